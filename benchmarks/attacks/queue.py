"""The queue of long jobs: many runs, processes and a server that are stopped, large jobs beside small ones.

By name only, on a quiet machine: some ten minutes, or two to three for each `--part` of 1/4 to 4/4.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import httpx2

from benchmarks.report import Figure, Part, Section
from benchmarks.services import (
    PostgresqlServer,
    Service,
    begin_run,
    cpu,
    ended,
    followed,
    numbers,
    post_campaign,
    postgresql,
    running,
    undisturbed,
    worker,
)

__all__ = ["run"]

RUNS, WORKERS, SERVICES = 300, 3, 2
CONFIGURATIONS, RESAMPLING = 200, {"size": 100, "repetitions": 8_000}
"""Of a short run: two steps, half a second."""
LONG_CONFIGURATIONS, LONG = 400, {"size": 100, "repetitions": 100_000}
"""Of a long one: 25 steps."""
_END_SECONDS: Final = 900.0
_STOPPED_SECONDS: Final = 180.0
"""After which a run beside a stopped worker is waited for no longer."""
_FROZEN_SECONDS: Final = 45.0
_ANSWER_SECONDS: Final = 10.0
_SHARE_SECONDS: Final = 40.0
_WAITING: Final = 12
"""Short runs that wait at any time beside a long one: full load."""
_STOPS: Final = """
import os, pathlib, signal, sys
if "jointstiff.service.workers" in sys.orig_argv:
    import sqlalchemy as sa
    from jointstiff.service.store.jobs import Steps
    from jointstiff.service.store.tables import jobs
    mark, before = pathlib.Path({mark!r}), Steps.store_result

    def store_result(steps, job_id, span, result):
        try:
            mark.touch(exist_ok=False)
        except FileExistsError:
            return before(steps, job_id, span, result)
        mark.write_text(str(os.getpid()))
        lock = sa.update(jobs).where(jobs.c.id == job_id).values(name=jobs.c.name)
        with steps._database.writing() as connection:
            connection.execute(lock)
            os.kill(os.getpid(), signal.SIGSTOP)
            for _ in range(100):  # this thread may go on for a moment
                connection.execute(lock)
        return before(steps, job_id, span, result)

    Steps.store_result = store_result
