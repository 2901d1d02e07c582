"""A report as data, independent of its format: sections and attachments."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Final, Literal

from jointstiff.schemas.job import Job
from jointstiff.service.tables.table import NO_NUMBER, Table
from jointstiff.solver.text import figure

NOT_STATED: Final = "not stated"

# Headings of sections
IDENTIFICATION: Final = "Identification"
REQUESTED: Final = "Request"
RESULTS: Final = "Results"
TO_SIGN: Final = ("Date of receipt of the item", "Date of issue", "Place and date", "Name and signature")
"""Lines at the end of a report that a laboratory signs, to be filled in by hand."""
STATED: Final = "Statements"
ASSESSMENT: Final = "Assessment and warnings"
ORIGIN: Final = "Origin of the numbers"
NOT_ISO_9283: Final = (
    "The results are derived from the identified stiffness of the joints. They are not a test of static "
    "compliance after ISO 9283:1998, clause 10, and do not replace one."
)


def format_time(time: datetime | None) -> str:
    """Return a time as text in UTC, to the minute, such as "2026-11-20 13:30 UTC"; `not stated` for None."""
    return NOT_STATED if time is None else f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def format_percent(share: float | None) -> str:
    """Return a share (1.0 is 100 %) as text in percent; `NO_NUMBER` for None."""
    return NO_NUMBER if share is None else f"{figure(100 * share, '.3g')} %"


def list_versions(job: Job) -> str:
    """Return the names and versions of the software that computed a job, as one line."""
    return ", ".join(f"{name} {version}" for name, version in sorted(job.provenance.versions.items()))


Fact = tuple[str, str]
"""A label and its text; a newline separates lines of the text."""


@dataclass(frozen=True)
class Picture:
    """A picture that this program has drawn."""

    svg: str  # SVG without links and scripts
    caption: str  # text below the picture
    width: float = 1.0  # share of the text's width


@dataclass(frozen=True)
class Section:
    """A section of a report; its parts are shown in the order of the fields."""

    heading: str
    facts: list[Fact] = field(default_factory=list)
    paragraphs: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    boxed: bool = False  # whether a frame is drawn around the section


@dataclass(frozen=True)
class Logo:
    """Logo of a laboratory."""

    content: bytes
    kind: Literal["png", "jpg"]


@dataclass(frozen=True)
class Letterhead:
    """Head of a report, above the title: the laboratory."""

    name: str  # name of the laboratory
    lines: list[str]  # its address, contact and accreditation
    logo: Logo | None = None


@dataclass(frozen=True)
class Attachment:
    """A file within the report."""

    name: str
    media_type: str
    description: str
    content: bytes


@dataclass(frozen=True)
class Document:
    """A report."""

    title: str  # title of the report
    number: str  # number that identifies the report, on each page
    letterhead: Letterhead  # letterhead of the laboratory
    dated: datetime  # date of the document's file
    sections: list[Section]  # in order; lines to sign and the end mark follow the last section
    attachments: list[Attachment] = field(default_factory=list)  # files within the report
    signs: bool = True  # true if the report has lines to sign
