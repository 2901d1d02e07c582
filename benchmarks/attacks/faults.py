"""Faults below the service: no room, no writing, a lock, a server that is away; during posts and a long run.

By name only: it takes about ten minutes, or `--part 1/2` and `--part 2/2`. SQLite's disk is a small one in
memory, which takes root.
"""

from __future__ import annotations

import resource
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

import httpx2

from benchmarks.attacks.worker_faults import worker_faults
from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Part, Section
from benchmarks.services import (
    PostgresqlServer,
    Service,
    begin_run,
    databases,
    ended,
    locked,
    numbers,
    postgresql,
    undisturbed,
)

__all__ = ["full", "run", "small_disk"]

Fault = Callable[[Service], AbstractContextManager[object]]

CONFIGURATIONS, RESAMPLING = 400, {"size": 100, "repetitions": 60_000, "seed": 5}
"""About fifteen steps of a quarter of a second."""
_DISK: Final = "24m"
_RECOVERED_SECONDS: Final = 30.0
_END_SECONDS: Final = 150.0
_CODED: Final = frozenset({201, 429, 503, 507})


@dataclass
class Outcome:
    """Outcome of one fault."""

    statuses: Counter[int] = field(default_factory=Counter)  # answers to posts while it lasted
    uncoded: list[str] = field(default_factory=list)  # posts whose answer is no problem document
    lost: int = 0  # acknowledged resources that are not there
    recovered: float = float("inf")  # time until a post was taken again [s]
    state: str = ""  # of the long run at its end
    same: bool = False  # whether its numbers are those of the undisturbed run


def run(*, quick: bool, part: Part) -> list[Section]:
    """Let services of our own meet each fault."""
    seconds = 3.0 if quick else 8.0
    expected = undisturbed(CONFIGURATIONS, RESAMPLING)
    with small_disk() as folder, postgresql() as server:
        sqlite: dict[str, Callable[[Path], Fault]] = {
            "disk full": lambda path: lambda _: full(path.parent),
            "no file may grow": lambda _: _no_growth,
            "locked": lambda path: lambda _: locked(path),
        }
        cases: dict[str, Callable[[], Outcome]] = {}
        for name, fault in sqlite.items():
            path = folder / f"{uuid4().hex}.db"
            long = 25.0 if name == "locked" and not quick else seconds
            cases[f"SQLite: {name}"] = partial(_meet, f"sqlite:///{path}", fault(path), long, expected)
        url, back = f"sqlite:///{folder / uuid4().hex}.db", partial(_clock_set_back, folder)
        cases["SQLite: clock −1 day"] = lambda: _meet(url, back, seconds, expected, _faked(folder))
        for name, hurt in {"server stopped and back": _stopped, "read-only": _read_only}.items():
            cases[f"PostgreSQL: {name}"] = partial(_meet, server(), partial(hurt, server), seconds, expected)
        outcomes: dict[str, Outcome] = {}
        sections: list[Section] = []
        for number in part.of(len(cases) + (0 if quick else 1)):
            if number < len(cases):
                name = list(cases)[number]
                outcomes[name] = cases[name]()
                for path in folder.glob("*.db*"):  # the disk is small
                    path.unlink()
            else:
                sections.append(hurt_workers(expected))
    return [_section(outcomes), *sections] if outcomes else sections


def hurt_workers(expected: dict[str, Any]) -> Section:
    """Let workers meet their faults, those that die at a step on both databases."""
    with databases() as new:
        return worker_faults(new, CONFIGURATIONS, RESAMPLING, expected)


def _meet(
    database: str,
    fault: Fault,
    seconds: float,
    expected: dict[str, Any],
    environment: dict[str, str] | None = None,
) -> Outcome:
    outcome, created = Outcome(), list[str]()
    stop, faulty = threading.Event(), threading.Event()
    with (
        Service(database, 1, environment=environment) as service,
        httpx2.Client(base_url=service.url, timeout=90) as client,
    ):
        address = begin_run(client, CONFIGURATIONS, RESAMPLING)
        poster = threading.Thread(target=_post_on, args=(service.url, stop, faulty, outcome, created))
        poster.start()
        time.sleep(1.0)
        faulty.set()
        with fault(service):
            time.sleep(seconds)
        faulty.clear()
        outcome.recovered = _recovered(created)
        run = ended(client, address, _END_SECONDS)
        stop.set()
        poster.join()
        outcome.lost = sum(client.get(f"/v1/robots/{robot}").status_code != 200 for robot in created)
    outcome.state = run["state"]
    outcome.same = numbers(run) == expected
    return outcome


