"""Robots: Pinocchio's model of the kinematics, the joint map, and bodies with their masses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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
            is_valid = np.abs(array) <= LARGEST_MAP_ENTRY  # false for NaN
            if not is_valid.all():
                raise RobotError(
                    "a number is not finite, or too large",
                    remedy=f"give numbers within ±{LARGEST_MAP_ENTRY:g}",
                    where=f"joint_map.{field}",
                )
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        n = self.offset.size
        shapes_agree = self.offset.shape == (n,) and self.matrix.shape == (n, n)
        if not shapes_agree or not 1 <= n <= MAX_MOVING_JOINTS:
            raise RobotError(
                f"the matrix has shape {self.matrix.shape}, and the offset has {n} numbers",
                remedy="give an n × n matrix and n offsets; n is the number of moving joints, at most "
                f"{MAX_MOVING_JOINTS}",
                where="joint_map.matrix",
            )
        singular_values = np.linalg.svd(self.matrix, compute_uv=False)  # descending
        greatest, least = singular_values[0], singular_values[-1]
        if least * WORST_CONDITION < max(greatest, 1.0):
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
        lengths = sorted({len(row) for row in matrix})
        is_square = lengths == [len(matrix)]
        if not is_square:
            lengths_text = " or ".join(str(length) for length in lengths) or "no"
            raise RobotError(
                f"the matrix has {len(matrix)} rows of {lengths_text} numbers",
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
        # Solve M q_c = q − o for all positions at once, the columns of the right-hand side.
        right_sides = (model_positions - self.offset).reshape(-1, self.n).T
        solutions = np.asarray(np.linalg.solve(self.matrix, right_sides))
        return solutions.T.reshape(model_positions.shape)


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
        least, most = (1.0 - relative) * mass, (1.0 + relative) * mass
        return cls(name, joint, mass, least, most, centre, radius)


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
    #: lists the robots that the description means if it was mistaken; empty without such a list
    list_misreadings: Callable[[], Iterable[KnownRobot]] = tuple

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
        n = model.njoints - 1  # Pinocchio counts the universe as joint 0
        parents = list(model.parents)[1:]
        is_a_chain = parents == list(range(n))
        if not is_a_chain:
            raise RobotError(
                "the kinematic model branches",
                where="robot",
                remedy="reduce the model to the arm: pinocchio.buildReducedModel",
            )
        if not 1 <= n <= MAX_MOVING_JOINTS:
            raise RobotError(
                f"the model has {n} joints",
                where="robot",
                remedy=f"give a model of 1 to {MAX_MOVING_JOINTS} joints",
            )
        self.model, self.bodies, self.payload, self.n = model, bodies, payload, n
        self.joint_names = tuple(model.names)[1:]
        self.joint_map = JointMap.identity(n) if joint_map is None else joint_map
        if self.joint_map.n != n:
            raise RobotError(
                f"the joint map has {self.joint_map.n} joints, but the robot has {n}",
                remedy=f"give a {n} × {n} matrix and {n} offsets; or, if the arm has "
                f"{self.joint_map.n} joints, " + describe_other_count(self.joint_map.n, n),
                where="joint_map.matrix",
            )
        numbers = range(1, n + 1)  # of the joints in Pinocchio's model
        kinds_and_axes = [_read_kind_and_axis(model, i) for i in numbers]
        self.joint_kinds = tuple(kind for kind, _ in kinds_and_axes)
        self.axes = np.array([axis for _, axis in kinds_and_axes])
        self.prismatic = np.array([kind == "prismatic" for kind in self.joint_kinds])
        self.limits = np.array([_read_limits(model, i) for i in numbers])
        self.limits.setflags(write=False)
        self.speeds = np.array([_read_speed(model, i) for i in numbers])
        self.speeds.setflags(write=False)
        self._flange_frame = _find_flange_frame(model, flange)
        self.flange, self.flange_placement = self._flange_frame.name, self._flange_frame.placement

    @property
    def reach_bound(self) -> float:
        """Upper bound of the flange's distance from the origin of R0 [m]; inf for a slide without limits."""
        placements = [self.model.jointPlacements[i] for i in range(1, self.n + 1)] + [self.flange_placement]
        lengths = sum(float(np.linalg.norm(each.translation)) for each in placements)
        strokes = np.abs(self.limits[self.prismatic]).max(axis=1)
        return lengths + float(strokes.sum())

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
        frames = self.model.frames.tolist()
        link_names = dict[int, str]()  # by the number of the joint that moves the link; 0 for the base
        for frame in frames:
            if frame.type == pin.FrameType.BODY:
                link_names.setdefault(frame.parentJoint, frame.name)
        if self.flange == link_names.get(self.n) and not self.flange_placement.isIdentity(0.0):
            # The only link frame behind the last joint is the flange, which gets a fixed joint of its own.
            del link_names[self.n]
        joints = list[ChainJoint]()
        for joint, name in enumerate(self.joint_names):
            link = link_names.get(joint + 1, f"{name}_link")
            joints.append(self._describe_joint(joint, link))
        if joints[-1].child != self.flange:
            place, parent = self.flange_placement, frames[self._flange_frame.parentFrame]
            name = parent.name if parent.type == pin.FrameType.FIXED_JOINT else "to_flange"
            z = np.array([0.0, 0.0, 1.0])
            joints.append(ChainJoint(name, "fixed", place.rotation, place.translation, z, None, self.flange))
        base = link_names.get(0, "base")
        return KinematicChain(self.model.name or "robot", base, self.flange, tuple(joints))

    def _describe_joint(self, joint: int, link: str) -> ChainJoint:
        """Return a moving joint as files state it; `link` is the name of the link that it moves."""
        speed = float(self.speeds[joint])
        place = self.model.jointPlacements[joint + 1]  # in the frame of the joint before
        lower, upper = self.limits[joint].tolist()
        has_limits = lower > -np.inf or upper < np.inf
        return ChainJoint(
            name=self.joint_names[joint],
            kind=self.joint_kinds[joint],
            rotation=place.rotation,
            translation=place.translation,
            axis=self.axes[joint],
            limits=(max(lower, -UNLIMITED), min(upper, UNLIMITED)) if has_limits else None,
            child=link,
            speed=None if np.isnan(speed) else speed,
        )

    def select_by_kind(self, turning: float, sliding: float) -> FloatArray:
        """Return an array (n,): `turning` for each revolute joint, `sliding` for each prismatic joint."""
        return np.where(self.prismatic, sliding, turning)

    def within_limits(self, joints: FloatArray) -> BoolArray:
        """Return a mask (N,) of the postures within the joint limits.

        `joints` (N, n) are the positions that the controller shows [rad or m].
        """
        positions = self.joint_map.model_angles(joints)  # limits are those of the model
        least, greatest = self.limits[:, 0] - _ROUNDING, self.limits[:, 1] + _ROUNDING
        is_inside = (positions >= least) & (positions <= greatest)
        return np.asarray(is_inside.all(axis=1), dtype=np.bool_)

    def round_to_whole_units(self, joints: FloatArray) -> FloatArray:
        """Return joint positions (N, n) [rad or m] rounded to whole degrees, or to whole mm if prismatic."""
        degrees: FloatArray = np.radians(np.round(np.degrees(joints)))
        return np.where(self.prismatic, np.round(joints * 1e3) / 1e3, degrees)


