"""Files in forms: readings, understood and shown before anything is stored; programs, to be corrected."""

from __future__ import annotations

import json
from typing import Annotated, Final

from anyio.to_thread import run_sync
from fastapi import APIRouter, File, Form, Request, Response, UploadFile
from pydantic import Json, JsonValue, TypeAdapter, ValidationError

from jointstiff.schemas.fields import MAX_NAME_LENGTH, Name
from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.schemas.program import MAX_FILES as MAX_PROGRAM_FILES
from jointstiff.schemas.program import Program, ProgramForm, ProgramRequest
from jointstiff.service.api.answers import PartsOf, accepted, json_response, problems
from jointstiff.service.api.bodies import (
    MAX_FILES,
    BodyRoute,
    KeyText,
    bound_key,
    large_bodies,
    without_collections,
)
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.jobs import AskedBy, JobRoute, Wait, answer
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.jobs.life import Parts
from jointstiff.service.kinds.program import PROGRAM
from jointstiff.service.kinds.program_work import packed
from jointstiff.service.resources.imports import import_files
from jointstiff.service.security.access import OPERATOR
from jointstiff.service.store.records import JobRecord
from jointstiff.solver.errors import RequestError

_NAME: Final = TypeAdapter(Name)

_DEFAULTS: Final = ImportRequest()
_IMPORT: Final = EXAMPLES["imports"]["one table"]

BINARY: Final[dict[str, JsonValue]] = {
    "type": "string",
    "contentMediaType": "application/octet-stream",
    "format": "binary",  # as OpenAPI 3.0 has it, by which generated clients know a file
}

_Readings = Annotated[
    list[UploadFile],
    File(
        description="Tables and lists of points: text or Excel, each with its name.",
        min_length=1,
        max_length=MAX_FILES,
        examples=[_IMPORT["files"]],
        json_schema_extra={"items": BINARY},
    ),
]
_ImportOptions = Annotated[
    Json[ImportRequest],
    Form(examples=[json.dumps(_IMPORT["options"])], json_schema_extra={"default": "{}"}),
]

_PROGRAM: Final = PROGRAM.examples["milling"]
_Program = Annotated[
    list[UploadFile],
    File(
        description="The program, each file with its name; and the table of loads, if `loads` names one.",
        min_length=1,
        max_length=MAX_PROGRAM_FILES,
        examples=[_PROGRAM["files"]],
        json_schema_extra={"items": BINARY},
    ),
]
_ProgramOptions = Annotated[Json[ProgramForm], Form(examples=[json.dumps(_PROGRAM["options"])])]

router = APIRouter(tags=["measurement sets"], route_class=BodyRoute)
programs = APIRouter(tags=["programs"], route_class=JobRoute)


@router.post("/v1/imports", dependencies=[OPERATOR], response_model=ImportAnswer, responses=problems(404))
async def create_import(
    request: Request, parts: PartsOf, files: _Readings, options: _ImportOptions = _DEFAULTS
) -> Response:
    """Preview files of readings. Nothing is stored.

    Send the files as fields `files` of a form, and missing information as JSON in a field `options`. The
    answer has the meaning of each column, assumptions and missing items, and, if nothing is missing, the
    measurement set: add `robot_id` and post it to /v1/measurement-sets. A file with two possible meanings is
    refused with all faults, each with file:line:column and a remedy; with `show_faults` they are in the
    preview. With `robot_id` the set is inspected. The `template` of an earlier answer as options refuses
    files of another form.
    """
    # A few bytes of Excel unpack to a great deal: all imports wait for their turn.
    answer = await run_sync(_understood, parts, files, options, limiter=large_bodies(request))
    return json_response(answer)


def _understood(parts: Parts, files: list[UploadFile], options: ImportRequest) -> str:
    robot = None if options.robot_id is None else parts.robots.find(options.robot_id, None)
    sources = [SourceFile(*named_content(file)) for file in files]
    with without_collections():
        return import_files(sources, options, robot).model_dump_json()


def named_content(file: UploadFile) -> tuple[str, bytes]:
    """Return name without folders and content of a file.

    Raises:
        RequestError: it has no name that can be shown.
    """
    name = (file.filename or "").replace("\\", "/").rpartition("/")[2]
    try:
        return _NAME.validate_python(name), file.file.read()
    except ValidationError:
        raise RequestError(
            "a file has no name, or a name that cannot be displayed",
            remedy=f"send it with a `filename` of 1 to {MAX_NAME_LENGTH} printable characters",
            where="files",
        ) from None


@programs.post(
    "/v1/programs",
    dependencies=[OPERATOR],
    description=PROGRAM.description,
    status_code=201,
    response_model=Program,
    responses=accepted(Program),
)
async def create_program(
    request: Request,
    parts: PartsOf,
    files: _Program,
    options: _ProgramOptions,
    asked_by: AskedBy,
    query: Wait,
    idempotency_key: KeyText = None,
) -> Response:
    """Correct the targets of a program."""
    jobs = parts.jobs[Program.kind]
    if len({file.filename for file in files}) < len(files):
        raise RequestError("two files have one name", where="files", remedy="send each file once")

    def create() -> JobRecord:
        body = ProgramRequest(**options.model_dump(), files=[packed(*named_content(file)) for file in files])
        key = bound_key(idempotency_key, body.model_dump_json().encode())
        return jobs.create(body, key, asked_by)

    # A program may take seconds to pack and to read: they wait for their turn, and leave others theirs.
    record = await run_sync(create, limiter=large_bodies(request))
    return await answer(jobs, record, query.wait, request.app.state.followers)
