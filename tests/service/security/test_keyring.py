"""Keys: their text, what is stored of them, who recognises them, and what wrong ones cost."""

import json
import re
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import select
from support.examples import examples
from support.in_process import Client
from support.processes import until

from jointstiff.service.api.health import Watch
from jointstiff.service.problems import KeyRefusedError, NotFoundError
from jointstiff.service.security import access
from jointstiff.service.security.access import FORGIVEN, get_network
from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.security.keys import (
    Keyring,
    KeysFile,
    KeysFileError,
    hash_secret,
    hide_secrets,
    make_key,
    parse_key_id,
)
from jointstiff.service.store.access import FORGET, MOST_WRONG, WrongKeys
from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import SessionRecord, wrong_keys

NOW = datetime.now(UTC)
KEYS = [make_key(f"key {number}", "viewer", NOW, None) for number in range(3)]


def test_a_key_has_an_id_256_bits_and_a_check_sum():
    text, record = KEYS[0]
    name, key_id, secret, check = text.split("_")
    assert (name, key_id) == ("jst", record.id)
    assert 62 ** len(secret) > 2**256
    assert int(check, 16) == zlib.crc32(text.rpartition("_")[0].encode())
    assert len({minted.text for minted in KEYS}) == len(KEYS)


def test_nothing_of_the_secret_is_stored():
    text, record = KEYS[0]
    secret = text.split("_")[2]
    assert secret not in repr(record)
    assert re.fullmatch(r"[0-9a-f]{64}", record.key_hash)


@given(place=st.integers(0, 65), letter=st.sampled_from("aZ09_-x"))
@examples(60)
def test_a_mistyped_key_is_told_from_a_wrong_one(place, letter):
    text = KEYS[0].text
    typed = text[:place] + letter + text[place + 1 :]
    if typed == text:
        assert parse_key_id(typed) == KEYS[0].record.id
    else:
        with pytest.raises(KeyRefusedError, match=r"mistyped|is not a key") as caught:
            parse_key_id(typed)
        assert "whole key" in caught.value.remedy


@pytest.mark.parametrize(
    "text",
    ["", "jst_", KEYS[0].text + "\n", KEYS[0].text + "0", "☃" * 67, "\ud800"],
    ids=["empty", "prefix", "line end", "too long", "snowmen", "surrogate"],  # the same in each process
)
def test_what_is_no_key_is_refused(text):
    with pytest.raises(KeyRefusedError):
        parse_key_id(text)


def test_keys_are_taken_out_of_texts():
    text = f"/v1/keys/{KEYS[0].text}/x?link=jsl_{'a' * 43}"
    assert hide_secrets(text) == "/v1/keys/jst_…/x?link=jsl_…"


def ring(store, *records):
    for record in records:
        store.keys.add(record)
    keyring = Keyring(store)
    keyring.read_keys()
    return keyring


def test_only_live_keys_open(database_url):
    expired = make_key("late", "admin", NOW, NOW - timedelta(seconds=1))
    with Store.open(database_url) as store:
        keyring = ring(store, KEYS[0].record, KEYS[1].record, expired.record)
        assert keyring.check(KEYS[0].text).name == "key 0"
        with pytest.raises(KeyRefusedError, match="does not belong to this service"):
            keyring.check(KEYS[2].text)
        with pytest.raises(KeyRefusedError, match="expired"):
            keyring.check(expired.text)
        assert keyring.find(expired.record.id) is None
        assert store.keys.revoke(KEYS[0].record.id, NOW).revoked_at == NOW
        assert store.keys.revoke(KEYS[0].record.id, NOW + timedelta(days=1)).revoked_at == NOW
        keyring.read_keys()
        with pytest.raises(KeyRefusedError, match="revoked"):
            keyring.check(KEYS[0].text)
        assert keyring.has_keys()
        with pytest.raises(NotFoundError):
            store.keys.revoke("0000000000", NOW)


def test_the_right_id_with_another_secret_is_wrong():
    _, key_id, secret, _ = KEYS[0].text.split("_")
    body = f"jst_{key_id}_{secret[::-1]}"
    forged = f"{body}_{zlib.crc32(body.encode()):08x}"
    with (
        Store.open("sqlite://") as store,
        pytest.raises(KeyRefusedError, match="does not belong to this service"),
    ):
        ring(store, KEYS[0].record).check(forged)


def test_last_uses_only_grow(database_url):
    with Store.open(database_url) as store:
        store.keys.add(KEYS[0].record)
        store.keys.mark_used(KEYS[0].record.id, NOW)
        store.keys.mark_used(KEYS[0].record.id, NOW - timedelta(hours=1))
        assert [key.last_used_at for key in store.keys.all()] == [NOW]


def test_a_file_has_hashes_and_its_keys_count_before_those_of_the_database(tmp_path):
    path = tmp_path / "keys.json"
    file = KeysFile(path)
    file.add(KEYS[0].record)
    file.add(KEYS[1].record)
    assert path.stat().st_mode & 0o077 == 0
    assert KEYS[0].text.split("_")[2] not in path.read_text()
    with Store.open("sqlite://") as store:
        keyring = Keyring(store, path)
        keyring.read_keys()
        assert [key.source for key in keyring.list_keys()] == ["file", "file"]
        assert keyring.check(KEYS[0].text).id == KEYS[0].record.id
        file.revoke(KEYS[0].record.id, NOW)
        keyring.read_keys()
        with pytest.raises(KeyRefusedError, match="revoked"):
            keyring.check(KEYS[0].text)
        assert keyring.check(KEYS[1].text)
        path.unlink()
        keyring.read_keys()
        assert not keyring.has_keys()


