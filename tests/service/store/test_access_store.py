"""Sessions, one-time links and journals in both databases."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from jointstiff.service.problems import CursorError, QuotaError
from jointstiff.service.store import access as access_module
from jointstiff.service.store.store import SESSION_IDLE, SESSION_LONGEST, Store
from jointstiff.service.store.tables import AuditEntry, SessionRecord, TrendNote

NOW = datetime(2026, 11, 20, 12, tzinfo=UTC)
MOMENT = timedelta(seconds=1)
SESSION = SessionRecord("a" * 64, "0123456789", NOW, NOW)
ENTRY = AuditEntry(NOW, "0123456789", "tablet", "192.0.2.1", "POST", "createRun", "/v1/runs", 201)


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        yield opened


def test_a_session_ends_idle_and_for_good(store):
    store.sessions.begin(SESSION)
    assert store.sessions.find(SESSION.token_hash, NOW + SESSION_IDLE - MOMENT) == SESSION
    assert store.sessions.find(SESSION.token_hash, NOW + SESSION_IDLE) is None
    at = NOW
    while at < NOW + SESSION_LONGEST:
        assert store.sessions.find(SESSION.token_hash, at) is not None
        store.sessions.used(SESSION.token_hash, at)
        at += SESSION_IDLE / 2
    assert store.sessions.find(SESSION.token_hash, NOW + SESSION_LONGEST) is None


def test_a_session_ends_when_it_is_ended(store):
    store.sessions.begin(SESSION)
    store.sessions.end(SESSION.token_hash)
    store.sessions.end(SESSION.token_hash)
    assert store.sessions.find(SESSION.token_hash, NOW) is None


def test_sessions_of_a_key_are_bounded_and_the_ended_are_removed(store, monkeypatch):
    monkeypatch.setattr(access_module, "MOST_SESSIONS", 3)
    other = replace(SESSION, token_hash="b" * 64, key_id="other")
    store.sessions.begin(other)
    times = [NOW + number * MOMENT for number in range(5)]
    for number, at in enumerate(times):
        store.sessions.begin(replace(SESSION, token_hash=str(number), created_at=at, used_at=at))
    assert [bool(store.sessions.find(str(number), times[-1])) for number in range(5)] == [False] * 2 + [
        True
    ] * 3
    assert store.sessions.find(other.token_hash, NOW) == other


def test_a_link_begins_one_session_within_its_time(store):
    ends = NOW + timedelta(minutes=10)
    store.sessions.offer("a", "key", NOW, ends)
    store.sessions.offer("b", "key", NOW, ends)
    assert store.sessions.redeem("a", ends - MOMENT) == "key"
    assert store.sessions.redeem("a", NOW) is None
    assert store.sessions.redeem("b", ends) is None
    assert store.sessions.redeem("nobody's", NOW) is None


def test_of_many_who_use_a_link_one_gets_the_key(store):
    store.sessions.offer("a", "key", NOW, NOW + MOMENT)
    with ThreadPoolExecutor(8) as pool:
        got = list(pool.map(lambda _: store.sessions.redeem("a", NOW), range(8)))
    assert sorted(got, key=str) == [None] * 7 + ["key"]


def test_the_audit_is_listed_newest_first(store):
    for number in range(5):
        store.audit.add(replace(ENTRY, status=200 + number, key_id=None if number % 2 else ENTRY.key_id))
    first = store.audit.page(3)
    assert [entry.status for entry in first.records] == [204, 203, 202]
    rest = store.audit.page(3, first.next)
    assert [entry.status for entry in rest.records] == [201, 200]
    assert rest.next is None
    mine = store.audit.page(9, key_id=ENTRY.key_id).records
    assert [entry.status for entry in mine] == [204, 202, 200]
    assert mine[0] == replace(ENTRY, status=204)
    with pytest.raises(CursorError):
        store.audit.page(3, "x")


def test_no_method_changes_or_removes_an_entry(store):
    assert {name for name in dir(store.audit) if not name.startswith("_")} == {"add", "of", "page"}


NOTE = TrendNote("robot", "baseline", NOW, "0123456789", "tablet", "{}")


def test_notes_come_back_oldest_first_and_by_robot(store):
    unsigned = replace(NOTE, kind="acknowledgement", key_id=None, key_name=None, document='{"note": "µ"}')
    for note in (NOTE, replace(NOTE, robot_id="other"), unsigned):
        store.trend_notes.add(note)
    assert store.trend_notes.of(robot_id="robot") == [NOTE, unsigned]
    assert store.trend_notes.of(robot_id="nobody") == []
    assert store.trend_notes.of(robot_id="a\x00b") == []


def test_a_full_database_takes_no_note():
    with Store.open("sqlite://", most_bytes=1) as store, pytest.raises(QuotaError):
        store.trend_notes.add(NOTE)
