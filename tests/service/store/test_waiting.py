"""What does not move and why, in words; and sessions of PostgreSQL that are lost."""

import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import psycopg
import pytest
import sqlalchemy as sa
from support.claims import Claims
from support.jobs import run_request, runs_of, stored_set
from support.processes import until
from typer.testing import CliRunner

from jointstiff.service.cli.app import app
from jointstiff.service.jobs import Part
from jointstiff.service.kinds.run.work import RunWork
from jointstiff.service.store.database import name_connections
from jointstiff.service.store.store import Store
from jointstiff.service.store.waiting import Waiting, connection_name, name_queue_schema


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    with Store.open(database_url) as opened:
        yield opened


@pytest.fixture
def claims(store: Store, database_url: str) -> Iterator[Claims]:
    with closing(Claims(store, database_url)) as queue:
        yield queue


@pytest.fixture
def runs(store: Store, claims: Claims, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(RunWork, "steps", lambda _work: [(i, i + 1) for i in range(24)])
    return runs_of(store, claims.enqueue)


@pytest.fixture
def run(store: Store, runs: Any) -> Any:
    return runs.create(run_request(stored_set(store), resampling={"size": 8, "repetitions": 24}), None)


def let_pass(store: Store, seconds: float) -> None:
    """Put all that was written into the past [s]."""
    is_sqlite = store.ping() == "sqlite"
    for table, column in (("jobs", "created_at"), ("job_steps", "stored_at"), ("heartbeats", "beat_at")):
        earlier = (
            f"strftime('%Y-%m-%d %H:%M:%f', {column}, '-{seconds} seconds') || '000'"
            if is_sqlite
            else f"{column} - interval '{seconds} s'"
        )
        store._database.change(sa.text(f"UPDATE {table} SET {column} = {earlier}"))  # noqa: S608
    schema = store.schema()
    table = "workflow_status" if schema is None else f"{name_queue_schema(schema)}.workflow_status"
    of_parts = sa.text(f"UPDATE {table} SET created_at = created_at - :n")  # noqa: S608
    store._database.change(of_parts.bindparams(n=int(1000 * seconds)))


def reasons(store: Store) -> list[str]:
    return [job.why for job in store.waits.read().stuck]


def test_a_job_that_waits_without_a_worker_is_told_after_30_s(store: Store, run: Any) -> None:
    let_pass(store, 25)
    assert store.waits.read() == Waiting((), 1, pytest.approx(25, abs=5))
    let_pass(store, 15)
    (stuck,) = store.waits.read().stuck
    assert (stuck.job_id, stuck.kind, stuck.seconds) == (run.id, "run", pytest.approx(40, abs=5))
    assert stuck.describe().startswith(f"run {run.id} has not moved for 4")
    assert "no worker is running; start one with `jointstiff worker`" in stuck.why


def test_a_job_behind_others_waits_for_its_turn_and_is_not_stuck(store: Store, run: Any, runs: Any) -> None:
    request = run_request(run.measurement_set_id, resampling={"size": 8, "repetitions": 24})
    other = runs.create(request, None)
    let_pass(store, 40)
    store.heartbeats.beat("alive")
    seen = store.waits.read()
    assert seen.stuck == []
    assert {job.why for job in seen.still if job.job_id in {run.id, other.id}} >= {
        "its part waits for a worker; 0 parts of other jobs come first"
    }
    assert (seen.parts, seen.oldest_seconds) == (2, pytest.approx(40, abs=5))


def test_a_silent_worker_and_one_that_has_ended_are_named(store: Store, claims: Claims, run: Any) -> None:
    store.heartbeats.beat("b")
    assert claims.claim("b") == Part(run.id, 0, 0)
    let_pass(store, 35)
    store.heartbeats.beat("c")
    (why,) = reasons(store)
    assert why.startswith("worker b has shown no sign of life for 3")
    store.heartbeats.forget("b")
    assert reasons(store) == ["worker b has ended; another worker takes over its part"]


def test_a_worker_that_computes_is_told_only_after_five_minutes(
    store: Store, claims: Claims, run: Any
) -> None:
    claims.claim("b")
    let_pass(store, 250)
    store.heartbeats.beat("b")
    assert reasons(store) == []
    let_pass(store, 60)
    store.heartbeats.beat("b")
    assert reasons(store) == ["worker b computes a step"]


def test_a_job_of_long_steps_may_be_still_for_five_of_them(store: Store, claims: Claims, run: Any) -> None:
    claims.claim("b")
    for step in range(3):
        store.steps.store_result(run.id, (step, step + 1), b"result")
        let_pass(store, 20)
    let_pass(store, 60)  # with the last 20 s less than five times 20 s
    assert reasons(store) == []
    let_pass(store, 30)
    assert reasons(store) == ["worker b has ended; another worker takes over its part"]


def test_a_part_that_was_handed_back_is_told_with_the_number_of_times(
    store: Store, claims: Claims, run: Any
) -> None:
    store.heartbeats.beat("b")
    part = claims.claim("b")
    for delays in range(2):
        claims.hand_back(Part(part.job_id, part.number, part.kept, delays))
    claims.end(part)
    claims._client.delete_workflows([name for name in delayed(claims) if name.endswith("~1")])
    let_pass(store, 40)
    store.heartbeats.beat("b")
    (why,) = reasons(store)
    assert why.startswith(
        "its part was handed back 2 times, as its rows were locked; it is offered again in "
    )


def delayed(claims: Claims) -> list[str]:
    return [row.workflow_id for row in claims._list_rows(status="DELAYED")]


def test_a_job_that_cannot_be_written_says_so(store: Store, run: Any) -> None:
    let_pass(store, 40)
    seen = store.waits.read("the database cannot be written")
    assert [job.why for job in seen.stuck] == ["the database cannot be written"]


def test_the_command_prints_what_waits_and_fails_if_a_job_is_stuck(
    store: Store, run: Any, database_url: str
) -> None:
    store.heartbeats.beat("b")
    result = CliRunner().invoke(app, ["status", "--database", database_url])
    assert result.exit_code == 0
    assert "workers: b\nqueue: 1 parts of jobs wait, the oldest for " in result.output
    let_pass(store, 40)
    result = CliRunner().invoke(app, ["status", "--database", database_url])
    assert result.exit_code == 1
    assert f"run {run.id} has not moved for 4" in result.output
    assert "s: no worker is running" in result.output


LOST = "UPDATE jobs SET name = name"


def lose(url: str, statement: str) -> psycopg.Connection[Any]:
    """Send a statement by the extended protocol but its last message, as a program that is cut off then."""
    connection = psycopg.connect(url, autocommit=True)
    connection.pgconn.enter_pipeline_mode()
    connection.pgconn.send_query_params(statement.encode(), None)
    connection.pgconn.flush()
    return connection


def test_a_lost_session_is_ended_and_no_other_is(new_postgresql_database: Any) -> None:
    """Not a long statement of ours, nor one that is idle, nor a lost one of another program."""
    url = new_postgresql_database()
    with Store.open(url) as store:
        lost = lose(name_connections(url, "w-lost"), LOST)
        others = [
            lose(f"{url}&application_name=report", LOST.replace("jobs", "robots")),
            psycopg.connect(name_connections(url, "idle"), autocommit=True),
            psycopg.connect(name_connections(url, "inside")),
            lose(name_connections(url, "busy"), "SELECT pg_sleep(60)"),
        ]
        others[2].execute("SELECT 1")
        time.sleep(0.3)
        assert store.waits.end_lost_sessions() == [], "it may go on within 20 s"
        until(lambda: store.waits.end_lost_sessions(0.2) == [connection_name("w-lost")], 10)
        time.sleep(0.2)
        assert store.waits.end_lost_sessions(0.2) == []
        alive = "SELECT count(*) FROM pg_stat_activity WHERE pid = ANY(%s)"
        pids = [each.info.backend_pid for each in others]
        with psycopg.connect(url) as other:
            assert other.execute(alive, [pids]).fetchone() == (4,)
        assert store._database.change(sa.text(LOST)) == 0, "no lock is left"
        for each in [lost, *others]:
            each.close()


def test_a_worker_that_waits_for_a_lock_is_named_with_the_worker_that_has_it(
    new_postgresql_database: Any,
) -> None:
    url = new_postgresql_database()
    with Store.open(url) as store, closing(Claims(store, url)) as claims:
        runs_of(store, claims.enqueue).create(run_request(stored_set(store)), None)
        for worker in ("a", "b"):
            store.heartbeats.beat(worker)
        part = claims.claim("b")
        let_pass(store, 31)
        for worker in ("a", "b"):
            store.heartbeats.beat(worker)
        with psycopg.connect(name_connections(url, "a")) as first:
            first.execute("UPDATE jobs SET name = name")
            with closing(lose(name_connections(url, "b"), "SELECT 1 FROM jobs FOR UPDATE")):
                until(lambda: reasons(store) != [], 30)
                assert reasons(store)[0].startswith(
                    "worker b waits for a lock of worker a (idle in transaction "
                )
        claims.hand_back(part)
        claims.end(part)
        (why,) = reasons(store)
        assert why.startswith("its part was handed back once, as worker b waited for a lock of worker a")
