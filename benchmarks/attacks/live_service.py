"""Live campaigns over HTTP: kill -9 while readings are sent, and fifty of them at once."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import httpx2
import numpy as np

from benchmarks.report import Figure, Part, Section
from benchmarks.services import Service, databases
from benchmarks.studies.live import ROWS, Reader, Row
from jointstiff.simulator import robot_document

__all__ = ["run"]

KILLS, CAMPAIGNS, READINGS = 20, 50, 4
_SENDERS = 8
_PATIENCE = 300.0
_HEALTH_SECONDS = 0.05


@dataclass
class Outcome:
    """Outcome of a campaign whose service was killed."""

    kills: int = 0
    acknowledged: dict[str, dict[str, Any]] = field(default_factory=dict)  # observations by label
    stored: list[dict[str, Any]] = field(default_factory=list)


def run(*, quick: bool, part: Part) -> list[Section]:
    """Kill services on both databases while readings are sent; then measure fifty campaigns at once."""
    with databases() as kinds:
        mine = [list(kinds)[number] for number in part.of(len(kinds))]
        killed = {kind: _killed(kinds[kind](), 3 if quick else KILLS) for kind in mine}
        health = {kind: _many(kinds[kind](), 8 if quick else CAMPAIGNS) for kind in mine}
    rows = [
        (kind, str(found.kills), str(len(found.acknowledged)), str(_lost(found)), str(_twice(found)))
        for kind, found in killed.items()
    ]
    titles = ("database", "kills", "acknowledged", "lost or changed", "twice")
    figures = [Figure.none(f"{kind}: lost or changed", _lost(found)) for kind, found in killed.items()]
    figures += [Figure.none(f"{kind}: stored twice", _twice(found)) for kind, found in killed.items()]
    pauses = [
        Figure(f"{kind}: /health beside {CAMPAIGNS} open campaigns, p95", p95, "at most", 50.0, " ms")
        for kind, (p95, _) in health.items()
    ]
    answers = tuple((kind, f"{p95:.0f} ms", f"{took:.2f} s") for kind, (p95, took) in health.items())
    return [
        Section("readings sent while the service is killed", titles, tuple(rows), tuple(figures)),
        Section("open campaigns at once", ("database", "/health p95", "reading p50"), answers, tuple(pauses)),
    ]


def _lost(outcome: Outcome) -> int:
    stored = {each["label"]: each for each in outcome.stored}
    return sum(_numbers(stored.get(label)) != _numbers(sent) for label, sent in outcome.acknowledged.items())


def _twice(outcome: Outcome) -> int:
    return len(outcome.stored) - len({each["label"] for each in outcome.stored})


def _numbers(observation: dict[str, Any] | None) -> object:
    if observation is None:
        return None
    readings = [(each["target"], each["unloaded"], each["loaded"]) for each in observation["readings"]]
    return observation["joints"], list(observation["force"]), readings


def _opened(client: httpx2.Client, seed: int, row: Row = ROWS[0]) -> tuple[Reader, str]:
    reader = Reader.of(row, seed)
    robot = client.post("/v1/robots", json=robot_document(reader.arm)).raise_for_status().json()["id"]
    header = reader.declared().declaration.header.model_dump(mode="json", exclude_none=True)
    body = {**header, "robot_id": robot, "observations": []}
    return reader, client.post("/v1/measurement-sets", json=body).raise_for_status().headers["location"]


def _reading(reader: Reader, following: dict[str, Any]) -> dict[str, Any]:
    read = reader.read(following["label"], following["joints"], following["force"])
    body: dict[str, Any] = read.model_dump(mode="json", exclude_none=True)
    return body


def _patiently(ask: Callable[[], httpx2.Response]) -> dict[str, Any]:
    """Ask until there is an answer."""
    deadline, last = time.monotonic() + _PATIENCE, "nothing"
    while time.monotonic() < deadline:
        try:
            answer = ask()
        except httpx2.TransportError as error:
            last = repr(error)
        else:
            if answer.status_code < 500:
                found: dict[str, Any] = answer.raise_for_status().json()
                return found
            last = f"{answer.status_code} {answer.text[:200]}"
        time.sleep(0.02)
    raise TimeoutError(f"the service does not answer; the last was {last}")


def _killed(database: str, kills: int) -> Outcome:
    """Send readings while the service is killed and started again."""
    chance, outcome = random.Random(11), Outcome()  # noqa: S311 - moments, not secrets
    service, over = Service(database, 0), threading.Event()
    with httpx2.Client(base_url=service.url, timeout=20.0) as client:
        # a goal that takes more readings than there are kills
        reader, address = _opened(client, 1, replace(ROWS[0], goal={"kind": "joints", "relative": 0.03}))

        def send() -> None:
            while not over.is_set():
                following = _patiently(lambda: client.get(f"{address}/next"))["next"]
                if following is None or len(outcome.acknowledged) >= 60:
                    return
                body = _reading(reader, following)
                _patiently(lambda body=body: client.post(f"{address}/observations", json=body))  # type: ignore[misc]
                outcome.acknowledged[body["label"]] = body

        sender = threading.Thread(target=send)
        sender.start()
        while outcome.kills < kills and sender.is_alive():
            before, deadline = len(outcome.acknowledged), time.monotonic() + _PATIENCE
            # Each second time while it starts, else amid readings, however slow the machine is.
            while outcome.kills % 2 and len(outcome.acknowledged) == before and time.monotonic() < deadline:
                time.sleep(0.02)
            time.sleep(chance.uniform(0.0, 3.0))
            service.kill()
            outcome.kills += 1
            service = Service(database, 0, service.port)
        over.set()
        sender.join()
        outcome.stored = _patiently(lambda: client.get(address))["observations"]
    with service:
        pass
    return outcome


def _many(database: str, campaigns: int) -> tuple[float, float]:
    """Return p95 of /health [ms] and the median time of a reading [s] beside campaigns measured at once."""
    waits, took, over = list[float](), list[float](), threading.Event()
    with Service(database, 0) as service:
        with httpx2.Client(base_url=service.url, timeout=_PATIENCE) as client:
            opened = [_opened(client, seed) for seed in range(campaigns)]

        def measure(share: list[tuple[Reader, str]]) -> None:
            with httpx2.Client(base_url=service.url, timeout=_PATIENCE) as client:
                for _ in range(READINGS):
                    for reader, address in share:
                        following = client.get(f"{address}/next").raise_for_status().json()["next"]
                        body = _reading(reader, following)
                        start = time.perf_counter()
                        client.post(f"{address}/observations", json=body).raise_for_status()
                        took.append(time.perf_counter() - start)

        def look() -> None:
            with httpx2.Client(base_url=service.url, timeout=_PATIENCE) as client:
                while not over.is_set():
                    start = time.perf_counter()
                    client.get("/health").raise_for_status()
                    waits.append(time.perf_counter() - start)
                    time.sleep(_HEALTH_SECONDS)

        senders = [threading.Thread(target=measure, args=(opened[k::_SENDERS],)) for k in range(_SENDERS)]
        looker = threading.Thread(target=look)
        for thread in [*senders, looker]:
            thread.start()
        for thread in senders:
            thread.join()
        over.set()
        looker.join()
    return 1e3 * float(np.quantile(waits, 0.95)), float(np.median(took))
