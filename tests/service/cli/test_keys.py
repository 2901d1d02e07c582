"""Keys at the terminal: they are shown once, kept as a hash, listed, revoked and linked."""

import re
from datetime import UTC, datetime, timedelta
from functools import partial

import pytest
from support.terminal import terminal

from jointstiff.service.problems import KeyRefusedError
from jointstiff.service.security.keys import Keyring, KeysFile, KeysFileError, hash_secret, make_key
from jointstiff.service.store.store import Store

NEW = "use another key; create one with `jointstiff keys create NAME --role ROLE`"
WRITE = "write the file with `jointstiff keys create NAME --role ROLE --keys-file FILE`"
run = partial(terminal, width=160)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder without a database."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def created(*options):
    """Create a key; return its text, id and secret."""
    made = run("keys", "create", "tablet hall 3", "--role", "operator", "--expires", "2999-01-01", *options)
    text = made.stdout.strip()
    assert (made.exit_code, made.stdout) == (0, f"{text}\n")
    return text, *text.split("_")[1:3]


@pytest.mark.parametrize("place", [[], ["--keys-file", "keys.json"]], ids=["database", "file"])
def test_a_key_is_shown_once_and_kept_until_it_is_revoked(folder, place):
    text, key_id, secret = created(*place)
    with Store.open("sqlite:///jointstiff.db") as kept:
        ring = Keyring(kept, folder / "keys.json" if place else None)
        ring.read_keys()
        found = ring.check(text)
        assert (found.id, found.name, found.role) == (key_id, "tablet hall 3", "operator")
        assert (found.expires_at, len(found.key_hash)) == (datetime(2999, 1, 1, tzinfo=UTC), 64)
        assert secret not in repr(found)
        listed = run("keys", "list", *place).stdout
        assert "valid until 2999-01-01 00:00" in listed
        assert key_id in listed
        assert secret not in listed
        revoked = run("keys", "revoke", key_id, *place)
        assert revoked.stdout == (
            f"revoked {key_id}, tablet hall 3; running services refuse this key within a second\n"
        )
        ring.read_keys()
        assert (ring.find(key_id), ring.has_keys()) == (None, False)
        with pytest.raises(KeyRefusedError) as caught:
            ring.check(text)
        assert str(caught.value) == f"the key was revoked: {NEW}"
        assert "│ revoked 20" in run("keys", "list", *place).stdout
        audit = [(one.operation, one.address, one.path) for one in kept.audit.page(9).records]
    if not place:
        assert audit[0] == ("revokeKey", "terminal", f"/v1/keys/{key_id}")
        assert audit[1][:2] == ("createKey", "terminal")
    assert secret.encode() not in b"".join(each.read_bytes() for each in folder.iterdir())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["create", "x"], "Missing option '--role'. Choose from: viewer, operator, admin"),
        (
            ["create", "x", "--role", "owner"],
            "Invalid value for '--role': 'owner' is not one of 'viewer', 'operator', 'admin'.",
        ),
        (
            ["create", " ", "--role", "viewer"],
            "Invalid value for NAME: must be 1 to 200 printable characters",
        ),
        (
            ["create", "x", "--role", "viewer", "--expires", "2001-01-01"],
            "Invalid value for --expires: must be in the future",
        ),
        (
            ["create", "x", "--role", "viewer", "--keys-file", "missing/keys.json"],
            f"the file of keys missing/keys.json cannot be used: No such file or directory remedy: {WRITE}",
        ),
        (
            ["list", "--keys-file", "missing.json"],
            f"the file of keys missing.json cannot be used: No such file or directory remedy: {WRITE}",
        ),
        (
            ["revoke", "0000000000"],
            "there is no key '0000000000' remedy: see `jointstiff keys list` for the ids",
        ),
        (["link", "0000000000"], "no valid key has the id '0000000000' remedy: see `jointstiff keys list`"),
    ],
)
def test_what_cannot_be_done_with_keys_is_said(arguments, said):
    created()
    refused = run("keys", *arguments)
    assert refused.exit_code == 2
    assert refused.stdout == ""
    assert said in " ".join(refused.stderr.split())


@pytest.mark.parametrize("arguments", [["list"], ["revoke", "x"], ["link", "x"]])
def test_to_look_for_keys_makes_no_database(folder, arguments):
    refused = run("keys", *arguments, "--database", "sqlite:///none.db")
    assert refused.exit_code == 2
    assert " ".join(refused.stderr.split()) == (
        "the database none.db does not exist remedy: "
        "give sqlite:///path/to/file.db or postgresql://user:password@host/database"
    )
    assert not (folder / "none.db").exists()


def test_a_link_has_its_secret_behind_the_number_sign_and_begins_a_session_of_its_key():
    _, key_id, _ = created()
    linked = run("keys", "link", key_id, "--server", "https://cell3.example/")
    shown = linked.stdout
    until = (
        f"{datetime.now(UTC) + timedelta(minutes=10):%H:%M}",
        f"{datetime.now(UTC) + timedelta(minutes=9):%H:%M}",
    )
    assert "signs one browser in as tablet hall 3 (operator), until " in linked.stderr
    assert any(f"until {time} UTC" in linked.stderr for time in until)
    line = r"^https://cell3\.example/#/sign-in/(jsl_[A-Za-z0-9]{43})$"
    (token,) = re.findall(line, shown, re.MULTILINE)
    assert "█" in shown
    with Store.open("sqlite:///jointstiff.db") as kept:
        soon = datetime.now(UTC) + timedelta(minutes=9)
        assert kept.sessions.redeem(hash_secret(token), soon) == key_id
        assert kept.sessions.redeem(hash_secret(token), soon) is None


def test_a_file_of_keys_names_each_once(folder):
    path, record = folder / "keys.json", make_key("key", "viewer", datetime.now(UTC), None).record
    KeysFile(path).add(record)
    assert [one.id for one in KeysFile(path).all()] == [record.id]
    KeysFile(path).add(record)
    with pytest.raises(KeysFileError) as caught:
        KeysFile(path).all()
    assert str(caught.value) == f"the file of keys {path} cannot be used: two keys have the same id: {WRITE}"
