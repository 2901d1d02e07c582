"""Events of jobs: all who follow a job share one look at it."""

from __future__ import annotations

import asyncio
import json

import pytest
from support.records import RUN, job_record

from jointstiff.schemas.job import Progress, Provenance
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.api import Watches
from jointstiff.service.api import events as module
from jointstiff.service.api.bodies import Body
from jointstiff.service.api.events import wait_for_end
from jointstiff.service.api.jobs import answer
from jointstiff.service.jobs import KINDS
from jointstiff.service.store import DeletedError, Standing, StoreUnavailableError

FOLLOWERS = 100


class ScriptedJobs:
    """Jobs of which each look finds as many units done as a script says, None for an outage; then the end."""

    kind = KINDS[0]

    def __init__(self, script, end="succeeded"):
        self.script = list(script)
        self.end = end
        self.looks = self.documents = 0

    def standing(self, _job_id):
        self.looks += 1
        if not self.script:
            return Standing(self.end, 0)
        done = self.script.pop(0)
        if done is None:
            raise StoreUnavailableError("away", "wait")
        return Standing("running", done)

    def current(self, job_id):
        self.documents += 1
        ended = not self.script
        return Run(
            id=job_id,
            state=self.end if ended else "queued",
            progress=Progress(done=90 if ended else 0, total=90, unit="resamples", activity="resampling"),
            request=RunRequest(measurement_set_id="s"),
            result=None,
            error=None,
            provenance=Provenance(
                versions={}, input_hash="", created_at="2026-11-20T00:00:00Z", started_at=None, ended_at=None
            ),
        )


def never():
    """Whether a service that goes on is about to end."""
    return False


@pytest.fixture(autouse=True)
def _hurried(monkeypatch):
    monkeypatch.setattr(module, "_EVENT_SECONDS", 0.01)
    monkeypatch.setattr(module, "_LOOK_SECONDS", 0.01)


async def followed(watches, jobs):
    return [event async for event in watches.events(jobs, "r1")]


def test_all_who_follow_a_job_share_one_look():
    jobs = ScriptedJobs([10, 10, 40, None, 80])

    async def crowd():
        watches = Watches()
        told = await asyncio.gather(*(followed(watches, jobs) for _ in range(FOLLOWERS)))
        assert watches._watches == {}
        return told

    told = asyncio.run(crowd())
    assert len(told) == FOLLOWERS
    assert all(events == told[0] for events in told)
    assert (jobs.looks, jobs.documents) == (6, 2)
    names = [event.splitlines()[0] for event in told[0]]
    assert names == ["event: progress"] * 4 + ["event: end"]
    data = [json.loads(event.splitlines()[1].removeprefix("data: ")) for event in told[0]]
    assert [each["progress"]["done"] for each in data] == [0, 10, 40, 80, 90]
    assert [each["state"] for each in data] == ["queued", "running", "running", "running", "succeeded"]
    assert set(data[0]) == {"id", "state", "progress"}


def test_those_who_leave_do_not_disturb_those_who_stay():
    jobs = ScriptedJobs(range(20))

    async def some_leave():
        watches = Watches()
        staying = [asyncio.create_task(followed(watches, jobs)) for _ in range(3)]
        leaving = [asyncio.create_task(followed(watches, jobs)) for _ in range(3)]
        await asyncio.sleep(0.05)
        for task in leaving:
            task.cancel()
        return await asyncio.gather(*staying)

    told = asyncio.run(some_leave())
    assert all(events[-1].startswith("event: end") for events in told)
    assert all(events == told[0] for events in told)


def test_no_one_looks_when_no_one_follows():
    jobs = ScriptedJobs(range(10_000))

    async def leave():
        watches = Watches()
        task = asyncio.create_task(followed(watches, jobs))
        await asyncio.sleep(0.05)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert watches._watches == {}
        await asyncio.sleep(0.05)
        looks = jobs.looks
        await asyncio.sleep(0.1)
        assert jobs.looks == looks

    asyncio.run(leave())


