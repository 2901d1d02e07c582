"""Attacks: bodies and files that cost memory, connections that say nothing, and work beside the health.

By name only, on a quiet machine: it takes a quarter of an hour, or `--part 1/2` and `--part 2/2`.
"""

from __future__ import annotations

import asyncio
import json
import resource
import socket
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from http.client import HTTPConnection, HTTPException
from itertools import cycle, product
from pathlib import Path
from typing import Final, NamedTuple

import httpx2
import numpy as np
from fastapi.exceptions import RequestValidationError

from benchmarks.attacks.hostile_bodies import bodies, imports
from benchmarks.attacks.many_posts import posts_at_once, queue_full
from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Part, Section
from benchmarks.services import (
    Service,
    caddy,
    cpu,
    descriptors,
    locked,
    post_campaign,
    postgresql,
    size_of,
)
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.service.api.bodies import parse_body
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.imports.answer import import_files
from jointstiff.service.imports.formats import SourceFile
from jointstiff.service.problems import problem_from_faults
from jointstiff.simulator.sweeps import TrackedArm
from tests.support.memory import peak_of

__all__ = ["run"]

_BODY: Final = 8 * 1024 * 1024
_CLIENTS: Final = 2_000
_ACCEPTED_SECONDS: Final = 3.0
_HELD_SECONDS: Final = 20.0
_OTHERS: Final = 5
"""Descriptors of the service that come and go: those who ask for its health."""
_HEADER: Final = b"GET /live HTTP/1.1\r\nHost: localhost\r\n"
_SWEEPS: Final = ((-2.4, 2.4), (-1.2, 0.9), (-1.0, 1.2), (-2.6, 2.6), (-1.6, 1.6), (-2.8, 2.8))


def run(*, quick: bool, part: Part) -> list[Section]:
    """Attack parsers in forks, and services of our own."""
    with tempfile.TemporaryDirectory(prefix="jointstiff-attacks-") as folder, postgresql() as server:
        database = f"sqlite:///{Path(folder) / 'attacked.db'}"
        count = 20 if quick else 1_000
        queues = {"SQLite": f"sqlite:///{Path(folder) / 'queue.db'}", "PostgreSQL": server()}
        attacks = [
            _bodies,
            _imports,
            lambda: _connections(database, 100 if quick else _CLIENTS),
            lambda: _health(Path(folder) / "health.db", 1.0 if quick else 8.0),
            lambda: posts_at_once("SQLite", database, count),
            lambda: posts_at_once("PostgreSQL", server(), count),
            lambda: queue_full(queues, count),
            lambda: _threads(database, 10 if quick else 100),
            lambda: _at_once(database, 10 if quick else 1),
            _elsewhere,
        ]
        return [attacks[number]() for number in part.of(len(attacks))]


# Memory


def _bodies() -> Section:
    peak_of(lambda: _validated(b"{}"))
    found = [(name, len(body) / 1e6, *peak_of(partial(_validated, body))) for name, body in bodies(_BODY)]
    worst = max(peak / (10.0 * size + 50.0) for _, size, peak, _ in found)
    return Section(
        title="Memory of a body, parsed in a fork",
        columns=("body", "size", "peak", "bound", "outcome"),
        rows=tuple(
            (name, f"{size:.2f} MB", f"{peak:.0f} MB", f"{10 * size + 50:.0f} MB", outcome)
            for name, size, peak, outcome in found
        ),
        figures=(Figure("peak of any body / (10 × body + 50 MB)", worst, "at most", 1.0, "×"),),
    )


def _validated(body: bytes) -> None:
    try:
        parse_body(MeasurementSetRequest, body)
    except RequestValidationError as error:
        problem_from_faults(error.errors())
        raise


def _imports() -> Section:
    found = []
    for what, name, content in imports():
        began = time.monotonic()
        files = [SourceFile(name, content)]
        peak, outcome = peak_of(partial(import_files, files, ImportRequest(), None))
        found.append((what, len(content) / 1e6, peak, outcome, time.monotonic() - began))
    return Section(
        title="Memory and time of an import, in a fork",
        columns=("file", "size", "peak", "outcome", "time"),
        rows=tuple(
            (what, f"{size:.2f} MB", f"{peak:.0f} MB", outcome, f"{seconds:.1f} s")
            for what, size, peak, outcome, seconds in found
        ),
        figures=(Figure("peak of any import", max(row[2] for row in found), "at most", 256.0, " MB"),),
    )


# Connections


