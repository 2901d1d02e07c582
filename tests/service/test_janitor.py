"""Every run ends: what the janitor of a worker does about work that nobody does."""

from __future__ import annotations

import pytest
from test_runs import request, stored_set

from service.api.parts import Parts
from service.engine import _patient
from service.janitor import Janitor
from service.runs import Runs
from service.store import Store
from service.store_errors import StoreUnavailableError


class LedgerEngine:
    """An engine that is a ledger: what is pending, with whom, and what became of runs."""

    def __init__(self):
        self.active = set()
        self.taken = {}
        self.ended = {}
        self.resumed = []

    def pending(self):
        return dict(self.taken)

    def resume(self, workflows):
        for name, kind in workflows:
            self.resumed.append((name, kind))
            self.taken.pop(name)

    def outcomes(self, run_ids):
        return {name: status for name, status in self.ended.items() if name in run_ids}


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        yield opened


@pytest.fixture
def runs(store):
    return Runs(store, Parts.of(store).sets, lambda _connection, _run_id: None)


@pytest.fixture
def engine():
    return LedgerEngine()


def test_what_a_dead_worker_left_is_shared_out(store, runs, engine):
    janitor = Janitor(store, runs, engine, "alive")
    engine.taken = {"run-1": ("run", "dead"), "part-1": ("part", "dead"), "part-2": ("part", "alive")}
    engine.active = {"part-2"}
    janitor.look()
    assert sorted(engine.resumed) == [("part-1", "part"), ("run-1", "run")]


def test_it_does_not_matter_who_noticed_first_and_died(store, runs, engine):
    """Nothing is forgotten on the way: whoever looks next finds the same."""
    engine.taken = {"run-1": ("run", "dead")}
    store.run_log.forget("dead")
    Janitor(store, runs, engine, "another").look()
    assert engine.resumed == [("run-1", "run")]


def test_the_living_are_left_alone(store, runs, engine):
    first, second = (Janitor(store, runs, engine, name) for name in ("a", "b"))
    first.look()
    engine.taken = {"run-1": ("run", "b")}
    engine.active = {"run-1"}
    second.look()
    first.look()
    assert engine.resumed == []


def test_work_that_a_living_worker_has_lost_is_taken_up_at_the_second_look(store, runs, engine):
    janitor = Janitor(store, runs, engine, "alive")
    engine.taken = {"part-1": ("part", "alive")}
    janitor.look()
    assert engine.resumed == []  # it may be about to begin
    janitor.look()
    assert engine.resumed == [("part-1", "part")]


@pytest.mark.parametrize("status", ["ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED", "SUCCESS", None])
def test_a_run_that_the_engine_gave_up_fails(store, runs, engine, status):
    run = runs.create(request(stored_set(store)), None)
    if status is not None:
        engine.ended = {run.id: status}
    janitor = Janitor(store, runs, engine, "alive")
    janitor.look()
    assert runs.current(run.id).state == "queued"
    janitor.look()
    assert runs.current(run.id).state == "failed"


@pytest.mark.parametrize("status", ["ENQUEUED", "PENDING"])
def test_a_run_that_goes_on_goes_on(store, runs, engine, status):
    run = runs.create(request(stored_set(store)), None)
    engine.ended = {run.id: status}
    janitor = Janitor(store, runs, engine, "alive")
    for _ in range(3):
        janitor.look()
    assert runs.current(run.id).state == "queued"


def test_a_worker_that_ends_hands_its_work_over(store, runs, engine):
    janitor = Janitor(store, runs, engine, "alive")
    janitor.look()
    engine.taken = {"part-1": ("part", "alive"), "part-2": ("part", "other")}
    janitor.hand_over()
    assert engine.resumed == [("part-1", "part")]


def test_a_step_waits_for_the_database(monkeypatch):
    """An outage is no result of a step."""
    monkeypatch.setattr("service.engine.time.sleep", lambda _: None)
    failures = iter([StoreUnavailableError("away", "wait")] * 50)

    @_patient
    def step(value):
        for failure in failures:
            raise failure
        return value

    assert step(3) == 3
