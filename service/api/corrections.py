"""Routes of corrected poses: few rows are answered at once, more rows and files are jobs."""

from __future__ import annotations

import json
from typing import Annotated, Any, Final

from anyio.to_thread import run_sync
from fastapi import APIRouter, File, Form, Response, UploadFile
from pydantic import Json

from jointstiff.schemas.correction import (
    MAX_ROWS,
    CorrectionJob,
    CorrectionRequest,
    CorrectionResult,
    CorrectionTableRequest,
)
from jointstiff.schemas.run import Run
from jointstiff.service.api.answers import describe_post_responses, json_response
from jointstiff.service.api.bodies import Key, KeyText, json_body, limiter_of_large_work
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.jobs import InjectedPost, JobRoute
from jointstiff.service.api.runs import BINARY, answer_form
from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.kinds.correction.kind import CORRECTION
from jointstiff.service.kinds.correction.work import pack_columns, pack_file
from jointstiff.service.runs.correction.answer import correct_request
from jointstiff.service.runs.verdicts import find_accepted_run
from jointstiff.service.security.access import OPERATOR
from jointstiff.service.store.tables import JobRecord
from jointstiff.solver.mechanics.robot import Robot

router = APIRouter(tags=["corrections"], route_class=JobRoute)

_TWO_ROWS: Final = CORRECTION.examples["two rows"]
_Table = Annotated[
    list[UploadFile],
    File(
        description="The table, CSV or Parquet.",
        min_length=1,
        max_length=1,
        examples=[_TWO_ROWS["files"]],
        json_schema_extra={"items": BINARY},
    ),
]
_Options = Annotated[Json[CorrectionTableRequest], Form(examples=[json.dumps(_TWO_ROWS["options"])])]
_JOB_ANSWERS: Final[dict[int | str, dict[str, Any]]] = {
    status: answer | {"model": CorrectionJob}
    for status, answer in describe_post_responses(CorrectionJob).items()
}


@router.post(
    "/v1/corrections", dependencies=[OPERATOR], response_model=CorrectionResult, responses=_JOB_ANSWERS
)
async def compute_corrections(
    posted: InjectedPost, body: Annotated[CorrectionRequest, json_body(EXAMPLES["corrections"])], key: Key
) -> Response:
    """Correct poses for the deflection under load by the model of a run, or by a prior.

    The answer has the columns of the request, corrected, and the status of each row; nothing is stored. Over
    5,000 rows are a job, as of a file. With joints, a wrong tool, base or unit is refused, and frames that
    fit are proposed.
    """
    limiter = limiter_of_large_work(posted.request)
    if max(map(len, body.columns.values())) <= MAX_ROWS:
        return json_response(await run_sync(_correct_as_json, posted.parts, body, limiter=limiter))

    def create(jobs: Jobs) -> JobRecord:
        """Store the job with the columns as a table."""
        table = pack_columns(body.columns, body, _find_source(posted.parts, body)[0])
        stated = body.model_dump(exclude={"columns"}, exclude_unset=True)
        return jobs.create(CorrectionTableRequest(**stated, files=[table]), key, posted.by)

    return await posted.answer(CORRECTION.name, create, limiter)


@router.post(
    CORRECTION.address,
    dependencies=[OPERATOR],
    description=CORRECTION.description,
    status_code=201,
    response_model=CorrectionJob,
    responses=describe_post_responses(CorrectionJob),
)
async def correct_file(
    posted: InjectedPost, files: _Table, options: _Options, idempotency_key: KeyText = None
) -> Response:
    """Correct a file of poses."""
    return await answer_form(posted, CorrectionJob, files, options, idempotency_key, pack_file)


def _correct_as_json(parts: Parts, body: CorrectionRequest) -> str:
    """Correct poses with the model of a stored run, or of a robot; return the result as JSON text.

    Raises:
        RequestError: run or robot do not exist, or the request cannot be carried out.
    """
    return correct_request(*_find_source(parts, body), body).model_dump_json()


def _find_source(parts: Parts, body: CorrectionRequest) -> tuple[Robot, Run | None]:
    """Return the robot of a request, and its run if the request names one.

    Raises:
        RequestError: run or robot do not exist.
        VerdictError: the run's verdict is not accepted.
    """
    if body.run_id is None:
        return parts.robot(body.robot_id or "", "robot_id")[0], None
    run = find_accepted_run(parts, body.run_id, body.accept_verdict)
    return run.prepared.robot, run.run
