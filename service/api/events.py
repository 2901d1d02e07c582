"""Progress of jobs as server-sent events: one task looks at all jobs that are followed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping
from contextlib import aclosing, suppress
from dataclasses import dataclass, field
from typing import ClassVar, Final

from fastapi.concurrency import run_in_threadpool
from fastapi.sse import ServerSentEvent

from jointstiff.schemas.job import Job
from jointstiff.service.jobs.life import Jobs
from jointstiff.service.problems.errors import NotFoundError, StoreUnavailableError
from jointstiff.service.store.jobs import JobStatus

TURN_SECONDS: Final = 0.1
"""Pause between two looks at the jobs that are followed."""
_PAUSE_PER_LOOK: Final = 4
"""Least pause as a multiple of the time a look took: looks take at most a fifth of a thread."""


@dataclass(eq=False)
class _Followed:
    """A job while someone follows it."""

    jobs: Jobs  # the jobs of its kind
    followers: int = 0  # number of those who follow it
    job: Job | None = None  # the job as it was first seen
    news: ServerSentEvent | None = None  # the latest event
    over: bool = False  # no further event comes
    # set when `news` or `over` changes, and replaced by another then
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    def look(self, job_id: str, status: JobStatus | None) -> ServerSentEvent | None:
        """Return the event that tells where the job stands; None if it is gone."""
        if status is None:
            return None
        is_current = self.job is None or not status.goes_on
        if is_current:
            try:
                self.job = self.jobs.current(job_id)
            except NotFoundError:  # deleted meanwhile
                is_current = False
        if self.job is None:
            return None
        if status.goes_on:
            return _event("progress", _at(status, self.job))
        return _event("end", self.job if is_current else _at(status, self.job))

    def tell(self, news: ServerSentEvent | None) -> None:
        """Tell the followers what is new; None ends their streams."""
        if news is not None and news == self.news:
            return
        self.over = news is None or news.event == "end"
        self.news = news or self.news
        self.changed.set()
        self.changed = asyncio.Event()


Question = Callable[[], Awaitable[bool]]


async def _always() -> bool:
    return True


class _NowAndThen:
    """A question that is asked again after some seconds only."""

    def __init__(self, question: Question, seconds: float) -> None:
        self._question = question
        self._seconds = seconds
        self._clock = asyncio.get_running_loop().time
        self._at = self._clock()
        self._answer = True

    async def __call__(self) -> bool:
        if self._answer and self._clock() - self._at >= self._seconds:
            self._at = self._clock()
            with suppress(StoreUnavailableError):  # the answer is that of before
                self._answer = await self._question()
        return self._answer


class Followers:
    """Followers of jobs. They belong to one event loop."""

    ALLOWED_SECONDS: ClassVar[float] = 5.0  # between two questions whether one may go on following

    def __init__(
        self, is_closing: Callable[[], bool] = lambda: False, *, pause: float = TURN_SECONDS
    ) -> None:
        """Serve those who follow jobs.

        Args:
            is_closing: tells whether the service is about to end, which ends all streams.
            pause: between two looks at the jobs that are followed [s].
        """
        self._pause = pause
        self._is_closing = is_closing
        self._followed: dict[str, _Followed] = {}
        self._task: asyncio.Task[None] | None = None

    async def events(
        self, jobs: Jobs, job_id: str, is_allowed: Question = _always
    ) -> AsyncGenerator[ServerSentEvent]:
        """Yield `progress` events while a job goes on, then one `end` event with its final state.

        Args:
            jobs: those of its kind.
            job_id: the job.
            is_allowed: asked from time to time; the stream ends once it says no.

        Raises:
            Exception: a look at the jobs failed, not because the database is away.
        """
        followed = self._followed.setdefault(job_id, _Followed(jobs))
        followed.followers += 1
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._look())
        task, told = self._task, None
        may_follow = _NowAndThen(is_allowed, self.ALLOWED_SECONDS)
        try:
            while await may_follow():
                if followed.news is not None and followed.news is not told:
                    told = followed.news
                    yield told
                elif followed.over:
                    break
                else:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(self.ALLOWED_SECONDS):
                            await followed.changed.wait()
        finally:
            followed.followers -= 1
            if followed.followers == 0 and self._followed.get(job_id) is followed:
                del self._followed[job_id]
        if task.done():
            await task

    async def wait(self, jobs: Jobs, job_id: str, seconds: float) -> None:
        """Return when a job has ended, after some seconds, or when the service is about to end."""
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds), aclosing(self.events(jobs, job_id)) as events:
                async for _ in events:
                    pass

    async def _look(self) -> None:
        """Look at the jobs until no one follows any."""
        clock = asyncio.get_running_loop().time
        try:
            while self._followed and not self._is_closing():
                began = clock()
                followed = {job_id: each for job_id, each in self._followed.items() if not each.over}
                with suppress(StoreUnavailableError):  # however long the database is away
                    for job_id, news in (await run_in_threadpool(_looked, followed)).items():
                        followed[job_id].tell(news)
                await asyncio.sleep(max(self._pause, _PAUSE_PER_LOOK * (clock() - began)))
        finally:
            left, self._followed = self._followed, {}
            for each in left.values():
                each.tell(None)


def _looked(followed: Mapping[str, _Followed]) -> dict[str, ServerSentEvent | None]:
    """Look at jobs, with one query for all of a kind."""
    kinds: dict[Jobs, list[str]] = {}
    for job_id, each in followed.items():
        kinds.setdefault(each.jobs, []).append(job_id)
    statuses = {
        job_id: at for jobs, ids in kinds.items() for job_id, at in jobs.records.statuses(ids).items()
    }
    return {job_id: each.look(job_id, statuses.get(job_id)) for job_id, each in followed.items()}


def _at(status: JobStatus, job: Job) -> Job:
    progress = job.progress and job.progress.model_copy(update={"done": status.done})
    return job.model_copy(update={"state": status.state, "progress": progress})


def _event(name: str, job: Job) -> ServerSentEvent:
    return ServerSentEvent(event=name, raw_data=job.model_dump_json(include={"id", "state", "progress"}))
