"""Errors that all observations share, carried to first order into what is estimated (method.md §8)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fitting.iteration import Iteration
from jointstiff.solver.fitting.prior import PriorRows
from jointstiff.solver.readings import ForceUncertainty, Measurements
from jointstiff.solver.regression import BLOCK_LENGTH, RegressorBlock, joint_torque, regressor_blocks
from jointstiff.solver.robot import Robot


def force_response(
    robot: Robot,
    measurements: Measurements,
    last: Iteration,
    prior: PriorRows | None,
    *,
    complementary_stiffness: bool,
) -> FloatArray:
    """Return what a standard uncertainty of the common errors of the force moves in the estimate.

    A wrench that is off by δW moves the deflections by ``J diag(c) J_wᵀ δW``. The estimator ĉ = H d is
    linear, bounds apart, so it takes them for ``H J diag(c) J_wᵀ δW`` of compliance: for a scale, ĉ itself.

    Args:
        robot: n joints.
        measurements: N observations that state a `force_uncertainty`.
        last: their fit.
        prior: as in the fit.
        complementary_stiffness: whether K_c is part of the model.

    Returns:
        (n, 4) for scale and rotation about x, y, z of R0 [rad/(N·m)]; their outer product is the common
        covariance.
    """
    uncertainty = measurements.force_uncertainty or ForceUncertainty()
    joints = np.flatnonzero(~last.observability.null)
    response = np.zeros((robot.n, 4))
    for block in _blocks(robot, measurements, last, complementary_stiffness):
        for k, torque in enumerate(_torques(block)):
            if uncertainty.standard_uncertainties[k] > 0.0:
                other = _with_torque(block, torque, last.fit.compliance)
                response[:, k] += last.method.response(other, joints, prior)
    return response * uncertainty.standard_uncertainties


def _blocks(
    robot: Robot, measurements: Measurements, last: Iteration, complementary_stiffness: bool
) -> Iterator[RegressorBlock]:
    if len(measurements) <= BLOCK_LENGTH:
        yield last.first_block
        return
    weighed = measurements if last.robust is None else last.robust.weigh(measurements)
    yield from regressor_blocks(robot, weighed, last.fit.compliance if complementary_stiffness else None)


def _torques(block: RegressorBlock) -> Iterator[FloatArray]:
    """Yield the torques (B, n) of the wrench itself, then of its turn about each axis of R0 [N·m]."""
    part = block.measurements
    yield block.torque
    for axis in np.eye(3):
        yield joint_torque(
            block.configurations, block.load_jacobian, np.cross(axis, part.force), np.cross(axis, part.moment)
        )


def _with_torque(block: RegressorBlock, torque: FloatArray, compliance: FloatArray) -> RegressorBlock:
    """Return the observations with the deflections that other torques (B, n) cause."""
    part = block.measurements
    bent = compliance * torque
    moved = np.where(part.present[..., None], np.einsum("btij,bj->bti", block.jacobian, bent), 0.0)
    encoders = part.encoders
    if encoders is not None:
        encoders = replace(encoders, deflection=np.where(encoders.present, bent, 0.0))
    return replace(block, measurements=replace(part, deflection=moved, encoders=encoders))
