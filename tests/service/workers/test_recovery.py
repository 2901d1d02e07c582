"""Workers that die, are started again or hang."""

import functools
import io
import os
import pickle
import re
import resource
import signal
import subprocess
import sys
import threading
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sqlalchemy as sa
from support.jobs import run_request, runs_of, stored_set
from support.processes import Service, ready, until, working

from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.identification import ByJoints
from jointstiff.service.library.client import Client
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.store.database import Database
from jointstiff.service.store.jobs import Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import job_steps, jobs
from jointstiff.service.workers import supervisor as supervisor_module
from jointstiff.service.workers.supervisor import Supervisor, pause_after
from jointstiff.service.workers.worker import Recovery, _patiently, carry_out_next
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import SolverError

SILENCE = timedelta(seconds=30)
NOW = datetime(2026, 11, 20, tzinfo=UTC)


@pytest.fixture
def store(either_database_url):
    with Store.open(either_database_url) as opened:
        yield opened


SPANS = [(0, 100), (100, 200), (200, 300)]


@pytest.fixture
def shared(store, runs):
    """Call it for a run that was posted and cut into steps of 100 draws."""

    def make():
        run = runs.create(run_request(stored_set(store)), None)
        runs.start(run.id)
        store.steps.share_out(run.id, SPANS)
        return run

    return make


def recovery_of(store, runs, executor="alive"):
    return Recovery(store, lambda _: runs, executor)


def all_done(store, runs, executor):
    """Carry out all steps that are left, as a worker does."""
    while carry_out_next(store, lambda _: runs, executor):
        pass


def test_a_run_is_cut_carried_out_and_put_together(store, runs):
    run = runs.create(run_request(stored_set(store)), None)
    assert runs.current(run.id).state == "queued"
    all_done(store, runs, "worker")
    ended = runs.current(run.id)
    assert (ended.state, ended.progress.done) == ("succeeded", 300)
    at_once = runs_of(store).create(run_request(run.measurement_set_id), None)
    assert ended.result == runs_of(store).current(at_once.id).result


def test_each_step_is_taken_by_one_worker_and_the_last_one_when_all_others_are_done(store, shared):
    run = shared()
    taken = [store.steps.take(name) for name in ("a", "b", "c")]
    assert [(step.start, step.units) for step in taken] == [(0, 100), (100, 100), (200, 100)]
    assert store.steps.take("d") is None
    assert store.steps.take("b") == taken[1], "what it has begun and not done comes again"
    for step in taken:
        assert store.steps.take("d") is None
        store.steps.keep(run.id, step.start, b"computed")
    last = store.steps.take("d")
    assert (last.start, last.is_last) == (300, True)
    assert store.steps.take("a") is None


def test_a_run_is_cut_when_its_turn_comes(store, runs):
    """Of a thousand runs that wait, the first ones end before the last one is looked at."""
    first, second = (runs.create(run_request(stored_set(store)), None) for _ in range(2))
    while runs.current(first.id).state != "succeeded":
        assert runs.current(second.id).state == "queued"
        assert carry_out_next(store, lambda _: runs, "worker")


def test_small_runs_do_not_wait_for_the_rest_of_large_ones(store, runs):
    large, small = (runs.create(run_request(stored_set(store)), None) for _ in range(2))
    store.steps.share_out(large.id, [(i, i + 1) for i in range(300)])
    store.steps.share_out(small.id, [(0, 300)])
    names = (f"worker {i}" for i in range(300))
    ids = [store.steps.take(next(names)).job_id for _ in range(6)]
    assert ids == [large.id] * 2 + [small.id] + [large.id] * 3


def test_a_step_that_two_workers_carried_out_is_kept_once(store, runs, shared):
    run = shared()
    for result in (b"first", b"second"):
        store.steps.keep(run.id, 0, result)
    store.steps.share_out(run.id, [(0, 300)])
    assert store.steps.results(run.id)[:1] == [b"first"]
    assert runs.records.status(run.id).done == 100


