"""Workers that die, are started again or hang."""

import functools
import io
import os
import pickle
import re
import resource
import signal
import sys
import threading
import time
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sqlalchemy as sa
from support.claims import Claims
from support.jobs import run_request, runs_of, stored_set
from support.processes import Service, ready, until, workers_of, working

from jointstiff.service.jobs import PARTS_AT_ONCE, STEPS_OF_A_PART, Part, Parts
from jointstiff.service.kinds.run.work import RunWork
from jointstiff.service.library.client import Client
from jointstiff.service.problems import LockedError, StoreError, StoreUnavailableError
from jointstiff.service.store.compression import compress
from jointstiff.service.store.database import Database
from jointstiff.service.store.jobs import Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import jobs
from jointstiff.service.workers import supervisor as supervisor_module
from jointstiff.service.workers import worker as worker_module
from jointstiff.service.workers.engine import ATTEMPTS
from jointstiff.service.workers.supervisor import Supervisor, pause_after
from jointstiff.service.workers.worker import FrozenError, Recovery, Retries, carry_out
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import SolverError

SILENCE = timedelta(seconds=30)
NOW = datetime(2026, 11, 20, tzinfo=UTC)


@pytest.fixture
def store(either_database_url):
    with Store.open(either_database_url) as opened:
        yield opened


@pytest.fixture
def claims(store, either_database_url):
    with closing(Claims(store, either_database_url)) as queue:
        yield queue


@pytest.fixture
def runs(store, claims):
    return runs_of(store, claims.enqueue)


@pytest.fixture(autouse=True)
def spans(monkeypatch):
    """Steps of one draw; a test may change their number."""
    spans = [(i, i + 1) for i in range(3 * STEPS_OF_A_PART)]
    monkeypatch.setattr(RunWork, "steps", lambda _work: spans)
    return spans


@pytest.fixture
def post(store, runs):
    """Call it for a run that was posted, of as many draws as there are steps."""

    def make(repetitions=3 * STEPS_OF_A_PART):
        request = run_request(stored_set(store), resampling={"size": 8, "repetitions": repetitions})
        return runs.create(request, None)

    return make


def recovery_of(store, runs, claims, executor="alive"):
    return Recovery(store, lambda _: runs, claims, executor)


def test_a_run_is_cut_carried_out_and_put_together(store, runs, claims, post):
    run = post()
    assert runs.current(run.id).state == "queued"
    claims.work_all(lambda _: runs)
    ended = runs.current(run.id)
    assert (ended.state, ended.progress.done) == ("succeeded", 3 * STEPS_OF_A_PART)
    at_once = runs_of(store).create(ended.request, None)
    assert ended.result == runs_of(store).current(at_once.id).result


def test_each_part_is_claimed_by_one_worker_and_the_one_that_finds_all_results_ends_the_run(
    runs, claims, post
):
    run = post()
    parts = [claims.claim("a")]
    assert claims.claim("b") is None, "a run begins with its first part"
    runs.mark_running(run.id)
    claims.add_following_parts(run.id, [Part(run.id, number, 0) for number in (1, 2)])
    parts += [claims.claim(name) for name in "bc"]
    assert [part.number for part in parts] == [0, 1, 2]
    assert claims.claim("d") is None
    for part in reversed(parts):
        assert runs.current(run.id).state == "running"
        runs.carry_out(part, claims)
    assert runs.current(run.id).state == "succeeded"


@pytest.fixture
def working_as(monkeypatch):
    """Call it with the version of the program that carries out the parts that follow."""
    monkeypatch.setattr("jointstiff.service.jobs.OTHER_VERSION_SECONDS", 0.0)

    def work_as(version):
        for module in ("jobs", "store.jobs", "workers.engine"):
            monkeypatch.setattr(f"jointstiff.service.{module}.jointstiff_version", lambda: version)

    return work_as


