"""Deflections: how far the tool bends under given loads, by the model of a run."""

from __future__ import annotations

from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, Request, Response

from jointstiff.schemas.deflection import DeflectionRequest, DeflectionResult
from jointstiff.schemas.run import Run
from jointstiff.service.api.access import OPERATOR
from jointstiff.service.api.bodies import BodyRoute, large_bodies
from jointstiff.service.api.examples import DEFLECTIONS, shown
from jointstiff.service.api.parts import PartsOf, json_response, problems
from jointstiff.service.jobs.parts import Parts
from jointstiff.service.kinds.deflection import predict_by_run
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.resources.stored_jobs import stored_job
from jointstiff.solver.errors import RequestError

router = APIRouter(prefix="/v1/deflections", tags=["runs"], route_class=BodyRoute)


@router.post(
    "", dependencies=[OPERATOR], response_model=DeflectionResult, responses=problems(400, 413, 415, 422)
)
async def compute_deflections(
    request: Request, parts: PartsOf, body: Annotated[DeflectionRequest, shown(DEFLECTIONS)]
) -> Response:
    """Predict deflection, rotation and Cartesian compliance by the model of a run. Nothing is stored.

    Each case has a posture, a load and a place. Intervals are of two kinds: `readings_only` includes the
    errors of the readings and the stated errors of the force; `with_model_error` also includes the model
    error, calibrated on held-out postures. A run never changes, so the same request has the same answer.
    """
    # Many cases take seconds: predictions wait for their turn, and leave the other requests theirs.
    return json_response(await run_sync(_predicted, parts, body, limiter=large_bodies(request)))


def _predicted(parts: Parts, body: DeflectionRequest) -> str:
    try:
        run = stored_job(parts.store, Run, body.run_id)
        robot = parts.sets.prepared(run.request.measurement_set_id).robot
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where="run_id") from error
    return predict_by_run(robot, run, body).model_dump_json()
