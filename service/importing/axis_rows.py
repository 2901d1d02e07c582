"""Tables with a row for each axis of a point, as PolyWorks exports, or for each joint of a posture, joined.

The table that is read has a row for each point or posture.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

from jointstiff.service.importing.grammar import (
    Vocabulary,
    find_any_unit,
    is_key,
    split_unit,
    split_unit_suffix,
)
from jointstiff.service.importing.grid import Grid, Row, looks_like_a_number
from jointstiff.service.tables.labels import fold_word

_AXES: Final[Mapping[str, str]] = MappingProxyType({axis: axis for axis in "xyz"})
_LEAST_JOINTS: Final = 3
_MOST_JOINTS: Final = 7
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
    """Table with a column of axes or joints: each point or posture has a row for each."""

    header: Row
    names: Mapping[
        str, str
    ]  # folded cell of an axis → its name: x, y and z, or the joints from base to flange
    points: Sequence[Mapping[str, Row]]  # axis → row
    axis_column: int

    @property
    def axes(self) -> list[str]:
        """Cells of the axes, in the order of their columns."""
        return list(self.names)

    @property
    def is_of_joints(self) -> bool:
        """Return whether the axes are joints."""
        return self.names.keys() != _AXES.keys()

    @property
    def has_angles(self) -> bool:
        """Return whether one column has the angles of all joints of a named posture: no more numbers vary."""
        return bool(self.constant) and len(self.chosen) == 1

    @property
    def others(self) -> list[int]:
        """Columns without that of the axes."""
        return [column for column in range(len(self.header.cells)) if column != self.axis_column]

    @cached_property
    def constant(self) -> list[int]:
        """Columns that have the same cell in all rows of each point."""
        return [column for column in self.others if self._is_same(column)]

    @cached_property
    def varying(self) -> list[int]:
        """Columns of numbers that differ between the rows of a point."""
        constant = self.constant
        return [column for column in self.others if column not in constant and self._has_numbers(column)]

    @cached_property
    def chosen(self) -> list[int]:
        """Varying columns that are read: the measured one, if only one says so; angles of joints."""
        headers = self.header.cells
        angles = [column for column in self.varying if self.is_of_joints and _is_angle(headers[column])]
        possible = angles or self.varying
        measured = [column for column in possible if _is_measured(headers[column])]
        return measured if len(measured) == 1 else possible

    def _is_same(self, column: int) -> bool:
        """Return whether a column has the same cell in all rows of each point."""
        return all(len({row.cells[column] for row in point.values()}) == 1 for point in self.points)

    def _has_numbers(self, column: int) -> bool:
        """Return whether all cells of a column are numbers."""
        return all(looks_like_a_number(row.cells[column]) for point in self.points for row in point.values())


def join_axis_rows(grid: Grid, words: Vocabulary) -> Grid:
    """Return a table by axis with a row for each point or posture; any other table unchanged.

    Of several columns of numbers the measured one is read, if its header says so.
    """
    for start, header in enumerate(grid.rows[: _MOST_TITLES + 1]):
        table = _find_axes(grid, start, words)
        if table is not None:
            titles = grid.rows[:start]
            rows, left = _join_rows(table)
            kind = "postures by joint" if table.is_of_joints else "points by axis"
            note = f"the rows of {len(table.points)} {kind} were joined"
            notes = [*grid.preview.assumptions, note + (f"; not read: {', '.join(left)}" if left else "")]
            preview = grid.preview.model_copy(update={"assumptions": notes})
            return replace(grid, preview=preview, rows=(*titles, *rows))
        if sum(map(looks_like_a_number, header.cells)):
            break
    return grid


def _find_axes(grid: Grid, start: int, words: Vocabulary) -> _AxisTable | None:
    """Return the table below a header with a column of axes or joints; None without such a column."""
    header, rows = grid.rows[start], _fill_down(grid.rows[start + 1 :])
    width = len(header.cells)
    if len(rows) < _LEAST_POINTS * len(_AXES) or any(len(row.cells) != width for row in rows):
        return None
    for column, title in enumerate(header.cells):
        texts = [row.cells[column] for row in rows]
        cells = list(map(fold_word, texts))
        is_of_axes = set(cells) == _AXES.keys()
        names = _AXES if is_of_axes else _name_joints(title, texts, words)
        points = _group_points(rows, cells, names) if names else None
        table = None if points is None else _AxisTable(header, names, points, column)
        if is_of_axes or (table is not None and table.has_angles):
            return table
    return None


def _name_joints(header: str, cells: Sequence[str], words: Vocabulary) -> dict[str, str]:
    """Return folded cell → name of the joint, from base to flange; empty unless cells name an arm's joints.

    A number is a joint if the header of the column says so, such as `1` below `joint`.
    """
    different = {fold_word(cell): cell for cell in cells}
    if not _LEAST_JOINTS <= len(different) <= _MOST_JOINTS:
        return {}
    names = [f"{header} {cell}" if cell.isdecimal() else cell for cell in different.values()]
    words.add_names_of_table(names)
    meanings = [words.find(name) for name in names]
    joints = {
        meaning.axis: place
        for place, meaning in enumerate(meanings)
        if meaning is not None and meaning.kind == "joint" and meaning.axis is not None
    }
    if sorted(joints) != list(range(len(different))):
        return {}
    folded = list(different)
    return {folded[place]: names[place] for _, place in sorted(joints.items())}


def _fill_down(rows: Sequence[Row]) -> list[Row]:
    """Return rows whose empty first cells have the cell above: a name is often in the first row only."""
    filled: list[Row] = []
    for row in rows:
        first = row.cells[0] or (filled[-1].cells[0] if filled else "")
        filled.append(replace(row, cells=(first, *row.cells[1:])))
    return filled


def _group_points(
    rows: Sequence[Row], cells: Sequence[str], axes: Collection[str]
) -> list[dict[str, Row]] | None:
    """Return the rows of each point by axis; None if a group of rows has not each axis once.

    The rows of a point follow each other, or those of an axis do, as a program melts a table; `cells` has the
    axis of each row.
    """
    count, rest = divmod(len(rows), len(axes))
    if rest:
        return None
    is_melted = len(set(cells[:count])) == 1
    step = count if is_melted else 1
    points = []
    for number in range(count):
        first = number if is_melted else number * len(axes)
        places = range(first, first + step * len(axes), step)
        point = {cells[place]: rows[place] for place in places}
        if len(point) != len(axes):
            return None
        points.append(point)
    has_one_name = all(len({row.cells[0] for row in point.values()}) == 1 for point in points)
    return points if has_one_name or not is_melted else None


def _join_rows(table: _AxisTable) -> tuple[list[Row], list[str]]:
    """Return a header and a row for each point, and the headers of the columns that are not read."""
    chosen, constant = table.chosen, table.constant
    headers = [_name_key(table, column) for column in constant]
    for column in chosen:
        headers += [_name_axis(table, column, axis) for axis in table.names]
    rows = [Row(table.header.line, tuple(headers))]
    for point in table.points:
        first = point[table.axes[0]]
        cells = [(first, column) for column in constant]
        cells += [(point[axis], column) for column in chosen for axis in table.axes]
        kinds = tuple(row.kinds[column] for row, column in cells if row.kinds is not None)
        texts = tuple(row.cells[column] for row, column in cells)
        rows.append(Row(first.line, texts, kinds or None))
    left = [table.header.cells[column] for column in table.varying if column not in chosen]
    return rows, left


def _split_unit(header: str) -> tuple[str, str | None]:
    """Split a header such as `value [mm]` or `value_mm` into name and unit; None without a unit."""
    name, unit = split_unit(header)
    return (name, unit) if unit is not None else split_unit_suffix(name) or (name, None)


def _is_angle(header: str) -> bool:
    """Return whether a header has a unit of angles."""
    known = find_any_unit(_split_unit(header)[1] or "")
    return known is not None and known[0] == "angle"


def _is_measured(header: str) -> bool:
    """Return whether a header names measured coordinates."""
    return not _MEASURED.isdisjoint(fold_word(_split_unit(header)[0]).strip(".").split())


def _name_key(table: _AxisTable, column: int) -> str:
    """Return the header of a column that is the same for the rows of a point; the first is `name`."""
    header = table.header.cells[column]
    is_first = column == table.constant[0]
    return "name" if is_first and not is_key(header) else header


def _name_axis(table: _AxisTable, column: int, axis: str) -> str:
    """Return the header of a coordinate or a joint, with the unit of its column."""
    name, unit = _split_unit(table.header.cells[column])
    words = axis if len(table.chosen) == 1 else f"{name} {axis}"
    return f"{words} [{unit}]" if unit else words
