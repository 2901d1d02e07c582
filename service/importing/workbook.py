"""Excel workbooks: which sheet, its texts and formats, its cells as a table."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from typing import Final

from jointstiff.service.importing.archive import NAMES, Archive
from jointstiff.service.importing.errors import ImportFileError, Place, shown
from jointstiff.service.importing.grid import COMMENT_MARKS, CellKind, Grid, Row, check_size
from jointstiff.service.importing.limits import MAX_CELL_LENGTH
from jointstiff.service.importing.sheet import Sheet, text_of

_DATES: Final = frozenset((*range(14, 23), *range(27, 37), *range(45, 48), *range(50, 59)))
_PERCENTAGES: Final = frozenset((9, 10))
_QUOTED: Final = re.compile(r'"[^"]*"|\\.|_.|\*.|\[[^\]]*\]')


def read_workbook(file: str, content: bytes, sheet: str | None) -> Grid:
    """Read one sheet. Formulas are not evaluated; their cells have the values that were stored beside them.

    Args:
        file: its name, for messages.
        content: its bytes.
        sheet: name of the sheet; the only one that is not empty if None.

    Raises:
        ImportFileError: damaged, beyond the limits, or no such table.
    """
    archive = Archive(file, content)
    parts, shared, styles = _parts(archive)
    elements = () if shared is None else archive.elements(shared, "si")
    texts = [text_of(archive, text)[: MAX_CELL_LENGTH + 1] for text in elements]  # enough to refuse long ones
    kinds = _kinds(archive, styles)
    sheets = {name: Sheet(archive, part, texts, kinds) for name, part in parts.items()}
    name = _only_filled(file, sheets) if sheet is None else sheet
    if name not in sheets:
        reason, remedy = f"there is no sheet {shown(name)}", f"use one of {shown(', '.join(sheets))}"
        raise ImportFileError(Place(file), reason, remedy, "sheet", tuple(sheets))
    rows: list[Row] = []
    comments: list[Row] = []
    for row in sheets[name].rows():
        first = next(cell for cell in row.cells if cell)
        (comments if first.startswith(COMMENT_MARKS) else rows).append(row)
    check_size(file, rows)
    notes = list(sheets[name].notes)
    if comments:
        count = f"{len(comments)} row{'s' * (len(comments) > 1)}"
        notes.append(f"comments were skipped ({count}), the first in row {comments[0].line}")
    bare = tuple(map(_bare, comments))
    remarks = tuple((row.line, " ".join(row.cells)) for row in bare)
    return Grid(file, "xlsx", tuple(rows), bare, remarks, sheet=name, assumptions=tuple(notes))


def _only_filled(file: str, sheets: Mapping[str, Sheet]) -> str:
    """Return the name of the only sheet with a row, or of the first if there is none."""
    filled = [name for name, sheet in sheets.items() if next(sheet.rows(), None)]
    if len(filled) > 1:
        reason = f"several sheets have data: {shown(', '.join(filled))}"
        raise ImportFileError(Place(file), reason, "give `sheet`", "sheet", tuple(filled))
    return (filled or list(sheets))[0]


def _bare(row: Row) -> Row:
    """Return a comment without its mark."""
    cells = list(row.cells)
    index = next(index for index, cell in enumerate(cells) if cell)
    mark = next(mark for mark in COMMENT_MARKS if cells[index].startswith(mark))
    cells[index] = cells[index].removeprefix(mark).strip()
    return Row(row.line, tuple(cells), row.kinds)


def _parts(archive: Archive) -> tuple[dict[str, str], str | None, str | None]:
    """Return the parts of sheets by their names, of texts that cells refer to, and of formats."""
    related: dict[str, dict[str, str]] = {"worksheet": {}, "sharedStrings": {}, "styles": {}}
    for relation in archive.elements("xl/_rels/workbook.xml.rels", "Relationship"):
        kind = relation.get("Type", "").rpartition("/")[2]
        if kind in related:
            path = posixpath.join("/xl", relation.get("Target", ""))
            related[kind][relation.get("Id", "")] = posixpath.normpath(path).lstrip("/")
    names: dict[str, str] = {}
    for sheet in archive.elements("xl/workbook.xml", "sheet"):
        identifier = next((value for key, value in sheet.items() if key.endswith("}id")), "")
        part = related["worksheet"].get(identifier)
        name = sheet.get("name", "")
        if part is not None and names.setdefault(name, part) is not part:
            raise archive.refusal(f"two sheets have the name {shown(name)}")
    if not names or any(len(related[kind]) > 1 for kind in ("sharedStrings", "styles")):
        raise archive.refusal("a workbook without a sheet, or with two tables of texts or styles")
    texts, styles = (next(iter(related[kind].values()), None) for kind in ("sharedStrings", "styles"))
    return names, texts, styles


def _kinds(archive: Archive, part: str | None) -> dict[str, CellKind]:
    """Return what numbers of each format are: Excel makes a date of 1.5 and a hundredth of 50 %."""
    if part is None:
        return {}
    codes: dict[str, str] = {}
    formats: list[str] = []
    for element in archive.elements(part, "numFmts", "cellXfs"):
        for child in element:
            name, number = NAMES.get(child.tag), child.get("numFmtId", "0")
            if name == "numFmt":
                codes[number] = child.get("formatCode", "")
            elif name == "xf":
                formats.append(number)
    return {str(index): _kind(number, codes.get(number)) for index, number in enumerate(formats)}


def _kind(number: str, code: str | None) -> CellKind:
    if code is None:
        known = int(number) if number.isascii() and number.isdigit() and len(number) < 5 else 0
        return "date" if known in _DATES else "percentage" if known in _PERCENTAGES else "number"
    plain = _QUOTED.sub("", code).lower().replace("general", "").replace("standard", "")
    if set("dmyhs") & set(plain):
        return "date"
    return "percentage" if "%" in plain else "number"
