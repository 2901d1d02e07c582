"""The routes of every kind of job, made of its declaration."""

from __future__ import annotations

import inspect
from collections.abc import AsyncIterator, Callable, Mapping
from functools import cache
from typing import Annotated, Any, TypeVar

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import EventSourceResponse, ServerSentEvent

from jointstiff.schemas.fields import Message, Page
from jointstiff.schemas.job import Requester
from jointstiff.schemas.query import JobQuery, WaitQuery
from jointstiff.service.api.access import OPERATOR, VIEWER, RequesterOf, asked_of
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.events import Followers
from jointstiff.service.api.examples import shown
from jointstiff.service.api.gate import Gate
from jointstiff.service.api.parts import (
    LOCATION,
    PartsOf,
    accepted,
    add_deletion,
    created,
    json_response,
    problems,
)
from jointstiff.service.jobs.life import Jobs
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.problems.errors import NotFoundError, StoreUnavailableError
from jointstiff.service.store.jobs import OPEN_STATES
from jointstiff.service.store.records import JobRecord

JobId = Annotated[str, Path(max_length=64)]
AskedBy = Annotated[Requester | None, RequesterOf]
Wait = Annotated[WaitQuery, Query()]
Route = TypeVar("Route", bound=Callable[..., Any])


def _work(request: Request) -> CapacityLimiter:
    work: CapacityLimiter = request.app.state.work
    return work


Work = Annotated[CapacityLimiter, Depends(_work)]


def _followers(request: Request) -> Followers:
    followers: Followers = request.app.state.followers
    return followers


FollowersOf = Annotated[Followers, Depends(_followers)]


@cache
def job_routes(kind: AnyKind) -> APIRouter:
    """Return the routes of a kind: create, list, get, delete and restore; follow and cancel if stepped.

    What is posted as a form has a route of its own to create it.
    """
    router = APIRouter(prefix=f"/v1/{kind.collection}", tags=[kind.collection], route_class=BodyRoute)
    identifier = Annotated[str, Path(alias=f"{kind.name}_id", max_length=64)]

    def jobs_of(parts: PartsOf) -> Jobs:
        return parts.jobs[kind.name]

    jobs = Annotated[Jobs, Depends(jobs_of)]
    types = {"jobs": jobs, "job_id": identifier}
    if not kind.is_form:
        _add_create(router, kind, types)
    _add_list(router, kind, types)
    _add_get(router, kind, types)
    add_deletion(
        router,
        f"/{{{kind.name}_id}}",
        kind.name,
        kind.message,
        delete=lambda parts, job_id: parts.jobs[kind.name].delete(job_id),
        restore=lambda parts, job_id: kind.answered(parts.jobs[kind.name].restore(job_id)),
        description=f"Delete a {kind.name}. Resources made from it are kept. It can be restored for 30 days. "
        "Cancel an unfinished one first.",
    )
    if kind.stepped:
        _add_stepped(router, kind, types)
    return router


def _typed(types: Mapping[str, Any]) -> Callable[[Route], Route]:
    """Give a route's parameters the types of its kind, which FastAPI reads."""

    def typed(route: Route) -> Route:
        own = inspect.get_annotations(route)
        route.__annotations__ = {name: types.get(name, found) for name, found in own.items()}
        return route

    return typed


def _add_create(router: APIRouter, kind: AnyKind, types: Mapping[str, Any]) -> None:
    body = Annotated[kind.request, shown(kind.examples)]  # type: ignore[name-defined]

    async def create_stepped(
        work: Work,
        jobs: Jobs,
        body: Message,
        key: Key,
        asked_by: AskedBy,
        query: Wait,
        followers: FollowersOf,
    ) -> Response:
        record = await run_sync(jobs.create, body, key, asked_by, limiter=work)
        return await answer(jobs, record, query.wait, followers)

    async def create_quick(work: Work, jobs: Jobs, body: Message, key: Key, asked_by: AskedBy) -> Response:
        record = await run_sync(jobs.create, body, key, asked_by, limiter=work)
        return created(kind.collection, record.id, kind.answered(record.document))

    stepped = kind.stepped
    later = accepted(kind.message) | problems(429) if stepped else {}
    router.post(
        "",
        name=f"create_{kind.name}",
        dependencies=[OPERATOR],
        description=kind.description,
        status_code=201,
        response_model=kind.message,
        responses=LOCATION | later | problems(400, 413, 415, 422, 507),
    )(_typed({**types, "body": body})(create_stepped if stepped else create_quick))


