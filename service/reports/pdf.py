"""A report as PDF/A-3b by Typst: the data go in as JSON, never as markup; no file is read, no host asked."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace
from datetime import UTC
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

from jointstiff.service.reports.document import Document
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    import typst

_TEMPLATE: Final = Path(__file__).with_name("template.typ")
_UNUSUAL: Final = re.compile(
    r"[^\x20-\u024F\u0370-\u03FF\u0400-\u04FF\u2010-\u2044\u2070-\u209F\u2190-\u2265]"
)
"""Characters that the fonts of Typst may lack, beyond Latin, Greek, Cyrillic and the signs of our texts."""


class NoTypstError(RequestError):
    """Typst is not installed."""

    def __init__(self) -> None:
        super().__init__(
            "reports as PDF need Typst, which is not installed",
            remedy="install jointstiff[reports], or ask for the report as HTML",
        )


def report_pdf(document: Document) -> bytes:
    """Return a report as PDF/A-3b with its attachments; the same document gives the same bytes.

    Characters that the fonts of Typst lack are shown by their code, such as ‹U+4E2D›; HTML and attachments
    have them as they are.

    Raises:
        NoTypstError: Typst is not installed.
    """
    try:
        import typst
    except ImportError as error:
        raise NoTypstError from error
    data = _data(document)
    try:
        return _compiled(data, document)
    except typst.TypstError as error:
        if "could not be displayed" not in error.message:
            raise
    return _compiled(_shown(data), document)


def _compiled(data: dict[str, Any], document: Document) -> bytes:
    import typst

    with TemporaryDirectory(prefix="jointstiff-report-") as empty:  # all that Typst may read
        compiler = typst.Compiler(
            _TEMPLATE.read_bytes(),
            root=empty,
            font_paths=_fonts(),
            sys_inputs={"document": json.dumps(data)},
            package_path=empty,
            package_cache_path=empty,
        )
        compiled = compiler.compile(
            format="pdf", pdf_standards="a-3b", timestamp=int(document.dated.timestamp())
        )
    return compiled if isinstance(compiled, bytes) else b""


@cache
def _fonts() -> typst.Fonts:
    """Return the fonts that Typst brings: reports look the same on every machine."""
    import typst

    return typst.Fonts(include_system_fonts=False)


def _data(document: Document) -> dict[str, Any]:
    """Return what the template reads."""
    dated, head = document.dated.astimezone(UTC), document.letterhead
    parts = ("year", "month", "day", "hour", "minute", "second")
    return {
        "title": document.title,
        "number": document.number,
        "state": {"kind": document.state.kind, "line": document.state.line},
        "by": document.state.by or "",
        "watermark": document.state.watermark,
        "letterhead": {"name": head.name, "lines": head.lines, "logo_type": head.logo_type},
        "logo": None if head.logo is None else list(head.logo),
        "dated": {part: getattr(dated, part) for part in parts},
        "sections": [
            asdict(replace(section, tables=[])) | {"tables": [table.shown() for table in section.tables]}
            for section in document.sections
        ],
        "signs": document.signs,
        "attachments": [asdict(each) | {"content": each.content.decode()} for each in document.attachments],
    }


def _shown(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return JSON with the code of each character that the fonts may lack; attachments stay as they are."""
    if isinstance(value, str):
        return _UNUSUAL.sub(lambda found: f"‹U+{ord(found[0]):04X}›" if found[0] != "\n" else "\n", value)
    if isinstance(value, list | tuple):
        return [_shown(each) for each in value]
    if isinstance(value, dict):
        return {name: each if name == "content" else _shown(each) for name, each in value.items()}
    return value
