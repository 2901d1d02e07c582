"""Displacements under load: added to positions before the load, or alone as deflections."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.importing.differences import FACTORS, are_differences
from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.grammar import MICROMETRES, Meaning, Quantity, Vocabulary, split_unit
from jointstiff.service.importing.titles import find_states_of_titles
from jointstiff.service.proposals.tables.lengths import find_size, guess_unit
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.table import METRES

_SPELLINGS: Final = "|".join(sorted(map(re.escape, MICROMETRES), key=len, reverse=True))
_IN_MICROMETRES: Final = re.compile(
    rf"(.*\w['′]?)[\s_/,]*(?:[\s_/,]|\[|\()\s?(?:{_SPELLINGS})\s?[\])]?", re.IGNORECASE
)
"""A header with its unit, as in `dX [µm]`, `ΔX/µm` or `dx_um`."""
_INITIAL: Final = re.compile(r"([xyz])[\s_]?0", re.IGNORECASE)
"""A coordinate before the load, next to its displacement."""
MICROMETRE: Final = "µm"
SIZES: Final[Mapping[str, float]] = {**{str(unit): size for unit, size in METRES.items()}, MICROMETRE: 1e-6}
"""Unit of a displacement or an uncertainty → its size [m]."""
_LEAST, _MOST = 5e-6, 0.03
"""Displacements under load that are plausible [m]: larger than a tracker's noise, and elastic."""
_MOST_UNCERTAIN: Final = 1e-4
"""Uncertainty [m] up to which an instrument writes coordinates."""
_COMPARED_ROWS: Final = 32
"""Rows by which the two columns of a difference are found; all rows confirm these columns."""


class Displacement(NamedTuple):
    """Columns of the displacement of a target."""

    target: str | None
    columns: tuple[int, int, int]
    unit: str | None  # None if no header states a unit; one of three states the unit of all


def add_deflections(tables: Sequence[NumberTable], words: Vocabulary) -> tuple[list[NumberTable], list[str]]:
    """Return tables whose displacements were added to the positions before the load, and notes.

    The positions are in the same table, or in another one with as many rows. A displacement without such a
    position is not changed. One that is the difference of two positions, or has no number, is ignored, as are
    uncertainties under such a header, such as `dX`, of positions whose states are named.

    Raises:
        ImportFileError: displacements without a unit may be in two units.
    """
    changed, notes = list(tables), list[str]()
    if any(_list_displacements(table, words) for table in tables):
        named = [_name_initial(table) for table in tables]
        are_states_named = _names_states(named)
        changed = [_ignore_others(table, words, notes, are_states_named=are_states_named) for table in named]
    for number, table in enumerate(changed):
        for found in _list_displacements(table, words):
            others = [other for other in range(len(tables)) if other != number]
            for base_number in (number, *others):
                base_table = changed[base_number]
                base = _find_base(base_table, found.target)
                if base is None or len(base_table.rows) != len(table.rows):
                    continue
                changed[base_number] = _name_base(base_table, base, found.target)
                changed[number], note = _add_found(changed[number], found, base_table, base)
                notes.append(note)
                break
    return changed, notes


def _name_initial(table: NumberTable) -> NumberTable:
    """Return a table whose columns `X0`, `Y0`, `Z0` are positions without load, next to a displacement."""
    meanings = list(table.meanings)
    column_of_axis: dict[int, int] = {}
    for column, header in enumerate(table.headers):
        found = _INITIAL.fullmatch(split_unit(header)[0].strip())
        meaning = meanings[column]
        if found is not None and (meaning is None or meaning.quantity.target == "0"):
            column_of_axis["xyz".index(found[1].casefold())] = column
    if len(column_of_axis) != len("xyz"):
        return table
    for axis, column in column_of_axis.items():
        unit = split_unit(table.headers[column])[1]
        known = unit if unit in METRES else None
        meanings[column] = Meaning(Quantity("position", None, "unloaded"), axis, known)
    return replace(table, meanings=tuple(meanings))


