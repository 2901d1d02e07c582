"""Columns that a proposal does not read and that are likely forces: by words, sizes and directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    find_force_at_end,
    find_unit_of_force,
    find_unit_of_weight,
    is_hung,
    looks_like_a_force,
    split_unit,
)
from jointstiff.service.importing.grid import COORDINATES
from jointstiff.service.proposals.columns.left import ColumnsLeft
from jointstiff.service.proposals.forces.vectors import complete_vectors
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.table import find_moving_columns

_UNIT_VECTOR: Final = 0.01
"""Largest difference of the size of a unit vector from 1."""
_SAME_SIZE: Final = 0.01
"""Largest difference of the sizes of forces, as a part of their mean."""
_ONE_SIZE: Final = 0.05
"""Largest difference of the readings of one force by a load cell, as a part of their median."""
_LEAST_FORCE: Final = 2.0
"""Least size of a force; a direction has the size 1."""
_LEAST_PART_OF_LOAD: Final = 0.3
"""Least size of a force under load, as a part of the greatest."""
_LARGER: Final = 3.0
"""Ratio of the sizes under load and without load up to which a column is noise."""
_DIFFERENT: Final = 0.5
"""Difference of the rows of a posture, as a part of the sizes without load, from which a column is noise."""


def may_be_force(table: NumberTable, column: int) -> bool:
    """Return whether a column without a known meaning has a word for a force, and numbers other than flags.

    Numbers that are noise in all states are no force.
    """
    is_named = table.meanings[column] is None and looks_like_a_force(table.headers[column])
    return is_named and not table.has_flags(column) and not _shows_no_load(table, column)


def _shows_no_load(table: NumberTable, column: int) -> bool:
    """Return whether a column has as large numbers in rows without load as under load, but not the same ones.

    Such numbers are noise. Rows without names of states show nothing.
    """
    states = [name.state for name in table.turn]
    if not {"unloaded", "loaded"} <= set(states):
        return False
    of_rows = table.table.numbers[:, column].reshape(-1, len(states))
    loaded, unloaded = (of_rows[:, states.index(state)] for state in ("loaded", "unloaded"))
    without_load, under_load = (float(np.sqrt(np.nanmean(each**2))) for each in (unloaded, loaded))
    difference = float(np.sqrt(np.nanmean((loaded - unloaded) ** 2)))
    return under_load <= _LARGER * without_load and difference >= _DIFFERENT * without_load


def find_bare_vector(left: ColumnsLeft) -> tuple[int, int, int] | None:
    """Return the three columns that are left, without headers and adjacent, if they are a vector; else None.

    A direction has the size 1, and is no force. Rows without load may have no numbers.
    """
    table = left.table
    if len(left.columns) != COORDINATES or any(table.headers[column] for column in left.columns):
        return None
    first, second, third = left.columns
    numbers = _list_filled(table, left.columns)
    sizes = np.linalg.norm(numbers, axis=1)
    is_force = len(sizes) > 0 and bool(np.isfinite(sizes).all()) and sizes.mean() > _LEAST_FORCE
    is_vector = third - first == COORDINATES - 1 and any(find_moving_columns(numbers))
    return (first, second, third) if is_force and is_vector else None


class SizesAlongVectors(NamedTuple):
    """Columns of a table with the sizes of forces and the unit vectors of their directions."""

    table: NumberTable
    size: int
    vector: tuple[int, int, int]

    @property
    def forces(self) -> FloatArray:
        """Forces (rows, 3) in the unit of the sizes; zero in rows without numbers."""
        numbers = np.nan_to_num(self.table.table.numbers)
        vectors = numbers[:, list(self.vector)]
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return numbers[:, [self.size]] * vectors / np.where(lengths > 0.0, lengths, 1.0)

    @property
    def have_one_direction(self) -> bool:
        """Return whether the unit vectors of all forces are the same."""
        forces = self.forces[self.forces.any(axis=1)]
        directions = forces / np.linalg.norm(forces, axis=1, keepdims=True)
        return bool(np.ptp(directions, axis=0).max(initial=0.0) <= _UNIT_VECTOR)

    @property
    def words(self) -> str:
        """Headers of the unit vectors, or the numbers of their columns."""
        return ", ".join(self.table.name_column(column) for column in self.vector)


def find_sizes_along_vectors(left: ColumnsLeft) -> SizesAlongVectors | None:
    """Return the only column of sizes of a force with the only three columns of a unit vector; else None.

    The header of the sizes has a word for a force. Three adjacent columns have the size 1 in all rows that
    have a force.
    """
    table = left.table
    sizes = [column for column in left.columns if may_be_force(table, column)]
    if len(sizes) != 1:
        return None
    numbers = np.nan_to_num(table.table.numbers)
    is_force = numbers[:, sizes[0]] > 0.0
    others = set(left.columns).difference(sizes)
    found = [
        SizesAlongVectors(table, sizes[0], (first, first + 1, first + 2))
        for first in sorted(others)
        if {first + 1, first + 2} <= others and _are_units(numbers[is_force, first : first + COORDINATES])
    ]
    has_force = bool((numbers[:, sizes[0]] >= 0.0).all() and is_force.any())
    return found[0] if len(found) == 1 and has_force else None


def _are_units(vectors: FloatArray) -> bool:
    """Return whether vectors (rows, 3) have the size 1."""
    return bool(np.abs(np.linalg.norm(vectors, axis=1) - 1.0).max(initial=0.0) <= _UNIT_VECTOR)


def find_constant_force(left: ColumnsLeft) -> tuple[int, int, int] | None:
    """Return three columns without headers whose numbers are a force of constant size; None without them."""
    columns = find_bare_vector(left)
    if columns is None:
        return None
    sizes = np.linalg.norm(_list_filled(left.table, columns), axis=1)
    return columns if np.ptp(sizes) <= _SAME_SIZE * sizes.mean() else None


def _list_filled(table: NumberTable, columns: Sequence[int]) -> FloatArray:
    """Return the numbers (N, m) of some columns in the rows that have any."""
    numbers = table.table.numbers[:, list(columns)]
    return numbers[np.isfinite(numbers).any(axis=1)]


def refuse_force_beside_columns(
    left: Sequence[ColumnsLeft], request: ImportRequest, joints: NumberTable
) -> None:
    """Refuse one stated force if columns that are not read are forces by their words.

    The size of a force in the table of joints has been compared with the stated force.

    Raises:
        ImportFileError: the request states a force, and there are such columns.
    """
    for each in left if request.force is not None else ():
        table = each.table
        columns = [column for column in each.columns if may_be_force(table, column)]
        if table is joints:
            columns = [column for column in columns if column != table.find_size_of_force()]
        else:
            columns += sorted(set(table.find_force_columns().values()) - table.copied)
        if columns:
            columns, pattern = complete_vectors(each, columns)
            listed = ", ".join(table.name_column(column) for column in columns)
            reason = f"`force` is stated, but columns that are not read look like forces: {listed}"
            remedy = f"say what these columns are by `columns`, or leave them out with `ignore`: {pattern}"
            raise ImportFileError(Place(table.grid.file), reason, remedy, "force")


def describe_likely_force(left: Sequence[ColumnsLeft]) -> str:
    """Return the end of a sentence on columns that may be the load, with what to state; empty without any.

    A column in a unit of mass, or of a load without a unit, with one number is a likely mass; flags without a
    unit of mass are none. The last three numbers without a header are a likely force.
    """
    sentences = [
        _describe_weight(header, mass)
        for each in left
        for column in each.columns
        if (mass := _find_mass(each.table, column)) is not None and (header := each.table.headers[column])
    ]
    for each in left:
        along = find_sizes_along_vectors(each)
        if along is not None and not along.have_one_direction:
            sentences.append(_describe_vectors(along))
            continue
        for column in each.columns:
            unit = find_unit_of_force(each.table.headers[column])
            sizes = _list_sizes(each.table, column)
            if unit is not None and sizes.size:
                sentences.append(_describe_sizes(each.table.headers[column], sizes, unit))
    for each in left:
        if len(each.columns) == COORDINATES and not any(each.table.headers[c] for c in each.columns):
            first, _, third = each.columns
            sentences.append(
                f"columns {first + 1}–{third + 1} of {quote(each.table.name)} are not read and may be "
                "the force: if so, name all columns by `header`, these as `Fx[N]`, `Fy[N]` and `Fz[N]`"
            )
    return "".join(f"; {sentence}" for sentence in sentences)


def _describe_weight(header: str, mass: float) -> str:
    """Return what to state if a mass hangs, in the unit of its header; in kg and lb without a unit."""
    unit = find_unit_of_weight(header)
    if unit is not None:
        size = f"{mass:g} {unit.removesuffix('f')}"
        return f"{quote(header)} has {size}: if this load hangs, `force` is 0,0,-{mass:g}{unit}"
    forces = f"0,0,-{mass:g}kgf for kg, or 0,0,-{mass:g}lbf for lb"
    return f"{quote(header)} has {mass:g} without a unit: if this load hangs, `force` is {forces}"


def _find_mass(table: NumberTable, column: int) -> float | None:
    """Return the one mass of a column, apart from rows with 0; else None.

    The column has a unit of mass, or a word for a load that hangs and no unit; then 1 may be a state.
    """
    header, numbers = table.headers[column], table.table.numbers[:, column]
    masses = set(numbers[np.isfinite(numbers) & (numbers != 0.0)].tolist())
    is_bare = is_hung(header) and split_unit(header)[1] is None and not table.has_flags(column)
    may_be_mass = find_unit_of_weight(header) is not None or is_bare
    return masses.pop() if may_be_mass and len(masses) == 1 and min(masses) > 0.0 else None


def _describe_sizes(header: str, sizes: FloatArray, unit: str) -> str:
    """Return what to state of the sizes (N,) of a force under load: one force, or that of each posture."""
    size = float(np.median(sizes))
    if np.ptp(sizes) <= _ONE_SIZE * size:
        found = f"{quote(header)} has {size:.4g} {unit} under load"
        return f"{found}: if this force pulls down, `force` is 0,0,-{size:.4g}{unit}"
    return (
        f"{quote(header)} has {sizes.min():.4g} to {sizes.max():.4g} {unit} under load, which differ by "
        f"posture: {_write_columns(unit)}"
    )


def _describe_vectors(along: SizesAlongVectors) -> str:
    """Return what to state of sizes along unit vectors that do not explain the deflections."""
    header = along.table.headers[along.size]
    found = f"{quote(header)} along {along.words} does not explain the deflections"
    return f"{found}: {_write_columns(find_force_at_end(header) or 'N')}"


def _write_columns(unit: str) -> str:
    """Return the request for columns of the force of each posture."""
    return f"write the force of each posture in columns `Fx [{unit}]`, `Fy [{unit}]` and `Fz [{unit}]`"


def _list_sizes(table: NumberTable, column: int) -> FloatArray:
    """Return the sizes (N,) of a force under load; none if rows have both signs, flags, or no force."""
    numbers = table.table.numbers[:, column]
    known = numbers[np.isfinite(numbers)]
    greatest = np.abs(known).max(initial=0.0)
    under_load = known[np.abs(known) >= max(_LEAST_PART_OF_LOAD * greatest, np.finfo(float).tiny)]
    has_one_sign = bool((under_load > 0.0).all() or (under_load < 0.0).all())
    is_force = has_one_sign and not table.has_flags(column) and not _shows_no_load(table, column)
    return np.abs(under_load) if is_force else np.array([])
