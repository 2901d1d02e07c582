"""Progress of jobs as server-sent events: one look at a job serves all who follow it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Final, TypeVar

from fastapi.concurrency import run_in_threadpool

from jointstiff.service.jobs import AnyJobs, Job
from jointstiff.service.store import NotFoundError, Standing, StoreUnavailableError

__all__ = ["Watches", "wait_for_end"]

_LOOK_SECONDS: Final = 0.1
_LOOK_SHARE: Final = 0.05
"""Between two looks at a job that is waited for: of the time waited so far, if that is longer. Hundreds who
wait a minute would otherwise keep all threads busy."""
_LONGEST_LOOK: Final = 2.0
"""And no longer than this, so that who waits is answered before a service that is told to end has ended."""
_EVENT_SECONDS: Final = 0.2
"""Between two looks at a job that is followed."""
_LOOKS_A_SECOND: Final = 200
"""At all jobs that are followed: of more than forty, each is looked at less often."""
_QUIET_LOOKS: Final = 75
"""After so many looks without news a comment is sent, so that proxies keep the connection."""
_AT_A_TIME: Final = 8
"""Followers that are told between two turns of the loop: hundreds must not keep other clients waiting."""

Answer = TypeVar("Answer")


async def wait_for_end(jobs: AnyJobs, job_id: str, wait: float, is_closing: Callable[[], bool]) -> None:
    """Return when a job has ended, after `wait` seconds, or soon after the service was told to end."""
    clock = asyncio.get_running_loop().time
    began = clock()
    while (await run_in_threadpool(jobs.standing, job_id)).goes_on and (waited := clock() - began) < wait:
        if is_closing():
            return
        await asyncio.sleep(min(max(_LOOK_SECONDS, _LOOK_SHARE * waited), _LONGEST_LOOK, wait - waited))


@dataclass(frozen=True, eq=False)
class _News:
    """An event, or a comment, and whether it is the last one."""

    text: str
    last: bool = False


class _Watch:
    """One task that looks at a job while someone follows it."""

    def __init__(self, jobs: AnyJobs, job_id: str, pause: Callable[[], float]) -> None:
        self.followers = 0
        self._pause = pause
        self.news: _News | None = None
        self._waiting: list[asyncio.Future[None]] = []
        self._task = asyncio.create_task(self._look(jobs, job_id))

    async def changed(self) -> None:
        """Wait for other news.

        Raises:
            Exception: whatever ended the task that looks for them.
        """
        if self._task.done():
            await self._task
        told = asyncio.get_running_loop().create_future()
        self._waiting.append(told)
        await told

    def stop(self) -> None:
        """No one follows any more."""
        self._task.cancel()

    async def _look(self, jobs: AnyJobs, job_id: str) -> None:
        try:
            await self._follow(jobs, job_id)
        except Exception as error:
            for told in self._waiting:
                if not told.done():
                    told.set_exception(error)
            raise

    async def _follow(self, jobs: AnyJobs, job_id: str) -> None:
        job = await _asked(jobs.current, job_id)
        standing, quiet = Standing(job.state, job.progress.done if job.progress else 0), 0
        while standing.goes_on:
            event = _event("progress", _at(standing, job))
            quiet = quiet + 1 if self.news and self.news.text == event else 0
            if quiet == 0:
                await self._tell(_News(event))
            elif quiet % _QUIET_LOOKS == 0:
                await self._tell(_News(": still running\n\n"))
            await asyncio.sleep(self._pause())
            standing = await _asked(jobs.standing, job_id)
        try:
            job = await _asked(jobs.current, job_id)
        except NotFoundError:  # deleted as soon as it had ended
            job = _at(standing, job)
        await self._tell(_News(_event("end", job), last=True))

    async def _tell(self, news: _News) -> None:
        self.news, waiting, self._waiting = news, self._waiting, []
        for number, told in enumerate(waiting, start=1):
            if not told.done():  # it may have left
                told.set_result(None)
            if number % _AT_A_TIME == 0:
                await asyncio.sleep(0)


class Watches:
    """The jobs that someone follows. Belongs to one event loop."""

    def __init__(self) -> None:
        self._watches: dict[str, _Watch] = {}

    async def events(self, jobs: AnyJobs, job_id: str) -> AsyncIterator[str]:
        """`progress` events while a job goes on, then one `end` event with its final state."""
        watch = self._watches.get(job_id)
        if watch is None:
            watch = self._watches[job_id] = _Watch(jobs, job_id, self._pause)
        watch.followers += 1
        try:
            told: _News | None = None
            while told is None or not told.last:
                if watch.news is None or watch.news is told:
                    await watch.changed()
                else:
                    told = watch.news
                    yield told.text
        finally:
            watch.followers -= 1
            if watch.followers == 0:
                watch.stop()
                self._watches.pop(job_id, None)

    def _pause(self) -> float:
        return max(_EVENT_SECONDS, len(self._watches) / _LOOKS_A_SECOND)


def _at(standing: Standing, job: Job) -> Job:
    progress = job.progress and job.progress.model_copy(update={"done": standing.done})
    return job.model_copy(update={"state": standing.state, "progress": progress})


async def _asked(ask: Callable[[str], Answer], job_id: str) -> Answer:
    """What is asked of a job, however long the database is away."""
    while True:
        try:
            return await run_in_threadpool(ask, job_id)
        except StoreUnavailableError:
            await asyncio.sleep(_EVENT_SECONDS)


def _event(name: str, job: Job) -> str:
    data = job.model_dump_json(include={"id", "state", "progress"})
    return f"event: {name}\ndata: {data}\n\n"
