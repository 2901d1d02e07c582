"""Excel workbooks: which sheet, its texts and formats, its cells as a table."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from jointstiff.service.importing.archive import Archive, parse_part
from jointstiff.service.importing.errors import ImportFileError, Place, shown
from jointstiff.service.importing.grid import COMMENT_MARKS, CellKind, Grid, Row, check_size
from jointstiff.service.importing.limits import MAX_CELL_LENGTH
from jointstiff.service.importing.sheet import SheetReader

__all__ = ["XLSX_MAGIC", "read_workbook"]

XLSX_MAGIC: Final = b"PK\x03\x04"

_DATES: Final = frozenset((*range(14, 23), *range(27, 37), *range(45, 48), *range(50, 59)))
_PERCENTAGES: Final = frozenset((9, 10))
_QUOTED: Final = re.compile(r'"[^"]*"|\\.|_.|\*.|\[[^\]]*\]')
_MAX_TEXTS: Final = 1_000_000


def read_workbook(file: str, content: bytes, sheet: str | None) -> Grid:
    """Read one sheet. No formula is evaluated, and the results stored beside formulas are not used.

    Args:
        file: its name, for messages.
        content: its bytes.
        sheet: name of the sheet; the only one that is not empty if None.

    Raises:
        ImportFileError: damaged, beyond the limits, or no such table.
    """
    archive = Archive(file, content)
    parts = _parts(archive)
    sheets = parts.sheets
    if sheet is not None and sheet not in sheets:
        raise ImportFileError(
            Place(file), f"there is no sheet {shown(sheet)}", f"give one of {shown(', '.join(sheets))}"
        )
    wanted = sheets if sheet is None else {sheet: sheets[sheet]}
    texts, kinds = _shared_texts(archive, parts.texts), _kinds(archive, parts.styles)
    read = {name: SheetReader(archive, part, texts, kinds).read() for name, part in wanted.items()}
    filled = [name for name, reader in read.items() if reader.rows]
    if len(filled) > 1:
        raise ImportFileError(
            Place(file), f"several sheets are filled: {shown(', '.join(filled))}", "give `sheet`"
        )
    name = filled[0] if filled else next(iter(wanted))
    reader = read[name]
    rows: list[Row] = []
    comments: list[Row] = []
    for row in reader.rows:
        first = next((cell for cell in row.cells if cell), "")
        (comments if first.startswith(COMMENT_MARKS) else rows).append(row)
    check_size(file, rows)
    notes = list(reader.notes)
    if comments:
        count = f"{len(comments)} row{'s' * (len(comments) > 1)}"
        notes.append(f"comments were skipped ({count}), the first in row {comments[0].line}")
    return Grid(file, "xlsx", tuple(rows), tuple(map(_bare, comments)), sheet=name, assumptions=tuple(notes))


def _bare(row: Row) -> Row:
    """A comment without its mark."""
    cells = list(row.cells)
    index = next(index for index, cell in enumerate(cells) if cell)
    mark = next(mark for mark in COMMENT_MARKS if cells[index].startswith(mark))
    cells[index] = cells[index].removeprefix(mark).strip()
    return Row(row.line, tuple(cells), row.kinds)


@dataclass(frozen=True)
class _Parts:
    """Where the parts of a workbook are.

    Attributes:
        sheets: by name, in order.
        texts: those that cells refer to by number, if there are any.
        styles: formats of cells, if there are any.
    """

    sheets: Mapping[str, str]
    texts: str | None
    styles: str | None


def _parts(archive: Archive) -> _Parts:
    related: dict[str, dict[str, str]] = {"worksheet": {}, "sharedStrings": {}, "styles": {}}
    names: dict[str, str] = {}

    def on_relation(tag: str, attributes: Mapping[str, str]) -> None:
        kind = attributes.get("Type", "").rpartition("/")[2]
        if tag == "Relationship" and kind in related:
            path = posixpath.join("/xl", attributes.get("Target", ""))
            related[kind][attributes.get("Id", "")] = posixpath.normpath(path).lstrip("/")

    def on_sheet(tag: str, attributes: Mapping[str, str]) -> None:
        if tag != "sheet":
            return
        relation = next((value for key, value in attributes.items() if key.endswith(" id")), "")
        part = related["worksheet"].get(relation)
        if part is not None:
            name = attributes.get("name", "")
            if name in names:
                raise archive.refusal(f"two sheets of the name {shown(name)}")
            names[name] = part

    parse_part(archive, "xl/_rels/workbook.xml.rels", on_relation)
    parse_part(archive, "xl/workbook.xml", on_sheet)
    if not names or any(len(related[kind]) > 1 for kind in ("sharedStrings", "styles")):
        raise archive.refusal("a workbook without a sheet, or with two tables of texts or styles")
    texts, styles = (next(iter(related[kind].values()), None) for kind in ("sharedStrings", "styles"))
    return _Parts(names, texts, styles)


def _shared_texts(archive: Archive, part: str | None) -> list[str]:
    """The texts that cells refer to by number, without the phonetic ones."""
    if part is None:
        return []
    texts: list[str] = []
    state = {"t": False, "phonetic": 0}

    def start(tag: str, _attributes: Mapping[str, str]) -> None:
        if tag == "si":
            texts.append("")
            if len(texts) > _MAX_TEXTS:
                raise archive.refusal(f"more than {_MAX_TEXTS} texts")
        state["phonetic"] += tag == "rPh"
        state["t"] = tag == "t" and not state["phonetic"]

    def end(tag: str) -> None:
        state["phonetic"] -= tag == "rPh"
        state["t"] = False

    def text(content: str) -> None:
        if state["t"] and texts and len(texts[-1]) <= MAX_CELL_LENGTH:
            texts[-1] += content

    parse_part(archive, part, start, end, text)
    return texts


def _kinds(archive: Archive, part: str | None) -> list[CellKind]:
    """What numbers of each format are: Excel makes a date of 1.5 and a hundredth of 50 %."""
    if part is None:
        return []
    codes: dict[str, str] = {}
    formats: list[str] = []
    inside = {"cellXfs": False}

    def start(tag: str, attributes: Mapping[str, str]) -> None:
        if tag == "numFmt":
            codes[attributes.get("numFmtId", "")] = attributes.get("formatCode", "")
        elif tag == "cellXfs":
            inside["cellXfs"] = True
        elif tag == "xf" and inside["cellXfs"]:
            formats.append(attributes.get("numFmtId", "0"))

    def end(tag: str) -> None:
        inside["cellXfs"] &= tag != "cellXfs"

    parse_part(archive, part, start, end)
    return [_kind(number, codes.get(number)) for number in formats]


def _kind(number: str, code: str | None) -> CellKind:
    if code is None:
        known = int(number) if number.isascii() and number.isdigit() and len(number) < 5 else 0
        return "date" if known in _DATES else "percentage" if known in _PERCENTAGES else "number"
    plain = _QUOTED.sub("", code).lower().replace("general", "").replace("standard", "")
    if set("dmyhs") & set(plain):
        return "date"
    return "percentage" if "%" in plain else "number"