@pytest.mark.parametrize("seed", range(6))
def test_one_version_computes_all_steps_of_a_job_whichever_versions_take_its_parts(
    store, claims, runs, post, working_as, monkeypatch, seed
):
    versions = ["0.9.2", "0.10.0", "0.10.0+local"]
    draw, run, computed_by, conclude = np.random.default_rng(seed), post(), [], runs.conclude

    def note(job_id, results):
        computed_by.append(store.steps.list_versions(job_id))
        conclude(job_id, results)

    monkeypatch.setattr(runs, "conclude", note)
    for _ in range(200):
        working_as(draw.choice(versions))
        if not claims.work(lambda _: runs):
            break
    ended = runs.current(run.id)
    assert (ended.state, ended.progress.done) == ("succeeded", 3 * STEPS_OF_A_PART)
    assert [len(versions) for versions in computed_by] == [1]


@pytest.mark.parametrize(
    ("older", "newer"),
    [
        ("0.9.2", "0.10.0"),
        ("1.2.0rc1", "1.2.0"),
        ("1.2.0rc9", "1.2.0rc10"),
        ("1.2.0b2", "1.2.0rc1"),
        ("1.2.0.dev3", "1.2.0a1"),
        ("1.2.0", "1.2.1rc1"),
        ("1.2.0", "1.2.0.post1"),
        ("1.2.0", "1.2.0+hall3"),
    ],
)
def test_a_newer_version_begins_a_job_again_and_an_older_one_leaves_it(
    store, claims, runs, post, working_as, older, newer
):
    run = post()
    working_as(older)
    assert claims.work(lambda _: runs)
    assert store.steps.list_versions(run.id) == {older}
    working_as(newer)
    assert claims.work(lambda _: runs)
    assert store.steps.list_versions(run.id) == {newer}
    assert runs.current(run.id).progress.activity == f"resampling, begun anew by version {newer}"
    working_as(older)
    assert claims.work(lambda _: runs)
    assert store.steps.list_versions(run.id) == {newer}
    assert not store.steps.store_result(run.id, (0, 1), b"of an older version", older)
    working_as(newer)
    claims.work_all(lambda _: runs)
    assert runs.current(run.id).state == "succeeded"


def test_each_part_leaves_the_one_that_follows(claims, runs, post, spans):
    """So of a job of any size as many wait as may be carried out at once."""
    spans[:] = [(i, i + 1) for i in range(STEPS_OF_A_PART * (PARTS_AT_ONCE + 2))]
    run, waiting = post(len(spans)), []
    while claims.work(lambda _: runs):
        waiting.append(len(claims.waiting()))
    assert waiting[:3] == [PARTS_AT_ONCE] * 2 + [PARTS_AT_ONCE - 1]
    assert len(waiting) == PARTS_AT_ONCE + 2
    assert runs.current(run.id).state == "succeeded"


def test_a_part_that_takes_long_leaves_its_other_steps(claims, runs, post, monkeypatch):
    monkeypatch.setattr("jointstiff.service.jobs.PART_SECONDS", 0.0)
    run, _ = post(), post()
    assert claims.work(lambda _: runs)
    assert runs.records.status(run.id).done == 1, "it makes progress, however slow"
    assert any(name.startswith(f"{run.id}-000000-1-") for name in claims.waiting())
    claims.work_all(lambda _: runs)
    progress = runs.current(run.id).progress
    assert (runs.current(run.id).state, progress.done) == ("succeeded", progress.total)


def test_a_part_goes_on_while_no_other_run_waits(claims, runs, post, monkeypatch):
    """Between two parts a worker does nothing for a moment, which nobody has asked for then."""
    monkeypatch.setattr("jointstiff.service.jobs.PART_SECONDS", 0.0)
    run = post()
    assert claims.work(lambda _: runs)
    assert runs.records.status(run.id).done == STEPS_OF_A_PART


