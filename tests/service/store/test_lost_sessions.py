"""Connections to PostgreSQL that are cut in the middle of a write: no lock stays, whatever was sent."""

import secrets
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
import psycopg
import pytest
import sqlalchemy as sa
from support.processes import until
from support.silent_proxy import SilentProxy

from jointstiff.service.jobs import Part
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import StoreError
from jointstiff.service.store import postgresql
from jointstiff.service.store.database import connection_name, name_connections
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import (
    JobRecord,
    MeasurementSetRecord,
    RobotRecord,
    measurement_sets,
)
from jointstiff.service.workers.engine import Queue

TIME = datetime(2026, 11, 20, tzinfo=UTC)
RUNS = KINDS[0].resource
BYTES = 60_000
"""Least size of a written document, which no compression makes smaller."""
SETS = 300
"""Sets of a robot that is renamed: a message of more than one portion."""


def text() -> str:
    """Return a JSON text that stays longer than `BYTES` when it is compressed."""
    return f'"{secrets.token_hex(2 * BYTES)}"'


def run_of(robot_id: str, set_id: str, job_id: str) -> JobRecord:
    columns = dict.fromkeys(("second_set_id", "name", "method", "weighting", "elasticity", "verdict"))
    return JobRecord(
        id=job_id,
        kind=RUNS.name,
        state="running",
        created_at=TIME,
        robot_id=robot_id,
        measurement_set_id=set_id,
        summary={},
        document="{}",
        **columns,
    )


def set_of(robot_id: str, set_id: str, size: int = BYTES) -> MeasurementSetRecord:
    return MeasurementSetRecord(
        set_id, robot_id, "set", "motor", 1, 0, TIME, "hash", document="{}", arrays=secrets.token_bytes(size)
    )


@dataclass
class Rows:
    """A robot of its own for a write, with a set and a run that has begun."""

    robot: str
    set: str
    job: str

    @classmethod
    def new(cls, store: Store, more_sets: int) -> "Rows":
        robot, set_id, job = (secrets.token_hex(16) for _ in range(3))
        store.robots.add(RobotRecord(robot, "robot", TIME, "hash", "{}"))
        store.sets.add(set_of(robot, set_id, 100))
        columns = [column.name for column in measurement_sets.c if column.name not in {"sequence", "id"}]
        copied = sa.select(*(measurement_sets.c[name] for name in columns), sa.func.gen_random_uuid())
        numbers = sa.func.generate_series(1, more_sets).table_valued("number")
        copies = copied.join_from(measurement_sets, numbers, sa.true()).where(measurement_sets.c.id == set_id)
        store._database.change(sa.insert(measurement_sets).from_select([*columns, "id"], copies))
        store.jobs(RUNS).add(run_of(robot, set_id, job))
        return cls(robot, set_id, job)


def store_step(store: Store, _queue: Queue | None, rows: Rows) -> None:
    store.steps.store_result(rows.job, (0, 1), secrets.token_bytes(BYTES))


def end(store: Store, _queue: Queue | None, rows: Rows) -> None:
    values = {"state": "succeeded", "document": text(), "trend": "{}"}
    store.jobs(RUNS).end(rows.job, "succeeded", lambda _record, _done: values)


def post(store: Store, queue: Queue | None, rows: Rows) -> None:
    assert queue
    record = replace(run_of(rows.robot, rows.set, secrets.token_hex(16)), document=text())
    store.jobs(RUNS).add(record, None, lambda connection: queue.enqueue(connection, record.id))


def add_parts(_store: Store, queue: Queue | None, rows: Rows) -> None:
    assert queue
    queue.add_following_parts(rows.job, [Part(rows.job, number, 0) for number in range(1, 8)])


def beat(store: Store, _queue: Queue | None, rows: Rows) -> None:
    store.heartbeats.beat(rows.job)


