"""The sentence of a proposal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jointstiff.solver.meaning.screening import WORST_SCREENED

if TYPE_CHECKING:
    from jointstiff.solver.meaning.proposal import Proposal, TargetReading
    from jointstiff.solver.meaning.table import JointColumns


def describe(proposal: Proposal, names: Sequence[str] = ()) -> str:
    """Return a proposal in one sentence: columns, units, frame, robot, residual and the next reading.

    `names` are the targets and states of the readings; without names, the targets have numbers.
    """
    names = names or [name_reading(proposal, reading) for reading in proposal.readings]
    columns = join(_describe_columns(proposal, names))
    frame = "" if proposal.is_in_base_frame else " in a frame of the instrument"
    robots = " or ".join(known.name for known in proposal.robots)
    next_best = f"more than {format_mm(WORST_SCREENED)}"
    if np.isfinite(proposal.next_residual):
        next_best = format_mm(proposal.next_residual)
    return (
        f"{columns}{frame} fit the {robots} to {format_mm(proposal.residual)} in {proposal.fitting} of "
        f"{proposal.count} positions (next best: {next_best})"
    )


def _describe_columns(proposal: Proposal, names: Sequence[str]) -> list[str]:
    """Return the columns of the joints and of each reading in words, such as `columns 7–9 as T1 loaded [mm]`.

    If the columns are in several tables, the first of successive columns of a table names their table.
    `names` are those of the readings.
    """
    table = proposal.joints.table
    with_table = any(reading.points.table != table for reading in proposal.readings)
    parts = [_describe_joints(proposal.joints, with_table=with_table)]
    for reading, name in zip(proposal.readings, names, strict=True):
        columns = name_columns(reading, with_table=reading.points.table != table)
        parts.append(f"{columns} as {name} [{proposal.unit}]")
        table = reading.points.table
    return parts


def remark(proposal: Proposal) -> str:
    """Return what a person should know about the fit; empty if it is usual."""
    if proposal.is_usual:
        return ""
    return "arms usually fit to 1 mm to 2 mm: another arm of the same class may have been measured"


def name_reading(proposal: Proposal, reading: TargetReading) -> str:
    """Return target and state of a reading, such as `T1 loaded`; a target in one state has no state."""
    target = f"T{reading.target}"
    readings_of_target = [other for other in proposal.readings if other.target == reading.target]
    if len(readings_of_target) == 1:
        return target
    state = STATES[min(reading.state, len(STATES) - 1)]
    return f"{target} {state}"


STATES = ("unloaded", "loaded", "unloaded after", "repeat")
"""State of a target by the order of its positions."""


def name_columns(reading: TargetReading, *, with_table: bool) -> str:
    """Return the columns of a reading, counted from 1, with the rows of a posture if there are several."""
    first, second, third = (column + 1 for column in reading.points.columns)
    columns = f"{first}, {second}, {third}"
    if third == first + 2:
        columns = f"{first}–{third}"
    groups = reading.points.groups
    rows = "" if groups.count == 1 else f" (row {reading.index + 1} of {groups.count}, {groups.order})"
    table = f"{reading.points.table} " if with_table else ""
    return f"{table}{columns}{rows}"


def _describe_joints(joints: JointColumns, *, with_table: bool) -> str:
    """Return the columns of the joints, their unit and the way of counting."""
    joint_count = len(joints.columns)
    in_order = sorted(joints.columns) if joints.is_reversed else list(joints.columns)
    are_neighbours = in_order == list(range(in_order[0], in_order[0] + joint_count))
    listed, names = f"{in_order[0] + 1}–{in_order[-1] + 1}", f"J1…J{joint_count}"
    if not are_neighbours:
        listed = ", ".join(str(column + 1) for column in joints.columns)
    elif joints.is_reversed:
        names = f"J{joint_count}…J1"
    counting = "" if joints.counting.is_own else f" {joints.counting.name}"
    table = f"{joints.table} columns" if with_table else "columns"
    return f"{table} {listed} as {names} [{joints.unit}]{counting}"


def join(parts: Sequence[str]) -> str:
    """Return parts as a list in words, such as `a, b and c`."""
    *others, last = parts
    return f"{', '.join(others)} and {last}" if others else last


def format_mm(length: float) -> str:
    """Return a length [m] in mm with two digits."""
    rounded = float(f"{length * 1e3:.2g}")
    return f"{rounded:g} mm"
