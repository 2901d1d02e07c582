"""Worker processes on PostgreSQL: two beside one, the service's answers meanwhile, and cancelling.

Also what benchmarks need to run services that are killed and started again: processes, databases.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import quantiles
from types import TracebackType
from typing import Any, Final

import httpx
import psycopg

from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Section, seconds_text
from benchmarks.timing import Times, interleaved

__all__ = ["Service", "ServiceError", "numbers", "post_campaign", "postgresql", "run", "running"]

CONFIGURATIONS, REPETITIONS = 5_000, 20_000
FEW: Final = 1_000
"""Resamples, as many as the figure speaks of."""
CHECKS, CANCELS = 400, 5
_START_SECONDS: Final = 60.0
_END_SECONDS: Final = 600.0


class ServiceError(Exception):
    """The service, or its database, did not do what it should."""


class Service:
    """A service process on a port of its own, which it keeps when it is started again."""

    def __init__(self, database: str, workers: int, port: int | None = None) -> None:
        """Start it, and wait until it answers."""
        self.port = port or _free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        command = [sys.executable, "-m", "service", "serve", "--port", str(self.port)]
        command += ["--database", database, "--workers", str(workers)]
        with tempfile.TemporaryFile() as log:
            self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log)
            self._wait(lambda: _tail(log.fileno()))

    def __enter__(self) -> Service:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.terminate()
        self.process.wait(30)

    def workers(self) -> list[int]:
        """Process ids of its workers."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [int(pid) for task in tasks for pid in task.read_text().split()]

    def kill_worker(self) -> None:
        """Kill one worker with SIGKILL, as soon as there is one."""
        while not (workers := [pid for pid in self.workers() if running(pid)]):
            time.sleep(0.01)
        os.kill(workers[0], signal.SIGKILL)

    def kill(self, *, workers: bool = False) -> list[int]:
        """Kill the service with SIGKILL.

        Args:
            workers: kill them with it.

        Returns:
            The workers it had.
        """
        pids = self.workers()
        for pid in (self.process.pid, *(pids if workers else ())):
            os.kill(pid, signal.SIGKILL)
        self.process.wait()
        return pids

    def _wait(self, log: Callable[[], str]) -> None:
        deadline = time.monotonic() + _START_SECONDS
        while time.monotonic() < deadline and self.process.poll() is None:
            try:
                httpx.get(f"{self.url}/health", timeout=5.0)
            except httpx.TransportError:
                time.sleep(0.02)
            else:
                return
        self.process.kill()
        raise ServiceError(f"the service did not start: {log()}")


def run(*, quick: bool) -> list[Section]:
    """Measure on a PostgreSQL server of our own."""
    with postgresql() as new_database:
        return [
            _speed_up(new_database, quick=quick),
            _answers(new_database(), quick=quick),
            _cancelling(new_database(), quick=quick),
        ]


def _speed_up(new_database: Callable[[], str], *, quick: bool) -> Section:
    """The same run on one worker and on two; both services are there, only one of them has work."""
    many, few = (200, 100) if quick else (REPETITIONS, FEW)
    configurations = 50 if quick else CONFIGURATIONS
    with ExitStack() as stack:
        posts = {}
        for name, count in (("one worker", 1), ("two workers", 2)):
            service = stack.enter_context(Service(new_database(), count))
            posts[name] = _poster(stack.enter_context(_client(service)), configurations)
        heavy = interleaved({name: _with(post, many) for name, post in posts.items()}, rounds=3)
        light = interleaved({name: _with(post, few) for name, post in posts.items()}, rounds=3)
    rows = [*_rows(f"{many:,} resamples", heavy), *_rows(f"{few:,} resamples", light)]
    what = f"{many:,} resamples of {configurations:,} configurations, PostgreSQL: one worker / two"
    return Section(
        title=f"Workers: resamples of {configurations:,} configurations, posted to ended",
        columns=("candidate", "time / two workers", "median", "numbers"),
        rows=tuple(rows),
        figures=(
            Figure(what, heavy.ratio("one worker", "two workers"), "at least", 1.7, "×"),
            Figure("the same: runs whose numbers differ", _different(heavy, light), "at most", 0),
        ),
        notes=(f"{few:,} resamples are too few to take long: the set's own identification then counts",),
        data={"heavy": heavy.seconds, "light": light.seconds},
    )


