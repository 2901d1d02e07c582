"""A report as one HTML page: every text is escaped, and the page has no scripts and loads nothing."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable
from html import escape
from itertools import count
from typing import Final

from jointstiff.service.reports.document import Document, Letterhead, Picture, Section
from jointstiff.service.tables.table import Table

_STYLE: Final = """
body { font: 15px/1.45 Georgia, serif; color: #222; max-width: 52rem; margin: 2rem auto; padding: 0 1rem; }
header { border-bottom: 1px solid #222; } header img { float: right; max-height: 64px; max-width: 200px; }
h1 { margin: 0.6rem 0 0; } header p { overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 1.6rem 0 0.5rem; }
table { border-collapse: collapse; margin: 0.5rem 0; font-size: 0.9rem; } .wide { overflow-x: auto; }
th, td { text-align: right; padding: 2px 8px; border-bottom: 1px solid #ccc; vertical-align: top; }
th { border-bottom-color: #222; } .text, caption { text-align: left; }
caption, figcaption, dt, .end { color: #5a5a5a; }
dl { display: grid; grid-template-columns: minmax(0, 16rem) minmax(50%, 1fr); gap: 2px 1rem; }
dd { margin: 0; white-space: pre-line; overflow-wrap: anywhere; }
figure { margin: 1rem 0; } figure svg { width: 100%; }
.state { font-weight: bold; text-transform: uppercase; }
.sign { display: grid; grid-template-columns: 1fr 1fr; gap: 3rem; margin-top: 4rem; }
body[data-mark]::before { content: attr(data-mark); position: fixed; top: 40%; left: 12%; z-index: -1;
  font-size: min(9rem, 18vw); font-weight: bold; color: #e8e8e8; transform: rotate(-35deg); }
.sign p { border-top: 1px solid #222; } .end { text-align: center; }
"""
POLICY: Final = (
    "default-src 'none'; img-src data:; frame-ancestors 'none'; style-src 'sha256-"
    f"{base64.b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode()}'"
)
"""Content security policy: this style, pictures within the page, and nothing else."""


def report_page(document: Document) -> bytes:
    """Return a report as HTML."""
    title, number = escape(document.title), escape(document.number)
    mark = f' data-mark="{document.state.watermark}"' if document.state.watermark else ""
    parts = [
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title} {number}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}</style></head><body{mark}><header>",
        _letterhead(document.letterhead),
        f"<h1>{title}</h1><p>{number}</p>",
        f'<p><span class="state">{escape(document.state.kind)}</span>: {escape(document.state.line)}</p>',
        "</header>",
        *(_section(place, section) for place, section in enumerate(document.sections, 1)),
    ]
    if document.signs:
        by = escape(document.state.by or "")
        parts.append(f'<div class="sign"><p>Place and date</p><p>Signature: authorised by {by}</p></div>')
    parts.append(f'<p class="end">— End of report {number} —</p></body></html>\n')
    return "\n".join(parts).encode()


def _letterhead(head: Letterhead) -> str:
    logo = ""
    if head.logo is not None:
        kind = "png" if head.logo_type == "png" else "jpeg"
        logo = f'<img alt="Logo" src="data:image/{kind};base64,{base64.b64encode(head.logo).decode()}">'
    lines = "".join(f"<br>{escape(line)}" for line in head.lines)
    return f"{logo}<p><strong>{escape(head.name)}</strong>{lines}</p>"


def _section(place: int, section: Section) -> str:
    facts = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in section.facts)
    return "\n".join(
        [
            f"<section><h2>{place} {escape(section.heading)}</h2>",
            *map(_table, section.tables),
            *(f"<p>– {escape(note)}</p>" for note in section.notes),
            f"<dl>{facts}</dl>" if facts else "",
            *(f"<p>{escape(paragraph)}</p>" for paragraph in section.paragraphs),
            *map(_picture, section.pictures),
            "</section>",
        ]
    )


def _table(table: Table) -> str:
    texts = table.text_columns()

    def row(cells: Iterable[str], tag: str) -> str:
        kinds = (' class="text"' if place in texts else "" for place in count())
        row_cells = (f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, cells, strict=False))
        return f"<tr>{''.join(row_cells)}</tr>"

    caption = f"<caption>{escape(table.legend)}</caption>" if table.legend else ""
    rows = "".join(row((cell.text for cell in cells), "td") for cells in table.rows())
    body = f"{caption}<thead>{row(table.head(), 'th')}</thead><tbody>{rows}</tbody>"
    return f'<div class="wide"><table>{body}</table></div>'


def _picture(picture: Picture) -> str:
    caption = escape(picture.caption)  # the SVG was drawn here, its texts escaped
    return f"<figure>{picture.svg}<figcaption>{caption}</figcaption></figure>"
