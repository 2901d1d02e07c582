"""Plain tables of numbers and words, as files have them; what the columns mean is no question here."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.schemas.imports import MAX_COLUMNS, Cell
from jointstiff.service.problems import FilesError
from jointstiff.solver.arrays import FloatArray

MAX_FILES: Final = 64
MAX_BYTES: Final = 8 * 2**20
"""Bytes of all files together."""
MAX_ROWS: Final = 320_000
MAX_CELLS: Final = 1_000_000
MAX_CELL_LENGTH: Final = 256
_LEAST_NUMERIC: Final = 0.8
"""Least fraction of a column's filled cells that are numbers, if the column has numbers."""


class NumberWithUnit(float):
    """A number whose cell has a unit, such as `10.5 °`."""

    unit: str
    text: str  # cell as it is written

    @classmethod
    def of(cls, number: float, unit: str, text: str) -> NumberWithUnit:
        """Return a number with its unit."""
        own = cls(number)
        own.unit, own.text = unit, text
        return own


class TableError(FilesError):
    """A file that is no table, or a mapping that does not fit the tables."""


@dataclass(frozen=True)
class Column:
    """Cells below one header."""

    id: str  #: letter as in a spreadsheet; for words around a table `file`, `title`, `block`, or `A.1`
    header: str
    cells: tuple[Cell, ...]

    @property
    def is_own(self) -> bool:
        """Return whether the column is in the file itself, and not made of the words around the table."""
        return self.id.isupper() and self.id.isalpha()

    @cached_property
    def is_numeric(self) -> bool:
        """Return whether nearly all filled cells are numbers."""
        filled = [cell for cell in self.cells if cell is not None]
        count = sum(isinstance(cell, float) for cell in filled)
        return bool(filled) and count >= _LEAST_NUMERIC * len(filled)

    @cached_property
    def numbers(self) -> FloatArray:
        """Cells as numbers (N,); NaN for a word or nothing."""
        return np.array([cell if isinstance(cell, float) else np.nan for cell in self.cells])

    @cached_property
    def words(self) -> list[str]:
        """Cells as words: `01` and `1.0` are `1`, as spreadsheets write names."""
        return [as_word(cell) for cell in self.cells]


