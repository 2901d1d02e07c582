"""Every job ends: what the recovery of a worker does about work that nobody does."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import closing
from datetime import UTC, datetime, timedelta

import pytest
from support.jobs import QueueEngine, request, runs_of, stored_set

from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.store.database import Database
from jointstiff.service.store.jobs import Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import _patient, _until_ended
from jointstiff.service.workers.worker import Recovery

SILENCE = timedelta(seconds=30)


@pytest.fixture
def store(either_database_url):
    with Store.open(either_database_url) as opened:
        yield opened


@pytest.fixture
def runs(store):
    return runs_of(store, lambda _connection, _kind, _run_id: None)


@pytest.fixture
def engine():
    return QueueEngine()


def recovery_of(store, runs, engine, executor="alive"):
    return Recovery(store, {"run": runs}, engine, executor)


def test_what_a_dead_worker_left_is_shared_out(store, runs, engine):
    recovery = recovery_of(store, runs, engine)
    engine.taken = {"job-1": ("job", "dead"), "part-1": ("part", "dead"), "part-2": ("part", "alive")}
    engine.active = ["part-2"]
    recovery.look()
    assert sorted(engine.resumed) == [("job-1", "job"), ("part-1", "part")]


def test_it_does_not_matter_who_noticed_first_and_died(store, runs, engine):
    """Nothing is forgotten on the way: whoever looks next finds the same."""
    engine.taken = {"job-1": ("job", "dead")}
    store.heartbeats.forget("dead")
    recovery_of(store, runs, engine, "another").look()
    assert engine.resumed == [("job-1", "job")]


def test_the_living_are_left_alone(store, runs, engine):
    first, second = (recovery_of(store, runs, engine, name) for name in ("a", "b"))
    first.look()
    engine.taken = {"job-1": ("job", "b")}
    engine.active = ["job-1"]
    second.look()
    first.look()
    assert engine.resumed == []


def test_work_that_a_living_worker_has_lost_is_taken_up_at_the_second_look(store, runs, engine):
    recovery = recovery_of(store, runs, engine)
    engine.taken = {"part-1": ("part", "alive")}
    recovery.look()
    assert engine.resumed == []  # it may be about to begin
    recovery.look()
    assert engine.resumed == [("part-1", "part")]


@pytest.mark.parametrize("status", ["ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED", "SUCCESS", None])
def test_a_run_that_the_engine_gave_up_or_does_not_know_fails(store, runs, engine, status):
    run = runs.create(request(stored_set(store)), None)
    engine.ended = {run.id: status} if status else {}
    recovery = recovery_of(store, runs, engine)
    recovery.look()
    assert runs.current(run.id).state == "queued"
    recovery.look()
    ended = runs.current(run.id)
    assert (ended.state, ended.error.type) == ("failed", "urn:jointstiff:problem:worker-lost")
    assert "send it again" in ended.error.remedy


def test_a_run_that_too_many_workers_died_over_fails_and_those_that_they_waited_for_do_not(
    store, runs, engine, monkeypatch
):
    monkeypatch.setattr("jointstiff.service.workers.worker.ATTEMPTS", 3)
    poison, waiting, heavy = (runs.create(request(stored_set(store)), None) for _ in range(3))
    runs.records.report(heavy.id, 0, runs.current(heavy.id).progress.total)
    runs.records.report(waiting.id, 0, 120)
    engine.shared_out = {poison.id, waiting.id, heavy.id}
    recovery = recovery_of(store, runs, engine)
    for number in range(3):
        assert {runs.current(run.id).state for run in (poison, waiting, heavy)} == {"queued"}
        dead = f"dead-{number}"
        engine.taken = {run.id: ("job", dead) for run in (poison, waiting, heavy)}
        engine.taken[f"{poison.id}-1"] = ("part", dead)
        engine.ended = {run.id: "PENDING" for run in (poison, waiting, heavy)}
        recovery.look()
    assert [runs.current(run.id).state for run in (poison, waiting, heavy)] == ["failed", "queued", "failed"]


def test_a_run_that_workers_die_over_before_it_is_shared_out_fails(store, runs, engine, monkeypatch):
    monkeypatch.setattr("jointstiff.service.workers.worker.ATTEMPTS", 3)
    poison = runs.create(request(stored_set(store)), None)
    engine.ended = {poison.id: "PENDING"}
    engine.inherited = {poison.id: ("job", "alive")}
    for state in ("queued", "queued", "failed"):
        recovery_of(store, runs, engine).count_own_deaths()
        assert runs.current(poison.id).state == state


def test_a_worker_that_starts_again_counts_the_death_of_the_one_before(store, runs, engine, monkeypatch):
    """The only worker takes its own name again: nobody else would count."""
    monkeypatch.setattr("jointstiff.service.workers.worker.ATTEMPTS", 3)
    poison = runs.create(request(stored_set(store)), None)
    engine.ended = {poison.id: "PENDING"}
    engine.inherited = {poison.id: ("job", "alive"), f"{poison.id}-1": ("part", "alive")}
    for _ in range(2):
        recovery = recovery_of(store, runs, engine)
        for _look in range(3):  # it is counted once
            recovery.look()
        assert runs.current(poison.id).state == "queued"
    runs.records.report(poison.id, 0, 120)
    for state in ("queued", "queued", "failed"):
        recovery_of(store, runs, engine).look()
        assert runs.current(poison.id).state == state


def test_a_duty_that_fails_does_not_keep_the_janitor_from_the_others(store, runs, engine, monkeypatch):
    def refuse(_workflows):
        raise KeyError("odd")

    monkeypatch.setattr(engine, "resume", refuse)
    run = runs.create(request(stored_set(store)), None)
    engine.ended = {run.id: "ERROR"}
    engine.taken = {"part-1": ("part", "dead")}
    recovery = recovery_of(store, runs, engine)
    for _ in range(2):
        with pytest.raises(KeyError, match="odd"):
            recovery.look()
    assert runs.current(run.id).state == "failed"


@pytest.mark.parametrize("status", ["ENQUEUED", "PENDING"])
def test_a_run_that_goes_on_goes_on(store, runs, engine, status):
    run = runs.create(request(stored_set(store)), None)
    engine.ended = {run.id: status}
    recovery = recovery_of(store, runs, engine)
    for _ in range(3):
        recovery.look()
    assert runs.current(run.id).state == "queued"


def test_the_steps_of_ended_runs_are_removed_and_their_results_stay(store, runs, engine):
    ended, goes_on = (runs.create(request(stored_set(store)), None) for _ in range(2))
    for run in (ended, goes_on):
        runs.records.report(run.id, 0, 120)
        engine.ended[run.id] = "PENDING"
    runs.cancel(ended.id)
    before = runs.document(ended.id)
    engine.forgotten = [ended.id]
    recovery_of(store, runs, engine).look()
    assert [runs.records.status(each.id).done for each in (ended, goes_on)] == [0, 120]
    assert runs.document(ended.id) == before


def test_a_worker_that_ends_hands_its_work_over(store, runs, engine):
    recovery = recovery_of(store, runs, engine)
    recovery.look()
    engine.taken = {"part-1": ("part", "alive"), "part-2": ("part", "other")}
    recovery.hand_over()
    assert engine.resumed == [("part-1", "part")]


@pytest.fixture
def beats_at(database_url):
    """Call it for the heartbeats of a store as they are at a time."""
    Store.open(database_url).close()
    with closing(Database.open(database_url)) as database:
        yield lambda time: Heartbeats(database, lambda _: time)


NOW = datetime(2026, 11, 20, tzinfo=UTC)


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


def test_of_a_part_no_step_is_carried_out_after_one_that_finds_the_job_ended():
    asked = []

    def compute(span):
        asked.append(span)
        return "" if span[0] == 2 else "computed"

    spans = [(i, i + 1) for i in range(1000)]
    assert _until_ended(compute, spans) == ["computed", "computed", ""]
    assert asked == spans[:3]
    assert _until_ended(compute, spans[3:]) == ["computed"] * 997


def test_a_step_waits_for_the_database(monkeypatch):
    """An outage is no result of a step."""
    monkeypatch.setattr("jointstiff.service.workers.engine.time.sleep", lambda _: None)
    failures = iter([StoreUnavailableError("away", "wait")] * 50)

    @_patient
    def step(value):
        for failure in failures:
            raise failure
        return value

    assert step(3) == 3


def test_a_process_without_memory_ends_and_its_step_has_no_result(monkeypatch):
    monkeypatch.setattr("os.kill", lambda pid, sign: sys.exit(f"{pid} {sign}"))

    @_patient
    def step():
        raise MemoryError

    with pytest.raises(SystemExit, match=f"^{os.getpid()} {signal.SIGKILL}$"):
        step()