def test_a_run_begins_when_its_turn_comes(runs, claims, post):
    """Of a thousand runs that wait, the first ones end before the last one is looked at."""
    first, second = post(), post()
    claims.work(lambda _: runs)
    assert [runs.current(each.id).state for each in (first, second)] == ["running", "queued"]


def test_small_runs_do_not_wait_for_the_rest_of_large_ones(runs, claims, post):
    large = post()
    claims.work(lambda _: runs)
    small = post()
    assert claims.claim("worker").job_id == small.id
    assert claims.claim("worker").job_id == large.id


def test_large_runs_go_on_however_many_small_ones_come(runs, claims, post, monkeypatch):
    large = post()
    claims.work(lambda _: runs)
    later = time.time() + 15  # seconds, of which newer runs passed for 10
    monkeypatch.setattr("jointstiff.service.workers.engine.time.time", lambda: later)
    small = post()
    assert [claims.claim("worker").job_id for _ in range(3)] == [large.id, large.id, small.id]


def test_the_more_runs_have_begun_the_longer_newer_ones_pass(runs, claims, post, monkeypatch):
    """So small runs do not wait for large ones however many these are."""
    for _ in range(4):
        post()
        claims.work(lambda _: runs)
    later = time.time() + 15
    monkeypatch.setattr("jointstiff.service.workers.engine.time.time", lambda: later)
    small = post()
    ids = [claims.claim("worker").job_id for _ in range(3)]
    assert small.id in ids, "before the parts of the other runs than the first"


def test_a_step_that_two_workers_carried_out_is_kept_once(store, runs, post):
    run = post()
    for result in (b"first", b"second"):
        assert store.steps.store_result(run.id, (0, 1), result)
    assert store.steps.results(run.id) == [b"first"]
    assert runs.records.status(run.id).done == 1


def test_the_results_of_ended_runs_are_removed_and_those_of_others_stay(store, runs, claims, post):
    ended, is_active = post(), post()
    for run in (ended, is_active):
        store.steps.store_result(run.id, (0, 1), b"computed")
    cancelled = runs.cancel(ended.id)
    assert cancelled.progress.done == 1
    assert not store.steps.store_result(ended.id, (1, 2), b"late")
    assert store.steps.results(ended.id) == []
    assert [runs.records.status(each.id).done for each in (ended, is_active)] == [0, 1]
    claims.work_all(lambda _: runs)
    assert runs.current(ended.id) == cancelled


@pytest.mark.parametrize("moment", ["before the part", "before its end", "at its end"])
def test_a_cancelled_run_is_not_put_together(store, runs, claims, post, monkeypatch, moment):
    """Its results are gone: of some kinds the end would compute them all again."""
    concluded = []
    monkeypatch.setattr(RunWork, "conclude", lambda _work, parts: concluded.append(parts))
    run, compute = post(), RunWork.compute

    def cancel_first(work, span):
        runs.cancel(run.id)
        return compute(work, span)

    def cancel_last(steps, job_id):
        runs.cancel(run.id)
        return results(steps, job_id)

    results = type(store.steps).results
    if moment == "before the part":
        runs.cancel(run.id)
    elif moment == "before its end":
        monkeypatch.setattr(RunWork, "compute", cancel_first)
    else:
        monkeypatch.setattr(type(store.steps), "results", cancel_last)
    claims.work_all(lambda _: runs)
    assert runs.current(run.id).state == "cancelled"
    assert concluded == []
    assert store.steps.results(run.id) == []


def test_what_a_dead_worker_left_is_claimed_by_others(store, runs, claims, post):
    post(), post()
    lost, mine = claims.claim("dead"), claims.claim("alive")
    recovery_of(store, runs, claims).check_and_recover()
    assert claims.claim("another") == lost
    assert claims.claimed_parts()[claims.claimed[mine]] == "alive", "the living are left alone"


def test_it_does_not_matter_who_noticed_first_and_died(store, runs, claims, post):
    """Nothing is forgotten on the way: whoever looks next finds the same."""
    post()
    lost = claims.claim("dead")
    store.heartbeats.forget("dead")
    recovery_of(store, runs, claims, "another").check_and_recover()
    assert claims.claim("alive") == lost


