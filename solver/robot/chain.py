"""Hold the kinematics of a serial robot as plain data: joints from the base link to the flange link.

Both readers, `solver.robot.urdf` and `solver.robot.dh`, end here, so everything behind them meets one kind of
robot. A `KinematicChain` that exists is sound: finite numbers, unit axes, unique names, 1 to 32
moving joints. Lengths are in m, angles in rad.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError

MAX_MOVING_JOINTS = 32
"""Maximum number of revolute joints of a chain: work and memory grow with its cube."""

MAX_CHAIN_JOINTS = 64
"""Maximum number of joints of a chain, fixed ones included."""

MAX_NAME_LENGTH = 200
"""Maximum length of the name of a robot, a link or a joint."""

UNLIMITED_ANGLE = 1e6
"""Smallest limit [rad] that means no limit, in documents written and read."""

_WORLD = "universe"
_UNIT_TOLERANCE = 1e-12  # of an axis or a rotation that a reader has already normalised


@dataclass(frozen=True, eq=False)
class ChainJoint:
    """A joint and the link behind it. Arrays are copied and read-only.

    The joint's frame is the child link's frame at joint angle zero. A point x of the child link at
    joint angle q lies at `rotation @ exp(q [axis]×) @ x + translation` in the parent link's frame.

    Raises:
        RobotError: a name, number, axis, rotation or limit that cannot be one.
    """

    name: str  #: name of the joint
    kind: Literal["revolute", "fixed"]  #: `revolute` moves, `fixed` does not
    rotation: FloatArray  #: (3, 3), from the joint's frame to the parent link's frame
    translation: FloatArray  #: (3,) origin of the joint's frame in the parent link's frame [m]
    axis: FloatArray  #: (3,) unit vector in the joint's frame; of no meaning for a fixed joint
    limits: tuple[float, float] | None  #: least and greatest joint angle [rad], None without limits
    child: str  #: name of the link that the joint carries

    def __post_init__(self) -> None:
        check_name(self.name, "a joint")
        place = f"joint '{self.name}'"
        check_name(self.child, f"{place} child")
        for field, shape in (("rotation", (3, 3)), ("translation", (3,)), ("axis", (3,))):
            array = np.array(getattr(self, field), dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                raise RobotError(
                    f"needs finite numbers of shape {shape}, but has shape {array.shape}",
                    remedy="give exactly these numbers",
                    where=f"{place} {field}",
                )
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        skewness = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if skewness > _UNIT_TOLERANCE or np.linalg.det(self.rotation) < 0.0:
            remedy = "give an orthonormal matrix with determinant 1"
            raise RobotError("the matrix is not a rotation", remedy=remedy, where=f"{place} rotation")
        if abs(np.linalg.norm(self.axis) - 1.0) > _UNIT_TOLERANCE:
            raise RobotError("the axis is not a unit vector", remedy="normalise it", where=place)
        if self.is_moving and self.name == _WORLD:
            reason = "this name is reserved for the world frame"
            raise RobotError(reason, remedy="rename the joint", where=place)
        lower, upper = self.limits or (0.0, 0.0)
        finite = math.isfinite(lower) and math.isfinite(upper)
        if not finite or lower > upper or lower >= UNLIMITED_ANGLE or upper <= -UNLIMITED_ANGLE:
            raise RobotError(
                f"the joint limits {lower:g} and {upper:g} rad leave no range",
                remedy="give a finite lower limit that does not exceed the upper one, or no limits",
                where=f"{place} limits",
            )

    @property
    def is_moving(self) -> bool:
        """Return whether the joint has an angle."""
        return self.kind != "fixed"

    @property
    def roll_pitch_yaw(self) -> tuple[float, float, float]:
        """Return the rotation as angles about the parent link's fixed x, y and z axes [rad]."""
        roll, pitch, yaw = pin.rpy.matrixToRpy(self.rotation)
        return float(roll), float(pitch), float(yaw)


@dataclass(frozen=True, eq=False)
class KinematicChain:
    """The joints from the base link to the flange link, in order, each carrying the next link.

    Raises:
        RobotError: an empty chain, one without moving joints, too many joints, duplicate or empty
            names.
    """

    name: str  #: name of the robot
    base: str  #: name of the base link; its frame is R0
    flange: str  #: name of the flange link, which the last joint carries
    joints: tuple[ChainJoint, ...]  #: all joints, fixed ones included

    def __post_init__(self) -> None:
        check_name(self.name, "the robot")
        check_name(self.base, "the base link")
        if not self.joints:
            raise RobotError("the chain has no joint", remedy="add joints to the chain", where="chain")
        moving = len(self.revolute)
        if moving == 0:
            raise RobotError(
                f"a fixed-only chain: there is no revolute joint between '{self.base}' and '{self.flange}'",
                remedy="choose a base and a flange with revolute joints between them",
                where="chain",
            )
        for count, most, what in (
            (moving, MAX_MOVING_JOINTS, "moving joints"),
            (len(self.joints), MAX_CHAIN_JOINTS, "joints, fixed ones included"),
        ):
            if count > most:
                raise RobotError(
                    f"the chain from '{self.base}' to '{self.flange}' has {count} {what}",
                    remedy=f"use at most {most}: choose a base and a flange closer to each other",
                    where="chain",
                )
        links = (self.base, *(joint.child for joint in self.joints))
        for what, names in (("joint", tuple(joint.name for joint in self.joints)), ("link", links)):
            name, count = Counter(names).most_common(1)[0]
            if count > 1:
                reason, remedy = f"{count} {what}s are named '{name}'", f"give each {what} a unique name"
                raise RobotError(reason, remedy=remedy, where=f"{what} '{name}'")
        if links[-1] != self.flange:
            raise RobotError(
                f"the last joint carries '{links[-1]}', not the flange '{self.flange}'",
                remedy="end the chain at the flange",
                where="flange",
            )

    @property
    def revolute(self) -> tuple[ChainJoint, ...]:
        """Return the moving joints, from the base on."""
        return tuple(joint for joint in self.joints if joint.is_moving)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the moving joints, from the base on."""
        return tuple(joint.name for joint in self.revolute)


def check_name(name: str, where: str) -> None:
    """Refuse a name that people or programs could mistake for another.

    Raises:
        RobotError: Empty, longer than `MAX_NAME_LENGTH`, with control or other invisible
            characters, or with spaces at an end.
    """
    if not name:
        raise RobotError("the name is missing or empty", remedy="give it a name", where=where)
    if len(name) > MAX_NAME_LENGTH:
        reason = f"the name has {len(name)} characters; it begins {name[:40]!r}"
        raise RobotError(reason, remedy=f"use at most {MAX_NAME_LENGTH} characters", where=where)
    if not name.isprintable() or name != name.strip():
        raise RobotError(
            f"the name {name[:60]!a} has invisible characters, or spaces at an end",
            remedy="use printable characters and no space at either end",
            where=where,
        )
