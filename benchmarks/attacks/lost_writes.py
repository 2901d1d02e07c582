"""Writes of services and workers that are cut in PostgreSQL: how soon their job and the next ones end.

A proxy between the database and the process falls silent after a random number of bytes of a write. The
process then goes on with new connections, or is stopped by SIGSTOP. By name only: an hour, or one write
with `--part` of 1/6 to 6/6. JOINTSTIFF_POSTGRESQL_PROGRAMS is the folder of another PostgreSQL's programs.
"""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, Final, Self
from uuid import uuid4

import httpx2

from benchmarks.report import Figure, Part, Section
from benchmarks.services import (
    PostgresqlServer,
    Service,
    post_campaign,
    postgresql,
    start_worker,
    worker,
)
from tests.support.silent_proxy import SilentProxy

__all__ = ["run"]

CUTS: Final = 20
"""Cuts of each write, of each kind."""
_AT_ONCE: Final = 3
"""Writes that are cut at the same time, each in a database of its own."""
_NEXT: Final = 2
"""Runs that are posted right after the cut."""
_REQUIRED_SECONDS: Final = 45.0
_LONGEST_SECONDS: Final = 240.0
_SHORT, _LONG = 8_000, 52_000
"""Draws of a run of two steps, and of one of thirteen, in two parts."""
_CONFIGURATIONS: Final = 200
_NAME: Final = "victim"

_HOOK: Final = """
import os, socket, sys

if {word!r} in sys.orig_argv:
    from jointstiff.service.{module} import {of} as of

    before = of.{method}

    def write(*arguments, **options):
        with socket.create_connection(("127.0.0.1", {port})) as control:
            control.sendall(b"?")
            control.recv(1)
            try:
                return before(*arguments, **options)
            finally:
                control.sendall(b".")

    of.{method} = write
"""
"""Code by which a process says that it begins and ends a write, and waits for leave to begin."""


@dataclass(frozen=True)
class _Write:
    """A write whose connection is cut, by a worker or a service."""

    name: str
    module: str
    of: str  # class
    method: str
    is_of_service: bool = False
    draws: int = _SHORT  # of its run


_WRITES: Final = (
    _Write("store a step", "store.jobs", "Steps", "store_result"),
    _Write("end", "store.jobs", "JobRecords", "end"),
    _Write("add parts", "workers.engine", "Queue", "add_following_parts", draws=_LONG),
    _Write("heartbeat", "store.jobs", "Heartbeats", "beat"),
    _Write("post", "store.collection", "Collection", "add", is_of_service=True),
    _Write("rename", "store.collection", "Collection", "change", is_of_service=True),
)


@dataclass
class _Outcome:
    """Cuts of a write."""

    size: int = 0  # of the write [bytes]
    seconds: dict[str, list[float]] = field(default_factory=lambda: {"cut": [], "SIGSTOP": []})
    failed: list[str] = field(default_factory=list)  # states of runs that did not succeed


def run(*, quick: bool, part: Part) -> list[Section]:
    """Cut each write on a PostgreSQL server of our own, each in a database of its own."""
    cuts = 1 if quick else CUTS
    writes = [_WRITES[number] for number in part.of(len(_WRITES))]
    with postgresql() as server, ThreadPoolExecutor(_AT_ONCE) as pool:
        version = server.version().split()[0]
        tasks = {write: pool.submit(_study, server, write, cuts) for write in writes}
        outcomes = {write: task.result() for write, task in tasks.items()}
    rows, figures = list[tuple[str, ...]](), list[Figure]()
    for write, outcome in outcomes.items():
        for kind, seconds in outcome.seconds.items():
            times = (f"{median(seconds):.1f} s", f"{max(seconds):.1f} s")
            rows.append((write.name, f"{outcome.size:,}", kind, str(len(seconds)), *times))
            what = f"PostgreSQL {version}, {write.name}, {kind}: the job and the next ones end"
            figures.append(Figure(what, max(seconds), "at most", _REQUIRED_SECONDS, " s"))
        figures.append(Figure.none(f"{write.name}: runs that do not succeed", len(outcome.failed)))
    return [
        Section(
            title=f"writes whose connection is cut at a random byte, PostgreSQL {version}",
            columns=("write", "bytes", "by", "cuts", "median", "longest"),
            rows=tuple(rows),
            figures=tuple(figures),
        )
    ]


