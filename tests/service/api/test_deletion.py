"""Deletion with undo: on both databases, over HTTP, and by the clock of the recovery."""

from __future__ import annotations

import dataclasses
from datetime import UTC, datetime, timedelta

import pytest
from support.api import CANCEL, DELETE, RESTORE, job_at, posted_set
from support.jobs import QueueEngine, request, runs_of, stored_set
from support.records import RESOURCES, job_record

from jointstiff.schemas.comparison import ComparisonRequest
from jointstiff.schemas.finding import Problem
from jointstiff.service.jobs import Parts
from jointstiff.service.problems import DeletedError, NotEndedError, NotFoundError
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import IdempotencyKey, MeasurementSetRecord, RobotRecord
from jointstiff.service.workers.worker import Recovery
from jointstiff.simulator import default_arm, simulate_campaign

TIME = datetime(2026, 11, 20, 12, tzinfo=UTC)
ROBOT = RobotRecord("r1", "robot", TIME, "", "{}")
SET = MeasurementSetRecord("s1", "r1", "set", "motor", 1, 0, TIME, "", "{}", b"")
RUN = job_record()
RUNS = RESOURCES["run"]
KEY = IdempotencyKey("a key", "hash of a body")

jobs = pytest.mark.parametrize("job", [job_record(kind) for kind in RESOURCES.values()], ids=RESOURCES)


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        opened.robots.add(ROBOT)
        opened.sets.add(SET)
        yield opened


def listed(store, kind):
    return [entry.id for entry in store.jobs(kind).page(limit=9).records]


class TestStore:
    @jobs
    def test_hidden_and_brought_back_as_it_was(self, store, job):
        kind = RESOURCES[job.kind]
        others = [dataclasses.replace(job, id=name) for name in ("before", "after")]
        for record in (others[0], job, others[1]):
            store.jobs(kind).add(record)
        deletions = store.jobs(kind)
        for _ in range(2):
            deletions.delete(job.id, TIME)
            assert listed(store, kind) == ["after", "before"]
            with pytest.raises(DeletedError, match=f"PATCH /v1/jobs/{job.id}"):
                store.jobs(kind).get(job.id)
            with pytest.raises(DeletedError):
                deletions.refuse_deleted(job.id)
        for _ in range(2):
            deletions.restore(job.id)
            assert store.jobs(kind).get(job.id) == job
            assert listed(store, kind) == ["after", job.id, "before"]
            deletions.refuse_deleted(job.id)

    @pytest.mark.parametrize("state", ["queued", "running"])
    @jobs
    def test_a_job_that_goes_on_stays(self, store, job, state):
        store.jobs(RESOURCES[job.kind]).add(dataclasses.replace(job, state=state))
        with pytest.raises(NotEndedError) as caught:
            store.jobs(RESOURCES[job.kind]).delete(job.id, TIME)
        assert caught.value.remedy.startswith("cancel it first")
        assert listed(store, RESOURCES[job.kind]) == [job.id]

    @jobs
    def test_purged_after_a_while_with_all_that_names_it(self, store, job):
        kind = RESOURCES[job.kind]
        other = dataclasses.replace(job, id="other")
        store.jobs(kind).add(job, KEY)
        store.jobs(kind).add(other, IdempotencyKey("another key", "hash"))
        jobs = store.jobs(kind)
        jobs.report(job.id, 0, 120)
        jobs.delete(job.id, TIME)
        jobs.delete(job.id, TIME + timedelta(days=20))  # which does not make it younger
        assert jobs.purge(TIME, 9) == []
        assert jobs.purge(TIME + timedelta(seconds=1), 9) == [job.id]
        for find in (lambda: jobs.get(job.id), lambda: jobs.restore(job.id)):
            with pytest.raises(NotFoundError) as caught:
                find()
            assert type(caught.value) is NotFoundError
        assert store.jobs(kind).find(KEY) is None
        assert store.jobs(kind).find(IdempotencyKey("another key", "hash")) == other
        assert store.jobs(kind).add(dataclasses.replace(job, id="anew"), KEY).id == "anew"
        jobs.add(job)
        assert jobs.status(job.id).done == 0

    def test_what_is_brought_back_is_not_purged(self, store):
        store.jobs(RUNS).add(RUN)
        deletions = store.jobs(RUNS)
        deletions.delete("u1", TIME)
        deletions.restore("u1")
        assert deletions.purge(TIME + timedelta(days=400), 9) == []
        assert store.jobs(RUNS).get("u1") == RUN


