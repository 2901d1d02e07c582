"""Stored geometries for those who build on them: robots and measurement sets."""

from __future__ import annotations

from jointstiff.schemas.geometry import Geometry, GeometryResult
from jointstiff.service.store import GeometryRecord, NotFoundError, Store
from jointstiff.solver.errors import RequestError

__all__ = ["succeeded_geometry"]


def succeeded_geometry(store: Store, geometry_id: str, where: str) -> tuple[Geometry, GeometryResult]:
    """A geometry and its result.

    Args:
        store: where it is.
        geometry_id: of it.
        where: field that names it, for messages.

    Raises:
        RequestError: there is none, it was deleted, or it has no result.
    """
    try:
        record = store.get(GeometryRecord, geometry_id)
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=where) from error
    geometry = Geometry.model_validate_json(record.document)
    if geometry.result is None:
        raise RequestError(
            f"geometry '{geometry_id}' has {geometry.state} and found no robot",
            remedy="name one that succeeded",
            where=where,
        )
    return geometry, geometry.result
