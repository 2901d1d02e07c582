"""Geometries: a robot's axes, base frame, wrist centre and targets from sweeps or unloaded poses."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from jointstiff.schemas.fields import Page
from jointstiff.schemas.geometry import Geometry, GeometryRequest, GeometrySummary
from jointstiff.schemas.query import GeometryQuery
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.examples import GEOMETRIES, shown
from jointstiff.service.api.jobs import JobId, delete, restore
from jointstiff.service.api.parts import DELETED, LOCATION, PartsOf, created, json_response, problems
from jointstiff.service.store import GeometryEntry

__all__ = ["router"]

router = APIRouter(prefix="/v1/geometries", tags=["geometries"], route_class=BodyRoute)


@router.post(
    "",
    status_code=201,
    response_model=Geometry,
    responses=LOCATION | problems(400, 413, 415, 422),
)
def create_geometry(
    parts: PartsOf,
    body: Annotated[GeometryRequest, shown(GEOMETRIES)],
    key: Key,
) -> Response:
    """Find a robot's geometry, from each joint turned alone or from unloaded poses.

    Axes, base frame, wrist centre and targets come with their uncertainties, links beside the nominal ones,
    and the identified model as a robot that can be posted as `"model": {"format": "geometry", …}`. What
    looks wrong (a bumped tracker, a short arc, a joint map that does not fit, …) is a finding with its
    figure; what cannot be used is refused, and nothing is stored.
    """
    record = parts.geometries.create(body, key)
    return created("geometries", record.id, record.document)


@router.get("", response_model=Page[GeometrySummary], responses=problems(422))
def list_geometries(parts: PartsOf, query: Annotated[GeometryQuery, Query()]) -> Page[GeometrySummary]:
    """List geometries without their results, newest first."""
    page = parts.store.page(GeometryEntry, limit=query.limit, cursor=query.cursor, filters=query.filters())
    items = [GeometrySummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{geometry_id}", response_model=Geometry, responses=problems(404, 422))
def get_geometry(parts: PartsOf, geometry_id: JobId) -> Response:
    """One geometry with its readings, result and provenance. It never changes."""
    return json_response(parts.geometries.document(geometry_id))


@router.delete(
    "/{geometry_id}", status_code=204, response_class=Response, responses=DELETED | problems(404, 409, 422)
)
def delete_geometry(parts: PartsOf, geometry_id: JobId) -> Response:
    """Delete a geometry; what was made of it stays as it is. For 30 days it can be restored."""
    return delete(parts.geometries, geometry_id)


@router.post("/{geometry_id}/restore", response_model=Geometry, responses=problems(404, 422))
def restore_geometry(parts: PartsOf, geometry_id: JobId) -> Response:
    """Bring a deleted geometry back; one that is not deleted stays as it is."""
    return restore(parts.geometries, geometry_id)
