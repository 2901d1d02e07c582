"""Identified models as files for other programs."""

from __future__ import annotations

from typing import Annotated, Any, Final, cast

from fastapi import APIRouter, HTTPException, Query, Response

from jointstiff.schemas.assessment import AcceptingOptions
from jointstiff.schemas.robot import Robot
from jointstiff.schemas.run.run import Run
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.jobs import JobId
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.exporting.formats import FORMATS, ModelFormat, export_model
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.jobs.parts import Parts

_FILES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The model.",
        "content": {found.media_type: {} for found in FORMATS.values()},
    }
}

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=AccessRoute)


@router.get(
    "/{run_id}/model.{format}",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_FILES | problems(404, 409, 422),
)
def get_run_model(
    parts: PartsOf,
    run_id: JobId,
    format: ModelFormat,  # noqa: A002
    query: Annotated[AcceptingOptions, Query()],
) -> Response:
    """Get the identified model as a file: tables (csv, xlsx), URDF, SDFormat, or MJCF of MuJoCo.

    Tables have the intervals, with units in every header. MJCF and SDFormat have a spring for each joint
    with a stiffness; URDF has none, so the numbers stand in comments. A joint that is rigid, not observable
    or not identified has no spring, and the file says why. A run not to be used is refused unless
    `accept_verdict` says so.
    """
    content = export_model(exported_model(parts, run_id), format, query.accept_verdict)
    return Response(
        content,
        media_type=FORMATS[format].media_type,
        headers={"Content-Disposition": f'attachment; filename="model-{run_id}.{format}"'},
    )


def exported_model(parts: Parts, run_id: str) -> ExportedModel:
    """Return the model of a stored run.

    Raises:
        HTTPException: the run has no result.
    """
    run = cast("Run", parts.jobs[Run.kind].current(run_id))
    if run.result is None:
        raise HTTPException(409, f"there is no result, because the run's state is {run.state}")
    prepared = parts.sets.prepared(run.request.measurement_set_id)
    stored = Robot.model_validate_json(parts.store.robots.get(prepared.robot_id).document)
    return ExportedModel(run, run.result, prepared.robot, stored.name, stored.geometry_id)
