"""Routes of corrected poses: few rows are answered at once; more rows, tables and programs are jobs."""

from __future__ import annotations

from typing import Annotated, Any, Final

from anyio.to_thread import run_sync
from fastapi import APIRouter, File, Form, Response, UploadFile
from pydantic import Json
from starlette.datastructures import Headers
from starlette.routing import Match
from starlette.types import Scope

from jointstiff.schemas.correction import (
    MAX_FILES,
    MAX_ROWS,
    CorrectionJob,
    CorrectionRequest,
    CorrectionResult,
    are_programs,
)
from jointstiff.schemas.run import Run
from jointstiff.service.api.answers import describe_post_responses, json_response
from jointstiff.service.api.bodies import Key, KeyText, bind_key, json_body, limiter_of_large_work
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.jobs import InjectedPost, JobRoute
from jointstiff.service.api.runs import BINARY, read_named_file
from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.kinds.correction.files import compress_file
from jointstiff.service.kinds.correction.kind import CORRECTION
from jointstiff.service.kinds.correction.work import pack_columns, pack_file
from jointstiff.service.runs.correction.answer import correct_request
from jointstiff.service.runs.verdicts import find_accepted_run
from jointstiff.service.security.access import OPERATOR
from jointstiff.service.store.tables import JobRecord
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot


class _ColumnsRoute(JobRoute):
    """Route of columns in JSON, whose address takes a file in a form, too."""

    takes_files = True


router = APIRouter(tags=["corrections"], route_class=_ColumnsRoute)

_ADDRESS: Final = f"/v1/{CORRECTION.collection}"
_Files = Annotated[list[UploadFile], File(min_length=1, max_length=MAX_FILES)]
_Options = Annotated[Json[CorrectionRequest], Form()]
_FORM: Final[dict[str, Any]] = {
    "schema": {
        "type": "object",
        "required": ["files", "options"],
        "properties": {
            "files": {
                "type": "array",
                "items": BINARY,
                "minItems": 1,
                "maxItems": MAX_FILES,
                "description": "A table, CSV or Parquet, whose headers have units, as `x [mm]`. Or the files "
                "of a robot program, each with its file name, and the table of loads, if any.",
            },
            "options": {
                "type": "string",
                "contentMediaType": "application/json",
                "contentSchema": {"$ref": "#/components/schemas/CorrectionRequest"},
            },
        },
    }
}
"""Description of a form with files, which has the same address as columns."""
_JOB_ANSWERS: Final[dict[int | str, dict[str, Any]]] = {
    status: answer | {"model": CorrectionJob}
    for status, answer in describe_post_responses(CorrectionJob).items()
}


class _FormRoute(JobRoute):
    """Route for forms alone: the route of columns, of the same address, answers other bodies."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Return whether the route answers a request, by its address, method and media type."""
        media_type = Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
        return super().matches(scope) if media_type == "multipart/form-data" else (Match.NONE, {})


_forms = APIRouter(route_class=_FormRoute)


@_forms.post(_ADDRESS, dependencies=[OPERATOR], status_code=201, include_in_schema=False)
async def correct_files(
    posted: InjectedPost, files: _Files, options: _Options, idempotency_key: KeyText = None
) -> Response:
    """Correct a table of poses, or a program.

    Raises:
        RequestError: two files have the same name, or the options contain files.
    """
    if len({file.filename for file in files}) < len(files):
        raise RequestError("two files have the same name", where="files", remedy="send each file once")
    if options.files:
        raise RequestError(
            "the options contain a field `files`",
            where="files",
            remedy="send each file as a field `files` of the form",
        )

    def create(jobs: Jobs) -> JobRecord:
        """Store the job with the uploaded files; return the job's record."""
        named = [read_named_file(file) for file in files]
        is_program = are_programs([name for name, _ in named], options.format)
        pack = compress_file if is_program else pack_file
        body = options.model_copy(update={"files": [pack(*each) for each in named]})
        return jobs.create(body, bind_key(idempotency_key, body.model_dump_json().encode()), posted.by)

    # Packing and reading files may take seconds: the limiter keeps threads free for other requests.
    return await posted.answer(CORRECTION.name, create, limiter_of_large_work(posted.request))


router.include_router(_forms)  # before the route of columns, which takes all other bodies


@router.post(
    _ADDRESS,
    dependencies=[OPERATOR],
    description=CORRECTION.description,
    response_model=CorrectionResult,
    responses=_JOB_ANSWERS,
    openapi_extra={"requestBody": {"content": {"multipart/form-data": _FORM}}},
)
async def compute_corrections(
    posted: InjectedPost, body: Annotated[CorrectionRequest, json_body(EXAMPLES["corrections"])], key: Key
) -> Response:
    """Correct poses."""
    if body.files or not body.columns:
        raise RequestError(
            "the request has no columns",
            where="columns",
            remedy="give columns x, y, z and an orientation; send a file as field `files` of a form",
        )
    limiter = limiter_of_large_work(posted.request)
    if max(map(len, body.columns.values())) <= MAX_ROWS:
        return json_response(await run_sync(_correct_as_json, posted.parts, body, limiter=limiter))

    def create(jobs: Jobs) -> JobRecord:
        """Store the job with the columns as a table."""
        table = pack_columns(body.columns, body, _find_source(posted.parts, body)[0])
        stated = body.model_dump(exclude={"columns"}, exclude_unset=True)
        return jobs.create(CorrectionRequest(**stated, files=[table]), key, posted.by)

    return await posted.answer(CORRECTION.name, create, limiter)


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
