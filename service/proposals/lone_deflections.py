"""Displacements under load without positions, whose joints headers name, as no robot can check them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.proposals.columns.left import (
    ColumnsLeft,
    list_other_columns,
    list_unexplained_numbers,
    name_columns_left,
)
from jointstiff.service.proposals.forces.naming import note_force, read_forces
from jointstiff.service.proposals.joined_tables import JoinedTables, describe_fault
from jointstiff.service.proposals.no_proposal import NoProposalError
from jointstiff.service.proposals.options import clear_headers, clear_names
from jointstiff.service.proposals.proposed_import import ProposedImport
from jointstiff.service.proposals.rewriting import write_deflections
from jointstiff.service.proposals.tables.deflections import (
    Deflection,
    list_displacement_columns,
    list_lone_displacements,
)
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.hypotheses import list_countings
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.refinement import FramePlacement
from jointstiff.solver.meaning.table import METRES, AngleUnit, JointColumns
from jointstiff.solver.meaning.words import join
from jointstiff.solver.mechanics.robot import KnownRobot

_LARGEST_TURN: Final = 2.2 * np.pi
"""Largest joint that is measured [rad]: larger numbers are degrees."""
_LEAST_WITHIN: Final = 0.5
"""Least fraction of the postures within the limits of joints that may be in radians."""


def propose_deflections(
    numbers: JoinedTables, request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport | None:
    """Return the proposal for displacements under load without positions; None of other tables.

    No position shows whether the joints are right, so that headers have to name them, and one robot is
    stated.

    Raises:
        NoProposalError: no header names the joints, the unit of the displacements is not clear, or the
            targets move against the force.
    """
    if len(robots) != 1:
        return None
    known = robots[0]
    found = _find_lone_deflections(numbers.tables, request, known)
    if found is None:
        return None
    joints, deflections = found.joints, found.deflections
    _refuse_deflections_against_force(joints, deflections, request)
    unit = _find_unit_of_joints(found, known, request)
    columns = JointColumns(joints.name, joints.table.joints, unit or "deg", list_countings(known.robot)[0])
    frame = FramePlacement(np.eye(3), np.zeros(3), METRES["mm"])
    proposal = Proposal((known,), columns, (), "mm", frame, math.nan, math.inf, fitting=0, count=0)
    targets = join([each.target for each in deflections])
    statement = (
        f"{joints.name} has joints by their names, and there are displacements under load of {targets} "
        "in axes of R0 without positions, which the robot cannot check"
    )
    options = request.model_copy(update={**clear_headers(), **clear_names(), "units": request.units})
    table = write_deflections(joints, unit, deflections)
    unread = name_columns_left(found.left, numbers.tables, request.state_words)
    notes = (*numbers.notes, *note_force(joints), *unread)
    return ProposedImport(proposal, (), table, options, None, notes, statement=statement)


class _LoneDeflections(NamedTuple):
    """Joints that headers name, and displacements under load without positions."""

    joints: NumberTable
    deflections: Sequence[Deflection]
    left: Sequence[ColumnsLeft]  # other columns

    @property
    def row_count(self) -> int:
        """Rows of each posture in the table of joints."""
        return len(self.joints.rows) // len(self.deflections[0].shifts)

    @property
    def angles(self) -> FloatArray:
        """Joints (N, n) of the postures as they are written."""
        return self.joints.table.numbers[:: self.row_count, list(self.joints.table.joints)]


def _find_lone_deflections(
    tables: Sequence[NumberTable], request: ImportRequest, known: KnownRobot
) -> _LoneDeflections | None:
    """Return joints and displacements of tables that have no other numbers; None of other tables.

    Raises:
        NoProposalError: no header names the joints, or the unit of the displacements is not clear.
    """
    words = Vocabulary(request, known.robot.joint_names)
    left = [_list_without_positions(table, words) for table in tables]
    count_left = sum(len(list_unexplained_numbers(each)) for each in left)
    with_joints = [table for table in tables if table.table.joints]
    may_be_joints = not with_joints and count_left == known.robot.n
    if count_left and not may_be_joints:
        return None
    try:
        deflections = list_lone_displacements(tables, words)
    except ImportFileError as fault:
        raise describe_fault(fault) from fault
    if deflections and may_be_joints:
        raise NoProposalError(
            "there are displacements under load without positions, so that the robot cannot find the joints",
            "name the joints in the headers, such as `J1 [deg]`, or all columns by `header`",
        )
    counts = {len(each.shifts) for each in deflections}
    has_each_target_once = len({each.target for each in deflections}) == len(deflections)
    if len(with_joints) != 1 or len(counts) != 1 or not has_each_target_once:
        return None
    found = _LoneDeflections(with_joints[0], deflections, left)
    return found if len(with_joints[0].rows) == found.row_count * counts.pop() else None


def _list_without_positions(table: NumberTable, words: Vocabulary) -> ColumnsLeft:
    """Return the columns of a table that are neither joints nor displacements by their headers."""
    read = {*table.table.joints, *list_displacement_columns(table, words)}
    return list_other_columns(table, read)


def _find_unit_of_joints(
    found: _LoneDeflections, known: KnownRobot, request: ImportRequest
) -> AngleUnit | None:
    """Return the unit of joints that headers or the request state, or that numbers and limits leave.

    None if the joints may be in both units.
    """
    meanings = [found.joints.meanings[column] for column in found.joints.table.joints]
    stated = {meaning.unit for meaning in meanings if meaning is not None}
    if request.units is not None and stated == {None}:
        stated = {request.units.angle}
    if stated != {None}:
        units: dict[str | None, AngleUnit] = {"deg": "deg", "rad": "rad"}
        return units.get(next(iter(stated))) if len(stated) == 1 else None
    if np.abs(found.angles).max() > _LARGEST_TURN:
        return "deg"
    is_within_as_radians = np.mean(known.robot.within_limits(found.angles)) >= _LEAST_WITHIN
    return None if is_within_as_radians else "deg"


def _refuse_deflections_against_force(
    table: NumberTable, deflections: Sequence[Deflection], request: ImportRequest
) -> None:
    """Refuse displacements without positions against the force: no springs move so, whatever their stiffness.

    Raises:
        NoProposalError: the work of the force is negative in most postures.
    """
    count = len(deflections[0].shifts)
    forces = read_forces(table)
    if forces is not None:
        forces = forces[:: len(table.rows) // count]
    elif request.force is not None:
        forces = np.tile(np.array(request.force), (count, 1))
    else:
        return
    work = np.array([np.einsum("ni,ni->n", forces, each.shifts) for each in deflections])
    if float(np.nansum(work)) < 0.0:
        raise NoProposalError(
            "the targets move against the force",
            "write displacements as loaded minus unloaded in axes of R0, or correct the sign of `force`",
        )