@dataclass(frozen=True)
class _Manner:
    """A way to hold a connection."""

    name: str
    first: bytes  # sent at once
    drip: bytes  # sent each second after that
    is_closed: bool  # in the time for a header


_POST: Final = (
    b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    b"Content-Length: 100000\r\n\r\n"
)
_MANNERS: Final = (
    _Manner("silent", b"", b"", is_closed=True),
    _Manner("half a header", _HEADER, b"", is_closed=True),
    _Manner("dripping header", _HEADER, b"X", is_closed=True),
    _Manner("dripping body", _POST, b"x", is_closed=False),
    _Manner("slow reader", (_HEADER.replace(b"/live", b"/openapi.json") + b"\r\n") * 8, b"", is_closed=False),
)


def _connections(database: str, count: int) -> Section:
    """Hold connections to a service, and to Caddy in front of it."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 8_192), hard))
    rows, figures = [], []
    for is_behind, manner in product((False, True), _MANNERS):
        with Service(database, 0) as service, ExitStack() as stack:
            port, pid = service.port, service.process.pid
            if is_behind:
                port, pid = stack.enter_context(caddy(service))
            with _asking(port) as seconds:
                held = asyncio.run(_held(service, port, pid, manner, count))
        where = "behind Caddy" if is_behind else "direct"
        answered = float(np.percentile(seconds, 95))
        rows.append(
            (
                f"{manner.name}, {where}",
                "—" if held.closed is None else f"{held.closed:.1f} s",
                f"{held.at_service:,}",
                f"{held.memory:.0f} MB",
                f"{1e3 * answered:.0f} ms of {len(seconds)}",
            )
        )
        name = f"{count:,} × {manner.name}, {where}"
        figures.append(Figure(f"{name}: /health p95", answered, "at most", 0.05, " s"))
        if manner.is_closed:
            closed = float("inf") if held.closed is None else held.closed
            figures.append(Figure(f"{name}: all closed", closed, "at most", 15.0, " s"))
        if is_behind and manner.is_closed:
            figures.append(Figure(f"{name}: connections at the service", held.at_service, "at most", _OTHERS))
    return Section(
        title=f"{count:,} connections that hold, to the service and to Caddy in front of it",
        columns=(
            "connections",
            "all closed after",
            "at the service",
            "memory of it",
            "/health p95 meanwhile",
        ),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(f"held for {_HELD_SECONDS:.0f} s, or until all are closed",),
    )


def _at_once(database: str, fewer: int) -> Section:
    """Slow readers, silent connections and large bodies, all behind Caddy: the memory they cost."""
    manners = {manner.name: manner for manner in _MANNERS}
    counts = {"slow reader": 300 // fewer, "silent": _CLIENTS // fewer}
    rows, figures = [], []
    for what in (_LEGAL, _REFUSED):
        with (
            Service(database, 0) as service,
            caddy(service) as (port, proxy),
            httpx2.Client(base_url=service.url, timeout=120) as client,
        ):
            path, legal, _ = _loads(client)[f"4 × {_LEGAL}"]
            body = legal if what == _LEGAL else b" " * (MAX_SET_BYTES + 1)
            idle, peak, done = size_of(service.process.pid), 0.0, threading.Event()

            def look(service: Service = service, done: threading.Event = done) -> None:
                nonlocal peak
                while not done.wait(0.1):
                    peak = max(peak, size_of(service.process.pid))

            with _asking(port) as seconds, ThreadPoolExecutor(4) as pool:
                pool.submit(look)
                held = [
                    pool.submit(asyncio.run, _held(service, port, proxy, manners[each], counts[each]))
                    for each in counts
                ]
                address = f"http://localhost:{port}{path}"
                posted = _repeated(address, body, 64 // fewer, 20.0, is_declared=what == _LEGAL)
                for each in held:
                    each.result()
                done.set()
        p95 = float(np.percentile(seconds, 95))
        answers = ", ".join(f"{count:,} × {status}" for status, count in sorted(posted.items()))
        rows.append(
            (what, answers, f"{idle:.0f} MB", f"{peak:.0f} MB", f"{1e3 * p95:.0f} ms of {len(seconds)}")
        )
        bodies_together = 64 // fewer * len(body) / 1e6
        figures += [
            Figure(
                f"at once, {what}: memory above idle / bodies together",
                (peak - idle) / bodies_together,
                "at most",
                3.0,
                "×",
            ),
            Figure(f"at once, {what}: /health p95", p95, "at most", 0.05, " s"),
        ]
    others = posted.total() - posted[413] - posted[503]  # 503: beyond the budget of all bodies
    figures.append(Figure.none(f"at once, {_REFUSED}: answers that are neither 413 nor 503", others))
    clients = f"{counts['slow reader']} slow readers, {counts['silent']:,} silent"
    return Section(
        title=f"At once: {clients}, {64 // fewer} clients that post large bodies",
        columns=("bodies", "answers", "memory idle", "peak", "/health p95"),
        rows=tuple(rows),
        figures=tuple(figures),
    )


class _Held(NamedTuple):
    """Outcome of connections that were held."""

    closed: float | None  # time until all were closed [s]; None if they were not
    at_service: int  # connections of the service while they were held
    memory: float  # of the service [MB]


async def _held(service: Service, port: int, pid: int, manner: _Manner, count: int) -> _Held:
    """Hold connections to the process that listens on a port, until all are closed or the time is over."""
    before, of_service = descriptors(pid), descriptors(service.process.pid)
    done = asyncio.Event()

    async def hold(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if manner.name == "slow reader":
            writer.transport.pause_reading()  # type: ignore[attr-defined]
        with suppress(OSError):
            writer.write(manner.first)
            while not (done.is_set() or writer.is_closing()):
                writer.write(manner.drip)
                with suppress(TimeoutError):
                    await asyncio.wait_for(done.wait(), 1.0)
        writer.transport.abort()
        del reader

    async with asyncio.TaskGroup() as group:
        for _ in range(count):
            group.create_task(hold(*await asyncio.open_connection(sock=_narrow(port))))
        began = time.monotonic()
        await asyncio.sleep(_ACCEPTED_SECONDS)
        at_service = descriptors(service.process.pid) - of_service
        closed = None
        while closed is None and time.monotonic() - began < _HELD_SECONDS:
            await asyncio.sleep(0.1)
            if descriptors(pid) <= before + _OTHERS:
                closed = time.monotonic() - began
        memory = size_of(service.process.pid)
        done.set()
    return _Held(closed, at_service, memory)


def _narrow(port: int) -> socket.socket:
    """Return a connection that takes little unread, so that one answer is more than the system keeps."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
    connection.connect(("127.0.0.1", port))
    connection.setblocking(False)
    return connection


