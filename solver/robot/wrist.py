"""Find the wrist centre, where the last three axes meet (method.md §4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

WRIST_JOINTS = 3
"""Number of joints of a wrist: the last ones of the robot."""


@dataclass(frozen=True, eq=False)
class Wrist:
    """The point nearest to the last three axes."""

    #: greatest miss distance of a spherical wrist [m]; under 10 mrad of deflection it moves the centre by 5
    #: µm
    TOLERANCE: ClassVar[float] = 0.5e-3

    centre: FloatArray  #: (3,) wrist centre in the flange frame [m]
    miss_distance: float  #: greatest distance of one of the axes from it [m]

    @property
    def spherical(self) -> bool:
        """Return whether the axes meet within `TOLERANCE`."""
        return self.miss_distance <= self.TOLERANCE


def find_wrist(robot: Robot) -> Wrist | None:
    """Find the point of least squared distance to the last three axes.

    If they meet in one configuration they meet in all: neighbouring axes keep their distance and the
    foot of their common perpendicular. One configuration therefore suffices.

    Returns:
        The wrist, or None if there are fewer than three joints or the point is not unique, as for
        parallel axes.
    """
    if robot.n < WRIST_JOINTS:
        return None
    configuration = Configurations(robot, np.zeros((1, robot.n)))
    directions = configuration.jacobian[0, 3:, -WRIST_JOINTS:].T
    moments = configuration.jacobian[0, :3, -WRIST_JOINTS:].T
    feet = np.cross(directions, moments)
    normals = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    system = normals.sum(axis=0)
    if np.linalg.svd(system, compute_uv=False)[-1] < 1e-6:
        return None
    centre = np.linalg.solve(system, np.einsum("kij,kj->i", normals, feet))
    misses = np.linalg.norm(np.einsum("kij,kj->ki", normals, centre - feet), axis=1)
    in_flange = configuration.flange_rotation[0].T @ (centre - configuration.flange_translation[0])
    return Wrist(in_flange, float(misses.max()))