class _Control:
    """A server that processes ask for leave to begin a write; it cuts the write that is chosen."""

    def __init__(self, proxy: SilentProxy) -> None:
        self._proxy = proxy
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._cut_after: int | None = None
        self._has_begun = False  # the write that is chosen
        self.sizes: list[int] = []  # bytes of the writes that ended
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._listener.close()

    def cut_next(self, count: int) -> None:
        """Cut the next write after so many bytes."""
        self._has_begun = False
        self._cut_after = count

    @property
    def is_cut(self) -> bool:
        """True once the chosen write was cut."""
        return self._has_begun and self._proxy.is_cut

    def forget(self) -> None:
        """Cut no write."""
        self._cut_after = None

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                writer, _ = self._listener.accept()
                threading.Thread(target=self._follow, args=(writer,), daemon=True).start()

    def _follow(self, writer: socket.socket) -> None:
        with writer, suppress(OSError):
            writer.recv(1)
            count, self._cut_after = self._cut_after, None
            before = self._proxy.sent
            if count is not None:
                self._proxy.cut_after(count)
                self._has_begun = True
            writer.sendall(b"!")
            if writer.recv(1) == b"." and count is None:
                self.sizes.append(self._proxy.sent - before)


class _Victim:
    """A worker or a service behind the proxy, which is started again if it has ended."""

    def __init__(self, write: _Write, proxy: SilentProxy, folder: Path, port: int) -> None:
        self._write, self._database, self._folder = write, proxy.url, folder
        word = "serve" if write.is_of_service else _NAME
        code = _HOOK.format(word=word, module=write.module, of=write.of, method=write.method, port=port)
        (folder / "sitecustomize.py").write_text(code, encoding="utf-8")
        self.url = ""  # address of a service
        self.process = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        path = os.pathsep.join(filter(None, (str(self._folder), os.environ.get("PYTHONPATH"))))
        environment = {"PYTHONPATH": path}
        if self._write.is_of_service:
            service = Service(self._database, 0, environment=environment)
            self.url = service.url
            return service.process
        return start_worker(self._database, _NAME, environment)

    def stop(self) -> None:
        """Stop the process by SIGSTOP."""
        os.kill(self.process.pid, signal.SIGSTOP)

    def go_on(self) -> None:
        """Let the process go on, or start it again if it ends instead."""
        with suppress(ProcessLookupError):
            os.kill(self.process.pid, signal.SIGCONT)
        time.sleep(3.0)
        if self.process.poll() is not None:
            self.process = self._start()

    def end(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()


@contextmanager
def _victim(write: _Write, proxy: SilentProxy, folder: Path, port: int) -> Iterator[_Victim]:
    victim = _Victim(write, proxy, folder, port)
    try:
        yield victim
    finally:
        victim.end()


def _study(server: PostgresqlServer, write: _Write, cuts: int) -> _Outcome:
    """Cut a write again and again, first by the connection alone, then also by SIGSTOP."""
    database, outcome, draw = server(), _Outcome(), random.Random(write.name)  # noqa: S311 - of bytes
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="jointstiff-lost-")))
        service = stack.enter_context(Service(database, 0))
        proxy = stack.enter_context(SilentProxy(database))
        control = stack.enter_context(_Control(proxy))
        victim = stack.enter_context(_victim(write, proxy, folder, control.port))
        stack.enter_context(worker(database, "other"))
        client = stack.enter_context(httpx2.Client(base_url=service.url, timeout=60))
        case = _Case(write, victim, client, proxy, control)
        outcome.size = case.measure()
        for kind, seconds in outcome.seconds.items():
            for _ in range(cuts):
                runs, taken = case.cut(draw.randint(1, outcome.size), is_stopped=kind == "SIGSTOP")
                seconds.append(taken)
                outcome.failed += [each for each in runs if each != "succeeded"]
    return outcome