def test_a_worker_that_ends_hands_its_work_over_and_nobody_died(store, runs, claims, post):
    post(), post()
    recovery = recovery_of(store, runs, claims)
    left = claims.claim("alive")
    for _ in range(ATTEMPTS + 1):
        recovery.hand_over()
        assert claims.claim("alive") == left
    others = claims.claim("other")
    store.heartbeats.beat("other")
    recovery.check_and_recover()
    recovery.hand_over()
    assert claims.claim("another") == left
    assert claims.claimed_parts()[claims.claimed[others]] == "other"
    assert store.heartbeats.living(SILENCE) == ["other"]


def test_a_run_without_a_part_that_would_end_it_fails(store, runs, claims, post):
    run = runs_of(store, lambda _connection, _run_id: None).create(run_request(stored_set(store)), None)
    waiting = post()
    recovery_of(store, runs, claims).check_and_recover()
    ended = runs.current(run.id)
    assert (ended.state, ended.error.type) == ("failed", "urn:jointstiff:problem:worker-lost")
    assert "send the job again" in ended.error.remedy
    assert runs.current(waiting.id).state == "queued"


@pytest.mark.parametrize("part", ["first", "other", "end"])
def test_a_run_that_too_many_workers_die_over_fails_and_others_do_not(store, runs, claims, post, part):
    poison = post()
    if part == "other":
        claims.work(lambda _: runs)
    if part == "end":
        for i in range(3 * STEPS_OF_A_PART):
            store.steps.store_result(poison.id, (i, i + 1), b"computed")
    recovery, waiting = recovery_of(store, runs, claims), post()
    while claimed := claims.claim("alive"):
        if claimed.job_id == poison.id:
            claims.put_back([claims.claimed[claimed]])
            break
    for death in range(ATTEMPTS):
        claims.used = {f"{waiting.id}-000000-0": death}
        assert claims.claim(f"dead-{death}").job_id == poison.id
        assert runs.current(poison.id).state != "failed"
        recovery.check_and_recover()
    claims.claim("the one after")
    claims.used = {f"{waiting.id}-000000-0": ATTEMPTS}
    recovery.check_and_recover()
    assert [runs.current(run.id).state for run in (poison, waiting)] == ["failed", "queued"]
    assert "5 workers died over one step" in runs.current(poison.id).error.detail


def test_deaths_are_counted_anew_once_a_step_is_kept(store, runs, claims, post, spans):
    """Ten kills of innocent workers in a row were five deaths over one run."""
    del spans[STEPS_OF_A_PART:]
    run, recovery = post(STEPS_OF_A_PART), recovery_of(store, runs, claims)
    for kept in range(1, STEPS_OF_A_PART):
        for _ in range(ATTEMPTS - 1):
            assert claims.claim("dead").kept == kept - 1
            recovery.check_and_recover()
        store.steps.store_result(run.id, (kept - 1, kept), b"by one that died then")
        claims.work(lambda _: runs)
        assert [name.rpartition("-")[0] for name in claims.waiting()] == [f"{run.id}-000000-{kept}"]
    assert runs.current(run.id).state == "running"