def test_the_steps_of_ended_runs_are_removed_and_their_results_stay(store, runs, shared):
    ended, goes_on = shared(), shared()
    for run in (ended, goes_on):
        store.steps.keep(run.id, 0, b"computed")
    step = store.steps.take("worker")
    assert step.job_id == ended.id
    cancelled = runs.cancel(ended.id)
    assert cancelled.progress.done == 100
    store.steps.keep(ended.id, step.start, b"late")
    store.steps.share_out(ended.id, SPANS)
    assert store.steps.results(ended.id) == []
    assert [runs.records.status(each.id).done for each in (ended, goes_on)] == [0, 100]
    assert store.steps.take("worker").job_id == goes_on.id
    assert runs.current(ended.id) == cancelled


def test_a_run_that_is_cancelled_before_its_last_step_is_not_put_together(store, runs, shared, monkeypatch):
    """Its results are gone: of some kinds the last step would compute them all again."""
    concluded = []
    monkeypatch.setattr(ByJoints, "conclude", lambda _work, parts: concluded.append(parts))
    run = shared()
    for start, _ in SPANS:
        store.steps.keep(run.id, start, b"computed")
    last = store.steps.take("worker")
    cancelled = runs.cancel(run.id)
    runs.carry_out(last)
    assert runs.current(run.id) == cancelled
    assert concluded == []


def test_what_a_dead_worker_left_is_taken_by_others(store, runs, shared):
    shared()
    lost = store.steps.take("dead")
    mine = store.steps.take("alive")
    recovery_of(store, runs).look()
    assert store.steps.take("another") == lost
    assert store.steps.take("alive") == mine, "the living are left alone"


def test_it_does_not_matter_who_noticed_first_and_died(store, runs, shared):
    """Nothing is forgotten on the way: whoever looks next finds the same."""
    shared()
    lost = store.steps.take("dead")
    store.heartbeats.forget("dead")
    recovery_of(store, runs, "another").look()
    assert store.steps.take("alive") == lost


def test_a_worker_that_ends_hands_its_work_over(store, runs, shared):
    shared()
    recovery = recovery_of(store, runs)
    recovery.look()
    left, others = store.steps.take("alive"), store.steps.take("other")
    recovery.hand_over()
    assert store.steps.take("another") == left
    assert store.steps.take("other") == others
    assert store.heartbeats.living(SILENCE) == []


def test_a_run_without_a_step_that_would_end_it_fails(store, runs):
    run = runs_of(store, lambda _connection, _run_id: None).create(run_request(stored_set(store)), None)
    waiting = runs.create(run_request(stored_set(store)), None)
    recovery_of(store, runs).look()
    ended = runs.current(run.id)
    assert (ended.state, ended.error.type) == ("failed", "urn:jointstiff:problem:worker-lost")
    assert "send it again" in ended.error.remedy
    assert runs.current(waiting.id).state == "queued"


@pytest.mark.parametrize("step", ["first", "other", "last"])
def test_a_run_that_too_many_workers_die_over_fails_and_others_do_not(store, runs, monkeypatch, step):
    monkeypatch.setattr("jointstiff.service.workers.worker.ATTEMPTS", 3)
    poison = runs.create(run_request(stored_set(store)), None)
    if step != "first":
        store.steps.share_out(poison.id, [(0, 300)])
    if step == "last":
        store.steps.keep(poison.id, 0, b"computed")
    recovery = recovery_of(store, runs)
    store.steps.take("dead-1")
    waiting = runs.create(run_request(stored_set(store)), None)
    assert store.steps.take("alive").job_id == waiting.id
    recovery.look()
    for name in ("dead-2", "dead-3"):
        assert {runs.current(run.id).state for run in (poison, waiting)} == {"queued"}
        assert store.steps.take(name).job_id == poison.id
        recovery.look()
    assert [runs.current(run.id).state for run in (poison, waiting)] == ["failed", "queued"]


