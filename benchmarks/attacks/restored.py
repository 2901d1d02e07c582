"""Backups made while clients post, restored and compared with what was acknowledged."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2

from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Section
from benchmarks.services import Service, post_campaign
from jointstiff.service.store.backups import back_up, restore
from jointstiff.service.workers.doctor import examine

__all__ = ["restored"]


def restored(kinds: dict[str, Callable[[], str]], seconds: float) -> Section:
    """Back databases up after some seconds of posts that go on, and restore each to a new one."""
    found = {kind: _restored(new, seconds) for kind, new in kinds.items()}
    return Section(
        title="Backup while a client posts robots and runs, restored to another database",
        columns=("database", "acknowledged before", "not there or not the same", "doctor"),
        rows=tuple(
            (kind, str(count), str(odd), faults or "ok") for kind, (count, odd, faults) in found.items()
        ),
        figures=tuple(
            figure
            for kind, (_, odd, faults) in found.items()
            for figure in (
                Figure(
                    f"{kind}, restored: acknowledged before and not there, or not the same", odd, "at most", 0
                ),
                Figure(f"{kind}, restored: the doctor finds something", int(bool(faults)), "at most", 0),
            )
        ),
        notes=("that `doctor` finds planted faults: tests/service/workers/test_doctor.py",),
    )


def _restored(new: Callable[[], str], seconds: float) -> tuple[int, int, str]:
    """Return how many were acknowledged before, how many of them are odd, and what the doctor finds."""
    database, other = new(), new()
    stop, told = threading.Event(), dict[str, dict[str, Any]]()
    with tempfile.TemporaryDirectory(prefix="jointstiff-backup-") as folder:
        with Service(database, 0) as service, httpx2.Client(base_url=service.url, timeout=90) as client:
            set_id = post_campaign(client, 19)
            poster = threading.Thread(target=_post_on, args=(service.url, set_id, stop, told))
            poster.start()
            time.sleep(seconds)
            before = dict(told)
            back_up(database, Path(folder) / "backup")
            stop.set()
            poster.join()
        restore(other, Path(folder) / "backup")
    with Service(other, 0) as service, httpx2.Client(base_url=service.url, timeout=90) as client:
        odd = sum(client.get(address).json() != answer for address, answer in before.items())
    return len(before), odd, "; ".join(f"{each.code}: {each.where}" for each in examine(other).faults)


def _post_on(url: str, set_id: str, stop: threading.Event, told: dict[str, dict[str, Any]]) -> None:
    robot = small_campaign().document["robot"]
    with httpx2.Client(base_url=url, timeout=90) as client:
        while not stop.is_set():
            for path, body in (("/v1/robots", robot), ("/v1/runs", {"measurement_set_id": set_id})):
                answer = client.post(path, json=body).raise_for_status()
                told[answer.headers["location"]] = answer.json()