def test_an_outage_is_no_death_of_workers_that_come_back(store, runs, claims, post):
    """After one longer than the silence of the dead, all workers but the first to be heard are silent."""
    post(), post()
    time = [NOW]
    beats = Heartbeats(store._database, lambda _: time[-1])
    recovery = Recovery(store, lambda _: runs, claims, "alive", heartbeats=beats)
    mine, others = claims.claim("alive"), claims.claim("other")

    def owners_after(silence, *duties):
        time.append(time[-1] + silence)
        for duty in duties:
            claims.used = {claims.claimed[mine]: len(time)}
            duty()
        pending = claims.claimed_parts()
        return [pending.get(claims.claimed[part]) for part in (mine, others)]

    beat = functools.partial(beats.beat, "other")
    assert owners_after(0 * SILENCE, beat, recovery.check_and_recover) == ["alive", "other"]
    assert owners_after(2 * SILENCE, recovery.check_and_recover, beat) == ["alive", "other"]
    assert owners_after(SILENCE / 6, recovery.check_and_recover) == ["alive", "other"]
    assert owners_after(2 * SILENCE, recovery.check_and_recover) == ["alive", "other"]
    assert owners_after(SILENCE / 6, recovery.check_and_recover) == ["alive", None], (
        "the other one has not come back"
    )


def test_a_part_that_dbos_says_is_carried_out_here_and_is_not_goes_back(store, runs, claims, post):
    post()
    idle, recovery = claims.claim("alive"), recovery_of(store, runs, claims)
    recovery.check_and_recover()
    assert claims.claim("other") is None, "it may be about to begin"
    recovery.check_and_recover()
    assert claims.claim("other") == idle


def test_a_worker_whose_part_makes_no_progress_shows_no_sign_of_life_and_ends(store, runs, claims, post):
    post()
    recovery = recovery_of(store, runs, claims)
    claims.used = {claims.claimed.setdefault(claims.claim("alive"), ""): 1.25}
    recovery.check_and_recover()
    assert store.heartbeats.living(SILENCE) == ["alive"]
    store.heartbeats.forget("alive")
    for _ in range(3):
        recovery.check_and_recover()
    assert store.heartbeats.living(SILENCE) == []
    with pytest.raises(FrozenError):
        recovery.check_and_recover()


def test_a_part_that_computes_is_progress_and_so_is_the_next_one(store, runs, claims):
    recovery = recovery_of(store, runs, claims)
    for used in ({"a": 1.0}, {"a": 1.1}, {"b": 1.1}, {}, {}, {"b": 1.1}, {"c": 0.0}) * 3:
        claims.used = used
        store.heartbeats.forget("alive")
        recovery.check_and_recover()
        assert store.heartbeats.living(SILENCE) == ["alive"]


def test_jobs_of_a_kind_of_another_version_are_left_alone(store, runs, claims, post):
    unknown, lost, known = post(), post(), post()
    other = sa.update(jobs).where(jobs.c.id.in_([unknown.id, lost.id])).values(kind="oracle")
    store._database.change(other)
    claims._client.delete_workflows([f"{lost.id}-000000-0"])
    parts = Parts(store, claims.enqueue)
    part = claims.claim("dead")
    carry_out(store, parts.jobs_of, part, claims)
    (later,) = claims._list_rows(status="DELAYED")
    assert later.workflow_id.startswith(unknown.id)
    Recovery(store, parts.jobs_of, claims, "alive").check_and_recover()
    claims.claim("dead")
    claims.work_all(parts.jobs_of)
    assert [runs.records.status(known.id).state, store.kind_of_job(unknown.id)] == ["succeeded", "oracle"]
    states = sa.select(jobs.c.state).where(jobs.c.kind == "oracle")
    assert [row.state for row in store._database.rows(states)] == ["queued", "queued"]


def test_a_part_of_a_job_that_was_removed_is_nothing(store, claims):
    carry_out(store, None, Part("gone", 0, 0), claims)


def test_the_parts_of_ended_jobs_are_removed(store, runs, claims, post):
    ended, is_active = post(), post()
    claims.work(lambda _: runs)
    claims.work(lambda _: runs)
    runs.cancel(ended.id)
    recovery_of(store, runs, claims).check_and_recover()
    claims.work_all(lambda _: runs)  # of the cancelled run, too
    assert {each.workflow_id for each in claims._list_rows()} >= {f"{is_active.id}-000000-0"}
    recovery_of(store, runs, claims).check_and_recover()
    assert claims._list_rows() == []


