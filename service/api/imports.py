"""Imports: files of readings, understood and shown before anything is stored."""

from __future__ import annotations

from typing import Any, Final

from fastapi import APIRouter, HTTPException, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from pydantic import TypeAdapter, ValidationError

from jointstiff.schemas.fields import MAX_NAME_LENGTH, Name
from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.service.api.bodies import MAX_SET_BYTES, SMALL_BYTES, read_content
from jointstiff.service.api.examples import IMPORTS
from jointstiff.service.api.multipart import Part, read_parts
from jointstiff.service.api.parts import json_response, problems
from jointstiff.service.conversion import MalformedError, parse
from jointstiff.service.importing import SourceFile
from jointstiff.service.resources import import_files
from jointstiff.solver.errors import RequestError

__all__ = ["router"]

_NAME: Final = TypeAdapter(Name)

_FORM: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "properties": {
                        "files": {
                            "type": "array",
                            "description": "Tables and lists of points: text or Excel, each with its name.",
                            "items": {"type": "string", "format": "binary"},
                            "minItems": 1,
                            "maxItems": 64,
                        },
                        "options": {"$ref": f"#/components/schemas/{ImportRequest.__name__}"},
                    },
                    "required": ["files"],
                    "additionalProperties": False,
                },
                "encoding": {"options": {"contentType": "application/json"}},
                "examples": {name: {"value": value} for name, value in IMPORTS.items()},
            }
        },
    }
}

router = APIRouter(prefix="/v1/imports", tags=["measurement sets"])


@router.post("", response_model=ImportAnswer, responses=problems(400, 413, 415, 422), openapi_extra=_FORM)
async def post_import(request: Request) -> Response:
    """Understand files of readings, and show what was understood. Nothing is stored.

    Send the files as fields `files` of a form, and what they do not say themselves as JSON in a field
    `options`. The answer says what each column was taken for, what was assumed and what is missing, and has
    the measurement set once nothing is: add `robot_id` and post it to /v1/measurement-sets. A file that can
    be understood in two ways is refused, with its place as file:line:column and the remedy.
    """
    content = await read_content(request, MAX_SET_BYTES)
    # A few bytes of Excel unpack to a great deal: all imports wait for their turn.
    async with request.app.state.large_bodies:
        answer = await run_in_threadpool(_answer, request.headers.get("content-type", ""), content)
    return json_response(answer)


def _answer(content_type: str, content: bytes) -> str:
    parts = read_parts(content_type, content)
    for part in parts:
        if part.name not in {"files", "options"}:
            raise RequestError(
                f"a form has no field {part.name[:MAX_NAME_LENGTH]!r}",
                remedy="send `files` and `options`",
                where="body",
            )
    options = [part for part in parts if part.name == "options"]
    if len(options) > 1:
        raise RequestError("the options are there twice", remedy="send one JSON document", where="options")
    files = [_file(part) for part in parts if part.name == "files"]
    return import_files(files, _options(options[0]) if options else ImportRequest()).model_dump_json()


def _options(part: Part) -> ImportRequest:
    if len(part.content) > SMALL_BYTES:
        raise HTTPException(413, f"the options exceed {SMALL_BYTES // 1024} KiB")
    try:
        return parse(ImportRequest, part.content)
    except MalformedError as error:
        raise RequestValidationError(
            [{**fault, "loc": ("options", *fault["loc"])} for fault in error.faults]
        ) from None


def _file(part: Part) -> SourceFile:
    try:
        return SourceFile(_NAME.validate_python(part.file_name), part.content)
    except ValidationError:
        raise RequestError(
            "a file has no name, or one that cannot be shown",
            remedy=f"send it with a `filename` of 1 to {MAX_NAME_LENGTH} printable characters",
            where="files",
        ) from None
