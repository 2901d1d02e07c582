"""Steps of jobs on both databases: workers at the same time, and workers that die between two writes."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import sqlalchemy as sa
from support.jobs import request, runs_of, stored_set

from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import job_steps
from jointstiff.service.workers.worker import Recovery, carry_out_next

SPANS = [(0, 100), (100, 200), (200, 300)]


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        yield opened


@pytest.fixture
def runs(store):
    return runs_of(store, store.steps.announce)


@pytest.fixture
def in_three_steps(monkeypatch):
    monkeypatch.setattr("jointstiff.service.kinds.identification.ByJoints.steps", lambda _work: SPANS)


def steps_left(store):
    return store._database.rows(sa.select(sa.func.count()).select_from(job_steps))[0][0]


class KilledError(BaseException):
    """The worker is no more."""


def work_until_killed(store, runs, commits):
    """Carry out steps until the worker dies at a commit, which is lost; return whether it did."""
    left = [commits]

    def count(_connection):
        left[0] -= 1
        if left[0] == 0:
            raise KilledError

    sa.event.listen(store._database._writer, "commit", count)
    try:
        while carry_out_next(store, lambda _: runs, "dead"):
            pass
    except KilledError:
        return True
    finally:
        sa.event.remove(store._database._writer, "commit", count)
    return False


@pytest.mark.usefixtures("in_three_steps")
def test_a_worker_that_dies_before_any_of_its_commits_loses_nothing(store, runs):
    """Whatever it was about to write: what another one goes on with are the same numbers."""
    stored = stored_set(store)
    expected = runs_of(store).current(runs_of(store).create(request(stored), None).id).result
    deaths = 0
    while True:
        run = runs.create(request(stored), None)
        is_dead = work_until_killed(store, runs, deaths + 1)
        assert runs.current(run.id).progress.done in {0, 100, 200, 300}
        Recovery(store, lambda _: runs, "alive").look()
        while carry_out_next(store, lambda _: runs, "alive"):
            pass
        ended = runs.current(run.id)
        assert (ended.state, ended.progress.done, ended.result) == ("succeeded", 300, expected), deaths
        assert steps_left(store) == 0
        if not is_dead:
            break
        deaths += 1
    assert deaths == 11, "three of the first step, two of each other, two of the last"


def cancelling(store, run_id, done):
    """Start to cancel a run, and wait a while for it, as it may have to wait for others."""
    thread = threading.Thread(target=lambda: (runs_of(store).cancel(run_id), done.set()))
    thread.start()
    thread.join(0.5)
    return thread


@pytest.mark.parametrize("step", ["first", "other"])
def test_a_run_cancelled_while_its_steps_are_added_leaves_none(store, runs, step):
    """PostgreSQL would not see rows that another transaction adds meanwhile, and they would stay for ever."""
    run = runs.create(request(stored_set(store)), None)
    if step == "other":
        store.steps.share_out(run.id, [(0, 300)])
    cancelled, threads = threading.Event(), []

    def cancel(_connection, _cursor, statement, *_rest):
        if statement.startswith("INSERT INTO job_steps"):
            threads.append(cancelling(store, run.id, cancelled))

    sa.event.listen(store._database._writer, "before_cursor_execute", cancel)
    if step == "first":
        store.steps.share_out(run.id, SPANS)
    else:
        store.steps.keep(run.id, 0, b"computed")
    threads[0].join(20)
    assert cancelled.is_set()
    assert runs.current(run.id).state == "cancelled"
    assert steps_left(store) == 0


def test_the_last_step_follows_when_workers_keep_the_last_ones_at_the_same_time(store, runs):
    run = runs.create(request(stored_set(store)), None)
    spans = [(i, i + 1) for i in range(40)]
    store.steps.share_out(run.id, spans)
    gate = threading.Barrier(4)

    def keep(number):
        gate.wait(20)
        for start in range(number, 40, 4):
            store.steps.keep(run.id, start, b"computed")

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(keep, range(4)))
    last = store.steps.take("worker")
    assert (last.start, last.is_last) == (40, True)
    assert len(store.steps.results(run.id)) == 40
    assert steps_left(store) == 41


@pytest.mark.usefixtures("in_three_steps")
def test_four_workers_end_all_runs_once_while_some_are_cancelled(store, runs):
    stored = stored_set(store)
    ids = [runs.create(request(stored), None).id for _ in range(8)]
    cancelled, ended, end = ids[::3], [], runs.records.end

    def count_ends(job_id, *rest):
        if end(job_id, *rest):
            ended.append(job_id)

    def work(name):
        while any(map(runs.records.goes_on, ids)):
            carry_out_next(store, lambda _: runs, name)

    runs.records.end = count_ends
    with ThreadPoolExecutor(5) as pool:
        working = pool.map(work, ["w1", "w2", "w3", "w4"])
        list(pool.map(runs.cancel, cancelled))
        list(working)
    assert sorted(ended) == sorted(ids)
    states = runs.records.statuses(ids)
    assert {states[job_id].state for job_id in ids if job_id not in cancelled} == {"succeeded"}
    assert {states[job_id].state for job_id in cancelled} <= {"cancelled", "succeeded"}
    assert steps_left(store) == 0


def test_the_next_step_is_found_by_an_index_however_many_wait(store, runs):
    """Reading them all took up to a minute and a half on PostgreSQL, with 1,000 jobs of 400 steps each."""
    run = runs.create(request(stored_set(store)), None)
    rows = [
        {
            "job_id": f"{number // 100:032d}",
            "start": number % 100,
            "units": 1,
            "turn": 2,
            "sequence": number // 100,
        }
        for number in range(20_000)
    ]
    with store._database.writing() as connection:
        connection.execute(sa.insert(job_steps), rows)
        connection.exec_driver_sql("ANALYZE")  # as the server does by itself within a minute
    explain = "EXPLAIN QUERY PLAN " if store._database.dialect == "sqlite" else "EXPLAIN "
    with store._database.reading() as connection:
        query = store.steps._next.params(executor="worker").compile(
            connection.engine, compile_kwargs={"literal_binds": True}
        )
        plan = "\n".join(map(str, connection.exec_driver_sql(explain + str(query).replace("%", "%%")).all()))
    assert "ix_job_steps_turn" in plan
    assert "TEMP B-TREE" not in plan
    assert "Sort" not in plan
    assert store.steps.take("worker").job_id == run.id
