"""Files of jobs that have succeeded: reports and tables, as each kind declares them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Path, Request, Response
from fastapi.responses import StreamingResponse

from jointstiff.schemas.job import Job
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.bodies import large_bodies
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.api.reports import REPORT_FILES, ReportFormat, report_answer
from jointstiff.service.jobs.life import Jobs
from jointstiff.service.kinds.kind import AnyKind, File
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.report import job_sheet
from jointstiff.service.reports.job import job_document
from jointstiff.service.tables.files import csv_parts, written


def job_files() -> APIRouter:
    """Return the routes of all reports and tables."""
    router = APIRouter(route_class=AccessRoute)
    for kind in KINDS:
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

    report.__annotations__["job_id"] = _identifier(kind)
    router.get(
        f"/v1/{kind.collection}/{{{kind.name}_id}}/report.{{format}}",
        name=f"get_{kind.name}_report",
        dependencies=[VIEWER],
        tags=[kind.collection],
        description=f"Get the report of a {kind.name} as PDF or HTML: what was asked for, the tables of the "
        "result, versions and hash of the input. It is for information, and nobody signs it.",
        response_class=Response,
        responses=REPORT_FILES | problems(404, 409, 422),
    )(report)


def _add_file(router: APIRouter, kind: AnyKind, file: File) -> None:
    async def download(request: Request, parts: PartsOf, job_id: str) -> Response:
        jobs = parts.jobs[kind.name]

        def content_of() -> bytes | Iterator[str]:
            sheet = job_sheet(kind, file, _succeeded(jobs, job_id), lambda: jobs.work(job_id))
            return csv_parts(sheet) if file.suffix == "csv" else written(sheet, file.suffix)

        # Large tables take seconds: they wait for their turn, and leave the other requests theirs.
        content = await run_sync(content_of, limiter=large_bodies(request))
        name = f"{kind.name}-{job_id}.{file.suffix}"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        if isinstance(content, bytes):
            return Response(content, media_type=file.media_type, headers=headers)
        return StreamingResponse(content, media_type=file.media_type, headers=headers)

    download.__annotations__["job_id"] = _identifier(kind)
    schema: dict[str, Any] = (
        {"schema": {"type": "string", "format": "binary"}} if file.suffix == "npz" else {}
    )
    answer: dict[int | str, dict[str, Any]] = {
        200: {"description": file.content, "content": {file.media_type: schema}}
    }
    router.get(
        f"/v1/{kind.collection}/{{{kind.name}_id}}/{file.name}",
        name=file.operation,
        dependencies=[VIEWER],
        tags=[kind.collection],
        description=file.description,
        response_class=Response,
        responses=answer | problems(404, 409, 422),
    )(download)


def _identifier(kind: AnyKind) -> Any:  # noqa: ANN401 - a type
    return Annotated[str, Path(alias=f"{kind.name}_id", max_length=64)]


def _succeeded(jobs: Jobs, job_id: str) -> Job:
    """Return a job with its result.

    Raises:
        HTTPException: it has none.
    """
    job = jobs.current(job_id)
    if job.result is None:
        raise HTTPException(409, f"there is no result, because the {job.kind}'s state is {job.state}")
    return job
