"""Convert configurations to the places of joints and flange."""

from __future__ import annotations

import numpy as np

from jointstiff.schemas.kinematics import Kinematics, Posture
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot import Configurations, Robot, joint_frames

__all__ = ["to_kinematics"]


def to_kinematics(robot: Robot, joints: list[list[float]]) -> Kinematics:
    """Return the robot in some configurations, or in that of all zeros.

    Raises:
        RequestError: a configuration that does not have as many angles as the robot has joints.
    """
    for number, angles in enumerate(joints):
        if len(angles) != robot.n:
            raise RequestError(
                f"{len(angles)} joint angles for a robot with {robot.n} joints",
                where=f"joints[{number}]",
                remedy=f"give the {robot.n} controller angles of {', '.join(robot.joint_names)}",
            )
    controller = np.array(joints or [[0.0] * robot.n], dtype=np.float64)
    q = robot.joint_map.model_angles(controller)
    configurations = Configurations(robot, q)
    _, origins = joint_frames(robot, q)
    postures = zip(
        origins.tolist(),
        configurations.angular_jacobian.transpose(0, 2, 1).tolist(),
        configurations.flange_translation.tolist(),
        configurations.flange_rotation.transpose(0, 2, 1).tolist(),
        strict=True,
    )
    return Kinematics(
        joints=list(robot.joint_names),
        postures=[
            Posture(joint_origins=joint_origins, joint_axes=axes, flange_origin=origin, flange_axes=flange)
            for joint_origins, axes, origin, flange in postures
        ],
    )
