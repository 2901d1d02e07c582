"""Worker processes on PostgreSQL: two beside one, the service's answers meanwhile, and cancelling."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from statistics import quantiles
from typing import Any, Final

import httpx2
import psycopg

from benchmarks.campaigns import blocks_of_set, default_settings, small_campaign
from benchmarks.report import Figure, Section, seconds_text
from benchmarks.services import Service, ServiceError, numbers, post_campaign, postgresql
from benchmarks.timing import Times, interleaved
from jointstiff.schemas.options import MAX_REPETITIONS
from jointstiff.service.threads import ONE_THREAD
from jointstiff.solver.resampling import ResamplingPlan, resample

__all__ = ["run"]

CONFIGURATIONS, REPETITIONS = 5_000, MAX_REPETITIONS
FEW: Final = 1_000
"""Resamples, as many as the figure speaks of."""
BARE: Final = 10_000
"""Resamples by processes with nothing around them."""
ROUNDS: Final = 3
CHECKS, CANCELS = 400, 5
_END_SECONDS: Final = 600.0
_prepared: dict[str, Any] = {}
"""Of a process that draws with nothing around it."""


def run(*, quick: bool) -> list[Section]:
    """Measure on a PostgreSQL server of our own."""
    with postgresql() as new_database:
        return [
            _speed_up(new_database, quick=quick),
            _answers(new_database(), quick=quick),
            _cancelling(new_database(), quick=quick),
        ]


def _speed_up(new_database: Callable[[], str], *, quick: bool) -> Section:
    """The same run on one worker and on two, in turn; the service that is not measured does not run."""
    many, few = (200, 100) if quick else (REPETITIONS, FEW)
    configurations = 50 if quick else CONFIGURATIONS
    databases = {"one worker": (new_database(), 1), "two workers": (new_database(), 2)}
    heavy, light = Times({name: [] for name in databases}, {}), Times({name: [] for name in databases}, {})
    for _ in range(ROUNDS):
        for name, (database, count) in databases.items():
            with Service(database, count) as service, _client(service) as client:
                post = _poster(client, configurations)
                post(few)  # warm up: workers are there, and have read the set
                for times, repetitions in ((heavy, many), (light, few)):
                    start = time.perf_counter()
                    times.results[name] = post(repetitions)
                    times.seconds[name].append(time.perf_counter() - start)
    bare = _bare(configurations, 100 if quick else BARE)
    rows = [
        *_rows(f"{many:,} resamples", heavy),
        *_rows(f"{few:,} resamples", light),
        *_rows("nothing around it", bare),
    ]
    what = f"{many:,} resamples of {configurations:,} configurations, PostgreSQL: one worker / two"
    return Section(
        title=f"Workers: resamples of {configurations:,} configurations, posted to read",
        columns=("candidate", "time / two workers", "median", "numbers"),
        rows=tuple(rows),
        figures=(
            Figure(what, heavy.ratio("one worker", "two workers"), "at least", 1.7, "×"),
            Figure("the same: runs whose numbers differ", _different(heavy, light), "at most", 0),
        ),
        notes=(
            f"{few:,} resamples are too few to take long: the set's own identification then counts",
            "nothing around it: the draws alone, in one process and shared by two: what the machine can give",
        ),
        data={"heavy": heavy.seconds, "light": light.seconds, "bare": bare.seconds},
    )


def _bare(configurations: int, repetitions: int) -> Times:
    """The same draws without service, engine and database."""
    os.environ.update(ONE_THREAD)  # for the processes that are started now
    spawn, half = get_context("spawn"), repetitions // 2
    work = {"one worker": [(0, repetitions)], "two workers": [(0, half), (half, repetitions)]}
    prepare = configurations, repetitions
    with ProcessPoolExecutor(2, spawn, _prepare, prepare) as pool:
        return interleaved(
            {name: partial(_drawn_by, pool, spans) for name, spans in work.items()}, rounds=ROUNDS
        )


def _prepare(configurations: int, repetitions: int) -> None:
    campaign = small_campaign(configurations=configurations)
    settings = default_settings(campaign.robot)
    _prepared["blocks"] = blocks_of_set(campaign.robot, campaign.measurements, settings)
    _prepared["plan"] = ResamplingPlan(configurations // 2, repetitions, seed=0)
    _prepared["bounds"] = settings.bounds


def _drawn_by(pool: ProcessPoolExecutor, spans: list[tuple[int, int]]) -> list[float]:
    return [value for part in pool.map(_drawn, spans) for value in part]


def _drawn(span: tuple[int, int]) -> list[float]:
    found: list[float] = resample(**_prepared, start=span[0], stop=span[1]).compensation.tolist()
    return found


def _rows(what: str, times: Times) -> list[tuple[str, ...]]:
    two, same = "two workers", "the same" if not _different(times) else "DIFFERENT"
    return [
        (f"{what}, {name}", f"{times.ratio(name, two):.2f}", seconds_text(times.median(name)), same)
        for name in times.seconds
    ]


def _different(*several: Times) -> int:
    return sum(len({json.dumps(result) for result in times.results.values()}) > 1 for times in several)


def _poster(client: httpx2.Client, configurations: int) -> Callable[[int], dict[str, Any]]:
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
        state = client.patch(f"/v1/jobs/{run_id}", json={"cancelled": True}).json()
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


def _health(client: httpx2.Client, checks: int) -> list[float]:
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
    """Return the steps done beyond those of a cancelled run; each worker may finish its current one."""
    configurations = 500 if quick else CONFIGURATIONS
    rows, greatest = [], 0.0
    with Service(database, 2) as service, _client(service) as client:
        set_id = post_campaign(client, configurations)
        for number in range(1 if quick else CANCELS):
            run_id = _start(client, set_id, configurations // 2, 100_000)
            _until(lambda run_id=run_id: _get(client, run_id)["progress"]["done"] > 0)  # type: ignore[misc]
            time.sleep(0.13 * number)
            start = time.perf_counter()
            told = client.patch(f"/v1/jobs/{run_id}", json={"cancelled": True}).json()
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
    query = "SELECT coalesce(max(done), 1), coalesce(sum(done), 0) FROM job_steps WHERE job_id = %s"
    with psycopg.connect(database, autocommit=True) as connection:
        step, done = connection.execute(query, [run_id]).fetchall()[0]
    return int(step), int(done)


def _start(client: httpx2.Client, set_id: str, size: int, repetitions: int) -> str:
    resampling = {"size": size, "repetitions": repetitions}
    body = {"measurement_set_id": set_id, "resampling": resampling}
    return str(client.post("/v1/runs?wait=0", json=body).raise_for_status().json()["id"])


def _get(client: httpx2.Client, run_id: str) -> dict[str, Any]:
    run: dict[str, Any] = client.get(f"/v1/runs/{run_id}").raise_for_status().json()
    return run


def _ended(client: httpx2.Client, run_id: str) -> dict[str, Any]:
    """The run once it has ended, followed by its events as the page does.

    To ask twenty times a second would take a tenth of a processor from the workers.
    """
    deadline = time.monotonic() + _END_SECONDS
    with client.stream("GET", f"/v1/jobs/{run_id}/events") as events:
        for _ in events.raise_for_status().iter_lines():
            if time.monotonic() > deadline:
                raise ServiceError(f"the run did not end within {_END_SECONDS:.0f} s")
    return _get(client, run_id)


def _until(met: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _END_SECONDS
    while not met():
        if time.monotonic() > deadline:
            raise ServiceError(f"nothing came within {_END_SECONDS:.0f} s")
        time.sleep(0.05)


def _client(service: Service) -> httpx2.Client:
    return httpx2.Client(base_url=service.url, timeout=120.0)
