"""Robots: Pinocchio's model of the kinematics, the joint map, and bodies with their masses."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import pinocchio as pin

from jointstiff.schemas.joints import JointKind
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.mechanics.chain import (
    FASTEST,
    MAX_MOVING_JOINTS,
    UNLIMITED,
    ChainJoint,
    KinematicChain,
)

_ROUNDING: Final = 1e-9
"""Part of a position [rad or m] by which it may pass a limit: rounding of documents."""
LARGEST_MAP_ENTRY: Final = 1e3
"""Largest entry of a joint map's matrix or offset, in SI units of the joints."""

WORST_CONDITION: Final = 1e8
"""Condition number of a joint map's matrix above which it counts as singular."""

STATED_BY_DEFAULT: Final = 0.2
"""Relative half-width of a mass whose uncertainty is not stated."""


@dataclass(frozen=True, eq=False)
class JointMap:
    """Map from the controller's joint positions q_c to the model's, q = M q_c + o (method.md §1).

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
                f"the matrix has shape {self.matrix.shape}, and the offset has {n} numbers",
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
        """Return the joint map of n joints whose controller angles equal the model's angles."""
        return cls(np.eye(n), np.zeros(n))

    @classmethod
    def from_rows(cls, matrix: Sequence[Sequence[float]], offset: Sequence[float]) -> JointMap:
        """Build the joint map from lists of numbers.

        Raises:
            RobotError: the rows have different lengths, or the matrix is not a valid map.
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
        """Return the model's joint positions (N, n) for the controller's positions (N, n) [rad or m]."""
        return np.asarray(controller @ self.matrix.T + self.offset)

    def controller_angles(self, model_positions: FloatArray) -> FloatArray:
        """Return the controller's joint positions (..., n) for positions of the model [rad or m]."""
        rows = (model_positions - self.offset).reshape(-1, self.n)  # all solved at once: M is factorised once
        return np.asarray(np.linalg.solve(self.matrix, rows.T)).T.reshape(model_positions.shape)


@dataclass(frozen=True)
class Body:
    """Body of a robot with mass and centre of mass, and bounds of both."""

    name: str  #: name in messages
    joint: int  #: index of the joint that carries it
    mass: float  #: m₀ [kg]
    least: float  #: lower bound of the mass [kg]
    most: float  #: upper bound of the mass [kg]
    centre: tuple[float, float, float]  #: centre of mass s in the frame that moves with the joint [m]
    radius: float = 0.0  #: R, how far the true centre of mass may be from `centre` [m]

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
        """Return a body whose mass is within ``(1 ± relative) mass``; `relative` 0 means an exact mass."""
        return cls(name, joint, mass, (1.0 - relative) * mass, (1.0 + relative) * mass, centre, radius)


