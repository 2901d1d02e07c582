"""Jobs over HTTP: the route that posts jobs, made from the declaration of a kind; and routes of all kinds.

The progress of jobs is sent as events: one task polls all jobs that clients follow.

Annotations are not postponed in this module: the annotations of a kind's route name message classes that only
a local variable refers to.
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
from jointstiff.service.api.bodies import BodyRoute, Key, json_body, limiter_of_large_work
from jointstiff.service.api.description import describe_problems
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.files import FILES, FILES_DESCRIPTION, is_stored_file, make_file
from jointstiff.service.jobs import Jobs
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.problems import NotFoundError, StoreUnavailableError
from jointstiff.service.security.access import OPERATOR, VIEWER, Gate, RequesterKeyDependency, get_requester
from jointstiff.service.store.jobs import JOB, JobStatus
from jointstiff.service.store.tables import OPEN_STATES, AccessKey, JobRecord

POLL_SECONDS: Final = 0.1
"""Pause between two polls of the jobs that are followed [s]."""
_PAUSE_PER_POLL_TIME: Final = 4
"""Least pause, as a multiple of the last poll's duration: polls take at most a fifth of the time."""


@dataclass(eq=False)
class _FollowedJob:
    """Job that clients follow, and its latest event."""

    jobs: Jobs  # all jobs of the same kind
    followers: int = 0  # number of clients that follow the job
    job: Job | None = None  # the job as it was last read from the store
    done: int = 0  # units of work at the last poll
    event: ServerSentEvent | None = None  # the latest event
    has_ended: bool = False  # no further event comes
    # set when `event` or `has_ended` changes, which wakes the waiting streams; then replaced by a new one
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    def make_event(self, job_id: str, status: JobStatus | None) -> ServerSentEvent | None:
        """Return the event for a job's present status; None if the job no longer exists.

        The whole job is read from the store only at first, when it has ended, and when it has begun anew.
        """
        if status is None:
            return None
        has_fallen = status.done < self.done
        self.done = status.done
        is_read = self.job is None or has_fallen or not status.is_active
        if is_read:
            try:
                self.job = self.jobs.current(job_id)
            except NotFoundError:  # deleted meanwhile
                is_read = False
        if self.job is None:
            return None
        if status.is_active:
            return _make_event("progress", self.jobs.update_progress(self.job, status))
        return _make_event("end", self.job if is_read else self.jobs.update_progress(self.job, status))

    def publish(self, event: ServerSentEvent | None) -> None:
        """Send an event to the streams of the job, unless it equals the last event; None ends the streams."""
        if event is not None and event == self.event:
            return
        self.has_ended = event is None or event.event == "end"
        self.event = event or self.event
        # Streams that wait for this event are woken; their next wait needs a new one.
        self.changed.set()
        self.changed = asyncio.Event()


PermissionCheck = Callable[[], Awaitable[bool]]


async def _is_always_allowed() -> bool:
    """Return True: the client may follow the job for any time."""
    return True


class Followers:
    """Streams of events for clients that follow jobs; all in one event loop, with one polling task."""

    ALLOWED_SECONDS: ClassVar[float] = 5.0  # between two checks whether a client may still follow

    def __init__(
        self, is_closing: Callable[[], bool] = lambda: False, *, pause: float = POLL_SECONDS
    ) -> None:
        """Create an object without followers.

        Args:
            is_closing: function that returns whether the service is about to end, which ends all streams.
            pause: pause between two polls of the jobs that are followed [s].
        """
        self._pause = pause
        self._is_closing = is_closing
        self._followed: dict[str, _FollowedJob] = {}
        self._task: asyncio.Task[None] | None = None

    async def events(
        self, jobs: Jobs, job_id: str, is_allowed: PermissionCheck = _is_always_allowed
    ) -> AsyncGenerator[ServerSentEvent]:
        """Yield `progress` events while a job is queued or runs, then one `end` event with its final state.

        Args:
            jobs: all jobs of the kind of this job.
            job_id: id of the job.
            is_allowed: called every `ALLOWED_SECONDS`; the stream ends when it returns false.

        Raises:
            Exception: polling failed for another reason than an unavailable database.
        """
        followed = self._followed.setdefault(job_id, _FollowedJob(jobs))
        followed.followers += 1
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._poll())
        task, clock = self._task, asyncio.get_running_loop().time
        sent: ServerSentEvent | None = None
        checked_at, may_follow = clock(), True
        try:
            while may_follow:
                if followed.event is not None and followed.event is not sent:
                    sent = followed.event
                    yield sent
                elif followed.has_ended:
                    break
                else:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(self.ALLOWED_SECONDS):
                            await followed.changed.wait()
                if clock() - checked_at >= self.ALLOWED_SECONDS:
                    checked_at = clock()
                    # The former permission holds until the database answers.
                    with suppress(StoreUnavailableError):
                        may_follow = await is_allowed()
        finally:
            followed.followers -= 1
            if followed.followers == 0 and self._followed.get(job_id) is followed:
                del self._followed[job_id]
        if task.done():
            await task  # raises the error of a failed poll

    async def wait(self, jobs: Jobs, job_id: str, seconds: float) -> None:
        """Wait until a job has ended, at most `seconds`, or until the service is about to end."""
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds), aclosing(self.events(jobs, job_id)) as events:
                async for _ in events:
                    pass

    async def _poll(self) -> None:
        """Poll the followed jobs and publish their events, until no job is followed or the service ends."""
        clock = asyncio.get_running_loop().time
        try:
            while self._followed and not self._is_closing():
                started_at = clock()
                followed = {
                    job_id: followed_job
                    for job_id, followed_job in self._followed.items()
                    if not followed_job.has_ended
                }
                # Polling continues, however long the database is not available.
                with suppress(StoreUnavailableError):
                    for job_id, event in (await run_in_threadpool(_read_events, followed)).items():
                        followed[job_id].publish(event)
                await asyncio.sleep(max(self._pause, _PAUSE_PER_POLL_TIME * (clock() - started_at)))
        finally:
            remaining, self._followed = self._followed, {}
            for followed_job in remaining.values():
                followed_job.publish(None)


