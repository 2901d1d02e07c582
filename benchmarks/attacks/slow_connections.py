"""A service without a proxy: silent, half and dripping requests, next to slow clients that mean well."""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import httpx2

from benchmarks.report import Figure, Section
from benchmarks.services import Service, size_of
from jointstiff.service.api.examples import EXAMPLES

__all__ = ["run"]

_HEADER: Final = b"POST /v1/%s HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
_HONEST_BYTES: Final = 1_000_000
_HONEST_SECONDS: Final = 14
_HALF_BYTES: Final = 6_000_000
_DECLARED_BYTES: Final = 7_000_000
_LONGEST_SECONDS: Final = 200.0
_SETTLE_SECONDS: Final = 5.0


@dataclass
class _Counts:
    """Numbers of clients."""

    silent: int = 900
    half: int = 60
    dripping: int = 60
    honest: int = 20


@dataclass
class _Found:
    """Answers and times that clients found."""

    closed_after: list[float] = field(default_factory=list)  # of attacking connections [s]
    answers: Counter[str] = field(default_factory=Counter)  # of attacking connections, by status
    honest: Counter[str] = field(default_factory=Counter)  # of honest clients, by status
    others: list[float] = field(default_factory=list)  # time of answers to others [s]


def run(*, quick: bool) -> list[Section]:
    """Attack a service of our own."""
    counts = _Counts(20, 6, 6, 4) if quick else _Counts()
    with tempfile.TemporaryDirectory(prefix="jointstiff-connections-") as folder:
        database = f"sqlite:///{Path(folder) / 'attacked.db'}"
        with Service(database, 0) as service:
            pid = service.process.pid
            _use(service.url)
            time.sleep(_SETTLE_SECONDS)
            before = size_of(pid)
            found = asyncio.run(_attack(service.port, counts))
            time.sleep(_SETTLE_SECONDS)
            after, peak = size_of(pid), size_of(pid, "VmHWM")
    served = found.honest["201"]
    answers = ", ".join(f"{count} × {status}" for status, count in found.answers.most_common())
    attacking = f"{counts.silent} silent, {counts.half} half bodies, {counts.dripping} dripping"
    return [
        Section(
            title=f"Service without a proxy: {attacking}, {counts.honest} honest and slow",
            columns=("what", "found"),
            rows=(
                ("answers to attackers", answers),
                ("last attacker closed after", f"{max(found.closed_after):.1f} s"),
                ("honest clients served", f"{served} of {counts.honest}"),
                ("slowest of other answers", f"{max(found.others):.2f} s of {len(found.others)}"),
                ("memory before, peak, after", f"{before:.0f}, {peak:.0f}, {after:.0f} MB"),
            ),
            figures=(
                Figure("slow connections: last one closed", max(found.closed_after), "at most", 190.0, " s"),
                Figure.none("slow connections: honest clients not served", counts.honest - served),
                Figure("slow connections: slowest of other answers", max(found.others), "at most", 1.0, " s"),
                Figure("slow connections: memory kept", after - before, "at most", 50.0, " MB"),
            ),
        )
    ]


def _use(url: str) -> None:
    """Use a service as a client does, so that it has imported what it needs."""
    small = json.dumps(EXAMPLES["robots"]["modified DH"]).encode()
    for content in (small, small.ljust(_HONEST_BYTES)):
        headers = {"Content-Type": "application/json"}
        answer = httpx2.post(f"{url}/v1/robots", content=content, headers=headers, timeout=_LONGEST_SECONDS)
        answer.raise_for_status()
    for path in ("/health", "/v1/robots"):
        httpx2.get(url + path, timeout=_LONGEST_SECONDS).raise_for_status()


async def _attack(port: int, counts: _Counts) -> _Found:
    """Open all connections; return what clients found when all have ended."""
    found = _Found()
    half = (
        _HEADER % b"measurement-sets" + b"Content-Length: %d\r\n\r\n" % _DECLARED_BYTES + b" " * _HALF_BYTES
    )
    async with asyncio.TaskGroup() as attackers:
        others = asyncio.create_task(_ask(port, found))
        for _ in range(counts.silent):
            attackers.create_task(_hold(port, found, b"", b""))
        for _ in range(counts.half):
            attackers.create_task(_hold(port, found, half, b""))
        for number in range(counts.dripping):
            head = _HEADER % b"robots"
            first = head if number % 2 else head + b"Content-Length: 100000\r\n\r\n"
            attackers.create_task(_hold(port, found, first, b"x"))
        for _ in range(counts.honest):
            attackers.create_task(_post_slowly(port, found))
    others.cancel()
    return found


async def _hold(port: int, found: _Found, first: bytes, drip: bytes) -> None:
    """Send bytes at once, then some each second, until the service closes the connection."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    began = time.monotonic()
    answer = asyncio.create_task(_read(reader))
    sending = asyncio.create_task(_send(writer, first, drip))
    await asyncio.wait([answer], timeout=_LONGEST_SECONDS)
    found.closed_after.append(time.monotonic() - began)
    sending.cancel()
    found.answers["open" if not answer.done() else _status(answer.result())] += 1
    answer.cancel()
    writer.transport.abort()


async def _send(writer: asyncio.StreamWriter, first: bytes, drip: bytes) -> None:
    with suppress(OSError):
        writer.write(first)
        await writer.drain()
        while drip:
            await asyncio.sleep(1.0)
            writer.write(drip)
            await writer.drain()


async def _read(reader: asyncio.StreamReader) -> bytes:
    with suppress(OSError):
        return await reader.read()
    return b""


def _status(answer: bytes) -> str:
    return answer[9:12].decode() or "no answer"


async def _post_slowly(port: int, found: _Found) -> None:
    """Post a robot of 1 MB in 14 s."""
    body = json.dumps(EXAMPLES["robots"]["modified DH"]).encode().ljust(_HONEST_BYTES)
    head = _HEADER % b"robots" + b"Connection: close\r\nContent-Length: %d\r\n\r\n" % len(body)
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(head)
    size = len(body) // _HONEST_SECONDS + 1
    with suppress(OSError):
        for start in range(0, len(body), size):
            writer.write(body[start : start + size])
            await writer.drain()
            await asyncio.sleep(1.0)
    found.honest[_status(await _read(reader))] += 1
    writer.transport.abort()


async def _ask(port: int, found: _Found) -> None:
    """Ask for health and robots again and again, each time on a new connection."""
    async with httpx2.AsyncClient(timeout=_LONGEST_SECONDS) as client:
        while True:
            for path in ("/health", "/v1/robots"):
                began = time.monotonic()
                answer = await client.get(f"http://127.0.0.1:{port}{path}", headers={"Connection": "close"})
                answer.raise_for_status()
                found.others.append(time.monotonic() - began)
                await asyncio.sleep(0.05)
