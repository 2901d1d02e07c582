"""Rows of a planned weight step: what each posture tells about the gearboxes (method.md §18)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.gearboxes.step import PLACE, Load, compute_holding_torques
from jointstiff.solver.mechanics.robot import Robot

LEAST_POSTURES: Final = 4
"""Least number of postures of a plan: compliance and offset of a joint, and two degrees of freedom."""
_UNKNOWNS: Final = 2
"""Unknowns of a joint that is read from both sides: compliance and offset."""
_UPPER: Final = 0.975
"""Probability below the upper end of an interval of 95 %."""
_ROUNDING: Final = 1e-9
"""Torque of a joint, relative to the greatest torque of all joints, that counts as rounding."""
_OFFSET: Final = 1e-3
"""Standard uncertainty of the offset of a joint between the states, before any reading [rad]."""


@dataclass(frozen=True, eq=False)
class PlannedStepRows:
    """Rows of a weight step that is not yet read, of J joints with two encoders."""

    robot: Robot
    load: Load
    gravity: FloatArray  # (3,) acceleration in R0 [m/s²]
    joints: IndexArray  # (J,) indices of the joints with two encoders
    compliance: FloatArray  # (n,) expected compliances [rad/(N·m)]; zero where nothing is known

    def __len__(self) -> int:
        """Return the number J of rows of a posture."""
        return len(self.joints)

    def __call__(self, joints: FloatArray) -> FloatArray:
        """Return the rows (N, J, n + J + 4) of the steps of twists in postures (N, n) [rad].

        The columns are the compliances of the robot's joints; then offsets of the J joints, the error of the
        load's mass and those of its place, each in its standard uncertainty. Both sides of each posture are
        read, so that lost motion cancels.
        """
        positions = self.robot.joint_map.model_angles(joints)
        all_torques = compute_holding_torques(self.robot, positions, self.load, self.gravity)
        greatest = np.abs(all_torques[0]).max(initial=0.0)
        all_torques[0][np.abs(all_torques[0]) < _ROUNDING * greatest] = 0.0
        torques = np.moveaxis(all_torques[:, :, self.joints], 0, 2)  # (N, J, 4)
        load = self.load
        uncertainties = np.array([load.mass_uncertainty / load.mass, *[load.point_uncertainty] * PLACE])
        count = len(self.joints)
        of_compliances = np.zeros((len(joints), count, self.robot.n))
        of_compliances[:, np.arange(count), self.joints] = torques[:, :, 0]
        of_offsets = np.broadcast_to(_OFFSET * np.eye(count), (len(joints), count, count))
        of_load = self.compliance[self.joints, None] * torques * uncertainties
        return np.concatenate([of_compliances, of_offsets, of_load], axis=2)


def find_widening(postures: int) -> float:
    """Return Student's quantile for a number of postures, relative to the normal one."""
    return float(stats.t.ppf(_UPPER, postures - _UNKNOWNS) / stats.norm.ppf(_UPPER))