def rename(store: Store, _queue: Queue | None, rows: Rows) -> None:
    store.robots.change(rows.robot, lambda _: {"name": secrets.token_hex(8)})


WRITES = [store_step, end, post, add_parts, beat, rename]
Write = Callable[[Store, Queue | None, Rows], None]


@contextmanager
def through(proxy: SilentProxy, name: str, write: Write) -> Iterator[tuple[Store, Queue | None]]:
    """A store behind a proxy, whose connections have a name; with its queue if the write needs it."""
    url = name_connections(proxy.url, name)
    with Store.open(url) as store, ExitStack() as stack:
        needs_queue = write in {post, add_parts}
        yield store, stack.enter_context(closing(Queue(store, url))) if needs_queue else None


LOCKS = (
    "SELECT count(*) FROM pg_locks JOIN pg_stat_activity USING (pid) "
    "WHERE application_name = %s AND granted AND locktype IN ('relation', 'transactionid', 'tuple')"
)
"""Number of locks of tables and rows; a lock of a row is one of the transaction that has it."""


def seconds_locked(url: str, name: str, longest: float) -> float:
    """Return the time until the connections of a name have no lock any more [s]."""
    began = time.monotonic()
    with psycopg.connect(url, autocommit=True) as other:
        until(lambda: other.execute(LOCKS, [connection_name(name)]).fetchone() == (0,), longest)
    return time.monotonic() - began


def measure(url: str, write: Write) -> int:
    """Return the number of bytes that a write sends."""
    with Store.open(url) as direct, SilentProxy(url) as proxy, through(proxy, "whole", write) as opened:
        rows = Rows.new(direct, SETS if write is rename else 0)
        before = proxy.sent
        write(*opened, rows)
        return proxy.sent - before


def cut_after(url: str, write: Write, count: int, longest: float) -> float:
    """Cut a write after a number of its bytes; return the time until all its locks are free [s]."""
    name = f"cut-{secrets.token_hex(4)}"
    with Store.open(url) as direct, SilentProxy(url) as proxy, through(proxy, name, write) as opened:
        rows = Rows.new(direct, SETS if write is rename else 0)
        proxy.cut_after(count)
        thread = threading.Thread(target=ignore_outage, args=(write, *opened, rows))
        thread.start()
        until(lambda: proxy.is_cut or not thread.is_alive())
        seconds = seconds_locked(url, name, longest)
        thread.join(60)
        return seconds


def ignore_outage(write: Write, store: Store, queue: Queue | None, rows: Rows) -> None:
    with suppress(StoreError):
        write(store, queue, rows)


@pytest.mark.parametrize("write", [store_step, rename])
def test_a_write_that_is_cut_leaves_no_lock(
    write: Write, new_postgresql_database: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A statement by itself, and one of many rows, which the driver would send by the extended protocol."""
    monkeypatch.setattr(postgresql, "ANSWER_SECONDS", 2.0)
    url = f"{new_postgresql_database()}&options=-cidle_in_transaction_session_timeout%3D2000"
    assert cut_after(url, write, 3 * measure(url, write) // 5, 20.0) < 20.0


@pytest.mark.slow
@pytest.mark.parametrize("write", WRITES)
def test_writes_that_are_cut_anywhere_are_free_within_20_s(
    write: Write, new_postgresql_database: Callable[[], str], capsys: pytest.CaptureFixture[str]
) -> None:
    """With the times of the product; JOINTSTIFF_POSTGRESQL_PROGRAMS chooses another server."""
    url = new_postgresql_database()
    cuts = np.random.default_rng(5).integers(1, measure(url, write), 20)
    with ThreadPoolExecutor(10) as pool:
        seconds = sorted(pool.map(lambda cut: cut_after(url, write, int(cut), 60.0), cuts))
    with capsys.disabled():
        print(f"{write.__name__}: free after {[round(each, 1) for each in seconds]} s")  # noqa: T201
    assert seconds[-1] < 20.0