def test_a_duty_that_fails_does_not_keep_the_janitor_from_the_others(store, runs, claims, monkeypatch):
    def refuse(_dead):
        raise KeyError("odd")

    monkeypatch.setattr(claims, "recover", refuse)
    run = runs_of(store, lambda _connection, _run_id: None).create(run_request(stored_set(store)), None)
    with pytest.raises(KeyError, match="odd"):
        recovery_of(store, runs, claims).check_and_recover()
    assert runs.current(run.id).state == "failed"


def test_a_step_that_fails_ends_its_run_with_the_reason(runs, claims, post, monkeypatch):
    run = post()

    def refuse(_self, _span):
        raise SolverError("no optimum", remedy="measure again")

    monkeypatch.setattr(RunWork, "compute", refuse)
    claims.work_all(lambda _: runs)
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
def test_a_pickle_planted_in_a_step_is_not_run_and_its_run_ends(store, runs, claims, post, tmp_path, written):
    """Who can write the database, or hands over a backup, runs no code in the workers."""
    run, other = post(), post()
    for i in range(3 * STEPS_OF_A_PART):
        store.steps.store_result(run.id, (i, i + 1), written(Planted(tmp_path / "ran")))
    claims.work_all(lambda _: runs)
    assert [runs.current(each.id).state for each in (run, other)] == ["failed", "succeeded"]
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("document", [compress(b"{"), b"{"])
@pytest.mark.parametrize("part", ["first", "other"])
def test_a_run_whose_document_is_damaged_fails_and_others_go_on(store, runs, claims, post, part, document):
    """No worker may die over it again and again, nor over the news that it failed."""
    damaged, other = post(), post()
    if part == "other":
        assert claims.work(lambda _: runs)
    broken = sa.text("UPDATE jobs SET document = :document WHERE id = :id")
    store._database.change(broken.bindparams(document=document, id=damaged.id))
    runs.work.cache_clear()  # as of a worker that starts
    claims.work_all(lambda _: runs)
    assert runs.records.status(damaged.id).state == "failed"
    assert [entry.state for entry in runs.records.page(limit=9).records] == ["succeeded", "failed"]
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
    beats_at(NOW).check_writable()
    assert beats_at(NOW).living(SILENCE) == ["a", "b"], "a proof is no worker"


def test_a_part_waits_for_the_database(monkeypatch):
    """An outage is no result of a step."""
    monkeypatch.setattr("jointstiff.service.workers.worker.time.sleep", lambda _: None)
    failures, ended = iter([StoreUnavailableError("away", "wait")] * 50), []

    def part():
        for failure in failures:
            raise failure
        ended.append(True)

    Retries().retry(part)
    assert ended == [True]


def test_a_part_whose_lock_is_not_available_three_times_is_handed_back(monkeypatch):
    """The worker goes on with other parts; other failures are waited for."""
    monkeypatch.setattr("jointstiff.service.workers.worker.time.sleep", lambda _: None)
    away, locked = StoreUnavailableError("away", "wait"), LockedError("locked", "wait")
    failures, tried, handed_back = iter([away, locked, away, locked, away, locked]), [], []

    def part():
        tried.append(True)
        raise next(failures)

    def hand_back():
        handed_back.append(len(tried))
        if len(handed_back) == 1:
            raise locked  # the queue is locked, too

    Retries().retry(part, hand_back)
    assert handed_back == [6, 6]


def test_a_worker_that_only_waits_for_the_database_shows_no_sign_of_life(store, runs, claims, post):
    """Its part goes on elsewhere; the sessions that are lost are ended all the same."""
    post()
    retries, waits, go_on = Retries(), threading.Event(), threading.Event()
    recovery = Recovery(store, lambda _: runs, claims, "alive", retries=retries)
    ended = []
    store.waits.end_lost_sessions = lambda: ended.append(True) or []

    def part():
        if not go_on.is_set():
            waits.set()
            raise StoreUnavailableError("away", "wait")

    thread = threading.Thread(target=retries.retry, args=(part,))
    thread.start()
    until(waits.is_set)
    recovery.check_and_recover()
    assert store.heartbeats.living(SILENCE) == ["alive"], "it has just begun to wait"
    store.heartbeats.forget("alive")
    recovery.check_and_recover()
    assert store.heartbeats.living(SILENCE) == []
    go_on.set()
    thread.join()
    recovery.check_and_recover()
    assert store.heartbeats.living(SILENCE) == ["alive"]
    assert len(ended) == 3


