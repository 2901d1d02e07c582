"""Workers that cannot start: tried less and less often, and said."""

from __future__ import annotations

import threading

import pytest

from jointstiff.service.workers.supervisor import Supervisor, pause_after


def test_pauses_double_up_to_a_minute():
    assert [pause_after(lives) for lives in (1, 2, 3, 4, 5, 6, 7, 10_000)] == [2, 4, 8, 16, 32, 60, 60, 60]


@pytest.mark.process
def test_a_worker_that_cannot_start_is_said_and_is_not_living(tmp_path):
    """Its database is a folder, which no SQLite opens."""
    forgotten: list[str] = []
    twice = threading.Event()

    def forget(name: str) -> None:
        forgotten.append(name)
        if len(forgotten) == 3:  # by then the second short life has been counted
            twice.set()

    with Supervisor(f"sqlite:///{tmp_path}", 1, "test", forget) as supervisor:
        assert supervisor.failing == 0
        assert twice.wait(120)
        assert supervisor.failing == 1
    assert set(forgotten) == {"test-1"}
