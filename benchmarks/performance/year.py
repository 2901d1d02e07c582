"""A year of data: lists, searches and trends at 100,000 runs, their size, and an idle worker at 1,000,000.

By name only: ten minutes, or one study with `--part` of 1/7 to 7/7.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any, Final

import anyio
import httpx2
import sqlalchemy as sa
from fastapi import FastAPI

from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Part, Section
from benchmarks.services import PostgresqlServer, ServiceError, cpu, databases
from jointstiff.schemas.run import Campaign, RunRequest
from jointstiff.service.api.runs import _store_robot_once, _store_set_once
from jointstiff.service.app import create_app
from jointstiff.service.jobs import Parts
from jointstiff.service.store.jobs import JOB
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import jobs
from jointstiff.service.workers.engine import Queue
from jointstiff.service.workers.worker import Recovery
from tests.support.copied_rows import Copies, Template, insert_rows, make_engine

__all__ = ["run"]

_RUNS_OF_ROBOT: Final = 100
_RUNS_OF_SET: Final = 2
_TEMPLATES: Final = 4
_FILES: Final = 8
_LOOKS: Final = 20


@dataclass(frozen=True)
class _Size:
    """Size of the tables."""

    runs: int
    sets: int  # of the robot whose trend is measured
    worker: tuple[int, int]  # jobs at which an idle worker is measured


def run(*, quick: bool, part: Part) -> list[Section]:
    """Measure both databases, and the plans of SQLite on new files, or the studies of a part."""
    size = _Size(2_000, 100, (1_000, 4_000)) if quick else _Size(100_000, 2_000, (10_000, 1_000_000))
    studies: list[Callable[[], Section]] = []
    with databases() as kinds:
        for name, new in kinds.items():
            server = new if isinstance(new, PostgresqlServer) else None
            studies.append(partial(_lists, name, new, server, size.runs))
            studies.append(partial(_trend, name, new, server, size.sets))
            studies.append(partial(_worker, name, new, server, size.worker))
        studies.append(lambda: _plans([kinds["SQLite"]() for _ in range(_FILES)]))
        return [studies[number]() for number in part.of(len(studies))]


def _lists(name: str, new: Callable[[], str], server: PostgresqlServer | None, runs: int) -> Section:
    """Measure the lists of one database, and the bytes of a run in it."""
    url = new()
    with Store.open(url) as store:
        kilobytes = _fill(store, url, runs)
        found = store.robots.page(limit=1, filters={"name": "KR 240 cell 7"}).records[0].id
        asked = {
            "list": "/v1/jobs?kind=run",
            "list of all kinds": "/v1/jobs",
            "list of a robot": f"/v1/jobs?kind=run&robot_id={found}",
            "list by verdict": "/v1/jobs?kind=run&state=succeeded&verdict=use",
            "list by a rare verdict": "/v1/jobs?kind=run&verdict=do_not_use",
            "list by name": "/v1/jobs?kind=run&sort=name",
            "search, many found": "/v1/jobs?kind=run&q=campaign%207",
            "search, few found": "/v1/jobs?kind=run&q=KR%20240%20cell%207%20w-700007",
            "search of all kinds": "/v1/jobs?q=w-700007",
            "search of sets": "/v1/measurement-sets?q=w-700007",
            "search of robots": "/v1/robots?q=cell%207",
            "robots": "/v1/robots",
            "trend": f"/v1/robots/{found}/trend",
        }
        used = _used(create_app(store), asked, server)
    rows = [
        (what, f"{1e3 * each[0]:.1f}", f"{1e3 * each[1]:.1f}", f"{1e3 * each[2]:.1f}")
        for what, each in used.items()
    ]
    figures = [
        Figure(
            f"{name}: {what}, processor time of service and database",
            1e3 * sum(each[1:]),
            "at most",
            50,
            " ms",
        )
        for what, each in used.items()
    ]
    figures.append(Figure(f"{name}: a run on disk", kilobytes, "at most", 18, " kB"))
    return Section(
        f"{name}: {runs:,} runs of {max(1, runs // _RUNS_OF_ROBOT):,} robots, {kilobytes:.1f} kB a run",
        ("request", "first [ms]", "service [ms]", "database [ms]"),
        tuple(rows),
        tuple(figures),
        ("processor time; the first request of robots derives their last campaigns, which rows keep",),
    )


def _trend(name: str, new: Callable[[], str], server: PostgresqlServer | None, sets: int) -> Section:
    """Measure the trend of a robot with many sets, each with a run."""
    url = new()
    with Store.open(url) as store:
        copies = Copies(_templates(store), 1, sets, 1)
        engine = make_engine(url)
        copies.add_robots_and_sets(engine)
        copies.add_runs(engine)
        _vacuum(engine)
        robot = store.robots.page(limit=1, filters={"name": "KR 240 cell 0"}).records[0].id
        address = f"/v1/robots/{robot}/trend"
        app = create_app(store)
        first, service, database = _used(app, {"trend": address}, server)["trend"]
        kilobytes = anyio.run(_read_size, app, address) / 1e3
    seconds = service + database
    return Section(
        title=f"{name}: trend of {sets:,} sets",
        columns=("first [ms]", "service [ms]", "database [ms]", "answer [kB]"),
        rows=((f"{1e3 * first:.0f}", f"{1e3 * service:.1f}", f"{1e3 * database:.1f}", f"{kilobytes:.0f}"),),
        figures=(
            Figure(f"{name}: trend of {sets:,} sets, processor time", 1e3 * seconds, "at most", 50, " ms"),
            Figure(f"{name}: trend of {sets:,} sets, answer", kilobytes, "at most", 100, " kB"),
        ),
        notes=("the first trend after the start of a service reads the runs of all sets",),
    )


async def _read_size(app: FastAPI, address: str) -> int:
    """Return the size of an answer [bytes]."""
    transport = httpx2.ASGITransport(app)
    async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
        answer = await client.get(address)
        return len(answer.raise_for_status().content)


def _used(
    app: FastAPI, asked: Mapping[str, str], server: PostgresqlServer | None
) -> dict[str, tuple[float, float, float]]:
    """Return the processor time of each request [s]: of the first one; of the service, and of the server."""

    async def measure() -> dict[str, tuple[float, float, float]]:
        used = {}
        transport = httpx2.ASGITransport(app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
            (await client.get("/v1/jobs?limit=1")).raise_for_status()
            for what, address in asked.items():
                times, before = [], 0.0
                for number in range(1 + _LOOKS):
                    if number == 1:
                        before = 0.0 if server is None else cpu(server.pid)
                    began = time.process_time()
                    (await client.get(address)).raise_for_status()
                    times.append(time.process_time() - began)
                of_server = 0.0 if server is None else (cpu(server.pid) - before) / _LOOKS
                used[what] = (times[0], median(times[1:]), of_server)
        return used

    return anyio.run(measure)


def _fill(store: Store, url: str, runs: int) -> float:
    """Fill a store: some rows by its own code, the others as copies of them.

    Returns:
        Size of a run on disk [kB].
    """
    copies = Copies(_templates(store), max(1, runs // _RUNS_OF_ROBOT), runs, _RUNS_OF_SET)
    engine = make_engine(url)
    copies.add_robots_and_sets(engine)
    before = _bytes(engine)
    copies.add_runs(engine)
    kilobytes = (_bytes(engine) - before) / runs / 1e3
    _vacuum(engine)
    return kilobytes


def _vacuum(engine: sa.Engine) -> None:
    """Do at once what autovacuum of PostgreSQL does in its time, and close an engine."""
    if engine.dialect.name == "postgresql":
        with engine.execution_options(isolation_level="AUTOCOMMIT").connect() as connection:
            connection.exec_driver_sql("VACUUM ANALYZE")
    engine.dispose()


def _templates(store: Store) -> list[Template]:
    """Store some campaigns and their runs by the service's own code; return their ids."""
    parts, found = Parts(store), []
    for seed in range(_TEMPLATES):
        campaign = Campaign.model_validate_json(json.dumps(small_campaign(seed=seed).document))
        robot_id = _store_robot_once(parts, campaign.robot)
        set_id = _store_set_once(parts, campaign.measurement_set, robot_id)
        made = parts.jobs["run"].create(RunRequest(measurement_set_id=set_id), None)
        if made.trend is None:
            raise ServiceError("a run of the benchmark has no result")
        found.append(Template(robot_id, set_id, made.id))
    return found


