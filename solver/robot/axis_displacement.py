"""Displace one joint axis of a robot and nothing else: as its identified geometry may be off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.chain import ChainJoint, KinematicChain
from jointstiff.solver.robot.model import Robot


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
    behind = robot.chain.joints[place + 1 :] or (_flange(own),)
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


_NAME = "displaced axis"


def _flange(last: ChainJoint) -> ChainJoint:
    """Return a fixed joint that carries the flange of a chain that ends with a moving joint."""
    return ChainJoint(_NAME, "fixed", np.eye(3), np.zeros(3), np.array([0.0, 0.0, 1.0]), None, last.child)


def _orthonormal(rotation: FloatArray) -> FloatArray:
    """Return the nearest rotation: products of rotations keep within rounding of one."""
    left, _, right = np.linalg.svd(rotation)
    nearest: FloatArray = left @ right
    return nearest
