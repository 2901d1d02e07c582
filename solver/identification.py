"""Identification of joint stiffnesses from measurements, with their evidence (method.md §2-§6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.common import CommonErrors, common_errors
from jointstiff.solver.fitting.decoupled import DecoupledPartialPose
from jointstiff.solver.fitting.iteration import (
    Iteration,
    fit_once,
    iterate_to_convergence,
    neglected_shift,
    require_observable,
)
from jointstiff.solver.fitting.methods import (
    LengthOfLeastCondition,
    MethodAccumulator,
    OneStage,
    displacement_readings,
)
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.estimate import Estimate, assemble
from jointstiff.solver.observability.identifiability import Excitation
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.complementary_stiffness import ComplementaryStiffness
from jointstiff.solver.regression.pose import refuse_unless_posed
from jointstiff.solver.regression.regressor import regressor_blocks
from jointstiff.solver.regression.stage_rows import target_readings
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.wrist import WRIST_JOINTS, Wrist, find_wrist


def identify(robot: Robot, measurements: Measurements, settings: Settings) -> Estimate:
    """Identify the joint compliances.

    Raises:
        UnsupportedMethodError: the readings or the robot cannot support the method or weighting.
        NotObservableError: the readings determine no joint.
        MeasurementError: an array is not what it should be.
        SolverError: optimality could not be certified.
    """
    refuse_unsupported(robot, measurements, settings)
    length = _characteristic_length(robot, measurements, settings)
    new_method = partial(_accumulator, robot, settings, length)
    first = last = fit_once(robot, measurements, settings, new_method)
    iterations = 0
    if settings.complementary_stiffness:
        last, iterations = iterate_to_convergence(robot, measurements, settings, new_method, first)
    common = _common_errors(robot, measurements, settings, last)
    estimate = _assembled(robot, measurements, settings, last, length, common)
    if settings.complementary_stiffness:
        shift: FloatArray | None = last.fit.compliance - first.fit.compliance
    else:
        prior = settings.prior.rows(estimate.sigma) if settings.prior and estimate.sigma else None
        shift = neglected_shift(robot, measurements, first, prior)
    size = ComplementaryStiffness(
        included=settings.complementary_stiffness,
        iterations=iterations,
        largest_ratio=first.largest_stiffness.ratio(estimate.compliance, estimate.estimated),
        largest_shift=_in_standard_uncertainties(shift, estimate),
        shift=shift,
    )
    return replace(estimate, complementary_stiffness=size)


def _assembled(
    robot: Robot,
    measurements: Measurements,
    settings: Settings,
    last: Iteration,
    length: float | None,
    common: Callable[[float], CommonErrors] | None,
) -> Estimate:
    """The estimate of the last fit; a robust scale takes the place of a sigma that is not known."""
    robust, targets = last.robust, last.targets
    estimate = assemble(
        last.fit,
        last.observability,
        last.method.judged.rows,
        names=robot.joint_names,
        sigma=measurements.sigma if robust is None else robust.sigma,
        settings=settings,
        characteristic_length=length,
        inflation=1.0 if robust is None else robust.inflation,
        sigma_given=measurements.sigma is not None,
        common=common,
    )
    if robust is None or targets is None:
        return estimate
    return replace(
        estimate,
        chi_square=targets.chi_square(estimate.compliance, sigma=robust.sigma, threshold=robust.threshold),
        certificates=(robust.certificate, *estimate.certificates),
        robust=robust,
    )


def _common_errors(
    robot: Robot, measurements: Measurements, settings: Settings, last: Iteration
) -> Callable[[float], CommonErrors] | None:
    """Return what carries common errors into the estimate, given sigma; None where none are stated."""
    if measurements.common_uncertainty is None:
        return None

    def response(sigma: float) -> CommonErrors:
        prior = None if settings.prior is None else settings.prior.rows(sigma)
        included = settings.complementary_stiffness
        return common_errors(robot, measurements, last, prior, complementary_stiffness=included)

    return response


def _in_standard_uncertainties(shift: FloatArray | None, estimate: Estimate) -> float | None:
    """Largest change of an estimate in units of its standard uncertainty, without what is assumed of it."""
    if shift is None or estimate.covariance is None:
        return None
    variance = np.diagonal(estimate.covariance)
    if estimate.common is not None:
        variance = variance - np.square(estimate.common.of("assumed_load_point")).sum(axis=1)
    known = estimate.estimated & (variance > 0.0)
    return float((np.abs(shift[known]) / np.sqrt(variance[known])).max()) if known.any() else None


def refuse_unsupported(robot: Robot, measurements: Measurements, settings: Settings) -> None:
    """Refuse what the readings or the robot cannot support, before any work is done.

    Raises:
        UnsupportedMethodError: saying what is missing.
    """
    if settings.method != "partial_pose":
        refuse_unless_posed(measurements)
    if settings.method == "decoupled_partial_pose":
        spherical_wrist(robot)
    if settings.loss != "squared" and measurements.direction is not None:
        raise UnsupportedMethodError(
            f"loss {settings.loss} compares the lengths of residuals, which a reading along one direction "
            "does not show",
            where="loss",
            remedy="use loss squared, or omit the readings along a direction",
        )
    weighting = settings.weighting
    others, length = weighting != "covariance", weighting == "characteristic_length"
    for refused, why, remedy in (
        (
            others and settings.prior is not None,
            "has no uncertainty of a reading to weigh a prior against",
            "use weighting covariance, or omit `priors`",
        ),
        (
            others and measurements.encoders is not None,
            "cannot combine encoder readings (angles) with positions (lengths)",
            "use weighting covariance, or omit the encoder readings",
        ),
        (
            length and settings.method != "complete_pose",
            f"needs rotations, which method {settings.method} does not use",
            "use weighting covariance, or method complete_pose",
        ),
    ):
        if refused:
            raise UnsupportedMethodError(f"weighting {weighting} {why}", where="weighting", remedy=remedy)


def spherical_wrist(robot: Robot) -> Wrist:
    """The robot's wrist, which the decoupled method needs.

    Raises:
        UnsupportedMethodError: if the robot has none, with the miss distance.
    """
    wrist = find_wrist(robot)
    if wrist is None or robot.n == WRIST_JOINTS:
        raise UnsupportedMethodError(
            f"a robot with {robot.n} joints has no arm with a spherical wrist",
            where="method",
            remedy="use method partial_pose",
        )
    if not wrist.spherical:
        raise UnsupportedMethodError(
            f"the last three axes miss each other by {1e3 * wrist.miss_distance:.3g} mm, more than "
            f"{1e3 * Wrist.TOLERANCE:g} mm, so the wrist has no centre",
            where="method",
            remedy="use method partial_pose, or correct the robot's model",
        )
    return wrist


def _accumulator(robot: Robot, settings: Settings, length: float | None) -> MethodAccumulator:
    uniform = settings.weighting == "uniform"
    if settings.method == "partial_pose":
        return OneStage(robot.n, target_readings, np.ones(3) if uniform else None)
    if settings.method == "complete_pose":
        length = 1.0 if uniform else length
        weight = None if length is None else np.repeat([1.0 / length, 1.0], 3)
        return OneStage(robot.n, displacement_readings, weight)
    return DecoupledPartialPose(robot, spherical_wrist(robot), uniform=uniform)


def _characteristic_length(robot: Robot, measurements: Measurements, settings: Settings) -> float | None:
    if settings.weighting != "characteristic_length" or settings.characteristic_length is not None:
        return settings.characteristic_length
    excitation, search = Excitation(robot.joint_names), LengthOfLeastCondition(robot)
    for block in regressor_blocks(robot, measurements):
        excitation.add(block)
        search.add(block)
    return search.length(require_observable(excitation).null)
