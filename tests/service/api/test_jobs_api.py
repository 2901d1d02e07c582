"""Jobs over HTTP: tables take turns; events for all who follow; deletion with undo."""

import asyncio
import dataclasses
import json
import time
from contextlib import closing
from datetime import UTC, datetime, timedelta

import anyio
import httpx2
import pytest
from fastapi.sse import ServerSentEvent
from support.api import CANCEL, DELETE, file_at, job_at, post, posted, posted_set
from support.claims import Claims
from support.jobs import RUN, job_record, run_request, runs_of, stored_set
from support.kinds import posted_job

from jointstiff.schemas.job import Progress, Provenance
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.api.jobs import Followers, answer_new_job
from jointstiff.service.app import create_app
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import (
    DeletedError,
    NotEndedError,
    NotFoundError,
    QuotaError,
    ReferencedError,
    StoreUnavailableError,
)
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.jobs import JobStatus
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import IdempotencyKey, MeasurementSetRecord, RobotRecord
from jointstiff.service.workers.worker import Recovery
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def comparison(local):
    """The address of a comparison of two sets."""
    first, second = (
        posted(local, simulate_campaign(default_arm(), load="pull", configurations=6, seed=seed))
        for seed in (1, 2)
    )
    return posted_job(local, "comparison", first, second["id"]).headers["location"]


def test_tables_wait_for_their_turn_and_leave_other_requests_theirs(memory, comparison):
    """As files do: tables of many rows take seconds."""
    app = create_app(memory)
    turns = app.state.large_bodies

    async def ask():
        transport = httpx2.ASGITransport(app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
            for borrower in range(int(turns.total_tokens)):
                await turns.acquire_on_behalf_of(borrower)
            with anyio.move_on_after(2.0) as patience:
                await client.get(file_at(comparison, "tables.json"))
            assert patience.cancelled_caught
            assert (await client.get(comparison)).status_code == 200
            turns.release_on_behalf_of(0)
            assert (await client.get(file_at(comparison, "tables.json"))).status_code == 200

    anyio.run(ask)


def test_a_comparison_of_one_set_has_no_file_of_ratios(local, comparison):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=6, seed=1)
    first, second = (posted(local, campaign, positive=positive)["id"] for positive in (True, False))
    of_one = post(local, "/v1/comparisons", {"run_ids": [first, second]})
    answer = local.get(file_at(of_one, "ratios.csv"))
    assert answer.status_code == 404
    assert answer.json()["detail"] == "this comparison has no rows for ratios.csv, the ratios of two sides"
    assert local.get(file_at(of_one, "table.csv")).text.count("\n") > 6
    assert local.get(file_at(comparison, "ratios.csv")).text.count("\n") > 6


REQUEST = RunRequest(measurement_set_id="s")


class ScriptedJobs:
    """Jobs of which each look finds as many units done as a script says, None for an outage; then the end."""

    kind = KINDS[0]

    def __init__(self, script, end="succeeded"):
        self.script = list(script)
        self.end = end
        self.looks = self.documents = 0
        self.records = self

    def statuses(self, job_ids):
        self.looks += 1
        return {job_id: self.status() for job_id in job_ids}

    def status(self):
        if not self.script:
            return JobStatus(self.end, 0)
        done = self.script.pop(0)
        if done is None:
            raise StoreUnavailableError("away", "wait")
        return JobStatus("running", done)

    def update_progress(self, job, status):
        progress = job.progress.model_copy(update={"done": status.done})
        return job.model_copy(update={"state": status.state, "progress": progress})

    def current(self, job_id):
        self.documents += 1
        ended = not self.script
        return Run(
            id=job_id,
            state=self.end if ended else "queued",
            progress=Progress(done=90 if ended else 0, total=90, unit="resamples", activity="resampling"),
            request=REQUEST,
            result=None,
            error=None,
            provenance=Provenance(
                versions={}, input_hash="", created_at="2026-11-20T00:00:00Z", started_at=None, ended_at=None
            ),
        )


def hurried(is_closing=lambda: False):
    return Followers(is_closing, pause=0.01)


