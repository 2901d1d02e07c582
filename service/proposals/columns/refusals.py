"""Refusals of proposals that leave out files, columns, or the names of rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grid import ARRAYS, COORDINATES
from jointstiff.service.proposals.columns.left import ColumnsLeft, list_unexplained_numbers
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.kinds import LOADS
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import find_moving_columns

_SAME_JOINT: Final = np.radians(0.01)
"""Largest difference of a joint [rad] between two logs of the same postures."""


def refuse_columns_left(
    left: Sequence[ColumnsLeft],
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
) -> None:
    """Refuse a proposal that leaves out a file, or columns that may be the positions under load.

    Raises:
        ImportFileError: nothing of a file is read; or all positions are in one state, and three columns of
            numbers are left.
    """
    joints = find_table(tables, proposal.joints.table)
    postures = len(joints.rows) // proposal.joints.groups.count
    for each in left:
        is_other = confirms_joints(each.table, proposal, joints) or _is_square_matrix(each.table, postures)
        if each.is_whole and not is_other:
            raise _build_file_error(each.table, joints, postures)
    if len({each.state for each in named}) > 1:
        return
    for each in left:
        columns = list_unexplained_numbers(each)
        if columns:
            listed = ", ".join(each.table.name_column(column) for column in columns)
            state = named[0].state.replace("_", " ")
            reason = f"{listed} of {quote(each.table.name)} are not read, and all positions are {state}"
            remedy = "correct these columns or name them in `header`, or leave them out with `ignore`"
            raise ImportFileError(Place(each.table.grid.file), reason, remedy)


def _is_square_matrix(table: NumberTable, postures: int) -> bool:
    """Return whether the arrays of a file with these rows are square, as a stiffness or a covariance is.

    Rows of postures, columns of positions, and arrays of three rows, which may be points, are no such matrix.
    """
    count, width = table.table.numbers.shape
    has_positions = any(each is not None and each.kind in ("position", "joint") for each in table.meanings)
    is_array = table.grid.preview.format in ARRAYS.values()
    is_square = count > COORDINATES and width % count == 0 and bool(np.isfinite(table.table.numbers).all())
    return is_array and is_square and not has_positions and count % postures > 0


def _build_file_error(table: NumberTable, joints: NumberTable, postures: int) -> ImportFileError:
    """Return the error that nothing of a file is read."""
    place, name = Place(table.grid.file), quote(table.name)
    leave_out = "name the sheets to be read in `sheet`" if table.grid.own_sheet else "leave the file out"
    if len(table.rows) % postures:
        reason = f"{name} is not read: it has {len(table.rows)} rows for {postures} postures"
        remedy = f"give each posture a row in every file, or {leave_out}"
        return ImportFileError(place, reason, remedy)
    if any(meaning is not None and meaning.kind in LOADS for meaning in table.meanings):
        reason = f"{name} is not read: no names of postures join its loads to those of {quote(joints.name)}"
        remedy = (
            "name the rows of both alike in a first column `label`; or, if the rows of all files are in one "
            f"order, state `by_order`; or {leave_out}"
        )
        return ImportFileError(place, reason, remedy, "by_order")
    reason = f"{name} is not read: its numbers are no positions in the postures of {quote(joints.name)}"
    remedy = (
        "put the rows of all files in one order, or name them alike in a first column `label`; or "
        f"{leave_out}"
    )
    return ImportFileError(place, reason, remedy)


def confirms_joints(table: NumberTable, proposal: Proposal, joints: NumberTable) -> bool:
    """Return whether a table has the columns of the table of joints, and the same joints in the same rows.

    Such a table is a log of the joints in another state. Joints are the same within `_SAME_JOINT`; other
    numbers do not change, or only increase, as times do.
    """
    if table is joints or table.headers != joints.headers or len(table.rows) != len(joints.rows):
        return False
    numbers, columns = table.table.numbers, list(proposal.joints.columns)
    limit = _SAME_JOINT if proposal.joints.unit == "rad" else np.degrees(_SAME_JOINT)
    are_same = bool((np.abs(numbers[:, columns] - joints.table.numbers[:, columns]) <= limit).all())
    is_moving = find_moving_columns(numbers)
    others = [column for column in range(numbers.shape[1]) if is_moving[column] and column not in columns]
    return are_same and bool((np.diff(numbers[:, others], axis=0) >= 0.0).all())


def refuse_single_rows(proposal: Proposal, tables: Sequence[NumberTable]) -> None:
    """Refuse a proposal that reads as postures the rows that names make states or targets of one posture.

    Rows of joints alone that differ in their loads are postures with different loads.

    Raises:
        ImportFileError: a table has such rows.
    """
    joints = find_table(tables, proposal.joints.table)
    single = {each.points.table for each in proposal.readings if each.points.groups.count == 1}
    of_states = [
        table for table in tables if table.name in single and len({row.state for row in table.turn}) > 1
    ]
    has_positions = any(each.points.table == joints.name for each in proposal.readings)
    are_loads_of_postures = not has_positions and len({(row.state, row.target) for row in joints.turn}) == 1
    count_of_joints = 0 if are_loads_of_postures else len(joints.turn)
    count = count_of_joints or max((len(table.turn) for table in of_states), default=0)
    if count > 1 and (of_states or proposal.joints.groups.count != count):
        reason = f"the {count} rows of a posture have different joints, so that each was read as a posture"
        remedy = (
            "write the joints of a posture alike in its rows; joints that headers name may differ by "
            "`joint_tolerance`"
        )
        raise ImportFileError(Place(joints.grid.file), reason, remedy)
