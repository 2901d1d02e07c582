"""Motions between the points of a path: whether the joints keep their limits there, too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.mechanics.inverse import InverseKinematics, flange_poses
from jointstiff.solver.process.path import ProcessPath

_PARTS: Final = np.array([0.25, 0.5, 0.75])
"""Parts of a motion at which its joints are computed."""
_AT_ONCE: Final = 20_000
"""Motions that are computed at a time."""


@dataclass(frozen=True, eq=False)
class LimitsBetween:
    """Limits of the joints along the lines of a path: the controller interpolates between its points.

    The controller leads the tool's centre along the line, and turns the tool about one axis. Arcs count as
    their chords. Motions from or to a given posture are not checked, as nothing can be chosen there.
    """

    inverse: InverseKinematics
    path: ProcessPath
    step: float  #: greatest motion of a joint [rad]

    def find_beyond(self, joints: FloatArray) -> BoolArray:
        """Find the lines on which a joint leaves its limits, or turns by more than the step.

        Args:
            joints: (m, n) controller's joints at the points of the path [rad or m].

        Returns:
            (m,) mask of the points to which such a line leads.
        """
        path = self.path
        beyond = np.zeros(len(path), dtype=np.bool_)
        free = np.isnan(path.given[:, 0])
        at = np.flatnonzero(path.continuous[1:] & free[1:] & free[:-1]) + 1
        if len(at):
            beyond[at] = self.are_beyond(at, joints[at - 1], joints[at])
        return beyond

    def are_beyond(self, at: IndexArray, before: FloatArray, here: FloatArray) -> BoolArray:
        """Return a mask (E,) of lines on which a joint leaves its limits, or turns by more than the step.

        Args:
            at: (E,) points to which the lines lead.
            before: (E, n) controller's joints at the points before [rad or m].
            here: (E, n) controller's joints at these points [rad or m].
        """
        blocks = [slice(i, i + _AT_ONCE) for i in range(0, len(at), _AT_ONCE)]
        return np.concatenate([self._check(at[each], before[each], here[each]) for each in blocks])

    def _check(self, at: IndexArray, before: FloatArray, here: FloatArray) -> BoolArray:
        """Return what `are_beyond` does, for a block of lines."""
        inverse, path, robot = self.inverse, self.path, self.inverse.arm
        start, end = (robot.joint_map.model_angles(inverse.select_arm_joints(q)) for q in (before, here))
        ends = flange_poses(robot, start), flange_poses(robot, end)
        first, last = (each[:, :3, :3] for each in ends)
        turn = Rotation.from_matrix(first.transpose(0, 2, 1) @ last).as_rotvec()
        place = path.place[at][..., None]
        centres = [each[:, :3, 3] + (each[:, :3, :3] @ place)[..., 0] for each in ends]
        poses = np.tile(np.eye(4), (len(_PARTS), len(at), 1, 1))
        for k, part in enumerate(_PARTS.tolist()):
            rotation = first @ Rotation.from_rotvec(part * turn).as_matrix()
            centre = (1.0 - part) * centres[0] + part * centres[1]
            poses[k, :, :3, :3] = rotation
            poses[k, :, :3, 3] = centre - (rotation @ place)[..., 0]
        guess = (start + _PARTS[:, None, None] * (end - start)).reshape(-1, robot.n)
        found, reached = inverse.refine(poses.reshape(-1, 4, 4), guess)
        low, high = robot.limits.T
        kept = reached & ((found >= low) & (found <= high)).all(axis=1)
        kept &= np.abs(found - guess).max(axis=1) <= self.step
        return np.asarray(~kept.reshape(len(_PARTS), -1).all(axis=0))