def test_steps_that_a_dead_process_left_behind_an_ended_job_are_removed(store, runs, claims, post):
    ended, is_active = post(), post()
    for run in (ended, is_active):
        store.steps.store_result(run.id, (0, 1), b"computed")
    store._database.change(sa.update(jobs).where(jobs.c.id == ended.id).values(state="cancelled"))
    recovery_of(store, runs, claims).check_and_recover()
    assert store.steps.results(ended.id) == []
    assert store.steps.results(is_active.id) == [b"computed"]


@pytest.mark.parametrize("step", ["compute", "conclude"])
def test_a_process_without_memory_ends_and_its_step_has_no_result(runs, claims, post, monkeypatch, step):
    monkeypatch.setattr("os.kill", lambda pid, sign: sys.exit(f"{pid} {sign}"))
    run = post()

    def exhaust(_self, _span):
        raise MemoryError

    monkeypatch.setattr(RunWork, step, exhaust)
    with pytest.raises(SystemExit, match=f"^{os.getpid()} {signal.SIGKILL}$"):
        claims.work_all(lambda _: runs)
    assert runs.current(run.id).state == "running"
    assert runs.records.status(run.id).done == (3 * STEPS_OF_A_PART if step == "conclude" else 0)


def test_pauses_double_up_to_a_minute():
    assert [pause_after(lives) for lives in (1, 2, 3, 4, 5, 6, 7, 10_000)] == [2, 4, 8, 16, 32, 60, 60, 60]


def test_a_worker_is_started_again_after_pauses_that_double(monkeypatch):
    """Of four lives, in seconds: who lives for a minute is not failing at its end, and begins anew."""
    lives, pauses, failing, now = [1.0, 59.0, 60.0, 5.0], [], [], 0.0
    supervisor = Supervisor("sqlite://", 0, "test")

    def watch(*_):
        nonlocal now
        now += lives[0]
        failing.append((lives.pop(0), supervisor.failing))

    monkeypatch.setattr(supervisor_module, "time", SimpleNamespace(monotonic=lambda: now))
    supervisor._stopping = SimpleNamespace(is_set=lambda: not lives, wait=pauses.append)
    supervisor._run_worker = watch
    supervisor._keep_worker_running("sqlite://", "test-1")
    assert pauses == [2, 4, 2]
    assert failing == [(1.0, 0), (59.0, 0), (60.0, 0), (5.0, 0)]


def test_a_worker_is_ended_once_it_shows_no_sign_of_life(monkeypatch):
    """It has two minutes for its start, and 45 s for each sign after that."""
    signs, pauses, ended = iter([True, True, False]), [], []

    def select(files, _writing, _failing, pause):
        pauses.append(pause)
        return (files if next(signs) else []), [], []

    monkeypatch.setattr(supervisor_module, "select", SimpleNamespace(select=select))
    reading, writing = os.pipe()
    os.write(writing, b".." * 4096)
    with os.fdopen(reading, "rb") as output, os.fdopen(writing, "wb"):
        process = SimpleNamespace(stdout=output, kill=lambda: ended.append(len(pauses)), wait=lambda: -9)
        assert Supervisor("sqlite://", 0, "test")._wait_for_end(process, "test-1-0") == -9
    assert (pauses, ended) == ([120.0, 45.0, 45.0], [3])


