"""kill -9, again and again: during one long run, under several open ones, and while clients post.

By name only: it takes about half an hour, or some minutes for each `--part` of 1/10 to 10/10.
"""

from __future__ import annotations

import random
import threading
import time
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any, Final
from uuid import uuid4

import httpx2
from sqlalchemy import func, select

from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Part, Section
from benchmarks.services import (
    Service,
    begin_run,
    databases,
    ended,
    followed,
    numbers,
    running,
    undisturbed,
)
from jointstiff.service.store.database import Database
from jointstiff.service.store.tables import idempotency_keys, job_steps, jobs, measurement_sets

__all__ = ["run"]

CONFIGURATIONS, REPETITIONS, SIZE = 5_000, 90_000, 1_000
"""Steps of a quarter of a second, some 240 of them."""
KILLS_OF_A_RUN, KILLS_WHILE_POSTING = 20, 50
OPEN_RUNS, OPEN_CONFIGURATIONS, OPEN_RESAMPLING = 3, 400, {"size": 100, "repetitions": 40_000}
"""Ten steps each, two or three seconds."""
KILLS_UNDER_OPEN_RUNS: Final = {"service": 10, "worker": 20}
ROUNDS: Final = 3
"""Of kills under open runs, each at other moments."""
VICTIMS: Final = ("worker", "service", "service and worker")
_END_SECONDS: Final = 900.0
_SOON: Final = 10.0
_PAUSE_SECONDS: Final = 0.1


@dataclass
class Outcome:
    """Outcome of the run that was disturbed."""

    kills: int = 0
    steps: int = 0
    run: dict[str, Any] = field(default_factory=dict)
    repeated: int = 0
    rows: int = 0
    done: int = 0
    left: int = 0
    slowest: float = 0.0


@dataclass
class Posted:
    """Resources that a client was told are stored, by collection and id, with the other answers."""

    answers: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    odd: list[str] = field(default_factory=list)
    tries: int = 0


