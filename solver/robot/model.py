"""A robot ready for computation: Pinocchio's model of a checked chain, and its joint map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import MAX_MOVING_JOINTS, UNLIMITED_ANGLE, FloatArray, KinematicChain

__all__ = ["LARGEST_MAP_ENTRY", "WORST_CONDITION", "JointMap", "Robot"]

LARGEST_MAP_ENTRY = 1e3
"""Largest entry of a joint map's matrix [rad/rad] or offset [rad]."""

WORST_CONDITION = 1e8
"""Condition number of a joint map's matrix above which it counts as singular."""


@dataclass(frozen=True, eq=False)
class JointMap:
    """How the model's angles follow from the controller's: q = M q_c + o (METHOD.md §1).

    Arrays are copied and read-only.

    Attributes:
        matrix: M (n, n), dimensionless.
        offset: o (n,) [rad].

    Raises:
        RobotError: a matrix that is not square, not of the offset's size, not finite, absurdly
            large, or singular.
    """

    matrix: FloatArray
    offset: FloatArray

    def __post_init__(self) -> None:
        matrix = _frozen(self.matrix, 2, "joint_map.matrix")
        offset = _frozen(self.offset, 1, "joint_map.offset")
        n = len(offset)
        if not 1 <= n <= MAX_MOVING_JOINTS or matrix.shape != (n, n):
            raise RobotError(
                f"a matrix of shape {matrix.shape} with an offset of {n} numbers",
                remedy=f"give an n × n matrix and n offsets, n the number of moving joints, "
                f"at most {MAX_MOVING_JOINTS}",
                where="joint_map.matrix",
            )
        _check_invertible(matrix)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "offset", offset)

    @classmethod
    def identity(cls, n: int) -> JointMap:
        """Return the map of a controller that counts as the model does, for n joints."""
        return cls(np.eye(n), np.zeros(n))

    @classmethod
    def from_rows(cls, matrix: Sequence[Sequence[float]], offset: Sequence[float]) -> JointMap:
        """Return the map with these rows, which may come from a stranger.

        Raises:
            RobotError: rows of different lengths, or what the class refuses.
        """
        lengths = {len(row) for row in matrix}
        if lengths != {len(matrix)}:
            raise RobotError(
                f"{len(matrix)} rows of {' or '.join(map(str, sorted(lengths))) or 'no'} numbers",
                remedy="give as many rows as each row has numbers",
                where="joint_map.matrix",
            )
        return cls(np.array(matrix, dtype=np.float64), np.array(offset, dtype=np.float64))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.offset)

    def model_angles(self, controller: FloatArray) -> FloatArray:
        """Map the controller's angles (N, n) to the model's (N, n), both in rad."""
        angles: FloatArray = controller @ self.matrix.T + self.offset
        return angles


class Robot:
    """A chain with Pinocchio's model of it. Take the model as read-only.

    Joint i of the chain is joint i + 1 of the model, with one coordinate; link inertias are zero.
    The model's world frame is R0, the frame of the chain's base link.

    Attributes:
        chain: the kinematics.
        joint_map: from controller to model angles.
        model: `pinocchio.Model` with nq = nv = n.
        flange_joint_id: index in the model of the last moving joint.
        flange_placement: `pinocchio.SE3` of the flange frame in the frame of that joint [m].
    """

    chain: KinematicChain
    joint_map: JointMap
    model: pin.Model
    flange_joint_id: int
    flange_placement: pin.SE3

    def __init__(self, chain: KinematicChain, joint_map: JointMap | None = None) -> None:
        """Build the model.

        Args:
            chain: the kinematics, n moving joints.
            joint_map: n joints; the identity if absent.

        Raises:
            RobotError: the joint map is for another number of joints, or Pinocchio understands the
                chain in another way than we do.
        """
        n = len(chain.revolute)
        self.chain = chain
        self.joint_map = JointMap.identity(n) if joint_map is None else joint_map
        if self.joint_map.n != n:
            raise RobotError(
                f"the joint map is for {self.joint_map.n} joints, the robot has {n}",
                remedy=f"give a {n} × {n} matrix and {n} offsets",
                where="joint_map.matrix",
            )
        self.model = _build_model(chain)
        flange = self.model.frames[_flange_frame(self.model, chain.flange)]
        self.flange_joint_id = int(flange.parentJoint)
        self.flange_placement = pin.SE3(flange.placement)

    @property
    def n(self) -> int:
        """Number of moving joints."""
        return len(self.chain.revolute)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the moving joints, from the base on."""
        return self.chain.joint_names

    @property
    def limits(self) -> FloatArray:
        """Least and greatest model angles (n, 2) [rad]; ∓inf where there is no limit."""
        limits = np.array(
            [joint.limits or (-UNLIMITED_ANGLE, UNLIMITED_ANGLE) for joint in self.chain.revolute]
        )
        return np.where(np.abs(limits) >= UNLIMITED_ANGLE, np.copysign(np.inf, limits), limits)


def _build_model(chain: KinematicChain) -> pin.Model:
    """Let Pinocchio parse the chain's own URDF, and compare what it made of it with the chain."""
    try:
        model = pin.buildModelFromXML(chain.to_urdf())
    except (ValueError, RuntimeError) as error:
        raise _misunderstood(chain, str(error)[:200]) from error
    names = chain.joint_names
    if not model.nq == model.nv == len(names):
        raise _misunderstood(chain, f"nq = {model.nq} and nv = {model.nv} for {len(names)} joints")
    if tuple(model.names)[1:] != names or "universe" in names:
        raise _misunderstood(chain, "other joints, or one with the reserved name 'universe'")
    if list(model.parents) != [0, *range(len(names))]:
        raise _misunderstood(chain, "joints that do not follow one another")
    return model


def _flange_frame(model: pin.Model, flange: str) -> int:
    """Find the frame of the flange link; a joint may have the same name, hence the type."""
    index = int(model.getFrameId(flange, pin.FrameType.BODY))
    if index >= model.nframes:  # which is how Pinocchio says that it is unknown
        raise RobotError(
            f"Pinocchio finds no frame '{flange}'", remedy="rename the flange link", where="flange"
        )
    return index


def _misunderstood(chain: KinematicChain, what: str) -> RobotError:
    return RobotError(
        f"Pinocchio reads the chain of '{chain.name}' in another way: {what}",
        remedy="rename links and joints in plain letters; if that does not help, report it",
        where="chain",
    )


def _frozen(values: FloatArray, dimensions: int, where: str) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.ndim != dimensions or not (np.abs(array) <= LARGEST_MAP_ENTRY).all():
        raise RobotError(
            f"{array.ndim} dimensions, or a number that is not finite",
            remedy=f"give numbers within ±{LARGEST_MAP_ENTRY:g} in {dimensions} dimensions",
            where=where,
        )
    array.flags.writeable = False
    return array


def _check_invertible(matrix: FloatArray) -> None:
    singular = np.linalg.svd(matrix, compute_uv=False)  # descending
    if singular[-1] * WORST_CONDITION < max(singular[0], 1.0):
        raise RobotError(
            "the matrix is singular: different controller angles give the same model angles",
            remedy="give an invertible matrix",
            where="joint_map.matrix",
        )