@pytest.mark.process
def test_a_worker_that_cannot_start_is_said_and_is_not_living(tmp_path, monkeypatch):
    """Its database is a folder, which no SQLite opens."""
    monkeypatch.setattr(supervisor_module, "pause_after", lambda _lives: 0.1)
    forgotten: list[str] = []
    with Supervisor(f"sqlite:///{tmp_path}", 1, "test", forgotten.append) as supervisor:
        assert supervisor.failing == 0
        until(lambda: supervisor.failing == 1)
    assert len(set(forgotten)) == len(forgotten) >= 2, "no two processes have one name"
    assert all(name.startswith("test-1-") for name in forgotten)


@pytest.mark.parametrize("comes_up", [True, False])
def test_a_worker_waits_for_a_server_that_comes_up(comes_up, store, monkeypatch, capsys):
    monkeypatch.setattr(worker_module, "DATABASE_SECONDS", 1.0)
    monkeypatch.setattr(worker_module, "DATABASE_PAUSE", 0.02)
    attempts = []

    def connect(url, upgrade):
        attempts.append(url)
        if not comes_up or len(attempts) < 3:
            raise StoreUnavailableError("the postgresql database failed (starting up)", "check the server")
        return store

    monkeypatch.setattr(worker_module.Store, "open", connect)
    if comes_up:
        assert worker_module._open_patiently("postgresql://h/d", None, threading.Event()) is store
        assert len(attempts) == 3
    else:
        with pytest.raises(StoreUnavailableError, match="starting up"):
            worker_module._open_patiently("postgresql://h/d", None, threading.Event())
    said = capsys.readouterr().err.strip().splitlines()
    assert said == ["the postgresql database failed (starting up): check the server; waiting up to 1 s"]


def test_a_worker_that_is_stopped_while_it_waits_ends(monkeypatch):
    def refuse(url, upgrade):
        raise StoreUnavailableError("the postgresql database failed", "check the server")

    monkeypatch.setattr(worker_module.Store, "open", refuse)
    stop = threading.Event()
    stop.set()
    with pytest.raises(SystemExit) as ended:
        worker_module._open_patiently("postgresql://h/d", None, stop)
    assert ended.value.code == 0


def test_a_worker_waits_for_the_file_of_a_service_that_starts(tmp_path, monkeypatch):
    monkeypatch.setattr(worker_module, "DATABASE_PAUSE", 0.02)
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    service = threading.Timer(0.2, lambda: Store.open(url).close())
    service.start()
    worker_module._open_patiently(url, None, threading.Event()).close()
    service.join()


def test_a_worker_makes_no_database(tmp_path, monkeypatch):
    """A mistyped path is an error with a remedy, not an empty database."""
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)  # which a worker changes
    monkeypatch.setattr(worker_module, "DATABASE_SECONDS", 0.1)
    monkeypatch.setattr(worker_module, "DATABASE_PAUSE", 0.02)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with pytest.raises(StoreError, match=r"mistyped\.db does not exist") as refused:
            worker_module.run_worker(f"sqlite:///{tmp_path / 'mistyped.db'}", "w1")
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert "start `jointstiff serve`" in refused.value.remedy
    assert list(tmp_path.iterdir()) == []


@pytest.mark.process
def test_a_worker_that_is_stopped_is_replaced(tmp_path, caplog):
    """The signs that it lives do not come through the database, which it may have locked."""
    url, forgotten = f"sqlite:///{tmp_path / 'x.db'}", []
    with Store.open(url) as store, Supervisor(url, 1, "test", forgotten.append, silence=3.0):
        beats = set()
        until(lambda: beats.update(store.heartbeats.silent(-SILENCE).values()) or len(beats) > 2)
        (stopped,), (name,) = workers_of(url), store.heartbeats.living(SILENCE)
        os.kill(stopped, signal.SIGSTOP)
        until(lambda: workers_of(url) not in ([], [stopped]))
    assert forgotten[0] == name
    assert f"worker {name} is silent; ending it" in caplog.text


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
