"""Files of jobs: tables, reports, files that a kind of job declares, and the models of runs."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import PurePath
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple, cast
from urllib.parse import quote

from fastapi import HTTPException, Request
from pydantic import BaseModel

from jointstiff.schemas.correction import CorrectionJob
from jointstiff.schemas.job import Job
from jointstiff.schemas.query import FileQuery
from jointstiff.schemas.retired import RetiredJob
from jointstiff.schemas.robot import Robot
from jointstiff.schemas.run import Run
from jointstiff.service.api.answers import make_missing_error
from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.kinds.kind import AnyKind, File
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.problems import NotFoundError
from jointstiff.service.reports.document import Document
from jointstiff.service.reports.exports import FORMATS, ExportedModel, ModelFormat, export_model
from jointstiff.service.reports.job import build_job_report, build_job_sheet, job_parts
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import POLICY, render_html, render_pdf
from jointstiff.service.reports.run import RunSubject, build_run_report
from jointstiff.service.tables.files import csv_parts, write_sheet
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import Line, Part, Table
from jointstiff.solver.errors import RequestError

_NO_HEADERS: Final[Mapping[str, str]] = MappingProxyType({})


class Content(NamedTuple):
    """Content of a file with its media type and headers; a large table is an iterator of its parts."""

    body: bytes | Iterator[str]
    media_type: str
    headers: Mapping[str, str] = _NO_HEADERS


@dataclass(frozen=True, eq=False)
class _RequestedFile:
    """File of a job that a client requests, with the data from which it is made."""

    laboratory: LaboratorySettings  # settings of the laboratory that issues reports
    parts: Parts
    jobs: Jobs  # all jobs of the same kind
    job_id: str
    name: str
    query: FileQuery

    @cached_property
    def job(self) -> Job:
        """Job with its result.

        Raises:
            HTTPException: the job has no result (409).
        """
        return _require_result(self.jobs, self.job_id)


_MakeContent = Callable[[_RequestedFile], Content]


def is_stored_file(kind: AnyKind, name: str) -> bool:
    """Return whether this file of a kind of job is stored with the result, so that nothing is computed."""
    # Of the present kinds, only a correction has files whose content the result of a job contains.
    return kind.name in RETIRED or _find_content_makers(kind).get(name) is _make_program_file


def make_file(
    request: Request, parts: Parts, jobs: Jobs, job_id: str, name: str, query: FileQuery
) -> Content:
    """Return the content of a file of a job.

    Raises:
        NotFoundError: the job does not exist.
        HTTPException: the job has no such file or nothing to write to it (404), or no result (409).
        RequestError: the program has no file of that name.
    """
    requested = _RequestedFile(request.app.state.laboratory, parts, jobs, job_id, name, query)
    if jobs.kind.name in RETIRED:
        return _make_stored_file(requested)
    make = _find_content_makers(jobs.kind).get(name)
    if make is None:
        jobs.records.get(job_id)
        raise HTTPException(
            404, f"a {jobs.kind.name} has no such file; use one of {', '.join(file_names(jobs.kind))}"
        )
    return make(requested)


def _make_stored_file(requested: _RequestedFile) -> Content:
    """Return a file of a job of a retired kind as it was stored.

    `program`, as which earlier versions delivered programs, is the file of the query, or the first one.
    """
    job = cast("RetiredJob", requested.job)
    names = [file.name for file in job.files]
    name = requested.name
    if name == "program":
        name = requested.query.file or next(iter(names), name)
    for file in job.files:
        if file.name == name:
            disposition = f"attachment; filename*=UTF-8''{quote(name, safe='')}"
            headers = {"Content-Disposition": disposition}
            return Content(decompress_file(file), "application/octet-stream", headers)
    detail = f"the job has no such file; use one of {', '.join(names)}" if names else "the job has no files"
    raise HTTPException(404, detail)


def file_names(kind: AnyKind) -> list[str]:
    """Return the names of the files that jobs of a kind have, such as `report.pdf`."""
    return list(_find_content_makers(kind))


@cache
def _find_content_makers(kind: AnyKind) -> Mapping[str, _MakeContent]:
    """Return the functions that make the files of a kind's jobs, as a dict: file's name → function."""
    maker_by_name: dict[str, _MakeContent] = {"tables.json": _make_tables_json}
    if kind.name == Run.kind_name():
        maker_by_name |= {
            "report.pdf": _make_run_report,
            "report.html": _make_run_report,
        }
        maker_by_name |= {f"model.{suffix}": _make_model_file for suffix in FORMATS}
    elif kind.has_report:
        maker_by_name |= {"report.pdf": _make_job_report, "report.html": _make_job_report}
    if kind.writes_programs:
        maker_by_name["program"] = _make_program_file
    return maker_by_name | {file.name: partial(_make_table_file, file) for file in kind.files}


def _make_tables_json(requested: _RequestedFile) -> Content:
    """Return `tables.json`: tables, text lines, evidence and assessment of a job, as in the terminal."""
    view = View(requested.query.details, UNITS[requested.query.unit])
    tables = [
        part.shown()
        for part in job_parts(requested.jobs.kind, requested.job, view)
        if isinstance(part, Table)
    ]
    assessment: BaseModel | None = getattr(requested.job.result, "assessment", None)
    report = requested.jobs.kind.make_report(requested.job, requested.job.result, view)
    assessment_json = assessment and assessment.model_dump(mode="json")
    document = {
        "assessment": assessment_json,
        "tables": tables,
        "lines": _list_text_lines([*report.parts, *report.further]),
        "evidence": _list_text_lines(report.evidence),
    }
    return Content(json.dumps(document, ensure_ascii=False, allow_nan=False).encode(), "application/json")


def _list_text_lines(parts: Sequence[Part]) -> list[str]:
    """Return the non-empty text lines of a report's parts, without its tables."""
    lines = (line.strip() for part in parts if isinstance(part, Line) for line in part.text.splitlines())
    return [line for line in lines if line]


