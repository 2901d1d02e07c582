"""The kinematic chain that a document states, and Pinocchio's model of it.

URDFs, read by `mechanics.urdf`, Denavit-Hartenberg tables and identified axes all become a `KinematicChain`,
and each chain becomes a `pin.Model`, joint by joint: everything behind this module works with that model. A
`KinematicChain` that exists is sound: finite numbers, unit axes, unique names, 1 to 32 moving joints. Lengths
are in m, angles in rad; a joint's position is an angle or a length, by its kind (`schemas.joints`).

Both conventions of tables put one moving joint into each row; the flange frame is the last frame of the
table. Rx, Rz are rotations about, Tx, Tz translations along the axes of the moved frame.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import mul
from typing import Final, Literal

import numpy as np
import pinocchio as pin

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.robot import DhRow
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError

MAX_MOVING_JOINTS = 32
"""Maximum number of moving joints of a chain: work and memory grow with its cube."""

MAX_CHAIN_JOINTS = 64
"""Maximum number of joints of a chain, fixed ones included."""

MAX_NAME_LENGTH = 200
"""Maximum length of the name of a robot, a link or a joint."""

UNLIMITED = 1e6
"""Smallest limit [rad or m] that means no limit, in documents written and read."""

FASTEST: Final = 1e3
"""Smallest speed of a joint [rad/s or m/s] that means no limit, in documents read."""

Convention = Literal["standard", "modified"]

LARGEST_LENGTH = 100.0
"""Largest a or d of a Denavit-Hartenberg table [m]."""

LARGEST_OFFSET = 1e4
"""Largest d of a table [m]: calibrated parallel axes have large offsets that cancel one another."""

LARGEST_ANGLE = 1e3
"""Largest limit of a revolute joint of a table [rad]."""

LARGEST_SPEED: Final = 100.0
"""Largest speed of a joint of a table [rad/s or m/s]."""

LARGEST_TWIST = 2 * math.pi
"""Largest alpha or theta of a table [rad]; a larger one is in degrees."""

_UNIT_TOLERANCE = 1e-12  # of an axis or a rotation that a reader has already normalised


@dataclass(frozen=True, eq=False)
class ChainJoint:
    """A joint and the link behind it. Arrays are copied and read-only.

    The joint's frame is the child link's frame at joint position zero. In the parent link's frame, a point x
    of the child link lies at `rotation @ exp(q [axis]×) @ x + translation` behind a revolute joint at angle
    q, and at `rotation @ (x + q axis) + translation` behind a prismatic joint at length q.

    Raises:
        RobotError: a name, number, axis, rotation or limit is not valid.
    """

    name: str  #: name of the joint
    kind: JointKind | Literal["fixed"]  #: kind of motion; a `fixed` joint does not move
    rotation: FloatArray  #: (3, 3), from the joint's frame to the parent link's frame
    translation: FloatArray  #: (3,) origin of the joint's frame in the parent link's frame [m]
    axis: FloatArray  #: (3,) unit vector in the joint's frame; of no meaning for a fixed joint
    limits: tuple[float, float] | None  #: least and greatest position [rad or m], None without limits
    child: str  #: name of the link that the joint carries
    speed: float | None = None  #: greatest speed by the maker [rad/s or m/s], None if unknown

    def __post_init__(self) -> None:
        check_name(self.name, "a joint")
        place = f"joint '{self.name}'"
        check_name(self.child, f"{place} child")
        for field in ("rotation", "translation", "axis"):
            array = np.array(getattr(self, field), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        orthogonality_error = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        error = max(orthogonality_error, abs(np.linalg.norm(self.axis) - 1.0))
        sound = error <= _UNIT_TOLERANCE and np.linalg.det(self.rotation) > 0.0
        if not sound or not np.isfinite(self.translation).all():
            raise RobotError(
                "the frame of the joint must have a rotation, a finite translation and a unit axis",
                remedy="give an orthonormal matrix with determinant 1, and normalise the axis",
                where=place,
            )
        lower, upper = self.limits or (0.0, 0.0)
        finite = math.isfinite(lower) and math.isfinite(upper)
        is_locked = self.limits is not None and lower == upper
        if not finite or is_locked or lower > upper or lower >= UNLIMITED or upper <= -UNLIMITED:
            unit = "" if self.kind == "fixed" else f" {JOINT_UNITS[self.kind].position}"
            raise RobotError(
                f"the joint limits {lower:g} and {upper:g}{unit} leave no range",
                remedy="give a finite lower limit below the upper limit, or no limits; make a joint that "
                "cannot move a fixed joint",
                where=f"{place} limits",
            )
        if self.speed is not None and not 0.0 < self.speed < math.inf:
            raise RobotError(
                f"the greatest speed of the joint is {self.speed:g}, which is not positive and finite",
                remedy="give the speed of the maker's data sheet, or none",
                where=f"{place} speed",
            )

    @property
    def is_moving(self) -> bool:
        """True if the joint moves, so that it has a position."""
        return self.kind != "fixed"

    @property
    def placement(self) -> pin.SE3:
        """Placement of the joint's frame in the frame of the parent link [m]."""
        return pin.SE3(self.rotation, self.translation)

    @property
    def roll_pitch_yaw(self) -> tuple[float, float, float]:
        """Rotation of the joint's frame: angles about the fixed x, y and z axes of the parent link [rad]."""
        roll, pitch, yaw = pin.rpy.matrixToRpy(self.rotation)
        return float(roll), float(pitch), float(yaw)


