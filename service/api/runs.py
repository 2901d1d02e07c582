"""Runs: identifications of a measurement set."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from jointstiff.schemas.fields import Page
from jointstiff.schemas.query import RunQuery
from jointstiff.schemas.run import Run, RunRequest, RunSummary
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.examples import RUNS, shown
from jointstiff.service.api.jobs import FollowersOf, JobId, Wait, answer, delete, follow, restore
from jointstiff.service.api.parts import (
    DELETED,
    LOCATION,
    PartsOf,
    accepted,
    json_response,
    problems,
)
from jointstiff.service.store import RunEntry

__all__ = ["router"]

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=BodyRoute)


@router.post(
    "",
    status_code=201,
    response_model=Run,
    responses=LOCATION | accepted(Run) | problems(400, 413, 415, 422, 429),
)
async def create_run(
    parts: PartsOf,
    body: Annotated[RunRequest, shown(RUNS)],
    key: Key,
    query: Wait,
    followers: FollowersOf,
) -> Response:
    """Identify the joint stiffnesses, and store the result with its provenance.

    Answers 201 with the finished run, or, if it resamples and takes longer than `wait` seconds, 202 with the
    run as it is and its address. A method that the readings cannot support is refused, and nothing is
    stored. Any other failure is a stored run in state `failed` that says why.
    """
    return await answer(parts.runs, "runs", body, key, query.wait, followers)


@router.get("", response_model=Page[RunSummary], responses=problems(422))
def list_runs(parts: PartsOf, query: Annotated[RunQuery, Query()]) -> Page[RunSummary]:
    """List runs without their results, newest first."""
    page = parts.store.page(RunEntry, limit=query.limit, cursor=query.cursor, filters=query.filters())
    items = [RunSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{run_id}", response_model=Run, responses=problems(404, 422))
def get_run(parts: PartsOf, run_id: JobId) -> Response:
    """One run with its request, progress, result and provenance. Once ended it never changes."""
    return json_response(parts.runs.document(run_id))


async def _events(followers: FollowersOf, parts: PartsOf, run_id: JobId) -> AsyncIterator[ServerSentEvent]:
    return await follow(followers, parts.runs, run_id)


@router.get("/{run_id}/events", response_class=EventSourceResponse, responses=problems(404, 422))
async def follow_run(
    events: Annotated[AsyncIterator[ServerSentEvent], Depends(_events)],
) -> AsyncIterator[ServerSentEvent]:
    """Follow a run: `progress` events with its state and progress, then one `end` event."""
    async for event in events:
        yield event


@router.post("/{run_id}/cancel", response_model=Run, responses=problems(404, 422))
def cancel_run(parts: PartsOf, run_id: JobId) -> Response:
    """End a run where it stands. Its workers stop at their next step; a run that has ended stays as it is."""
    return json_response(parts.runs.cancel(run_id).model_dump_json())


@router.delete(
    "/{run_id}", status_code=204, response_class=Response, responses=DELETED | problems(404, 409, 422)
)
def delete_run(parts: PartsOf, run_id: JobId) -> Response:
    """Delete a run; one that goes on must be cancelled first. For 30 days it can be restored."""
    return delete(parts.runs, run_id)


@router.post("/{run_id}/restore", response_model=Run, responses=problems(404, 422))
def restore_run(parts: PartsOf, run_id: JobId) -> Response:
    """Bring a deleted run back; one that is not deleted stays as it is."""
    return restore(parts.runs, run_id)
