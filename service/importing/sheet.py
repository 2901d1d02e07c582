"""The cells of one sheet, in the order of their addresses or not at all."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Final
from xml.etree.ElementTree import Element

from jointstiff.service.importing.archive import NAMES, Archive
from jointstiff.service.importing.errors import shown
from jointstiff.service.importing.grid import CellKind, Row
from jointstiff.service.importing.limits import (
    MAX_CELL_LENGTH,
    MAX_COLUMNS,
    MAX_ROWS,
    MAX_SHEET_CELLS,
)

_ADDRESS: Final = re.compile(r"([A-Z]{1,3})([1-9][0-9]{0,6})")
_ROW: Final = re.compile(r"[1-9][0-9]{0,6}")
MAX_LINE: Final = 1_048_576
"""Excel's last row."""

_KINDS: Final[Mapping[str, CellKind]] = MappingProxyType(
    {"s": "text", "str": "text", "inlineStr": "text", "b": "truth value", "e": "error", "d": "date"}
)
_EMPTY: Final[CellKind] = "text"
_PARTS: Final = MappingProxyType(
    {
        "row": {"c", "extLst"},
        "is": {"t", "r", "rPh", "phoneticPr"},
        "si": {"t", "r", "rPh", "phoneticPr"},
        "r": {"rPr", "t"},
    }
)


def children(archive: Archive, element: Element) -> Iterator[tuple[str, Element]]:
    """Yield the elements in an element with their names.

    Raises:
        ImportFileError: one is not known there; it could hold a value that would be lost.
    """
    allowed = _PARTS.get(NAMES.get(element.tag, ""), set())
    for child in element:
        name = NAMES.get(child.tag)
        if name not in allowed:
            tag = child.tag.rpartition("}")[2]
            raise archive.refusal(f"an element {shown(tag)} that {shown(element.tag)} cannot have")
        yield name, child


def text_of(archive: Archive, element: Element) -> str:
    """Return a text, which may consist of pieces of different fonts, without the phonetic ones.

    Raises:
        ImportFileError: one of its elements is not known.
    """
    pieces = []
    for name, child in children(archive, element):
        if name == "r":
            pieces.append(text_of(archive, child))
        elif name == "t":
            pieces.append(_plain(archive, child))
    return "".join(pieces)


def _plain(archive: Archive, element: Element) -> str:
    if len(element):
        next(children(archive, element))  # which refuses it, as there can be none
    return element.text or ""


class Sheet:
    """One sheet, to be read row by row.

    Each reading begins anew; `notes` are those of the last one.
    """

    def __init__(
        self, archive: Archive, part: str, texts: Sequence[str], kinds: Mapping[str, CellKind]
    ) -> None:
        """Prepare to read."""
        self._archive, self._part, self._texts, self._kinds = archive, part, texts, kinds
        self._begin()

    def _begin(self) -> None:
        self._line = self._column = self._count = self._hidden = self._formulas = 0

    @property
    def notes(self) -> list[str]:
        """Return what should be known of the rows that were read, in words."""
        notes = []
        if self._hidden:
            notes.append(f"{self._hidden} rows or columns are hidden in the sheet, and were read as well")
        if self._formulas:
            notes.append(f"the stored values of formulas were used ({self._formulas} cells)")
        return notes

    def rows(self) -> Iterator[Row]:
        """Yield the rows that are not empty, each as long as its last cell that is not.

        Raises:
            ImportFileError: damaged, beyond the limits, or its cells are not in order.
        """
        self._begin()
        filled = 0
        for element in self._archive.elements(self._part, "row", "col"):
            self._hidden += element.get("hidden") in ("1", "true")
            row = self._row(element) if NAMES[element.tag] == "row" else None
            if row is not None:
                filled += 1
                if filled > MAX_ROWS:
                    raise self._refusal(f"the sheet has more than {MAX_ROWS} rows")
                yield row

    def _row(self, element: Element) -> Row | None:
        number = element.get("r", str(self._line + 1))
        if not _ROW.fullmatch(number) or not self._line < int(number) <= MAX_LINE:
            raise self._refusal(f"row {shown(number)} follows row {self._line}")
        self._line, self._column = int(number), 0
        cells: list[str] = []
        kinds: list[CellKind] = []
        for name, cell in children(self._archive, element):
            if name == "c":
                self._find_place(cell.get("r"))
                text, kind = self._cell(cell)
                if text:
                    gap = self._column - 1 - len(cells)
                    cells += [*[""] * gap, text]
                    kinds += [*[_EMPTY] * gap, kind]
        return Row(self._line, tuple(cells), tuple(kinds)) if cells else None

    def _find_place(self, address: str | None) -> None:
        column = self._column + 1
        if address is not None:
            match = _ADDRESS.fullmatch(address)
            if match is None or int(match[2]) != self._line or _index(match[1]) < column:
                raise self._refusal(f"cell {shown(address)} is not in its place")
            column = _index(match[1])
        self._count += column - self._column
        self._column = column
        if column > MAX_COLUMNS or self._count > MAX_SHEET_CELLS:
            raise self._refusal(f"the sheet has more than {MAX_COLUMNS} columns or {MAX_SHEET_CELLS} cells")

    def _cell(self, cell: Element) -> tuple[str, CellKind]:
        """Return the text and the kind of a cell; a formula is one if no value is stored beside it."""
        children = {NAMES.get(child.tag): child for child in cell}
        type_ = cell.get("t", "n")
        kind = _KINDS.get(type_) or self._number_kind(type_, cell.get("s", "0"))
        holder = "is" if type_ == "inlineStr" else "v"
        if len(children) != len(cell) or not children.keys() <= {holder, "f", "extLst"}:
            tags = ", ".join(child.tag.rpartition("}")[2] for child in cell)
            raise self._refusal(f"elements {shown(tags)}, which a cell of type {shown(type_)} cannot have")
        value = self._value(children[holder], type_) if holder in children else ""
        if "f" in children:
            if not value and type_ != "str":
                return "= …", "formula"
            self._formulas += 1
        return value, kind

    def _value(self, holder: Element, type_: str) -> str:
        if type_ == "inlineStr":
            value = text_of(self._archive, holder)
        else:
            value = _plain(self._archive, holder)
            if type_ == "s" and value:
                known = value.isascii() and value.isdigit() and len(value) < 8
                if not known or int(value) >= len(self._texts):
                    raise self._refusal(f"a cell that refers to an unknown text {shown(value)}")
                value = self._texts[int(value)]
        if len(value) > MAX_CELL_LENGTH:
            raise self._refusal(f"a cell has more than {MAX_CELL_LENGTH} characters")
        return value.strip()

    def _number_kind(self, type_: str, style: str) -> CellKind:
        if type_ != "n":
            raise self._refusal(f"a cell of unknown type {shown(type_)}")
        kind = self._kinds.get(style) if self._kinds else "number"
        if kind is None:
            raise self._refusal(f"a cell of unknown format {shown(style)}")
        return kind

    def _refusal(self, reason: str) -> Exception:
        return self._archive.refusal(reason, self._line or None, self._column or None)


@lru_cache(maxsize=1024)
def _index(letters: str) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number
