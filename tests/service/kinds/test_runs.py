"""Long runs without workers: the service's side of them, and what a worker does with them."""

import pytest
from support.jobs import request, runs_of, stored_set

from jointstiff.service import jobs as module
from jointstiff.service.kinds.work import pack
from jointstiff.service.problems import TooManyJobsError
from jointstiff.service.store.store import Store
from jointstiff.solver.errors import RequestError, UnsupportedMethodError


@pytest.fixture
def store(either_database_url):
    with Store.open(either_database_url) as opened:
        yield opened


@pytest.fixture
def enqueued():
    return []


@pytest.fixture
def runs(store, enqueued):
    """Runs whose long ones are left to workers, and listed."""

    def enqueue(connection, run_id):
        enqueued.append(run_id)
        store.steps.announce(connection, run_id)

    return runs_of(store, enqueue)


def test_steps_in_any_order_make_the_run_that_one_process_makes(store, runs, enqueued):
    set_id = stored_set(store)
    run = runs.create(request(set_id), None)
    work = runs.work(run.id)
    spans = [(0, 1), (1, 170), (170, 300)]
    computed = {span: pack(work.compute(span)) for span in reversed(spans)}
    runs.start(run.id)
    for _ in range(2):  # as two workers may
        store.steps.share_out(run.id, spans)
    for start, stop in [*reversed(spans), spans[1]]:  # one of them twice, as workers may
        store.steps.keep(run.id, start, computed[start, stop])
    assert runs.current(run.id).state == "running"
    assert runs.current(run.id).progress.done == 300
    runs.conclude(run.id, store.steps.results(run.id))
    at_once = runs_of(store).create(request(set_id), None)
    assert runs.current(run.id).result == runs.current(at_once.id).result
    assert runs.current(run.id).result.resampling.repetitions == 300
    assert runs.current(run.id).provenance.ended_at is not None


def test_a_run_ends_once(store, runs):
    run = runs.create(request(stored_set(store)), None)
    store.steps.share_out(run.id, [(0, 120), (120, 300)])
    store.steps.keep(run.id, 0, b"")
    cancelled = runs.cancel(run.id)
    assert (cancelled.state, cancelled.progress.done) == ("cancelled", 120)
    work = runs.work(run.id)
    runs.conclude(run.id, [pack(work.compute((0, 300)))])
    runs.fail(run.id, RuntimeError("late"))
    assert runs.current(run.id) == cancelled
    assert runs.cancel(run.id) == cancelled


def test_refused_before_anything_is_stored(store, runs, enqueued):
    set_id = stored_set(store, targets={"P10": (0.1, 0.1, 0.0)})
    with pytest.raises(UnsupportedMethodError, match="needs 3 targets"):
        runs.create(request(set_id, method="complete_pose"), None)
    with pytest.raises(RequestError, match="a draw of 13 configurations exceeds the set's 12") as refused:
        runs.create(request(set_id, resampling={"size": 13}), None)
    assert refused.value.where == "resampling.size"
    for option in (
        {"loss": "huber"},
        {"priors": {"joint_2": {"stiffness": 1e6, "standard_uncertainty": 1e5}}},
        {"stiffness_order": [["joint_2", "joint_5"]]},
    ):
        with pytest.raises(UnsupportedMethodError, match="resampling") as refused:
            runs.create(request(set_id, **option), None)
        assert refused.value.where == "resampling"
    assert enqueued == []


def test_as_many_as_may_wait_and_no_more(store, runs, enqueued, monkeypatch):
    monkeypatch.setattr(module, "MAX_OPEN", 2)
    set_id = stored_set(store)
    first, _ = (runs.create(request(set_id), None) for _ in range(2))
    with pytest.raises(TooManyJobsError, match="are queued or running"):
        runs.create(request(set_id), None)
    runs.cancel(first.id)
    runs.create(request(set_id), None)
    assert len(enqueued) == 3


def test_progress_does_not_go_back_when_a_run_ends_while_it_is_read(store, runs, monkeypatch):
    """Its steps are gone then: the answer is that of the run as it ended, not one without progress."""
    run = runs.create(request(stored_set(store)), None)
    store.steps.share_out(run.id, [(0, 120), (120, 300)])
    store.steps.keep(run.id, 0, b"")
    before = runs.records.status

    def end_first(job_id):
        monkeypatch.setattr(runs.records, "status", before)
        runs.cancel(job_id)
        return before(job_id)

    monkeypatch.setattr(runs.records, "status", end_first)
    read = runs.current(run.id)
    assert (read.state, read.progress.done) == ("cancelled", 120)
