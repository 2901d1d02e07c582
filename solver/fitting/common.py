"""Errors that all observations share, carried to first order into what is estimated (method.md §8)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fitting.iteration import Iteration
from jointstiff.solver.fitting.prior import PriorRows
from jointstiff.solver.readings.measurements import CommonUncertainty, Measurements
from jointstiff.solver.regression.regressor import RegressorBlock, regressor_blocks
from jointstiff.solver.robot.model import Robot, displaced_axis

CommonSource = Literal[
    "force_scale", "force_direction", "load_point", "assumed_load_point", "target_places", "axes"
]
"""Source of an error that all observations share; a load point's is assumed where nothing is stated."""


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """Effect of common errors on the estimate."""

    sources: tuple[CommonSource, ...]  #: (K,) source of each error
    #: (n, K) change of the estimate by one standard uncertainty of each [rad/(N·m)]; their share of the
    #: covariance is the product with the transpose
    responses: FloatArray

    def of(self, source: CommonSource) -> FloatArray:
        """Return the responses (n, k) of the errors of one source."""
        return self.responses[:, [own == source for own in self.sources]]


def common_errors(
    robot: Robot,
    measurements: Measurements,
    last: Iteration,
    prior: PriorRows | None,
    *,
    complementary_stiffness: bool,
) -> CommonErrors:
    """Return what a standard uncertainty of each common error moves in the estimate.

    An error makes the deflections differ from those that the regressor explains. The estimator ĉ = H d is
    linear, bounds apart, so it takes the difference for ``H δd`` of compliance: for a scale of the force, ĉ
    itself.

    Args:
        robot: n joints.
        measurements: N observations that state a `common_uncertainty`.
        last: their fit.
        prior: as in the fit.
        complementary_stiffness: whether K_c is part of the model.
    """
    uncertainty = measurements.common_uncertainty or CommonUncertainty()
    joints = np.flatnonzero(~last.observability.null)
    pairs = list(_displaced(robot, uncertainty))
    sources: tuple[CommonSource, ...] = ()
    responses = np.zeros((robot.n, 0))
    balanced = last.fit.compliance if complementary_stiffness else None
    for block in last.blocks(robot, measurements, balanced):
        errors = list(_errors(block, uncertainty, last.fit.compliance))
        errors += _axis_errors(block, pairs, last.fit.compliance, complementary_stiffness)
        sources = tuple(source for source, _ in errors)
        if errors:
            added = last.method.responses([other for _, other in errors], joints, prior)
            responses = responses + added if responses.size else added
    return CommonErrors(sources, responses)


def _errors(
    block: RegressorBlock, uncertainty: CommonUncertainty, compliance: FloatArray
) -> Iterator[tuple[CommonSource, RegressorBlock]]:
    """Yield the observations with the deflections that one standard uncertainty of each error adds."""
    for source, torque in _torques(block, uncertainty):
        bent = compliance * torque
        yield source, _with_deflection(block, np.einsum("btij,bj->bti", block.jacobian, bent), bent)
    if uncertainty.target_places:
        rotation = np.einsum("bij,bj->bi", block.configurations.angular_jacobian, compliance * block.torque)
        for axis in np.moveaxis(block.configurations.flange_rotation, -1, 0):
            moved = np.cross(rotation, uncertainty.target_places * axis)
            for target in range(block.measurements.present.shape[1]):
                deflection = np.zeros_like(block.measurements.deflection)
                deflection[:, target] = moved
                yield "target_places", _with_deflection(block, deflection, np.zeros_like(block.torque))


def _torques(
    block: RegressorBlock, uncertainty: CommonUncertainty
) -> Iterator[tuple[CommonSource, FloatArray]]:
    """Yield the torques (B, n) that errors of the load add [N·m]."""
    part = block.measurements

    def torque(force: FloatArray, moment: FloatArray) -> FloatArray:
        return block.configurations.joint_torque(block.load_jacobian, force, moment)

    if uncertainty.scale:
        yield "force_scale", uncertainty.scale * block.torque
    if uncertainty.direction:
        for axis in uncertainty.direction * np.eye(3):
            yield "force_direction", torque(np.cross(axis, part.force), np.cross(axis, part.moment))
    if uncertainty.load_point:
        for axis in np.moveaxis(block.configurations.flange_rotation, -1, 0):
            moment = np.cross(uncertainty.load_point * axis, part.force)
            source: CommonSource = "assumed_load_point" if uncertainty.load_point_assumed else "load_point"
            yield source, torque(np.zeros_like(moment), moment)


def _displaced(robot: Robot, uncertainty: CommonUncertainty) -> Iterator[tuple[Robot, Robot]]:
    """Yield the robot with an axis off by a standard uncertainty, and by its opposite."""
    if not (uncertainty.axis_position or uncertainty.axis_direction):
        return
    for j, axis in enumerate(robot.axes):
        for across in np.linalg.svd(axis[None])[2][1:]:
            for step, turn in (
                (uncertainty.axis_position * across, 0.0 * across),
                (0.0 * across, uncertainty.axis_direction * across),
            ):
                if step.any() or turn.any():
                    yield displaced_axis(robot, j, step, turn), displaced_axis(robot, j, -step, -turn)


def _axis_errors(
    block: RegressorBlock,
    pairs: Sequence[tuple[Robot, Robot]],
    compliance: FloatArray,
    complementary_stiffness: bool,
) -> Iterator[tuple[CommonSource, RegressorBlock]]:
    """Yield the observations with half the difference of what the two robots of each pair predict."""
    balanced = compliance if complementary_stiffness else None
    for pair in pairs:
        blocks = [next(regressor_blocks(robot, block.measurements, balanced)) for robot in pair]
        moved, bent = (
            0.5 * (one - other)
            for one, other in zip(*((b.A @ compliance, b.torque * compliance) for b in blocks), strict=True)
        )
        yield "axes", _with_deflection(block, moved, bent)


def _with_deflection(block: RegressorBlock, moved: FloatArray, bent: FloatArray) -> RegressorBlock:
    """Return the observations with other deflections of targets (B, T, 3) and encoders (B, n)."""
    part = block.measurements
    encoders = part.encoders
    if encoders is not None:
        encoders = replace(encoders, deflection=np.where(encoders.present, bent, 0.0))
    present = np.where(part.present[..., None], moved, 0.0)
    return replace(block, measurements=replace(part, deflection=present, encoders=encoders))
