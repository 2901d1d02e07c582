"""Deletion with undo of jobs, robots and sets: on both databases, over HTTP, by the recovery's clock."""

import dataclasses
from datetime import UTC, datetime, timedelta

import pytest
from support.api import CANCEL, DELETE, RESTORE, job_at, post, posted, posted_set
from support.in_process import Client
from support.jobs import request, runs_of, stored_set
from support.records import RESOURCES, job_record

from jointstiff.schemas.comparison import ComparisonRequest
from jointstiff.schemas.finding import Problem
from jointstiff.service.jobs import Parts
from jointstiff.service.problems import (
    DeletedError,
    NotEndedError,
    NotFoundError,
    QuotaError,
    ReferencedError,
)
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


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        opened.robots.add(ROBOT)
        opened.sets.add(SET)
        yield opened


class TestStore:
    @pytest.mark.parametrize("state", ["queued", "running"])
    def test_a_job_that_goes_on_stays(self, store, state):
        jobs = store.jobs(RUNS)
        jobs.add(dataclasses.replace(RUN, state=state))
        with pytest.raises(NotEndedError) as caught:
            jobs.delete("u1", TIME)
        assert caught.value.remedy.startswith("cancel it first")
        assert [entry.id for entry in jobs.page(limit=9).records] == ["u1"]

    def test_purged_after_a_while_with_all_that_names_it(self, store):
        jobs, other = store.jobs(RUNS), dataclasses.replace(RUN, id="other")
        jobs.add(RUN, KEY)
        jobs.add(other, IdempotencyKey("another key", "hash"))
        jobs.delete("u1", TIME)
        with pytest.raises(DeletedError):
            jobs.refuse_deleted("u1")
        jobs.delete("u1", TIME + timedelta(days=20))  # which does not make it younger
        assert jobs.purge(TIME, 9) == []
        assert jobs.purge(TIME + timedelta(seconds=1), 9) == ["u1"]
        for find in (jobs.get, jobs.restore):
            with pytest.raises(NotFoundError) as caught:
                find("u1")
            assert type(caught.value) is NotFoundError
        assert jobs.find(KEY) is None
        assert jobs.find(IdempotencyKey("another key", "hash")) == other
        assert jobs.add(dataclasses.replace(RUN, id="anew"), KEY).id == "anew"
        jobs.add(RUN)
        assert jobs.status("u1").done == 0

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
        return runs_of(store, store.steps.announce)

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

    def test_the_janitor_removes_by_its_clock(self, store, runs):
        deleted, kept = (runs.create(request(stored_set(store), resampling=None), None) for _ in range(2))
        runs.records.delete(deleted.id)
        clock = [datetime.now(UTC) + KEEP_DELETED - timedelta(hours=1)]
        recovery = Recovery(store, lambda _: runs, "alive", now=lambda: clock[0])
        recovery.look()
        runs.records.restore(deleted.id)
        runs.records.delete(deleted.id)
        clock[0] += timedelta(hours=2)
        recovery.look()
        with pytest.raises(NotFoundError) as caught:
            runs.records.restore(deleted.id)
        assert type(caught.value) is NotFoundError
        assert runs.document(kept.id) == kept.document