def _bytes(engine: sa.Engine) -> int:
    """Return the size of a database [bytes]."""
    query = (
        "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"
        if engine.dialect.name == "sqlite"
        else "SELECT pg_database_size(current_database())"
    )
    with engine.connect() as connection:
        return int(connection.execute(sa.text(query)).scalar_one())


class _IdleQueue(Queue):
    """The queue of a worker that carries nothing out."""

    def seconds_of_running_parts(self) -> dict[str, float]:
        """Return nothing: no part is under way."""
        return {}

    def recover(self, executors: Iterable[str]) -> None:
        """Do nothing: no worker is dead."""


def _worker(
    name: str, new: Callable[[], str], server: PostgresqlServer | None, sizes: tuple[int, int]
) -> Section:
    """Measure the periodic looks of a worker that has nothing to do, at two numbers of jobs."""
    used, rows = [], []
    for count in sizes:
        url = new()
        with Store.open(url) as store, closing(_IdleQueue(store, url)) as queue:
            _fill_short(store, url, count)
            parts = Parts(store)
            recovery = Recovery(store, parts.jobs_of, queue, "idle")  # type: ignore[arg-type]
            recovery.check_and_recover()
            before = 0.0 if server is None else cpu(server.pid)
            times = []
            for _ in range(_LOOKS):
                began = time.process_time()
                recovery.check_and_recover()
                times.append(time.process_time() - began)
            of_server = 0.0 if server is None else (cpu(server.pid) - before) / _LOOKS
        used.append(median(times) + of_server)
        rows.append((f"{count:,} jobs", f"{1e3 * median(times):.1f}", f"{1e3 * of_server:.1f}"))
    figure = Figure(
        f"{name}: a look of an idle worker at {sizes[1]:,} jobs / at {sizes[0]:,}",
        used[1] / used[0],
        "at most",
        1.3,
        "×",
    )
    title = f"{name}: processor time of a look of an idle worker, one each 5 s"
    return Section(title, ("size", "worker [ms]", "database [ms]"), tuple(rows), (figure,))