def _post_on(
    url: str, stop: threading.Event, faulty: threading.Event, outcome: Outcome, created: list[str]
) -> None:
    robot = small_campaign().document["robot"]
    with httpx2.Client(base_url=url, timeout=90) as client:
        while not stop.is_set():
            time.sleep(0.05)
            answer = client.post("/v1/robots", json=robot)
            if answer.status_code == 201:
                created.append(answer.json()["id"])
            if faulty.is_set():
                outcome.statuses[answer.status_code] += 1
            if answer.status_code not in _CODED or (answer.is_error and "detail" not in answer.json()):
                outcome.uncoded.append(f"{answer.status_code} {answer.text[:80]}")


def _recovered(created: list[str]) -> float:
    """Return the time until another post is acknowledged [s]."""
    before, began = len(created), time.monotonic()
    while len(created) == before:
        if time.monotonic() - began > 4 * _RECOVERED_SECONDS:
            return float("inf")
        time.sleep(0.02)
    return time.monotonic() - began


# The faults


@contextmanager
def small_disk() -> Iterator[Path]:
    """A small disk of our own."""
    folder = Path(tempfile.mkdtemp(prefix="jointstiff-faults-"))
    subprocess.run(["/bin/mount", "-t", "tmpfs", "-o", f"size={_DISK}", "tmpfs", folder], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["/bin/umount", "-l", folder], check=True)
        folder.rmdir()


@contextmanager
def full(folder: Path) -> Iterator[None]:
    """Fill the disk of a folder."""
    ballast = folder / "ballast"
    with ballast.open("wb", buffering=0) as file:
        block = 1 << 20
        while block:
            try:
                file.write(bytes(block))
            except OSError:
                block //= 2
    try:
        yield
    finally:
        ballast.unlink()


@contextmanager
def _no_growth(service: Service) -> Iterator[None]:
    pids = [service.process.pid, *service.workers()]
    for pid in pids:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
    try:
        yield
    finally:
        for pid in pids:
            if Path(f"/proc/{pid}").exists():
                resource.prlimit(pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))


_CLOCK: Final = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <time.h>

static long back(void) { struct stat s; return stat(getenv("JOINTSTIFF_CLOCK"), &s) ? 0 : 86400; }

int clock_gettime(clockid_t clock, struct timespec *time) {
  static int (*real)(clockid_t, struct timespec *);
  if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
  int failed = real(clock, time);
  if (!failed && clock == CLOCK_REALTIME) time->tv_sec -= back();
  return failed;
}

int gettimeofday(struct timeval *time, void *zone) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  time->tv_sec = now.tv_sec;
  time->tv_usec = now.tv_nsec / 1000;
  return 0;
}

time_t time(time_t *at) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (at) *at = now.tv_sec;
  return now.tv_sec;
}
"""
"""A clock that stands a day back once a file is there. Debian's libfaketime makes Python's `sleep` fail."""


def _faked(folder: Path) -> dict[str, str]:
    """Return the environment of processes whose time of day is ours to set back."""
    source, library = folder / "clock.c", folder / "clock.so"
    source.write_text(_CLOCK, encoding="ascii")
    subprocess.run(["/usr/bin/cc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return {"LD_PRELOAD": str(library), "JOINTSTIFF_CLOCK": str(folder / "back")}


@contextmanager
def _clock_set_back(folder: Path, _: Service) -> Iterator[None]:
    """Set the clock back by a day, for good."""
    (folder / "back").touch()
    yield


@contextmanager
def _stopped(server: PostgresqlServer, _: Service) -> Iterator[None]:
    server.stop()
    try:
        yield
    finally:
        server.start()


@contextmanager
def _read_only(server: PostgresqlServer, _: Service) -> Iterator[None]:
    server.say("ALTER SYSTEM SET default_transaction_read_only = on")
    server.say("SELECT pg_reload_conf()")
    try:
        yield
    finally:
        server.say("ALTER SYSTEM RESET default_transaction_read_only")
        server.say("SELECT pg_reload_conf()")


def _section(outcomes: dict[str, Outcome]) -> Section:
    again = "until posts are taken again"
    return Section(
        title="Faults during posts and a long run",
        columns=("fault", "answers meanwhile", "uncoded", "lost", "recovered", "long run"),
        rows=tuple(
            (
                name,
                ", ".join(f"{count} × {status}" for status, count in sorted(found.statuses.items())),
                "; ".join(found.uncoded[:2]) or "0",
                str(found.lost),
                f"{found.recovered:.1f} s",
                found.state if found.same else f"{found.state}, DIFFERENT",
            )
            for name, found in outcomes.items()
        ),
        figures=tuple(
            figure
            for name, found in outcomes.items()
            for figure in (
                Figure.none(f"{name}: answers without a code", len(found.uncoded)),
                Figure.none(f"{name}: acknowledged and lost", found.lost),
                Figure(f"{name}: {again}", found.recovered, "at most", _RECOVERED_SECONDS, " s"),
                Figure.none(f"{name}: long run not the same", int(not found.same)),
            )
        ),
        notes=("kill -9 of service and worker: the benchmark `durability`",),
    )
