"""Robots: a chain with its joint map and bodies, and Pinocchio's model of it, ready for computation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import MAX_MOVING_JOINTS, UNLIMITED_ANGLE, ChainJoint, KinematicChain

LARGEST_MAP_ENTRY: Final = 1e3
"""Largest entry of a joint map's matrix [rad/rad] or offset [rad]."""

WORST_CONDITION: Final = 1e8
"""Condition number of a joint map's matrix above which it counts as singular."""

STATED_BY_DEFAULT: Final = 0.2
"""Relative half-width of a mass whose uncertainty nobody states."""

_NAME: Final = "displaced axis"


@dataclass(frozen=True, eq=False)
class JointMap:
    """Map controller angles q_c to model angles q = M q_c + o (method.md §1).

    Arrays are copied and read-only.

    Raises:
        RobotError: a matrix that is not square, not of the offset's size, not finite, absurdly
            large, or singular.
    """

    matrix: FloatArray  #: M (n, n), dimensionless
    offset: FloatArray  #: o (n,) [rad]

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
        """Map controller angles (N, n) to model angles (N, n), both in rad."""
        return np.asarray(controller @ self.matrix.T + self.offset)

    def controller_angles(self, model: FloatArray) -> FloatArray:
        """Return the angles (..., n) that the controller shows [rad] of angles of the model [rad]."""
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
    """A chain with Pinocchio's model of it. Take the model as read-only.

    Joint i of the chain is joint i + 1 of the model, with one coordinate; link inertias are zero.
    The model's world frame is R0, the frame of the chain's base link.
    """

    chain: KinematicChain  #: the kinematics
    joint_map: JointMap  #: from controller to model angles
    bodies: tuple[Body, ...]  #: with their masses, where they are stated
    model: pin.Model  #: `pinocchio.Model` with nq = nv = n, and a frame of the flange's name
    flange_placement: pin.SE3  #: of the flange frame in the frame of the last moving joint [m]
    axes: FloatArray  #: (n, 3) unit vectors, each in the frame that moves with its joint
    #: (3, n, 3, 4) terms of the placement ``[R t]`` of each such frame in the one before: it is ``terms[0]
    #: + sin(q) terms[1] + cos(q) terms[2]`` (Rodrigues), lengths in m
    joint_terms: FloatArray
    n: int  #: number of moving joints
    joint_names: tuple[str, ...]  #: names of the moving joints, from the base on
    limits: FloatArray  #: (n, 2) least and greatest model angles [rad]; ∓inf where there is no limit

    def __init__(
        self, chain: KinematicChain, joint_map: JointMap | None = None, bodies: tuple[Body, ...] = ()
    ) -> None:
        """Build the model joint by joint.

        Args:
            chain: the kinematics, n moving joints.
            joint_map: n joints; the identity if absent.
            bodies: with their masses; they change no kinematics.

        Raises:
            RobotError: the joint map is for another number of joints.
        """
        moving = chain.revolute
        n = self.n = len(moving)
        self.chain, self.bodies, self.joint_names = chain, bodies, chain.joint_names
        self.joint_map = JointMap.identity(n) if joint_map is None else joint_map
        if self.joint_map.n != n:
            raise RobotError(
                f"the joint map has {self.joint_map.n} joints, but the robot has {n}",
                remedy=f"give a {n} × {n} matrix and {n} offsets",
                where="joint_map.matrix",
            )
        self.model = pin.Model()
        self.model.name = chain.name
        self.axes = np.array([joint.axis for joint in moving])
        self.joint_terms = np.zeros((3, n, 3, 4))
        parent, placement = 0, pin.SE3.Identity()  # Pinocchio's world, R0
        for joint in chain.joints:
            placement = placement * pin.SE3(joint.rotation, joint.translation)
            if joint.is_moving:
                # [P(I + K²) p], [PK 0] and [-PK² 0], by ``exp(q K) = I + sin(q) K + (1 - cos(q)) K²``
                still, sine, cosine = self.joint_terms[:, parent]
                K = pin.skew(joint.axis)
                sine[:, :3] = placement.rotation @ K
                cosine[:, :3] = -sine[:, :3] @ K
                still[:, :3] = placement.rotation - cosine[:, :3]
                still[:, 3] = placement.translation
                unaligned = pin.JointModelRevoluteUnaligned(joint.axis)
                parent = self.model.addJoint(parent, unaligned, placement, joint.name)
                placement = pin.SE3.Identity()  # in the last moving joint
        self.model.addBodyFrame(chain.flange, parent, placement, 0)
        self.flange_placement = placement
        limits = np.array([joint.limits or (-UNLIMITED_ANGLE, UNLIMITED_ANGLE) for joint in moving])
        self.limits = np.where(np.abs(limits) >= UNLIMITED_ANGLE, np.copysign(np.inf, limits), limits)
        self.limits.setflags(write=False)


def displaced_axis(robot: Robot, joint: int, translation: FloatArray, turn: FloatArray) -> Robot:
    """Return the robot with one axis moved.

    At model angle zero all other axes and the flange stay in place.

    Args:
        robot: n joints.
        joint: index of the moving joint.
        translation: (3,) of the axis, axes of the joint's frame [m].
        turn: (3,) rotation vector of the axis about the origin of the joint's frame, its axes [rad].
    """
    place = robot.chain.joints.index(robot.chain.revolute[joint])
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