@dataclass(frozen=True, eq=False)
class KinematicChain:
    """Chain of the joints from the base link to the flange link, in order, each carrying the next link.

    Raises:
        RobotError: a chain without moving joints, too many joints, duplicate or empty names.
    """

    name: str  #: name of the robot
    base: str  #: name of the base link; its frame is R0
    flange: str  #: name of the flange link, which the last joint carries
    joints: tuple[ChainJoint, ...]  #: all joints, fixed ones included

    def __post_init__(self) -> None:
        check_name(self.name, "the robot")
        check_name(self.base, "the base link")
        moving = len(self.moving)
        if moving == 0:
            raise RobotError(
                f"there is no moving joint between '{self.base}' and '{self.flange}'",
                remedy="choose a base and a flange with moving joints between base and flange",
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
        # Pinocchio finds joints and frames by name, so that a name must not occur twice.
        for what, names in (("joint", tuple(joint.name for joint in self.joints)), ("link", links)):
            name, count = Counter(names).most_common(1)[0]
            if count > 1:
                reason = f"{count} {what}s are named '{name}'"
                remedy = f"give each {what} a unique name"
                raise RobotError(reason, remedy=remedy, where=f"{what} '{name}'")

    @property
    def moving(self) -> tuple[ChainJoint, ...]:
        """Return the moving joints, from the base on."""
        return tuple(joint for joint in self.joints if joint.is_moving)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the moving joints, from the base on."""
        return tuple(joint.name for joint in self.moving)

    @property
    def joint_kinds(self) -> tuple[JointKind, ...]:
        """Return the kinds of the moving joints, from the base on."""
        return tuple(joint.kind for joint in self.joints if joint.kind != "fixed")

    def without_speeds(self) -> KinematicChain:
        """Return the chain with joints of unknown speed."""
        return replace(self, joints=tuple(replace(joint, speed=None) for joint in self.joints))

    def model(self) -> pin.Model:
        """Build Pinocchio's model: a joint for each moving joint, and a frame for each link.

        The universe is R0, the frame of the base link. Frames of links behind a fixed joint are placed in the
        frame of the last moving joint; the frame of the flange is the last one.
        """
        # `parent` is the last moving joint, `link` the last frame, `placement` the latter in the former.
        model, parent, placement = pin.Model(), 0, pin.SE3.Identity()
        model.name = self.name
        link = model.addBodyFrame(self.base, parent, placement, 0)
        for joint in self.joints:
            placement = placement * joint.placement
            if joint.is_moving:
                parent = model.addJoint(parent, *_pinocchio_joint(joint, placement))
                link = model.addJointFrame(parent, link)
                placement = pin.SE3.Identity()
            else:
                fixed = pin.Frame(joint.name, parent, link, placement, pin.FrameType.FIXED_JOINT)
                link = model.addFrame(fixed)
            link = model.addBodyFrame(joint.child, parent, placement, link)
        return model


_NO_BOUND: Final = np.full(1, np.inf)


def _pinocchio_joint(joint: ChainJoint, placement: pin.SE3) -> tuple[object, ...]:
    """Return the arguments of `pin.Model.addJoint` for a moving joint, without the parent's index."""
    kind = pin.JointModelPrismaticUnaligned if joint.kind == "prismatic" else pin.JointModelRevoluteUnaligned
    lower, upper = joint.limits or (-UNLIMITED, UNLIMITED)
    least = np.full(1, lower if lower > -UNLIMITED else -np.inf)
    greatest = np.full(1, upper if upper < UNLIMITED else np.inf)
    speed = _NO_BOUND if joint.speed is None else np.full(1, joint.speed)
    return kind(joint.axis), placement, joint.name, _NO_BOUND, speed, least, greatest


def check_name(name: str, where: str) -> None:
    """Refuse a name that is empty or too long, or has invisible characters, which make names look equal.

    `where` names the named object, such as "a joint", for the error.

    Raises:
        RobotError: the name is empty, longer than `MAX_NAME_LENGTH`, has control or other invisible
            characters, or spaces at an end.
    """
    if not name:
        raise RobotError("the name is missing or empty", remedy="give a name", where=where)
    if len(name) > MAX_NAME_LENGTH:
        reason = f"the name has {len(name)} characters; it begins {name[:40]!r}"
        raise RobotError(reason, remedy=f"use at most {MAX_NAME_LENGTH} characters", where=where)
    if not name.isprintable() or name != name.strip():
        raise RobotError(
            f"the name {name[:60]!a} has invisible characters, or spaces at an end",
            remedy="use printable characters and no space at either end",
            where=where,
        )


def chain_dh_rows(rows: Sequence[DhRow], convention: Convention, name: str) -> KinematicChain:
    """Build the kinematic chain of a Denavit-Hartenberg table.

    With joint angle q_i and the constants of row i, frame i is in frame i-1 at

    * standard: T_i = Rz(q_i + theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i),
    * modified (Craig): T_i = Rx(alpha_i) Tx(a_i) Rz(q_i + theta_i) Tz(d_i).

    The position q_i of a prismatic joint is a length: it is added to d_i instead of theta_i.

    Joints are named joint_1, joint_2, …; links are named base (frame 0, R0), link_1, …, flange (frame n).
    Link_i has the origin and the z axis of frame i in the modified convention, of frame i-1 in the standard
    convention, turned or shifted by joint_i, which carries the link.

    Args:
        rows: 1 to `MAX_MOVING_JOINTS` rows, base first, in m and rad.
        convention: convention of the table.
        name: name of the robot.

    Returns:
        The chain: a moving joint for each row, and a fixed joint to the flange.

    Raises:
        RobotError: too few or too many rows, or a number that is not finite or absurdly large.
    """
    if not 1 <= len(rows) <= MAX_MOVING_JOINTS:
        remedy = f"give 1 to {MAX_MOVING_JOINTS} rows, one per joint"
        raise RobotError(f"the table has {len(rows)} rows", remedy=remedy, where="model.rows")
    joints, z = [], np.array([0.0, 0.0, 1.0])
    before = pin.SE3.Identity()  # transforms of earlier rows that still precede the next joint
    for index, row in enumerate(rows):
        limits = _read_limits(row, f"model.rows[{index}]")
        # Rx(alpha) and Tx(a) commute, and so do Rz(theta) and Tz(d)
        about_x = pin.SE3(pin.utils.rotate("x", row.alpha), np.array([row.a, 0.0, 0.0]))
        if convention == "modified":
            place = about_x * _about_z(row.theta, row.d)
        else:  # joint i moves about or along z of frame i-1: row i-1 after its joint precedes joint i
            place = before * _about_z(row.theta, 0.0)
            before = _about_z(0.0, row.d) * about_x
        joint, link = f"joint_{index + 1}", f"link_{index + 1}"
        joints.append(
            ChainJoint(joint, row.kind, place.rotation, place.translation, z, limits, link, row.speed)
        )
    joints.append(ChainJoint("joint_flange", "fixed", before.rotation, before.translation, z, None, "flange"))
    reach = float(np.linalg.norm(reduce(mul, (joint.placement for joint in joints)).translation))
    if reach > LARGEST_LENGTH and any(abs(row.d) > LARGEST_LENGTH for row in rows):
        raise RobotError(
            f"the flange is {reach:g} m from the base with all joints at zero; at most "
            f"{LARGEST_LENGTH:g} m is plausible",
            remedy=f"check d and its unit: offsets above {LARGEST_LENGTH:g} m are plausible only if the "
            f"offsets cancel to at most {LARGEST_LENGTH:g} m; give a longer machine as a URDF",
            where="model.rows",
        )
    return KinematicChain(name=name, base="base", flange="flange", joints=tuple(joints))


def _about_z(angle: float, length: float) -> pin.SE3:
    """Return the transform Rz(angle) Tz(length): rotation about z [rad], then translation along z [m]."""
    return pin.SE3(pin.utils.rotate("z", angle), np.array([0.0, 0.0, length]))


def _read_limits(row: DhRow, where: str) -> tuple[float, float] | None:
    """Check the numbers of a row of the table, and return the limits of its joint [rad or m].

    Return None for a joint without limits. `where` is the place of the row, for errors.

    Raises:
        RobotError: a number is not finite or too large.
    """
    position = ("m", LARGEST_LENGTH) if row.kind == "prismatic" else ("rad", LARGEST_ANGLE)
    speed = (f"{position[0]}/s", LARGEST_SPEED)
    for field, unit, largest in (
        ("a", "m", LARGEST_LENGTH),
        ("alpha", "rad", LARGEST_TWIST),
        ("d", "m", LARGEST_OFFSET),
        ("theta", "rad", LARGEST_TWIST),
        ("lower", *position),
        ("upper", *position),
        ("speed", *speed),
    ):
        value = getattr(row, field)
        if value is not None and not (math.isfinite(value) and abs(value) <= largest):
            raise RobotError(
                f"{value:g} {unit} is not a finite number within ±{largest:g} {unit}",
                remedy="check the number and its unit: lengths are in m, angles in rad, unless `length_unit` "
                "and `angle_unit` of the table say mm and deg",
                where=f"{where}.{field}",
            )
    if row.lower is None and row.upper is None:
        return None
    return (
        -UNLIMITED if row.lower is None else row.lower,
        UNLIMITED if row.upper is None else row.upper,
    )
