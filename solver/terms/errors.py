"""Errors that a set may state, a test suspects, a budget lists and a plan hedges against (method.md §8, §13).

Of the load: with W = (F, M), J_F and J_ω its Jacobians, R the flange's rotation and c the compliances, each
error adds torques τ, which move the targets by ``J (c ∘ τ)``. Of geometry: places of targets on the flange,
axes of joints, tracker and base.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.configuration import skew
from jointstiff.solver.robot.model import displaced_axis
from jointstiff.solver.terms.block import Motion, RegressorBlock, Term, by_torque, regressor_blocks

_STEP = 1e-5
"""Half the step of the difference quotients of an axis [m and rad]."""


def _load_point(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move the load point by e along the flange's axes: it adds the moment e × F."""
    moment = -skew(block.measurements.force) @ block.configurations.flange_rotation
    return by_torque(block, compliance, block.configurations.angular_jacobian.transpose(0, 2, 1) @ moment)


def _force_scale(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Scale all forces and moments."""
    return by_torque(block, compliance, block.torque[..., None])


def _force_direction(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Turn all forces and moments about the axes of R0: φ × F, φ × M."""
    part = block.measurements
    by_force = block.load_jacobian.transpose(0, 2, 1) @ -skew(part.force)
    by_moment = block.configurations.angular_jacobian.transpose(0, 2, 1) @ -skew(part.moment)
    return by_torque(block, compliance, by_force + by_moment)


def _constant_force(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Add one force, axes of R0, to every load."""
    return by_torque(block, compliance, block.load_jacobian.transpose(0, 2, 1))


LOAD_POINT = Term("load_point", "m", _load_point, lambda common: (common.load_point,), suspected=True)
FORCE_SCALE = Term("force_scale", "1", _force_scale, lambda common: (common.scale,))
FORCE_DIRECTION = Term("force_direction", "rad", _force_direction, lambda common: (common.direction,))
CONSTANT_FORCE = Term("constant_force", "N", _constant_force, suspected=True)


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

TERMS: Final[dict[str, Term]] = {
    term.name: term
    for term in (FORCE_SCALE, FORCE_DIRECTION, LOAD_POINT, CONSTANT_FORCE, MOVEMENT, TARGET_PLACES, AXES)
}
"""Errors by name. Each has its line in the budget where the readings state its uncertainty."""
