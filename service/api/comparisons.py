"""Comparisons: several methods on one measurement set, free and constrained."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, HTTPException, Query, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from jointstiff.schemas.comparison import Comparison, ComparisonRequest, ComparisonSummary
from jointstiff.schemas.fields import Page
from jointstiff.schemas.query import ComparisonQuery
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.examples import COMPARISONS, shown
from jointstiff.service.api.jobs import FollowersOf, JobId, Wait, answer, delete, follow, restore
from jointstiff.service.api.parts import (
    DELETED,
    LOCATION,
    PartsOf,
    accepted,
    json_response,
    problems,
)
from jointstiff.service.conversion import comparison_csv
from jointstiff.service.store import ComparisonEntry

__all__ = ["router"]

_TABLE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The table, RFC 4180.", "content": {"text/csv": {}}}
}

router = APIRouter(prefix="/v1/comparisons", tags=["comparisons"], route_class=BodyRoute)


@router.post(
    "",
    status_code=201,
    response_model=Comparison,
    responses=LOCATION | accepted(Comparison) | problems(400, 413, 415, 422, 429),
)
async def create_comparison(
    parts: PartsOf,
    body: Annotated[ComparisonRequest, shown(COMPARISONS)],
    key: Key,
    query: Wait,
    followers: FollowersOf,
) -> Response:
    """Identify by several methods, free and constrained, and store the results side by side.

    The answer is as that to a run: 201 with the finished comparison, or 202 if it resamples and takes longer
    than `wait` seconds. A method that the readings cannot support is an entry with its `error`; the others
    have their numbers.
    """
    return await answer(parts.comparisons, "comparisons", body, key, query.wait, followers)


@router.get("", response_model=Page[ComparisonSummary], responses=problems(422))
def list_comparisons(parts: PartsOf, query: Annotated[ComparisonQuery, Query()]) -> Page[ComparisonSummary]:
    """List comparisons without their results, newest first."""
    page = parts.store.page(ComparisonEntry, limit=query.limit, cursor=query.cursor, filters=query.filters())
    items = [ComparisonSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{comparison_id}", response_model=Comparison, responses=problems(404, 422))
def get_comparison(parts: PartsOf, comparison_id: JobId) -> Response:
    """One comparison with its request, progress, result and provenance. Once ended it never changes."""
    return json_response(parts.comparisons.document(comparison_id))


@router.get(
    "/{comparison_id}/table.csv",
    response_class=Response,
    responses=_TABLE | problems(404, 409, 422),
)
def get_comparison_table(parts: PartsOf, comparison_id: JobId) -> Response:
    """The result as a table for spreadsheets: one row an entry and joint, units in the headers."""
    comparison = parts.comparisons.current(comparison_id)
    if comparison.result is None:
        raise HTTPException(409, f"the comparison has no table, as it is {comparison.state}")
    return Response(
        comparison_csv(comparison.result),
        media_type="text/csv",
        headers={"Content-Disposition": f'attachment; filename="comparison-{comparison.id}.csv"'},
    )


async def _events(
    followers: FollowersOf, parts: PartsOf, comparison_id: JobId
) -> AsyncIterator[ServerSentEvent]:
    return await follow(followers, parts.comparisons, comparison_id)


@router.get("/{comparison_id}/events", response_class=EventSourceResponse, responses=problems(404, 422))
async def follow_comparison(
    events: Annotated[AsyncIterator[ServerSentEvent], Depends(_events)],
) -> AsyncIterator[ServerSentEvent]:
    """Follow a comparison: `progress` events with its state and progress, then one `end` event."""
    async for event in events:
        yield event


@router.post("/{comparison_id}/cancel", response_model=Comparison, responses=problems(404, 422))
def cancel_comparison(parts: PartsOf, comparison_id: JobId) -> Response:
    """End a comparison where it stands, as a run; one that has ended stays as it is."""
    return json_response(parts.comparisons.cancel(comparison_id).model_dump_json())


@router.delete(
    "/{comparison_id}", status_code=204, response_class=Response, responses=DELETED | problems(404, 409, 422)
)
def delete_comparison(parts: PartsOf, comparison_id: JobId) -> Response:
    """Delete a comparison; one that goes on must be cancelled first. For 30 days it can be restored."""
    return delete(parts.comparisons, comparison_id)


@router.post("/{comparison_id}/restore", response_model=Comparison, responses=problems(404, 422))
def restore_comparison(parts: PartsOf, comparison_id: JobId) -> Response:
    """Bring a deleted comparison back; one that is not deleted stays as it is."""
    return restore(parts.comparisons, comparison_id)