def test_a_worker_that_starts_again_counts_the_death_of_the_one_before(store, runs, monkeypatch):
    """The only worker takes its own name again: nobody else would count."""
    monkeypatch.setattr("jointstiff.service.workers.worker.ATTEMPTS", 3)
    poison = runs.create(run_request(stored_set(store)), None)
    for state in ("queued", "queued", "failed"):
        store.steps.take("alive")
        recovery = recovery_of(store, runs)
        recovery.count_own_death()
        for _ in range(3):  # it is counted once
            recovery.look()
            recovery.count_own_death()
        assert runs.current(poison.id).state == state


def test_an_outage_is_no_death_of_workers_that_come_back(store, shared):
    """After one longer than the silence of the dead, all workers but the first to be heard are silent."""
    shared()
    time = [NOW]
    beats = Heartbeats(store._database, lambda _: time[-1])
    recovery = Recovery(store, lambda _: None, "alive", heartbeats=beats)
    others = [store.steps.take(name) for name in ("alive", "other")][-1]
    deaths = sa.select(job_steps.c.deaths).order_by(job_steps.c.start)

    def deaths_after(silence, *duties):
        time.append(time[-1] + silence)
        for duty in duties:
            duty()
        return [row.deaths for row in store._database.rows(deaths)]

    beat = functools.partial(beats.beat, "other")
    assert deaths_after(0 * SILENCE, beat, recovery.look) == [0, 0, 0]
    assert deaths_after(2 * SILENCE, recovery.look, beat, recovery.look) == [0, 0, 0]
    assert store.steps.take("other") == others
    assert deaths_after(2 * SILENCE, recovery.look) == [0, 0, 0]
    assert deaths_after(SILENCE / 6, recovery.look) == [0, 1, 0], "the other one has not come back"
    assert deaths_after(2 * SILENCE, recovery.count_own_death) == [1, 1, 0], "it started again by itself"


def test_jobs_of_a_kind_of_another_version_are_left_alone(store, runs, monkeypatch):
    monkeypatch.setattr("jointstiff.service.workers.worker.ATTEMPTS", 1)
    unknown, lost, known = (runs.create(run_request(stored_set(store)), None) for _ in range(3))
    other = sa.update(jobs).where(jobs.c.id.in_([unknown.id, lost.id])).values(kind="oracle")
    store._database.change(other, sa.delete(job_steps).where(job_steps.c.job_id == lost.id))
    parts = Parts(store, store.steps.announce)
    assert store.steps.take("dead").job_id == unknown.id
    Recovery(store, parts.jobs_of, "alive").look()
    while carry_out_next(store, parts.jobs_of, "alive"):
        pass
    assert [runs.records.status(known.id).state, store.kind_of_job(unknown.id)] == ["succeeded", "oracle"]
    states = sa.select(jobs.c.state).where(jobs.c.kind == "oracle")
    assert [row.state for row in store._database.rows(states)] == ["queued", "queued"]


def test_a_duty_that_fails_does_not_keep_the_janitor_from_the_others(store, runs, monkeypatch):
    def refuse(_living):
        raise KeyError("odd")

    monkeypatch.setattr(store.steps, "count_deaths", refuse)
    run = runs_of(store, lambda _connection, _run_id: None).create(run_request(stored_set(store)), None)
    with pytest.raises(KeyError, match="odd"):
        recovery_of(store, runs).look()
    assert runs.current(run.id).state == "failed"


def test_a_step_that_fails_ends_its_run_with_the_reason(store, runs, monkeypatch):
    run = runs.create(run_request(stored_set(store)), None)

    def refuse(_self, _span):
        raise SolverError("no optimum", remedy="measure again")

    monkeypatch.setattr(ByJoints, "compute", refuse)
    all_done(store, runs, "worker")
    ended = runs.current(run.id)
    assert (ended.state, ended.error.detail, ended.error.remedy) == ("failed", "no optimum", "measure again")


