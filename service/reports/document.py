"""A report as data: sections of facts, paragraphs, tables and pictures. It knows no typesetting."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from jointstiff.service.tables.table import Table

Fact = tuple[str, str]
"""A label, and what is stated; lines are parted by a newline."""


@dataclass(frozen=True)
class Picture:
    """A picture that was drawn here."""

    svg: str  # SVG without links and scripts
    caption: str  # below it
    width: float = 1.0  # share of the text's width


@dataclass(frozen=True)
class Section:
    """A section; its parts stand in this order."""

    heading: str
    facts: list[Fact] = field(default_factory=list)
    paragraphs: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Letterhead:
    """The laboratory above the title."""

    name: str  # name of the laboratory
    lines: list[str]  # its address, contact and accreditation
    logo: bytes | None = None  # bytes of a PNG or JPEG; none without
    logo_type: Literal["png", "jpg"] = "png"  # format of the logo


@dataclass(frozen=True)
class State:
    """State of a report: draft, authorised or superseded."""

    kind: Literal["draft", "authorised", "superseded", "unsigned"]  # kind of the state
    line: str  # who authorised it and when, or what is missing
    number: int = 0  # counts the authorisations; zero for none
    issued_at: datetime | None = None  # when it was authorised; None for a draft
    by: str | None = None  # name of the key that authorised it

    @property
    def watermark(self) -> str:
        """Return what stands across each page; nothing if it is authorised, or nobody signs it."""
        return self.kind.upper() if self.kind in {"draft", "superseded"} else ""


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
    number: str  # number that identifies it, on each page
    state: State  # whether it is authorised
    letterhead: Letterhead  # letterhead of the laboratory
    dated: datetime  # date of the document's file
    sections: list[Section]  # in order; signature and end mark follow them
    attachments: list[Attachment] = field(default_factory=list)  # files within it
    signs: bool = True  # whether it has a line to sign