def test_a_quiet_job_sends_comments(monkeypatch):
    monkeypatch.setattr(module, "_QUIET_LOOKS", 3)
    events = asyncio.run(followed(Watches(), ScriptedJobs([5] * 8)))
    assert [event.split("\n")[0] for event in events].count(": still running") >= 1
    assert [event for event in events if event.startswith("event: progress")][-1].count('"done":5')


def test_a_look_that_fails_ends_the_streams():
    class Broken(ScriptedJobs):
        def standing(self, _job_id):
            raise RuntimeError("broken")

    async def crowd():
        watches = Watches()
        jobs = Broken([1])
        return await asyncio.gather(*(followed(watches, jobs) for _ in range(3)), return_exceptions=True)

    assert [str(error) for error in asyncio.run(crowd())] == ["broken"] * 3


def test_a_job_that_is_deleted_as_soon_as_it_ends_is_told_to_have_ended():
    class Deleted(ScriptedJobs):
        def standing(self, _job_id):
            found = super().standing(_job_id)
            return found if self.script else Standing("cancelled", 40)

        def current(self, job_id):
            if not self.script:
                raise DeletedError(RUN, job_id)
            return super().current(job_id)

    told = asyncio.run(followed(Watches(), Deleted([10, 20, 30])))
    assert told[-1].startswith("event: end")
    last = json.loads(told[-1].splitlines()[1].removeprefix("data: "))
    assert (last["state"], last["progress"]["done"]) == ("cancelled", 40)


def test_an_outage_at_the_first_or_the_last_look_does_not_end_a_stream():
    class Flickering(ScriptedJobs):
        outages = 6

        def current(self, job_id):
            self.outages -= 1
            if self.outages % 3:
                raise StoreUnavailableError("away", "wait")
            return super().current(job_id)

    told = asyncio.run(followed(Watches(), Flickering([10])))
    assert [event.splitlines()[0] for event in told] == ["event: progress"] * 2 + ["event: end"]


def test_waiting_ends_when_the_service_is_told_to():
    jobs = ScriptedJobs([1] * 10_000)
    asyncio.run(wait_for_end(jobs, "r1", 60, lambda: jobs.looks > 2))
    assert jobs.looks == 3


def test_waiting_ends_with_the_job_or_with_patience():
    jobs = ScriptedJobs([1, 2, 3])
    asyncio.run(wait_for_end(jobs, "r1", 60, never))
    assert jobs.looks == 4
    jobs = ScriptedJobs([1] * 10_000)
    asyncio.run(wait_for_end(jobs, "r1", 0.05, never))
    assert len(jobs.script) > 1


def test_those_who_wait_long_look_less_often(monkeypatch):
    monkeypatch.setattr(module, "_LOOK_SECONDS", 0.0)
    jobs = ScriptedJobs([1] * 100_000)
    asyncio.run(wait_for_end(jobs, "r1", 0.2, never))
    often = jobs.looks
    jobs = ScriptedJobs([1] * 100_000)
    asyncio.run(wait_for_end(jobs, "r1", 2.0, never))
    assert jobs.looks < 3 * often


@pytest.mark.parametrize("error", [StoreUnavailableError("away", "wait"), DeletedError(RUN, "r1")])
def test_what_was_stored_is_accepted_whatever_happens_to_it_then(error):
    """A job that was posted without a key would be posted again after a 503."""

    class Lost(ScriptedJobs):
        def create(self, _message, _key):
            job = self.current("r1")
            return job_record(RUN, "r1", state=job.state, document=job.model_dump_json())

        def standing(self, _job_id):
            raise error

    told = asyncio.run(answer(Lost([1]), Body(None, None), 5, never))
    assert (told.status_code, told.headers["location"]) == (202, "/v1/runs/r1")
    assert json.loads(told.body)["state"] == "queued"
