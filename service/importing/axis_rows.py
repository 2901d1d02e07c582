"""Tables with a row for each axis of a point, as PolyWorks exports, or for each joint of a posture, joined.

The table that is read has a row for each point or posture.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import (
    OPPOSITE_STATE,
    Vocabulary,
    find_any_unit,
    find_state_in_name,
    is_key,
    is_planned,
    split_unit,
    split_unit_suffix,
)
from jointstiff.service.importing.grid import Grid, Row, looks_like_a_number
from jointstiff.service.importing.loads import find_load, find_state_of_load
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
_NOMINAL: Final = frozenset(
    ("nominal", "nom", "nominell", "soll", "sollwert", "theoretical", "theo", "théorique", "reference", "ref",
     "referenz", "référence", "referencia", "riferimento")
)  # fmt: skip
"""Words of the column that measured coordinates are compared with: planned ones, or those without load."""
_STATEMENT: Final = re.compile(r"\s?[=:]\s?([^=:;,|]{1,80})")
"""Text of a title on a column behind its header, as in `Nominal = without load`."""


@dataclass(frozen=True)
class _AxisTable:
    """Table with a column of axes or joints: each point or posture has a row for each."""

    header: Row
    # folded cell of an axis → its name: x, y and z, or the joints from base to flange
    names: Mapping[str, str]
    points: Sequence[Mapping[str, Row]]  # axis → row
    axis_column: int
    states: Mapping[int, State] = field(default_factory=dict)  # of the nominal and the measured column

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
        """Varying columns that are read: those of states; the measured one, if only one says so; angles."""
        headers = self.header.cells
        if self.states:
            return sorted(self.states)
        angles = [column for column in self.varying if self.is_of_joints and _is_angle(headers[column])]
        possible = angles or self.varying
        measured = [column for column in possible if _has_word(headers[column], _MEASURED)]
        return measured if len(measured) == 1 else possible

    @property
    def compared(self) -> tuple[int, int] | None:
        """Columns of nominal and of measured coordinates, if there is one of each; else None."""
        headers = self.header.cells
        nominal, measured = (
            [column for column in self.varying if _has_word(headers[column], words)]
            for words in (_NOMINAL, _MEASURED)
        )
        is_pair = not self.is_of_joints and len(nominal) == len(measured) == 1 and nominal != measured
        return (nominal[0], measured[0]) if is_pair else None

    def _is_same(self, column: int) -> bool:
        """Return whether a column has the same cell in all rows of each point."""
        return all(len({row.cells[column] for row in point.values()}) == 1 for point in self.points)

    def _has_numbers(self, column: int) -> bool:
        """Return whether all cells of a column are numbers."""
        return all(looks_like_a_number(row.cells[column]) for point in self.points for row in point.values())


def join_axis_rows(grid: Grid, words: Vocabulary, *, with_nominal: bool = False) -> Grid:
    """Return a table by axis with a row for each point or posture; any other table unchanged.

    Of several columns of numbers the measured one is read, if its header says so. The nominal one is read
    with it, if a title or the caller says that both are states. Else it is kept `with_nominal` only.
    """
    for start, header in enumerate(grid.rows[: _MOST_TITLES + 1]):
        table = _find_axes(grid, start, words)
        if table is not None:
            titles = grid.rows[:start]
            table = replace(table, states=_find_states(table, titles, words))
            kept = _find_nominal(table) if with_nominal else None
            rows, left = _join_rows(table, kept)
            kind = "postures by joint" if table.is_of_joints else "points by axis"
            note = f"the rows of {len(table.points)} {kind} were joined"
            notes = [*grid.preview.assumptions, note + (f"; not read: {', '.join(left)}" if left else "")]
            preview = grid.preview.model_copy(update={"assumptions": notes})
            return replace(grid, preview=preview, rows=(*titles, *rows))
        if sum(map(looks_like_a_number, header.cells)):
            break
    return grid


def _find_states(table: _AxisTable, titles: Sequence[Row], words: Vocabulary) -> dict[int, State]:
    """Return the states of the nominal and the measured column by the caller or the titles; else nothing.

    The caller may state one of them only.
    """
    if table.compared is None:
        return {}
    nominal, measured = table.compared
    names = [_split_unit(table.header.cells[column])[0] for column in (nominal, measured)]
    first, second = (find_state_in_name(name, words.states) for name in names)
    if first is None and second is None:
        text = "; ".join(cell for row in titles for cell in row.cells)
        first, second = (_find_stated(name, text) for name in names)
    else:
        first, second = first or OPPOSITE_STATE.get(second), second or OPPOSITE_STATE.get(first)
    are_opposite = first is not None and OPPOSITE_STATE.get(first) == second
    return {nominal: first, measured: second} if are_opposite and first and second else {}


def _find_stated(name: str, text: str) -> State | None:
    """Return the state that the titles give to the column of a name; None without a clear one."""
    found = set[State | None]()
    for place in re.finditer(rf"(?<!\w){re.escape(name)}(?!\w)", text, re.IGNORECASE):
        clause = _STATEMENT.match(text, place.end())
        if clause is None:
            continue
        mass = find_load(clause[1])
        by_mass = None if mass is None else find_state_of_load(mass)
        by_words = find_state_in_name(clause[1], {})
        contradict = None not in (by_mass, by_words) and by_mass != by_words
        found.add(None if contradict else by_words or by_mass)
    return found.pop() if len(found) == 1 else None


def _find_nominal(table: _AxisTable) -> int | None:
    """Return the column of nominal coordinates that are in no state; None without one."""
    if table.states or table.compared is None:
        return None
    nominal, _ = table.compared
    return nominal if is_planned(f"{_split_unit(table.header.cells[nominal])[0]} x") else None


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


def _join_rows(table: _AxisTable, nominal: int | None) -> tuple[list[Row], list[str]]:
    """Return a header and a row for each point, and the headers of the columns that are not read.

    The column of `nominal` coordinates is kept.
    """
    chosen, constant = [*table.chosen, *([] if nominal is None else [nominal])], table.constant
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


def _has_word(header: str, words: Collection[str]) -> bool:
    """Return whether a header has one of some words, such as those of measured coordinates."""
    return any(word in words for word in fold_word(_split_unit(header)[0]).strip(".").split())


def _name_key(table: _AxisTable, column: int) -> str:
    """Return the header of a column that is the same for the rows of a point; the first is `name`."""
    header = table.header.cells[column]
    is_first = column == table.constant[0]
    return "name" if is_first and not is_key(header) else header


def _name_axis(table: _AxisTable, column: int, axis: str) -> str:
    """Return the header of a coordinate or a joint, with the unit of its column."""
    name, unit = _split_unit(table.header.cells[column])
    is_only = table.chosen == [column]
    words = axis if is_only else f"{table.states.get(column, name)} {axis}"
    return f"{words} [{unit}]" if unit else words
