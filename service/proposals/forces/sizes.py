"""Column of the sizes of a force, together with a force that the caller states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import find_unit_of_force, find_unit_of_size
from jointstiff.service.importing.loads import find_newtons
from jointstiff.service.proposals.columns.left import ColumnsLeft
from jointstiff.service.proposals.forces.evidence import ForceEvidence
from jointstiff.service.proposals.forces.likely import find_sizes_along_vectors, may_be_force
from jointstiff.service.proposals.forces.vectors import ForceVector, list_vectors
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal

_SAME_FORCE: Final = 0.02
"""Largest difference of a stated force and the median of the sizes, as a part of the stated force."""
_CONSTANT: Final = 0.002
"""Largest difference of the sizes of one force, as a part of the stated force."""


class StatedForce(NamedTuple):
    """Tables and request after a stated force was compared with a column of sizes."""

    tables: Sequence[NumberTable]
    request: ImportRequest  # without the force, if the tables have the force of each posture
    notes: list[str]


@dataclass(frozen=True)
class _ForceSizes:
    """Column of the sizes of a force in the readings under load."""

    table: NumberTable
    column: int
    newtons: float  # of the unit of the column
    readings: Sequence[NamedReading]  # under load, in the table of the column; () in a table of joints alone

    @property
    def header(self) -> str:
        """Header of the column, quoted."""
        return quote(self.table.headers[self.column])

    @property
    def numbers(self) -> FloatArray:
        """Forces (rows, 1) [N] with the signs of the column."""
        return self.newtons * self.table.table.numbers[:, [self.column]]

    def list_under_load(self, proposal: Proposal) -> dict[str, FloatArray]:
        """Return load in words → forces (N, m) [N] of the readings under this load in each posture.

        An empty cell has the force of another reading of the posture under this load, as in merged cells.
        """
        if not self.readings:
            groups = proposal.joints.groups
            return {"": groups.split(self.numbers)[:, self.table.find_loaded_row(groups)]}
        forces: dict[str, list[FloatArray]] = {}
        for each in self.readings:
            of_rows = each.reading.points.groups.split(self.numbers)[:, each.reading.index]
            forces.setdefault(each.load, []).append(of_rows)
        return {load: _fill_gaps(np.hstack(parts)) for load, parts in forces.items()}


def _fill_gaps(forces: FloatArray) -> FloatArray:
    """Return forces (N, m) whose missing numbers are the first number of their row."""
    first = np.argmax(np.isfinite(forces), axis=1)
    return np.where(np.isfinite(forces), forces, np.take_along_axis(forces, first[:, None], axis=1))


def compare_stated_force(
    left: Sequence[ColumnsLeft],
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    request: ImportRequest,
) -> StatedForce:
    """Compare a stated force with the only column of sizes of a force, if no header names an axis or a mass.

    Sizes that differ are those of the force in each posture, in the stated direction. A constant size
    confirms the stated force, as does a vector that changes by its size under load.

    Raises:
        ImportFileError: the sizes are not those of the stated force, or they have directions of their own.
    """
    unit = None if request.units is None else request.units.force
    if request.force is None or unit is None:
        return StatedForce(tables, request, [])
    stated = find_newtons(unit) * float(np.linalg.norm(request.force))
    vectors = list(list_vectors(left))
    if len(vectors) == 1 and vectors[0].confirms(stated):
        return _confirm_by_vector(vectors[0], stated, tables, request)
    sizes = _find_sizes(left, proposal, named, tables)
    if sizes is None:
        return StatedForce(tables, request, [])
    _refuse_other_directions(left)
    of_loads = list(sizes.list_under_load(proposal).values())
    _refuse_other_sizes(sizes, of_loads, stated)
    forces = np.hstack(of_loads)
    if np.ptp(np.abs(forces)) <= _CONSTANT * stated:
        note = f"{sizes.header} has {np.abs(forces).mean():.4g} N: `force` of {stated:.4g} N was taken"
        others = [_ignore(table, sizes) for table in tables]
        return StatedForce(others, request, [note])
    note = f"{sizes.header} as the size of the force in each posture, in the direction of `force`"
    direction = np.array(request.force) / np.linalg.norm(np.array(request.force))
    with_forces = [_add_forces(table, sizes, proposal, direction, unit) for table in tables]
    return StatedForce(with_forces, request.model_copy(update={"force": None}), [note])


def _confirm_by_vector(
    vector: ForceVector, stated: float, tables: Sequence[NumberTable], request: ImportRequest
) -> StatedForce:
    """Return the tables with a vector of a controller that confirms a stated force [N], and a note."""
    changes = vector.measure_changes()
    median = 0.0 if changes is None else float(np.median(changes))
    change = f"{vector.pattern} changes by {median:.3g} N under load, if it is in N"
    note = f"{change}: `force` of {stated:.4g} N was taken"
    ignored = vector.table.ignored.union(vector.columns)
    confirmed = replace(vector.table, ignored=ignored)
    return StatedForce([confirmed if table is vector.table else table for table in tables], request, [note])


def take_sizes_as_weights(
    left: Sequence[ColumnsLeft],
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    evidence: ForceEvidence,
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables with the sizes of the only column of a force along −z of R0, and a note.

    The header has a word for a force, and the deflections show the direction; otherwise the tables stay.
    """
    sizes = _find_sizes(left, proposal, named, tables)
    unit = None if sizes is None else find_unit_of_size(sizes.table.headers[sizes.column])
    if sizes is None or unit is None:
        return tables, []
    of_loads = sizes.list_under_load(proposal)
    forces = np.hstack(list(of_loads.values()))
    is_force = np.isfinite(forces).all() and ((forces > 0.0).all() or (forces < 0.0).all())
    spreads = [np.ptp(of_load, axis=1).max(initial=0.0) for of_load in of_loads.values()]
    is_one_in_posture = max(spreads) <= _SAME_FORCE * float(np.abs(forces).max())
    if not (is_force and is_one_in_posture and evidence.are_down(of_loads)):
        return tables, []
    down = np.array([0.0, 0.0, -1.0])
    note = f"{sizes.header} as the size of a force along −z of R0, as the deflections show"
    return [_add_forces(table, sizes, proposal, down, unit) for table in tables], [note]