async def followed(followers, jobs, job_id="r1"):
    return [event async for event in followers.events(jobs, job_id)]


def data_of(events):
    return [json.loads(event.raw_data) for event in events]


def test_who_may_follow_no_longer_hears_no_more():
    asked = []

    async def is_allowed():
        asked.append(len(asked) < 2)
        return asked[-1]

    async def follow():
        followers = type("Prompt", (Followers,), {"ALLOWED_SECONDS": 0.05})(pause=0.01)
        return [event async for event in followers.events(ScriptedJobs([1] * 10_000), "r1", is_allowed)]

    assert [event.event for event in asyncio.run(follow())] == ["progress"]
    assert asked == [True, True, False]


def test_streams_end_when_the_service_is_told_to():
    jobs = ScriptedJobs([1] * 10_000)
    events = asyncio.run(followed(hurried(lambda: jobs.looks > 2), jobs))
    assert [event.event for event in events] == ["progress"]


def test_those_who_leave_do_not_disturb_those_who_stay():
    jobs = ScriptedJobs(range(20))

    async def some_leave():
        followers = hurried()
        staying = [asyncio.create_task(followed(followers, jobs)) for _ in range(3)]
        leaving = [asyncio.create_task(followed(followers, jobs)) for _ in range(3)]
        await asyncio.sleep(0.05)
        for task in leaving:
            task.cancel()
        return await asyncio.gather(*staying)

    told = asyncio.run(some_leave())
    assert all(events[-1].event == "end" for events in told)
    assert all(events == told[0] for events in told)


def test_no_one_looks_when_no_one_follows():
    jobs = ScriptedJobs(range(10_000))

    async def leave():
        followers = hurried()
        task = asyncio.create_task(followed(followers, jobs))
        await asyncio.sleep(0.05)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert followers._followed == {}
        await asyncio.wait_for(followers._task, 60)
        looks = jobs.looks
        await asyncio.sleep(0.1)
        assert jobs.looks == looks

    asyncio.run(leave())


def test_who_leaves_as_news_come_has_left():
    """Both reach the task in one turn of the loop; `asyncio.wait_for` of Python 3.11 would go on."""

    async def leave():
        followers = Followers(pause=60.0)
        task = asyncio.create_task(followed(followers, ScriptedJobs(range(10))))
        while (job := followers._followed.get("r1")) is None or job.event is None:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.01)
        job.publish(ServerSentEvent(event="progress", raw_data="{}"))
        task.cancel()
        await asyncio.wait([task], timeout=5.0)
        assert task.cancelled()
        assert followers._followed == {}

    asyncio.run(leave())


def test_a_look_that_fails_ends_the_streams():
    class Broken(ScriptedJobs):
        def statuses(self, _job_ids):
            raise RuntimeError("broken")

    async def crowd():
        followers = hurried()
        jobs = Broken([1])
        return await asyncio.gather(*(followed(followers, jobs) for _ in range(3)), return_exceptions=True)

    assert [str(error) for error in asyncio.run(crowd())] == ["broken"] * 3


def test_a_job_that_is_deleted_as_soon_as_it_ends_is_told_to_have_ended():
    class Deleted(ScriptedJobs):
        def status(self):
            found = super().status()
            return found if self.script else JobStatus("cancelled", 40)

        def current(self, job_id):
            if not self.script:
                raise DeletedError(RUN, job_id)
            return super().current(job_id)

    told = asyncio.run(followed(hurried(), Deleted([10, 20, 30])))
    assert told[-1].event == "end"
    last = data_of(told)[-1]
    assert (last["state"], last["progress"]["done"]) == ("cancelled", 40)


def test_an_outage_at_the_first_or_the_last_look_does_not_end_a_stream():
    class Flickering(ScriptedJobs):
        outages = 6

        def current(self, job_id):
            self.outages -= 1
            if self.outages % 3:
                raise StoreUnavailableError("away", "wait")
            return super().current(job_id)

    told = asyncio.run(followed(hurried(), Flickering([10, 20, 30, 40])))
    assert [event.event for event in told] == ["progress"] * (len(told) - 1) + ["end"]
    assert len(told) > 1