def _read_events(followed: Mapping[str, _FollowedJob]) -> dict[str, ServerSentEvent | None]:
    """Return the present event of each followed job by the job's id; one query reads all jobs of a kind."""
    ids_by_jobs: dict[Jobs, list[str]] = {}
    for job_id, followed_job in followed.items():
        ids_by_jobs.setdefault(followed_job.jobs, []).append(job_id)
    statuses = {
        job_id: status
        for jobs, ids in ids_by_jobs.items()
        for job_id, status in jobs.records.statuses(ids).items()
    }
    return {
        job_id: followed_job.make_event(job_id, statuses.get(job_id))
        for job_id, followed_job in followed.items()
    }


def _make_event(name: str, job: Job) -> ServerSentEvent:
    """Return a server-sent event with this name that contains id, state and progress of a job."""
    return ServerSentEvent(event=name, raw_data=job.model_dump_json(include={"id", "state", "progress"}))


JobId = Annotated[str, Path(max_length=64, description="Id of the job.")]
RequesterKey = Annotated[AccessKey | None, RequesterKeyDependency]
Wait = Annotated[WaitQuery, Query()]
ANY_JOB: Final[Any] = Annotated[
    Union[tuple(kind.message for kind in (*KINDS, *RETIRED))],  # noqa: UP007 - of types known at run time
    Discriminator("kind"),
]
"""A job of any kind."""


class JobRoute(BodyRoute):
    """Route that stores a job; if the child process has stored it, this process waits for the job's end."""

    async def finish_child_answer(self, request: Request, response: Response) -> Response:
        """Wait for the end of a job that the child process has stored: the child itself does not wait."""
        if response.status_code != 202:
            return response
        # The child process has validated the request, so `wait` is a number.
        wait = float(request.query_params.get("wait", WaitQuery().wait))
        # The id is read from the header, because the body may be compressed.
        job_id = response.headers["Location"].rpartition("/")[2]
        jobs = await run_in_threadpool(request.app.state.parts.jobs_of, job_id)
        record = await run_in_threadpool(jobs.records.get, job_id)
        return await answer_new_job(jobs, record, wait, request.app.state.followers)


async def answer_new_job(jobs: Jobs, record: JobRecord, wait: float, followers: Followers) -> Response:
    """Return the HTTP answer with a new job: status 201 if the job ends within `wait` seconds, else 202."""
    to_public_json = jobs.kind.to_answer
    if record.state not in OPEN_STATES:
        return answers.answer_created(JOB.collection, record.id, to_public_json(record.document))
    try:
        if wait:
            await followers.wait(jobs, record.id, wait)
        job = await run_in_threadpool(jobs.current, record.id)
    except (StoreUnavailableError, NotFoundError):
        # The job was stored before the database became unavailable or the job was deleted: answer as stored.
        return answers.answer_created(JOB.collection, record.id, to_public_json(record.document), 202)
    text = to_public_json(job.model_dump_json())
    return answers.answer_created(JOB.collection, job.id, text, 202 if job.state in OPEN_STATES else 201)


