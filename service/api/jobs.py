"""Jobs over HTTP: the post of each kind, made of its declaration; and what jobs of all kinds share.

Their progress is sent as events: one task looks at all jobs that are followed.

Annotations are evaluated where they stand: those of a kind's routes name the messages of that kind.
"""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Mapping
from contextlib import aclosing, suppress
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final, Literal, Union

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import Discriminator, Field, create_model

from jointstiff.schemas.fields import Page
from jointstiff.schemas.job import Job, JobChange, JobSummary
from jointstiff.schemas.query import FileQuery, JobQuery, WaitQuery
from jointstiff.service.api import answers
from jointstiff.service.api.bodies import BodyRoute, Key, large_bodies, shown
from jointstiff.service.api.description import problems
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.files import FILES, FILES_DESCRIPTION, content_of, is_stored
from jointstiff.service.jobs import Jobs
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import NotFoundError, StoreUnavailableError
from jointstiff.service.security.access import OPERATOR, VIEWER, Gate, KeyOf, requester_of
from jointstiff.service.store.jobs import JOB, JobStatus
from jointstiff.service.store.tables import OPEN_STATES, AccessKey, JobRecord

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
        """Return the event with the progress of the job; None if it is gone."""
        if status is None:
            return None
        is_current = self.job is None or not status.is_active
        if is_current:
            try:
                self.job = self.jobs.current(job_id)
            except NotFoundError:  # deleted meanwhile
                is_current = False
        if self.job is None:
            return None
        if status.is_active:
            return _event("progress", _event_at(status, self.job))
        return _event("end", self.job if is_current else _event_at(status, self.job))

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
            is_allowed: called from time to time; the stream ends once it is false.

        Raises:
            Exception: a look at the jobs failed, not because the database is away.
        """
        followed = self._followed.setdefault(job_id, _Followed(jobs))
        followed.followers += 1
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._poll())
        task, sent, clock = self._task, None, asyncio.get_running_loop().time
        asked_at, may_follow = clock(), True
        try:
            while may_follow:
                if followed.news is not None and followed.news is not sent:
                    sent = followed.news
                    yield sent
                elif followed.over:
                    break
                else:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(self.ALLOWED_SECONDS):
                            await followed.changed.wait()
                if clock() - asked_at >= self.ALLOWED_SECONDS:
                    asked_at = clock()
                    with suppress(StoreUnavailableError):  # the answer is that of before
                        may_follow = await is_allowed()
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

    async def _poll(self) -> None:
        """Look at the jobs until no one follows any."""
        clock = asyncio.get_running_loop().time
        try:
            while self._followed and not self._is_closing():
                began = clock()
                followed = {job_id: each for job_id, each in self._followed.items() if not each.over}
                with suppress(StoreUnavailableError):  # however long the database is away
                    for job_id, news in (await run_in_threadpool(_look_at_jobs, followed)).items():
                        followed[job_id].tell(news)
                await asyncio.sleep(max(self._pause, _PAUSE_PER_LOOK * (clock() - began)))
        finally:
            left, self._followed = self._followed, {}
            for each in left.values():
                each.tell(None)


def _look_at_jobs(followed: Mapping[str, _Followed]) -> dict[str, ServerSentEvent | None]:
    """Look at jobs, with one query for all of a kind."""
    kinds: dict[Jobs, list[str]] = {}
    for job_id, each in followed.items():
        kinds.setdefault(each.jobs, []).append(job_id)
    statuses = {
        job_id: at for jobs, ids in kinds.items() for job_id, at in jobs.records.statuses(ids).items()
    }
    return {job_id: each.look(job_id, statuses.get(job_id)) for job_id, each in followed.items()}


def _event_at(status: JobStatus, job: Job) -> Job:
    progress = job.progress and job.progress.model_copy(update={"done": status.done})
    return job.model_copy(update={"state": status.state, "progress": progress})


def _event(name: str, job: Job) -> ServerSentEvent:
    return ServerSentEvent(event=name, raw_data=job.model_dump_json(include={"id", "state", "progress"}))


JobId = Annotated[str, Path(max_length=64, description="Id of the job.")]
AskedBy = Annotated[AccessKey | None, KeyOf]
Wait = Annotated[WaitQuery, Query()]
ANY_JOB: Final[Any] = Annotated[
    Union[tuple(kind.message for kind in KINDS)],  # noqa: UP007 - of types known at run time
    Discriminator("kind"),
]
"""A job of any kind."""


class JobRoute(BodyRoute):
    """Route that stores a job. Of one that the child has stored the service waits for the end."""

    async def after_child(self, request: Request, response: Response) -> Response:
        """Wait for a job that goes on: the child waits for no worker."""
        if response.status_code != 202:
            return response
        wait = float(request.query_params.get("wait", WaitQuery().wait))  # a number: it was answered 202
        job_id = response.headers["Location"].rpartition("/")[2]  # the body may be compressed
        jobs = await run_in_threadpool(request.app.state.parts.jobs_of, job_id)
        record = await run_in_threadpool(jobs.records.get, job_id)
        return await answer(jobs, record, wait, request.app.state.followers)


async def answer(jobs: Jobs, record: JobRecord, wait: float, followers: Followers) -> Response:
    """Answer with a new job: 201 if it ends within `wait` seconds, else 202 with the job as it is."""
    answered = jobs.kind.answered
    if record.state not in OPEN_STATES:
        return answers.created(JOB.collection, record.id, answered(record.document))
    try:
        if wait:
            await followers.wait(jobs, record.id, wait)
        job = await run_in_threadpool(jobs.current, record.id)
    except (StoreUnavailableError, NotFoundError):  # away, or deleted meanwhile; but it was stored
        return answers.created(JOB.collection, record.id, answered(record.document), 202)
    text = answered(job.model_dump_json())
    return answers.created(JOB.collection, job.id, text, 202 if job.state in OPEN_STATES else 201)


class Posted:
    """A post of a job: its requester, and how long the answer waits for its end."""

    def __init__(self, request: Request, parts: answers.PartsOf, asked_by: AskedBy, query: Wait) -> None:
        self.request, self.parts, self.by, self.wait = request, parts, asked_by, query.wait

    async def answer(
        self, kind: str, create: Callable[[Jobs], JobRecord], turns: CapacityLimiter | None = None
    ) -> Response:
        """Create a job of a kind in its turn; answer with it as `answer` does."""
        jobs, state = self.parts.jobs[kind], self.request.app.state
        record = await run_sync(create, jobs, limiter=turns or state.work)
        return await answer(jobs, record, self.wait, state.followers)


PostOf = Annotated[Posted, Depends()]


def post_of(kind: AnyKind) -> APIRouter:
    """Return the route by which jobs of a kind are posted; not for one that is posted as a form."""
    router = APIRouter(tags=[kind.collection], route_class=JobRoute)

    @router.post(
        f"/v1/{kind.collection}",
        name=f"create_{kind.name}",
        dependencies=[OPERATOR],
        description=kind.description,
        status_code=201,
        response_model=kind.message,
        responses=answers.accepted(kind.message),
    )
    async def create(
        posted: PostOf,
        body: Annotated[kind.request, shown(kind.examples)],  # type: ignore[name-defined]
        key: Key,
    ) -> Response:
        return await posted.answer(kind.name, lambda jobs: jobs.create(body, key, posted.by))

    return router


router = APIRouter(prefix="/v1/jobs", tags=["jobs"], route_class=BodyRoute)


_Kind: Final[Any] = Literal[tuple(kind.name for kind in KINDS)]


class _Listing(JobQuery):
    kind: _Kind | None = Field(default=None, description="Filter by kind.")


_Listed = create_model("JobSummary", __base__=JobSummary, kind=(_Kind, ...))


@router.get("", dependencies=[VIEWER], response_model=Page[_Listed])
def list_jobs(parts: answers.PartsOf, query: Annotated[_Listing, Query()]) -> Page[JobSummary]:
    """List jobs of all kinds, or of one, without their results."""
    return parts.page(query)


@router.get("/{job_id}", dependencies=[VIEWER], response_model=ANY_JOB, responses=answers.NOT_MODIFIED)
def get_job(request: Request, parts: answers.PartsOf, job_id: JobId) -> Response:
    """Get a job: request, state, result and provenance. Once it has ended, it never changes."""
    return answers.unchanging(request, parts.job(job_id))


@router.patch("/{job_id}", dependencies=[OPERATOR], response_model=ANY_JOB)
def change_job(
    parts: answers.PartsOf, job_id: JobId, body: Annotated[JobChange, shown(EXAMPLES["job_changes"])]
) -> Response:
    """Cancel, delete or restore a job of any kind, and get it.

    The workers of a cancelled job stop at their next step; one that has ended stays as it is. A deleted job
    can be restored for 30 days; resources made from it are kept. Cancel an unfinished one first.
    """
    jobs = parts.jobs_of(job_id)
    if body.deleted is False:
        jobs.records.restore(job_id)
    if body.cancelled and jobs.records.is_active(job_id):
        jobs.cancel(job_id)
    if body.deleted:
        jobs.records.delete(job_id)
    return answers.json_response(parts.job(job_id, hidden=body.deleted is True))


async def _events(request: Request, parts: answers.PartsOf, job_id: JobId) -> AsyncIterator[ServerSentEvent]:
    # Before the stream begins: a job that is not there is a 404, not an event.
    jobs = await run_in_threadpool(parts.jobs_of, job_id)
    await run_in_threadpool(jobs.records.refuse_deleted, job_id)
    gate: Gate = request.app.state.gate
    followers: Followers = request.app.state.followers
    return followers.events(jobs, job_id, lambda: gate.still_opens(request, requester_of(request).key))


@router.get("/{job_id}/events", dependencies=[VIEWER], response_class=EventSourceResponse)
async def follow_job(
    events: Annotated[AsyncIterator[ServerSentEvent], Depends(_events)],
) -> AsyncIterator[ServerSentEvent]:
    """Follow a job of any kind: `progress` events with state and progress, then one `end` event."""
    async for event in events:
        yield event


@router.get(
    "/{job_id}/files/{name}",
    dependencies=[VIEWER],
    name="get_job_file",
    description=FILES_DESCRIPTION,
    response_class=Response,
    responses=FILES | answers.NOT_MODIFIED | problems(409),
)
async def get_job_file(
    request: Request,
    parts: answers.PartsOf,
    job_id: JobId,
    name: Annotated[str, Path(max_length=200)],
    query: Annotated[FileQuery, Query()],
) -> Response:
    """Get a file of a job."""
    jobs = await run_in_threadpool(parts.jobs_of, job_id)
    # Computation may take seconds: it is queued, so that other requests are answered meanwhile.
    turns = None if is_stored(jobs.kind, name) else large_bodies(request)
    content = await run_sync(content_of, request, parts, jobs, job_id, name, query, limiter=turns)
    return answers.unchanging(request, content.body, content.media_type, content.headers)
