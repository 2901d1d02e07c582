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
    names = names or [name_reading(proposal, each) for each in proposal.readings]
    several = len({proposal.joints.table, *(each.points.table for each in proposal.readings)}) > 1
    parts = [_describe_joints(proposal.joints, with_table=several)]
    parts += [
        f"{name_columns(each, with_table=several)} as {name} [{proposal.unit}]"
        for each, name in zip(proposal.readings, names, strict=True)
    ]
    frame = "" if proposal.is_in_base_frame else " in a frame of the instrument"
    names = " or ".join(known.name for known in proposal.robots)
    following = f"more than {format_mm(WORST_SCREENED)}"
    if np.isfinite(proposal.next_residual):
        following = format_mm(proposal.next_residual)
    return (
        f"{join(parts)}{frame} fit the {names} to {format_mm(proposal.residual)} in {proposal.fitting} of "
        f"{proposal.count} positions (next best: {following})"
    )


def remark(proposal: Proposal) -> str:
    """Return what a person should know about the fit; empty if it is usual."""
    if proposal.is_usual:
        return ""
    return "arms usually fit to 1 mm to 2 mm: another arm of the same class may have been measured"


def name_reading(proposal: Proposal, reading: TargetReading) -> str:
    """Return target and state of a reading, such as `T1 loaded`; a target in one state has no state."""
    states = [each.state for each in proposal.readings if each.target == reading.target]
    target = f"T{reading.target}"
    return target if len(states) == 1 else f"{target} {STATES[min(reading.state, len(STATES) - 1)]}"


STATES = ("unloaded", "loaded", "unloaded after", "repeat")
"""State of a target by the order of its positions."""


def name_columns(reading: TargetReading, *, with_table: bool) -> str:
    """Return the columns of a reading, counted from 1, with the rows of a posture if there are several."""
    first, second, third = (column + 1 for column in reading.points.columns)
    columns = f"{first}–{third}" if third == first + 2 else f"{first}, {second}, {third}"
    groups = reading.points.groups
    rows = "" if groups.count == 1 else f" (row {reading.index + 1} of {groups.count}, {groups.order})"
    table = f"{reading.points.table} " if with_table else ""
    return f"{table}{columns}{rows}"


def _describe_joints(joints: JointColumns, *, with_table: bool) -> str:
    """Return the columns of the joints, their unit and the way of counting."""
    first, last = joints.columns[0] + 1, joints.columns[-1] + 1
    names = f"J1…J{len(joints.columns)}"
    if joints.is_reversed:
        first, last, names = last, first, f"J{len(joints.columns)}…J1"
    counting = "" if joints.counting.is_own else f" {joints.counting.name}"
    table = f"{joints.table} columns" if with_table else "columns"
    return f"{table} {first}–{last} as {names} [{joints.unit}]{counting}"


def join(parts: Sequence[str]) -> str:
    """Return parts as a list in words."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def format_mm(length: float) -> str:
    """Return a length [m] in mm with two digits."""
    return f"{float(f'{length * 1e3:.2g}'):g} mm"