class Posted:
    """Request that posts a job, with its requester, and the time to wait for the job's end [s]."""

    def __init__(
        self, request: Request, parts: answers.InjectedParts, asked_by: RequesterKey, query: Wait
    ) -> None:
        self.request, self.parts, self.by, self.wait = request, parts, asked_by, query.wait

    async def answer(
        self, kind: str, create: Callable[[Jobs], JobRecord], limiter: CapacityLimiter | None = None
    ) -> Response:
        """Create a job of a kind in a thread of the limiter; return 201 if it ends in time, else 202."""
        jobs, state = self.parts.jobs[kind], self.request.app.state
        record = await run_sync(create, jobs, limiter=limiter or state.work)
        return await answer_new_job(jobs, record, self.wait, state.followers)


InjectedPost = Annotated[Posted, Depends()]


def make_post_route(kind: AnyKind) -> APIRouter:
    """Return a router with the route that posts jobs of a kind; for kinds that are posted as JSON."""
    router = APIRouter(tags=[kind.collection], route_class=JobRoute)

    @router.post(
        f"/v1/{kind.collection}",
        name=f"create_{kind.name}",
        dependencies=[OPERATOR],
        description=kind.description,
        status_code=201,
        response_model=kind.message,
        responses=answers.describe_post_responses(kind.message),
    )
    async def create(
        posted: InjectedPost,
        body: Annotated[kind.request, json_body(kind.examples)],  # type: ignore[name-defined]
        key: Key,
    ) -> Response:
        return await posted.answer(kind.name, lambda jobs: jobs.create(body, key, posted.by))

    return router


router = APIRouter(prefix="/v1/jobs", tags=["jobs"], route_class=BodyRoute)


_Kind: Final[Any] = Literal[tuple(kind.name for kind in (*KINDS, *RETIRED))]


class _Listing(JobQuery):
    kind: _Kind | None = Field(default=None, description="Filter by kind.")


_Listed = create_model("JobSummary", __base__=JobSummary, kind=(_Kind, ...))


@router.get("", dependencies=[VIEWER], response_model=Page[_Listed])
def list_jobs(parts: answers.InjectedParts, query: Annotated[_Listing, Query()]) -> Page[JobSummary]:
    """List jobs of all kinds, or of one, without their results."""
    return parts.page(query)


@router.get("/{job_id}", dependencies=[VIEWER], response_model=ANY_JOB, responses=answers.NOT_MODIFIED)
def get_job(request: Request, parts: answers.InjectedParts, job_id: JobId) -> Response:
    """Get a job: request, state, result and provenance. Once it has ended, it never changes."""
    return answers.answer_with_etag(request, parts.job(job_id))


@router.patch("/{job_id}", dependencies=[OPERATOR], response_model=ANY_JOB)
def change_job(
    parts: answers.InjectedParts,
    job_id: JobId,
    body: Annotated[JobChange, json_body(EXAMPLES["job_changes"])],
) -> Response:
    """Cancel, delete or restore a job of any kind, and get it.

    A cancelled job stops at its next step; one that has ended stays as it is. A deleted job
    can be restored for 30 days; resources made from it are kept. Cancel an unfinished job before deletion.
    """
    jobs = parts.jobs_of(job_id)
    if body.deleted is False:
        jobs.records.restore(job_id)
    if body.cancelled and jobs.records.is_active(job_id):
        jobs.cancel(job_id)
    if body.deleted:
        jobs.records.delete(job_id)
    return answers.json_response(parts.job(job_id, hidden=body.deleted is True))


async def _events_of_job(
    request: Request, parts: answers.InjectedParts, job_id: JobId
) -> AsyncIterator[ServerSentEvent]:
    """Return the events of a job, for as long as the requester's key is valid."""
    # Checked before the stream begins, so that a missing job is answered 404 and not by an event.
    jobs = await run_in_threadpool(parts.jobs_of, job_id)
    await run_in_threadpool(jobs.records.refuse_deleted, job_id)
    gate: Gate = request.app.state.gate
    followers: Followers = request.app.state.followers
    return followers.events(jobs, job_id, lambda: gate.may_continue(request, get_requester(request).key))


@router.get("/{job_id}/events", dependencies=[VIEWER], response_class=EventSourceResponse)
async def follow_job(
    events: Annotated[AsyncIterator[ServerSentEvent], Depends(_events_of_job)],
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
    responses=FILES | answers.NOT_MODIFIED | describe_problems(409),
)
async def get_job_file(
    request: Request,
    parts: answers.InjectedParts,
    job_id: JobId,
    name: Annotated[str, Path(max_length=200)],
    query: Annotated[FileQuery, Query()],
) -> Response:
    """Get a file of a job."""
    jobs = await run_in_threadpool(parts.jobs_of, job_id)
    # Computing a file may take seconds: the limiter keeps threads free for other requests.
    limiter = None if is_stored_file(jobs.kind, name) else limiter_of_large_work(request)
    content = await run_sync(make_file, request, parts, jobs, job_id, name, query, limiter=limiter)
    return answers.answer_with_etag(request, content.body, content.media_type, content.headers)