def _make_table_file(file: File, requested: _RequestedFile) -> Content:
    """Return a table of a job as a file, such as CSV; raise HTTPException (404) if it has no rows."""
    kind, job = requested.jobs.kind, requested.job
    sheet = build_job_sheet(file, job, lambda: requested.jobs.work(job.id))
    if not sheet.columns:
        file_words = file.description.partition(",")[0]
        reason = f"this {kind.name} has no rows for {file.name}, {file_words}"
        raise HTTPException(404, f"{reason}; use tables.json, or another file of the job")
    body = csv_parts(sheet) if file.suffix == "csv" else write_sheet(sheet, file.suffix)
    is_alone = sum(each.suffix == file.suffix for each in kind.files) == 1
    table = "" if is_alone else f" {PurePath(file.name).stem}"
    return Content(body, file.media_type, _make_disposition(requested, f"{kind.name}{table}", file.suffix))


def _make_job_report(requested: _RequestedFile) -> Content:
    """Return the report of a job that is not a run, as PDF or HTML."""
    jobs, parts, job_id = requested.jobs, requested.parts, requested.job_id
    record = jobs.records.get(job_id)
    subject_lines = (
        [] if record.robot_id is None else [("Robot", parts.store.robots.get(record.robot_id).name)]
    )
    json_text = jobs.kind.to_answer(record.document)
    return _render_report(
        build_job_report(jobs.kind, requested.job, json_text, requested.laboratory, subject_lines), requested
    )


def _make_run_report(requested: _RequestedFile) -> Content:
    """Return the report of a run, as PDF or HTML."""
    subject = make_run_subject(requested.parts, requested.job_id, requested.laboratory)
    return _render_report(build_run_report(subject), requested)


def _make_model_file(requested: _RequestedFile) -> Content:
    """Return the identified model of a run in the format of the file's ending."""
    suffix = cast("ModelFormat", requested.name.partition(".")[2])
    model = export_model(
        prepare_exported_model(requested.parts, requested.job_id), suffix, requested.query.accept_verdict
    )
    return Content(model, FORMATS[suffix].media_type, _make_disposition(requested, "model", suffix))


def _make_program_file(requested: _RequestedFile) -> Content:
    """Return a file of a program that was corrected: that of the query, or the first one.

    Its name tells it from the original.

    Raises:
        RequestError: the correction has no file of this name.
    """
    result, file = cast("CorrectionJob", requested.job).result, requested.query.file
    program = None if result is None else result.program
    files = [] if program is None else program.files
    chosen = next((candidate for candidate in files if file in {None, candidate.name}), None)
    if program is None or chosen is None:
        names = ", ".join(candidate.name for candidate in files)
        remedy = f"use one of {names}" if files else "use `rows.csv`"
        raise RequestError("the correction has no such file", where="query.file", remedy=remedy)
    path = PurePath(chosen.name)
    ending = "-corrected" if program.corrected else ""
    name = f"{path.stem}{ending}{path.suffix}"
    disposition = f"attachment; filename*=UTF-8''{quote(name, safe='')}"
    return Content(decompress_file(chosen), "application/octet-stream", {"Content-Disposition": disposition})


def _require_result(jobs: Jobs, job_id: str) -> Job:
    """Return a job; raise HTTPException (409) if it has no result."""
    job = jobs.current(job_id)
    if job.result is None:
        raise make_missing_error(job, "result")
    return job


def _render_report(document: Document, requested: _RequestedFile) -> Content:
    """Render a report as PDF if `report.pdf` is requested, else as HTML; a browser displays the report."""
    is_run = requested.jobs.kind.name == Run.kind_name()
    words = "stiffness" if is_run else requested.jobs.kind.name
    if requested.name == "report.pdf":
        headers = _make_disposition(requested, words, "pdf", "inline")
        return Content(render_pdf(document), "application/pdf", headers)
    headers = _make_disposition(requested, words, "html", "inline") | {"Content-Security-Policy": POLICY}
    return Content(render_html(document), "text/html", headers)


