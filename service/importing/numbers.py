"""Numbers of files whose columns have no known meaning yet, for the robot to find their meaning."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import PurePath
from typing import Final

import numpy as np

from jointstiff.schemas.imports import DecimalMark, ImportOptions
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import Meaning, Vocabulary, is_statistic
from jointstiff.service.importing.grid import (
    Grid,
    Row,
    count_numbers,
    decide_decimal_mark,
    has_separated_thousands,
    looks_like_a_number,
    read_number,
    remove_thousands_separators,
)
from jointstiff.service.importing.masses import is_mass_table
from jointstiff.service.importing.reading import SourceFile, read_grids
from jointstiff.solver.meaning.table import Table

_LEAST_NUMBERS: Final = 3
"""Numbers of a row of data, at least."""
_OTHER_KINDS: Final = frozenset(("force", "moment", "load point", "mass", "along", "uncertainty"))
"""Kinds of columns that are neither joints nor positions."""


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Table of a file, with the meanings that its headers have by their names."""

    grid: Grid
    headers: tuple[str, ...]  # empty texts without a header
    meanings: tuple[Meaning | None, ...]  # None for a header without a known meaning
    rows: tuple[Row, ...]  # rows of data
    mark: DecimalMark
    table: Table  # the numbers

    @property
    def name(self) -> str:
        """Name of the table among all tables: the file's, with the sheet's if the file has several."""
        return self.table.name

    @property
    def stem(self) -> str:
        """Name of the file without its extension."""
        return PurePath(self.grid.file).stem

    def find_column(self, kind: str) -> int | None:
        """Return the first column of a kind, such as `name`; None without one."""
        columns = (c for c, meaning in enumerate(self.meanings) if meaning and meaning.kind == kind)
        return next(columns, None)


def read_number_tables(
    files: Sequence[SourceFile], options: ImportOptions, joints: Sequence[str]
) -> list[NumberTable]:
    """Read the tables of numbers of all files; tables of masses or without rows of numbers are left out.

    `joints` are the names of the robot's joints, which columns may have.

    Raises:
        ImportFileError: a file is no table, or its numbers are ambiguous.
    """
    tables = []
    for file in files:
        grids = read_grids(file, options, every_length=True)
        for grid in grids:
            if not is_mass_table(grid) and any(_is_data(row) for row in grid.rows):
                sheet = grid.preview.sheet if len(grids) > 1 else None
                name = f"{grid.file}, {sheet}" if sheet else grid.file
                tables.append(_read_table(grid, name, options, joints))
    return tables


def _read_table(grid: Grid, name: str, options: ImportOptions, joints: Sequence[str]) -> NumberTable:
    """Read the rows of data of a table, at least one, and the header above these rows.

    Raises:
        ImportFileError: the decimal mark of the table is ambiguous.
    """
    data = [index for index, row in enumerate(grid.rows) if _is_data(row)]
    width = Counter(len(grid.rows[index].cells) for index in data).most_common(1)[0][0]
    rows = tuple(grid.rows[index] for index in data if len(grid.rows[index].cells) == width)
    headers = _find_headers(grid, data[0], width)
    columns = [c for c in range(width) if any(looks_like_a_number(row.cells[c]) for row in rows)]
    is_separated = grid.preview.format != "text" or has_separated_thousands(rows, columns)
    mark, _ = decide_decimal_mark(
        grid, rows, columns, options.decimal_mark, are_thousands_separated=is_separated
    )
    read = partial(_read_cell, mark=mark, are_thousands_separated=is_separated)
    numbers = np.array([[read(cell) for cell in row.cells] for row in rows])
    meanings = _find_meanings(headers, Vocabulary(options, joints))
    named_joints = _list_joint_columns(meanings)
    known_joints = named_joints if len(named_joints) == len(joints) else ()
    table = Table(name, numbers, known_joints, _find_other_columns(meanings))
    return NumberTable(grid, headers, meanings, rows, mark, table)


def _list_joint_columns(meanings: Sequence[Meaning | None]) -> tuple[int, ...]:
    """Return the columns whose headers name joints, in the order of the joints."""
    column_of_joint: dict[int, int] = {}
    for column, meaning in enumerate(meanings):
        if meaning is not None and meaning.kind == "joint" and meaning.axis is not None:
            column_of_joint[meaning.axis] = column
    return tuple(column_of_joint[joint] for joint in sorted(column_of_joint))


def _find_other_columns(meanings: Sequence[Meaning | None]) -> frozenset[int]:
    """Return the columns whose headers name something else than joints or positions, such as forces."""
    return frozenset(
        column
        for column, meaning in enumerate(meanings)
        if meaning is not None and meaning.kind in _OTHER_KINDS
    )


def _is_data(row: Row) -> bool:
    """Return whether a row has enough numbers to be a row of data, and no word such as `mean` before them."""
    first_filled = next((cell for cell in row.cells if cell), "")
    return count_numbers(row) >= _LEAST_NUMBERS and not is_statistic(first_filled)


def _find_headers(grid: Grid, first: int, width: int) -> tuple[str, ...]:
    """Return the header in the row above the first row of data; empty texts without a header."""
    if first > 0 and len(grid.rows[first - 1].cells) == width:
        return grid.rows[first - 1].cells
    return ("",) * width


def _find_meanings(headers: Sequence[str], words: Vocabulary) -> tuple[Meaning | None, ...]:
    """Return the meanings of headers by their names; None for an empty or unknown header."""
    return tuple(words.find(header) if header else None for header in headers)


def _read_cell(cell: str, mark: DecimalMark, *, are_thousands_separated: bool) -> float:
    """Return the number of a cell; NaN for a cell without a number."""
    text = remove_thousands_separators(cell, mark) if are_thousands_separated else cell
    try:
        return read_number(text, mark)
    except ImportFileError:
        return math.nan
