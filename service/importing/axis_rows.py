"""Tables with a row for each point and axis, as PolyWorks exports, read with a row for each point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from jointstiff.service.importing.grammar import is_key, split_unit
from jointstiff.service.importing.grid import Grid, Row, looks_like_a_number
from jointstiff.service.tables.labels import fold_word

_AXES: Final = ("x", "y", "z")
_LEAST_POINTS: Final = 3
_MOST_TITLES: Final = 20
"""Rows above the header."""
_MEASURED: Final = frozenset(
    ("measured", "meas", "actual", "act", "ist", "istwert", "gemessen", "measurement", "mesuré", "mesure",
     "mesurée", "value", "wert", "valeur", "messwert")
)  # fmt: skip
"""Words of the column of measured coordinates."""


@dataclass(frozen=True)
class _AxisTable:
    """Table with a column of axes: the rows of a point follow each other."""

    header: Row
    points: Sequence[Mapping[str, Row]]  # axis → row
    axis_column: int

    @property
    def others(self) -> list[int]:
        """Columns without that of the axes."""
        return [column for column in range(len(self.header.cells)) if column != self.axis_column]

    def is_same(self, column: int) -> bool:
        """Return whether a column has the same cell in the three rows of each point."""
        return all(len({row.cells[column] for row in point.values()}) == 1 for point in self.points)

    def has_numbers(self, column: int) -> bool:
        """Return whether all cells of a column are numbers."""
        return all(looks_like_a_number(row.cells[column]) for point in self.points for row in point.values())


def join_axis_rows(grid: Grid) -> Grid:
    """Return a table by axis with a row for each point; any other table unchanged.

    Of several columns of numbers the measured one is read, if its header says so.
    """
    for start, header in enumerate(grid.rows[: _MOST_TITLES + 1]):
        table = _find_axes(grid, start)
        if table is not None:
            titles = grid.rows[:start]
            note = f"the rows of {len(table.points)} points by axis were joined"
            rows, left = _join_rows(table)
            notes = [*grid.preview.assumptions, note + (f"; not read: {', '.join(left)}" if left else "")]
            preview = grid.preview.model_copy(update={"assumptions": notes})
            return replace(grid, preview=preview, rows=(*titles, *rows))
        if sum(map(looks_like_a_number, header.cells)):
            break
    return grid


def _find_axes(grid: Grid, start: int) -> _AxisTable | None:
    """Return the table below a header with a column of axes; None without such a column."""
    header, rows = grid.rows[start], _fill_down(grid.rows[start + 1 :])
    width = len(header.cells)
    if len(rows) < _LEAST_POINTS * len(_AXES) or any(len(row.cells) != width for row in rows):
        return None
    for column in range(width):
        axes = [fold_word(row.cells[column]) for row in rows]
        if set(axes) == set(_AXES):
            points = _group_points(rows, axes)
            return None if points is None else _AxisTable(header, points, column)
    return None


def _fill_down(rows: Sequence[Row]) -> list[Row]:
    """Return rows whose empty first cells have the cell above: a name is often in the first row only."""
    filled: list[Row] = []
    for row in rows:
        first = row.cells[0] or (filled[-1].cells[0] if filled else "")
        filled.append(replace(row, cells=(first, *row.cells[1:])))
    return filled


def _group_points(rows: Sequence[Row], axes: Sequence[str]) -> list[dict[str, Row]] | None:
    """Return the rows of each point by axis; None if a group of three rows has no x, y and z."""
    if len(rows) % len(_AXES):
        return None
    points = []
    for first in range(0, len(rows), len(_AXES)):
        point = dict(zip(axes[first : first + 3], rows[first : first + 3], strict=True))
        if len(point) != len(_AXES):
            return None
        points.append(point)
    return points


def _join_rows(table: _AxisTable) -> tuple[list[Row], list[str]]:
    """Return a header and a row for each point, and the headers of the columns that are not read."""
    numbers = [column for column in table.others if table.has_numbers(column)]
    once = [column for column in table.others if table.is_same(column)]
    values = [column for column in numbers if column not in once]
    measured = [column for column in values if _is_measured(table.header.cells[column])]
    chosen = measured if len(measured) == 1 else values
    headers = [_name_key(table, column) for column in once]
    for column in chosen:
        headers += [_name_axis(table.header.cells[column], axis, len(chosen) == 1) for axis in _AXES]
    rows = [Row(table.header.line, tuple(headers))]
    for point in table.points:
        cells = [(point["x"], column) for column in once]
        cells += [(point[axis], column) for column in chosen for axis in _AXES]
        kinds = tuple(row.kinds[column] for row, column in cells if row.kinds is not None)
        texts = tuple(row.cells[column] for row, column in cells)
        rows.append(Row(point["x"].line, texts, kinds or None))
    left = [table.header.cells[column] for column in values if column not in chosen]
    return rows, left


def _is_measured(header: str) -> bool:
    """Return whether a header names measured coordinates."""
    return not _MEASURED.isdisjoint(fold_word(split_unit(header)[0]).strip(".").split())


def _name_key(table: _AxisTable, column: int) -> str:
    """Return the header of a column that is the same for the rows of a point; the first is `name`."""
    header = table.header.cells[column]
    is_first = column == next(each for each in table.others if table.is_same(each))
    return "name" if is_first and not is_key(header) else header


def _name_axis(header: str, axis: str, is_only_one: bool) -> str:
    """Return the header of a coordinate, with the unit of its column."""
    name, unit = split_unit(header)
    words = axis if is_only_one else f"{name} {axis}"
    return f"{words} [{unit}]" if unit else words
