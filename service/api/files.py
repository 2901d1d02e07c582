"""Files of jobs: tables, reports, what a kind declares, and the models of runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import PurePath
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple, cast
from urllib.parse import quote

from fastapi import HTTPException, Request
from pydantic import BaseModel

from jointstiff.schemas.job import Job
from jointstiff.schemas.program import Program
from jointstiff.schemas.query import FileQuery
from jointstiff.schemas.robot import Robot
from jointstiff.schemas.run import Run
from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.kinds.kind import AnyKind, File
from jointstiff.service.kinds.program.work import unpacked
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.certificate import certificate
from jointstiff.service.reports.document import Document
from jointstiff.service.reports.exports import FORMATS, ExportedModel, ModelFormat, export_model
from jointstiff.service.reports.job import job_document, job_parts, job_sheet
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import POLICY, report_page, report_pdf
from jointstiff.service.reports.run import RunSubject, run_document
from jointstiff.service.tables.files import csv_parts, written
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import Line, Part, Table
from jointstiff.solver.errors import RequestError

_NO_HEADERS: Final[Mapping[str, str]] = MappingProxyType({})


class Content(NamedTuple):
    """Content of a file."""

    body: bytes | Iterator[str]
    media_type: str
    headers: Mapping[str, str] = _NO_HEADERS


@dataclass(frozen=True, eq=False)
class _Wanted:
    """A requested file."""

    laboratory: LaboratorySettings  # that issues reports
    parts: Parts
    jobs: Jobs  # those of its kind
    job_id: str
    name: str
    query: FileQuery

    @cached_property
    def job(self) -> Job:
        """The job, which has succeeded.

        Raises:
            HTTPException: it has no result (409).
        """
        return _require_result(self.jobs, self.job_id)


_Make = Callable[[_Wanted], Content]


def is_stored(kind: AnyKind, name: str) -> bool:
    """Return whether a file of a kind's jobs needs no work."""
    return _files(kind).get(name) is _corrected_program


def content_of(
    request: Request, parts: Parts, jobs: Jobs, job_id: str, name: str, query: FileQuery
) -> Content:
    """Return a file of a job.

    Raises:
        NotFoundError: there is no such job.
        HTTPException: there is no such file, or nothing to put into it (404), or no result (409).
        RequestError: the program has no file of that name.
    """
    make = _files(jobs.kind).get(name)
    if make is None:
        jobs.records.get(job_id)
        raise HTTPException(
            404, f"a {jobs.kind.name} has no such file; use one of {', '.join(names(jobs.kind))}"
        )
    return make(_Wanted(request.app.state.laboratory, parts, jobs, job_id, name, query))


def names(kind: AnyKind) -> list[str]:
    """Return the names of the files that a kind's jobs have."""
    return list(_files(kind))


@cache
def _files(kind: AnyKind) -> Mapping[str, _Make]:
    """Return what makes each file of a kind's jobs, by name."""
    made: dict[str, _Make] = {"tables.json": _tables}
    if kind.name == Run.kind_name():
        made |= {"report.pdf": _run_report, "report.html": _run_report, "report.xml": _certificate}
        made |= {f"model.{suffix}": _model for suffix in FORMATS}
    elif kind.reported:
        made |= {"report.pdf": _job_report, "report.html": _job_report}
    if kind.name == Program.kind_name():
        made["program"] = _corrected_program
    return made | {file.name: partial(_sheet, file) for file in kind.files}


def _tables(wanted: _Wanted) -> Content:
    view = View(wanted.query.details, UNITS[wanted.query.unit])
    tables = [
        part.shown() for part in job_parts(wanted.jobs.kind, wanted.job, view) if isinstance(part, Table)
    ]
    assessment: BaseModel | None = getattr(wanted.job.result, "assessment", None)
    report = wanted.jobs.kind.report(wanted.job, wanted.job.result, view)
    verdict = assessment and assessment.model_dump(mode="json")
    shown = {
        "assessment": verdict,
        "tables": tables,
        "lines": _lines(report.parts),
        "evidence": _lines(report.evidence),
    }
    return Content(json.dumps(shown, ensure_ascii=False, allow_nan=False).encode(), "application/json")


def _lines(parts: Sequence[Part]) -> list[str]:
    """Return the lines of a report that are not tables."""
    lines = (line.strip() for part in parts if isinstance(part, Line) for line in part.text.splitlines())
    return [line for line in lines if line]


def _sheet(file: File, wanted: _Wanted) -> Content:
    kind, job = wanted.jobs.kind, wanted.job
    sheet = job_sheet(file, job, lambda: wanted.jobs.work(job.id))
    if not sheet.columns:
        what = file.description.partition(",")[0]
        reason = f"this {kind.name} has no rows for {file.name}, {what}"
        raise HTTPException(404, f"{reason}; use tables.json, or another of its files")
    body = csv_parts(sheet) if file.suffix == "csv" else written(sheet, file.suffix)
    return Content(body, file.media_type, _file_response(f"{kind.name}-{job.id}.{file.suffix}"))


def _job_report(wanted: _Wanted) -> Content:
    jobs, parts, job_id = wanted.jobs, wanted.parts, wanted.job_id
    record = jobs.records.get(job_id)
    about = [] if record.robot_id is None else [("Robot", parts.store.robots.get(record.robot_id).name)]
    answered = jobs.kind.answered(record.document)
    return _write_sheet(job_document(jobs.kind, wanted.job, answered, wanted.laboratory, about), wanted.name)


