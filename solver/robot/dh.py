"""Build a `KinematicChain` from a Denavit-Hartenberg table, standard or modified.

Both conventions put one revolute joint into each row; the flange frame is the last frame of the
table. Rx, Rz are rotations about, Tx, Tz translations along the axes of the moved frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import (
    MAX_MOVING_JOINTS,
    UNLIMITED_ANGLE,
    ChainJoint,
    KinematicChain,
)

Convention = Literal["standard", "modified"]

LARGEST_LENGTH = 100.0
"""Largest a or d [m]."""

LARGEST_ANGLE = 1e3
"""Largest joint limit [rad]."""

LARGEST_TWIST = 2 * math.pi
"""Largest alpha or theta [rad]; a larger one is in degrees."""


@dataclass(frozen=True)
class DhRow:
    """One row of a table."""

    a: float  #: link length [m]
    alpha: float  #: link twist [rad]
    d: float  #: link offset [m]
    theta: float  #: constant added to the joint angle [rad]
    lower: float | None = None  #: least joint angle, `theta` not included [rad]; None without a limit
    upper: float | None = None  #: greatest joint angle, `theta` not included [rad]; None without a limit


def dh_chain(rows: Sequence[DhRow], convention: Convention, name: str) -> KinematicChain:
    """Build the chain of a table.

    With joint angle q_i and the constants of row i, frame i stands in frame i-1 at

    * standard: T_i = Rz(q_i + theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i),
    * modified (Craig): T_i = Rx(alpha_i) Tx(a_i) Rz(q_i + theta_i) Tz(d_i).

    Joints are named joint_1, joint_2, …; links base (frame 0, R0), link_1, …, flange (frame n). The
    links between have the origin and z of the joint that carries them: frame i in the modified,
    frame i-1 in the standard convention, turned by the joint's angle.

    Args:
        rows: 1 to `MAX_MOVING_JOINTS` rows, base first.
        convention: of the table.
        name: name of the robot.

    Returns:
        The chain: the rows' joints, and a fixed one to the flange.

    Raises:
        RobotError: too few or too many rows, or a number that is not finite or absurdly large.
    """
    if not 1 <= len(rows) <= MAX_MOVING_JOINTS:
        raise RobotError(
            f"{len(rows)} rows",
            remedy=f"give 1 to {MAX_MOVING_JOINTS} rows, one per joint",
            where="model.rows",
        )
    for index, row in enumerate(rows):
        _check_row(row, f"model.rows[{index}]")
    placements = _modified(rows) if convention == "modified" else _standard(rows)
    *moving, flange = placements
    joints = [
        _joint(f"joint_{index}", "revolute", placement, _limits(row), f"link_{index}")
        for index, (row, placement) in enumerate(zip(rows, moving, strict=True), start=1)
    ]
    joints.append(_joint("joint_flange", "fixed", flange, None, "flange"))
    return KinematicChain(name=name, base="base", flange="flange", joints=tuple(joints))


def _modified(rows: Sequence[DhRow]) -> list[pin.SE3]:
    """Return the placements of the joints, Rx(alpha) Tx(a) Rz(theta) Tz(d), then of the flange, identity."""
    placements = [_about_x(row.alpha, row.a) * _about_z(row.theta, row.d) for row in rows]
    return [*placements, pin.SE3.Identity()]


def _standard(rows: Sequence[DhRow]) -> list[pin.SE3]:
    """Return the placements of the joints, then of the flange.

    Joint i turns about z of frame i-1, so the transforms of row i-1 after its own joint, Tz(d) Tx(a)
    Rx(alpha), come before joint i: [Tz(d) Tx(a) Rx(alpha)]_{i-1} Rz(theta_i).
    """
    placements = []
    before = pin.SE3.Identity()
    for row in rows:
        placements.append(before * _about_z(row.theta, 0.0))
        before = _about_z(0.0, row.d) * _about_x(row.alpha, row.a)
    return [*placements, before]


def _about_x(angle: float, length: float) -> pin.SE3:
    """Return Rx(angle) Tx(length), which commute."""
    return pin.SE3(pin.utils.rotate("x", angle), np.array([length, 0.0, 0.0]))


def _about_z(angle: float, length: float) -> pin.SE3:
    """Return Rz(angle) Tz(length), which commute."""
    return pin.SE3(pin.utils.rotate("z", angle), np.array([0.0, 0.0, length]))


def _joint(
    name: str,
    kind: Literal["revolute", "fixed"],
    placement: pin.SE3,
    limits: tuple[float, float] | None,
    child: str,
) -> ChainJoint:
    axis = np.array([0.0, 0.0, 1.0])
    return ChainJoint(name, kind, placement.rotation, placement.translation, axis, limits, child)


def _limits(row: DhRow) -> tuple[float, float] | None:
    if row.lower is None and row.upper is None:
        return None
    lower = -UNLIMITED_ANGLE if row.lower is None else row.lower
    upper = UNLIMITED_ANGLE if row.upper is None else row.upper
    return lower, upper


def _check_row(row: DhRow, where: str) -> None:
    for field, value, largest, unit in (
        ("a", row.a, LARGEST_LENGTH, "m"),
        ("alpha", row.alpha, LARGEST_TWIST, "rad"),
        ("d", row.d, LARGEST_LENGTH, "m"),
        ("theta", row.theta, LARGEST_TWIST, "rad"),
        ("lower", row.lower, LARGEST_ANGLE, "rad"),
        ("upper", row.upper, LARGEST_ANGLE, "rad"),
    ):
        if value is not None and not (math.isfinite(value) and abs(value) <= largest):
            raise RobotError(
                f"{value:g} {unit} is not a finite number within ±{largest:g} {unit}",
                remedy="check the number; lengths are in m, angles in rad, not in degrees",
                where=f"{where}.{field}",
            )
    if row.lower is not None and row.upper is not None and row.lower > row.upper:
        raise RobotError(
            f"the lower limit {row.lower:g} rad is above the upper limit {row.upper:g} rad",
            remedy="exchange the limits, or correct a sign",
            where=f"{where}.lower",
        )