def describe_other_count(arm: int, model: int) -> str:
    """Return what to change in a model of `model` joints that describes an arm of `arm` joints."""
    if model > arm:
        return (
            "remove the row or joint of the model that is no joint of the arm: a tool is not a joint, and "
            "its length belongs to the load point and to the places of targets"
        )
    return "add the missing row or joint to the model: a DH table has one row for each joint of the arm"


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """Robot that may have been measured in place of the chosen robot."""

    name: str  #: name of the robot
    robot: Robot  #: model of the robot
    identifier: str | None = None  #: id of the stored robot; None for an arm of the catalogue
    #: what to do if this robot was measured; empty if the robot can be chosen by its name
    remedy: str = ""


def _read_kind_and_axis(model: pin.Model, index: int) -> tuple[JointKind, FloatArray]:
    """Return the kind of a joint of one degree of freedom, and its axis (3,) in its frame.

    Raises:
        RobotError: the joint does not move about or along a single axis.
    """
    joint = model.joints[index]
    motion = np.zeros(6)  # at unit speed: linear, then angular velocity
    if joint.nv == 1:
        data = joint.createData()
        joint.calc(data, pin.neutral(model), np.zeros(model.nv))
        motion = np.ravel(data.S)
    linear, angular = motion[:3], motion[3:]
    slides, turns = bool(linear.any()), bool(angular.any())
    if slides == turns:  # both, as a screw does, or a joint of several degrees of freedom
        raise RobotError(
            f"the joint '{model.names[index]}' is a {joint.shortname()}",
            where="robot",
            remedy="only joints about or along one axis are supported: fix all other joints",
        )
    if slides:
        return "prismatic", linear / np.linalg.norm(linear)
    return "revolute", angular / np.linalg.norm(angular)


