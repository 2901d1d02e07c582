"""Programs: posted as files, corrected, and handed back as files and a table."""

from __future__ import annotations

import json
from pathlib import PurePath
from typing import Annotated, Any, Final, cast
from urllib.parse import quote

from anyio.to_thread import run_sync
from fastapi import APIRouter, File, Form, HTTPException, Query, Request, Response, UploadFile
from fastapi.concurrency import run_in_threadpool
from pydantic import Json

from jointstiff.schemas.program import MAX_FILES, Program, ProgramForm, ProgramRequest, ProgramResult
from jointstiff.schemas.query import WaitQuery
from jointstiff.service.api.access import OPERATOR, VIEWER
from jointstiff.service.api.bodies import BodyRoute, Handler, KeyText, bound_key, large_bodies
from jointstiff.service.api.imports import BINARY, named_content
from jointstiff.service.api.jobs import AskedBy, FollowersOf, JobId, Wait, answer
from jointstiff.service.api.parts import LOCATION, PartsOf, accepted, problems
from jointstiff.service.kinds.program import PROGRAM
from jointstiff.service.kinds.program_work import packed, unpacked
from jointstiff.service.store.records import JobRecord
from jointstiff.solver.errors import RequestError

_EXAMPLE: Final = PROGRAM.examples["milling"]
_FILES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The file.", "content": {"application/octet-stream": {}}}
}

_Files = Annotated[
    list[UploadFile],
    File(
        description="The program, each file with its name; and the table of loads, if `loads` names one.",
        min_length=1,
        max_length=MAX_FILES,
        examples=[_EXAMPLE["files"]],
        json_schema_extra={"items": BINARY},
    ),
]
_Options = Annotated[Json[ProgramForm], Form(examples=[json.dumps(_EXAMPLE["options"])])]
_FileName = Annotated[
    str | None, Query(max_length=200, description="Name of the file; default: the first one.")
]


class _FollowedRoute(BodyRoute):
    """Route of jobs that the child stores: it waits for no worker, the service does."""

    def get_route_handler(self) -> Handler:
        """Return the handler, which waits for a job that goes on."""
        handle = super().get_route_handler()

        async def handle_followed(request: Request) -> Response:
            response = await handle(request)
            if response.status_code != 202 or request.app.state.limited_child is None:
                return response
            jobs = request.app.state.parts.jobs[Program.kind]
            wait = float(request.query_params.get("wait", WaitQuery().wait))  # a number: it was answered 202
            job_id = response.headers["Location"].rpartition("/")[2]  # the body may be compressed
            record = await run_in_threadpool(jobs.record, job_id)
            return await answer(jobs, record, wait, request.app.state.followers)

        return handle_followed


router = APIRouter(prefix="/v1/programs", tags=["programs"], route_class=_FollowedRoute)


@router.post(
    "",
    dependencies=[OPERATOR],
    description=PROGRAM.description,
    status_code=201,
    response_model=Program,
    responses=LOCATION | accepted(Program) | problems(400, 413, 415, 422, 429, 507),
)
async def create_program(
    request: Request,
    parts: PartsOf,
    files: _Files,
    options: _Options,
    followers: FollowersOf,
    asked_by: AskedBy,
    query: Wait,
    idempotency_key: KeyText = None,
) -> Response:
    """Correct the targets of a program."""
    jobs, sent = parts.jobs[Program.kind], _different(files)

    def create() -> JobRecord:
        body = ProgramRequest(**options.model_dump(), files=[packed(*named_content(file)) for file in sent])
        key = bound_key(idempotency_key, body.model_dump_json().encode())
        return jobs.create(body, key, asked_by)

    # A program may take seconds to pack and to read: they wait for their turn, and leave others theirs.
    record = await run_sync(create, limiter=large_bodies(request))
    return await answer(jobs, record, query.wait, followers)


@router.get(
    "/{program_id}/program",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_FILES | problems(404, 409, 422),
)
def get_program_file(parts: PartsOf, program_id: JobId, file: _FileName = None) -> Response:
    """Get a file of the compensated program: only numbers of its targets differ from what was sent."""
    result = _result(parts, program_id)
    found = next((each for each in result.files if file in {None, each.name}), None)
    if found is None:
        names = ", ".join(each.name for each in result.files)
        raise RequestError("the program has no such file", where="query.file", remedy=f"use one of {names}")
    path = PurePath(found.name)
    name = f"{path.stem}-corrected{path.suffix}" if result.corrected else found.name
    return Response(
        unpacked(found),
        media_type="application/octet-stream",
        headers={"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"},
    )


def _result(parts: PartsOf, program_id: str) -> ProgramResult:
    program = cast("Program", parts.jobs[Program.kind].current(program_id))
    if program.result is None:
        raise HTTPException(409, f"there are no corrected files: the program's state is {program.state}")
    return program.result


def _different(files: list[UploadFile]) -> list[UploadFile]:
    if len({file.filename for file in files}) < len(files):
        raise RequestError("two files have one name", where="files", remedy="send each file once")
    return files