class TestInputs:
    def test_what_others_refer_to_stays(self, store):
        runs, sets, robots = store.jobs(RUNS), store.sets, store.robots
        runs.add(RUN)
        with pytest.raises(ReferencedError, match="'s1' is used by run u1"):
            sets.delete("s1", TIME)
        with pytest.raises(ReferencedError, match="'r1' is used by measurement set s1, run u1"):
            robots.delete("r1", TIME)
        store.jobs(RUNS).delete("u1", TIME)
        sets.delete("s1", TIME)
        robots.delete("r1", TIME)
        for collection, identifier in ((store.sets, "s1"), (store.robots, "r1")):
            with pytest.raises(DeletedError):
                collection.get(identifier)
            assert collection.page(limit=9).records == ()
            assert [entry.id for entry in collection.page(limit=9, deleted=True).records] == [identifier]

    def test_nothing_refers_to_the_deleted(self, store):
        sets, robots = store.sets, store.robots
        sets.delete("s1", TIME)
        with pytest.raises(DeletedError, match="measurement set 's1'"):
            store.jobs(RUNS).add(RUN)
        robots.delete("r1", TIME)
        with pytest.raises(DeletedError, match="robot 'r1'"):
            store.sets.add(dataclasses.replace(SET, id="s2"))
        with pytest.raises(DeletedError, match="robot 'r1'"):
            sets.restore("s1")
        robots.restore("r1")
        sets.restore("s1")
        assert store.sets.get("s1") == SET
        assert store.robots.get("r1") == ROBOT

    def test_the_first_deletion_counts_and_odd_ids_are_not_there(self, store):
        sets = store.sets
        for hours in (0, 1):
            sets.delete("s1", TIME + timedelta(hours=hours))
        assert sets.purge(TIME + timedelta(minutes=1), 9) == ["s1"]
        for odd in ("no such", "\x00", "\ud800"):
            with pytest.raises(NotFoundError):
                sets.delete(odd, TIME)
            with pytest.raises(NotFoundError):
                sets.restore(odd)

    def test_purged_from_the_jobs_to_the_robot_with_their_keys(self, store):
        key = IdempotencyKey("a key", "hash")
        store.robots.add(dataclasses.replace(ROBOT, id="r2"), key)
        store.jobs(RUNS).add(RUN)
        runs, sets, robots = store.jobs(RUNS), store.sets, store.robots
        runs.delete("u1", TIME + timedelta(days=1))
        sets.delete("s1", TIME + timedelta(days=1))
        robots.delete("r1", TIME + timedelta(days=1))
        robots.delete("r2", TIME)
        later = TIME + KEEP_DELETED + timedelta(hours=1)
        assert robots.purge(later - KEEP_DELETED, 9) == ["r2"]
        assert store.robots.find(key) is None
        assert robots.purge(later + KEEP_DELETED, 9) == []  # the set refers to it
        now = later + timedelta(days=1)
        recovery = Recovery(store, lambda _: runs_of(store), "alive", now=lambda: now)
        recovery.look()
        for collection, identifier in ((store.sets, "s1"), (store.robots, "r1")):
            with pytest.raises(NotFoundError) as caught:
                collection.get(identifier)
            assert not isinstance(caught.value, DeletedError)


def test_a_quota_refuses_what_is_new_and_keeps_the_rest(database_url):
    with Store.open(database_url) as store:
        store.robots.add(ROBOT)
        used = store.quota.used()
        assert used > 10_000
    with Store.open(database_url, used) as store:
        with pytest.raises(QuotaError, match="its quota is"):
            store.robots.add(dataclasses.replace(ROBOT, id="r2"))
        assert store.robots.get("r1") == ROBOT
        store.robots.delete("r1", TIME)
    with Store.open(database_url, 10 * used) as store:
        store.robots.add(dataclasses.replace(ROBOT, id="r2"))


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

    def test_a_campaign_is_deleted_from_its_end_and_brought_back(self):
        document = simulate_campaign(default_arm(), load="pull", configurations=8, seed=1)
        with Store.open("sqlite://") as opened:
            client = Client(opened)
            first = posted(client, document)
            run, stored = first["id"], first["request"]["measurement_set_id"]
            robot = client.get(f"/v1/measurement-sets/{stored}").json()["robot_id"]
            addresses = [f"/v1/runs/{run}", f"/v1/measurement-sets/{stored}", f"/v1/robots/{robot}"]
            for address in addresses[:0:-1]:
                refused = client.request("PATCH", address, json=DELETE)
                assert refused.status_code == 409
                assert refused.json()["type"] == "urn:jointstiff:problem:referenced"
            shown = [client.get(address).json() for address in addresses]
            changed = [job_at(run), *addresses[1:]]
            for address, at in zip(addresses, changed, strict=True):
                answers = [client.request("PATCH", at, json=DELETE) for _ in range(2)]
                assert [answer.status_code for answer in answers] == [200, 200]
                assert answers[0].json() == answers[1].json()
                assert client.request("PATCH", at, json=DELETE).status_code == 200
                assert client.get(address).json()["type"] == "urn:jointstiff:problem:deleted"
                listing = address.rpartition("/")[0]
                assert client.get(listing).json()["items"] == []
                assert len(client.get(listing, params={"deleted": True}).json()["items"]) == 1
            gone = post(client, "/v1/runs", {"measurement_set_id": stored}, 422)
            assert "was deleted" in gone["detail"]
            assert client.request("PATCH", job_at(run), json=RESTORE).status_code == 404
            for address in reversed(changed):
                assert client.request("PATCH", address, json=RESTORE).status_code == 200
            assert [client.get(address).json() for address in addresses] == shown
