"""Jobs of any kind in a form for people: verdict first, then tables, warnings and advice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rich.console import RenderableType

from jointstiff.schemas.finding import Assessment, Finding
from jointstiff.schemas.job import Job
from jointstiff.schemas.joints import JointKind
from jointstiff.service.kinds.kind import AnyKind, File
from jointstiff.service.reports.document import (
    ASSESSMENT,
    IDENTIFICATION,
    NOT_ISO_9283,
    ORIGIN,
    REQUESTED,
    RESULTS,
    STATED,
    Attachment,
    Document,
    Fact,
    Picture,
    Section,
    format_time,
    list_versions,
)
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.tables.report import (
    Report,
    View,
    hint_lines,
    list_request_fields,
    note_lines,
    problem_line,
    remedies,
    to_do_lines,
    verdict_lines,
    warning_lines,
    with_overall_verdict,
)
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import Chart, Line, Part, Sheet, Table, build_text_table
from jointstiff.service.tables.terminal import lay_out_parts

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work

_DEFAULT: Final = View()
_ACCEPTED_VERDICT: Final = Line(
    "  computed despite this verdict, because the request accepts the verdict", "bad"
)


def lay_out_job(
    kind: AnyKind,
    job: Job,
    *,
    details: bool = False,
    unit: str = DEFAULT_UNIT,
    applies: bool = False,
    door: str = "--details",
    change_text: Callable[[str], str] = str,
) -> RenderableType:
    """Lay out a job for the terminal.

    Args:
        kind: kind of the job.
        job: job with a result or an error.
        details: true to show all details of the result.
        unit: name of a unit of stiffness, a key of `UNITS`.
        applies: true if the command that made the job has the option `--apply`.
        door: option that shows all details.
        change_text: function that names the options of a command in a line, in place of fields of the API.
    """
    parts: list[Part] = [
        replace(part, text=change_text(part.text)) if isinstance(part, Line) else part
        for part in job_parts(kind, job, View(details, UNITS[unit], applies, door))
    ]
    if details:
        facts = [
            (label, text.replace("\n", "; "))
            for label, text in list_request_fields(job.request, joint_kinds_in(job))
        ]
        parts.append(build_text_table(["request", ""], facts, left_aligned=[0, 1]))
    return lay_out_parts(parts)


def joint_kinds_in(job: Job) -> dict[str, JointKind]:
    """Return the kind of each joint by name; empty if no joint is prismatic, or the job has no result."""
    kinds: dict[str, JointKind] = getattr(job.result, "joint_kinds", {})
    return kinds


def job_parts(kind: AnyKind, job: Job, view: View = _DEFAULT) -> list[Part]:
    """Return the lines, tables and charts that show a job: its result, or its error or state without one."""
    if job.result is None:
        return [problem_line(job.error) if job.error else Line(f"the {kind.name} is {job.state}")]
    report = kind.make_report(job, job.result, view)
    charts = kind.make_charts(job.result)
    assessment = getattr(job.result, "assessment", None)
    if not isinstance(assessment, Assessment):  # none, or that of a retired kind, which is shown as stored
        return [*report.parts, *report.evidence, *charts]
    report = replace(report, assumed=[*view.assumed, *report.assumed])
    warnings: Sequence[Finding] = getattr(job.result, "warnings", ())
    parts: list[Part] = [*verdict_lines(assessment, details=view.details)]
    if assessment.verdict == getattr(job.request, "accept_verdict", None):
        parts.append(_ACCEPTED_VERDICT)
    parts += report.parts
    parts += _list_further_parts(report, assessment, warnings, view)
    parts += report.evidence
    advice = [*remedies(assessment, applies=view.applies), *report.advice]
    parts += to_do_lines(advice, details=view.details)
    return [*parts, *charts]


def _list_further_parts(
    report: Report, assessment: Assessment, warnings: Sequence[Finding], view: View
) -> list[Part]:
    """Return what follows the results: with details all assumptions and warnings, otherwise hints."""
    if not view.details:
        return [*hint_lines(report, assessment, warnings, view.door)]
    assumed = [Line(f"  assumed: {each}", "dim") for each in view.assumed]
    return [*report.further, *assumed, *note_lines(assessment), *warning_lines(assessment, warnings)]


def build_job_sheet(file: File, job: Job, work: Callable[[], Work]) -> Sheet:
    """Return the table that a file of a succeeded job contains, with the overall verdict as a column.

    Args:
        file: description of a file that jobs of this kind have.
        job: job with a result.
        work: function that returns the job's work; called only if the file is made from the work.
    """
    sheet = file.sheet(job if file.made_of == "result" else work())
    return with_overall_verdict(sheet, getattr(job.result, "assessment", None))


def build_job_report(
    kind: AnyKind, job: Job, document: str, settings: LaboratorySettings, about: Sequence[Fact] = ()
) -> Document:
    """Build the report of a succeeded job: results first, and in one box what concerns trust in them.

    `document` is the JSON of the job, to be attached; `about` are further facts for the first section.
    """
    attachment = Attachment(
        f"{job.kind}.json", "application/json", "The job, with all its numbers", document.encode()
    )
    identity: list[Fact] = [
        ("Report", f"{kind.title}, {job.id}"),
        ("Computed", format_time(job.provenance.ended_at)),
        *about,
    ]
    return Document(
        title=kind.title,
        number=job.id,
        letterhead=settings.letterhead(),
        dated=job.provenance.ended_at or job.provenance.created_at,
        sections=[
            *_build_result_sections(job_parts(kind, job, View(details=True))),
            Section(IDENTIFICATION, facts=identity),
            Section(REQUESTED, facts=list_request_fields(job.request, joint_kinds_in(job))),
            Section(STATED, paragraphs=[NOT_ISO_9283]),
            Section(ORIGIN, facts=_list_facts_of_origin(job, attachment)),
        ],
        attachments=[attachment],
        signs=False,
    )


def _build_result_sections(parts: Sequence[Part]) -> list[Section]:
    """Return two sections of a job's output: tables and pictures; and all lines of text, in a box."""
    from jointstiff.service.reports.pictures import draw_bars

    tables, pictures, notes = list[Table](), list[Picture](), list[str]()
    for part in parts:
        match part:
            case Table():
                tables.append(part)
            case Chart():
                pictures.append(draw_bars(part))
            case Line():
                notes += map(str.strip, part.text.splitlines())
    return [
        Section(RESULTS, tables=tables, pictures=pictures),
        Section(ASSESSMENT, notes=[note for note in notes if note], boxed=True),
    ]


def _list_facts_of_origin(job: Job, attachment: Attachment) -> list[Fact]:
    """Return the facts by which the numbers of a report can be traced and computed again."""
    return [
        ("SHA-256 of the input", job.provenance.input_hash),
        ("Versions", list_versions(job)),
        ("Attached", f"{attachment.name}, with all numbers"),
    ]
