"""The posture of each place of a map: all branches within limits, and the one that is taken."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.deflection.elastic import ElasticPredictor
from jointstiff.solver.deflection.forward import load_torque
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.map_task import MapTask
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

_FULL_TURN: Final = 2.0 * np.pi
_TIE: Final = 1e-9
"""Relative difference of two deflections that is rounding: wrists turned over bend alike."""


def postures_within_limits(
    robot: Robot, task: MapTask, inverse: InverseKinematics, places: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray, IndexArray]:
    """Return place, orientation and angles (K,), (K,), (K, n) of all postures within limits.

    Last come the places (S,) that some posture reaches, limits or not.
    """
    fan, count = task.fan, len(task.fan)
    poses = np.zeros((len(places), count, 4, 4))
    poses[..., 3, 3] = 1.0
    poses[..., :3, :3] = fan.rotation
    poses[..., :3, 3] = places[:, None] - fan.rotation @ task.place
    angles = robot.joint_map.controller_angles(inverse.branches(poses.reshape(-1, 4, 4)))
    pose, branch = np.nonzero(np.isfinite(angles).all(axis=2))
    joints = _turned(angles[pose, branch], robot, task)
    place, orientation = np.divmod(pose, count)
    kept = ((joints >= task.limits[:, 0]) & (joints <= task.limits[:, 1])).all(axis=1)
    model_angles = robot.joint_map.model_angles(joints)
    kept &= ((model_angles >= robot.limits[:, 0]) & (model_angles <= robot.limits[:, 1])).all(axis=1)
    return place[kept], orientation[kept], joints[kept], np.unique(place)


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


def chosen_postures(
    model: JointModel | ElasticPredictor,
    task: MapTask,
    place: IndexArray,
    orientation: IndexArray,
    joints: FloatArray,
) -> IndexArray:
    """Return one posture of each place: the index (R,) of the nearest or the stiffest."""
    home = np.zeros(model.robot.n) if task.near is None else task.near
    far = np.abs(joints - home).max(axis=1, initial=0.0)
    size = far if task.near is not None else _linear_length(model, task, orientation, joints)
    with np.errstate(divide="ignore"):
        rank = np.round(np.log(size) / _TIE)  # what differs by rounding is a tie
    order = np.lexsort((orientation, far, rank, place))
    return np.asarray(order[np.unique(place[order], return_index=True)[1]])


def _linear_length(
    model: JointModel | ElasticPredictor, task: MapTask, orientation: IndexArray, joints: FloatArray
) -> FloatArray:
    """Return the length (K,) of ``J diag(c) τ`` [m], or of the links' too, at unloaded postures."""
    if not len(joints):
        return np.zeros(0)
    cases = task.cases(orientation, joints)
    here = Configurations(model.robot, model.robot.joint_map.model_angles(joints))
    if isinstance(model, ElasticPredictor):
        moved = model.places(cases, here).deflection(model.compliances)[:, :3]
        return np.asarray(np.linalg.norm(moved, axis=1))
    torque = load_torque(cases, here)
    moved = here.jacobian_at(here.to_base(cases.place[:, None]))[:, 0]
    return np.asarray(np.linalg.norm((moved @ (model.compliance * torque)[..., None])[..., 0], axis=1))
