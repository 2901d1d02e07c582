"""Pairs: two measurement sets, or runs, of one robot beside each other."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from jointstiff.schemas.fields import Page
from jointstiff.schemas.pair import Pair, PairRequest, PairSummary
from jointstiff.schemas.query import PairQuery
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.examples import PAIRS, shown
from jointstiff.service.api.jobs import JobId, delete, restore
from jointstiff.service.api.parts import DELETED, LOCATION, PartsOf, created, json_response, problems
from jointstiff.service.store import PairEntry

__all__ = ["router"]

router = APIRouter(prefix="/v1/pairs", tags=["pairs"], route_class=BodyRoute)


@router.post(
    "",
    status_code=201,
    response_model=Pair,
    responses=LOCATION | problems(400, 413, 415, 422),
)
def create_pair(parts: PartsOf, body: Annotated[PairRequest, shown(PAIRS)], key: Key) -> Response:
    """Compare two sides, such as encoders of motors and secondary ones, before and after, unit A and B.

    For each joint: the ratio of its stiffnesses with Fieller's interval, and whether it has changed. For each
    observation, and overall: the share of the deflection that the second side avoids, measured where both
    sides have the observation, and predicted. With `ordered`, also both sides in one problem in which no
    joint is softer on the second.
    """
    record = parts.pairs.create(body, key)
    return created("pairs", record.id, record.document)


@router.get("", response_model=Page[PairSummary], responses=problems(422))
def list_pairs(parts: PartsOf, query: Annotated[PairQuery, Query()]) -> Page[PairSummary]:
    """List pairs without their results, newest first."""
    page = parts.store.page(PairEntry, limit=query.limit, cursor=query.cursor, filters=query.filters())
    items = [PairSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{pair_id}", response_model=Pair, responses=problems(404, 422))
def get_pair(parts: PartsOf, pair_id: JobId) -> Response:
    """One pair with its request, result and provenance. It never changes."""
    return json_response(parts.pairs.document(pair_id))


@router.delete(
    "/{pair_id}", status_code=204, response_class=Response, responses=DELETED | problems(404, 409, 422)
)
def delete_pair(parts: PartsOf, pair_id: JobId) -> Response:
    """Delete a pair. For 30 days it can be restored."""
    return delete(parts.pairs, pair_id)


@router.post("/{pair_id}/restore", response_model=Pair, responses=problems(404, 422))
def restore_pair(parts: PartsOf, pair_id: JobId) -> Response:
    """Bring a deleted pair back; one that is not deleted stays as it is."""
    return restore(parts.pairs, pair_id)