def as_word(cell: Cell) -> str:
    """Return a cell as a word; whole numbers have no leading zeros and no decimals."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell + 0.0:.12g}"  # −0 is 0
    word = cell.strip()
    return str(int(word)) if word.isdecimal() else word


@dataclass(frozen=True)
class Table:
    """Columns of equal length."""

    name: str  #: `a.csv`, `book.xlsx#Sheet1`, `log.txt#2`
    columns: tuple[Column, ...] = field(repr=False)

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(self.columns[0].cells) if self.columns else 0

    @property
    def form(self) -> tuple[tuple[str, bool], ...]:
        """Headers and kinds of the columns: tables of one form may be stacked."""
        return tuple((column.header, column.is_numeric) for column in self.columns)

    def column(self, name: str) -> Column:
        """Return a column by its id.

        Raises:
            TableError: the table has no such column.
        """
        for column in self.columns:
            if column.id == name:
                return column
        columns = ", ".join(column.id for column in self.columns)
        raise TableError(f"there is no column {name}", where=self.name, remedy=f"use the columns {columns}")

    def numbers(self, names: Sequence[str]) -> FloatArray:
        """Return columns as numbers (N, m)."""
        columns = [self.column(name).numbers for name in names]
        return np.array(columns).reshape(len(columns), self.row_count).T

    def with_columns(self, columns: Sequence[Column]) -> Table:
        """Return the table with further columns."""
        return replace(self, columns=(*self.columns, *columns))

    def fill_down(self, names: Sequence[str]) -> Table:
        """Return the table whose empty cells in some columns have the cell above, as merged cells mean."""
        columns = []
        for column in self.columns:
            cells = list(column.cells)
            if column.id in names:
                for row in range(1, len(cells)):
                    cells[row] = cells[row - 1] if cells[row] is None else cells[row]
            columns.append(replace(column, cells=tuple(cells)))
        return replace(self, columns=tuple(columns))


def letter(index: int) -> str:
    """Return the name of a column as in a spreadsheet: 0 → A, 26 → AA."""
    rest, last = divmod(index, 26)
    return (letter(rest - 1) if rest else "") + chr(ord("A") + last)


def build_table(name: str, headers: Sequence[str], rows: Sequence[Sequence[Cell]]) -> Table:
    """Build a table from rows of cells; columns without any cell are left out, but keep their letter.

    Raises:
        TableError: the table is too large.
    """
    width = max(map(len, rows), default=0)
    if width > MAX_COLUMNS or len(rows) > MAX_ROWS or width * len(rows) > MAX_CELLS:
        limits = f"{MAX_ROWS:,} rows, {MAX_COLUMNS} columns or {MAX_CELLS:,} cells"
        raise TableError(f"the table has more than {limits}", where=name, remedy="split the file")
    columns = []
    for index in range(width):
        header = " ".join(headers[index].split()) if index < len(headers) else ""
        cells = tuple(row[index] if index < len(row) else None for row in rows)
        _refuse_other_texts(name, (header, *cells))
        if any(cell is not None for cell in cells):
            columns.append(_split_units(Column(letter(index), header, cells)))
    return Table(name, tuple(columns))


def _refuse_other_texts(name: str, cells: Sequence[Cell]) -> None:
    """Refuse a text that is longer than names are, or cannot be printed.

    Raises:
        TableError: there is such a text.
    """
    if any(isinstance(cell, str) and not cell.isprintable() for cell in cells):
        reason = "a cell has characters that cannot be printed"
        raise TableError(reason, where=name, remedy="state the `encoding` of the file, or correct the cell")
    if any(isinstance(cell, str) and len(cell) > MAX_CELL_LENGTH for cell in cells):
        reason = f"a cell has more than {MAX_CELL_LENGTH} characters"
        raise TableError(reason, where=name, remedy="remove texts that are no names")


def _split_units(column: Column) -> Column:
    """Return a column whose cells have one unit with this unit in the header; other units remain words."""
    units = {
        cell.unit if isinstance(cell, NumberWithUnit) else "" for cell in column.cells if cell is not None
    }
    if units == {""}:
        return column
    if len(units) == 1:
        cells: tuple[Cell, ...] = tuple(None if cell is None else float(cell) for cell in column.cells)
        return replace(column, header=f"{column.header} [{units.pop()}]".strip(), cells=cells)
    cells = tuple(cell.text if isinstance(cell, NumberWithUnit) else cell for cell in column.cells)
    return replace(column, cells=cells)


def group_forms(tables: Sequence[Table]) -> list[list[Table]]:
    """Return the tables of each form, in the order of their first table."""
    groups: dict[object, list[Table]] = defaultdict(list)
    for table in tables:
        groups[table.form].append(table)
    return list(groups.values())


def stack(tables: Sequence[Table]) -> Table:
    """Return tables of one form below each other; the column `file` has the name of each row's table."""
    first, *others = tables
    if not others:
        return first
    columns = []
    for index, column in enumerate(first.columns):
        cells = tuple(cell for table in tables for cell in table.columns[index].cells)
        columns.append(replace(column, cells=cells))
    names = tuple(table.name for table in tables for _ in range(table.row_count))
    return Table(first.name, (*columns, Column("file", "file", names)))


def transpose(table: Table) -> Table:
    """Return a table whose rows were columns; the words of its first column become headers."""
    first, *others = table.columns
    if first.is_numeric:
        headers = [""] * (1 + table.row_count)
        columns: Sequence[Column] = table.columns
    else:
        headers = ["", *first.words]
        columns = others
    numeric = [column for column in columns if column.is_own and np.isfinite(column.numbers).any()]
    rows: list[list[Cell]] = [[column.header or None, *column.cells] for column in numeric]
    return build_table(table.name, headers, rows)


def split_words(column: Column, marks: str) -> Iterator[Column]:
    """Yield the parts of words such as `P01_T1_loaded` as columns `A.1`, `A.2`, …, if all have as many."""
    rows = [cut(word, marks) for word in column.words]
    width = max(map(len, rows), default=0)
    if width < 2 or any(len(row) not in (width, 0) for row in rows):
        return
    for part in range(width):
        cells = tuple(row[part] if row else None for row in rows)
        yield Column(f"{column.id}.{part + 1}", f"{column.header} part {part + 1}".strip(), cells)


def cut(word: str, marks: str) -> list[str]:
    """Return the parts of a word between marks, without empty ones."""
    for mark in marks:
        word = word.replace(mark, " ")
    return word.split()
