"""The task of a map: tool, orientations, process wrench and limits; and the postures that they allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

_FULL_TURN: Final = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class ToolFan:
    """Orientations of the flange among which each place chooses, with the process wrench in each."""

    rotation: FloatArray  #: (O, 3, 3) axes of the flange in R0
    force: FloatArray  #: (O, 3) on the robot, axes of R0 [N]
    moment: FloatArray  #: (O, 3) about the load point, axes of R0 [N·m]
    direction: FloatArray  #: (O, 3) unit vectors along which compliance is asked for, axes of R0

    def __len__(self) -> int:
        return len(self.rotation)


@dataclass(frozen=True, eq=False)
class MapTask:
    """Everything that a map asks of each place."""

    fan: ToolFan  #: orientations and wrenches
    place: FloatArray  #: (3,) place of the tool, flange frame [m]: it is brought to the places
    load_point: FloatArray  #: (3,) where the force acts, flange frame [m]
    limits: FloatArray  #: (n, 2) least and greatest angles as the controller shows them [rad]; ∓inf for none
    #: (n,) controller's angles [rad] that each place stays nearest to; None: it is the stiffest
    near: FloatArray | None
    confidence: float  #: level of the intervals

    def cases(self, orientation: IndexArray, joints: FloatArray) -> LoadCases:
        """Return the load cases of postures (R, n) in orientations (R,) of the fan."""
        count = len(joints)
        return LoadCases(
            joints=joints.copy(),
            force=self.fan.force[orientation],
            moment=self.fan.moment[orientation],
            load_point=np.tile(self.load_point, (count, 1)),
            place=np.tile(self.place, (count, 1)),
        )


def tool_rotations(tool_axis: FloatArray, directions: FloatArray, turns: int) -> FloatArray:
    """Return the orientations of the flange that point a tool along directions.

    At angle zero the flange's x axis, as far as it is across the tool, points along x of R0, as far as that
    is across the direction; y takes the place of an x that is along. Angles follow about the tool axis.

    Args:
        tool_axis: (3,) unit vector in the flange frame.
        directions: (D, 3) unit vectors in R0.
        turns: number A of angles about the tool axis, evenly over a full turn.

    Returns:
        (D·A, 3, 3) axes of the flange in R0, the angles of a direction together.
    """
    angle = _FULL_TURN * np.arange(turns) / turns
    about = np.tile(np.eye(3), (turns, 1, 1))
    about[:, 0, 0] = about[:, 1, 1] = np.cos(angle)
    about[:, 1, 0] = np.sin(angle)
    about[:, 0, 1] = -about[:, 1, 0]
    tool = _frame_about(tool_axis)
    return np.concatenate([_frame_about(direction) @ about @ tool.T for direction in directions])


def _frame_about(axis: FloatArray) -> FloatArray:
    """Return right-handed axes (3, 3), the last of them given; the first is nearest to x, or else to y."""
    for other in np.eye(3)[:2]:
        across = other - axis * (axis @ other)
        if (size := float(np.linalg.norm(across))) > 1e-6:
            first = across / size
            return np.stack([first, np.cross(axis, first), axis], axis=1)
    raise RequestError("a direction is the zero vector", where="directions", remedy="give unit vectors")


def postures_within_limits(
    robot: Robot, task: MapTask, inverse: InverseKinematics, places: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray, IndexArray, IndexArray]:
    """Return place, orientation and angles (K,), (K,), (K, n) of all postures within limits.

    Last come the places (S,) that some posture reaches, limits or not, and those (L,) of which a posture is
    not known: a map that keeps near to a posture follows its branch where solutions may be missing, near a
    singularity, as programs follow theirs, and takes what it finds if no other solution is nearer.
    """
    fan, count = task.fan, len(task.fan)
    poses = np.zeros((len(places), count, 4, 4))
    poses[..., 3, 3] = 1.0
    poses[..., :3, :3] = fan.rotation
    poses[..., :3, 3] = places[:, None] - fan.rotation @ task.place
    goals = poses.reshape(-1, 4, 4)
    solutions, complete = inverse.solutions(goals)
    lost = np.zeros(0, dtype=np.intp)
    if task.near is not None:
        rows = np.flatnonzero(~complete)
        near = np.tile(robot.joint_map.model_angles(task.near[None]), (len(rows), 1))
        followed, known = inverse.followed(goals[rows], near)
        known &= _far(followed, near) <= np.fmin.reduce(
            _far(solutions[rows], near[:, None]), axis=1, initial=np.inf
        )
        solutions[rows] = np.nan
        solutions[rows[known], 0] = followed[known]
        lost = np.unique(rows[~known] // count)
    angles = robot.joint_map.controller_angles(solutions)
    pose, branch = np.nonzero(np.isfinite(angles).all(axis=2))
    joints = _turned(angles[pose, branch], robot, task)
    place, orientation = np.divmod(pose, count)
    kept = ((joints >= task.limits[:, 0]) & (joints <= task.limits[:, 1])).all(axis=1)
    model_angles = robot.joint_map.model_angles(joints)
    kept &= ((model_angles >= robot.limits[:, 0]) & (model_angles <= robot.limits[:, 1])).all(axis=1)
    return place[kept], orientation[kept], joints[kept], np.unique(place), lost


def _far(angles: FloatArray, near: FloatArray) -> FloatArray:
    """Return the greatest difference of an angle, full turns aside, rounded [rad]."""
    apart = angles - near
    apart = np.abs(apart - _FULL_TURN * np.round(apart / _FULL_TURN)).max(axis=-1)
    return np.asarray(np.round(apart, 6))


def _turned(angles: FloatArray, robot: Robot, task: MapTask) -> FloatArray:
    """Return controller's angles (K, n), model's angles turned fully towards the limits or what is near.

    A joint that the map couples to others is turned in the model, where a full turn is one.
    """
    joint_map, limits = robot.joint_map, robot.limits
    q = joint_map.model_angles(angles)
    if task.near is None:
        near = np.clip(0.0, limits[:, 0], limits[:, 1])
    else:
        near = joint_map.model_angles(task.near[None])[0]
    q = q + _FULL_TURN * np.round((near - q) / _FULL_TURN)
    with np.errstate(invalid="ignore"):
        up = np.where(q < limits[:, 0], np.ceil((limits[:, 0] - q) / _FULL_TURN), 0.0)
        down = np.where(q > limits[:, 1], np.ceil((q - limits[:, 1]) / _FULL_TURN), 0.0)
    return joint_map.controller_angles(q + _FULL_TURN * (up - down))
