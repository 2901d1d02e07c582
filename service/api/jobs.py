"""What the routes of all kinds of jobs do: answer a post, follow a job."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import ServerSentEvent
from pydantic import BaseModel

from jointstiff.schemas.query import WaitQuery
from jointstiff.service.api.events import Followers
from jointstiff.service.api.parts import created, json_response
from jointstiff.service.jobs import AnyJobs
from jointstiff.service.store import OPEN_STATES, IdempotencyKey, NotFoundError, StoreUnavailableError

__all__ = ["FollowersOf", "JobId", "Wait", "answer", "delete", "follow", "restore"]

JobId = Annotated[str, Path(max_length=64)]

Wait = Annotated[WaitQuery, Query()]


def _followers(request: Request) -> Followers:
    followers: Followers = request.app.state.followers
    return followers


FollowersOf = Annotated[Followers, Depends(_followers)]


async def answer(
    jobs: AnyJobs,
    collection: str,
    body: BaseModel,
    key: IdempotencyKey | None,
    wait: float,
    followers: Followers,
) -> Response:
    """Create a job; 201 with the job if it ends within `wait` seconds, else 202 with the job as it is.

    Args:
        jobs: of its kind.
        collection: their name in addresses.
        body: what is asked for.
        key: the idempotency key that came with it.
        wait: in seconds.
        followers: those who follow jobs.

    Raises:
        RequestError: it cannot be done, and nothing is stored.
    """
    record = await run_in_threadpool(jobs.create, body, key)
    if record.state not in OPEN_STATES:
        return created(collection, record.id, record.document)
    try:
        if wait:
            await followers.wait(jobs, record.id, wait)
        job = await run_in_threadpool(jobs.current, record.id)
    except (StoreUnavailableError, NotFoundError):  # away, or deleted meanwhile; but it was stored
        return created(collection, record.id, record.document, 202)
    return created(collection, job.id, job.model_dump_json(), 202 if job.state in OPEN_STATES else 201)


async def follow(followers: Followers, jobs: AnyJobs, job_id: str) -> AsyncIterator[ServerSentEvent]:
    """Return the events of a job.

    Raises:
        NotFoundError: there is no such job.
    """
    await run_in_threadpool(jobs.standing, job_id)  # a job that is not there is a 404, not an event
    await run_in_threadpool(jobs.deletions.refuse_deleted, job_id)
    return followers.events(jobs, job_id)


def delete(jobs: AnyJobs, job_id: str) -> Response:
    """Hide a job; 204, also if it is hidden already.

    Raises:
        NotFoundError: there is no such job.
        NotEndedError: it goes on (409).
    """
    jobs.delete(job_id)
    return Response(status_code=204)


def restore(jobs: AnyJobs, job_id: str) -> Response:
    """Bring a job back; 200 with the job, also if it was not hidden.

    Raises:
        NotFoundError: there is no such job, or it has been removed for good.
    """
    return json_response(jobs.restore(job_id))