def _fill_short(store: Store, url: str, count: int) -> None:
    """Fill a store with jobs whose documents are short: a look reads none."""
    template, engine = _templates(store)[0], make_engine(url)
    with engine.begin() as connection:
        short = (
            sa.update(jobs).where(jobs.c.id == template.run).values(document="{}", trend=None, numbers=None)
        )
        connection.execute(short)
    copies = Copies([template], 1, count, _RUNS_OF_SET)
    owners = {"robot_id": template.robot, "measurement_set_id": template.set}
    insert_rows(engine, jobs, (copies.run(number) | owners for number in range(count)))
    _vacuum(engine)


@contextmanager
def _plans_noted(store: Store) -> Iterator[list[str]]:
    """Note the plan of each statement on a store, as SQLite explains it."""
    plans: list[str] = []

    def note(connection: sa.Connection, _cursor: object, statement: str, parameters: Any, *_: object) -> None:  # noqa: ANN401 - of any statement
        if statement.startswith("SELECT"):
            rows = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", parameters).all()
            plans.append("; ".join(str(row[3]) for row in rows))

    with store._database.reading() as connection:
        engine = connection.engine
    sa.event.listen(engine, "before_cursor_execute", note)
    try:
        yield plans
    finally:
        sa.event.remove(engine, "before_cursor_execute", note)


def _plans(urls: list[str]) -> Section:
    """Compare the plans of lists, of a trend and of a worker's looks over new files."""
    found = []
    for url in urls:
        with Store.open(url) as store, _plans_noted(store) as plans:
            for name in (
                "robot_id",
                "name",
                "state",
                "verdict",
                "method",
                "elasticity",
                "measurement_set_id",
            ):
                for sort, q in (("-created_at", None), ("name", None), ("-created_at", "cell 7")):
                    filters = {"kind": "run", name: "x"}
                    store.jobs(JOB).page(limit=50, filters=filters, sort=sort, q=q, counted=True)
            for listed in (store.robots, store.sets, store.open_sets):
                for sort in ("created_at", "-name"):
                    listed.page(limit=50, sort=sort, q="cell", counted=True)
            store.runs_with_numbers("x", 100)
            store.sets_of_robot("x")
            store.open_jobs(["run"])
            store.find_unfinished_jobs(["x"])
        found.append(tuple(plans))
    rows = tuple((plan,) for plan in dict.fromkeys(found[0]))
    figure = Figure(
        f"different sets of plans over {len(urls)} new files of SQLite", len(set(found)), "at most", 1
    )
    return Section(f"Plans of SQLite on {len(urls)} new files", ("plan",), rows, (figure,))