def run(*, quick: bool, part: Part) -> list[Section]:
    """Disturb services on an SQLite file and on a PostgreSQL server of our own."""
    with databases() as kinds:
        mine = [(number // 2, list(kinds)[number % 2]) for number in part.of((2 + ROUNDS) * len(kinds))]
        runs = {kind: _disturbed(kinds[kind](), quick=quick) for of, kind in mine if of == 0}
        kills = 2 if quick else KILLS_WHILE_POSTING
        posts = {kind: _posting(kinds[kind](), kills) for of, kind in mine if of == 1}
        under = {
            f"{kind}, {victim}, round {of - 1}": _under_open_runs(
                kinds[kind](), victim, 2 if quick else number, seed=of
            )
            for of, kind in mine
            if of >= 2
            for victim, number in KILLS_UNDER_OPEN_RUNS.items()
        }
    sections = [_post_section(posts)] if posts else []
    if under:
        sections.insert(0, _open_section(under))
    if runs:
        expected = undisturbed(*_options(quick=quick))
        sections.insert(0, _run_section(runs, expected, 0 if quick else KILLS_OF_A_RUN))
    return sections


# One long run


def _options(*, quick: bool) -> tuple[int, dict[str, int]]:
    configurations, repetitions, size = (500, 20_000, 50) if quick else (CONFIGURATIONS, REPETITIONS, SIZE)
    return configurations, {"size": size, "repetitions": repetitions}


def _disturbed(database: str, *, quick: bool) -> Outcome:
    chance, outcome = random.Random(7), Outcome()  # noqa: S311 - moments, not secrets
    service = Service(database, 1)
    with httpx2.Client(base_url=service.url, timeout=60.0) as client:
        address = begin_run(client, *_options(quick=quick))
        victims = [VICTIMS[number % len(VICTIMS)] for number in range(3 if quick else KILLS_OF_A_RUN)]
        chance.shuffle(victims)
        for victim in victims:
            time.sleep(chance.uniform(0.0, 5.0))
            if client.get(address).json()["state"] not in {"queued", "running"}:
                break
            service = _struck(service, database, victim, outcome)
        before = 0
        for outcome.run in followed(client, address, _END_SECONDS):
            outcome.repeated += outcome.run["progress"]["done"] < before  # it never goes back
            before = outcome.run["progress"]["done"]
    with service:
        pass
    _count(database, outcome)
    return outcome


def _struck(service: Service, database: str, victim: str, outcome: Outcome) -> Service:
    """Kill, and start again what does not start by itself."""
    outcome.kills += 1
    if victim == "worker":
        service.kill_worker()
        return service
    workers = service.kill(workers=victim != "service")
    outcome.left += _left(workers)
    start = time.monotonic()
    again = Service(database, 1, service.port)
    outcome.slowest = max(outcome.slowest, time.monotonic() - start)
    return again


def _left(workers: list[int]) -> int:
    """Count the processes that still run after some seconds."""
    deadline = time.monotonic() + _SOON
    while any(map(running, workers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return sum(map(running, workers))


def _count(database: str, outcome: Outcome) -> None:
    with closing(Database.open(database)) as opened, opened.reading() as connection:
        outcome.rows = connection.execute(select(func.count()).select_from(jobs)).scalar_one()
        outcome.steps = connection.execute(select(func.count()).select_from(job_steps)).scalar_one()
    outcome.done = int(outcome.run["progress"]["done"])


def _run_section(runs: dict[str, Outcome], expected: dict[str, Any], kills: int) -> Section:
    def faults(outcome: Outcome) -> int:
        different = numbers(outcome.run) != expected
        duplicates = outcome.rows != 1 or outcome.done != expected["progress"]["total"]
        duplicates = duplicates or outcome.steps > 0
        return sum([outcome.run["state"] != "succeeded", different, duplicates, outcome.repeated > 0])

    rows = tuple(
        (
            kind,
            f"{found.kills}, {found.steps} steps left",
            found.run["state"],
            "the same" if numbers(found.run) == expected else "DIFFERENT",
            f"{found.rows}, {found.done:,} draws",
            str(found.left),
            f"{found.slowest:.1f} s",
        )
        for kind, found in runs.items()
    )
    return Section(
        title="kill -9 of worker, service, or both, at random moments of one run",
        columns=("database", "kills", "state", "numbers", "rows", "workers left", "slowest start"),
        rows=rows,
        figures=tuple(
            figure
            for kind, found in runs.items()
            for figure in (
                Figure(f"{kind}: kills before the run had ended", found.kills, "at least", kills),
                Figure.none(f"{kind}: runs not succeeded, different, or stored twice", faults(found)),
            )
        ),
        notes=("the undisturbed run was carried out in one process, without workers",),
        data={kind: {"kills": found.kills} for kind, found in runs.items()},
    )


# Several open runs


@dataclass
class Killed:
    """Outcome of the runs that were open while one process after the other was killed."""

    kills: int
    runs: list[dict[str, Any]]
    rows: int  # of runs in the database

    @property
    def failed(self) -> int:
        """Return the number of runs that did not succeed."""
        return sum(run["state"] != "succeeded" for run in self.runs)

    @property
    def odd(self) -> int:
        """Return the number of runs whose draws were not all counted, or were counted twice."""
        return sum(run["progress"]["done"] != OPEN_RESAMPLING["repetitions"] for run in self.runs)


def _under_open_runs(database: str, victim: str, kills: int, seed: int) -> Killed:
    """Kill one process after the other, soon after each start, while three runs are open all the time."""
    chance, addresses = random.Random(seed), list[str]()  # noqa: S311 - moments, not secrets
    workers = 1 if victim == "service" else 2
    service = Service(database, workers)
    with httpx2.Client(base_url=service.url, timeout=60.0) as client:
        for _ in range(kills):
            states = [client.get(address).json()["state"] for address in addresses]
            for _ in range(OPEN_RUNS - sum(state in {"queued", "running"} for state in states)):
                addresses.append(begin_run(client, OPEN_CONFIGURATIONS, OPEN_RESAMPLING))
            time.sleep(chance.uniform(0.3, 3.0))
            service = _struck(service, database, victim, Outcome())
        runs = [ended(client, address, _END_SECONDS) for address in addresses]
    with service:
        pass
    with closing(Database.open(database)) as opened, opened.reading() as connection:
        rows = connection.execute(select(func.count()).select_from(jobs)).scalar_one()
    return Killed(kills, runs, rows)


def _open_section(found: dict[str, Killed]) -> Section:
    expected = undisturbed(OPEN_CONFIGURATIONS, OPEN_RESAMPLING)
    different = {name: sum(numbers(run) != expected for run in each.runs) for name, each in found.items()}
    return Section(
        title=f"kill -9 of the service, or of workers, soon after each start, under {OPEN_RUNS} open runs",
        columns=("database, victim, round", "kills", "runs", "failed", "lost or stored twice", "other bits"),
        rows=tuple(
            (
                name,
                str(each.kills),
                str(len(each.runs)),
                str(each.failed),
                str(abs(each.rows - len(each.runs)) + each.odd),
                str(different[name]),
            )
            for name, each in found.items()
        ),
        figures=tuple(
            Figure.none(
                f"{name}: runs failed, lost, stored or counted twice, or of other bits",
                each.failed + abs(each.rows - len(each.runs)) + each.odd + different[name],
            )
            for name, each in found.items()
        ),
        notes=tuple(
            f"{name}: {run['error']}" for name, each in found.items() for run in each.runs if run["error"]
        ),
    )


# Posting


def _posting(database: str, kills: int) -> tuple[int, Posted, list[str]]:
    """Kill the service while a client posts; what it was told, and what is not so."""
    chance, stop, posted = random.Random(11), threading.Event(), Posted()  # noqa: S311
    service = Service(database, 1)
    client = threading.Thread(target=_post_on, args=(service.url, stop, posted), daemon=True)
    client.start()
    for _ in range(kills):
        # Now and then so long that the worker is there, too, which takes longer to start.
        time.sleep(chance.uniform(0.05, 2.0) if chance.random() < 0.7 else chance.uniform(3.0, 8.0))
        service.kill(workers=chance.random() < 0.5)
        service = Service(database, 1, service.port)
    stop.set()
    client.join()
    with service:
        faults = posted.odd + _lost(service, posted)
    return kills, posted, faults + _half_stored(database, posted)


def _post_on(url: str, stop: threading.Event, posted: Posted) -> None:
    """Post sets, quick runs and long runs in turn, each until it is answered, under a key of its own."""
    document = small_campaign().document
    with httpx2.Client(base_url=url, timeout=30.0) as client:
        robot = _acknowledged(client, "/v1/robots", document["robot"], posted)
        readings = document["measurement_set"] | {"robot_id": robot["id"]}
        while not stop.is_set():
            stored = _acknowledged(client, "/v1/measurement-sets", readings, posted)
            body = {"measurement_set_id": stored["id"]}
            _acknowledged(client, "/v1/runs", body, posted)
            resampling = {"size": 10, "repetitions": 200}
            _acknowledged(client, "/v1/runs?wait=0", body | {"resampling": resampling}, posted)
            stop.wait(_PAUSE_SECONDS)  # the long runs all have to end


def _acknowledged(client: httpx2.Client, path: str, body: dict[str, Any], posted: Posted) -> dict[str, Any]:
    key = {"Idempotency-Key": uuid4().hex}
    while True:
        posted.tries += 1
        with suppress(httpx2.TransportError):
            response = client.post(path, json=body, headers=key)
            if response.is_success:
                answer: dict[str, Any] = response.json()
                posted.answers[response.headers["location"].rpartition("/")[0], answer["id"]] = answer
                return answer
            posted.odd.append(f"{response.status_code} {response.text[:300]}")
        time.sleep(0.02)


_LATER = {"last_campaign"}
"""Fields of a robot that its next run changes."""


def _lost(service: Service, posted: Posted) -> list[str]:
    """Answers that are not what is stored, and runs that do not end."""
    faults = []
    with httpx2.Client(base_url=service.url, timeout=60.0) as client:
        for (path, identifier), answer in posted.answers.items():
            response = client.get(f"{path}/{identifier}")
            if response.status_code != httpx2.codes.OK:
                faults.append(f"{path}/{identifier} is {response.status_code}")
            elif answer.get("state") in {"queued", "running"}:
                run = ended(client, f"{path}/{identifier}", _END_SECONDS)
                if run["state"] != "succeeded":
                    faults.append(f"{path}/{identifier} is {run['state']}: {run['error']}")
            elif any(response.json()[name] != value for name, value in answer.items() if name not in _LATER):
                faults.append(f"{path}/{identifier} differs from the answer")
        faults += _unreadable(client)
    return faults


def _unreadable(client: httpx2.Client) -> list[str]:
    """Sets and runs that are listed, but cannot be read or do not end, acknowledged or not."""
    faults = []
    for path in ("/v1/measurement-sets", "/v1/jobs"):
        cursor: dict[str, str] = {}
        while True:
            page = client.get(path, params={"limit": "100"} | cursor).raise_for_status().json()
            for item in page["items"]:
                found = client.get(f"{path}/{item['id']}")
                if not found.is_success or found.json().get("state", "succeeded") != "succeeded":
                    faults.append(f"{path}/{item['id']} is half-stored: {found.text[:200]}")
            if page["next"] is None:
                break
            cursor = {"cursor": page["next"]}
    return faults


def _half_stored(database: str, posted: Posted) -> list[str]:
    """Rows without a key or keys without a row; each was posted with one, and each key made one row."""
    faults = []
    with closing(Database.open(database)) as opened, opened.reading() as connection:
        for table, collection in ((measurement_sets, "measurement-sets"), (jobs, "runs")):
            keyed = select(idempotency_keys.c.resource_id).where(idempotency_keys.c.resource == collection)
            keys = {str(row.resource_id) for row in connection.execute(keyed)}
            rows = {str(row.id) for row in connection.execute(select(table.c.id))}
            told = {i for path, i in posted.answers if path.endswith(table.name.replace("_", "-"))}
            if not keys == rows == told:
                counts = f"{len(keys)} keys, {len(rows)} rows, {len(told)} acknowledged"
                faults.append(f"{table.name}: {counts}")
    return faults


def _post_section(posts: dict[str, tuple[int, Posted, list[str]]]) -> Section:
    rows = tuple(
        (kind, str(kills), str(posted.tries), str(len(posted.answers)), str(len(faults)))
        for kind, (kills, posted, faults) in posts.items()
    )
    what = "acknowledged and lost, half-stored, stored twice, or refused without reason"
    return Section(
        title="kill -9 of the service while a client posts sets, quick runs and long runs",
        columns=("database", "kills", "posts tried", "acknowledged", "faults"),
        rows=rows,
        figures=tuple(Figure.none(f"{kind}: {what}", len(faults)) for kind, (*_, faults) in posts.items()),
        notes=tuple(f"{kind}: {fault}" for kind, (*_, faults) in posts.items() for fault in faults[:10]),
        data={kind: {"faults": faults} for kind, (*_, faults) in posts.items()},
    )