def test_waiting_ends_when_the_service_is_told_to():
    jobs = ScriptedJobs([1] * 10_000)
    asyncio.run(hurried(lambda: jobs.looks > 2).wait(jobs, "r1", 60))
    assert jobs.looks == 3


def test_waiting_ends_with_the_job_or_with_patience():
    jobs = ScriptedJobs([1, 2, 3])
    asyncio.run(hurried().wait(jobs, "r1", 60))
    assert jobs.looks == 4
    jobs = ScriptedJobs([1] * 10_000)
    asyncio.run(hurried().wait(jobs, "r1", 0.05))
    assert len(jobs.script) > 1


def test_slow_looks_are_rare():
    """Looks at many jobs at once take long, and must leave the threads to others."""

    class Slow(ScriptedJobs):
        def statuses(self, job_ids):
            time.sleep(0.05)
            return super().statuses(job_ids)

    jobs = Slow([1] * 10_000)
    asyncio.run(hurried().wait(jobs, "r1", 1.0))
    assert jobs.looks <= 5


@pytest.mark.parametrize("error", [StoreUnavailableError("away", "wait"), DeletedError(RUN, "r1")])
def test_what_was_stored_is_accepted_whatever_happens_to_it_then(error):
    """A job that was posted without a key would be posted again after a 503."""

    class Lost(ScriptedJobs):
        def create(self, _message, _key):
            job = self.current("r1")
            return job_record(RUN, "r1", state=job.state, document=job.model_dump_json())

        def current(self, job_id):
            if self.documents:
                raise error
            return super().current(job_id)

    jobs = Lost([1])
    told = asyncio.run(answer_new_job(jobs, jobs.create(REQUEST, None), 0.1, hurried()))
    assert (told.status_code, told.headers["location"]) == (202, "/v1/jobs/r1")
    assert json.loads(told.body)["state"] == "queued"


TIME = datetime(2026, 11, 20, 12, tzinfo=UTC)
ROBOT = RobotRecord("r1", "robot", TIME, "", "{}")
SET = MeasurementSetRecord("s1", "r1", "set", "motor", 1, 0, TIME, "", "{}", b"")
JOB = job_record()
KEY = IdempotencyKey("a key", "hash of a body")


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        opened.robots.add(ROBOT)
        opened.sets.add(SET)
        yield opened


@pytest.fixture
def claims(store, database_url):
    with closing(Claims(store, database_url)) as queue:
        yield queue


class TestStore:
    @pytest.mark.parametrize("state", ["queued", "running"])
    def test_a_job_that_goes_on_stays(self, store, state):
        jobs = store.jobs(RUN)
        jobs.add(dataclasses.replace(JOB, state=state))
        with pytest.raises(NotEndedError) as caught:
            jobs.delete("u1", TIME)
        assert caught.value.remedy.startswith("cancel the run first")
        assert [entry.id for entry in jobs.page(limit=9).records] == ["u1"]

    def test_purged_after_a_while_with_all_that_names_it(self, store):
        jobs, other = store.jobs(RUN), dataclasses.replace(JOB, id="other")
        jobs.add(JOB, KEY)
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
        assert jobs.add(dataclasses.replace(JOB, id="anew"), KEY).id == "anew"
        jobs.add(JOB)
        assert jobs.status("u1").done == 0

    def test_what_is_brought_back_is_not_purged(self, store):
        store.jobs(RUN).add(JOB)
        deletions = store.jobs(RUN)
        deletions.delete("u1", TIME)
        deletions.restore("u1")
        assert deletions.purge(TIME + timedelta(days=400), 9) == []
        assert store.jobs(RUN).get("u1") == JOB


