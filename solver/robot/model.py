"""Build Pinocchio's model of a chain, ready for computation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.body import Body
from jointstiff.solver.robot.chain import UNLIMITED_ANGLE, ChainJoint, KinematicChain
from jointstiff.solver.robot.joint_map import JointMap

_NAME = "displaced axis"


class Robot:
    """A chain with Pinocchio's model of it. Take the model as read-only.

    Joint i of the chain is joint i + 1 of the model, with one coordinate; link inertias are zero.
    The model's world frame is R0, the frame of the chain's base link.
    """

    chain: KinematicChain  #: the kinematics
    joint_map: JointMap  #: from controller to model angles
    bodies: tuple[Body, ...]  #: with their masses, where they are stated
    model: pin.Model  #: `pinocchio.Model` with nq = nv = n, and a frame of the flange's name
    flange_joint_id: int  #: index in the model of the last moving joint
    flange_placement: pin.SE3  #: `pinocchio.SE3` of the flange frame in the frame of that joint [m]
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
        """Build the model.

        Args:
            chain: the kinematics, n moving joints.
            joint_map: n joints; the identity if absent.
            bodies: with their masses; they change no kinematics.

        Raises:
            RobotError: the joint map is for another number of joints.
        """
        n = len(chain.revolute)
        self.chain, self.bodies = chain, bodies
        self.joint_map = JointMap.identity(n) if joint_map is None else joint_map
        if self.joint_map.n != n:
            raise RobotError(
                f"the joint map has {self.joint_map.n} joints, but the robot has {n}",
                remedy=f"give a {n} × {n} matrix and {n} offsets",
                where="joint_map.matrix",
            )
        self.model, self.flange_placement = _build_model(chain)
        self.flange_joint_id = n
        self.axes = np.array([joint.axis for joint in chain.revolute])
        # [P(I + K²) p], [PK 0] and [-PK² 0], by ``exp(q K) = I + sin(q) K + (1 - cos(q)) K²``
        terms = np.zeros((3, len(self.axes), 3, 4))
        for j, axis in enumerate(self.axes):
            placement = self.model.jointPlacements[j + 1]
            K = pin.skew(axis)
            terms[1, j, :, :3] = placement.rotation @ K
            terms[2, j, :, :3] = -terms[1, j, :, :3] @ K
            terms[0, j, :, :3] = placement.rotation - terms[2, j, :, :3]
            terms[0, j, :, 3] = placement.translation
        self.joint_terms = terms
        self.n, self.joint_names = n, chain.joint_names
        limits = np.array([joint.limits or (-UNLIMITED_ANGLE, UNLIMITED_ANGLE) for joint in chain.revolute])
        self.limits = np.where(np.abs(limits) >= UNLIMITED_ANGLE, np.copysign(np.inf, limits), limits)
        self.limits.setflags(write=False)


def _build_model(chain: KinematicChain) -> tuple[pin.Model, pin.SE3]:
    """Build the model joint by joint; return it with the flange's placement in the last moving joint."""
    model = pin.Model()
    model.name = chain.name
    parent = 0  # Pinocchio's world, R0
    placement = pin.SE3.Identity()  # in the last moving joint
    for joint in chain.joints:
        placement = placement * pin.SE3(joint.rotation, joint.translation)
        if joint.is_moving:
            revolute = pin.JointModelRevoluteUnaligned(joint.axis)
            parent = model.addJoint(parent, revolute, placement, joint.name)
            placement = pin.SE3.Identity()
    model.addBodyFrame(chain.flange, parent, placement, 0)
    return model, placement


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
        rotation=_orthonormal(own.rotation @ rotation),
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
        rotation=_orthonormal(rotation.T @ behind[0].rotation),
        translation=rotation.T @ (behind[0].translation - translation),
    )
    joints = (*robot.chain.joints[:place], moved, back, *behind[1:])
    chain = KinematicChain(robot.chain.name, robot.chain.base, robot.chain.flange, joints)
    return Robot(chain, robot.joint_map)


def _orthonormal(rotation: FloatArray) -> FloatArray:
    """Return the nearest rotation: products of rotations keep within rounding of one."""
    left, _, right = np.linalg.svd(rotation)
    nearest: FloatArray = left @ right
    return nearest
