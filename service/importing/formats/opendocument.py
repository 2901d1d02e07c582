"""Spreadsheets in OpenDocument (.ods) as grids, unpacked and parsed within the limits of Excel workbooks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.formats.elements import Element, read_elements
from jointstiff.service.importing.formats.excel import MAX_SHEET_CELLS, Archive, build_grids
from jointstiff.service.importing.grid import (
    EMPTY_CELL_KIND,
    CellKind,
    Grid,
    Row,
    is_plain_number,
    write_ascii_minus,
)

_SPACE: Final = "urn:oasis:names:tc:opendocument:xmlns:"
_OFFICE, _TABLE, _TEXT = (f"{_SPACE}{name}:1.0 " for name in ("office", "table", "text"))
_ROWS: Final = frozenset(f"{_TABLE}{name}" for name in ("table-row-group", "table-header-rows", "table-rows"))
"""Elements in which rows may be."""
_CELLS: Final = frozenset(f"{_TABLE}{name}" for name in ("table-cell", "covered-table-cell"))
_HIDDEN: Final = frozenset(("collapse", "filter"))
_BLANKS: Final = frozenset(f"{_TEXT}{name}" for name in ("s", "tab", "line-break"))
_NO_TEXT: Final = frozenset((f"{_TEXT}note", f"{_OFFICE}annotation"))
_REPEAT: Final = re.compile(r"[1-9][0-9]{0,6}")
_KINDS: Final[Mapping[str, tuple[CellKind, str]]] = MappingProxyType(
    {
        "float": ("number", "value"),
        "currency": ("number", "value"),
        "percentage": ("percentage", "value"),
        "date": ("date", "date-value"),
        "time": ("date", "time-value"),
        "boolean": ("truth value", "boolean-value"),
        "string": ("text", "string-value"),
    }
)
"""Type of a cell → its kind, and the attribute with its value."""


def read_spreadsheet(file: str, content: bytes, stated: str | None) -> list[Grid]:
    """Return the sheets of a spreadsheet as grids; a cell with a formula has the value that was stored.

    Args:
        file: name of the file, for messages.
        content: bytes of the file.
        stated: names of sheets, with semicolons between; if None, all sheets that are not empty.

    Raises:
        ImportFileError: the file is no spreadsheet, is beyond a limit, or has no sheet of a name.
    """
    archive = Archive(file, content, "an OpenDocument spreadsheet (.ods)", "LibreOffice")
    root = read_elements(file, archive.read("content.xml"))
    body = root.find(f"{_OFFICE}body")
    spreadsheet = None if body is None else body.find(f"{_OFFICE}spreadsheet")
    tables = (
        [] if spreadsheet is None else [each for each in spreadsheet.children if each.tag == f"{_TABLE}table"]
    )
    sheets = {each.attributes.get(f"{_TABLE}name", ""): _Sheet(archive, each) for each in tables}
    if not sheets or len(sheets) < len(tables):
        raise archive.build_error("the file has no sheet, or two sheets with the same name")
    return build_grids(file, sheets, stated)


class _Sheet:
    """One sheet; repeated rows and cells are written as often as they are repeated."""

    def __init__(self, archive: Archive, table: Element) -> None:
        self._archive, self._table = archive, table
        self._line = self._count = self._hidden = self._formulas = 0

    @property
    def notes(self) -> list[str]:
        """Notes for the user on the rows that were read: hidden ones, and formulas."""
        notes = []
        if self._hidden:
            notes.append(f"{self._hidden} rows are hidden in the sheet, and were read as well")
        if self._formulas:
            notes.append(f"the stored values of formulas were used ({self._formulas} cells)")
        return notes

    def rows(self) -> Iterator[Row]:
        """Yield the rows that are not empty, each up to its last cell with a text."""
        self._archive.cells -= self._count
        self._line = self._count = self._hidden = self._formulas = 0
        filled_count = 0
        for element in _walk_rows(self._table):
            self._line += 1
            repeat = self._read_repeat(element, "rows")
            cells, kinds = self._read_cells(element)
            if cells:
                filled_count += repeat
                self._add_cells(repeat * len(cells))
                if filled_count > limits.MAX_ROWS:
                    raise self._build_error(f"the sheet has more than {limits.MAX_ROWS} rows")
                self._hidden += repeat * (element.attributes.get(f"{_TABLE}visibility") in _HIDDEN)
                yield from (Row(self._line + n, cells, kinds) for n in range(repeat))
            self._line += repeat - 1

    def _read_repeat(self, element: Element, name: str) -> int:
        """Return how often a row or a cell is repeated."""
        text = element.attributes.get(f"{_TABLE}number-{name}-repeated", "1")
        if not _REPEAT.fullmatch(text):
            raise self._build_error(f"{quote(text)} is no number of repeated {name}")
        return int(text)

    def _read_cells(self, row: Element) -> tuple[tuple[str, ...], tuple[CellKind, ...]]:
        """Return the texts and kinds of the cells of a row, up to the last with a text."""
        cells, kinds = list[str](), list[CellKind]()
        empty = 0  # cells without a text behind the last with one
        for element in row.children:
            if element.tag not in _CELLS:
                continue
            repeat = self._read_repeat(element, "columns")
            text, kind = self._read_cell(element)
            if not text:
                empty += repeat
                continue
            if len(cells) + empty + repeat > limits.MAX_COLUMNS:
                raise self._build_error(f"the sheet has more than {limits.MAX_COLUMNS} columns")
            cells += [*[""] * empty, *[write_ascii_minus(text)] * repeat]
            kinds += [*EMPTY_CELL_KIND * empty, *(kind,) * repeat]
            empty = 0
        return tuple(cells), tuple(kinds)

    def _read_cell(self, cell: Element) -> tuple[str, CellKind]:
        """Return the text and the kind of a cell; the kind is `formula` if no value is stored with it."""
        type_ = cell.attributes.get(f"{_OFFICE}value-type")
        shown = "\n".join(_join_text(each) for each in cell.children if each.tag == f"{_TEXT}p").strip()
        has_formula = f"{_TABLE}formula" in cell.attributes
        if type_ is None:
            return ("= …", "formula") if has_formula and not shown else (shown, "text")
        if type_ not in _KINDS:
            raise self._build_error(f"a cell has the unknown type {quote(type_)}")
        kind, attribute = _KINDS[type_]
        stored = cell.attributes.get(f"{_OFFICE}{attribute}", "").strip()
        if kind in ("number", "percentage") and not is_plain_number(stored):
            raise self._build_error(f"a cell has {quote(stored)} in place of a number")
        text = stored or shown
        if len(text) > limits.MAX_CELL_LENGTH:
            raise self._build_error(f"a cell has more than {limits.MAX_CELL_LENGTH} characters")
        if kind == "text" and has_formula and text.startswith(("#", "Err:")):
            kind = "error"
        self._formulas += has_formula
        return text, kind

    def _add_cells(self, count: int) -> None:
        """Count cells of all sheets; refuse the file beyond `MAX_SHEET_CELLS`."""
        self._count += count
        self._archive.cells += count
        if self._archive.cells > MAX_SHEET_CELLS:
            raise self._build_error(f"the sheets have more than {MAX_SHEET_CELLS} cells")

    def _build_error(self, reason: str) -> ImportFileError:
        """Return the error that the file cannot be read, at the current row."""
        return self._archive.build_error(reason, self._line or None)


def _walk_rows(parent: Element) -> Iterator[Element]:
    """Yield the rows of a table, also those in groups."""
    for child in parent.children:
        if child.tag == f"{_TABLE}table-row":
            yield child
        elif child.tag in _ROWS:
            yield from _walk_rows(child)


def _join_text(element: Element) -> str:
    """Return the text of a paragraph with that of its parts in other fonts, and blanks for tabs."""
    pieces = []
    for part in element.parts:
        if isinstance(part, str):
            pieces.append(part)
        elif part.tag in _BLANKS:
            pieces.append(" ")
        elif part.tag not in _NO_TEXT:
            pieces.append(_join_text(part))
    return "".join(pieces)
