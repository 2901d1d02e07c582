"""Files of jobs that have succeeded: reports and tables, as each kind declares them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Annotated, Any, Literal

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Path, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse
from pydantic import BaseModel

from jointstiff.schemas.job import Job
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.bodies import large_bodies
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.api.reports import REPORT_FILES, ReportFormat, report_answer
from jointstiff.service.jobs.life import Jobs
from jointstiff.service.kinds.kind import AnyKind, File
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.job import job_document, job_parts, job_sheet
from jointstiff.service.tables.files import csv_parts, written
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import Table

Unit = Literal["MNm/rad", "kNm/deg", "Nm/arcmin", "Nm/rad", "urad/Nm"]
"""Names of `UNITS`."""
Answers = dict[int | str, dict[str, Any]]


@cache
def job_files() -> APIRouter:
    """Return the routes of all reports, tables and files."""
    router = APIRouter(route_class=AccessRoute)
    for kind in KINDS:
        _add_tables(router, kind)
        if kind.reported:
            _add_report(router, kind)
        for file in kind.files:
            _add_file(router, kind, file)
    return router


def _add_report(router: APIRouter, kind: AnyKind) -> None:
    def report(request: Request, parts: PartsOf, job_id: str, format: ReportFormat) -> Response:  # noqa: A002
        job = _succeeded(parts.jobs[kind.name], job_id)
        document = kind.answered(parts.jobs[kind.name].document(job.id))
        robot_id = parts.jobs[kind.name].record(job.id).robot_id
        about = [] if robot_id is None else [("Robot", parts.store.robots.get(robot_id).name)]
        return report_answer(job_document(kind, job, document, request.app.state.laboratory, about), format)

    description = (
        f"Get the report of a {kind.name} as PDF or HTML: request, tables of the result, versions and hash "
        "of the input. It is for information, and is not signed."
    )
    _add(router, kind, "report.{format}", report, f"get_{kind.name}_report", description, REPORT_FILES)


def _add_tables(router: APIRouter, kind: AnyKind) -> None:
    async def tables(
        request: Request, parts: PartsOf, job_id: str, unit: Unit = "MNm/rad", *, details: bool = True
    ) -> Response:
        def answer_of() -> Response:
            job = _succeeded(parts.jobs[kind.name], job_id)
            shown = job_parts(kind, job, View(details, UNITS[unit]))
            listed = [part.shown() for part in shown if isinstance(part, Table)]
            assessment: BaseModel | None = getattr(job.result, "assessment", None)
            return JSONResponse(
                {"assessment": assessment and assessment.model_dump(mode="json"), "tables": listed}
            )

        return await run_sync(answer_of, limiter=large_bodies(request))

    description = (
        f"Get the tables of a {kind.name} as in the terminal, with its `assessment` (null if it has none): "
        "title, caption, head, rows of text, and the indices of text columns."
    )
    answer: Answers = {200: {"description": "The tables.", "content": {"application/json": {}}}}
    _add(router, kind, "tables.json", tables, f"get_{kind.name}_tables", description, answer)


def _add_file(router: APIRouter, kind: AnyKind, file: File) -> None:
    async def download(request: Request, parts: PartsOf, job_id: str) -> Response:
        jobs = parts.jobs[kind.name]

        def content_of() -> bytes | Iterator[str]:
            sheet = job_sheet(file, _succeeded(jobs, job_id), lambda: jobs.work(job_id))
            return csv_parts(sheet) if file.suffix == "csv" else written(sheet, file.suffix)

        # Large tables take seconds: they wait for their turn, and leave the other requests theirs.
        content = await run_sync(content_of, limiter=large_bodies(request))
        name = f"{kind.name}-{job_id}.{file.suffix}"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        if isinstance(content, bytes):
            return Response(content, media_type=file.media_type, headers=headers)
        return StreamingResponse(content, media_type=file.media_type, headers=headers)

    schema = {"schema": {"type": "string", "format": "binary"}} if file.suffix == "npz" else {}
    answer: Answers = {200: {"description": file.content, "content": {file.media_type: schema}}}
    _add(router, kind, file.name, download, file.operation, file.description, answer)


def _add(
    router: APIRouter,
    kind: AnyKind,
    file: str,
    route: Callable[..., Any],
    operation: str,
    description: str,
    answer: Answers,
) -> None:
    """Add the route of a file of a kind's jobs."""
    route.__annotations__["job_id"] = Annotated[str, Path(alias=f"{kind.name}_id", max_length=64)]
    router.get(
        f"/v1/{kind.collection}/{{{kind.name}_id}}/{file}",
        name=operation,
        dependencies=[VIEWER],
        tags=[kind.collection],
        description=description,
        response_class=Response,
        responses=answer | problems(404, 409, 422),
    )(route)


def _succeeded(jobs: Jobs, job_id: str) -> Job:
    """Return a job with its result."""
    job = jobs.current(job_id)
    if job.result is None:
        raise HTTPException(409, f"there is no result: the {job.kind}'s state is {job.state}")
    return job