def _make_disposition(
    requested: _RequestedFile, words: str, suffix: str, use: Literal["attachment", "inline"] = "attachment"
) -> dict[str, str]:
    """Return the header with the name under which a browser saves a file.

    The name tells people the robot's serial number, the measurement set, the day and the content of a file:
    `F-2110 press 2026-09-21 stiffness.pdf`.

    Args:
        requested: the file.
        words: content of the file, such as `stiffness`.
        suffix: ending of the name, without the point.
        use: `attachment` if a browser saves the file, `inline` if it displays the file.
    """
    # A report states its number inside; of other files the name tells from which job they are.
    number = [] if use == "inline" else [requested.job_id[:8]]
    name = f"{' '.join([*_subject_words(requested), words, *number])}.{suffix}"
    return {"Content-Disposition": f"{use}; filename*=UTF-8''{quote(name, safe=' ').replace(' ', '%20')}"}


def _subject_words(requested: _RequestedFile) -> list[str]:
    """Return serial number, name and day of the measurement set of a job; of its robot if it has no set.

    The day is that of the measurement in UTC; if it is not stated, the day on which the job was posted.
    """
    record, store = requested.jobs.records.get(requested.job_id), requested.parts.store
    serial_number, subject, time = None, None, record.created_at
    # What a job is about may have been deleted since.
    with suppress(NotFoundError):
        if record.measurement_set_id is not None:
            measured = store.sets.get(record.measurement_set_id)
            serial_number, subject = measured.serial_number, measured.name
            time = measured.measured_at or record.created_at
        elif record.robot_id is not None:
            subject = store.robots.get(record.robot_id).name
    words = [_as_file_name(each) for each in (serial_number, subject) if each]
    return [*filter(None, words), f"{time:%Y-%m-%d}"]


_UNSAFE: Final = re.compile(r'[\x00-\x1f\x7f-\x9f<>:"/\\|?*\u200e\u200f\u202a-\u202e\u2066-\u2069]+')
"""Characters that a file system refuses, or that change the order in which a name is read."""
_LONGEST_PART: Final = 60
"""Most characters of a serial number or of a name in the name of a file."""


def _as_file_name(text: str) -> str:
    """Return a text that may be a part of a file's name on any system."""
    return _UNSAFE.sub("-", text)[:_LONGEST_PART].strip(" .-")


def prepare_exported_model(parts: Parts, run_id: str) -> ExportedModel:
    """Return the identified model of a stored run, with its robot.

    Raises:
        HTTPException: the run has no result (409).
    """
    run = cast("Run", _require_result(parts.jobs[Run.kind_name()], run_id))
    prepared = parts.sets.prepared(run.request.measurement_set_id)
    stored = Robot.model_validate_json(parts.store.robots.get(prepared.robot_id).document)
    return ExportedModel(run, cast("Any", run.result), prepared.robot, stored.name, stored.geometry_id)


def make_run_subject(parts: Parts, run_id: str, settings: LaboratorySettings) -> RunSubject:
    """Return the subject of a run's report: identified model, readings, and settings of the laboratory.

    Raises:
        HTTPException: the run has no result (409).
    """
    model = prepare_exported_model(parts, run_id)
    readings = parts.sets.document(model.run.request.measurement_set_id)
    return RunSubject(model, readings, settings)


def _describe_media_types() -> dict[str, Any]:
    """Return the media types of all files of jobs, with their schemas for OpenAPI."""
    types_of_kinds = {file.media_type for kind in KINDS for file in kind.files}
    general_types = {"application/json", "application/pdf", "text/html", "application/octet-stream"}
    types = sorted(types_of_kinds | general_types | {format_.media_type for format_ in FORMATS.values()})
    binary = {"schema": {"type": "string", "format": "binary"}}
    return {name: binary if name == "application/octet-stream" else {} for name in types}


def _write_description() -> str:
    """Return the description of the operation `get_job_file`, with the files of each kind of job."""
    tables = {kind: {file.name: file.description for file in kind.files} for kind in KINDS}
    lines = [f"* {kind.name}: {_list_files(file_names(kind), tables[kind])}" for kind in KINDS]
    return "\n".join([_FILES_TEXT, "", *lines])


def _list_files(names: list[str], tables: dict[str, str]) -> str:
    """Return the names of files as one text; the names of tables with their descriptions."""
    plain = [f"`{name}`" for name in names if name not in tables and name != "tables.json"]
    described = [f"`{name}` ({text})" for name, text in tables.items()]
    return ", ".join((*plain, *described))


_FILES_TEXT: Final = """Get a file of a job that has succeeded. Its names are:

* `tables.json` of any job: the tables and lines of the terminal, and the `assessment`
* `report.pdf`, `report.html`: request, tables, versions, hash of the input; of a run after ISO/IEC 17025,
  with lines to sign, PDF/A-3b with the run attached
* `model.…` of a run: tables with intervals (csv, xlsx), or MJCF with springs; `do_not_use` needs
  `accept_verdict`
* `program` of the correction of a program: a corrected file (`file`); only numbers of its targets differ
* tables, by the kind of the job; their headers have the units"""


FILES_DESCRIPTION: Final = _write_description()
FILES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The file.", "content": _describe_media_types()}
}