class Planted:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def in_an_archive(planted):
    buffer = io.BytesIO()
    np.savez(buffer, x=np.array([planted], dtype=object))
    return buffer.getvalue()


@pytest.mark.parametrize("written", [pickle.dumps, in_an_archive])
def test_a_pickle_planted_in_a_step_is_not_run_and_its_run_ends(store, runs, shared, tmp_path, written):
    """Who can write the database, or hands over a backup, runs no code in the workers."""
    run, other = shared(), runs.create(run_request(stored_set(store)), None)
    for start, _ in SPANS:
        store.steps.keep(run.id, start, written(Planted(tmp_path / "ran")))
    all_done(store, runs, "worker")
    assert [runs.current(each.id).state for each in (run, other)] == ["failed", "succeeded"]
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("step", ["first", "other"])
def test_a_run_whose_document_is_damaged_fails_and_others_go_on(store, runs, step):
    """No worker may die over it again and again, nor over the news that it failed."""
    damaged, other = (runs.create(run_request(stored_set(store)), None) for _ in range(2))
    if step == "other":
        assert carry_out_next(store, lambda _: runs, "worker")
    broken = sa.update(jobs).where(jobs.c.id == damaged.id).values(document="{")
    store._database.change(broken)
    runs.work.cache_clear()  # as of a worker that starts
    all_done(store, runs, "worker")
    assert runs.records.status(damaged.id).state == "failed"
    assert runs.records.get(damaged.id).summary["state"] == "failed"
    assert runs.current(other.id).state == "succeeded"


@pytest.fixture
def beats_at(database_url):
    """Call it for the heartbeats of a store as they are at a time."""
    Store.open(database_url).close()
    with closing(Database.open(database_url)) as database:
        yield lambda time: Heartbeats(database, lambda _: time)


def test_a_clock_that_was_set_back_does_not_keep_the_dead_alive(beats_at):
    beats_at(NOW + timedelta(hours=1)).beat("dead")
    assert beats_at(NOW).beat("alive") == ["alive"]


def test_the_living_are_counted_by_their_beats(beats_at):
    for executor in ("a", "b"):
        beats_at(NOW).beat(executor)
    assert beats_at(NOW).living(SILENCE) == ["a", "b"]
    assert beats_at(NOW + 2 * SILENCE).living(SILENCE) == []
    beats_at(NOW).prove()
    assert beats_at(NOW).living(SILENCE) == ["a", "b"], "a proof is no worker"


def test_a_step_waits_for_the_database(monkeypatch):
    """An outage is no result of a step."""
    monkeypatch.setattr("jointstiff.service.workers.worker.time.sleep", lambda _: None)
    failures = iter([StoreUnavailableError("away", "wait")] * 50)

    def step():
        for failure in failures:
            raise failure
        return True

    assert _patiently(step)


@pytest.mark.parametrize("step", ["compute", "conclude"])
def test_a_process_without_memory_ends_and_its_step_has_no_result(store, runs, monkeypatch, step):
    monkeypatch.setattr("os.kill", lambda pid, sign: sys.exit(f"{pid} {sign}"))
    run = runs.create(run_request(stored_set(store)), None)

    def exhaust(_self, _span):
        raise MemoryError

    monkeypatch.setattr(ByJoints, step, exhaust)
    with pytest.raises(SystemExit, match=f"^{os.getpid()} {signal.SIGKILL}$"):
        _patiently(lambda: all_done(store, runs, "worker"))
    assert runs.current(run.id).state == "running"
    assert runs.records.status(run.id).done == (300 if step == "conclude" else 0)


def test_pauses_double_up_to_a_minute():
    assert [pause_after(lives) for lives in (1, 2, 3, 4, 5, 6, 7, 10_000)] == [2, 4, 8, 16, 32, 60, 60, 60]


