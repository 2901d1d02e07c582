"""A report as data: sections of facts, paragraphs, tables and pictures. It knows no typesetting."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

Fact = tuple[str, str]
"""A label, and what is stated; lines are parted by a newline."""


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        head: headers, with units.
        rows: cells, as many as headers.
        caption: above it.
        texts: columns that hold text and not numbers.
    """

    head: list[str]
    rows: list[list[str]]
    caption: str = ""
    texts: list[int] = field(default_factory=lambda: [0])


@dataclass(frozen=True)
class Picture:
    """A picture that was drawn here.

    Attributes:
        svg: SVG without links and scripts.
        caption: below it.
        width: share of the text's width.
    """

    svg: str
    caption: str
    width: float = 1.0


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
    """The laboratory above the title.

    Attributes:
        name: of the laboratory.
        lines: its address, contact and accreditation.
        logo: bytes of a PNG or JPEG; none without.
        logo_type: of these bytes.
    """

    name: str
    lines: list[str]
    logo: bytes | None = None
    logo_type: Literal["png", "jpg"] = "png"


@dataclass(frozen=True)
class State:
    """State of a report: draft, authorised or superseded.

    Attributes:
        kind: of the state.
        line: who authorised it and when, or what is missing.
        number: counts the authorisations; zero for none.
        issued_at: when it was authorised; None for a draft.
        by: name of the key that authorised it.
    """

    kind: Literal["draft", "authorised", "superseded", "unsigned"]
    line: str
    number: int = 0
    issued_at: datetime | None = None
    by: str | None = None

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
    """A report.

    Attributes:
        title: of the report.
        number: that identifies it, on each page.
        state: whether it is authorised.
        letterhead: of the laboratory.
        dated: date of the document's file.
        sections: in order; signature and end mark follow them.
        attachments: files within it.
        signs: whether it has a line to sign.
    """

    title: str
    number: str
    state: State
    letterhead: Letterhead
    dated: datetime
    sections: list[Section]
    attachments: list[Attachment] = field(default_factory=list)
    signs: bool = True
