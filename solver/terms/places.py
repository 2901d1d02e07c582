"""Errors of geometry: places of targets on the flange, axes of joints, tracker and base (method.md §8)."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.configuration import skew
from jointstiff.solver.robot.model import displaced_axis
from jointstiff.solver.terms.block import RegressorBlock, regressor_blocks
from jointstiff.solver.terms.term import Motion, Term

_STEP = 1e-5
"""Half the step of the difference quotients of an axis [m and rad]."""


def _target_places(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move each target by e along the flange's axes: with the flange's rotation φ it moves by φ × e."""
    rotation = np.einsum("bij,bj->bi", block.configurations.angular_jacobian, compliance * block.torque)
    moved = skew(rotation) @ block.configurations.flange_rotation
    B, T = block.points.shape[:2]
    columns = np.zeros((B, T, 3, T, 3))
    columns[:, np.arange(T), :, np.arange(T)] = moved
    return Motion(columns.reshape(B, T, 3, 3 * T))


def _axes(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move each axis along both directions across it, and turn it about them: [m, rad, m, rad] a joint."""
    targets, joints = [], []
    for j, axis in enumerate(block.robot.axes):
        for across in _STEP * np.linalg.svd(axis[None])[2][1:]:
            for step, turn in ((across, 0.0 * across), (0.0 * across, across)):
                ahead, behind = (
                    next(regressor_blocks(robot, block.measurements, block.compliance))
                    for robot in (
                        displaced_axis(block.robot, j, step, turn),
                        displaced_axis(block.robot, j, -step, -turn),
                    )
                )
                targets.append((ahead.A @ compliance - behind.A @ compliance) / (2.0 * _STEP))
                joints.append((ahead.torque - behind.torque) * compliance / (2.0 * _STEP))
    return Motion(np.stack(targets, axis=-1), np.stack(joints, axis=-1))


def _movement(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Shift, and turn about the middle of all targets, what was read under load: tracker or base moved."""
    turn = -skew(block.points - block.points[block.measurements.present].mean(axis=0))
    return Motion(np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=-1))


TARGET_PLACES = Term("target_places", "m", _target_places, lambda common: (common.target_places,))
AXES = Term("axes", "m, rad", _axes, lambda common: (common.axis_position, common.axis_direction))
MOVEMENT = Term("movement", "m, rad", _movement, suspected=True)