def test_a_worker_is_started_again_after_pauses_that_double(monkeypatch):
    """Of four lives, in seconds: who lives for a minute is not failing at its end, and begins anew."""
    lives, pauses, failing, now = [1.0, 59.0, 60.0, 5.0], [], [], 0.0
    supervisor = Supervisor("sqlite://", 0, "test")

    def timer(seconds, forget, arguments):
        def start():
            if lives[0] >= seconds:
                forget(*arguments)

        return SimpleNamespace(start=start, cancel=lambda: None)

    def watch(*_):
        nonlocal now
        failing.append((lives[0], supervisor.failing))
        now += lives.pop(0)

    monkeypatch.setattr(supervisor_module, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(supervisor_module, "threading", SimpleNamespace(Timer=timer))
    supervisor._stopping = SimpleNamespace(is_set=lambda: not lives, wait=pauses.append)
    supervisor._watch = watch
    supervisor._keep("sqlite://", "test-1")
    assert pauses == [2, 4, 2]
    assert failing == [(1.0, 0), (59.0, 0), (60.0, 0), (5.0, 0)]


def test_a_worker_is_ended_once_two_looks_in_a_row_find_it_silent():
    """The first look comes after a minute, the others every 15 s."""
    looks, pauses, ended = iter([True, False, True, True]), [], []

    def wait(pause):
        pauses.append(pause)
        if ended:
            return -9
        raise subprocess.TimeoutExpired("test-1", pause)

    process = SimpleNamespace(wait=wait, kill=lambda: ended.append(len(pauses)))
    supervisor = Supervisor("sqlite://", 0, "test", is_silent=lambda _: next(looks))
    assert supervisor._end_of(process, "test-1") == -9
    assert (pauses, ended) == ([60.0, 15.0, 15.0, 15.0, 15.0], [4])


@pytest.mark.process
def test_a_worker_that_cannot_start_is_said_and_is_not_living(tmp_path, monkeypatch):
    """Its database is a folder, which no SQLite opens."""
    monkeypatch.setattr(supervisor_module, "pause_after", lambda _lives: 0.1)
    forgotten: list[str] = []
    with Supervisor(f"sqlite:///{tmp_path}", 1, "test", forgotten.append) as supervisor:
        assert supervisor.failing == 0
        until(lambda: supervisor.failing == 1)
    assert set(forgotten) == {"test-1"}
    assert len(forgotten) >= 2


@pytest.mark.process
def test_a_worker_that_lives_and_shows_no_sign_of_it_is_replaced(tmp_path, caplog):
    """Two looks in a row find it silent, the third would find another process of its name."""
    replaced = threading.Event()
    looks: list[str] = []

    def is_silent(name: str) -> bool:
        looks.append(name)
        return len(looks) != 2  # one look alone is no proof

    with Supervisor(
        f"sqlite:///{tmp_path / 'x.db'}", 1, "test", lambda _: replaced.set(), is_silent, 0.2, 0.1
    ):
        assert replaced.wait(60)
    assert len(looks) >= 4
    assert set(looks) == {"test-1"}
    assert "worker test-1 is silent; ending it" in caplog.text


@pytest.mark.process
def test_a_worker_without_memory_ends(tmp_path):
    """It would show signs of life and carry out nothing."""
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    service = Service(url, "--workers", "0")
    try:
        with working(url, "w1") as worker, Client(service.url) as client:
            ready(worker)
            used = 1024 * int(
                re.search(r"VmSize:\s+(\d+)", Path(f"/proc/{worker.pid}/status").read_text())[1]
            )
            resource.prlimit(worker.pid, resource.RLIMIT_AS, (used, used))
            many = {"size": 10, "repetitions": 5_000, "seed": 1}
            campaign = simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)
            client.post(campaign | {"run": {"resampling": many}})
            assert worker.wait(120) == 70
    finally:
        service.stop()
