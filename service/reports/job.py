"""Reports of other jobs, all by one template: what was asked for, and the tables that the terminal shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from io import StringIO
from types import MappingProxyType
from typing import Any, Final

from rich.console import Console, Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from jointstiff.schemas.comparison import Comparison
from jointstiff.schemas.job import Job
from jointstiff.schemas.map import Map
from jointstiff.schemas.pair import Pair
from jointstiff.schemas.plan import Plan
from jointstiff.schemas.program import Program
from jointstiff.service.kinds.comparison.tables import comparison_report
from jointstiff.service.kinds.map.tables import map_report
from jointstiff.service.kinds.pair.tables import pair_report
from jointstiff.service.kinds.plan.tables import plan_report
from jointstiff.service.kinds.program.tables import program_report
from jointstiff.service.reports.document import Attachment, Document, Fact, Section, State, Table
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.statements import IDENTIFICATION, NOT_ISO_9283, ORIGIN, RESULTS, STATED
from jointstiff.service.reports.wording import moment

_WIDTH: Final = 110
_TITLES: Final[Mapping[str, str]] = MappingProxyType(
    {
        Comparison.kind: "Comparison of methods",
        Pair.kind: "Comparison of two measurement sets",
        Plan.kind: "Plan of a campaign",
        Map.kind: "Map of a work area",
        Program.kind: "Compensated program",
    }
)
_RENDERED: Final[Mapping[str, Callable[[Any], RenderableType]]] = MappingProxyType(
    {
        Comparison.kind: lambda job: comparison_report(job, details=True),
        Pair.kind: lambda job: pair_report(job, details=True),
        Plan.kind: plan_report,
        Map.kind: map_report,
        Program.kind: program_report,
    }
)
REPORTED_KINDS: Final = tuple(_TITLES)
"""Kinds of jobs that have such a report."""
_UNSIGNED: Final = State("unsigned", "For information: reports of this kind are not authorised.")


def job_document(job: Job, document: str, settings: LaboratorySettings) -> Document:
    """Return the report of a job that has succeeded.

    Args:
        job: of one of `REPORTED_KINDS`.
        document: JSON of the job, which is attached.
        settings: of the laboratory.
    """
    title, provenance = _TITLES[job.kind], job.provenance
    tables, notes = _parts(_RENDERED[job.kind](job))
    versions = ", ".join(f"{name} {version}" for name, version in sorted(provenance.versions.items()))
    return Document(
        title=title,
        number=job.id,
        state=_UNSIGNED,
        letterhead=settings.letterhead(),
        dated=provenance.ended_at or provenance.created_at,
        sections=[
            Section(
                IDENTIFICATION,
                facts=[
                    ("Report", f"{title}, {job.id}"),
                    ("Computed", moment(provenance.ended_at)),
                    *_asked(job),
                ],
            ),
            Section(RESULTS, tables=tables, notes=notes),
            Section(STATED, paragraphs=[NOT_ISO_9283]),
            Section(
                ORIGIN,
                facts=[
                    ("SHA-256 of the input", provenance.input_hash),
                    ("Versions", versions),
                    ("Attached", f"{job.kind}.json, with all numbers"),
                ],
            ),
        ],
        attachments=[
            Attachment(
                f"{job.kind}.json", "application/json", "The job, with all its numbers", document.encode()
            )
        ],
        signs=False,
    )


def _asked(job: Job) -> Iterator[Fact]:
    """Yield what was asked for, as far as it is a word or a number and no default."""
    for name, value in job.request.model_dump(exclude_defaults=True).items():
        if isinstance(value, str | int | float):
            yield name.replace("_", " ").capitalize(), str(value)


def _parts(shown: RenderableType) -> tuple[list[Table], list[str]]:
    """Return the tables and the lines of what the terminal shows."""
    tables: list[Table] = []
    lines: list[str] = []
    for part in shown.renderables if isinstance(shown, Group) else [shown]:
        if isinstance(part, RichTable):
            tables.append(_table(part))
        else:
            lines += [line.strip() for line in _plain(part).splitlines() if line.strip()]
    return tables, lines


def _table(table: RichTable) -> Table:
    columns = [[_plain(cell) for cell in column.cells] for column in table.columns]
    captions = [_plain(each) for each in (table.title, table.caption) if each]
    texts = [place for place, column in enumerate(table.columns) if column.justify != "right"]
    return Table(
        [_plain(column.header) for column in table.columns],
        [list(row) for row in zip(*columns, strict=True)],
        "; ".join(captions).replace("\n", " "),
        texts,
    )


def _plain(shown: RenderableType) -> str:
    """Return text without its styles."""
    if isinstance(shown, Text):
        return shown.plain
    if isinstance(shown, str):
        return Text.from_markup(shown).plain
    text = StringIO()
    Console(file=text, width=_WIDTH, color_system=None).print(shown)
    return text.getvalue()
