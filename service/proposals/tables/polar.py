"""Polar readings of a tracker or a total station: two angles and a distance, as coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.importing.grammar import (
    Meaning,
    Quantity,
    collapse_blanks,
    find_any_unit,
    split_unit,
)
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.tables.labels import fold_word

_HORIZONTAL: Final = frozenset(("hz", "h", "az", "azimuth", "azimut", "horizontal", "horizontal angle"))
"""Names of the horizontal angle."""
_VERTICAL: Final = frozenset(
    ("v", "vz", "el", "ze", "zenith", "zenit", "zenith angle", "elevation", "vertical", "vertical angle")
)
"""Names of the vertical angle, from the zenith or from the horizon."""
_DISTANCE: Final = frozenset(("d", "sd", "dist", "distance", "slope distance", "range", "distanz"))
"""Names of the distance along the line of sight."""
_RADIANS: Final = {"rad": 1.0, "deg": math.pi / 180.0, "gon": math.pi / 200.0}
"""Units of angles, in radians."""


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
    """
    polar = [_find_columns(table) for table in tables]
    names = [table.name for table, columns in zip(tables, polar, strict=True) if columns is not None]
    if not names:
        return
    for is_from_zenith, is_clockwise in product((True, False), (False, True)):
        convention = _Convention(is_from_zenith, is_clockwise)
        converted = [
            table if columns is None else _convert(table, columns, convention)
            for table, columns in zip(tables, polar, strict=True)
        ]
        note = f"polar readings of {', '.join(names)} as x, y, z of the instrument: {convention.note}"
        yield converted, f"{note}, as the robot shows"


def _find_columns(table: NumberTable) -> _PolarColumns | None:
    """Return the columns whose headers name two angles and a distance, with their units; else None."""
    found: dict[str, tuple[int, str]] = {}
    for column, header in enumerate(table.headers):
        base, written = split_unit(header)
        known = find_any_unit(written or "")
        name = collapse_blanks(fold_word(base))
        for kind, names in (("horizontal", _HORIZONTAL), ("vertical", _VERTICAL), ("distance", _DISTANCE)):
            dimension = "length" if kind == "distance" else "angle"
            if known is not None and known[0] == dimension and name in names:
                if kind in found or column in table.ignored | table.stated:
                    return None
                found[kind] = column, known[1]
    if len(found) < 3:
        return None
    horizontal, vertical, distance = (found[kind] for kind in ("horizontal", "vertical", "distance"))
    if not {horizontal[1], vertical[1]} <= _RADIANS.keys():
        return None
    radians = _RADIANS[horizontal[1]], _RADIANS[vertical[1]]
    return _PolarColumns(horizontal[0], vertical[0], distance[0], radians, distance[1])


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
    return replace(converted, headers=tuple(headers), meanings=tuple(meanings), table=numbers_alone)