def _add_list(router: APIRouter, kind: AnyKind, types: Mapping[str, Any]) -> None:
    @router.get(
        "",
        name=f"list_{kind.collection}",
        dependencies=[VIEWER],
        description=f"List {kind.collection} without their results, newest first.",
        response_model=Page[kind.summary],  # type: ignore[name-defined]
        responses=problems(422),
    )
    @_typed({**types, "query": Annotated[kind.query, Query()]})
    def page(jobs: Jobs, query: JobQuery) -> Page[Any]:
        return jobs.page(query)


def _add_get(router: APIRouter, kind: AnyKind, types: Mapping[str, Any]) -> None:
    @router.get(
        f"/{{{kind.name}_id}}",
        name=f"get_{kind.name}",
        dependencies=[VIEWER],
        description=f"Get a {kind.name}: request, state, result and provenance. Once finished, it never "
        "changes.",
        response_model=kind.message,
        responses=problems(404, 422),
    )
    @_typed(types)
    def get(jobs: Jobs, job_id: str) -> Response:
        return json_response(kind.answered(jobs.document(job_id)))


def _add_stepped(router: APIRouter, kind: AnyKind, types: Mapping[str, Any]) -> None:
    async def events_of(
        request: Request, followers: FollowersOf, jobs: Jobs, job_id: str
    ) -> AsyncIterator[ServerSentEvent]:
        # Before the stream begins: a job that is not there is a 404, not an event.
        await run_in_threadpool(jobs.status, job_id)
        await run_in_threadpool(jobs.deletions.refuse_deleted, job_id)
        gate: Gate = request.app.state.gate
        return followers.events(jobs, job_id, lambda: gate.still_opens(request, asked_of(request).key))

    @router.get(
        f"/{{{kind.name}_id}}/events",
        name=f"follow_{kind.name}",
        dependencies=[VIEWER],
        description=f"Follow a {kind.name}: `progress` events with state and progress, then one `end` event.",
        response_class=EventSourceResponse,
        responses=problems(404, 422),
    )
    @_typed({"events": Annotated[AsyncIterator[ServerSentEvent], Depends(_typed(types)(events_of))]})
    async def follow(events: AsyncIterator[ServerSentEvent]) -> AsyncIterator[ServerSentEvent]:
        async for event in events:
            yield event

    @router.post(
        f"/{{{kind.name}_id}}/cancel",
        name=f"cancel_{kind.name}",
        dependencies=[OPERATOR],
        description=f"Cancel a {kind.name}. Its workers stop at their next step; a finished one "
        "stays as it is.",
        response_model=kind.message,
        responses=problems(404, 422),
    )
    @_typed(types)
    def cancel(jobs: Jobs, job_id: str) -> Response:
        return json_response(kind.answered(jobs.cancel(job_id).model_dump_json()))


async def answer(jobs: Jobs, record: JobRecord, wait: float, followers: Followers) -> Response:
    """Answer with a new job: 201 if it ends within `wait` seconds, else 202 with the job as it is.

    Args:
        jobs: those of its kind.
        record: the job.
        wait: in seconds.
        followers: those who follow jobs.
    """
    collection, answered = jobs.kind.collection, jobs.kind.answered
    if record.state not in OPEN_STATES:
        return created(collection, record.id, answered(record.document))
    try:
        if wait:
            await followers.wait(jobs, record.id, wait)
        job = await run_in_threadpool(jobs.current, record.id)
    except (StoreUnavailableError, NotFoundError):  # away, or deleted meanwhile; but it was stored
        return created(collection, record.id, answered(record.document), 202)
    text = answered(job.model_dump_json())
    return created(collection, job.id, text, 202 if job.state in OPEN_STATES else 201)