class Robot:
    """Serial arm: Pinocchio's model, the joint map, and bodies. All attributes are read-only.

    `model` alone defines the kinematics: Jacobians, frames and torques of weights are computed from it by
    Pinocchio. Its universe is R0. Positions of its joints (n,) are in rad or m, by their kinds.
    """

    model: pin.Model  #: n joints in one line, each about or along one axis
    joint_map: JointMap  #: from controller to model angles
    bodies: tuple[Body, ...]  #: with their masses, where they are stated
    payload: float | None  #: largest payload by the maker [kg]; None if unknown
    flange: str  #: name of the frame of `model` that is the flange
    flange_placement: pin.SE3  #: of the flange frame in the frame of the last joint [m]
    n: int  #: number of joints
    joint_names: tuple[str, ...]  #: from the base on
    joint_kinds: tuple[JointKind, ...]  #: in the same order
    prismatic: BoolArray  #: (n,) which joints slide along their axes; the others turn about them
    axes: FloatArray  #: (n, 3) unit vectors, each in the frame that moves with its joint
    limits: FloatArray  #: (n, 2) least and greatest positions of the model [rad or m]; ∓inf for no limit
    speeds: (
        FloatArray  #: (n,) greatest speeds of the model's joints by the maker [rad/s or m/s]; NaN if unknown
    )

    def __init__(
        self,
        model: pin.Model,
        joint_map: JointMap | None = None,
        bodies: tuple[Body, ...] = (),
        *,
        flange: str | None = None,
        payload: float | None = None,
    ) -> None:
        """Read names, kinds, axes and limits from the model.

        Args:
            model: n joints, each carrying the next; the model is not copied.
            joint_map: map of n joints; None for the identity.
            bodies: bodies with their masses; they do not affect the kinematics.
            flange: name of the flange frame, behind the last joint; None for the only frame at the end.
            payload: largest payload by the maker [kg]; None if unknown.

        Raises:
            RobotError: the model branches, has no joint or an unsupported joint, the flange is not a frame
                behind the last joint, or the joint map has another number of joints.
        """
        if list(model.parents)[1:] != list(range(model.njoints - 1)):
            raise RobotError(
                "the kinematic model branches",
                where="robot",
                remedy="reduce the model to the arm: pinocchio.buildReducedModel",
            )
        n = self.n = model.njoints - 1
        if not 1 <= n <= MAX_MOVING_JOINTS:
            raise RobotError(
                f"the model has {n} joints",
                where="robot",
                remedy=f"give a model of 1 to {MAX_MOVING_JOINTS} joints",
            )
        self.model, self.bodies, self.joint_names = model, bodies, tuple(model.names)[1:]
        self.payload = payload
        self.joint_map = JointMap.identity(n) if joint_map is None else joint_map
        if self.joint_map.n != n:
            raise RobotError(
                f"the joint map has {self.joint_map.n} joints, but the robot has {n}",
                remedy=f"give a {n} × {n} matrix and {n} offsets",
                where="joint_map.matrix",
            )
        self.joint_kinds, axes = zip(*(_read_kind_and_axis(model, i) for i in range(1, n + 1)), strict=True)
        self.axes = np.array(axes)
        self.prismatic = np.array([kind == "prismatic" for kind in self.joint_kinds])
        self.limits = np.array([_read_limits(model, i) for i in range(1, n + 1)])
        self.limits.setflags(write=False)
        self.speeds = np.array([_read_speed(model, i) for i in range(1, n + 1)])
        self.speeds.setflags(write=False)
        self._flange_frame = frame = _find_flange_frame(model, flange)
        self.flange, self.flange_placement = frame.name, frame.placement

    def with_payload(self, payload: float | None) -> Robot:
        """Return a copy with another payload [kg]; this object if it has this payload already."""
        if payload == self.payload:
            return self
        robot = copy(self)
        robot.payload = payload
        return robot

    def with_speeds(self, speeds: FloatArray) -> Robot:
        """Return a copy with other greatest speeds (n,) of the joints [rad/s or m/s]; NaN if unknown."""
        robot = copy(self)
        robot.speeds = speeds.copy()
        robot.speeds.setflags(write=False)
        return robot

    def joint_index(self, name: str, where: str) -> int:
        """Return the index of the joint with this name; `where` is the request's field, for the error.

        Raises:
            RequestError: the robot has no joint of this name.
        """
        if name not in self.joint_names:
            raise RequestError(
                f"the robot has no joint '{name}'",
                where=where,
                remedy=f"use one of {', '.join(self.joint_names)}",
            )
        return self.joint_names.index(name)

    @cached_property
    def chain(self) -> KinematicChain:
        """Return the kinematic chain for files: the joints of the model, and a fixed joint to the flange.

        Raises:
            RobotError: a name of the model is unfit for a file.
        """
        frames, body = self.model.frames.tolist(), pin.FrameType.BODY
        links = {frame.parentJoint: frame.name for frame in reversed(frames) if frame.type == body}
        if self.flange == links.get(self.n) and not self.flange_placement.isIdentity(0.0):
            # The only link frame behind the last joint is the flange, which gets a fixed joint of its own.
            del links[self.n]
        joints, moving = [], zip(self.joint_names, self.joint_kinds, self.axes, strict=True)
        for i, (name, kind, axis) in enumerate(moving):
            place, (lower, upper) = self.model.jointPlacements[i + 1], self.limits[i].tolist()
            unlimited = lower == -np.inf and upper == np.inf
            limits = None if unlimited else (max(lower, -UNLIMITED), min(upper, UNLIMITED))
            link = links.get(i + 1, f"{name}_link")
            speed = None if np.isnan(self.speeds[i]) else float(self.speeds[i])
            joints.append(
                ChainJoint(name, kind, place.rotation, place.translation, axis, limits, link, speed)
            )
        if joints[-1].child != self.flange:
            place, fixed = self.flange_placement, frames[self._flange_frame.parentFrame]
            name = fixed.name if fixed.type == pin.FrameType.FIXED_JOINT else "to_flange"
            z = np.array([0.0, 0.0, 1.0])
            joints.append(ChainJoint(name, "fixed", place.rotation, place.translation, z, None, self.flange))
        return KinematicChain(self.model.name or "robot", links.get(0, "base"), self.flange, tuple(joints))

    def select_by_kind(self, turning: float, sliding: float) -> FloatArray:
        """Return an array (n,): `turning` for each revolute joint, `sliding` for each prismatic joint."""
        return np.where(self.prismatic, sliding, turning)

    def within_limits(self, joints: FloatArray) -> BoolArray:
        """Return a mask (N,) of the postures within the joint limits.

        `joints` (N, n) are the positions that the controller shows [rad or m].
        """
        model_angles = self.joint_map.model_angles(joints)
        is_inside = (model_angles >= self.limits[:, 0] - _ROUNDING) & (
            model_angles <= self.limits[:, 1] + _ROUNDING
        )
        return np.asarray(is_inside.all(axis=1), dtype=np.bool_)

    def round_to_whole_units(self, joints: FloatArray) -> FloatArray:
        """Return joint positions (N, n) [rad or m] rounded to whole degrees, or to whole mm if prismatic."""
        degrees: FloatArray = np.radians(np.round(np.degrees(joints)))
        return np.where(self.prismatic, np.round(joints * 1e3) / 1e3, degrees)


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """Robot that may have been measured in place of the chosen robot."""

    name: str  #: name of the robot
    robot: Robot  #: model of the robot
    identifier: str | None = None  #: id of the stored robot; None for an arm of the catalogue


