"""Costs of each kind of work on PostgreSQL, and a simulation of who needs how many parts; docs/scale.md.

By name only, on a quiet machine: some minutes.
"""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heapreplace
from itertools import count
from math import ceil
from pathlib import Path
from typing import Any, Final

import httpx2
import numpy as np
import psycopg

from benchmarks.report import Figure, Section
from benchmarks.services import PostgresqlServer, Service, cpu, post_campaign, postgresql
from benchmarks.studies.programs import KUKA_TOOL, START, path, tool_poses
from jointstiff.simulator.programs import program_text

__all__ = ["run"]

STATIONS: Final = ("service", "database", "worker")
MIX: Final = {
    "readings": 1.0,
    "run": 1.0,
    "look": 10.0,
    "map": 0.1,
    "program": 0.1,
    "resampled": 0.05,
    "plan": 0.02,
}
"""Posts and looks for each run of a day: an assumption."""
SIZES: Final = {"plant: 1,000 robots": 10_000, "fleet: 1e5 robots": 100_000, "public service": 1_000_000}
"""Runs a day: ten of each robot of a plant, one of each of a fleet."""
PEAK: Final = 3.0
"""Work in the busiest hour over that of an hour on average: an assumption."""
SIMULATED_SECONDS: Final = 600.0
WAITS: Final = {"service": 0.2, "database": 0.05, "worker": 20.0}
"""Longest waits in queues that 95 of 100 requests may have [s]."""
WORKERS: Final = (1, 2, 4)
IDLE_SECONDS: Final = 10.0
_ENDED: Final = frozenset({"succeeded", "failed", "cancelled"})


@dataclass(frozen=True)
class Cost:
    """Cost of one request."""

    seconds: Mapping[str, float]  # of a processor, by station
    rows: float
    size: float  # [B]


def run(*, quick: bool) -> list[Section]:
    """Measure on a PostgreSQL server of our own, then simulate."""
    with postgresql() as server:
        costs, notes = _costs(server, 2 if quick else 40)
        carried = {workers: _carried(server, workers, 2 if quick else 24) for workers in WORKERS}
    return [_cost_section(costs, notes), _carried_section(carried), _simulated(costs, quick=quick)]


# Measured


