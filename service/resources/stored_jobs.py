"""Stored jobs for those who build on them: robots, measurement sets and other jobs."""

from __future__ import annotations

from typing import TypeVar

from jointstiff.schemas.geometry import Geometry, GeometryResult
from jointstiff.schemas.job import Job
from jointstiff.service.problems.errors import NotFoundError, Resource
from jointstiff.service.store.store import Store
from jointstiff.solver.errors import RequestError

AnyJob = TypeVar("AnyJob", bound=Job)


def stored_job(store: Store, message: type[AnyJob], job_id: str) -> AnyJob:
    """Return a job.

    Raises:
        NotFoundError: there is none, or it was deleted.
    """
    record = store.jobs(Resource(message.kind, message.collection)).get(job_id)
    return message.model_validate_json(record.document)


def succeeded_geometry(store: Store, geometry_id: str, where: str) -> tuple[Geometry, GeometryResult]:
    """Return a geometry and its result.

    Raises:
        RequestError: there is none, it was deleted, or it has no result.
    """
    try:
        geometry = stored_job(store, Geometry, geometry_id)
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=where) from error
    if geometry.result is None:
        raise RequestError(
            f"geometry '{geometry_id}' is {geometry.state} and has no identified robot",
            remedy="use a geometry that has succeeded",
            where=where,
        )
    return geometry, geometry.result
