"""Flange of a robot in many postures at once, by the product of exponentials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot


@dataclass(frozen=True, eq=False)
class FlangeModel:
    """Axes of a robot at zero positions of its model, in R0."""

    axes: FloatArray  #: (n, 3) unit vectors along the axes
    points: FloatArray  #: (n, 3) a point on each axis [m]
    rotation: FloatArray  #: (3, 3) from the flange frame to R0
    place: FloatArray  #: (3,) origin of the flange frame [m]
    prismatic: BoolArray  #: (n,) which joints slide

    @classmethod
    def of(cls, robot: Robot) -> FlangeModel:
        """Read the axes from the Jacobian of the robot at zero positions.

        A joint with the axis a through the point p moves the origin of R0 by the velocity v = p × a; then
        a × v is the point of the axis nearest to the origin.
        """
        zero = Postures(robot, np.zeros((1, robot.n)))
        (jacobian,), (rotation,), (place,) = zero.jacobian, zero.flange_rotation, zero.flange_translation
        linear = jacobian[:3].T  # (n, 3) velocity at the origin of R0 per unit of each joint
        angular = jacobian[3:].T  # (n, 3) angular velocity
        is_sliding = robot.prismatic[:, None]
        axes = np.where(is_sliding, linear, angular)
        points = np.where(is_sliding, 0.0, np.cross(axes, linear))
        return cls(axes, points, rotation, place, robot.prismatic)

    def place_flange(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations R (..., 3, 3) and places d (..., 3) [m] of the flange for positions q (..., n).

        The displacements ``x → rotation x + place`` by the joints are chained from base to flange, and then
        applied to the flange at zero positions. A turn about an axis is followed by the shift after which the
        point on the axis is where it was.
        """
        shape = q.shape[:-1]
        rotation: FloatArray = np.broadcast_to(np.eye(3), (*shape, 3, 3))
        place: FloatArray = np.zeros((*shape, 3))
        for joint, axis in enumerate(self.axes):
            position = q[..., joint]  # angle [rad], or length [m] of a prismatic joint
            if self.prismatic[joint]:
                place = place + position[..., None] * (rotation @ axis)
            else:
                turn, point = _turn_about(axis, position), self.points[joint]
                shift = point - turn @ point
                place = place + (rotation @ shift[..., None])[..., 0]
                rotation = rotation @ turn
        return rotation @ self.rotation, place + rotation @ self.place


def _turn_about(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Return the rotations (..., 3, 3) about a unit vector by angles (...) [rad], by Rodrigues' formula."""
    cross = build_cross_matrix(axis)
    sine = np.sin(angle)[..., None, None]
    versine = 1.0 - np.cos(angle)[..., None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def build_cross_matrix(vector: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) whose product with a vector is the cross product."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