def _costs(server: PostgresqlServer, repetitions: int) -> tuple[dict[str, Cost], list[str]]:
    """Return costs by request, and notes on idle time and memory."""
    database = server()
    with Service(database, 1) as service, httpx2.Client(base_url=service.url, timeout=300) as client:
        requests = _requests(client)
        for post in requests.values():  # what is loaded once
            post()
        before = _used(service, server)
        time.sleep(IDLE_SECONDS)
        idle = (_used(service, server) - before) / IDLE_SECONDS
        costs = {}
        for name, post in requests.items():
            number = repetitions if name in {"readings", "run", "look"} else max(1, repetitions // 4)
            before, held, began = _used(service, server), _stored(database), time.monotonic()
            for _ in range(number):
                post()
            used = _used(service, server) - before - idle * (time.monotonic() - began)
            each = dict(zip(STATIONS, np.maximum(used, 0.0) / number, strict=True))
            costs[name] = Cost(each, *((_stored(database) - held) / number))
        notes = [
            f"without work: {load:.3f} processors of the {at}"
            for at, load in zip(STATIONS, idle, strict=True)
        ]
        for name, pid in (("service", service.process.pid), ("worker", service.workers()[0])):
            notes.append(f"greatest memory of the {name}: {_peak(pid):.0f} MB")
    return costs, notes


def _requests(client: httpx2.Client) -> dict[str, Callable[[], object]]:
    """Return functions that send a request of each kind, and wait for its end."""
    numbers = count()
    set_id = post_campaign(client, 19)
    made = client.post("/v1/runs", json={"measurement_set_id": set_id}).raise_for_status().json()["id"]
    area = {"area": [[1.2, -0.6, 0.6], [1.8, 0.6, 1.0]], "grid": [20, 10, 5], "place": [0.0, 0.0, 0.25]}
    corrected = {
        "run_id": made,
        "units": {"length": "mm", "angle": "deg", "force": "N"},
        "accuracy_option": "off",
        "load": {"force": [0.0, 0.0, -500.0]},
        "tools": [{"values": KUKA_TOOL}],
        "bases": [{"values": [0.0] * 6}],
        "start": np.degrees(START).tolist(),
    }
    text = program_text("krl", tool_poses(path(1_000)), 4).encode()

    def program() -> object:
        files = {"files": ("path.src", text)}
        options = {"options": json.dumps(corrected)}
        return _ended(client, client.post("/v1/programs?wait=0", data=options, files=files))

    def posted(collection: str, body: Mapping[str, Any]) -> Callable[[], object]:
        return lambda: _ended(client, client.post(f"/v1/{collection}?wait=0", json=body))

    resampling = {"size": 10, "repetitions": 1_000}
    return {
        "readings": lambda: post_campaign(client, 19 + next(numbers) % 2),
        "run": posted("runs", {"measurement_set_id": set_id}),
        "look": lambda: client.get(f"/v1/runs/{made}").raise_for_status(),
        "map": posted("maps", {"run_id": made, "force": [0.0, 0.0, -900.0], "turns": 4, **area}),
        "program": program,
        "resampled": lambda: posted(
            "runs", {"measurement_set_id": set_id, "resampling": resampling | {"seed": next(numbers)}}
        )(),
        "plan": posted("plans", {"measurement_set_id": set_id, "readings": 6}),
    }


def _ended(client: httpx2.Client, answer: httpx2.Response) -> dict[str, Any]:
    job: dict[str, Any] = answer.raise_for_status().json()
    while job["state"] not in _ENDED:
        time.sleep(0.5)  # what asks often costs the service more than the work
        job = client.get(answer.headers["location"]).raise_for_status().json()
    if job["state"] != "succeeded":
        raise RuntimeError(job["error"])
    return job


def _used(service: Service, server: PostgresqlServer) -> np.ndarray[Any, Any]:
    """Return the processor time that service, database and workers have taken [s]."""
    workers = sum(map(cpu, service.workers()))
    return np.array([cpu(service.process.pid) - workers, cpu(server.pid), workers])


def _stored(database: str) -> np.ndarray[Any, Any]:
    """Return the rows and the bytes of a database."""
    with psycopg.connect(database) as connection:
        names = connection.execute("SELECT schemaname, relname FROM pg_stat_user_tables").fetchall()
        counts = [
            connection.execute(f'SELECT count(*) FROM "{schema}"."{name}"'.encode()).fetchone()  # noqa: S608
            for schema, name in names
        ]
        size = connection.execute("SELECT pg_database_size(current_database())").fetchone()
    return np.array([sum(row[0] for row in counts if row), size[0] if size else 0], dtype=float)


def _peak(pid: int) -> float:
    """Return the greatest memory that a process has held [MB]."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1e3


def _carried(server: PostgresqlServer, workers: int, number: int) -> tuple[float, float]:
    """Return resampled runs a second by some workers, and the processors that the database takes for them."""
    with Service(server(), workers) as service, httpx2.Client(base_url=service.url, timeout=300) as client:
        resampling = {"size": 100, "repetitions": 10_000}
        body = {"measurement_set_id": post_campaign(client, 400), "resampling": resampling}
        _ended(client, client.post("/v1/runs?wait=0", json=body))  # a worker is there
        before, began = cpu(server.pid), time.monotonic()
        answers = [client.post("/v1/runs?wait=0", json=body) for _ in range(number)]
        for answer in answers:
            _ended(client, answer)
        seconds = time.monotonic() - began
        return number / seconds, (cpu(server.pid) - before) / seconds


# Simulated


def waits_of(arrivals: Sequence[float], seconds: Sequence[float], parts: int) -> Iterator[float]:
    """Yield how long each request waits, first come first served, for one of some equal parts."""
    free = [0.0] * parts
    heapify(free)
    for arrival, needed in zip(arrivals, seconds, strict=True):
        begin = max(arrival, free[0])
        heapreplace(free, begin + needed)
        yield begin - arrival


def simulated(costs: Mapping[str, Cost], runs: int, parts: Mapping[str, int]) -> dict[str, float]:
    """Return the wait that 95 of 100 requests keep below at each station in the busiest hour [s]."""
    chance = random.Random(1)  # noqa: S311
    rate = PEAK * runs / 86_400.0
    asked = [
        (chance.uniform(0.0, SIMULATED_SECONDS), name)
        for name, each in MIX.items()
        for _ in range(round(rate * each * SIMULATED_SECONDS))
    ]
    waits = {}
    for station in STATIONS:  # one after the other: each request leaves a station later than it came
        asked.sort()
        needed = [costs[name].seconds[station] for _, name in asked]
        waited = list(waits_of([at for at, _ in asked], needed, parts[station]))
        used = [wait for wait, seconds in zip(waited, needed, strict=True) if seconds]
        waits[station] = float(np.quantile(used or [0.0], 0.95))
        asked = [
            (at + wait + seconds, name)
            for (at, name), wait, seconds in zip(asked, waited, needed, strict=True)
        ]
    return waits


def parts_for(costs: Mapping[str, Cost], runs: int) -> tuple[dict[str, int], dict[str, float]]:
    """Return the fewest parts of each kind by which all waits are short, and the waits."""
    rate = PEAK * runs / 86_400.0
    parts = {station: max(1, ceil(rate * per_run(costs, station))) for station in STATIONS}
    while True:
        waits = simulated(costs, runs, parts)
        long = [station for station in STATIONS if waits[station] > WAITS[station]]
        if not long:
            return parts, waits
        parts[long[0]] += 1


def per_run(costs: Mapping[str, Cost], station: str) -> float:
    """Return the processor time that a run takes at a station, with all that goes with it [s]."""
    return sum(share * costs[name].seconds[station] for name, share in MIX.items())


# Reported


def _cost_section(costs: Mapping[str, Cost], notes: Sequence[str]) -> Section:
    return Section(
        title="Cost of a request, on PostgreSQL",
        columns=("request", *(f"{station} [ms]" for station in STATIONS), "rows", "kB"),
        rows=tuple(
            (
                name,
                *(f"{1e3 * cost.seconds[station]:.1f}" for station in STATIONS),
                f"{cost.rows:.1f}",
                f"{cost.size / 1e3:.1f}",
            )
            for name, cost in costs.items()
        ),
        figures=(),
        notes=tuple(notes),
    )


def _carried_section(carried: Mapping[int, tuple[float, float]]) -> Section:
    return Section(
        title="Runs with 10,000 resamples of 400 configurations, by workers of one machine",
        columns=("workers", "runs a second", "processors of the database"),
        rows=tuple((f"{n}", f"{rate:.2f}", f"{load:.2f}") for n, (rate, load) in carried.items()),
        figures=(Figure("two workers over one", carried[2][0] / carried[1][0], "at least", 1.6, "×"),),
    )


def _simulated(costs: Mapping[str, Cost], *, quick: bool) -> Section:
    size = sum(share * costs[name].size for name, share in MIX.items())
    carries = {station: 0.8 * 86_400 / PEAK / per_run(costs, station) for station in STATIONS}
    rows = []
    for name, runs in list(SIZES.items())[: 1 if quick else None]:
        parts, waits = parts_for(costs, runs)
        seen = [f"{parts[station]}, {1e3 * waits[station]:.0f} ms" for station in STATIONS]
        rows.append((name, f"{runs:,}", *seen, f"{365 * runs * size / 1e9:,.0f} GB"))
    return Section(
        title="Parts that keep waits short in the busiest hour, and the wait that 95 of 100 keep below",
        columns=("size", "runs a day", *STATIONS, "a year"),
        rows=tuple(rows),
        figures=(),
        notes=tuple(
            f"one {station} is 80 % busy at {runs:,.0f} runs a day" for station, runs in carries.items()
        ),
    )
