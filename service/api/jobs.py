"""The routes of jobs: post, list and get of each kind, made of its declaration; and what all jobs share.

Annotations are evaluated where they stand: those of a kind's routes name the messages of that kind.
"""

from collections.abc import AsyncIterator
from typing import Annotated, Any, Final, Union, cast

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import EventSourceResponse, ServerSentEvent

from jointstiff.schemas.fields import Page
from jointstiff.schemas.job import JobChange, Requester
from jointstiff.schemas.query import FileQuery, WaitQuery
from jointstiff.service.api import answers
from jointstiff.service.api.bodies import EXAMPLES, BodyRoute, Key, large_bodies, shown
from jointstiff.service.api.events import Followers
from jointstiff.service.api.files import FILES, FILES_DESCRIPTION, content_of, is_stored
from jointstiff.service.jobs.life import Jobs
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems.errors import NotFoundError, StoreUnavailableError
from jointstiff.service.security.access import OPERATOR, VIEWER, Gate, RequesterOf, asked_of
from jointstiff.service.store.tables import OPEN_STATES, JobRecord

JobId = Annotated[str, Path(max_length=64)]
AskedBy = Annotated[Requester | None, RequesterOf]
Wait = Annotated[WaitQuery, Query()]
ANY_JOB: Final[Any] = Union[tuple(kind.message for kind in KINDS)]  # noqa: UP007 - of types known at run time
"""A job of any kind."""


def _work(request: Request) -> CapacityLimiter:
    return cast("CapacityLimiter", request.app.state.work)


Work = Annotated[CapacityLimiter, Depends(_work)]


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
    collection, answered = jobs.kind.collection, jobs.kind.answered
    if record.state not in OPEN_STATES:
        return answers.created(collection, record.id, answered(record.document))
    try:
        if wait:
            await followers.wait(jobs, record.id, wait)
        job = await run_in_threadpool(jobs.current, record.id)
    except (StoreUnavailableError, NotFoundError):  # away, or deleted meanwhile; but it was stored
        return answers.created(collection, record.id, answered(record.document), 202)
    text = answered(job.model_dump_json())
    return answers.created(collection, job.id, text, 202 if job.state in OPEN_STATES else 201)


def kind_routes(kind: AnyKind) -> APIRouter:
    """Return the routes of a kind: post, list and get. What is posted as a form has a post of its own."""
    router = APIRouter(prefix=f"/v1/{kind.collection}", tags=[kind.collection], route_class=JobRoute)

    if not kind.is_form:

        @router.post(
            "",
            name=f"create_{kind.name}",
            dependencies=[OPERATOR],
            description=kind.description,
            status_code=201,
            response_model=kind.message,
            responses=answers.accepted(kind.message),
        )
        async def create(
            request: Request,
            parts: answers.PartsOf,
            work: Work,
            body: Annotated[kind.request, shown(kind.examples)],  # type: ignore[name-defined]
            key: Key,
            asked_by: AskedBy,
            query: Wait,
        ) -> Response:
            jobs = parts.jobs[kind.name]
            record = await run_sync(jobs.create, body, key, asked_by, limiter=work)
            return await answer(jobs, record, query.wait, request.app.state.followers)

    @router.get(
        "",
        name=f"list_{kind.collection}",
        dependencies=[VIEWER],
        description=f"List {kind.collection} without their results, newest first.",
        response_model=Page[kind.summary],  # type: ignore[name-defined]
        responses=answers.problems(422),
    )
    def page(parts: answers.PartsOf, query: Annotated[kind.query, Query()]) -> Page[Any]:  # type: ignore[name-defined]
        return parts.jobs[kind.name].page(query)

    @router.get(
        f"/{{{kind.name}_id}}",
        name=f"get_{kind.name}",
        dependencies=[VIEWER],
        description=f"Get a {kind.name}: request, state, result and provenance. Once finished, it never "
        "changes.",
        response_model=kind.message,
        responses=answers.NOT_MODIFIED,
    )
    def get(
        request: Request,
        parts: answers.PartsOf,
        job_id: Annotated[str, Path(alias=f"{kind.name}_id", max_length=64)],
    ) -> Response:
        return answers.unchanging(request, kind.answered(parts.jobs[kind.name].document(job_id)))

    return router


router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["jobs"], route_class=BodyRoute)


@router.patch("", dependencies=[OPERATOR], response_model=ANY_JOB)
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
    if body.cancelled and jobs.records.goes_on(job_id):
        jobs.cancel(job_id)
    if body.deleted:
        jobs.records.delete(job_id)
    return answers.json_response(jobs.kind.answered(jobs.document(job_id, hidden=body.deleted is True)))


@router.delete(
    "",
    dependencies=[OPERATOR],
    status_code=204,
    response_class=Response,
    responses=answers.DELETED,
)
def delete_job(parts: answers.PartsOf, job_id: JobId) -> Response:
    """Delete a job of any kind. It can be restored for 30 days. Cancel an unfinished one first."""
    parts.jobs_of(job_id).records.delete(job_id)
    return Response(status_code=204)


async def _events(request: Request, parts: answers.PartsOf, job_id: JobId) -> AsyncIterator[ServerSentEvent]:
    # Before the stream begins: a job that is not there is a 404, not an event.
    jobs = await run_in_threadpool(parts.jobs_of, job_id)
    await run_in_threadpool(jobs.records.refuse_deleted, job_id)
    gate: Gate = request.app.state.gate
    followers: Followers = request.app.state.followers
    return followers.events(jobs, job_id, lambda: gate.still_opens(request, asked_of(request).key))


@router.get("/events", dependencies=[VIEWER], response_class=EventSourceResponse)
async def follow_job(
    events: Annotated[AsyncIterator[ServerSentEvent], Depends(_events)],
) -> AsyncIterator[ServerSentEvent]:
    """Follow a job of any kind: `progress` events with state and progress, then one `end` event."""
    async for event in events:
        yield event


@router.get(
    "/files/{name}",
    dependencies=[VIEWER],
    name="get_job_file",
    description=FILES_DESCRIPTION,
    response_class=Response,
    responses=FILES | answers.NOT_MODIFIED | answers.problems(409),
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
    # What is computed may take seconds: it waits for its turn, and leaves others theirs.
    turns = None if is_stored(jobs.kind, name) else large_bodies(request)
    content = await run_sync(content_of, request, parts, jobs, job_id, name, query, limiter=turns)
    return answers.unchanging(request, content.body, content.media_type, content.headers)