class _Case:
    """A service and two workers on a database, one of whose processes is behind a proxy."""

    def __init__(
        self, write: _Write, victim: _Victim, client: httpx2.Client, proxy: SilentProxy, control: _Control
    ) -> None:
        self._write, self._victim, self._client = write, victim, client
        self._proxy, self._control = proxy, control
        self._pool = ThreadPoolExecutor(1)
        self._set_id = post_campaign(client, _CONFIGURATIONS)
        self._robot = client.get(f"/v1/measurement-sets/{self._set_id}").json()["robot_id"]
        _until(lambda: client.get("/health").json()["workers"] == (1 if write.is_of_service else 2))

    def measure(self) -> int:
        """Return the number of bytes that a write sends, the least of some."""
        while len(self._control.sizes) < 3:
            address = self._post_or_rename().result()
            self._wait([address or self._post(self._client)])
        return min(self._control.sizes)

    def cut(self, count: int, *, is_stopped: bool) -> tuple[list[str], float]:
        """Cut a write after so many bytes; return the states of the runs, and the time to their end [s]."""
        while True:
            self._control.cut_next(count)
            first = self._post_or_rename()
            if self._wait_for_cut(first):
                break
            self._control.forget()
        began = time.monotonic()
        if is_stopped:
            self._victim.stop()
        with ThreadPoolExecutor(_NEXT) as pool:
            posted = [pool.submit(self._post, self._client) for _ in range(_NEXT)]
            addresses = [each.result() for each in posted]
        addresses.append(first.result() or self._post(self._client))
        states = self._wait(addresses)
        seconds = time.monotonic() - began
        self._proxy.close_silent()  # or each cut would leave some sessions, and the server has a hundred
        if is_stopped:
            self._victim.go_on()
            expected = 1 if self._write.is_of_service else 2
            _until(lambda: self._client.get("/health").json()["workers"] >= expected)
        return states, seconds

    def _wait_for_cut(self, first: Future[str | None]) -> bool:
        """Wait until the write was cut; return False if the other worker has made it."""
        while not self._control.is_cut:
            if self._write.name != "heartbeat" and first.done():
                address = first.result()
                has_ended = address is None or self._state(address) not in {"queued", "running"}
                if has_ended:
                    time.sleep(0.5)
                    return self._control.is_cut
            time.sleep(0.01)
        return True

    def _post_or_rename(self) -> Future[str | None]:
        """Begin the request that leads to the write; its result is the address of a run, or None."""
        return self._pool.submit(self._act)

    def _act(self) -> str | None:
        if not self._write.is_of_service:
            return self._post(self._client)
        with httpx2.Client(base_url=self._victim.url, timeout=15) as other:
            if self._write.name == "post":
                return self._post(other)
            with suppress(httpx2.TransportError):
                other.patch(f"/v1/robots/{self._robot}", json={"name": f"robot {uuid4().hex}"})
        return None

    def _post(self, client: httpx2.Client) -> str:
        """Post a run until it is accepted, after the first attempt by the other service."""
        resampling = {"size": 100, "repetitions": self._write.draws}
        body = {"measurement_set_id": self._set_id, "resampling": resampling}
        key = {"Idempotency-Key": uuid4().hex}
        while True:
            with suppress(httpx2.TransportError):
                answer = client.post("/v1/runs?wait=0", json=body, headers=key)
                if answer.is_success:
                    return str(answer.headers["location"])
            client = self._client
            time.sleep(0.2)

    def _wait(self, addresses: list[str]) -> list[str]:
        """Return the states of runs once they have ended."""
        _until(lambda: all(self._state(each) not in {"queued", "running"} for each in addresses))
        return [self._state(each) for each in addresses]

    def _state(self, address: str) -> str:
        answer: dict[str, Any] = self._client.get(address).json()
        return str(answer.get("state", "running"))  # a database that does not answer for a moment


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _LONGEST_SECONDS
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.2)
