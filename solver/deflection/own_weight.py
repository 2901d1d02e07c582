"""Own weight of the links: torques and stiffness of forces that act on links before the flange."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.regression.balance import wrench_stiffness
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import Robot

STANDARD_GRAVITY: FloatArray = np.array([0.0, 0.0, -9.80665])
"""In R0, z upwards [m/s²]."""


@dataclass(frozen=True, eq=False)
class OwnWeight:
    """Masses of the n links, each carried by a joint; a tool and its payload belong to the last.

    Raises:
        RequestError: a mass is negative, or a number is not finite.
    """

    mass: FloatArray  #: (n,) [kg]; zero for a link whose weight is left out
    centre: FloatArray  #: (n, 3) centres of mass in the frames that move with the joints [m]
    gravity: FloatArray = field(default_factory=lambda: STANDARD_GRAVITY)  #: (3,) in R0 [m/s²]

    def __post_init__(self) -> None:
        finite = all(np.isfinite(array).all() for array in (self.mass, self.centre, self.gravity))
        if not finite or (self.mass < 0.0).any() or self.centre.shape != (len(self.mass), 3):
            raise RequestError(
                "a mass is negative, or a number is not finite",
                where="own_weight",
                remedy="give each link a mass in kg and its centre in m",
            )

    def torque_and_stiffness(
        self, robot: Robot, q: FloatArray, configurations: Configurations
    ) -> tuple[FloatArray, FloatArray]:
        """Return the torques g(q) and ``∂g/∂q`` of the weights (method.md §9).

        Each weight is a dead force at its centre of mass that only the joints up to its own carry.

        Args:
            robot: n joints.
            q: (B, n) angles of the model [rad].
            configurations: the kinematics there.

        Returns:
            (B, n) [N·m] and (B, n, n) [N·m/rad].
        """
        rotation, origin = joint_frames(robot, q)
        centres = origin + (rotation @ self.centre[:, :, None])[..., 0]
        jacobian = configurations.jacobian_at(centres)  # (B, n, 3, n)
        torque, stiffness = np.zeros(q.shape), np.zeros((*q.shape, robot.n))
        for j in np.flatnonzero(self.mass):
            carried = np.arange(robot.n) <= j
            force = np.broadcast_to(self.mass[j] * self.gravity, (len(q), 3))
            torque += np.where(carried, np.einsum("bij,bi->bj", jacobian[:, j], force), 0.0)
            part = wrench_stiffness(configurations, jacobian[:, j], force, np.zeros_like(force))
            stiffness += np.where(carried[:, None] & carried, part, 0.0)
        return torque, stiffness
