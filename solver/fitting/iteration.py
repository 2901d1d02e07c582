"""Fits of a whole set: one, or one after the other until the deflected configurations stand still.

What is known beforehand joins the readings as further rows (method.md §5).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import NotObservableError, SolverError, UnsupportedMethodError
from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.fitting.methods import MethodAccumulator
from jointstiff.solver.fitting.prior import Prior, PriorRows
from jointstiff.solver.fitting.robust import RobustFit, fit_huber
from jointstiff.solver.fitting.scale import scale_of
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.observability.identifiability import Excitation, Observability
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.complementary_stiffness import LargestStiffness, neglected_readings
from jointstiff.solver.regression.regressor import (
    BLOCK_LENGTH,
    RegressorBlock,
    keep_for,
    regressor_blocks,
)
from jointstiff.solver.regression.stage_rows import TargetRows
from jointstiff.solver.robot.model import Robot


def fit_with_prior(
    method: MethodAccumulator, observability: Observability, settings: Settings, sigma: float | None
) -> Fit:
    """Fit under the constraints, with the prior if there is one.

    A prior's weight beside the readings is sigma/s₀; a sigma that is not given is estimated first, from the
    readings alone.

    Args:
        method: the rows of all observations.
        observability: of the same.
        settings: constraints and prior.
        sigma: standard uncertainty of one coordinate of one reading [m], or None.

    Returns:
        The fit; with a prior its `alone` is that of the readings alone.

    Raises:
        UnsupportedMethodError: sigma is not given and cannot be estimated.
    """
    alone = method.fit(observability.null, settings.constraints)
    if settings.prior is None:
        return alone
    sigma = scale_of(alone, method.judged.rows, sigma).sigma
    if not sigma:
        raise UnsupportedMethodError(
            "weighting a prior needs sigma, which is not given and cannot be estimated from these readings",
            where="priors",
            remedy="state `noise`, or add observations",
        )
    fit = method.fit(observability.null, settings.constraints, settings.prior.rows(sigma))
    return replace(fit, alone=alone)


def prior_to_data(alone: Fit, prior: Prior, sigma: float) -> FloatArray:
    """Information of the prior over that of the readings, ``s₀⁻² / (sigma² C_jj)⁻¹``, the others unknown.

    Args:
        alone: the fit of the readings alone.
        prior: of the n compliances.
        sigma: standard uncertainty of one coordinate of one reading [m].

    Returns:
        (n,) NaN where there is no prior; inf where the readings determine no more than a combination.
    """
    variance = sigma**2 * np.diagonal(alone.covariance)
    ratio = np.where(prior.known, variance / prior.standard_uncertainty**2, np.nan)
    for group in alone.undetermined:
        for joint in group.joints:
            ratio[joint] = np.inf if prior.known[joint] else np.nan
    return np.asarray(ratio)


MAX_ITERATIONS = 20
"""Maximum number of fits with K_c: each shrinks the change by the ratio of K_c to the joint stiffness,
typically 1/1000."""
_STILL = 1e-10
"""Relative change of the compliances still to come at which the iteration has converged."""
_FAR_BELOW = 1e-4
"""The same in standard uncertainties by the residuals: readings without noise are fitted to rounding."""
_SHRINKS = 1e-3
"""Least factor by which a fit is taken to shrink the change: the ratio of K_c to the joint stiffness."""
SHIFT_OBSERVATIONS = 4096
"""Number of fits that show the effect of K_c."""


class NewMethod(Protocol):
    """Makes an accumulator of the method that was asked for, empty."""

    def __call__(self) -> MethodAccumulator:
        """One for each fit."""


@dataclass(frozen=True, eq=False)
class Iteration:
    """One fit of a whole set."""

    #: observability of the joints, in the unloaded configurations; the first pass settles it for all
    observability: Observability
    method: MethodAccumulator  #: the rows that were fitted
    fit: Fit  #: the outcome
    largest_stiffness: LargestStiffness  #: K_c over the set
    robust: RobustFit | None  #: weights of the readings by the Huber loss; None for the squared loss
    targets: TargetRows | None  #: the rows of that loss
    first_block: RegressorBlock  #: the first observations, with their regressors

    def blocks(
        self,
        robot: Robot,
        measurements: Measurements,
        compliance: FloatArray | None = None,
        most: int = sys.maxsize,
    ) -> Iterator[RegressorBlock]:
        """Yield the observations that were fitted, as they were weighted; of many blocks `most` at most."""
        if len(measurements) <= BLOCK_LENGTH:
            yield self.first_block
            return
        weighed = measurements if self.robust is None else self.robust.weigh(measurements)
        yield from regressor_blocks(robot, weighed.evenly(most), compliance)


def fit_once(
    robot: Robot,
    measurements: Measurements,
    settings: Settings,
    new_method: NewMethod,
    before: Iteration | None = None,
) -> Iteration:
    """Fit once.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: loss, constraints and prior.
        new_method: method and weighting.
        before: an earlier pass, by whose compliances the load bends the robot; None neglects K_c.

    Raises:
        JointstiffError: as `jointstiff.solver.identification.identify`.
    """
    compliance = None if before is None else before.fit.compliance
    excitation, method = Excitation(robot.joint_names), new_method()
    largest, robust, targets = LargestStiffness(robot.n), None, None
    if settings.loss == "huber":
        targets, robust = _weights(robot, measurements, settings, before)
        measurements = robust.weigh(measurements)
    first_block = None
    for block in regressor_blocks(robot, measurements, compliance):
        excitation.add(block)
        method.add(block)
        largest.add(block)
        first_block = first_block or block
    if first_block is None:  # measurements hold at least one observation
        raise SolverError("there are no observations")
    observability = require_observable(excitation) if before is None else before.observability
    fit = fit_with_prior(
        method, observability, settings, measurements.sigma if robust is None else robust.sigma
    )
    return Iteration(observability, method, fit, largest, robust, targets, first_block)


def _weights(
    robot: Robot, measurements: Measurements, settings: Settings, before: Iteration | None
) -> tuple[TargetRows, RobustFit]:
    """Solve the Huber problem of this pass; a scale that is not known is settled by the first one."""
    compliance = None if before is None else before.fit.compliance
    sigma = measurements.sigma
    if before is not None and before.robust is not None:
        sigma = before.robust.sigma
    excitation, targets = Excitation(robot.joint_names), TargetRows(robot.n)
    for block in regressor_blocks(robot, measurements, compliance):
        excitation.add(block)
        targets.add(block)
    null = (require_observable(excitation) if before is None else before.observability).null
    return targets, fit_huber(
        targets,
        null,
        settings.constraints,
        prior=settings.prior,
        sigma=sigma,
        threshold=settings.huber_threshold,
    )


def iterate_to_convergence(
    robot: Robot, measurements: Measurements, settings: Settings, new_method: NewMethod, first: Iteration
) -> tuple[Iteration, int]:
    """Fit with K_c until the compliances that bend the robot are those that are found.

    The first fit starts from the first-order effect of K_c; noise leaves nothing for a second one to find.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: loss, constraints and prior.
        new_method: method and weighting.
        first: the fit without K_c.

    Returns:
        The last fit, and how many it took after the first.

    Raises:
        SolverError: the compliances do not settle within `MAX_ITERATIONS`.
    """
    known = measurements.sigma or _noise(first)
    prior = settings.prior.rows(known) if settings.prior and known else None
    shift = neglected_shift(robot, measurements, first, prior)
    at = replace(first, fit=replace(first.fit, compliance=first.fit.compliance + shift))
    size = np.maximum(np.abs(first.fit.compliance), first.observability.reference_compliance)
    shrinks = float((np.abs(shift) / size).max())
    for rounds in range(1, MAX_ITERATIONS + 1):
        before, last = at, fit_once(robot, measurements, settings, new_method, at)
        at = last
        change = np.abs(last.fit.compliance - before.fit.compliance)
        size = np.maximum(np.abs(last.fit.compliance), first.observability.reference_compliance)
        uncertainty = _noise(last) * np.sqrt(np.diagonal(last.fit.covariance))
        if (change * max(shrinks, _SHRINKS) <= np.maximum(_STILL * size, _FAR_BELOW * uncertainty)).all():
            keep_for(measurements, last.fit.compliance)
            return last, rounds
    raise SolverError(
        f"the iteration with the complementary stiffness did not converge: after {MAX_ITERATIONS} "
        f"fits the compliances still change by {(change / size).max():.1e} (relative)",
        where="complementary_stiffness",
        remedy="neglect the complementary stiffness, or add postures and loads that excite every joint",
    )


def neglected_shift(
    robot: Robot, measurements: Measurements, neglected: Iteration, prior: PriorRows | None
) -> FloatArray:
    """Return the change of the compliances if K_c were included, to first order.

    The readings lose what the model left out, and the estimator is linear where bounds stay as active as they
    are. Of a set beyond `SHIFT_OBSERVATIONS` as many stand for the whole, evenly spread. Where loads of all
    directions make the observations' shares cancel, that overstates it: by the root of the set's size over
    theirs.

    Returns:
        (n,) change [rad/(N·m)], zero for joints at a bound.
    """
    fit = neglected.fit
    estimated = np.flatnonzero(~neglected.observability.null & (fit.active == 0))
    shift, share = np.zeros(robot.n), min(1.0, SHIFT_OBSERVATIONS / len(measurements))
    for block in neglected.blocks(robot, measurements, most=SHIFT_OBSERVATIONS):
        left_out = replace(block, measurements=neglected_readings(block, fit.compliance))
        shift -= neglected.method.responses([left_out], estimated, prior)[:, 0]
    return shift / share


def _noise(last: Iteration) -> float:
    """Return sigma by the residuals of a fit [m]; zero where there is no freedom."""
    return scale_of(last.fit, last.method.judged.rows, None).sigma or 0.0


def require_observable(excitation: Excitation) -> Observability:
    """Return what the readings see.

    Raises:
        NotObservableError: nothing at all.
    """
    observability = excitation.observability()
    if not excitation.anything_moved:
        raise NotObservableError(
            "no target moved, so no compliance can be identified",
            where="observations",
            remedy="check that the loaded readings were taken with the load applied",
        )
    if observability.null.all():
        reasons = "; ".join(str(reason).split(":")[0] for reason in observability.reasons)
        raise NotObservableError(
            f"the readings do not determine any joint: {reasons}",
            where="observations",
            remedy="add loads with a torque about the joints' axes, and targets away from these axes",
        )
    return observability
