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
from jointstiff.solver.robot.chain import MAX_MOVING_JOINTS, UNLIMITED_ANGLE, ChainJoint, KinematicChain

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
        remedy = f"give 1 to {MAX_MOVING_JOINTS} rows, one per joint"
        raise RobotError(f"{len(rows)} rows", remedy=remedy, where="model.rows")
    joints, z = [], np.array([0.0, 0.0, 1.0])
    before = pin.SE3.Identity()  # what of the rows so far comes before the next joint
    for index, row in enumerate(rows):
        limits = _checked_limits(row, f"model.rows[{index}]")
        # Rx(alpha) Tx(a), which commute, as the other two do
        about_x = pin.SE3(pin.utils.rotate("x", row.alpha), np.array([row.a, 0.0, 0.0]))
        if convention == "modified":
            place = about_x * _about_z(row.theta, row.d)
        else:  # the joint turns about z of frame i-1: what follows its own joint in row i-1 comes before it
            place = before * _about_z(row.theta, 0.0)
            before = _about_z(0.0, row.d) * about_x
        own, link = f"joint_{index + 1}", f"link_{index + 1}"
        joints.append(ChainJoint(own, "revolute", place.rotation, place.translation, z, limits, link))
    joints.append(ChainJoint("joint_flange", "fixed", before.rotation, before.translation, z, None, "flange"))
    return KinematicChain(name=name, base="base", flange="flange", joints=tuple(joints))


def _about_z(angle: float, length: float) -> pin.SE3:
    """Return Rz(angle) Tz(length)."""
    return pin.SE3(pin.utils.rotate("z", angle), np.array([0.0, 0.0, length]))


def _checked_limits(row: DhRow, where: str) -> tuple[float, float] | None:
    """Return the limits of a row's joint [rad], unless a number of the row makes no sense."""
    for field, largest, unit in (
        ("a", LARGEST_LENGTH, "m"),
        ("alpha", LARGEST_TWIST, "rad"),
        ("d", LARGEST_LENGTH, "m"),
        ("theta", LARGEST_TWIST, "rad"),
        ("lower", LARGEST_ANGLE, "rad"),
        ("upper", LARGEST_ANGLE, "rad"),
    ):
        value = getattr(row, field)
        if value is not None and not (math.isfinite(value) and abs(value) <= largest):
            raise RobotError(
                f"{value:g} {unit} is not a finite number within ±{largest:g} {unit}",
                remedy="check the number; lengths are in m, angles in rad, not in degrees",
                where=f"{where}.{field}",
            )
    if row.lower is None and row.upper is None:
        return None
    lower = -UNLIMITED_ANGLE if row.lower is None else row.lower
    upper = UNLIMITED_ANGLE if row.upper is None else row.upper
    if lower > upper:
        raise RobotError(
            f"the lower limit {lower:g} rad is above the upper limit {upper:g} rad",
            remedy="exchange the limits, or correct a sign",
            where=f"{where}.lower",
        )
    return lower, upper
