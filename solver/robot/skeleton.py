"""Where the joints are: what it takes to draw a robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

__all__ = ["Skeleton"]


class Skeleton:
    """Joint frames and flange of N configurations, axes of R0.

    Attributes:
        origin: (N, n, 3) origins of the joints' frames, from base to flange [m].
        axis: (N, n, 3) unit vectors along the joints' axes.
        flange_rotation: (N, 3, 3) axes of the flange in R0.
        flange_translation: (N, 3) origin of the flange frame [m].
    """

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        """Compute the frames.

        Args:
            robot: n joints.
            q: (N, n) angles of the model [rad].

        Raises:
            MeasurementError: if q has another shape or is not finite.
        """
        configurations = Configurations(robot, q)
        self.axis: FloatArray = configurations.angular_jacobian.transpose(0, 2, 1)
        self.flange_rotation = configurations.flange_rotation
        self.flange_translation = configurations.flange_translation
        self.origin: FloatArray = np.empty((len(q), robot.n, 3))
        data = robot.model.createData()
        for angles, origins in zip(q, self.origin, strict=True):
            pin.forwardKinematics(robot.model, data, np.ascontiguousarray(angles, dtype=np.float64))
            for joint in range(robot.n):
                origins[joint] = data.oMi[joint + 1].translation
