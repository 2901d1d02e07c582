"""A report as one HTML page, and as PDF/A-3b by Typst."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from datetime import UTC
from functools import cache
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

from jointstiff.service.reports.document import TO_SIGN, Document, Letterhead, Logo, Section
from jointstiff.service.tables.table import Line, Table
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    import typst

_STYLE: Final = """
body { font: 15px/1.45 Georgia, serif; color: #222; max-width: 52rem; margin: 2rem auto; padding: 0 1rem; }
header { border-bottom: 1px solid #222; } header img { float: right; max-height: 64px; max-width: 200px; }
h1 { margin: 0.6rem 0 0; } header p { overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 1.6rem 0 0.5rem; }
table { border-collapse: collapse; margin: 0.5rem 0; font-size: 0.9rem; } .wide { overflow-x: auto; }
th, td { text-align: right; padding: 2px 8px; border-bottom: 1px solid #ccc; vertical-align: top; }
th { border-bottom-color: #222; } .text, caption { text-align: left; } .dim { color: #767676; }
caption, figcaption, dt, .end { color: #5a5a5a; }
dl { display: grid; grid-template-columns: minmax(0, 16rem) minmax(50%, 1fr); gap: 2px 1rem; }
dd { margin: 0; white-space: pre-line; overflow-wrap: anywhere; }
.box { border: 1px solid #222; padding: 0 1rem; } figure { margin: 1rem 0; } figure svg { width: 100%; }
.sign { display: grid; grid-template-columns: 1fr 1fr; gap: 3rem; margin-top: 4rem; }
.sign p { border-top: 1px solid #222; } .end { text-align: center; }
"""
POLICY: Final = (
    "default-src 'none'; img-src data:; frame-ancestors 'none'; style-src 'sha256-"
    f"{base64.b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode()}'"
)
"""Content security policy: allows this style and pictures within the page, and nothing else."""


def render_html(document: Document) -> bytes:
    """Return a report as one HTML page (UTF-8) without links to other files."""
    title, number = escape(document.title), escape(document.number)
    parts = [
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title} {number}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}</style></head><body><header>",
        _letterhead_html(document.letterhead),
        f"<h1>{title}</h1><p>{number}</p>",
        "</header>",
    ]
    for position, section in enumerate(document.sections, 1):
        parts.append(_section_html(position, section))
    if document.signs:
        lines = [f"<p>{line}</p>" for line in TO_SIGN]
        parts += ['<div class="sign">', *lines, "</div>"]
    parts.append(f'<p class="end">— End of report {number} —</p></body></html>\n')
    return "\n".join(parts).encode()


def _letterhead_html(head: Letterhead) -> str:
    """Return the HTML of a letterhead, with the logo as a data URL."""
    logo = ""
    if head.logo is not None:
        kind = head.logo.kind.replace("jpg", "jpeg")
        content = base64.b64encode(head.logo.content).decode()
        logo = f'<img alt="Logo" src="data:image/{kind};base64,{content}">'
    lines = "".join(f"<br>{escape(line)}" for line in head.lines)
    return f"{logo}<p><strong>{escape(head.name)}</strong>{lines}</p>"


def _section_html(number: int, section: Section) -> str:
    """Return the HTML of a section with its number: tables, notes, facts, paragraphs, pictures."""
    box = ' class="box"' if section.boxed else ""
    lines = [f"<section{box}><h2>{number} {escape(section.heading)}</h2>"]
    lines += [_table_html(table) for table in section.tables]
    lines += [f"<p>– {escape(note)}</p>" for note in section.notes]
    facts = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in section.facts)
    lines.append(f"<dl>{facts}</dl>" if facts else "")
    lines += [f"<p>{escape(paragraph)}</p>" for paragraph in section.paragraphs]
    for picture in section.pictures:
        caption = f"<figcaption>{escape(picture.caption)}</figcaption>"
        lines.append(f"<figure>{picture.svg}{caption}</figure>")  # the texts of the SVG are escaped already
    return "\n".join([*lines, "</section>"])


def _table_html(table: Table) -> str:
    """Return the HTML of a table; columns of texts are aligned to the left."""
    text_columns = table.text_columns()
    caption = f"<caption>{escape(table.legend)}</caption>" if table.legend else ""
    head = _row_html(map(Line, table.head()), "th", text_columns)
    rows = "".join(_row_html(cells, "td", text_columns) for cells in table.rows())
    body = f"{caption}<thead>{head}</thead><tbody>{rows}</tbody>"
    return f'<div class="wide"><table>{body}</table></div>'


def _row_html(cells: Iterable[Line], tag: str, text_columns: Sequence[int]) -> str:
    """Return the HTML of a row whose cells have the tag `td` or `th`.

    `text_columns` are the indices of columns with text, which the style sheet aligns to the left.
    """
    row_cells = list[str]()
    for column, cell in enumerate(cells):
        classes = list[str]()
        if column in text_columns:
            classes.append("text")
        if cell.style == "dim":
            classes.append("dim")
        css_class = f' class="{" ".join(classes)}"' if classes else ""
        row_cells.append(f"<{tag}{css_class}>{escape(cell.text)}</{tag}>")
    return f"<tr>{''.join(row_cells)}</tr>"


_TEMPLATE: Final = Path(__file__).with_name("template.typ")
_UNUSUAL_CHARACTER: Final = re.compile(
    r"[^\x20-\u024F\u0370-\u03FF\u0400-\u04FF\u2010-\u2044\u2070-\u209F\u2190-\u2265]"
)
"""Characters that the fonts of Typst may lack, beyond Latin, Greek, Cyrillic and the signs of our texts."""


class NoTypstError(RequestError):
    """Typst is not installed."""

    def __init__(self) -> None:
        super().__init__(
            "a report as PDF needs the extra `reports`, which is not installed",
            remedy='pip install "jointstiff[reports]", or request the report as HTML',
        )


def require_typst() -> None:
    """Refuse a report as PDF before its work begins.

    Raises:
        NoTypstError: Typst is not installed.
    """
    try:
        import typst  # noqa: F401
    except ImportError as error:
        raise NoTypstError from error


def render_pdf(document: Document) -> bytes:
    """Return a report as PDF/A-3b with its attachments; the same document gives the same bytes.

    Characters that the fonts of Typst lack are shown as codes, such as ‹U+4E2D›; the HTML report and the
    attachments have the characters themselves.

    Raises:
        NoTypstError: Typst is not installed.
    """
    require_typst()
    import typst

    data = _template_data(document)
    try:
        return _compile_pdf(data, document)
    except typst.TypstError as error:
        if "could not be displayed" not in error.message:
            raise
    # A font lacks some character: try again with codes instead of unusual characters.
    return _compile_pdf(_replace_unusual_characters(data), document)


def _compile_pdf(data: dict[str, Any], document: Document) -> bytes:
    """Compile the template with its data by Typst, which can read no other file; return the PDF."""
    import typst

    # The empty folder is all that Typst may read: texts of users cannot include other files.
    with TemporaryDirectory(prefix="jointstiff-report-") as empty:
        compiler = typst.Compiler(
            _TEMPLATE.read_bytes(),
            root=empty,
            font_paths=_load_fonts(),
            sys_inputs={"document": json.dumps(data)},
            package_path=empty,
            package_cache_path=empty,
        )
        compiled = compiler.compile(
            format="pdf", pdf_standards="a-3b", timestamp=int(document.dated.timestamp())
        )
    # A PDF is always one file; Typst returns a list only for several pictures.
    return compiled if isinstance(compiled, bytes) else b""


@cache
def _load_fonts() -> typst.Fonts:
    """Return the fonts of Typst itself, without those of the system: reports look the same everywhere."""
    import typst

    return typst.Fonts(include_system_fonts=False)


def _template_data(document: Document) -> dict[str, Any]:
    """Return the content of a report as JSON values, in the form that the template reads."""
    head = document.letterhead
    dated = document.dated.astimezone(UTC)
    parts_of_time = ("year", "month", "day", "hour", "minute", "second")
    attachments = [asdict(each) | {"content": each.content.decode()} for each in document.attachments]
    return {
        "title": document.title,
        "number": document.number,
        "letterhead": {"name": head.name, "lines": head.lines},
        "logo": _logo_data(head.logo),
        "dated": {part: getattr(dated, part) for part in parts_of_time},
        "sections": [_section_data(section) for section in document.sections],
        "to_sign": TO_SIGN if document.signs else [],
        "attachments": attachments,
    }


def _logo_data(logo: Logo | None) -> dict[str, Any] | None:
    """Return a logo as JSON values: the numbers of its bytes, and its kind."""
    if logo is None:
        return None
    return {"content": list(logo.content), "kind": logo.kind}


def _section_data(section: Section) -> dict[str, Any]:
    """Return a section as JSON values, with its tables as they are shown."""
    shown_tables = [table.shown() for table in section.tables]
    return asdict(replace(section, tables=[])) | {"tables": shown_tables}


def _replace_unusual_characters(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Replace characters that the fonts may lack by their codes in all texts of a JSON value.

    Texts in fields named `content`, the attachments, are not changed.
    """
    if isinstance(value, str):
        return _UNUSUAL_CHARACTER.sub(
            lambda match: "\n" if match[0] == "\n" else f"‹U+{ord(match[0]):04X}›", value
        )
    if isinstance(value, list | tuple):
        return [_replace_unusual_characters(each) for each in value]
    if isinstance(value, dict):
        return {
            name: each if name == "content" else _replace_unusual_characters(each)
            for name, each in value.items()
        }
    return value