# Health


@contextmanager
def _asking(port: int) -> Iterator[list[float]]:
    """Ask for health and readiness in turns, each on a new connection; yield how long answers took [s]."""
    seconds: list[float] = []
    stop = threading.Event()

    def ask() -> None:
        for path in cycle(("/health", "/live")):
            if stop.wait(0.05):
                return
            began = time.monotonic()
            connection = HTTPConnection("localhost", port, timeout=20)
            try:
                connection.request("GET", path)
                connection.getresponse().read()
            except (OSError, HTTPException):
                seconds.append(20.0)
            else:
                seconds.append(time.monotonic() - began)
            finally:
                connection.close()

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        yield seconds
    finally:
        stop.set()
        thread.join()


def _health(database: Path, duration: float) -> Section:
    with (
        Service(f"sqlite:///{database}", 0) as service,
        httpx2.Client(base_url=service.url, timeout=120) as client,
    ):
        loads = _loads(client)
        rows, figures = [], []
        for name, (path, body, threads) in loads.items():
            lock = locked(database) if name == _LOCKED else nullcontext()
            with _asking(service.port) as seconds, lock:
                done = _repeated(service.url + path, body, threads, duration)
            p95 = float(np.percentile(seconds, 95))
            rows.append((name, f"{done.total()}", f"{1e3 * p95:.0f} ms", f"{1e3 * max(seconds):.0f} ms"))
            figures.append(Figure(f"/health p95 under {name}", p95, "at most", 0.05, " s"))
    return Section(
        title="/health beside work",
        columns=("work", "requests", "p95", "slowest"),
        rows=tuple(rows),
        figures=tuple(figures),
    )