def _names_states(tables: Sequence[NumberTable]) -> bool:
    """Return whether rows, headers or titles of tables name positions without load, and others under load."""
    states = set(find_states_of_titles([table.title for table in tables], {}).values())
    for table in tables:
        states.update(row.state for row in table.turn if row.state is not None)
        quantities = (meaning.quantity for meaning in table.meanings if meaning is not None)
        states.update(each.state for each in quantities if each.kind == "position" and each.state is not None)
    return {"unloaded", "loaded"} <= states


def _ignore_others(
    table: NumberTable, words: Vocabulary, notes: list[str], *, are_states_named: bool
) -> NumberTable:
    """Return a table that ignores columns under headers of displacements that state no displacement.

    They are differences of its positions, have no number, or are uncertainties of positions whose states are
    named. A note on each is added to `notes`.
    """
    ignored = set[int]()
    for found in _list_displacements(table, words):
        headers = ", ".join(table.headers[column] for column in found.columns)
        if not np.isfinite(table.table.numbers[:, list(found.columns)]).any():
            ignored.update(found.columns)
            notes.append(f"{headers} ignored, which have no numbers")
        elif (pair := _find_difference(table, found)) is not None:
            ignored.update(found.columns)
            first, second = (", ".join(table.headers[column] for column in columns) for columns in pair)
            notes.append(f"{headers} ignored, the difference of {first} and {second}")
        elif are_states_named and _are_uncertainties(table, found):
            ignored.update(found.columns)
            limit = f"{1e3 * _MOST_UNCERTAIN:g} mm"
            notes.append(f"{headers} ignored as uncertainties: all are above 0 and below {limit}")
    meanings = [None if column in ignored else each for column, each in enumerate(table.meanings)]
    return replace(table, meanings=tuple(meanings), ignored=table.ignored | ignored)


def _are_uncertainties(table: NumberTable, found: Displacement) -> bool:
    """Return whether numbers under headers of a displacement are all above 0, and small: no load moves so."""
    positions = [
        column
        for column, meaning in enumerate(table.meanings)
        if meaning is not None and meaning.kind == "position" and meaning.quantity.state != "deflection"
    ]
    if not positions:
        return False
    unit = found.unit or _find_unit(table, positions[0]) or guess_unit(find_size(table, positions))
    numbers = table.table.numbers[:, list(found.columns)]
    known = numbers[np.isfinite(numbers)]
    return bool((known > 0.0).all()) and float(known.max()) * SIZES[unit] < _MOST_UNCERTAIN


