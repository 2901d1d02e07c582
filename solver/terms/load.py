"""Errors of the load: its point, its size and direction, and a force that nobody stated (method.md §8, §13).

With W = (F, M) the load, J_F and J_ω its Jacobians, R the flange's rotation and c the compliances, each error
adds torques τ, which move the targets by ``J (c ∘ τ)``.
"""

from __future__ import annotations

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.configuration import skew
from jointstiff.solver.terms.block import RegressorBlock
from jointstiff.solver.terms.term import Motion, Term, by_torque


def _torque_of(block: RegressorBlock, force: FloatArray, moment: FloatArray | None = None) -> FloatArray:
    """Return the torques (B, n, k) of further forces [N], and moments [N·m], (B, 3, k) at the load point."""
    torque: FloatArray = block.load_jacobian.transpose(0, 2, 1) @ force
    return torque if moment is None else torque + _turning(block) @ moment


def _turning(block: RegressorBlock) -> FloatArray:
    return block.configurations.angular_jacobian.transpose(0, 2, 1)


def _load_point(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move the load point by e along the flange's axes: it adds the moment e × F."""
    moment = -skew(block.measurements.force) @ block.configurations.flange_rotation
    return by_torque(block, compliance, _turning(block) @ moment)


def _force_scale(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Scale all forces and moments."""
    return by_torque(block, compliance, block.torque[..., None])


def _force_direction(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Turn all forces and moments about the axes of R0: φ × F, φ × M."""
    part = block.measurements
    return by_torque(block, compliance, _torque_of(block, -skew(part.force), -skew(part.moment)))


def _constant_force(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Add one force, axes of R0, to every load."""
    return by_torque(block, compliance, block.load_jacobian.transpose(0, 2, 1))


LOAD_POINT = Term("load_point", "m", _load_point, lambda common: (common.load_point,), suspected=True)
FORCE_SCALE = Term("force_scale", "1", _force_scale, lambda common: (common.scale,))
FORCE_DIRECTION = Term("force_direction", "rad", _force_direction, lambda common: (common.direction,))
CONSTANT_FORCE = Term("constant_force", "N", _constant_force, suspected=True)