def _loads(client: httpx2.Client) -> dict[str, tuple[str, bytes, int]]:
    set_id = post_campaign(client, 19)
    largest = small_campaign(configurations=6_000).document
    robot = client.post("/v1/robots", json=largest["robot"]).raise_for_status().json()["id"]
    legal = json.dumps(largest["measurement_set"] | {"robot_id": robot}).encode()
    illegal = max(bodies(_BODY), key=lambda each: len(each[1]) if each[0] != "299,000 different keys" else 0)
    nested = dict(bodies(_BODY))["lists of lists"]
    client.post("/v1/measurement-sets", content=legal, headers=_JSON).raise_for_status()
    return {
        "nothing": ("/live", b"", 0),
        f"4 × {_LEGAL}": ("/v1/measurement-sets", legal, 4),
        f"4 × largest illegal body ({illegal[0]})": ("/v1/measurement-sets", illegal[1], 4),
        "4 × 990,000 empty lists": ("/v1/measurement-sets", nested, 4),
        "4 × runs": ("/v1/runs", json.dumps({"measurement_set_id": set_id}).encode(), 4),
        "10 × geometries of 600": ("/v1/geometries", _sweeps(100), 10),
        _LOCKED: ("/v1/robots", json.dumps(largest["robot"]).encode(), 12),
    }


_LEGAL: Final = "largest legal set"
_REFUSED: Final = "of 8 MiB and a byte, undeclared"
_LOCKED: Final = "SQLite locked, 12 posts waiting"
_JSON: Final = {"Content-Type": "application/json"}


def _repeated(
    address: str, body: bytes, threads: int, duration: float, *, is_declared: bool = True
) -> Counter[int]:
    """Post a body again and again, its length declared or not; return the answers by status, 0 for none."""
    end = time.monotonic() + duration

    def post(_: int) -> Counter[int]:
        statuses: Counter[int] = Counter()
        with httpx2.Client(timeout=120) as client:
            while time.monotonic() < end:
                content = body if is_declared else iter((body,))
                try:
                    statuses[client.post(address, content=content, headers=_JSON).status_code] += 1
                except httpx2.TransportError:
                    statuses[0] += 1
        return statuses

    with ThreadPoolExecutor(max(1, threads)) as pool:
        statuses = sum(pool.map(post, range(threads)), Counter[int]())
    time.sleep(max(0.0, end - time.monotonic()))
    return statuses


def _sweeps(count: int) -> bytes:
    """Return a geometry's request of six sweeps of so many positions."""
    cell, rng = TrackedArm(), np.random.default_rng(51)
    sweeps = []
    for joint, (first, last) in enumerate(_SWEEPS):
        controller = cell.sweep(joint, np.linspace(first, last, count))
        seen = cell.readings(controller) + rng.normal(0.0, 2e-5, (count, len(cell.targets), 3))
        observations = [
            {"joints": list(q), "targets": {f"t{n}": list(p) for n, p in enumerate(points)}}
            for q, points in zip(controller, seen, strict=True)
        ]
        sweeps.append({"joint": f"joint_{joint + 1}", "observations": observations})
    units = {"length": "m", "angle": "rad"}
    return json.dumps({"units": units, "noise": {"sigma": 2e-5}, "sweeps": sweeps}).encode()


# What others show


def _elsewhere() -> Section:
    return Section(
        title="What tests and other benchmarks show",
        columns=("what", "where"),
        rows=(
            ("DNS rebinding, cross-site page, null origin, in Chromium", "tests/dashboard/test_sign_in.py"),
            ("role × operation; an operation without a role", "tests/service/api/test_access.py"),
            ("clients that pause; times of Caddy", "tests/e2e/test_connections.py"),
            ("kill -9 of services and workers", "python -m benchmarks durability"),
            ("disks, locks, clocks, servers, workers", "python -m benchmarks faults"),
        ),
    )


# Threads of linear algebra


def _threads(database: str, count: int) -> Section:
    with Service(database, 0) as service, httpx2.Client(base_url=service.url, timeout=200) as client:
        coupled = {"elasticity": "coupled_joints", "link_penalty": 1e-3}
        run = {"measurement_set_id": post_campaign(client, 20 * count)} | coupled
        requests = {
            f"geometry of {6 * count}": ("/v1/geometries", _sweeps(count)),
            "coupled joints": ("/v1/runs", json.dumps(run).encode()),
        }
        found = {}
        for name, (path, body) in requests.items():
            before, began = cpu(service.process.pid), time.monotonic()
            client.post(path, content=body, headers=_JSON).raise_for_status()
            found[name] = (cpu(service.process.pid) - before, time.monotonic() - began)
    return Section(
        title="Processor time of the service beside the time that it took",
        columns=("work", "processor", "time", "ratio"),
        rows=tuple((name, f"{c:.2f} s", f"{t:.2f} s", f"{c / t:.2f}") for name, (c, t) in found.items()),
        figures=tuple(
            Figure(f"{name}: processor time / time", c / t, "at most", 1.1, "×")
            for name, (c, t) in found.items()
        ),
    )
