"""Robots: from messages to kinematics and back."""

from __future__ import annotations

import numpy as np

from jointstiff.schemas import robot as robots
from jointstiff.solver.robot import DhRow, JointMap, KinematicChain, Robot, dh_chain, find_wrist

__all__ = ["build_robot", "describe_joints", "describe_wrist", "dh_kinematics"]


def dh_kinematics(model: robots.DhModel, name: str) -> KinematicChain:
    """The chain of a DH table.

    Raises:
        RobotError: a row that makes no robot.
    """
    rows = [DhRow(row.a, row.alpha, row.d, row.theta, row.lower, row.upper) for row in model.rows]
    return dh_chain(rows, model.convention, name)


def build_robot(chain: KinematicChain, joint_map: robots.JointMap | None) -> Robot:
    """A robot of a checked chain.

    Raises:
        RobotError: the joint map does not fit.
    """
    if joint_map is None:
        return Robot(chain)
    return Robot(chain, JointMap.from_rows(joint_map.matrix, joint_map.offset))


def describe_joints(robot: Robot) -> list[robots.Joint]:
    """The moving joints with their limits."""
    return [
        robots.Joint(
            name=name,
            lower=float(lower) if np.isfinite(lower) else None,
            upper=float(upper) if np.isfinite(upper) else None,
        )
        for name, (lower, upper) in zip(robot.joint_names, robot.limits, strict=True)
    ]


def describe_wrist(robot: Robot) -> robots.Wrist:
    """Whether the decoupled method applies."""
    wrist = find_wrist(robot)
    if wrist is None:
        return robots.Wrist(spherical=False, miss_distance=None)
    return robots.Wrist(spherical=wrist.spherical, miss_distance=wrist.miss_distance)