def _find_sizes(
    left: Sequence[ColumnsLeft],
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
) -> _ForceSizes | None:
    """Return the only column that looks like a force, if the column has a unit of force; else None.

    Rows of a table without joints have one load only.
    """
    columns = [(each.table, each_column) for each in left for each_column in each.columns]
    columns = [(table, column) for table, column in columns if may_be_force(table, column)]
    has_other = any(table.has_column_of(kind) for table in tables for kind in ("force", "mass"))
    if len(columns) != 1 or has_other:
        return None
    ((table, column),) = columns
    unit = find_unit_of_force(table.headers[column])
    loaded = [each for each in named if each.state == "loaded"]
    own = [each for each in loaded if each.reading.points.table == table.name]
    has_joints = table.name == proposal.joints.table
    if unit is None or not (has_joints or (own and len({each.load for each in loaded}) == 1)):
        return None
    return _ForceSizes(table, column, find_newtons(unit), own)


def _refuse_other_directions(left: Sequence[ColumnsLeft]) -> None:
    """Refuse one stated force together with unit vectors that give each posture another direction.

    Raises:
        ImportFileError: there are such unit vectors.
    """
    for along in filter(None, map(find_sizes_along_vectors, left)):
        if not along.have_one_direction:
            raise ImportFileError(
                Place(along.table.grid.file),
                f"`force` has one direction, but the unit vectors {along.words} differ by posture",
                f"omit `force`, or leave the unit vectors out with `ignore`: {along.words}",
                "force",
            )


def _refuse_other_sizes(sizes: _ForceSizes, of_loads: Sequence[FloatArray], stated: float) -> None:
    """Refuse a stated force [N] that the forces (N, m) [N] of a column, under each load, contradict.

    Raises:
        ImportFileError: the median of the sizes differs from the stated force, a reading under load has no
            force, the signs differ, or the readings of a posture under one load have several forces.
    """
    forces = np.hstack(of_loads)
    if not np.isfinite(forces).all():
        raise ImportFileError(
            Place(sizes.table.grid.file),
            f"`force` is stated, but {sizes.header} has no force in some postures",
            f"complete the column, or leave the column out by `ignore`: {sizes.header}",
            "force",
        )
    least, most = float(np.abs(forces).min()), float(np.abs(forces).max())
    have_one_sign = bool((forces > 0.0).all() or (forces < 0.0).all())
    spreads = [np.ptp(of_load, axis=1).max(initial=0.0) for of_load in of_loads]
    is_same = abs(float(np.median(np.abs(forces))) - stated) <= _SAME_FORCE * stated
    is_force = have_one_sign and least > _SAME_FORCE * stated and max(spreads) <= _SAME_FORCE * stated
    if is_same and is_force:
        return
    found = f"{most:.4g} N" if most - least <= _CONSTANT * stated else f"{least:.4g} to {most:.4g} N"
    signs = "" if have_one_sign or least == 0.0 else ", of both signs"
    raise ImportFileError(
        Place(sizes.table.grid.file),
        f"`force` is {stated:.4g} N, but {sizes.header} has {found}{signs} under load",
        f"correct `force`, or leave the column out by `ignore`: {sizes.header}",
        "force",
    )


def _ignore(table: NumberTable, sizes: _ForceSizes) -> NumberTable:
    """Return a table whose column of sizes, if the table has this column, needs no further meaning."""
    return replace(table, ignored=table.ignored | {sizes.column}) if table is sizes.table else table


def _add_forces(
    table: NumberTable,
    sizes: _ForceSizes,
    proposal: Proposal,
    direction: FloatArray,
    unit: str,
) -> NumberTable:
    """Return a table that has the force of each row along a unit vector, if the rows are those of joints."""
    if table.name != proposal.joints.table:
        return _ignore(table, sizes)
    groups = proposal.joints.groups
    numbers = sizes.numbers[:, 0]
    of_loads = list(sizes.list_under_load(proposal).values())
    if len(of_loads) == 1:
        of_postures = of_loads[0][:, 0]
        is_in_blocks = groups.order == "in blocks"
        numbers = np.tile(of_postures, groups.count) if is_in_blocks else np.repeat(of_postures, groups.count)
    forces = np.outer(np.abs(np.nan_to_num(numbers)) / find_newtons(unit), direction)
    return _ignore(table, sizes).add_forces(forces, unit)
