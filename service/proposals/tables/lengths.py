"""Lengths of files in one unit: positions in metres and millimetres, and displacements in micrometres."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from jointstiff.service.importing.grammar import find_any_unit, split_unit
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.table import METRES, LengthUnit

_MOST_METRES: Final = 20.0
"""Coordinate up to which a number may be in metres, and from which it may be in millimetres."""
MOST_REPEAT: Final = 1e-4
"""Greatest distance [m] of a repeated coordinate from the mean of all repeats."""
_ORDINARY: Final = 90.0
"""Percentile of absolute numbers that counts as their size."""


def find_size(table: NumberTable, columns: Collection[int]) -> float:
    """Return the size of the numbers in some columns: most are not larger."""
    numbers = np.abs(table.table.numbers[:, sorted(columns)])
    known = numbers[np.isfinite(numbers)]
    return float(np.percentile(known, _ORDINARY)) if known.size else 0.0


def guess_unit(size: float) -> LengthUnit:
    """Return the unit that coordinates of a size [unit] have if they are in m or mm."""
    return "m" if size < _MOST_METRES else "mm"


def find_units_of_coordinates(table: NumberTable) -> dict[int, float]:
    """Return the size of the unit [m] of each column of coordinates.

    Coordinates are columns that headers name as positions, or of numbers of hundreds of millimetres. Whole
    numbers below an unknown header count rows, and a unit of another quantity has other numbers.
    """
    sizes = {}
    for column, meaning in enumerate(table.meanings):
        unit = guess_unit(find_size(table, [column]))
        is_position = meaning is not None and meaning.kind == "position"
        may_be_position = meaning is None and not _has_other_unit(table, column)
        if is_position or (may_be_position and unit == "mm" and not _is_whole(table, column)):
            sizes[column] = METRES[unit]
    return sizes


def _has_other_unit(table: NumberTable, column: int) -> bool:
    """Return whether the header of a column states a unit of another quantity than length, such as `°C`."""
    unit = split_unit(table.headers[column])[1]
    known = None if unit is None else find_any_unit(unit)
    return known is not None and known[0] != "length"


def _is_whole(table: NumberTable, column: int) -> bool:
    """Return whether a column has whole numbers only."""
    numbers = table.table.numbers[:, column]
    known = numbers[np.isfinite(numbers)]
    return bool((known == np.round(known)).all())


def unify_lengths(tables: Sequence[NumberTable]) -> list[NumberTable]:
    """Return the tables with their positions in mm, if headers state different units of positions."""
    units = {
        meaning.unit
        for table in tables
        for meaning in table.meanings
        if meaning is not None and meaning.kind == "position" and meaning.unit is not None
    }
    if len(units) < 2:
        return list(tables)
    return [_convert_by_headers(table) for table in tables]


def _convert_by_headers(table: NumberTable) -> NumberTable:
    """Return a table with the positions in mm whose headers state another unit."""
    for unit in ("m", "in"):
        columns = [
            column
            for column, meaning in enumerate(table.meanings)
            if meaning is not None and meaning.kind == "position" and meaning.unit == unit
        ]
        if columns:
            table = table.scale(columns, METRES[unit] / METRES["mm"], "mm")
    return table


def convert_columns(table: NumberTable, columns: Collection[int], unit: LengthUnit) -> NumberTable | None:
    """Return a table with coordinates in metres converted to mm, or to metres; None if no column is so.

    Args:
        table: table of numbers.
        columns: columns that may be coordinates.
        unit: unit of the other positions; these columns may be 1000 times as large or as small.
    """
    if unit not in ("m", "mm"):
        return None
    other = [column for column in columns if guess_unit(find_size(table, [column])) != unit]
    factor = 1e3 if unit == "mm" else 1e-3
    return table.scale(other, factor, unit) if other else None
