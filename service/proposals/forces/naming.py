"""Forces of the files of a proposal: their columns, directions and axes, as names and deflections show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.grammar import find_force_at_end
from jointstiff.service.proposals.columns.left import list_columns_left
from jointstiff.service.proposals.forces.evidence import ForceEvidence
from jointstiff.service.proposals.forces.gathered import GatheredLoads, gather_loads, join_forces
from jointstiff.service.proposals.forces.likely import (
    find_bare_vector,
    find_constant_force,
    find_sizes_along_vectors,
)
from jointstiff.service.proposals.forces.sizes import StatedForce, compare_stated_force, take_sizes_as_weights
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.no_proposal import NoProposalError, UnfinishedError
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.states import order_states
from jointstiff.solver.meaning.words import describe

_AXES: Final = 3
_LEAST_ALONG: Final = 0.75
"""Least fraction of the postures in which targets move along a force whose columns have no headers."""
_MOST_ASIDE: Final = np.radians(30.0)
"""Largest angle of the move of a target to −z of R0 [rad], if a force without an axis is a weight."""
_LEAST_DOWN: Final = 0.9
"""Least fraction of the positions that move within `_MOST_ASIDE`, if a force without an axis is a weight."""
_MEDIAN_ASIDE: Final = np.radians(10.0)
"""Largest median of the angles of all moves to −z of R0 [rad], if a force without an axis is a weight."""


def order_by_forces(proposal: Proposal, tables: Sequence[NumberTable], request: ImportRequest) -> Proposal:
    """Return the proposal with the state first that has no load, if columns of forces show which one.

    Raises:
        NoProposalError: a posture has two different loads.
    """
    tables = take_loads(proposal, tables, request).tables
    joints = next(table for table in tables if table.name == proposal.joints.table)
    stated = read_forces(joints)
    if stated is None:
        return proposal
    groups = proposal.joints.groups
    forces = groups.split(stated)[:, 0]
    return order_states(proposal, [table.table for table in tables], np.nan_to_num(forces))


def take_loads(proposal: Proposal, tables: Sequence[NumberTable], request: ImportRequest) -> GatheredLoads:
    """Return the tables with the loads of other tables in the table of joints, and notes on them.

    Raises:
        NoProposalError: a posture has two different loads.
    """
    try:
        return gather_loads(proposal, tables, request)
    except ImportFileError as fault:
        raise UnfinishedError(f"{fault.place}: {fault.reason}", fault.remedy, fault) from fault


def name_forces(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables with the forces whose columns, directions or axes the deflections show; and notes.

    Raises:
        NoProposalError: there are several forces, whose direction the targets do not show.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    evidence = ForceEvidence(proposal, named, joints, request)
    if len(joints.find_force_columns()) == _AXES:
        return _turn_forces(proposal, tables, evidence)
    found, notes = _name_constant_force(proposal, tables, request)
    if not notes:
        found, notes = _name_bare_forces(proposal, tables, request, evidence)
    if not notes:
        found, notes = _name_forces_along_vectors(proposal, named, tables, request, evidence)
    if notes:
        found, further = _turn_forces(proposal, found, evidence)
        return found, [*notes, *further]
    left = list_columns_left(proposal, tables, named)
    if any(find_sizes_along_vectors(each) for each in left):
        return tables, []  # a force along other directions than −z
    found, notes = _name_force_of_size(proposal, named, tables, request)
    if notes or request.force is not None:
        return found, notes
    return take_sizes_as_weights(left, proposal, named, tables, evidence)


def _turn_forces(
    proposal: Proposal, tables: Sequence[NumberTable], evidence: ForceEvidence
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables with forces and moments turned into R0, if they are likely in the positions' axes.

    A note says which axes were taken, wherever the deflections do not show those of R0.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    columns = list(joints.find_columns_of("force").values())
    source = next((table for table in tables if _has_copied_force(table)), joints)
    axes = evidence.judge_axes(joints.table.numbers[:, columns], source.name)
    if axes is None:
        return tables, []
    angle = f"{math.degrees(proposal.frame.turn):.1f}°"
    if not axes.are_of_positions:
        differ = f"from which the instrument's axes differ by {angle}"
        return tables, [f"the forces of the file were read in axes of R0, {differ}, {axes.reason}"]
    turned = joints.turn_vectors(("force", "moment"), proposal.frame.rotation)
    note = f"the forces of the file were turned by {angle} from the instrument's axes into R0, {axes.reason}"
    return [turned if table is joints else table for table in tables], [note]


def _has_copied_force(table: NumberTable) -> bool:
    """Return whether the table of joints has the force of a table."""
    return not table.copied.isdisjoint(table.find_columns_of("force").values())


def _name_bare_forces(
    proposal: Proposal, tables: Sequence[NumberTable], request: ImportRequest, evidence: ForceEvidence
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables, with three columns without headers as the force if they explain the deflections.

    Raises:
        NoProposalError: the request states another force.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    left = next(each for each in list_columns_left(proposal, tables) if each.table is joints)
    columns = find_bare_vector(left)
    if columns is None:
        return tables, []
    numbers = joints.table.numbers[:, list(columns)]
    listed = f"columns {columns[0] + 1}–{columns[2] + 1}"
    if evidence.are_forces(numbers):
        if request.force is not None:
            reason = f"`force` is stated, but {listed} are the force of each row"
            raise NoProposalError(reason, "omit `force`")
    elif request.force is not None and evidence.may_be_forces(numbers):
        reason = f"`force` is stated, but {listed} without headers may be the force of each row"
        raise NoProposalError(reason, "say what these columns are by `header`, which names all columns")
    else:
        return tables, []
    named = joints.name_forces(columns)
    note = f"{listed} as the force, as the deflections show"
    return [named if table is joints else table for table in tables], [note]


def _name_forces_along_vectors(
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    request: ImportRequest,
    evidence: ForceEvidence,
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables, with sizes along or against unit vectors as the force that explains the deflections.

    Raises:
        NoProposalError: a posture has two different forces.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    has_load = joints.has_column_of("force") or joints.has_column_of("mass")
    if has_load or request.force is not None:
        return tables, []
    for each in list_columns_left(proposal, tables, named):
        along = find_sizes_along_vectors(each)
        if along is None:
            continue
        forces = _join_forces(proposal, each.table, joints, request, along.forces)
        senses = {} if forces is None else {"along": forces, "against": -forces}
        for sense, own in senses.items():
            if evidence.are_forces(own):
                columns = (along.size, *along.vector)
                header = _name_column(each.table, joints, along.size)
                listed = f"columns {along.vector[0] + 1}–{along.vector[2] + 1}"
                note = f"{header} {sense} the unit vectors of {listed}, as the deflections show"
                return _replace_by_forces(tables, joints, each.table, own, columns), [note]
    return tables, []


def _join_forces(
    proposal: Proposal, table: NumberTable, joints: NumberTable, request: ImportRequest, forces: FloatArray
) -> FloatArray | None:
    """Return the forces (N, 3) of the rows of joints from those (rows, 3) of a table; None without a join.

    Raises:
        NoProposalError: a posture has two different forces.
    """
    try:
        return join_forces(proposal, table, joints, request, forces)
    except ImportFileError as fault:
        raise UnfinishedError(f"{fault.place}: {fault.reason}", fault.remedy, fault) from fault


def _replace_by_forces(
    tables: Sequence[NumberTable],
    joints: NumberTable,
    source: NumberTable,
    forces: FloatArray,
    columns: tuple[int, ...],
) -> Sequence[NumberTable]:
    """Return the tables with forces (N, 3) in the table of joints, in place of columns of a table.

    The first of the columns has the sizes of the forces, and their unit.
    """
    unit = find_force_at_end(source.headers[columns[0]])
    if source.name == joints.name:
        along = joints.add_forces(forces, unit, columns)
        return [along if table is joints else table for table in tables]
    along = joints.add_forces(forces, unit).mark_copies(joints)
    read = replace(source, copied=source.copied.union(columns))
    replaced = {joints.name: along, source.name: read}
    return [replaced.get(table.name, table) for table in tables]


def _name_column(table: NumberTable, joints: NumberTable, column: int) -> str:
    """Return the quoted header of a column, with its table if this has no joints."""
    header = quote(table.headers[column])
    return header if table.name == joints.name else f"{header} of {table.name}"


def _name_constant_force(
    proposal: Proposal, tables: Sequence[NumberTable], request: ImportRequest
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables, with the columns of a force of constant size if nothing else states a force.

    The columns have no headers, so that the targets have to move along the force.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    has_load = joints.has_column_of("force") or joints.has_column_of("mass")
    left = next(each for each in list_columns_left(proposal, tables) if each.table is joints)
    columns = None if has_load or request.force is not None else find_constant_force(left)
    if columns is None:
        return tables, []
    forces = proposal.joints.groups.split(joints.table.numbers[:, list(columns)])[:, 0]
    solver_tables = [table.table for table in tables]
    is_posture = np.eye(len(forces))[..., None]
    along = [order_states(proposal, solver_tables, forces * own) is proposal for own in is_posture]
    if np.mean(along) < _LEAST_ALONG:
        return tables, []
    named = joints.name_forces(columns)
    note = f"columns {columns[0] + 1}–{columns[2] + 1} as the force: its size is constant"
    return [named if table is joints else table for table in tables], [note]


def take_stated_force(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> StatedForce:
    """Return tables and request after a stated force was compared with a column of sizes.

    Raises:
        NoProposalError: the sizes are not those of the stated force.
    """
    left = list_columns_left(proposal, tables, named)
    try:
        return compare_stated_force(left, proposal, named, tables, request)
    except ImportFileError as fault:
        raise NoProposalError(fault.reason, fault.remedy) from fault


def _name_force_of_size(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables, with the sizes of a force along −z of R0 if the targets move that way under load.

    The header names no axis. A column of directions, such as `+X`, states the axis of each row.

    Raises:
        NoProposalError: there are several forces, whose direction the targets do not show.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    if request.force is not None:
        return tables, []
    found, notes = _name_force_along_directions(proposal, named, tables, request)
    column = joints.find_size_of_force()
    if notes or column is None:
        return found, notes
    header = quote(joints.headers[column])
    sizes = joints.table.numbers[:, column]
    has_one_sign = bool((sizes >= 0.0).all() or (sizes <= 0.0).all())
    if has_one_sign and _move_down(named):
        along_z = joints.name_size_along_z(column)
        note = f"{header} as the size of a force along −z of R0, as the targets move"
        return [along_z if table is joints else table for table in tables], [note]
    if len({each.force for each in named if each.state == "loaded"}) > 1:
        described = describe(proposal, [each.words for each in named])
        raise NoProposalError(
            f"{described}, but {header} has several forces without a direction",
            "write the force in columns `Fx [N]`, `Fy [N]` and `Fz [N]` in axes of R0",
        )
    return tables, []


def _name_force_along_directions(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables with the force of columns of directions and sizes in one table, and a note on it.

    Raises:
        NoProposalError: the targets do not move along the directions in R0, a size is negative, or a posture
            has two different forces.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    has_load = joints.has_column_of("force") or joints.has_column_of("mass")
    others = [] if has_load else [table for table in tables if table is not joints]
    for table in (joints, *others):
        directions, size = table.find_directions(), table.find_size_of_force()
        size = table.find_size_along_directions() if size is None else size
        if directions is None or size is None:
            continue
        own = table.read_forces_along(directions, size)
        forces = _join_forces(proposal, table, joints, request, own)
        if forces is None:
            continue
        header = _name_column(table, joints, directions)
        if (table.table.numbers[:, size] < 0.0).any() or not _move_along(proposal, named, forces):
            described = describe(proposal, [each.words for each in named])
            raise NoProposalError(
                f"{described}, but the targets do not move along {header} in R0",
                "write the force in columns `Fx [N]`, `Fy [N]` and `Fz [N]` in axes of R0",
            )
        note = f"{quote(table.headers[size])} along the directions of {header} in R0, as the targets move"
        return _replace_by_forces(tables, joints, table, forces, columns=(size, directions)), [note]
    return tables, []


def _move_along(proposal: Proposal, named: Sequence[NamedReading], forces: FloatArray) -> bool:
    """Return whether most targets move along the forces (rows, 3) of the rows of joints under load."""
    of_postures = proposal.joints.groups.split(forces).sum(axis=1)
    unloaded = {each.target: each.reading.positions for each in named if each.state == "unloaded"}
    along = [
        np.einsum("ni,ni->n", of_postures, each.reading.positions - unloaded[each.target]) > 0.0
        for each in named
        if each.state == "loaded" and each.target in unloaded
    ]
    return bool(along) and bool(np.mean(along) >= _LEAST_ALONG)


def _move_down(named: Sequence[NamedReading]) -> bool:
    """Return whether targets move along −z of R0 under load, in most positions hardly along x and y."""
    unloaded = {each.target: each.reading.positions for each in named if each.state == "unloaded"}
    shifts = [
        each.reading.positions - unloaded[each.target]
        for each in named
        if each.state == "loaded" and each.target in unloaded
    ]
    if not shifts:
        return False
    moved = np.array(shifts).reshape(-1, 3)
    x, y, z = moved[np.isfinite(moved).all(axis=1)].T
    if len(z) == 0:
        return False
    angles = np.arctan2(np.hypot(x, y), -z)
    is_most_down = np.mean(angles <= _MOST_ASIDE) >= _LEAST_DOWN
    return bool(is_most_down and np.median(angles) <= _MEDIAN_ASIDE)


def read_forces(table: NumberTable) -> FloatArray | None:
    """Return the forces (N, 3) of a table by its headers; a force along one axis only has no other part.

    None unless headers name one axis, or all three.
    """
    column_of_axis = table.find_force_columns()
    if len(column_of_axis) != len("xyz") and not table.force_is_along_one_axis:
        return None
    forces = np.zeros((len(table.rows), 3))
    for axis, column in column_of_axis.items():
        forces[:, axis] = table.table.numbers[:, column]
    return forces


def note_force(table: NumberTable) -> list[str]:
    """Return the note that forces along two axes are 0, if headers name the force along one axis only."""
    if not table.force_is_along_one_axis:
        return []
    (named,) = table.find_force_columns()
    first, second = ("xyz"[axis] for axis in range(3) if axis != named)
    return [f"only the force along {'xyz'[named]} has a column: along {first} and {second} it is 0"]
