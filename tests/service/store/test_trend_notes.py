"""Notes in trends in both databases: added, listed by robot, never changed."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from jointstiff.service.problems.errors import QuotaError
from jointstiff.service.store.records import TrendNote
from jointstiff.service.store.store import Store

NOTE = TrendNote("robot", "baseline", datetime(2026, 11, 20, 12, tzinfo=UTC), "0123456789", "tablet", "{}")


def test_notes_come_back_oldest_first_and_by_robot(database_url):
    unsigned = replace(NOTE, kind="acknowledgement", key_id=None, key_name=None, document='{"note": "µ"}')
    with Store.open(database_url) as store:
        for note in (NOTE, replace(NOTE, robot_id="other"), unsigned):
            store.trend_notes.add(note)
    with Store.open(database_url) as store:
        assert store.trend_notes.of(robot_id="robot") == [NOTE, unsigned]
        assert store.trend_notes.of(robot_id="nobody") == []
        assert store.trend_notes.of(robot_id="a\x00b") == []


def test_a_full_database_takes_none():
    with Store.open("sqlite://", most_bytes=1) as store, pytest.raises(QuotaError):
        store.trend_notes.add(NOTE)