def _read_kind_and_axis(model: pin.Model, index: int) -> tuple[JointKind, FloatArray]:
    """Return the kind of a joint of one degree of freedom, and its axis (3,) in its frame.

    Raises:
        RobotError: the joint does not move about or along a single axis.
    """
    joint, motion = model.joints[index], np.zeros(6)
    if joint.nv == 1:
        data = joint.createData()
        joint.calc(data, pin.neutral(model), np.zeros(model.nv))
        motion = np.ravel(data.S)
    kinds: dict[JointKind, FloatArray] = {"prismatic": motion[:3], "revolute": motion[3:]}
    axes_of_motion = [(kind, axis) for kind, axis in kinds.items() if axis.any()]
    if len(axes_of_motion) != 1:
        raise RobotError(
            f"the joint '{model.names[index]}' is a {joint.shortname()}",
            where="robot",
            remedy="only joints about or along one axis are supported: fix all other joints",
        )
    kind, axis = axes_of_motion[0]
    return kind, axis / np.linalg.norm(axis)


def _read_limits(model: pin.Model, index: int) -> tuple[float, float]:
    """Return the least and greatest position of a joint [rad or m]; infinite without a limit."""
    joint = model.joints[index]
    if joint.nq != 1:  # Pinocchio states an unbounded angle as its cosine and sine
        return -np.inf, np.inf
    lower = float(model.lowerPositionLimit[joint.idx_q])
    upper = float(model.upperPositionLimit[joint.idx_q])
    return lower if lower > -UNLIMITED else -np.inf, upper if upper < UNLIMITED else np.inf


def _read_speed(model: pin.Model, index: int) -> float:
    """Return the greatest speed of a joint [rad/s or m/s]; NaN if the model states none."""
    speed = float(model.velocityLimit[model.joints[index].idx_v])
    return speed if 0.0 < speed < FASTEST else float("nan")