"""
"""Code by which the first worker that keeps a step is stopped inside its transaction."""


def run(*, quick: bool, part: Part) -> list[Section]:
    """Use services on a PostgreSQL server of our own, and one on an SQLite file."""
    with tempfile.TemporaryDirectory(prefix="jointstiff-queue-") as name, postgresql() as server:
        folder = Path(name)
        studies: list[Callable[[], Section]] = [
            lambda: _many(server(), 12 if quick else RUNS),
            lambda: _stopped(server, folder),
            lambda: _frozen(server, 3.0 if quick else _FROZEN_SECONDS),
            lambda: _shared(
                {"SQLite": f"sqlite:///{folder / 'shared.db'}", "PostgreSQL": server()},
                5.0 if quick else _SHARE_SECONDS,
            ),
        ]
        return [studies[number]() for number in part.of(len(studies))]


# Many runs


def _many(database: str, count: int) -> Section:
    """Carry out runs by two services and three workers, of which one each is killed."""
    with ExitStack() as stack:
        services = [Service(database, 0) for _ in range(SERVICES)]
        stack.enter_context(services[0])
        clients = [stack.enter_context(httpx2.Client(base_url=each.url, timeout=60)) for each in services]
        workers = [stack.enter_context(worker(database, f"bench-{number}")) for number in range(WORKERS)]
        set_id = post_campaign(clients[0], CONFIGURATIONS)
        body = {"measurement_set_id": set_id, "resampling": RESAMPLING}

        def posted(number: int) -> str:
            key = {"Idempotency-Key": f"run {number}"}
            while True:
                for client in clients[number % SERVICES :] + clients[: number % SERVICES]:
                    with suppress(httpx2.TransportError):
                        answer = client.post("/v1/runs?wait=0", json=body, headers=key).raise_for_status()
                        return str(answer.headers["location"])

        began = time.monotonic()
        with ThreadPoolExecutor(4) as pool:
            futures = [pool.submit(posted, number) for number in range(count)]
            _until(lambda: sum(each.done() for each in futures) > count // 3)
            services[1].kill()
            _until(lambda: any(_states(clients[0])[state] for state in ("running", "succeeded")))
            workers[0].kill()
            addresses = [each.result() for each in futures]
        runs = [ended(clients[0], address, _END_SECONDS) for address in addresses]
        seconds = time.monotonic() - began
    expected = undisturbed(CONFIGURATIONS, RESAMPLING)
    succeeded = sum(each["state"] == "succeeded" for each in runs)
    twice = count - len({each["id"] for each in runs})
    other = sum(numbers(each) != expected for each in runs)
    return Section(
        title=f"{count} runs, {SERVICES} services, {WORKERS} workers on PostgreSQL; one of each is killed",
        columns=("runs", "succeeded", "stored twice", "other bits", "time"),
        rows=((str(count), str(succeeded), str(twice), str(other), f"{seconds:.0f} s"),),
        figures=(
            Figure("runs of two services and three workers: succeeded", succeeded, "at least", count),
            Figure.none(
                "runs of two services and three workers: stored twice, or of other bits", twice + other
            ),
        ),
    )


def _states(client: httpx2.Client) -> Counter[str]:
    items = client.get("/v1/jobs", params={"limit": "100"}).raise_for_status().json()["items"]
    return Counter(each["state"] for each in items)


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _END_SECONDS
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)


# A worker that is stopped


def _stopped(server: PostgresqlServer, folder: Path) -> Section:
    """Stop a worker inside a transaction; cancel nine times, and look at everything meanwhile."""
    found = {
        kind: _stopped_on(database, folder / kind)
        for kind, database in {
            "SQLite": f"sqlite:///{folder / 'stopped.db'}",
            "PostgreSQL": server(),
        }.items()
    }
    return Section(
        title="a worker is stopped inside a transaction; 2 workers, nine requests to cancel, looks meanwhile",
        columns=("database", "run ended elsewhere after", "looks", "slowest", "answers"),
        rows=tuple(
            (kind, f"{seconds:.1f} s", str(len(looks)), f"{max(s for _, s in looks):.1f} s", _counted(looks))
            for kind, (seconds, looks) in found.items()
        ),
        figures=tuple(
            figure
            for kind, (seconds, looks) in found.items()
            for figure in (
                Figure(f"{kind}, stopped worker: its run ends elsewhere", seconds, "at most", 60, " s"),
                Figure(
                    f"{kind}, stopped worker: slowest answer", max(s for _, s in looks), "at most", 10, " s"
                ),
                Figure.none(
                    f"{kind}, stopped worker: answers that are neither 200 nor 503",
                    sum(status not in {200, 503} for status, _ in looks),
                ),
            )
        ),
    )


def _stopped_on(database: str, folder: Path) -> tuple[float, list[tuple[int, float]]]:
    """Return the time until the run has ended elsewhere [s]; status and time of each answer [s]."""
    folder.mkdir()
    mark = folder / "mark"
    (folder / "sitecustomize.py").write_text(_STOPS.format(mark=str(mark)), encoding="utf-8")
    looks: list[tuple[int, float]] = []
    with (
        Service(database, 2, environment={"PYTHONPATH": str(folder)}) as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
        ThreadPoolExecutor(12) as pool,
    ):
        address = begin_run(client, CONFIGURATIONS, RESAMPLING)
        victim = begin_run(client, CONFIGURATIONS, RESAMPLING)
        _until(lambda: mark.exists() and mark.read_text() != "")
        began = time.monotonic()
        cancels = [pool.submit(_timed, client, "PATCH", victim) for _ in range(9)]
        while True:
            look = _timed(client, "GET", address)
            looks.append(look[:2])
            if look[2].get("state") not in {None, "queued", "running"}:
                break
            if time.monotonic() - began > _STOPPED_SECONDS:
                break
            looks.append(_timed(client, "GET", "/v1/jobs")[:2])
            time.sleep(0.2)
        seconds = time.monotonic() - began
        looks += [each.result()[:2] for each in cancels]
        pid = int(mark.read_text())
        if running(pid):
            os.kill(pid, signal.SIGCONT)
    return seconds, looks


def _timed(client: httpx2.Client, method: str, path: str) -> tuple[int, float, Mapping[str, Any]]:
    """Return status, time [s] and body of an answer."""
    began = time.monotonic()
    answer = client.patch(path, json={"cancelled": True}) if method == "PATCH" else client.get(path)
    return answer.status_code, time.monotonic() - began, answer.json()


def _counted(looks: list[tuple[int, float]]) -> str:
    counts = Counter(status for status, _ in looks)
    return ", ".join(f"{count} × {status}" for status, count in sorted(counts.items()))


# A server that is stopped


def _frozen(server: PostgresqlServer, seconds: float) -> Section:
    """Stop all processes of the server for a while, and ask the service all the time."""
    looks: list[tuple[int, float]] = []
    database = server()
    with (
        Service(database, 1) as service,
        httpx2.Client(base_url=service.url, timeout=120) as client,
        ThreadPoolExecutor(8) as pool,
    ):
        set_id = post_campaign(client, CONFIGURATIONS)
        address = begin_run(client, LONG_CONFIGURATIONS, LONG)
        body = {"measurement_set_id": set_id, "resampling": RESAMPLING}

        def asked(number: int) -> list[tuple[int, float]]:
            found, deadline = [], time.monotonic() + seconds
            while time.monotonic() < deadline:
                began = time.monotonic()
                if number % 4 == 3:
                    answer = client.post("/v1/runs?wait=0", json=body)
                else:
                    answer = client.get((address, "/v1/jobs", "/v1/robots")[number % 4])
                found.append((answer.status_code, time.monotonic() - began))
                time.sleep(0.5)
            return found

        processes = [server.pid, *_children(server.pid)]
        for pid in processes:
            os.kill(pid, signal.SIGSTOP)
        try:
            for each in [pool.submit(asked, number) for number in range(8)]:
                looks += each.result()
        finally:
            for pid in processes:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
        run = _after(client, address)
    slowest = max(s for _, s in looks)
    return Section(
        title=f"all processes of PostgreSQL are stopped for {seconds:.0f} s; eight clients ask and post",
        columns=("answers", "slowest", "the run that was open"),
        rows=((_counted(looks), f"{slowest:.1f} s", str(run["state"])),),
        figures=(
            Figure("PostgreSQL frozen: slowest answer", slowest, "at most", _ANSWER_SECONDS, " s"),
            Figure.none(
                "PostgreSQL frozen: answers that are no success and not 503",
                sum(status >= 300 and status != 503 for status, _ in looks),
            ),
            Figure.none("PostgreSQL frozen: open run not succeeded", int(run["state"] != "succeeded")),
        ),
    )


def _after(client: httpx2.Client, address: str) -> dict[str, Any]:
    """Return a run once it has ended; the service may say for a while yet that the database is away."""
    deadline = time.monotonic() + _END_SECONDS
    while time.monotonic() < deadline:
        with suppress(httpx2.HTTPStatusError):
            return ended(client, address, _END_SECONDS)
        time.sleep(0.5)
    return {"state": "unknown"}


def _children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


# Large jobs beside small ones


def _shared(databases: Mapping[str, str], seconds: float) -> Section:
    found = {kind: _shared_on(database, seconds) for kind, database in databases.items()}
    return Section(
        title=f"one worker: a long run alone, behind it a short one, and beside {_WAITING} that always wait",
        columns=("database", "share alone that computes", "short one waits", "share beside"),
        rows=tuple(
            (kind, f"{busy:.2f}", f"{wait:.2f} s", f"{share:.3f}")
            for kind, (busy, wait, share) in found.items()
        ),
        figures=tuple(
            figure
            for kind, (busy, wait, share) in found.items()
            for figure in (
                Figure(f"{kind}: share of its time that a worker alone computes", busy, "at least", 0.85),
                Figure(f"{kind}: a short run behind a long one ends after", wait, "at most", 2, " s"),
                Figure(f"{kind}: share of a long run at full load", share, "at least", 0.125),
            )
        ),
        notes=("the share of a long run is its draws a second beside the others, over those alone",),
    )


def _shared_on(database: str, seconds: float) -> tuple[float, float, float]:
    """Return share of time that computes, wait of a short run [s], share at full load."""
    with (
        Service(database, 1) as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        short = {"measurement_set_id": post_campaign(client, CONFIGURATIONS), "resampling": RESAMPLING}
        long = {"measurement_set_id": post_campaign(client, LONG_CONFIGURATIONS), "resampling": LONG}

        def begin(body: dict[str, Any]) -> str:
            return str(client.post("/v1/runs?wait=0", json=body).raise_for_status().headers["location"])

        ended(client, begin(short), _END_SECONDS)  # the worker has started
        (worker,) = service.workers()

        address, used, began = begin(long), cpu(worker), time.monotonic()
        ended(client, address, _END_SECONDS)
        alone = time.monotonic() - began
        busy = (cpu(worker) - used) / alone

        address = begin(long)
        next(run for run in followed(client, address, _END_SECONDS) if run["progress"]["done"])
        began = time.monotonic()
        ended(client, begin(short), _END_SECONDS)
        wait = time.monotonic() - began
        ended(client, address, _END_SECONDS)

        address, waiting, done = begin(long), list[str](), 0
        began = time.monotonic()
        while time.monotonic() - began < seconds and done < LONG["repetitions"]:
            states = [client.get(each).json()["state"] for each in waiting]
            waiting = [
                each for each, state in zip(waiting, states, strict=True) if state in {"queued", "running"}
            ]
            waiting += [begin(short) for _ in range(_WAITING - len(waiting))]
            time.sleep(0.2)
            done = client.get(address).json()["progress"]["done"]
        share = done / (time.monotonic() - began) * alone / LONG["repetitions"]
    return busy, wait, share