def _read_limits(model: pin.Model, index: int) -> tuple[float, float]:
    """Return the least and greatest position of a joint [rad or m]; infinite without a limit."""
    joint = model.joints[index]
    if joint.nq != 1:  # Pinocchio states an unbounded angle as its cosine and sine
        return -np.inf, np.inf
    lower = float(model.lowerPositionLimit[joint.idx_q])
    upper = float(model.upperPositionLimit[joint.idx_q])
    # Files state huge numbers for joints without a limit.
    has_lower, has_upper = lower > -UNLIMITED, upper < UNLIMITED
    return lower if has_lower else -np.inf, upper if has_upper else np.inf


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
    last_joint = model.njoints - 1
    frames_behind = dict[int, pin.Frame]()  # by their numbers in the model
    for number, frame in enumerate(model.frames):
        if frame.parentJoint == last_joint and frame.type != pin.FrameType.JOINT:
            frames_behind[number] = frame
    if flange is None:
        parents = {frame.parentFrame for frame in frames_behind.values()}
        candidates = [frame for number, frame in frames_behind.items() if number not in parents]
        problem = "the robot has several frames that may be the flange"
    else:
        named = [frame for frame in frames_behind.values() if frame.name == flange]
        candidates = [frame for frame in named if frame.type != pin.FrameType.FIXED_JOINT]
        problem = f"the robot has no frame '{flange}' behind the last joint"
    if len(candidates) == 1:
        return candidates[0]
    if frames_behind or flange is not None:
        raise RobotError(
            problem,
            where="flange",
            remedy=f"use one of {', '.join(frame.name for frame in frames_behind.values())}",
        )
    own_name = f"{model.names[last_joint]}_link"
    return pin.Frame(own_name, last_joint, pin.SE3.Identity(), pin.FrameType.BODY)


def in_configuration_space(model: pin.Model, q: FloatArray) -> FloatArray:
    """Return Pinocchio's configurations (N, nq) for joint positions q (N, n) [rad or m].

    Pinocchio states an unbounded angle by two numbers, its cosine and sine.
    """
    has_unbounded_angles = model.nq != model.nv
    if not has_unbounded_angles:
        return q
    neutral = pin.neutral(model)  # all positions zero
    return np.array([pin.integrate(model, neutral, positions) for positions in q])


def copy_with_weights(
    model: pin.Model, mass: FloatArray, centre: FloatArray, gravity: FloatArray
) -> pin.Model:
    """Return a copy of the model with masses (n,) [kg], centres of mass (n, 3) [m], and gravity (3,) [m/s²].

    The centres are in the frames that move with the joints. Moments of inertia are zero, as only postures at
    rest are computed.
    """
    model = model.copy()
    for link in range(len(mass)):
        # Pinocchio counts the universe as joint 0.
        model.inertias[link + 1] = pin.Inertia(float(mass[link]), centre[link], np.zeros((3, 3)))
    model.gravity.linear = gravity
    return model


def fix_prismatic_joints(robot: Robot, fixed_positions: FloatArray) -> Robot:
    """Return the robot of its revolute joints alone, with the prismatic joints fixed at given positions.

    Args:
        robot: n joints.
        fixed_positions: (n,) controller's joint positions [rad or m], used only for prismatic joints.

    Raises:
        RobotError: all joints are prismatic, or a prismatic joint also depends on a revolute joint of the
            controller.
    """
    matrix, offset = robot.joint_map.matrix, robot.joint_map.offset
    prismatic, revolute = robot.prismatic, ~robot.prismatic
    slides_with_rotary_axis = matrix[np.ix_(prismatic, revolute)].any()
    if slides_with_rotary_axis:
        raise RobotError(
            "a linear axis moves with a rotary axis of the controller, so the linear axis cannot stand still",
            remedy="give a joint map in which prismatic joints depend on prismatic joints only",
            where="joint_map.matrix",
        )
    # q = M q_c + o with the prismatic part of q_c fixed: the fixed part adds to the offset.
    offset_with_fixed = matrix[:, prismatic] @ fixed_positions[prismatic] + offset
    joint_map = JointMap(matrix[np.ix_(revolute, revolute)], offset_with_fixed[revolute])
    fixed_model_positions = np.where(prismatic, offset_with_fixed, 0.0)
    configuration = in_configuration_space(robot.model, fixed_model_positions[None])[0]
    fixed_joints = (np.flatnonzero(prismatic) + 1).tolist()  # Pinocchio's joint 0 is the universe
    model = pin.buildReducedModel(_add_frames(robot), fixed_joints, configuration)
    return Robot(model, joint_map, flange=robot.flange, payload=robot.payload)


def _add_frames(robot: Robot) -> pin.Model:
    """Return a copy of the model with frames of all joints and the flange, as `buildReducedModel` needs."""
    model = robot.model.copy()
    for i, name in enumerate(robot.joint_names, 1):
        if not model.existFrame(name, pin.FrameType.JOINT):
            model.addJointFrame(i)
    if not model.existFrame(robot.flange):
        model.addFrame(pin.Frame(robot.flange, robot.n, robot.flange_placement, pin.FrameType.OP_FRAME))
    return model
