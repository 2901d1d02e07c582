"""What the routes of all kinds of jobs do: answer a post, follow a job."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from jointstiff.schemas.query import WaitQuery
from jointstiff.service.api.bodies import Body
from jointstiff.service.api.events import wait_for_end
from jointstiff.service.api.parts import created, json_response
from jointstiff.service.jobs import AnyJobs
from jointstiff.service.store import OPEN_STATES, NotFoundError, StoreUnavailableError

__all__ = ["Closing", "JobId", "Wait", "answer", "delete", "follow", "restore"]

JobId = Annotated[str, Path(max_length=64)]

Wait = Annotated[WaitQuery, Query()]


def _closing(request: Request) -> Callable[[], bool]:
    tells: Callable[[], bool] = request.app.state.is_closing
    return tells


Closing = Annotated[Callable[[], bool], Depends(_closing)]


async def answer(
    jobs: AnyJobs, collection: str, body: Body[Any], wait: float, is_closing: Callable[[], bool]
) -> Response:
    """Create a job; 201 with the job if it ends within `wait` seconds, else 202 with the job as it is.

    Args:
        jobs: of its kind.
        collection: their name in addresses.
        body: what is asked for.
        wait: in seconds.
        is_closing: tells whether the service is about to end, which ends the wait.

    Raises:
        RequestError: it cannot be done, and nothing is stored.
    """
    record = await run_in_threadpool(jobs.create, body.message, body.key)
    if record.state not in OPEN_STATES:
        return created(collection, record.id, record.document)
    try:
        await wait_for_end(jobs, record.id, wait, is_closing)
        job = await run_in_threadpool(jobs.current, record.id)
    except (StoreUnavailableError, NotFoundError):  # away, or deleted meanwhile; but it was stored
        return created(collection, record.id, record.document, 202)
    return created(collection, job.id, job.model_dump_json(), 202 if job.state in OPEN_STATES else 201)


async def follow(request: Request, jobs: AnyJobs, job_id: str) -> StreamingResponse:
    """The events of a job.

    Raises:
        NotFoundError: there is no such job.
    """
    await run_in_threadpool(jobs.standing, job_id)  # a job that is not there is a 404, not an event
    await run_in_threadpool(jobs.deletions.refuse_deleted, job_id)
    return StreamingResponse(
        request.app.state.watches.events(jobs, job_id),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store"},
    )


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
