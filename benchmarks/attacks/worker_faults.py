"""Workers that die at each step or run out of memory; and pickles in a database."""

from __future__ import annotations

import pickle
import resource
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final

import httpx2

from benchmarks.report import Figure, Section
from benchmarks.services import Service, begin_run, ended, numbers

__all__ = ["worker_faults"]

_CLEAR_SECONDS: Final = 120.0
_AT_ONCE: Final = 4
"""Services at the same time: eight of them do not start in time on a busy machine of two processors."""
_DYING: Final = """
import os, signal, sys
if "jointstiff.service.workers" in sys.orig_argv:
    import jointstiff.service.jobs as life
    import jointstiff.service.store.jobs as log
    from jointstiff.service.problems import WorkerLostError
    from jointstiff.solver.errors import SolverError

    def die(*_):
        os.kill(os.getpid(), signal.SIGKILL)

    def refuse(*_):
        raise SolverError("planted", remedy="none")

    def fail(self, job_id, failure, before=life.Jobs.fail):
        before(self, job_id, failure) if isinstance(failure, WorkerLostError) else die()
"""
_STEPS: Final = {
    "plan": "    life.Jobs.start = die\n",
    "compute": "    log.Steps.store_result = die\n",
    "conclude": "    life.Jobs.conclude = die\n",
    "fail": "    log.Steps.store_result = refuse\n    life.Jobs.fail = fail\n",
}
"""Code by which a worker dies in a step, each time."""
_UNABLE: Final = """
import os, sys
if "jointstiff.service.workers" in sys.orig_argv:
    with open(STARTED, "a") as file:
        file.write(".")
    os._exit(1)
"""
_UNABLE_SECONDS: Final = 30.0
"""With pauses of 2, 4, 8 and 16 s, a worker is started five times."""


@contextmanager
def _changed(folder: Path, code: str) -> Iterator[dict[str, str]]:
    """Yield the environment in which workers run some code first."""
    place = Path(tempfile.mkdtemp(dir=folder))
    (place / "sitecustomize.py").write_text(code, encoding="utf-8")
    yield {"PYTHONPATH": str(place)}


def worker_faults(
    new: Mapping[str, Callable[[], str]],
    configurations: int,
    resampling: dict[str, int],
    expected: dict[str, Any],
) -> Section:
    """Let workers meet their faults, many at the same time; SQLite's meet all of them.

    Args:
        new: makes a database, by its kind; one is `SQLite`.
        configurations: of the set.
        resampling: of its long run.
        expected: numbers of a run that nothing disturbs.
    """
    sqlite = new["SQLite"]
    with (
        tempfile.TemporaryDirectory(prefix="jointstiff-workers-") as name,
        ThreadPoolExecutor(_AT_ONCE) as pool,
    ):
        folder = Path(name)
        dying = {
            f"{step}, {kind}": pool.submit(_dies, make(), folder, _DYING + code, configurations, resampling)
            for kind, make in new.items()
            for step, code in _STEPS.items()
        }
        starved = pool.submit(_starved, sqlite(), configurations, resampling)
        unable = pool.submit(_unable, sqlite(), folder)
        planted = pool.submit(_planted, sqlite(), folder, configurations, resampling)
        dead, starving = {step: task.result() for step, task in dying.items()}, starved.result()
        pickled, (told, starts) = planted.result(), unable.result()
    rows = [
        (f"dies at the step {step}, each time", f"{run['state']}", f"{s:.0f} s")
        for step, (run, s) in dead.items()
    ]
    rows += [
        ("out of memory", starving["state"], ""),
        ("cannot start", f"{starts} starts in {_UNABLE_SECONDS:g} s", f"said after {told:.0f} s"),
        ("a pickle planted in the database", pickled, ""),
    ]
    died = "worker dies at the step {}: until a clear state"
    return Section(
        title="Workers",
        columns=("worker", "its job", "after"),
        rows=tuple(rows),
        figures=(
            *(Figure(died.format(step), s, "at most", _CLEAR_SECONDS, " s") for step, (_, s) in dead.items()),
            Figure.none("worker out of memory: run not the same", int(numbers(starving) != expected)),
            Figure("worker cannot start: until /health says so", told, "at most", _UNABLE_SECONDS, " s"),
            Figure(f"worker cannot start: starts in {_UNABLE_SECONDS:g} s", starts, "at most", 6),
            Figure.none("pickle in the database: run, or its job does not end", int(pickled != "failed")),
        ),
    )


def _dies(
    database: str, folder: Path, code: str, configurations: int, resampling: dict[str, int]
) -> tuple[dict[str, Any], float]:
    """Return the run, and the time until it had ended [s]."""
    with (
        _changed(folder, code) as environment,
        Service(database, 1, environment=environment) as service,
        httpx2.Client(base_url=service.url, timeout=90) as client,
    ):
        address = begin_run(client, configurations, resampling)
        began = time.monotonic()
        run = ended(client, address, 1.5 * _CLEAR_SECONDS)
        seconds = time.monotonic() - began
    return run, seconds if run["state"] == "failed" and run["error"] else float("inf")


def _starved(database: str, configurations: int, resampling: dict[str, int]) -> dict[str, Any]:
    """Take a worker all further memory in the middle; the one that follows has enough."""
    with Service(database, 1) as service, httpx2.Client(base_url=service.url, timeout=90) as client:
        address = begin_run(client, configurations, resampling)
        while client.get(address).json()["progress"]["done"] == 0:
            time.sleep(0.05)
        for pid in service.workers():
            resource.prlimit(pid, resource.RLIMIT_DATA, (1 << 20, 1 << 20))
        return ended(client, address, _CLEAR_SECONDS)


def _unable(database: str, folder: Path) -> tuple[float, int]:
    """Return the time until /health tells of workers that cannot start [s], and how many were started."""
    started = folder / "started"
    code = _UNABLE.replace("STARTED", repr(str(started)))
    with _changed(folder, code) as environment, Service(database, 1, environment=environment) as service:
        began, told = time.monotonic(), float("inf")
        while time.monotonic() - began < _UNABLE_SECONDS:
            found = httpx2.get(f"{service.url}/health", timeout=20).json()
            if found["failing_workers"]:
                told = min(told, time.monotonic() - began)
            time.sleep(0.2)
    return told, started.stat().st_size


class _Planted:
    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return open, (str(self._path), "w")


def _planted(database: str, folder: Path, configurations: int, resampling: dict[str, int]) -> str:
    """Return what becomes of a job of which a step in the database holds a pickle."""
    ran = folder / "ran"
    with Service(database, 0) as service, httpx2.Client(base_url=service.url, timeout=90) as client:
        address = begin_run(client, configurations, resampling)
    job_id, draws = address.rpartition("/")[2], resampling["repetitions"]
    step = (job_id, 0, draws, pickle.dumps(_Planted(ran)))
    with closing(sqlite3.connect(database.removeprefix("sqlite:///"))) as connection, connection:
        connection.execute("DELETE FROM job_steps")
        connection.execute("INSERT INTO job_steps (job_id, start, units, result) VALUES (?, ?, ?, ?)", step)
    with Service(database, 1) as service, httpx2.Client(base_url=service.url, timeout=90) as client:
        state = str(ended(client, address, _CLEAR_SECONDS)["state"])
    return "RUN" if ran.exists() else state
