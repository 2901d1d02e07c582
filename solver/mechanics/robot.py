"""Robots: a kinematic chain as plain data, with joint map and bodies.

URDFs, read by `mechanics.urdf`, and Denavit-Hartenberg tables end here, so everything behind them meets
one kind of robot. A `KinematicChain` that exists is sound: finite numbers, unit axes, unique names, 1 to 32
moving joints. Lengths are in m, angles in rad; a joint's position is an angle or a length, by its kind
(`schemas.joints`).

Both conventions of tables put one moving joint into each row; the flange frame is the last frame of the
table. Rx, Rz are rotations about, Tx, Tz translations along the axes of the moved frame.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.robot import DhRow
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RobotError

MAX_MOVING_JOINTS = 32
"""Maximum number of moving joints of a chain: work and memory grow with its cube."""

MAX_CHAIN_JOINTS = 64
"""Maximum number of joints of a chain, fixed ones included."""

MAX_NAME_LENGTH = 200
"""Maximum length of the name of a robot, a link or a joint."""

UNLIMITED = 1e6
"""Smallest limit [rad or m] that means no limit, in documents written and read."""

Convention = Literal["standard", "modified"]

LARGEST_LENGTH = 100.0
"""Largest a or d of a Denavit-Hartenberg table [m]."""

LARGEST_ANGLE = 1e3
"""Largest limit of a revolute joint of a table [rad]."""

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
        RobotError: a name, number, axis, rotation or limit that cannot be one.
    """

    name: str  #: name of the joint
    kind: JointKind | Literal["fixed"]  #: how it moves; `fixed` does not
    rotation: FloatArray  #: (3, 3), from the joint's frame to the parent link's frame
    translation: FloatArray  #: (3,) origin of the joint's frame in the parent link's frame [m]
    axis: FloatArray  #: (3,) unit vector in the joint's frame; of no meaning for a fixed joint
    limits: tuple[float, float] | None  #: least and greatest position [rad or m], None without limits
    child: str  #: name of the link that the joint carries

    def __post_init__(self) -> None:
        check_name(self.name, "a joint")
        place = f"joint '{self.name}'"
        check_name(self.child, f"{place} child")
        for field in ("rotation", "translation", "axis"):
            array = np.array(getattr(self, field), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        skewness = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        off = max(skewness, abs(np.linalg.norm(self.axis) - 1.0))
        sound = off <= _UNIT_TOLERANCE and np.linalg.det(self.rotation) > 0.0
        if not sound or not np.isfinite(self.translation).all():
            raise RobotError(
                "the joint's frame is not a rotation, a finite translation and a unit axis",
                remedy="give an orthonormal matrix with determinant 1, and normalise the axis",
                where=place,
            )
        lower, upper = self.limits or (0.0, 0.0)
        finite = math.isfinite(lower) and math.isfinite(upper)
        if not finite or lower > upper or lower >= UNLIMITED or upper <= -UNLIMITED:
            unit = "" if self.kind == "fixed" else f" {JOINT_UNITS[self.kind].position}"
            raise RobotError(
                f"the joint limits {lower:g} and {upper:g}{unit} leave no range",
                remedy="give a finite lower limit that does not exceed the upper one, or no limits",
                where=f"{place} limits",
            )

    @property
    def is_moving(self) -> bool:
        """Return whether the joint has a position."""
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
                f"a fixed-only chain: there is no moving joint between '{self.base}' and '{self.flange}'",
                remedy="choose a base and a flange with moving joints between them",
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


def dh_chain(rows: Sequence[DhRow], convention: Convention, name: str) -> KinematicChain:
    """Build the chain of a table.

    With joint angle q_i and the constants of row i, frame i stands in frame i-1 at

    * standard: T_i = Rz(q_i + theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i),
    * modified (Craig): T_i = Rx(alpha_i) Tx(a_i) Rz(q_i + theta_i) Tz(d_i).

    A prismatic joint's length q_i is added to d_i instead, and theta_i stays.

    Joints are named joint_1, joint_2, …; links base (frame 0, R0), link_1, …, flange (frame n). The
    links between have the origin and z of the joint that carries them: frame i in the modified,
    frame i-1 in the standard convention, turned or shifted by the joint.

    Args:
        rows: 1 to `MAX_MOVING_JOINTS` rows, base first, in m and rad.
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
        else:  # the joint moves about or along z of frame i-1: what follows the joint of row i-1 comes before
            place = before * _about_z(row.theta, 0.0)
            before = _about_z(0.0, row.d) * about_x
        own, link = f"joint_{index + 1}", f"link_{index + 1}"
        joints.append(ChainJoint(own, row.kind, place.rotation, place.translation, z, limits, link))
    joints.append(ChainJoint("joint_flange", "fixed", before.rotation, before.translation, z, None, "flange"))
    return KinematicChain(name=name, base="base", flange="flange", joints=tuple(joints))


def _about_z(angle: float, length: float) -> pin.SE3:
    """Return Rz(angle) Tz(length)."""
    return pin.SE3(pin.utils.rotate("z", angle), np.array([0.0, 0.0, length]))


def _checked_limits(row: DhRow, where: str) -> tuple[float, float] | None:
    """Return the limits of a row's joint [rad or m], unless a number of the row makes no sense."""
    position = ("m", LARGEST_LENGTH) if row.kind == "prismatic" else ("rad", LARGEST_ANGLE)
    for field, unit, largest in (
        ("a", "m", LARGEST_LENGTH),
        ("alpha", "rad", LARGEST_TWIST),
        ("d", "m", LARGEST_LENGTH),
        ("theta", "rad", LARGEST_TWIST),
        ("lower", *position),
        ("upper", *position),
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
    return (
        -UNLIMITED if row.lower is None else row.lower,
        UNLIMITED if row.upper is None else row.upper,
    )


_ROUNDING: Final = 1e-9
"""Part of a position [rad or m] by which it may pass a limit: rounding of documents."""
LARGEST_MAP_ENTRY: Final = 1e3
"""Largest entry of a joint map's matrix or offset, in SI units of the joints."""

WORST_CONDITION: Final = 1e8
"""Condition number of a joint map's matrix above which it counts as singular."""

STATED_BY_DEFAULT: Final = 0.2
"""Relative half-width of a mass whose uncertainty nobody states."""

_NAME: Final = "displaced axis"


@dataclass(frozen=True, eq=False)
class JointMap:
    """Map the controller's joint positions q_c to those of the model, q = M q_c + o (method.md §1).

    Arrays are copied and read-only.

    Raises:
        RobotError: a matrix that is not square, not of the offset's size, not finite, absurdly
            large, or singular.
    """

    matrix: FloatArray  #: M (n, n), units of the model's joint per those of the controller's
    offset: FloatArray  #: o (n,) [rad or m]

    def __post_init__(self) -> None:
        for field in ("matrix", "offset"):
            array = np.array(getattr(self, field), dtype=np.float64)
            if not (np.abs(array) <= LARGEST_MAP_ENTRY).all():
                raise RobotError(
                    "a number is not finite, or too large",
                    remedy=f"give numbers within ±{LARGEST_MAP_ENTRY:g}",
                    where=f"joint_map.{field}",
                )
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        n = self.offset.size
        if not 1 <= n <= MAX_MOVING_JOINTS or self.offset.ndim != 1 or self.matrix.shape != (n, n):
            raise RobotError(
                f"the matrix has shape {self.matrix.shape}, the offset {n} numbers",
                remedy="give an n × n matrix and n offsets; n is the number of moving joints, at most "
                f"{MAX_MOVING_JOINTS}",
                where="joint_map.matrix",
            )
        singular = np.linalg.svd(self.matrix, compute_uv=False)  # descending
        if singular[-1] * WORST_CONDITION < max(singular[0], 1.0):
            raise RobotError(
                "the matrix is singular: different controller angles give the same model angles",
                remedy="give an invertible matrix",
                where="joint_map.matrix",
            )

    @classmethod
    def identity(cls, n: int) -> JointMap:
        """Return the map for n joints whose controller angles are the model's."""
        return cls(np.eye(n), np.zeros(n))

    @classmethod
    def from_rows(cls, matrix: Sequence[Sequence[float]], offset: Sequence[float]) -> JointMap:
        """Build the map from rows that a request gave.

        Raises:
            RobotError: rows of different lengths, or anything that the class refuses.
        """
        lengths = {len(row) for row in matrix}
        if lengths != {len(matrix)}:
            raise RobotError(
                f"the matrix has {len(matrix)} rows of {' or '.join(map(str, sorted(lengths))) or 'no'} "
                "numbers",
                remedy="give a square matrix",
                where="joint_map.matrix",
            )
        return cls(np.array(matrix, dtype=np.float64), np.array(offset, dtype=np.float64))

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.offset)

    def model_angles(self, controller: FloatArray) -> FloatArray:
        """Map positions (N, n) that the controller shows to those of the model, both [rad or m]."""
        return np.asarray(controller @ self.matrix.T + self.offset)

    def controller_angles(self, model: FloatArray) -> FloatArray:
        """Return the positions (..., n) that the controller shows of those of the model, both [rad or m]."""
        wanted = (model - self.offset).reshape(-1, self.n)  # columns of one system: factorised once
        return np.asarray(np.linalg.solve(self.matrix, wanted.T)).T.reshape(model.shape)


@dataclass(frozen=True)
class Body:
    """A body of a robot, as people state it or a URDF has it, and how well it is known."""

    name: str  #: for messages
    joint: int  #: index of the joint that carries it
    mass: float  #: m₀ [kg]
    least: float  #: bound of the mass from below [kg]
    most: float  #: bound of the mass from above [kg]
    centre: tuple[float, float, float]  #: centre of mass s in the frame that moves with the joint [m]
    radius: float = 0.0  #: R, how far from it the centre of mass may lie [m]

    @classmethod
    def within(
        cls,
        name: str,
        joint: int,
        mass: float,
        centre: tuple[float, float, float],
        *,
        relative: float = STATED_BY_DEFAULT,
        radius: float = 0.0,
    ) -> Body:
        """Return a body whose mass is known to a relative half-width; 0 for exactly."""
        return cls(name, joint, mass, (1.0 - relative) * mass, (1.0 + relative) * mass, centre, radius)


class Robot:
    """A chain with joint map and bodies, and what its kinematics are computed from. Take it as read-only."""

    chain: KinematicChain  #: the kinematics
    joint_map: JointMap  #: from controller to model angles
    bodies: tuple[Body, ...]  #: with their masses, where they are stated
    flange_placement: pin.SE3  #: of the flange frame in the frame of the last moving joint [m]
    axes: FloatArray  #: (n, 3) unit vectors, each in the frame that moves with its joint
    #: (3, n, 3, 4) terms of the placement ``[R t]`` of each such frame in the one before: it is ``terms[0]
    #: + sin(q) terms[1] + cos(q) terms[2]`` (Rodrigues), lengths in m; of a prismatic joint terms[0] alone
    joint_terms: FloatArray
    prismatic: BoolArray  #: (n,) which joints slide along their axes; the others turn about them
    slides: FloatArray  #: (n, 3) motion of such a frame in the one before by one m; zero of a revolute joint
    n: int  #: number of moving joints
    joint_names: tuple[str, ...]  #: names of the moving joints, from the base on
    joint_kinds: tuple[JointKind, ...]  #: their kinds, in the same order
    limits: FloatArray  #: (n, 2) least and greatest positions of the model [rad or m]; ∓inf for no limit

    def __init__(
        self, chain: KinematicChain, joint_map: JointMap | None = None, bodies: tuple[Body, ...] = ()
    ) -> None:
        """Place the frames joint by joint.

        Args:
            chain: the kinematics, n moving joints.
            joint_map: n joints; the identity if absent.
            bodies: with their masses; they change no kinematics.

        Raises:
            RobotError: the joint map is for another number of joints.
        """
        moving = chain.moving
        n = self.n = len(moving)
        self.chain, self.bodies, self.joint_names = chain, bodies, chain.joint_names
        self.joint_map = JointMap.identity(n) if joint_map is None else joint_map
        if self.joint_map.n != n:
            raise RobotError(
                f"the joint map has {self.joint_map.n} joints, but the robot has {n}",
                remedy=f"give a {n} × {n} matrix and {n} offsets",
                where="joint_map.matrix",
            )
        self.axes = np.array([joint.axis for joint in moving])
        self.joint_terms, self.slides = np.zeros((3, n, 3, 4)), np.zeros((n, 3))
        parent, placement = 0, pin.SE3.Identity()  # R0
        for joint in chain.joints:
            placement = placement * pin.SE3(joint.rotation, joint.translation)
            if joint.is_moving:
                # [P(I + K²) p], [PK 0] and [-PK² 0], by ``exp(q K) = I + sin(q) K + (1 - cos(q)) K²``
                still, sine, cosine = self.joint_terms[:, parent]
                if joint.kind == "prismatic":
                    self.slides[parent] = placement.rotation @ joint.axis
                else:
                    K = pin.skew(joint.axis)
                    sine[:, :3] = placement.rotation @ K
                    cosine[:, :3] = -sine[:, :3] @ K
                still[:, :3] = placement.rotation - cosine[:, :3]
                still[:, 3] = placement.translation
                parent, placement = parent + 1, pin.SE3.Identity()  # in the last moving joint
        self.flange_placement = placement
        self.joint_kinds = chain.joint_kinds
        self.prismatic = np.array([kind == "prismatic" for kind in self.joint_kinds])
        limits = np.array([joint.limits or (-UNLIMITED, UNLIMITED) for joint in moving])
        self.limits = np.where(np.abs(limits) >= UNLIMITED, np.copysign(np.inf, limits), limits)
        self.limits.setflags(write=False)

    def by_kind(self, turning: float, sliding: float) -> FloatArray:
        """Return a number for each joint (n,): one of angles, one of the lengths of prismatic joints."""
        return np.where(self.prismatic, sliding, turning)

    def within_limits(self, joints: FloatArray) -> BoolArray:
        """Return which postures (N, n) of the controller lie within the limits of the model's joints (N,)."""
        model = self.joint_map.model_angles(joints)
        inside = (model >= self.limits[:, 0] - _ROUNDING) & (model <= self.limits[:, 1] + _ROUNDING)
        return np.asarray(inside.all(axis=1), dtype=np.bool_)

    def in_whole_units(self, joints: FloatArray) -> FloatArray:
        """Return positions (N, n) [rad or m] in whole degrees, and in whole mm of prismatic joints."""
        degrees: FloatArray = np.radians(np.round(np.degrees(joints)))
        return np.where(self.prismatic, np.round(joints * 1e3) / 1e3, degrees)


def standing_still(robot: Robot, held: FloatArray) -> Robot:
    """Return the robot without its prismatic joints, which stand where the controller shows them.

    Args:
        robot: n joints.
        held: (n,) as the controller shows them; those of the revolute joints do not matter.

    Raises:
        RobotError: no joint is left, or a prismatic one moves with others of the controller.
    """
    matrix, offset, slides = robot.joint_map.matrix, robot.joint_map.offset, robot.prismatic
    if matrix[np.ix_(slides, ~slides)].any():
        raise RobotError(
            "a linear axis moves with a rotary axis of the controller, so it cannot stand still",
            remedy="give a joint map whose rows of prismatic joints have entries of such joints only",
            where="joint_map.matrix",
        )
    by_held = matrix[:, slides] @ held[slides] + offset
    places = iter(by_held[slides].tolist())
    joints = tuple(
        replace(
            joint,
            kind="fixed",
            translation=joint.translation + next(places) * (joint.rotation @ joint.axis),
            limits=None,
        )
        if joint.kind == "prismatic"
        else joint
        for joint in robot.chain.joints
    )
    joint_map = JointMap(matrix[np.ix_(~slides, ~slides)], by_held[~slides])
    return Robot(replace(robot.chain, joints=joints), joint_map)


def displaced_axis(robot: Robot, joint: int, translation: FloatArray, turn: FloatArray) -> Robot:
    """Return the robot with one axis moved.

    At model position zero all other axes and the flange stay in place.

    Args:
        robot: n joints.
        joint: index of the moving joint.
        translation: (3,) of the axis, axes of the joint's frame [m].
        turn: (3,) rotation vector of the axis about the origin of the joint's frame, its axes [rad].
    """
    place = robot.chain.joints.index(robot.chain.moving[joint])
    own = robot.chain.joints[place]
    rotation: FloatArray = Rotation.from_rotvec(turn).as_matrix()
    moved = replace(
        own,
        rotation=own.rotation @ rotation,
        translation=own.translation + own.rotation @ translation,
    )
    # A fixed joint that carries the flange of a chain that ends with a moving joint
    behind = robot.chain.joints[place + 1 :] or (
        ChainJoint(_NAME, "fixed", np.eye(3), np.zeros(3), np.array([0.0, 0.0, 1.0]), None, own.child),
    )
    if behind[0].name == _NAME:
        moved = replace(moved, child=_NAME)
    back = replace(
        behind[0],
        rotation=rotation.T @ behind[0].rotation,
        translation=rotation.T @ (behind[0].translation - translation),
    )
    return Robot(
        replace(robot.chain, joints=(*robot.chain.joints[:place], moved, back, *behind[1:])), robot.joint_map
    )
