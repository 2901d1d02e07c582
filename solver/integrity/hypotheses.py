"""Mistakes of a whole set that leave every number plausible: what angles and lengths may have been meant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.finding import M_AS_MM, MM_AS_M, FindingCode


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Angles and positions of some rows, corrected for one assumed mistake."""

    code: FindingCode  #: the finding if it is true
    joints: FloatArray  #: (M, n) controller angles [rad]
    length: float  #: factor on the positions
    figure: str  #: change that was tried, for the message: "with ... ".
    remedy: str  #: the proposed correction
    rows: IndexArray  #: (M,) rows that it can explain, as places among those asked for


def unit_hypotheses(joints: FloatArray) -> Iterator[Hypothesis]:
    """Lengths and angles in another unit.

    Args:
        joints: (M, n) controller angles as posted [rad].
    """
    rows = np.arange(len(joints))
    for factor, changed, remedy in (
        (1e-3, "all lengths divided by 1000", MM_AS_M),
        (1e3, "all lengths multiplied by 1000", M_AS_MM),
    ):
        yield Hypothesis("length_unit_suspect", joints, factor, changed, remedy, rows)
    for angles, changed, right, declared, unit in (
        (np.deg2rad(joints), "all angles taken as degrees", "degrees", "radians", "deg"),
        (np.rad2deg(joints), "all angles taken as radians", "radians", "degrees", "rad"),
    ):
        remedy = f"the angles seem to be in {right} and declared as {declared}: set `units.angle` to {unit}"
        yield Hypothesis("angle_unit_suspect", angles, 1.0, changed, remedy, rows)


def angle_hypotheses(joints: FloatArray, rows: IndexArray, names: tuple[str, ...]) -> Iterator[Hypothesis]:
    """A joint's sign, two joints' columns, rows shifted against the readings.

    Args:
        joints: (N, n) controller angles of the whole set [rad].
        rows: (M,) which of its rows are asked for.
        names: of the controller's joints.
    """
    angles, every = joints[rows], np.arange(len(rows))
    for j, name in enumerate(names):
        sign = np.ones(len(names))
        sign[j] = -1.0
        yield Hypothesis(
            "joint_sign_suspect",
            angles * sign,
            1.0,
            f"the angle of {name} with the other sign",
            f"change the sign of {name} in every observation, or in the joint map",
            every,
        )
    yield from _exchanges(angles, every, names)
    for shift, neighbour in ((-1, "before"), (1, "after")):
        inside = np.flatnonzero((rows + shift >= 0) & (rows + shift < len(joints)))
        if len(inside):
            yield Hypothesis(
                "observations_out_of_order",
                joints[rows[inside] + shift],
                1.0,
                f"the angles of the row {neighbour}",
                f"shift the readings by one row: they belong to the angles of the row {neighbour}",
                inside,
            )


def _exchanges(asked: FloatArray, every: IndexArray, names: tuple[str, ...]) -> Iterator[Hypothesis]:
    for j, k in combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[j, k]] = k, j
        yield Hypothesis(
            "joints_swapped",
            asked[:, order],
            1.0,
            f"the angles of {names[j]} and {names[k]} exchanged",
            f"exchange the columns of {names[j]} and {names[k]} in every observation",
            every,
        )
