"""`jointstiff keys`: keys made, listed and revoked on a database or in a file; links as QR codes."""

import re
from datetime import UTC, datetime, timedelta
from functools import partial

import pytest
from support.terminal import terminal

from jointstiff.service.security.keys import Keyring, digest
from jointstiff.service.store.store import Store


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return partial(terminal, "keys")


@pytest.mark.parametrize("place", [(), ("--keys-file", "keys.json")], ids=["database", "file"])
def test_a_key_is_made_listed_and_revoked(place, command, tmp_path):
    made = command("create", "tablet hall 3", "--role", "operator", "--expires", "2999-01-01", *place)
    assert made.exit_code == 0, made.output
    key = made.stdout.strip()  # and nothing else, for $(…)
    with Store.open("sqlite:///jointstiff.db") as store:
        keyring = Keyring(store, tmp_path / "keys.json" if place else None)
        keyring.look()
        found = keyring.check(key)
        assert (found.name, found.role) == ("tablet hall 3", "operator")
        assert found.expires_at == datetime(2999, 1, 1, tzinfo=UTC)
        listed = command("list", *place).stdout
        assert found.id in listed
        assert "2999-01-01" in listed
        assert key.split("_")[2] not in listed
        assert command("revoke", found.id, *place).exit_code == 0
        keyring.look()
        assert keyring.find(found.id) is None
        assert "revoked" in command("list", *place).stdout
        entries = store.audit.page(9).records
    noted = [(entry.operation, entry.address, entry.path) for entry in entries]
    path = f"/v1/keys/{found.id}"
    expected = [("revokeKey", "terminal", path), ("createKey", "terminal", path)]
    assert noted == ([] if place else expected)


@pytest.mark.parametrize(
    "arguments",
    [
        ("create", "x"),
        ("create", "x", "--role", "owner"),
        ("create", " ", "--role", "viewer"),
        ("create", "x", "--role", "viewer", "--expires", "2001-01-01"),
        ("create", "x", "--role", "viewer", "--keys-file", "missing/keys.json"),
        ("revoke", "0000000000"),
        ("link", "0000000000"),
        ("list", "--keys-file", "missing.json"),
    ],
)
def test_what_cannot_be_done_is_refused(arguments, command):
    ended = command(*arguments)
    assert ended.exit_code == 2
    assert "jst_" not in ended.stdout


def test_a_link_has_its_secret_after_the_number_sign_and_begins_a_session(command):
    key_id = command("create", "tablet", "--role", "viewer").stdout.split("_")[1]
    shown = command("link", key_id, "--server", "https://cell3.example/")
    assert shown.exit_code == 0, shown.output
    (token,) = re.findall(
        r"^https://cell3\.example/#/sign-in/(jsl_[A-Za-z0-9]{43})$", shown.stdout, re.MULTILINE
    )
    assert "█" in shown.stdout or "\x1b[" in shown.stdout  # the QR code
    now = datetime.now(UTC)
    with Store.open("sqlite:///jointstiff.db") as store:
        assert store.sessions.redeem(digest(token), now + timedelta(minutes=9)) == key_id


@pytest.mark.parametrize("arguments", [["list"], ["revoke", "x"], ["link", "x"]])
def test_a_database_that_is_not_there_is_not_made(arguments, tmp_path):
    database = tmp_path / "none.db"
    done = terminal("keys", *arguments, "--database", f"sqlite:///{database}")
    assert done.exit_code == 2
    assert "there is no database" in done.output
    assert not database.exists()
