"""Deletion of robots and sets: only of what nothing refers to, and nothing refers to the deleted."""

from __future__ import annotations

import dataclasses
from datetime import UTC, datetime, timedelta

import pytest
from support.api import DELETE, RESTORE, job_at, posted
from support.in_process import Client
from support.jobs import QueueEngine, runs_of
from support.records import RESOURCES, job_record

from jointstiff.service.problems import DeletedError, NotFoundError, QuotaError, ReferencedError
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import IdempotencyKey, MeasurementSetRecord, RobotRecord
from jointstiff.service.workers.worker import Recovery
from jointstiff.simulator import default_arm, simulate_campaign

TIME = datetime(2026, 11, 20, 12, tzinfo=UTC)
ROBOT = RobotRecord("r1", "robot", TIME, "", "{}")
SET = MeasurementSetRecord("s1", "r1", "set", "motor", 1, 0, TIME, "", "{}", b"")


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        opened.robots.add(ROBOT)
        opened.sets.add(SET)
        yield opened


class TestStore:
    def test_what_others_refer_to_stays(self, store):
        runs, sets, robots = store.jobs(RESOURCES["run"]), *deletions(store)
        runs.add(job_record())
        with pytest.raises(ReferencedError, match="'s1' is used by run u1"):
            sets.delete("s1", TIME)
        with pytest.raises(ReferencedError, match="'r1' is used by measurement set s1, run u1"):
            robots.delete("r1", TIME)
        store.jobs(RESOURCES["run"]).delete("u1", TIME)
        sets.delete("s1", TIME)
        robots.delete("r1", TIME)
        for collection, identifier in ((store.sets, "s1"), (store.robots, "r1")):
            with pytest.raises(DeletedError):
                collection.get(identifier)
            assert collection.page(limit=9).records == ()
            assert [entry.id for entry in collection.page(limit=9, deleted=True).records] == [identifier]

    def test_nothing_refers_to_the_deleted(self, store):
        sets, robots = deletions(store)
        sets.delete("s1", TIME)
        with pytest.raises(DeletedError, match="measurement set 's1'"):
            store.jobs(RESOURCES["run"]).add(job_record())
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
        sets, _ = deletions(store)
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
        store.jobs(RESOURCES["run"]).add(job_record())
        runs, (sets, robots) = store.jobs(RESOURCES["run"]), deletions(store)
        runs.delete("u1", TIME + timedelta(days=1))
        sets.delete("s1", TIME + timedelta(days=1))
        robots.delete("r1", TIME + timedelta(days=1))
        robots.delete("r2", TIME)
        later = TIME + KEEP_DELETED + timedelta(hours=1)
        assert robots.purge(later - KEEP_DELETED, 9) == ["r2"]
        assert store.robots.find(key) is None
        assert robots.purge(later + KEEP_DELETED, 9) == []  # the set refers to it
        now = later + timedelta(days=1)
        recovery = Recovery(store, {"run": runs_of(store)}, QueueEngine(), "alive", now=lambda: now)
        recovery.look()
        for collection, identifier in ((store.sets, "s1"), (store.robots, "r1")):
            with pytest.raises(NotFoundError) as caught:
                collection.get(identifier)
            assert not isinstance(caught.value, DeletedError)


def deletions(store):
    return [store.sets, store.robots]


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


class TestApi:
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
            gone = client.request("POST", "/v1/runs", json={"measurement_set_id": stored})
            assert gone.status_code == 422
            assert "was deleted" in gone.json()["detail"]
            assert client.request("PATCH", job_at(run), json=RESTORE).status_code == 404
            for address in reversed(changed):
                assert client.request("PATCH", address, json=RESTORE).status_code == 200
            assert [client.get(address).json() for address in addresses] == shown
