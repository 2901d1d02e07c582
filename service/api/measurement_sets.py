"""Measurement sets: loads and the tracker's readings."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from jointstiff.schemas.fields import Page
from jointstiff.schemas.measurement import (
    MeasurementSet,
    MeasurementSetRequest,
    MeasurementSetSummary,
    SetChange,
)
from jointstiff.schemas.query import SetQuery
from jointstiff.service.api.access import OPERATOR, VIEWER
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.examples import MEASUREMENT_SETS, SET_CHANGES, shown
from jointstiff.service.api.parts import LOCATION, PartsOf, add_deletion, created, json_response, problems
from jointstiff.service.resources.measurement_sets import assembled

router = APIRouter(prefix="/v1/measurement-sets", tags=["measurement sets"], route_class=BodyRoute)


@router.post(
    "",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=MeasurementSet,
    responses=LOCATION | problems(400, 413, 415, 422, 507),
)
def create_measurement_set(
    parts: PartsOf,
    body: Annotated[MeasurementSetRequest, shown(MEASUREMENT_SETS)],
    key: Key,
) -> Response:
    """Store a measurement set.

    What cannot be right is refused with its place and the remedy, and nothing is stored. What is
    suspicious (targets that did not move as one body, deflection against the force, angles that look
    like the other unit, …) is stored with a warning, which every run of the set shows.
    """
    record = parts.sets.create(body, key)
    return created("measurement-sets", record.id, assembled(record).model_dump_json())


@router.get("", dependencies=[VIEWER], response_model=Page[MeasurementSetSummary], responses=problems(422))
def list_measurement_sets(parts: PartsOf, query: Annotated[SetQuery, Query()]) -> Page[MeasurementSetSummary]:
    """List measurement sets without their observations, newest first."""
    page = parts.store.sets.page(
        limit=query.limit,
        cursor=query.cursor,
        filters=query.filters(),
        spans=query.spans(),
        deleted=query.deleted,
        archived=query.archived,
    )
    items = [MeasurementSetSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{set_id}", dependencies=[VIEWER], response_model=MeasurementSet, responses=problems(404, 422))
def get_measurement_set(parts: PartsOf, set_id: Annotated[str, Path(max_length=64)]) -> Response:
    """Get a measurement set as it was posted, with what was noticed."""
    return json_response(parts.sets.document(set_id).model_dump_json())


@router.patch(
    "/{set_id}",
    dependencies=[OPERATOR],
    response_model=MeasurementSetSummary,
    responses=problems(400, 404, 413, 415, 422),
)
def change_measurement_set(
    parts: PartsOf,
    set_id: Annotated[str, Path(max_length=64)],
    body: Annotated[SetChange, shown(SET_CHANGES)],
) -> MeasurementSetSummary:
    """Change name and metadata of a measurement set, or archive it.

    Fields that are left out stay; null removes one. Readings, hash and runs stay as they are, whatever
    changes. Listings leave an archived set out.
    """
    return MeasurementSetSummary.model_validate(parts.sets.change(set_id, body), from_attributes=True)


add_deletion(
    router,
    "/{set_id}",
    "measurement_set",
    MeasurementSet,
    delete=lambda parts, set_id: parts.sets.delete(set_id),
    restore=lambda parts, set_id: parts.sets.restore(set_id).model_dump_json(),
    description="Delete a measurement set that no job refers to. It can be restored for 30 days.",
)