def _find_difference(table: NumberTable, found: Displacement) -> tuple[list[int], list[int]] | None:
    """Return the columns of two positions whose difference a displacement is; None without such positions.

    Numbers alone show them, as headers of the positions may have no known meaning, and their axes may have
    another order.
    """
    positions = np.array(
        [column for column in range(len(table.headers)) if _may_compare(table, found, column)]
    )
    numbers = table.table.numbers
    shifts = numbers[:, list(found.columns)]
    known = np.flatnonzero(np.isfinite(shifts).all(axis=1))
    compared = known[:: 1 + len(known) // _COMPARED_ROWS]
    if len(positions) < 2 * len(found.columns):
        return None
    for factor in FACTORS:
        nearest = [
            _find_nearest_pair(numbers[np.ix_(compared, positions)], factor * axis)
            for axis in shifts[compared].T
        ]
        pairs = positions[nearest]  # (3, 2)
        first, second = pairs.T
        if len(np.unique(pairs)) == pairs.size and are_differences(
            numbers[:, first], numbers[:, second], shifts
        ):
            in_order = np.sort(pairs, axis=1)
            return in_order[:, 0].tolist(), in_order[:, 1].tolist()
    return None


def _may_compare(table: NumberTable, found: Displacement, column: int) -> bool:
    """Return whether a column may be one of the positions whose difference a displacement is."""
    if column in table.ignored or column in found.columns:
        return False
    meaning = table.meanings[column]
    if meaning is None:
        return True
    is_position = meaning.kind == "position" and meaning.quantity.state != "deflection"
    return is_position and found.target in (None, meaning.quantity.target)


def _find_nearest_pair(numbers: FloatArray, shifts: FloatArray) -> tuple[int, int]:
    """Return the two columns of numbers (N, m) whose difference is nearest to displacements (N,) of an axis.

    The columns have numbers together in half of the rows.
    """
    is_known = np.isfinite(numbers).astype(float)
    greatest = np.zeros((numbers.shape[1], numbers.shape[1]))
    for row, shift in zip(numbers, shifts, strict=True):
        greatest = np.fmax(greatest, np.abs(row - row[:, np.newaxis] - shift))
    greatest[2.0 * is_known.T @ is_known < len(numbers)] = np.inf
    np.fill_diagonal(greatest, np.inf)
    first, second = np.unravel_index(greatest.argmin(), greatest.shape)
    return int(first), int(second)


def _add_found(
    table: NumberTable, found: Displacement, base_table: NumberTable, base: tuple[int, int, int]
) -> tuple[NumberTable, str]:
    """Return a table with positions under load in place of a displacement, and a note.

    Args:
        table: table of the displacement.
        found: columns of the displacement.
        base_table: table of the positions before the load.
        base: columns of these positions.

    Raises:
        ImportFileError: a displacement without a unit may be in two units.
    """
    unit = _find_unit(base_table, base[0])
    base_metres = METRES[guess_unit(find_size(base_table, base))] if unit is None else SIZES[unit]
    metres = SIZES[found.unit] if found.unit else _choose_size(table, found, (base_metres, SIZES[MICROMETRE]))
    positions = base_table.table.numbers[:, list(base)]
    displacements = table.table.numbers[:, list(found.columns)]
    sums = positions + metres / base_metres * displacements
    meanings = list(table.meanings)
    for axis, column in enumerate(found.columns):
        meanings[column] = Meaning(Quantity("position", found.target, "loaded"), axis, unit)
    numbers = {column: sums[:, axis] for axis, column in enumerate(found.columns)}
    added = replace(table.replace_numbers(numbers), meanings=tuple(meanings))
    if base_table.table.measured.issuperset(base):
        measured = table.table.measured.union(found.columns)
        added = replace(added, table=replace(added.table, measured=measured))
    headers = ", ".join(table.headers[column] for column in found.columns)
    stated = "" if found.unit else f" in {_name_size(metres)}"
    return added, f"{headers}{stated} added to the positions without load"


def _name_base(table: NumberTable, base: tuple[int, int, int], target: str | None) -> NumberTable:
    """Return a table in which the columns of a position are named as those without load."""
    meanings = list(table.meanings)
    for axis, column in enumerate(base):
        quantity = Quantity("position", target, "unloaded")
        meanings[column] = Meaning(quantity, axis, _find_unit(table, column))
    return replace(table, meanings=tuple(meanings))


def split_micrometres(header: str) -> str | None:
    """Return the name in a header that states micrometres, such as `dX [µm]`; None for other headers."""
    found = _IN_MICROMETRES.fullmatch(header)
    return None if found is None else found[1]


def _list_displacements(table: NumberTable, words: Vocabulary) -> list[Displacement]:
    """Return the columns that headers name as displacements along x, y and z."""
    columns_of: dict[str | None, dict[int, int]] = {}
    units_of: dict[str | None, set[str]] = {}
    for column, header in enumerate(table.headers):
        name = split_micrometres(header)
        meaning = table.meanings[column] if name is None else words.find(name)
        if column in table.ignored or meaning is None or meaning.axis is None:
            continue
        if meaning.kind == "position" and meaning.quantity.state == "deflection":
            target = meaning.quantity.target
            unit = meaning.unit if name is None else MICROMETRE
            columns_of.setdefault(target, {})[meaning.axis] = column
            units_of.setdefault(target, set()).update([] if unit is None else [unit])
    return [
        Displacement(target, (columns[0], columns[1], columns[2]), next(iter(units_of[target]), None))
        for target, columns in columns_of.items()
        if len(columns) == 3 and len(units_of[target]) <= 1
    ]


@dataclass(frozen=True, eq=False)
class Deflection:
    """Displacement of a target under load in all postures, without a position."""

    target: str
    shifts: FloatArray  # (N, 3) in axes of R0 [mm]


def list_displacement_columns(table: NumberTable, words: Vocabulary) -> list[int]:
    """Return the columns of a table that headers name as displacements along x, y and z."""
    return [column for found in _list_displacements(table, words) for column in found.columns]


def list_lone_displacements(tables: Sequence[NumberTable], words: Vocabulary) -> list[Deflection]:
    """Return the displacements of tables without positions; rows of a posture in turn are targets.

    Rows of several states have no displacements.

    Raises:
        ImportFileError: displacements without a unit may be in two units.
    """
    return [each for table in tables for each in _list_deflections(table, words)]


def _list_deflections(table: NumberTable, words: Vocabulary) -> Iterator[Deflection]:
    """Yield the displacements of a table; arguments and errors as of `list_lone_displacements`."""
    has_states = any(name.state is not None for name in table.turn)
    displacements = [] if has_states else _list_displacements(table, words)
    for number, found in enumerate(displacements, 1):
        sizes = (SIZES["m"], SIZES["mm"], SIZES[MICROMETRE])
        metres = SIZES[found.unit] if found.unit else _choose_size(table, found, sizes)
        shifts = 1e3 * metres * table.table.numbers[:, list(found.columns)]
        names = [name.target or f"T{row}" for row, name in enumerate(table.turn, 1)]
        if not names:
            names = ["T1" if len(displacements) == 1 else f"T{number}"]
        for row, name in enumerate(names):
            yield Deflection(found.target or name, shifts[row :: len(names)])


def _find_base(table: NumberTable, target: str | None) -> tuple[int, int, int] | None:
    """Return the columns of the position before the load of a target; None if not exactly one is named.

    None also if the target has a position under load.
    """
    columns_of: dict[str | None, dict[int, int]] = {}
    for column, meaning in enumerate(table.meanings):
        if meaning is None or meaning.kind != "position" or meaning.axis is None:
            continue
        if meaning.quantity.target == target and meaning.quantity.state != "deflection":
            columns_of.setdefault(meaning.quantity.state, {})[meaning.axis] = column
    if "loaded" in columns_of or len(columns_of) != 1:
        return None
    (columns,) = columns_of.values()
    return (columns[0], columns[1], columns[2]) if len(columns) == 3 else None


def _choose_size(table: NumberTable, found: Displacement, sizes: Sequence[float]) -> float:
    """Return the size [m] of the unit of a displacement without a unit, of several `sizes` [m].

    Raises:
        ImportFileError: several units are plausible, or none is.
    """
    numbers = table.table.numbers[:, list(found.columns)]
    typical = float(np.nanmedian(np.linalg.norm(numbers, axis=1)))
    plausible = [metres for metres in sizes if _LEAST <= typical * metres <= _MOST]
    if len(plausible) == 1:
        return plausible[0]
    header = table.headers[found.columns[0]]
    raise ImportFileError(
        Place(table.grid.file, None, found.columns[0] + 1),
        f"the displacements are {typical:.3g} by their median, so that their unit is not clear",
        f"write the unit in the headers, such as `{split_unit(header)[0]} [µm]`",
    )


def _find_unit(table: NumberTable, column: int) -> str | None:
    """Return the unit that the header of a column states; None without one."""
    meaning = table.meanings[column]
    return None if meaning is None else meaning.unit


def _name_size(metres: float) -> str:
    """Return the name of the unit of a size [m]."""
    return next(unit for unit, size in SIZES.items() if size == metres)
