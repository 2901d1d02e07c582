"""Events of jobs: one task looks at all jobs that are followed, for all who follow them."""

import asyncio
import json
import time

import pytest
from fastapi.sse import ServerSentEvent
from support.records import RUN, job_record

from jointstiff.schemas.job import Progress, Provenance
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.api.jobs import Followers, answer
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import DeletedError, StoreUnavailableError
from jointstiff.service.store.jobs import JobStatus

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
        while (job := followers._followed.get("r1")) is None or job.news is None:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.01)
        job.tell(ServerSentEvent(event="progress", raw_data="{}"))
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
    told = asyncio.run(answer(jobs, jobs.create(REQUEST, None), 0.1, hurried()))
    assert (told.status_code, told.headers["location"]) == (202, "/v1/runs/r1")
    assert json.loads(told.body)["state"] == "queued"