class TestJobs:
    @pytest.fixture
    def runs(self, store):
        return runs_of(store, lambda _connection, _run_id: None)

    def test_a_run_is_cancelled_then_deleted_and_its_late_work_does_nothing(self, store, runs):
        run = runs.create(run_request(stored_set(store)), None)
        with pytest.raises(NotEndedError):
            runs.records.delete(run.id)
        runs.cancel(run.id)
        before = runs.records.get(run.id)
        runs.records.delete(run.id)
        assert not runs.records.is_active(run.id)
        runs.fail(run.id, RuntimeError("of a worker that did not hear of it"))
        with pytest.raises(DeletedError):
            runs.cancel(run.id)
        runs.records.restore(run.id)
        assert runs.records.get(run.id) == before

    def test_the_janitor_removes_by_its_clock(self, store, runs, claims):
        deleted, kept = (runs.create(run_request(stored_set(store), resampling=None), None) for _ in range(2))
        runs.records.delete(deleted.id)
        clock = [datetime.now(UTC) + KEEP_DELETED - timedelta(hours=1)]
        recovery = Recovery(store, lambda _: runs, claims, "alive", now=lambda: clock[0])
        recovery.check_and_recover()
        runs.records.restore(deleted.id)
        runs.records.delete(deleted.id)
        clock[0] += timedelta(hours=2)
        recovery.check_and_recover()
        with pytest.raises(NotFoundError) as caught:
            runs.records.restore(deleted.id)
        assert type(caught.value) is NotFoundError
        assert runs.records.get(kept.id) == kept


class TestInputs:
    def test_what_others_refer_to_stays(self, store):
        runs, sets, robots = store.jobs(RUN), store.sets, store.robots
        runs.add(JOB)
        with pytest.raises(ReferencedError, match="'s1' is used by run u1"):
            sets.delete("s1", TIME)
        with pytest.raises(ReferencedError, match="'r1' is used by measurement set s1, run u1"):
            robots.delete("r1", TIME)
        store.jobs(RUN).delete("u1", TIME)
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
            store.jobs(RUN).add(JOB)
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

    def test_purged_from_the_jobs_to_the_robot_with_their_keys(self, store, claims):
        key = IdempotencyKey("a key", "hash")
        store.robots.add(dataclasses.replace(ROBOT, id="r2"), key)
        store.jobs(RUN).add(JOB)
        runs, sets, robots = store.jobs(RUN), store.sets, store.robots
        runs.delete("u1", TIME + timedelta(days=1))
        sets.delete("s1", TIME + timedelta(days=1))
        robots.delete("r1", TIME + timedelta(days=1))
        robots.delete("r2", TIME)
        later = TIME + KEEP_DELETED + timedelta(hours=1)
        assert robots.purge(later - KEEP_DELETED, 9) == ["r2"]
        assert store.robots.find(key) is None
        assert robots.purge(later + KEEP_DELETED, 9) == []  # the set refers to it
        now = later + timedelta(days=1)
        recovery = Recovery(store, lambda _: runs_of(store), claims, "alive", now=lambda: now)
        recovery.check_and_recover()
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


DEAD_WEIGHT = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=5)


class TestHttp:
    def test_a_run_that_goes_on(self, client_of_workers):
        client = client_of_workers
        resampling = {"size": 5, "repetitions": 100_000, "seed": 1}
        body = {"measurement_set_id": posted_set(client, DEAD_WEIGHT), "resampling": resampling}
        run = client.post("/v1/runs?wait=0", json=body)
        assert run.status_code == 202
        address = run.headers["location"]
        refused = client.patch(job_at(address), json=DELETE)
        assert refused.status_code == 409
        assert f"PATCH {job_at(address)}" in refused.json()["remedy"]
        early = client.get(f"{job_at(address)}/files/joints.csv")
        assert early.status_code == 409
        identifier = job_at(address).rpartition("/")[2]
        wait = f"wait: read GET /v1/jobs/{identifier} until `state` is `succeeded`"
        assert early.json()["remedy"] == wait
        assert client.patch(job_at(address), json=CANCEL).status_code == 200
        late = client.get(f"{job_at(address)}/files/joints.csv")
        assert (late.status_code, late.json()["remedy"]) == (409, "post the run again")
        for _ in range(2):
            cancelled = client.patch(job_at(address), json=CANCEL | DELETE)
            assert (cancelled.status_code, cancelled.json()["state"]) == (200, "cancelled")
        assert client.get(address).json()["type"].endswith(":deleted")