def _find_flange_frame(model: pin.Model, flange: str | None) -> pin.Frame:
    """Return the flange frame: the frame of the given name, the only tip, or the last joint's own frame.

    A tip is a frame behind the last joint to which no other frame is attached.

    Raises:
        RobotError: no frame of that name is behind the last joint, or there are several candidates.
    """
    behind = [
        (number, frame)
        for number, frame in enumerate(model.frames)
        if frame.parentJoint == model.njoints - 1 and frame.type != pin.FrameType.JOINT
    ]
    parents = {frame.parentFrame for _, frame in behind}
    # Candidates: without a name, all tips; with a name, the frames of that name.
    candidates = [frame for number, frame in behind if number not in parents and flange is None]
    candidates += [
        frame for _, frame in behind if frame.name == flange and frame.type != pin.FrameType.FIXED_JOINT
    ]
    if len(candidates) == 1:
        return candidates[0]
    if behind or flange is not None:
        raise RobotError(
            f"the robot has no frame '{flange}' behind the last joint"
            if flange
            else "the robot has several frames that may be the flange",
            where="flange",
            remedy=f"use one of {', '.join(frame.name for _, frame in behind)}",
        )
    last = model.njoints - 1
    return pin.Frame(f"{model.names[last]}_link", last, pin.SE3.Identity(), pin.FrameType.BODY)


def in_configuration_space(model: pin.Model, q: FloatArray) -> FloatArray:
    """Return Pinocchio's configurations (N, nq) for joint positions q (N, n) [rad or m].

    Pinocchio states an unbounded angle by two numbers, its cosine and sine.
    """
    if model.nq == model.nv:
        return q
    neutral = pin.neutral(model)
    return np.array([pin.integrate(model, neutral, each) for each in q])


def copy_with_weights(
    model: pin.Model, mass: FloatArray, centre: FloatArray, gravity: FloatArray
) -> pin.Model:
    """Return a copy of the model with masses (n,) [kg], centres of mass (n, 3) [m], and gravity (3,) [m/s²].

    The centres are in the frames that move with the joints. Moments of inertia are zero, as only postures at
    rest are computed.
    """
    model = model.copy()
    for i, (each, place) in enumerate(zip(mass, centre, strict=True), 1):
        model.inertias[i] = pin.Inertia(float(each), place, np.zeros((3, 3)))
    model.gravity.linear = gravity
    return model


def fix_prismatic_joints(robot: Robot, fixed_positions: FloatArray) -> Robot:
    """Return the robot with its prismatic joints fixed at given positions.

    Args:
        robot: n joints.
        fixed_positions: (n,) controller's joint positions [rad or m], used only for prismatic joints.

    Raises:
        RobotError: all joints are prismatic, or a prismatic joint also depends on a revolute joint of the
            controller.
    """
    matrix = robot.joint_map.matrix
    offset = robot.joint_map.offset
    prismatic = robot.prismatic
    if matrix[np.ix_(prismatic, ~prismatic)].any():
        raise RobotError(
            "a linear axis moves with a rotary axis of the controller, so the linear axis cannot stand still",
            remedy="give a joint map in which prismatic joints depend on prismatic joints only",
            where="joint_map.matrix",
        )
    offset_with_fixed = matrix[:, prismatic] @ fixed_positions[prismatic] + offset
    fixed_configuration = in_configuration_space(
        robot.model, np.where(prismatic, offset_with_fixed, 0.0)[None]
    )[0]
    fixed_joints = (np.flatnonzero(prismatic) + 1).tolist()
    joint_map = JointMap(matrix[np.ix_(~prismatic, ~prismatic)], offset_with_fixed[~prismatic])
    return Robot(
        pin.buildReducedModel(_add_frames(robot), fixed_joints, fixed_configuration),
        joint_map,
        flange=robot.flange,
        payload=robot.payload,
    )


def _add_frames(robot: Robot) -> pin.Model:
    """Return a copy of the model with frames of all joints and the flange, as `buildReducedModel` needs."""
    model = robot.model.copy()
    for i, name in enumerate(robot.joint_names, 1):
        if not model.existFrame(name, pin.FrameType.JOINT):
            model.addJointFrame(i)
    if not model.existFrame(robot.flange):
        model.addFrame(pin.Frame(robot.flange, robot.n, robot.flange_placement, pin.FrameType.OP_FRAME))
    return model
