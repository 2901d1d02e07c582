"""Polar readings of a tracker or a total station: two angles and a distance, as coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    UNKNOWN,
    Meaning,
    Quantity,
    find_any_unit,
    parse_polar,
    split_unit,
)
from jointstiff.service.importing.unit_remarks import find_unit_of_name
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.table import METRES

_RADIANS: Final = {"rad": 1.0, "deg": math.pi / 180.0, "gon": math.pi / 200.0}
"""Units of angles, in radians."""


_PARTS: Final = 3
"""Numbers of a polar reading."""


class _Convention(NamedTuple):
    """Way in which angles are counted."""

    is_from_zenith: bool  # the vertical angle; else it is the elevation above the horizon
    is_clockwise: bool  # the horizontal angle, seen from above

    @property
    def note(self) -> str:
        """The convention in words."""
        vertical = "zenith angle" if self.is_from_zenith else "elevation"
        sense = "clockwise" if self.is_clockwise else "counterclockwise"
        return f"vertical angles as {vertical}, horizontal angles {sense}"


class _PolarColumns(NamedTuple):
    """Columns of the polar readings of a table."""

    horizontal: int
    vertical: int
    distance: int
    radians: tuple[float, float]  # of the units of both angles
    unit: str  # of the distance


def list_cartesian(tables: Sequence[NumberTable]) -> Iterator[tuple[list[NumberTable], str]]:
    """Yield the tables with polar readings as x, y, z by each convention, and a note on the convention.

    Nothing without polar readings.

    Raises:
        ImportFileError: the caller states polar readings, but not all three with their units.
    """
    polar = [_find_columns(table) for table in tables]
    names = [table.name for table, columns in zip(tables, polar, strict=True) if columns is not None]
    if not names:
        return
    units = "".join(
        _describe_units(table, columns)
        for table, columns in zip(tables, polar, strict=True)
        if columns is not None
    )
    for is_from_zenith, is_clockwise in product((True, False), (False, True)):
        convention = _Convention(is_from_zenith, is_clockwise)
        converted = [
            table if columns is None else _convert(table, columns, convention)
            for table, columns in zip(tables, polar, strict=True)
        ]
        note = f"polar readings of {', '.join(names)} as x, y, z of the instrument: {convention.note}"
        yield converted, f"{note}, as the robot shows{units}"


def _describe_units(table: NumberTable, columns: _PolarColumns) -> str:
    """Return the end of a note on the units of polar readings that remarks state; empty without a unit."""
    found = {
        table.headers[column]: unit
        for column in (columns.horizontal, columns.vertical, columns.distance)
        if (unit := find_unit_of_name(table.headers[column], table.remarks)) is not None
    }
    if not found:
        return ""
    listed = ", ".join(f"{name} in {unit}" for name, unit in found.items())
    return f"; {listed} according to remarks in {table.name}"


def _find_columns(table: NumberTable) -> _PolarColumns | None:
    """Return the columns whose headers name two angles and a distance, with their units; else None.

    Raises:
        ImportFileError: the caller states polar readings, but not all three with their units.
    """
    columns_of_part: dict[int, list[int]] = {part: [] for part in range(_PARTS)}
    units: dict[int, str] = {}
    for column in range(len(table.headers)):
        meaning = _find_polar_meaning(table, column)
        if meaning is not None and meaning.axis is not None:
            columns_of_part[meaning.axis].append(column)
            units[column] = meaning.unit or _find_unit(table, column)
    are_found = all(len(columns) == 1 for columns in columns_of_part.values())
    if are_found:
        horizontal, vertical, distance = (columns[0] for columns in columns_of_part.values())
        angles = _RADIANS.get(units[horizontal]), _RADIANS.get(units[vertical])
        if angles[0] is not None and angles[1] is not None and units[distance] in METRES:
            return _PolarColumns(horizontal, vertical, distance, (angles[0], angles[1]), units[distance])
    _refuse_incomplete_statement(table)
    return None


def _find_polar_meaning(table: NumberTable, column: int) -> Meaning | None:
    """Return the meaning of a column of polar readings, stated or by its header; None for other columns."""
    meaning = table.meanings[column]
    if meaning is not None and meaning.kind == "polar":
        return meaning
    is_free = column not in table.ignored | table.stated
    return parse_polar(table.headers[column]) if is_free else None


def _find_unit(table: NumberTable, column: int) -> str:
    """Return the unit of a column that its header or a remark above the table states; empty without one."""
    name, text = split_unit(table.headers[column])
    known = find_any_unit(text or "")
    return (find_unit_of_name(name, table.remarks) or "") if known is None else known[1]


def _refuse_incomplete_statement(table: NumberTable) -> None:
    """Refuse stated columns of polar readings that lack one of the three, or a unit.

    Raises:
        ImportFileError: there are such columns.
    """
    stated = [
        column
        for column in sorted(table.stated)
        if (meaning := table.meanings[column]) is not None and meaning.kind == "polar"
    ]
    if not stated:
        return
    examples = ("horizontal angle [gon]", "vertical angle [gon]", "distance [m]")
    raise ImportFileError(
        Place(table.grid.file, None, stated[0] + 1),
        f"{quote(table.headers[stated[0]])} is stated to be a part of a polar reading, which has two angles "
        "and a distance, each with its unit",
        f"state one column for each of {', '.join(f'`{each}`' for each in examples)} in `columns`",
        UNKNOWN,
    )


def _convert(table: NumberTable, columns: _PolarColumns, convention: _Convention) -> NumberTable:
    """Return the table with x, y and z in place of polar readings."""
    numbers = table.table.numbers
    horizontal = columns.radians[0] * numbers[:, columns.horizontal]
    vertical = columns.radians[1] * numbers[:, columns.vertical]
    distance = numbers[:, columns.distance]
    zenith = vertical if convention.is_from_zenith else math.pi / 2.0 - vertical
    sense = -1.0 if convention.is_clockwise else 1.0
    level = distance * np.sin(zenith)
    places = sorted((columns.horizontal, columns.vertical, columns.distance))
    axes = (level * np.cos(horizontal), sense * level * np.sin(horizontal), distance * np.cos(zenith))
    headers, meanings = list(table.headers), list(table.meanings)
    for axis, column in enumerate(places):
        headers[column] = f"{'xyz'[axis]} [{columns.unit}]"
        meanings[column] = Meaning(Quantity("position"), axis, columns.unit)
    converted = table.replace_numbers(dict(zip(places, axes, strict=True)))
    others = converted.table.others.difference(places)
    numbers_alone = replace(converted.table, others=others)
    stated = table.stated.difference(places)
    return replace(
        converted, headers=tuple(headers), meanings=tuple(meanings), table=numbers_alone, stated=stated
    )
