"""The cells of one sheet, in the order of their addresses or not at all."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from jointstiff.service.importing.archive import Archive, parse_part
from jointstiff.service.importing.errors import shown
from jointstiff.service.importing.grid import CellKind, Row
from jointstiff.service.importing.limits import MAX_CELL_LENGTH, MAX_CELLS, MAX_COLUMNS, MAX_ROWS

__all__ = ["SheetReader"]

_ADDRESS: Final = re.compile(r"([A-Z]{1,3})([1-9][0-9]{0,6})")
MAX_LINE: Final = 1_048_576
"""Excel's last row."""

_ROW: Final = re.compile(r"[1-9][0-9]{0,6}")
_KINDS: Final[Mapping[str, CellKind]] = MappingProxyType(
    {"s": "text", "str": "text", "inlineStr": "text", "b": "truth value", "e": "error", "d": "date"}
)


class SheetReader:
    """Receives the elements of a sheet and makes rows of them.

    Attributes:
        rows: that are not empty, each as long as its last cell.
        notes: what should be known of the sheet, in words.
    """

    def __init__(self, archive: Archive, part: str, texts: Sequence[str], kinds: Sequence[CellKind]) -> None:
        self.rows: list[Row] = []
        self.notes: list[str] = []
        self._archive, self._part, self._texts, self._kinds = archive, part, texts, kinds
        self._line = self._column = self._count = 0
        self._cells: list[str] = []
        self._cell_kinds: list[CellKind] = []
        self._type: str | None = None
        self._kind: CellKind = "number"
        self._value: str | None = None
        self._reading = False
        self._phonetic = 0
        self._hidden = 0

    def read(self) -> SheetReader:
        """Read it.

        Raises:
            ImportFileError: damaged, beyond the limits, or its cells are not in order.
        """
        parse_part(self._archive, self._part, self._start, self._end, self._text)
        if self._hidden:
            self.notes.append(f"{self._hidden} rows or columns are hidden in the sheet, and were read too")
        return self

    def _start(self, tag: str, attributes: Mapping[str, str]) -> None:
        if tag == "row":
            self._begin_row(attributes)
        elif tag == "c":
            self._begin_cell(attributes)
        elif tag == "f":
            self._kind = "formula"
        elif tag == "rPh":
            self._phonetic += 1
        elif tag in ("v", "t") and not self._phonetic:
            self._begin_value(tag)
        if tag in ("row", "col") and attributes.get("hidden") in ("1", "true"):
            self._hidden += 1

    def _end(self, tag: str) -> None:
        if tag == "c":
            self._finish_cell()
        elif tag == "row":
            while self._cells and not self._cells[-1]:
                self._cells.pop()
                self._cell_kinds.pop()
            if self._cells:
                self.rows.append(Row(self._line, tuple(self._cells), tuple(self._cell_kinds)))
        elif tag == "rPh":
            self._phonetic -= 1
        elif tag in ("v", "t"):
            self._reading = False

    def _text(self, content: str) -> None:
        if self._reading:
            self._value = (self._value or "") + content
            if len(self._value) > MAX_CELL_LENGTH:
                raise self._refusal(f"a cell of more than {MAX_CELL_LENGTH} characters")

    def _begin_row(self, attributes: Mapping[str, str]) -> None:
        number = attributes.get("r", str(self._line + 1))
        if not _ROW.fullmatch(number) or not self._line < int(number) <= MAX_LINE:
            raise self._refusal(f"row {shown(number)} follows row {self._line}")
        self._line, self._column = int(number), 0
        self._cells, self._cell_kinds = [], []
        if len(self.rows) >= MAX_ROWS:
            raise self._refusal(f"more than {MAX_ROWS} rows")

    def _begin_cell(self, attributes: Mapping[str, str]) -> None:
        column = self._column + 1
        if "r" in attributes:
            match = _ADDRESS.fullmatch(attributes["r"])
            if match is None or int(match[2]) != self._line or _index(match[1]) < column:
                raise self._refusal(f"cell {shown(attributes['r'])} is not in its place")
            column = _index(match[1])
        self._count += column - self._column
        if column > MAX_COLUMNS or self._count > MAX_CELLS:
            raise self._refusal(f"more than {MAX_COLUMNS} columns or {MAX_CELLS} cells")
        skipped = column - self._column - 1
        self._cells += [""] * skipped
        self._cell_kinds += ["text"] * skipped
        self._column, self._value = column, None
        self._type = attributes.get("t", "n")
        self._kind = _KINDS.get(self._type) or self._number_kind(attributes.get("s", "0"))

    def _begin_value(self, tag: str) -> None:
        """One `v` in a cell, or pieces of text `t` in one with text of its own."""
        if self._type is None:
            return
        if (tag == "t") != (self._type == "inlineStr") or (tag == "v" and self._value is not None):
            raise self._refusal(f"an element {tag} that a cell of type {shown(self._type)} cannot have")
        self._value, self._reading = self._value or "", True

    def _number_kind(self, style: str) -> CellKind:
        if self._type != "n":
            raise self._refusal(f"a cell of unknown type {shown(self._type or '')}")
        if not self._kinds:
            return "number"
        if not (style.isascii() and style.isdigit() and len(style) < 7) or int(style) >= len(self._kinds):
            raise self._refusal(f"a cell of unknown format {shown(style)}")
        return self._kinds[int(style)]

    def _finish_cell(self) -> None:
        value = self._value or ""
        if self._type == "s" and value:
            known = value.isascii() and value.isdigit() and len(value) < 8
            if not known or int(value) >= len(self._texts):
                raise self._refusal(f"a cell that refers to an unknown text {shown(value)}")
            value = self._texts[int(value)]
        text = value.strip()
        self._cells.append("= …" if self._kind == "formula" and not text else text)
        self._cell_kinds.append(self._kind)
        self._type = None

    def _refusal(self, reason: str) -> Exception:
        return self._archive.refusal(reason, self._line or None, self._column or None)


@lru_cache(maxsize=1024)
def _index(letters: str) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number
