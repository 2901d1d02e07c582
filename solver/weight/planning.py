"""Rows of unloaded positions still to be taken, for plans: geometry and masses are a nuisance (§10, §14)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.charts import RigidTransform
from jointstiff.solver.geometry.poses import Poses, PoseState, chain_axes
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.weight.bodies import Burden, WeightReadings
from jointstiff.solver.weight.regressor import Frames, rows_at

_GEOMETRY: Final = 0.01
"""Standard uncertainty of axes and targets before any reading [m and rad]: a nominal arm is as good."""


def planned_rows(
    robot: Robot, burden: Burden, targets: FloatArray, compliance: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Return a function from postures (N, n) to rows (N, 3 T, P) of a reading of targets (T, 3) [m].

    The columns are those of the joints' compliances, then those of the geometry and of the masses, in units
    of what is known of each beforehand. Errors of masses show by compliances (n,) [rad/(N·m)].
    """
    axes, flange = chain_axes(robot.chain)
    frames, names = Frames.of(robot, RigidTransform.identity()), tuple(map(str, range(len(targets))))

    def rows(joints: FloatArray) -> FloatArray:
        angles = robot.joint_map.model_angles(joints)
        count, shape = len(joints), (len(joints), *targets.shape)
        places = Configurations(robot, angles).to_base(np.broadcast_to(targets, shape))
        poses = Poses(joints, places, np.ones(shape[:2], dtype=np.bool_), names, robot.joint_map)
        state = PoseState(axes, flange.apply(targets), np.zeros(count))
        readings = WeightReadings.unloaded(poses, burden)
        found = rows_at(readings, poses.whitened, frames, state, np.zeros(angles.shape), compliance)
        masses = np.einsum("mjk,j->mk", found.products, compliance)
        stacked = np.hstack([found.joints, _GEOMETRY * found.geometry, masses])
        return stacked.reshape(count, 3 * len(targets), -1)

    return rows