def test_a_service_that_runs_refuses_a_revoked_key_soon(tmp_path):
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    with Store.open(url) as store, Store.open(url) as terminal:
        keyring = ring(store, KEYS[0].record)
        with Watch(store, keyring):
            assert keyring.find(KEYS[0].record.id)
            terminal.keys.revoke(KEYS[0].record.id, NOW)
            until(lambda: keyring.find(KEYS[0].record.id) is None, seconds=10)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"{}",
        b'{"keys": [{"id": "x"}]}',
        json.dumps({"format": "jointstiff-keys-2", "keys": []}).encode(),
        b" " * (2 * 1024 * 1024),
    ],
    ids=["empty", "list", "object", "half a key", "another format", "2 MiB"],
)
def test_what_is_no_file_of_keys_is_refused(content, tmp_path):
    path = tmp_path / "keys.json"
    path.write_bytes(content)
    with pytest.raises(KeysFileError, match="cannot be used") as caught:
        KeysFile(path).all()
    assert "keys create" in caught.value.remedy
    with pytest.raises(KeysFileError):
        KeysFile(path).add(KEYS[0].record)
    assert path.read_bytes() == content


def test_wrong_keys_are_counted_by_network_for_all_services_and_forgotten(database_url):
    with Store.open(database_url) as store, closing(Database.open(database_url)) as other:
        now = [NOW]
        counts = [WrongKeys(store._database, lambda _: now[0]), WrongKeys(other, lambda _: now[0])]
        for number in range(2 * MOST_WRONG):
            assert counts[number % 2].count("192.0.2.1") == min(number, MOST_WRONG)
        assert counts[0].count("192.0.2.2") == 0
        now[0] += (MOST_WRONG - FORGIVEN) * FORGET
        assert counts[1].count("192.0.2.1") == FORGIVEN
        now[0] -= timedelta(hours=1)  # a clock that is set back forgives nothing, and adds nothing
        assert counts[0].count("192.0.2.1") == FORGIVEN + 1


def test_services_that_count_at_once_count_each_wrong_key(database_url):
    with Store.open(database_url) as first, Store.open(database_url) as second, ThreadPoolExecutor(8) as pool:
        counts = [store.wrong_keys.count for store in (first, second)]
        list(pool.map(lambda number: counts[number % 2]("192.0.2.1"), range(12)))
        assert 11 < counts[0]("192.0.2.1") <= 12


def test_services_of_one_database_share_the_throttle(database_url, monkeypatch):
    monkeypatch.setattr(access, "SLOW_SECONDS", 0.0)
    posture = AccessPolicy.from_address("127.0.0.1", (), access_control=True, require_key=True)
    wrong = {"Authorization": f"Bearer {make_key('stranger', 'admin', NOW, None).text}"}
    with Store.open(database_url) as first, Store.open(database_url) as second:
        first.keys.add(KEYS[0][1])
        services = [Client(store, posture) for store in (first, second)]
        statuses = [services[number % 2].get("/v1/robots", headers=wrong).status_code for number in range(16)]
        assert statuses == [401] * (FORGIVEN + 1) + [429] * (15 - FORGIVEN)
        good = {"Authorization": f"Bearer {KEYS[0][0]}"}
        assert {service.get("/v1/robots", headers=good).status_code for service in services} == {200}


def test_one_machine_has_one_count_however_many_addresses():
    networks = {get_network(f"2001:db8::{number:x}") for number in range(20)}
    assert networks == {get_network("2001:db8::ffff")} != {get_network("2001:db8:1::1")}
    assert get_network("192.0.2.1") != get_network("192.0.2.2")


def test_the_count_forgets_networks_rather_than_growing(monkeypatch):
    monkeypatch.setattr("jointstiff.service.store.access.MOST_NETWORKS", 8)
    with Store.open("sqlite://") as store:
        for number in range(24):
            store.wrong_keys.count(f"10.0.0.{number}")
        with store._database.reading() as connection:
            assert len(connection.execute(select(wrong_keys)).all()) == 8


def test_digests_take_any_text():
    assert len(hash_secret("\ud800")) == 64


def test_a_file_that_everyone_can_write_has_no_keys(tmp_path):
    path = tmp_path / "keys.json"
    KeysFile(path).add(KEYS[0].record)
    path.chmod(0o666)
    with pytest.raises(KeysFileError, match="chmod o-w"):
        KeysFile(path).all()


def test_sessions_of_a_key_do_not_come_back_with_its_file(tmp_path, caplog):
    path = tmp_path / "keys.json"
    KeysFile(path).add(KEYS[0].record)
    content = path.read_bytes()
    with Store.open("sqlite://") as store:
        keyring = Keyring(store, path)
        keyring.read_keys()
        store.sessions.begin(SessionRecord("hash", KEYS[0].record.id, NOW, NOW))
        store.sessions.offer("link", KEYS[0].record.id, NOW, NOW + timedelta(minutes=10))
        keyring.read_keys()
        assert store.sessions.find("hash", NOW)
        path.unlink()
        for _ in range(2):
            keyring.read_keys()
        assert [record.levelname for record in caplog.records] == ["ERROR"]  # not at each look
        path.write_bytes(content)
        keyring.read_keys()
        assert keyring.find(KEYS[0].record.id)
        assert store.sessions.find("hash", NOW) is None
        assert store.sessions.redeem("link", NOW) is None


def test_of_many_who_write_a_file_at_once_none_loses_a_key(tmp_path):
    path = tmp_path / "keys.json"
    minted = [make_key(f"key {number}", "viewer", NOW, None).record for number in range(16)]
    with ThreadPoolExecutor(16) as pool:
        list(pool.map(lambda record: KeysFile(path).add(record), minted))
    assert {key.id for key in KeysFile(path).all()} == {record.id for record in minted}
    assert [each.name for each in tmp_path.iterdir()] == ["keys.json"]