def _run_report(wanted: _Wanted) -> Content:
    subject = run_subject(wanted.parts, wanted.job_id, wanted.laboratory)
    return _write_sheet(run_document(subject), wanted.name)


def _certificate(wanted: _Wanted) -> Content:
    subject = run_subject(wanted.parts, wanted.job_id, wanted.laboratory)
    return Content(
        certificate(subject), "application/xml", _file_response(f"certificate-{wanted.job_id}.xml")
    )


def _model(wanted: _Wanted) -> Content:
    suffix = cast("ModelFormat", wanted.name.partition(".")[2])
    model = export_model(exported_model(wanted.parts, wanted.job_id), suffix, wanted.query.accept_verdict)
    return Content(model, FORMATS[suffix].media_type, _file_response(f"model-{wanted.job_id}.{suffix}"))


def _corrected_program(wanted: _Wanted) -> Content:
    result, file = cast("Program", wanted.job).result, wanted.query.file
    found = next((each for each in result.files if file in {None, each.name}), None) if result else None
    if result is None or found is None:
        known = ", ".join(each.name for each in result.files) if result else ""
        raise RequestError("the program has no such file", where="query.file", remedy=f"use one of {known}")
    path = PurePath(found.name)
    name = f"{path.stem}-corrected{path.suffix}" if result.corrected else found.name
    disposition = f"attachment; filename*=UTF-8''{quote(name, safe='')}"
    return Content(unpacked(found), "application/octet-stream", {"Content-Disposition": disposition})


def _require_result(jobs: Jobs, job_id: str) -> Job:
    """Return a job with its result."""
    job = jobs.current(job_id)
    if job.result is None:
        raise HTTPException(409, f"there is no result: the {job.kind}'s state is {job.state}")
    return job


def _write_sheet(document: Document, name: str) -> Content:
    if name == "report.pdf":
        return _report(report_pdf(document), document.number, "pdf")
    return _report(report_page(document), document.number, "html")


def _report(content: bytes, number: str, suffix: Literal["pdf", "html"]) -> Content:
    headers = {"Content-Disposition": f'inline; filename="report-{number}.{suffix}"'}
    if suffix == "html":
        return Content(content, "text/html", headers | {"Content-Security-Policy": POLICY})
    return Content(content, "application/pdf", headers)


def _file_response(name: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="{name}"'}


def exported_model(parts: Parts, run_id: str) -> ExportedModel:
    """Return the model of a stored run.

    Raises:
        HTTPException: the run has no result.
    """
    run = cast("Run", _require_result(parts.jobs[Run.kind_name()], run_id))
    prepared = parts.sets.prepared(run.request.measurement_set_id)
    stored = Robot.model_validate_json(parts.store.robots.get(prepared.robot_id).document)
    return ExportedModel(run, cast("Any", run.result), prepared.robot, stored.name, stored.geometry_id)


def run_subject(parts: Parts, run_id: str, settings: LaboratorySettings) -> RunSubject:
    """Return what the report of a run is about.

    Raises:
        HTTPException: the run has no result.
    """
    model = exported_model(parts, run_id)
    readings = parts.sets.document(model.run.request.measurement_set_id)
    return RunSubject(model, readings, settings)


def _media_types() -> dict[str, Any]:
    """Return the media types of all files, for OpenAPI."""
    own = {file.media_type for kind in KINDS for file in kind.files}
    fixed = {"application/json", "application/pdf", "text/html", "application/octet-stream"}
    types = sorted(own | fixed | {each.media_type for each in FORMATS.values()})
    binary = {"schema": {"type": "string", "format": "binary"}}
    return {name: binary if name == "application/octet-stream" else {} for name in types}


def _description() -> str:
    """Return the description of the operation: the files of each kind."""
    listed = [f"* {kind.name}: {', '.join(f'`{name}`' for name in names(kind))}" for kind in KINDS]
    own = [f"* `{file.name}` of a {kind.name}: {file.description}" for kind in KINDS for file in kind.files]
    return "\n".join([_FILES_TEXT, "", *listed, "", *own])


_FILES_TEXT: Final = """Get a file of a job that has succeeded. Its names are:

* `tables.json`: the tables as in the terminal (title, caption, head, rows of text, indices of text columns),
  its other lines (`lines`, `evidence`), and the `assessment`
* `report.pdf`, `report.html`: request, tables, versions and hash of the input; of a run after ISO/IEC 17025,
  with lines to sign, PDF/A-3b with the run attached
* `report.xml` of a run: a digital calibration certificate, DCC 3.3.0; needs `measured_at` of the set, and
  `country` and `responsible` of the laboratory's settings
* `model.…` of a run: tables with intervals (csv, xlsx), or MJCF with a spring for each joint that has one;
  refused for the verdict `do_not_use` without `accept_verdict`
* `program` of a program: a compensated file (`file`); only numbers of its targets differ"""


FILES_DESCRIPTION: Final = _description()
FILES: Final[dict[int | str, dict[str, Any]]] = {200: {"description": "The file.", "content": _media_types()}}
