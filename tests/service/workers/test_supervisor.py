"""Workers that cannot start: tried less and less often, and said."""

import re
import resource
import threading
from pathlib import Path

import pytest
from support.processes import Service, ready, until, working

from jointstiff.service.library.client import Client
from jointstiff.service.workers import supervisor as supervisor_module
from jointstiff.service.workers.supervisor import Supervisor, pause_after
from jointstiff.simulator import default_arm, simulate_campaign


def test_pauses_double_up_to_a_minute():
    assert [pause_after(lives) for lives in (1, 2, 3, 4, 5, 6, 7, 10_000)] == [2, 4, 8, 16, 32, 60, 60, 60]


@pytest.mark.process
def test_a_worker_that_cannot_start_is_said_and_is_not_living(tmp_path, monkeypatch):
    """Its database is a folder, which no SQLite opens."""
    monkeypatch.setattr(supervisor_module, "pause_after", lambda _lives: 0.1)
    forgotten: list[str] = []
    with Supervisor(f"sqlite:///{tmp_path}", 1, "test", forgotten.append) as supervisor:
        assert supervisor.failing == 0
        until(lambda: supervisor.failing == 1)
    assert set(forgotten) == {"test-1"}
    assert len(forgotten) >= 2


@pytest.mark.process
def test_a_worker_that_lives_and_shows_no_sign_of_it_is_replaced(tmp_path, caplog):
    """Two looks in a row find it silent, the third would find another process of its name."""
    replaced = threading.Event()
    looks: list[str] = []

    def is_silent(name: str) -> bool:
        looks.append(name)
        return len(looks) != 2  # one look alone is no proof

    with Supervisor(
        f"sqlite:///{tmp_path / 'x.db'}", 1, "test", lambda _: replaced.set(), is_silent, 0.2, 0.1
    ):
        assert replaced.wait(60)
    assert len(looks) >= 4
    assert set(looks) == {"test-1"}
    assert "worker test-1 is silent; ending it" in caplog.text


@pytest.mark.process
def test_a_worker_without_memory_ends(tmp_path):
    """It would show signs of life and carry out nothing."""
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    service = Service(url, "--workers", "0")
    try:
        with working(url, "w1") as worker, Client(service.url) as client:
            ready(worker)
            used = 1024 * int(
                re.search(r"VmSize:\s+(\d+)", Path(f"/proc/{worker.pid}/status").read_text())[1]
            )
            resource.prlimit(worker.pid, resource.RLIMIT_AS, (used, used))
            many = {"size": 10, "repetitions": 5_000, "seed": 1}
            campaign = simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)
            client.post(campaign | {"run": {"resampling": many}})
            assert worker.wait(120) == 70
    finally:
        service.stop()