class TestJobs:
    @pytest.fixture
    def runs(self, store):
        return runs_of(store, lambda _connection, _kind, _run_id: None)

    def test_a_run_is_cancelled_then_deleted_and_its_late_work_does_nothing(self, store, runs):
        run = runs.create(request(stored_set(store)), None)
        with pytest.raises(NotEndedError):
            runs.records.delete(run.id)
        runs.cancel(run.id)
        before = runs.document(run.id)
        runs.records.delete(run.id)
        assert not runs.records.goes_on(run.id)
        runs.fail(run.id, RuntimeError("of a worker that did not hear of it"))
        with pytest.raises(DeletedError):
            runs.cancel(run.id)
        runs.records.restore(run.id)
        assert runs.document(run.id) == before

    def test_a_deleted_run_is_not_compared(self, store, runs):
        parts, set_id = Parts(store), stored_set(store)
        kept, run = (runs.create(request(set_id, resampling=None), None) for _ in range(2))
        runs.records.delete(run.id)
        with pytest.raises(Exception, match="was deleted") as caught:
            parts.jobs["comparison"].create(ComparisonRequest(run_ids=[kept.id, run.id]), None)
        assert caught.value.where == "run_ids[1]"
        assert "restore" in caught.value.remedy

    @pytest.mark.parametrize("odd", ["\x00", "é", "a\x1f", "\ud800"])
    def test_odd_ids(self, runs, odd):
        for act in (runs.records.delete, runs.records.restore):
            with pytest.raises(NotFoundError):
                act(odd)

    def test_the_janitor_removes_by_its_clock(self, store, runs):
        deleted, kept = (runs.create(request(stored_set(store), resampling=None), None) for _ in range(2))
        runs.records.delete(deleted.id)
        clock = [datetime.now(UTC) + KEEP_DELETED - timedelta(hours=1)]
        recovery = Recovery(store, {"run": runs}, QueueEngine(), "alive", now=lambda: clock[0])
        recovery.look()
        runs.records.restore(deleted.id)
        runs.records.delete(deleted.id)
        clock[0] += timedelta(hours=2)
        recovery.look()
        with pytest.raises(NotFoundError) as caught:
            runs.records.restore(deleted.id)
        assert type(caught.value) is NotFoundError
        assert runs.document(kept.id) == kept.document


CAMPAIGN = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=5)


class TestHttp:
    @pytest.mark.parametrize("collection", ["jobs", "robots", "measurement-sets"])
    @pytest.mark.parametrize("identifier", ["nothing", "%00", "%F0%9F%92%A9", "a%ED%A0%80"])
    def test_unknown(self, client, collection, identifier):
        address = f"/v1/{collection}/{identifier}"
        answers = [client.patch(address, json=change) for change in (DELETE, RESTORE)]
        for answer in (*answers, client.delete(f"/v1/jobs/{identifier}")):
            assert answer.status_code == 404
            assert Problem.model_validate(answer.json()).type.endswith(":not-found")

    def test_a_run_that_goes_on(self, client_of_workers):
        client = client_of_workers
        resampling = {"size": 5, "repetitions": 100_000, "seed": 1}
        body = {"measurement_set_id": posted_set(client, CAMPAIGN), "resampling": resampling}
        run = client.post("/v1/runs?wait=0", json=body)
        assert run.status_code == 202
        address = run.headers["location"]
        refused = client.delete(job_at(address))
        assert refused.status_code == 409
        assert f"PATCH {job_at(address)}" in refused.json()["remedy"]
        for _ in range(2):
            cancelled = client.patch(job_at(address), json=CANCEL | DELETE)
            assert (cancelled.status_code, cancelled.json()["state"]) == (200, "cancelled")
        assert client.get(address).json()["type"].endswith(":deleted")
