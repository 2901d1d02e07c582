"""Imports: files of readings, understood and shown before anything is stored."""

from __future__ import annotations

import json
from typing import Annotated, Final

from anyio.to_thread import run_sync
from fastapi import APIRouter, File, Form, Request, Response, UploadFile
from pydantic import Json, JsonValue, TypeAdapter, ValidationError

from jointstiff.schemas.fields import MAX_NAME_LENGTH, Name
from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.service.api.access import OPERATOR
from jointstiff.service.api.bodies import BodyRoute, large_bodies, without_collections
from jointstiff.service.api.examples import IMPORTS
from jointstiff.service.api.forms import MAX_FILES
from jointstiff.service.api.parts import PartsOf, json_response, problems
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.jobs.parts import Parts
from jointstiff.service.resources.imports import import_files
from jointstiff.solver.errors import RequestError

_NAME: Final = TypeAdapter(Name)

_DEFAULTS: Final = ImportRequest()
_EXAMPLE: Final = IMPORTS["one table"]

BINARY: Final[dict[str, JsonValue]] = {
    "type": "string",
    "contentMediaType": "application/octet-stream",
    "format": "binary",  # as OpenAPI 3.0 has it, by which generated clients know a file
}

_Files = Annotated[
    list[UploadFile],
    File(
        description="Tables and lists of points: text or Excel, each with its name.",
        min_length=1,
        max_length=MAX_FILES,
        examples=[_EXAMPLE["files"]],
        json_schema_extra={"items": BINARY},
    ),
]
_Options = Annotated[
    Json[ImportRequest],
    Form(examples=[json.dumps(_EXAMPLE["options"])], json_schema_extra={"default": "{}"}),
]

router = APIRouter(prefix="/v1/imports", tags=["measurement sets"], route_class=BodyRoute)


@router.post(
    "", dependencies=[OPERATOR], response_model=ImportAnswer, responses=problems(400, 404, 413, 415, 422)
)
async def create_import(
    request: Request, parts: PartsOf, files: _Files, options: _Options = _DEFAULTS
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