def _rows(what: str, times: Times) -> list[tuple[str, ...]]:
    two, same = "two workers", "the same" if not _different(times) else "DIFFERENT"
    return [
        (f"{what}, {name}", f"{times.ratio(name, two):.2f}", seconds_text(times.median(name)), same)
        for name in times.seconds
    ]


def _different(*several: Times) -> int:
    return sum(len({json.dumps(result) for result in times.results.values()}) > 1 for times in several)


def _with(post: Callable[[int], dict[str, Any]], repetitions: int) -> Callable[[], dict[str, Any]]:
    return lambda: post(repetitions)


def _poster(client: httpx.Client, configurations: int) -> Callable[[int], dict[str, Any]]:
    """Posts a run on a stored set, waits for its end, and returns its numbers."""
    set_id = post_campaign(client, configurations)

    def post(repetitions: int) -> dict[str, Any]:
        return numbers(_ended(client, _start(client, set_id, configurations // 2, repetitions)))

    return post


def _answers(database: str, *, quick: bool) -> Section:
    """Health checks, one after the other, idle and while a run keeps a worker for each processor busy."""
    checks, configurations = (20, 50) if quick else (CHECKS, CONFIGURATIONS)
    with Service(database, os.cpu_count() or 1) as service, _client(service) as client:
        set_id = post_campaign(client, configurations)
        _health(client, 20)  # warm up
        idle = _health(client, checks)
        run_id = _start(client, set_id, configurations // 2, 100_000)
        _until(lambda: _get(client, run_id)["progress"]["done"] > 0)
        busy = _health(client, checks)
        state = client.post(f"/v1/runs/{run_id}/cancel").json()
    rows = tuple((name, *map(seconds_text, _tails(s))) for name, s in (("idle", idle), ("busy", busy)))
    ratio = _tails(busy)[1] / _tails(idle)[1]
    return Section(
        title=f"Health endpoint while a run saturates {os.cpu_count()} workers",
        columns=("service", "median", "p95", "slowest"),
        rows=rows,
        figures=(Figure("GET /health, p95 while workers are saturated / idle", ratio, "at most", 5, "×"),),
        notes=(f"the run was {state['progress']['done']:,} draws on when it was cancelled",),
        data={"idle": idle, "busy": busy},
    )


def _health(client: httpx.Client, checks: int) -> list[float]:
    seconds = []
    for _ in range(checks):
        start = time.perf_counter()
        client.get("/health").raise_for_status()
        seconds.append(time.perf_counter() - start)
        time.sleep(0.01)
    return seconds


def _tails(seconds: list[float]) -> tuple[float, float, float]:
    twentieths = quantiles(seconds, n=20, method="inclusive")
    return twentieths[9], twentieths[18], max(seconds)


def _cancelling(database: str, *, quick: bool) -> Section:
    """How many steps are done beyond what a cancelled run says; each worker may end the one it is in."""
    configurations = 500 if quick else CONFIGURATIONS
    rows, greatest = [], 0.0
    with Service(database, 2) as service, _client(service) as client:
        set_id = post_campaign(client, configurations)
        for number in range(1 if quick else CANCELS):
            run_id = _start(client, set_id, configurations // 2, 100_000)
            _until(lambda run_id=run_id: _get(client, run_id)["progress"]["done"] > 0)  # type: ignore[misc]
            time.sleep(0.13 * number)
            start = time.perf_counter()
            told = client.post(f"/v1/runs/{run_id}/cancel").json()
            answered = time.perf_counter() - start
            step, after = _settled(database, run_id)
            done = told["progress"]["done"]
            late = (after - done) / step
            greatest = max(greatest, late)
            rows.append((told["state"], f"{done:,} of 100,000", seconds_text(answered), f"{late:.0f}"))
    return Section(
        title="Cancelling a run on two workers",
        columns=("state", "told", "answered after", "steps ended later"),
        rows=tuple(rows),
        figures=(Figure("steps that two workers ended after a cancel, in all", greatest, "at most", 2),),
    )


def _settled(database: str, run_id: str) -> tuple[int, int]:
    """Draws of a step, and draws done when nothing can come any more."""
    time.sleep(3.0)
    query = "SELECT coalesce(max(done), 1), coalesce(sum(done), 0) FROM run_steps WHERE run_id = %s"
    with psycopg.connect(database, autocommit=True) as connection:
        step, done = connection.execute(query, [run_id]).fetchall()[0]
    return int(step), int(done)


def post_campaign(client: httpx.Client, configurations: int) -> str:
    """Post robot and readings; the id of the set."""
    document = small_campaign(configurations=configurations).document
    robot = client.post("/v1/robots", json=document["robot"]).raise_for_status().json()
    readings = document["measurement_set"] | {"robot_id": robot["id"]}
    stored = client.post("/v1/measurement-sets", json=readings).raise_for_status().json()
    return str(stored["id"])


def numbers(run: dict[str, Any]) -> dict[str, Any]:
    """What two runs of the same input have in common: all but ids and times."""
    request = {name: value for name, value in run["request"].items() if name != "measurement_set_id"}
    hashed = run["provenance"]["input_hash"]
    return {"request": request, "input_hash": hashed} | {
        name: run[name] for name in ("state", "progress", "result", "error")
    }


def _start(client: httpx.Client, set_id: str, size: int, repetitions: int) -> str:
    resampling = {"size": size, "repetitions": repetitions}
    body = {"measurement_set_id": set_id, "resampling": resampling}
    return str(client.post("/v1/runs?wait=0", json=body).raise_for_status().json()["id"])


def _get(client: httpx.Client, run_id: str) -> dict[str, Any]:
    run: dict[str, Any] = client.get(f"/v1/runs/{run_id}").raise_for_status().json()
    return run


def _ended(client: httpx.Client, run_id: str) -> dict[str, Any]:
    deadline = time.monotonic() + _END_SECONDS
    while (run := _get(client, run_id))["state"] in {"queued", "running"}:
        if time.monotonic() > deadline:
            raise ServiceError(f"the run did not end within {_END_SECONDS:.0f} s")
        time.sleep(0.05)
    return run


def _until(met: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _END_SECONDS
    while not met():
        if time.monotonic() > deadline:
            raise ServiceError(f"nothing came within {_END_SECONDS:.0f} s")
        time.sleep(0.05)


def _client(service: Service) -> httpx.Client:
    return httpx.Client(base_url=service.url, timeout=120.0)


def running(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@contextmanager
def postgresql() -> Iterator[Callable[[], str]]:
    """A PostgreSQL server of our own; yields what makes a fresh database and returns its URL."""
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    found = installed[-1] if installed else shutil.which("initdb")
    if not found:
        raise ServiceError("no PostgreSQL server here: apt-get install postgresql")
    folder = Path(tempfile.mkdtemp(prefix="jointstiff-benchmark-pg-"))
    try:
        if os.geteuid() == 0:  # the server refuses to run as root
            shutil.chown(folder, "postgres", "postgres")
        _control(Path(found), folder, "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C")
        control, options = Path(found).with_name("pg_ctl"), f"-k {folder} -c listen_addresses=''"
        _control(control, folder, "start", "-w", "-o", options)
        try:
            yield lambda: _new_database(folder)
        finally:
            _control(control, folder, "stop", "-w", "-m", "immediate")
    finally:
        shutil.rmtree(folder)


def _control(program: Path, folder: Path, *arguments: str) -> None:
    command = [str(program), "-D", str(folder / "data"), *arguments]
    if os.geteuid() == 0:
        command = ["setpriv", "--reuid=postgres", "--regid=postgres", "--init-groups", *command]
    with (folder / "log").open("a") as log:  # a file: the server would hold a pipe open
        subprocess.run(command, cwd=folder, stdout=log, stderr=log, check=True, timeout=60)


def _new_database(folder: Path) -> str:
    name = f"benchmark_{time.monotonic_ns()}"
    with psycopg.connect(f"postgresql://postgres@/postgres?host={folder}", autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    return f"postgresql://postgres@/{name}?host={folder}"


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def _tail(descriptor: int) -> str:
    os.lseek(descriptor, 0, os.SEEK_SET)
    return os.read(descriptor, 10_000).decode(errors="replace")
