"""Identification of joint stiffnesses: the story from measurements to an estimate (method.md §2-§6, §8).

Fit once without the complementary stiffness K_c; with K_c, fit again until the fitted compliances equal those
with which the robot was bent. Then propagate the errors that all observations share, and compute sigma,
uncertainties, intervals and verdicts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError, NotObservableError, SolverError, UnsupportedMethodError
from jointstiff.solver.fit.estimate import (
    CommonErrors,
    ComplementaryStiffness,
    Estimate,
    Evidence,
    LeverProfile,
)
from jointstiff.solver.fit.lever import FreeLoad, ProfileEnds
from jointstiff.solver.fit.method import (
    Method,
    MethodRows,
    Settings,
    find_length_of_least_condition,
    find_spherical_wrist,
    refuse_missing_poses,
)
from jointstiff.solver.fit.observability import Excitation, Observability
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.rest import find_rest
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import Certificate, solve, solve_step
from jointstiff.solver.fit.stages import (
    Fit,
    Likelihood,
    RobustFit,
    Scale,
    SolveProblem,
    TargetRows,
    estimate_scale,
    fit_huber,
    fit_method,
)
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.mechanics.block import Term, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import NEGLECTED_STIFFNESS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, TERMS, list_stated_terms

MAX_ITERATIONS: Final = 60
"""Maximum number of fits: with K_c alone two or three suffice, with stated errors five to fifteen."""
_CHANGE_TOLERANCE: Final = 1e-10
"""Largest relative change of the compliances by a further fit at rest."""
_CHANGE_IN_UNCERTAINTIES: Final = 1e-6
"""Largest change of the compliances by a further fit at rest, in standard uncertainties; for readings without
noise the uncertainty is zero, and `_CHANGE_TOLERANCE` decides."""
_MOST_UNCERTAINTIES: Final = 20.0
"""Greatest fitted error, in its standard uncertainties, that still is the error that was stated."""
SHIFT_OBSERVATIONS: Final = 4096
"""Maximum number of observations from which the effect of neglecting K_c is estimated."""
_LEAST_SIGMA: Final = 1e-15
"""Rounding of a position [m]: sigma is at least this, so that exact readings do not divide by zero."""


def identify(rows: Rows, settings: Settings) -> Estimate:
    """Identify the joint compliances of a robot from measured deflections.

    Args:
        rows: N observations of a robot with n joints.
        settings: settings of the fit.

    Returns:
        The estimate, with intervals, verdicts and certificates.

    Raises:
        UnsupportedMethodError: the readings or the robot cannot support the method or weighting.
        NotObservableError: the readings determine no joint.
        MeasurementError: an array has a wrong shape or wrong numbers, or the numbers overflow.
        SolverError: optimality could not be certified, or the load has no balance with K_c.
    """
    return _identify(rows, settings, why_without_k_c=None)


def _identify(rows: Rows, settings: Settings, why_without_k_c: str | None) -> Estimate:
    """Identify the joint compliances; arguments, result and errors are those of `identify`.

    `why_without_k_c` is the reason why the settings neglect the complementary stiffness K_c although it was
    requested; None if they do not.
    """
    refuse_unsupported(rows, settings)
    unloaded_rows = rows.at(None)  # in the postures without the load
    problem = _state_problem(unloaded_rows, settings)
    first_fit = problem.fit_unbent_robot()
    final = _fit_until_at_rest(problem, first_fit)
    certified_fit = final.problem.certify(final.fit)
    estimate = _build_estimate(final.problem, certified_fit)
    effect_of_k_c = _describe_complementary_stiffness(final, first_fit, estimate)
    return replace(
        estimate,
        characteristic_length=problem.method.characteristic_length,
        complementary_stiffness=replace(effect_of_k_c, obstacle=why_without_k_c),
        statements_dropped=final.statements_dropped,
    )


def _state_problem(rows: Rows, settings: Settings) -> _Problem:
    """Return the data of a fit: method, observability, and the stated errors to fit with the joints.

    Stated errors are errors of the load and of places whose standard uncertainty the user stated.

    Raises:
        NotObservableError: the readings determine no joint.
    """
    observability = _require_observable(Excitation.of(rows))
    characteristic_length = _find_characteristic_length(rows, settings, observability)
    method = Method(rows.robot, settings, characteristic_length)
    stated_errors = _list_stated_errors_to_fit(rows.measurements, settings, method)
    return _Problem(rows, settings, method, observability, stated_errors)


class _FinalFit(NamedTuple):
    """Last of several fits, at which the robot is bent by the fitted compliances."""

    problem: _Problem  #: problem of this fit: without stated errors if the readings contradict them
    fit: _SingleFit
    iterations: int  #: number of fits after the first
    statements_dropped: str | None = None  #: why stated errors were not fitted after all; None if they were


def _fit_until_at_rest(problem: _Problem, first: _SingleFit) -> _FinalFit:
    """Repeat the fit until the compliances that bend the robot equal the fitted compliances.

    The complementary stiffness K_c bends the robot, and the columns of stated errors (errors of the load and
    of places that are fitted within their stated uncertainties) depend on the compliances, too. If the
    readings contradict the stated uncertainties, the errors are propagated after the fit instead. Without K_c
    and stated errors, the first fit is the last.

    Args:
        problem: observations, settings and stated errors.
        first: fit without K_c and stated errors.

    Raises:
        SolverError: the load has no balance with K_c, or the compliances do not come to rest.
    """
    why_dropped = None
    if problem.stated_errors:
        try:
            final = _repeat_until_at_rest(problem, first)
            _refuse_contradicted_statements(final.fit)
        except SolverError as error:
            why_dropped = error.reason
        else:
            return final
    problem = replace(problem, stated_errors=())
    final = _FinalFit(problem, first, iterations=0)
    if problem.settings.complementary_stiffness:
        final = _repeat_until_at_rest(problem, first)
    return final._replace(statements_dropped=why_dropped)


def _describe_complementary_stiffness(
    final: _FinalFit, first: _SingleFit, estimate: Estimate
) -> ComplementaryStiffness:
    """Return the effect of the complementary stiffness K_c on a fit.

    K_c (n, n) is the change of the joints' torques by their deflections, as the load moves with the arm.

    Args:
        final: last fit.
        first: fit without K_c and stated errors.
        estimate: estimate from the last fit.
    """
    problem = final.problem
    is_included = problem.settings.complementary_stiffness
    only_k_c_changed_the_fit = is_included and not problem.stated_errors
    if only_k_c_changed_the_fit:
        shift = final.fit.compliance - first.compliance
    else:
        shift = _estimate_neglected_shift(problem, first, estimate.sigma)
    ratios = np.abs(estimate.compliance)[:, None] * _find_largest_stiffness(problem.rows)  # |K_c,ij| c_i
    ratios_of_estimates = ratios[np.ix_(estimate.estimated, estimate.estimated)]
    return ComplementaryStiffness(
        included=is_included,
        iterations=final.iterations if is_included else 0,
        largest_ratio=float(ratios_of_estimates.max(initial=0.0)),
        largest_shift=_find_largest_standardised_shift(shift, estimate),
        shift=shift,
    )


def _find_characteristic_length(rows: Rows, settings: Settings, observability: Observability) -> float | None:
    """Return the characteristic length [m] that makes displacements and rotations comparable.

    It is the length of the settings, or else that of the least condition number; None for other weightings.
    """
    if settings.weighting != "characteristic_length":
        return None
    if settings.characteristic_length is not None:
        return settings.characteristic_length
    with_unit_length = Method(rows.robot, settings, length=1.0)
    return find_length_of_least_condition(with_unit_length, rows, observability.null)


def _find_largest_stiffness(rows: Rows) -> FloatArray:
    """Return the greatest |K_c,ij| (n, n) over the observations, in the unloaded postures [N·m/rad]."""
    largest = [np.abs(block.complementary_stiffness).max(axis=0) for block in rows.generate_blocks()]
    return np.asarray(np.max(largest, axis=0))


def _refuse_contradicted_statements(last: _SingleFit) -> None:
    """Refuse a fit that explains the readings by errors of load or places far larger than stated.

    Raises:
        SolverError: an error is more than `_MOST_UNCERTAINTIES` standard uncertainties from zero.
    """
    errors = last.compressed.fit_statements(last.compliance).unknowns  # in standard uncertainties
    greatest = float(np.abs(errors).max(initial=0.0))
    if greatest > _MOST_UNCERTAINTIES:
        raise SolverError(
            f"the fit changes a stated quantity by {greatest:.0f} times its standard uncertainty"
        )


def _list_stated_errors_to_fit(
    measurements: Measurements, settings: Settings, method: Method
) -> tuple[Term, ...]:
    """Return the terms (kinds of error) with stated uncertainties that are fitted together with the joints.

    Only a method of one stage with weights by covariance and squared loss can fit them. Otherwise the errors
    are propagated after the fit, and no term is returned.
    """
    has_one_stage = len(method.stages) == 1
    can_fit_errors = has_one_stage and method.by_covariance and settings.loss == "squared"
    return list_stated_terms(measurements) if can_fit_errors else ()


def identify_with_fallback(rows: Rows, settings: Settings) -> tuple[Settings, Estimate]:
    """Identify the compliances; if that fails with the complementary stiffness K_c, identify without K_c.

    With K_c the load has no balance if the joints are very soft, as readings in a wrong unit make them
    appear. The estimate then records why K_c was neglected.

    Returns:
        The settings that were used, and the estimate.

    Raises:
        JointstiffError: the identification fails for another reason than K_c.
    """
    try:
        return settings, identify(rows, settings)
    except SolverError as error:
        if error.where != "complementary_stiffness":
            raise
        why_without_k_c = error.reason
    settings_without_k_c = replace(settings, complementary_stiffness=False)
    return settings_without_k_c, _identify(rows, settings_without_k_c, why_without_k_c)


def refuse_unsupported(rows: Rows, settings: Settings) -> None:
    """Refuse settings that the readings or the robot cannot support, before any work is done.

    Raises:
        UnsupportedMethodError: names what is missing and a remedy.
    """
    measurements = rows.measurements
    if settings.method == "decoupled_partial_pose":
        find_spherical_wrist(rows.robot)
    if settings.method != "partial_pose":
        refuse_missing_poses(measurements)
    if settings.loss != "squared" and measurements.direction is not None:
        raise UnsupportedMethodError(
            f"loss {settings.loss} needs the length of each residual, but a reading along one direction "
            "has no such length",
            where="loss",
            remedy="use loss squared, or omit the readings along a direction",
        )
    if settings.weighting != "covariance":
        _refuse_unsupported_weighting(measurements, settings)


def _refuse_unsupported_weighting(measurements: Measurements, settings: Settings) -> None:
    """Refuse what a weighting other than that by covariance cannot support.

    Raises:
        UnsupportedMethodError: names what is missing and a remedy.
    """
    weighting = settings.weighting
    if settings.prior is not None:
        raise UnsupportedMethodError(
            f"weighting {weighting} does not use the uncertainty of the readings, so a prior cannot be "
            "weighed against the readings",
            where="weighting",
            remedy="use weighting covariance, or omit `priors`",
        )
    if measurements.encoders is not None:
        raise UnsupportedMethodError(
            f"weighting {weighting} cannot combine encoder readings (angles) with positions (lengths)",
            where="weighting",
            remedy="use weighting covariance, or omit the encoder readings",
        )
    if weighting == "characteristic_length" and settings.method != "complete_pose":
        raise UnsupportedMethodError(
            f"weighting {weighting} needs rotations, but method {settings.method} does not use rotations",
            where="weighting",
            remedy="use weighting covariance, or method complete_pose",
        )


@dataclass(frozen=True, eq=False)
class _SingleFit:
    """One fit of all observations; with K_c or stated errors several fits follow each other."""

    rows: Rows  # observations with the weights of the fit, at the compliances that bend the robot
    compressed: MethodRows  # rows that were fitted
    fit: Fit
    robust: RobustFit | None  # weights of the readings by the Huber loss; None for the squared loss
    targets: TargetRows | None  # rows for the Huber loss; None for the squared loss

    @property
    def compliance(self) -> FloatArray:
        """Fitted compliances (n,) [rad/(N·m)]."""
        return self.fit.compliance

    def list_certificates(self) -> tuple[Certificate, ...]:
        """Return the certificates of the stages, after that of the robust fit, if there is one."""
        if self.robust is None:
            return self.fit.certificates
        return (self.robust.certificate, *self.fit.certificates)

    def estimate_sigma_from_residuals(self) -> float:
        """Return sigma, the standard deviation of a coordinate, from the residuals [m].

        The result is 0 without degrees of freedom to estimate sigma from.
        """
        scale = estimate_scale(self.fit, self.compressed.all_readings, None)
        return scale.sigma or 0.0


@dataclass(frozen=True, eq=False)
class _Problem:
    """Observations, settings and stated errors of a fit, which all repetitions share."""

    rows: Rows  # N observations in their unloaded postures
    settings: Settings
    method: Method
    observability: Observability  # in the unloaded postures
    stated_errors: tuple[Term, ...]  # errors with stated uncertainties, fitted together with the joints

    def fit_unbent_robot(self) -> _SingleFit:
        """Fit all observations once, without a certificate; neglect K_c and stated errors."""
        return self._fit_joints(self.rows, stated_errors=None, before=None)

    def fit_bent_robot(self, compliance: FloatArray, before: _SingleFit) -> _SingleFit:
        """Fit all observations once, without a certificate, to a robot that given compliances bend.

        The robot is bent where the complementary stiffness K_c is part of the model. The columns of stated
        errors, too, are computed at these compliances.

        Args:
            compliance: (n,) compliances that bend the robot [rad/(N·m)].
            before: the fit before, which gives an unknown sigma.
        """
        bent_rows = self.rows.at(compliance) if self.settings.complementary_stiffness else self.rows
        stated_errors = None
        if self.stated_errors:
            stated_errors = self._compute_stated_errors_at(compliance, before)
        return self._fit_joints(bent_rows, stated_errors, before)

    def _fit_joints(
        self, rows: Rows, stated_errors: Statements | None, before: _SingleFit | None
    ) -> _SingleFit:
        """Fit joints and stated errors to rows, by least squares or with the Huber loss.

        The Huber loss gives weights of the readings; least squares with these weights give its estimate.

        Args:
            rows: N observations in their postures, bent or not.
            stated_errors: errors to fit with the joints; None without any.
            before: the fit before; None for the first fit.
        """
        robust, targets = None, None
        if self.settings.loss == "huber":
            targets = TargetRows.of(rows)
            robust = self._fit_huber(targets, before)
            weighted_readings = robust.reweight(rows.measurements)
            rows = rows.of(weighted_readings)
        compressed = MethodRows.compress(self.method, rows, stated_errors)
        fit = self._solve_compressed_rows(compressed, robust, solve_step)
        return _SingleFit(rows, compressed, fit, robust, targets)

    def certify(self, last: _SingleFit) -> _SingleFit:
        """Return the last fit, solved again by Clarabel, with certificates of its optimum."""
        certified = self._solve_compressed_rows(last.compressed, last.robust, solve)
        return replace(last, fit=certified)

    def _solve_compressed_rows(
        self, compressed: MethodRows, robust: RobustFit | None, solve_problem: SolveProblem
    ) -> Fit:
        """Return the fit of compressed rows, with the prior of the settings.

        With a prior, the fit without the prior is its attribute `alone`.

        Args:
            compressed: compressed rows of all observations.
            robust: fit with the Huber loss, which gives sigma; None for the squared loss.
            solve_problem: function that solves a problem.
        """
        constraints, has_no_effect = self.settings.constraints, self.observability.null
        fit = fit_method(compressed, has_no_effect, constraints, solve_problem=solve_problem)
        if self.settings.prior is None:
            return fit
        # A prior is weighed against the noise of the readings. A sigma that is not stated is estimated from
        # the readings alone, without the prior.
        stated_sigma = self.rows.measurements.sigma if robust is None else robust.sigma
        sigma = _require_sigma_for_prior(estimate_scale(fit, compressed.all_readings, stated_sigma))
        prior = self.settings.prior.in_units_of(sigma)
        fit_with_prior = fit_method(compressed, has_no_effect, constraints, prior, solve_problem)
        return replace(fit_with_prior, alone=fit)

    def _fit_huber(self, targets: TargetRows, before: _SingleFit | None) -> RobustFit:
        """Fit the joints with Huber's loss; an unknown sigma is estimated by the first fit and then kept.

        Args:
            targets: whitened rows of all readings.
            before: the fit before; None for the first fit.
        """
        sigma = self.rows.measurements.sigma
        if before is not None and before.robust is not None:
            sigma = before.robust.sigma
        return fit_huber(
            targets,
            has_no_effect=self.observability.null,
            constraints=self.settings.constraints,
            prior=self.settings.prior,
            sigma=sigma,
            threshold=self.settings.huber_threshold,
        )

    def _compute_stated_errors_at(self, compliance: FloatArray, before: _SingleFit) -> Statements:
        """Return the stated errors to fit with the joints, with their columns at compliances (n,).

        Args:
            compliance: (n,) compliances [rad/(N·m)]; negative ones count as zero.
            before: the fit before, whose residuals give sigma where sigma is not stated.
        """
        measurements = self.rows.measurements
        sigma = measurements.sigma or before.estimate_sigma_from_residuals()
        return Statements(
            terms=self.stated_errors,
            common=measurements.common_uncertainty,
            compliance=np.maximum(compliance, 0.0),
            sigma=max(sigma, LEAST_STATED_SIGMA),
        )


def _require_sigma_for_prior(scale: Scale) -> float:
    """Return the sigma of a scale [m].

    Raises:
        UnsupportedMethodError: sigma is neither stated nor estimated.
    """
    if not scale.sigma:
        raise UnsupportedMethodError(
            "a prior is weighted with sigma, but sigma is not given and cannot be estimated from these "
            "readings",
            where="priors",
            remedy="state `noise`, or add observations",
        )
    return scale.sigma


def _require_observable(excitation: Excitation) -> Observability:
    """Return the observability of the joints; refuse readings that determine no joint.

    Raises:
        NotObservableError: no target moved, or the readings determine no joint.
    """
    if not excitation.anything_moved:
        raise NotObservableError(
            "no target moved, so no compliance can be identified",
            where="observations",
            remedy="check that the loaded readings were taken with the load applied",
        )
    observability = excitation.observability()
    if observability.null.all():
        short_reasons = [str(reason).split(":")[0] for reason in observability.reasons]
        distinct_reasons = ", or ".join(dict.fromkeys(short_reasons))
        raise NotObservableError(
            f"the readings do not determine any joint: {distinct_reasons}",
            where="observations",
            remedy="add loads with a torque about the joints' axes, and targets away from these axes",
        )
    return observability


class _Repetition:
    """Fits that follow each other, each to the robot that is bent by given compliances.

    Attributes:
        last: last fit.
        count: number of fits after the first.
    """

    def __init__(self, problem: _Problem, first: _SingleFit) -> None:
        """Start from a first fit of the problem."""
        self._problem = problem
        self.last = first
        self.count = 0

    def fit(self, compliance: FloatArray) -> FloatArray:
        """Fit the robot that compliances (n,) bend, and return the fitted compliances (n,) [rad/(N·m)]."""
        self.last = self._problem.fit_bent_robot(compliance, before=self.last)
        self.count += 1
        return self.last.compliance


def _repeat_until_at_rest(problem: _Problem, first: _SingleFit) -> _FinalFit:
    """Repeat the fit until the fitted compliances equal those that bend the robot, a fixed point.

    With the complementary stiffness K_c, the compliances bend the robot; the columns of stated errors depend
    on them, too.

    Args:
        problem: observations, settings and stated errors.
        first: fit without K_c and stated errors.

    Raises:
        SolverError: the compliances do not come to rest in `MAX_ITERATIONS` fits.
    """
    repetition = _Repetition(problem, first)
    find_rest(
        repetition.fit,
        start=_estimate_compliances_at_rest(problem, first),
        unit=_list_changes_at_rest(problem.observability, first),
        most_steps=MAX_ITERATIONS,
    )
    # The last fit is that at the fixed point.
    return _FinalFit(problem, repetition.last, iterations=repetition.count)


def _estimate_compliances_at_rest(problem: _Problem, first: _SingleFit) -> FloatArray:
    """Estimate the compliances (n,) at which the fits come to rest [rad/(N·m)].

    These are the compliances of the first fit and, if K_c is part of the model, the effect of K_c to first
    order. So with noisy readings and without stated errors, a single further fit suffices.
    """
    if not problem.settings.complementary_stiffness:
        return first.compliance
    sigma = problem.rows.measurements.sigma or first.estimate_sigma_from_residuals()
    return first.compliance + _estimate_neglected_shift(problem, first, sigma)


def _list_changes_at_rest(observability: Observability, first: _SingleFit) -> FloatArray:
    """Return the greatest changes (n,) of the compliances by a further fit that count as rest [rad/(N·m)].

    They are small compared with the compliance, or with its standard uncertainty if that is larger. The size
    of a compliance is at least the one that would cause all of the measured deflections.
    """
    # A joint that nothing moves has no compliance to compare with.
    reference = np.maximum(observability.reference_compliance, np.finfo(np.float64).tiny)
    size = np.maximum(np.abs(first.compliance), reference)
    uncertainty = first.estimate_sigma_from_residuals() * np.sqrt(np.diagonal(first.fit.covariance))
    uncertainty = np.where(np.isfinite(uncertainty), uncertainty, 0.0)
    return np.maximum(_CHANGE_TOLERANCE * size, _CHANGE_IN_UNCERTAINTIES * uncertainty)


def _estimate_neglected_shift(problem: _Problem, without_k_c: _SingleFit, sigma: float | None) -> FloatArray:
    """Return the change (n,) of the compliances if K_c were included, to first order [rad/(N·m)].

    Joints at a bound stay at the bound. Of a large set only `SHIFT_OBSERVATIONS` evenly spread observations
    are used, and the change is multiplied by the ratio of the numbers of observations; where loads in all
    directions cancel, this overstates the change.

    Args:
        problem: observations and settings.
        without_k_c: fit that neglects K_c.
        sigma: standard uncertainty of a coordinate [m], which weighs the prior; None leaves the prior out.
    """
    fit = without_k_c.fit
    sample = without_k_c.rows.at(None).select_evenly(SHIFT_OBSERVATIONS)
    is_free = ~problem.observability.null & (fit.active == 0)
    prior = problem.settings.prior
    weighed_prior = prior.in_units_of(sigma) if prior and sigma else None
    responses = without_k_c.compressed.compute_responses(
        sample, [NEGLECTED_STIFFNESS], fit.compliance, np.flatnonzero(is_free), weighed_prior
    )
    bias = responses[NEGLECTED_STIFFNESS.name][:, 0]  # by neglecting K_c
    return -bias * (len(problem.rows) / len(sample))


def _build_estimate(problem: _Problem, last_fit: _SingleFit) -> Estimate:
    """Build the estimate from the last fit: sigma, uncertainties, intervals and a verdict on each joint.

    With the Huber loss, a robust scale replaces a sigma that is unknown.
    """
    scale = _estimate_final_scale(problem, last_fit)
    fit, common_errors = _add_uncertainties(problem, last_fit, scale)
    covariance = None if scale.sigma is None else np.float64(scale.sigma) ** 2 * fit.covariance
    _refuse_overflow(fit, scale, covariance)
    evidence = _collect_evidence(problem, last_fit, fit, scale, common_errors)
    likelihood: Likelihood | None = fit.likelihood
    second_order = None
    if evidence.profiles:
        # Beyond first order, errors of the load add to the uncertainty of joints near the line of the load.
        second_order = evidence.compute_extra_uncertainties()
        covariance = None if covariance is None else covariance + np.diag(np.square(second_order))
        likelihood = _widen_likelihood(fit, second_order / (scale.sigma or 1.0), evidence.list_open_joints())
    return Estimate(
        joints=evidence.derive_joint_results(),
        compliance=fit.compliance,
        balanced=last_fit.rows.balanced,
        covariance=covariance,
        sigma=scale.sigma,
        sigma_given=scale.given,
        chi_square=_compute_chi_square(last_fit, scale),
        degrees_of_freedom=scale.degrees_of_freedom,
        identifiability=fit.identifiability,
        certificates=last_fit.list_certificates(),
        compressed=last_fit.compressed,
        observability=problem.observability,
        likelihood=likelihood,
        common=common_errors,
        second_order=second_order,
        robust=last_fit.robust,
    )


def _collect_evidence(
    problem: _Problem, last_fit: _SingleFit, fit: Fit, scale: Scale, common_errors: CommonErrors | None
) -> Evidence:
    """Return the data on which the verdicts on the joints are based.

    Args:
        problem: observations and settings.
        last_fit: last fit, whose rows belong to its compliances.
        fit: the outcome of this fit, with the uncertainty of errors that all observations share.
        scale: sigma.
        common_errors: errors that all observations share; None without any.
    """
    settings = problem.settings
    return Evidence(
        names=problem.rows.robot.joint_names,
        fit=fit,
        observability=problem.observability,
        scale=scale,
        constraints=settings.constraints,
        confidence=settings.confidence,
        prior_to_data=_compare_prior_to_data(fit.alone, settings.prior, scale.sigma, len(fit.compliance)),
        profiles=_profile_short_levers(problem, last_fit, fit, scale, common_errors),
    )


def _compute_chi_square(last_fit: _SingleFit, scale: Scale) -> float:
    """Return the chi-square of the last fit: with the Huber loss, that of the targets' weighted residuals."""
    robust, targets = last_fit.robust, last_fit.targets
    if robust is None or targets is None:
        return scale.chi_square
    return targets.chi_square(last_fit.compliance, sigma=robust.sigma, threshold=robust.threshold)


def _add_uncertainties(
    problem: _Problem, last_fit: _SingleFit, scale: Scale
) -> tuple[Fit, CommonErrors | None]:
    """Return the last fit with all uncertainties in its covariance, and the errors common to all readings.

    There are no common errors where sigma is unknown.
    """
    fit, sigma = last_fit.fit, scale.sigma
    if last_fit.robust is not None:
        # The weights of the Huber loss come from the residuals, which makes the covariance larger.
        fit = fit.multiply_covariance(last_fit.robust.inflation)
    if sigma is None:
        return fit, None
    common_errors = _propagate_common_errors(problem, last_fit, sigma)
    if common_errors is None:
        return fit, None
    # The covariance of a fit is in units of sigma.
    responses = common_errors.responses_to_unfitted_errors / sigma
    return fit.add_common_errors(responses), common_errors


def _widen_likelihood(fit: Fit, uncertainty: FloatArray, open_joints: IndexArray) -> Likelihood | None:
    """Return the likelihood of the compliances with further independent uncertainties of the joints.

    None if the likelihood has no joint left.

    Args:
        fit: fit of n joints.
        uncertainty: (n,) further standard uncertainties, in units of sigma.
        open_joints: joints that are left out, because their compliance has no upper end.
    """
    widened = fit.add_common_errors(np.diag(uncertainty)).likelihood
    known = widened.leave_out(open_joints)
    return known if len(known.joints) else None


def _estimate_final_scale(problem: _Problem, last_fit: _SingleFit) -> Scale:
    """Return sigma, as stated or from the residuals, and the chi-square of the last fit.

    With a prior, sigma comes from the fit without the prior, and chi-square from the fit with the prior.
    """
    stated_sigma = problem.rows.measurements.sigma
    sigma = stated_sigma if last_fit.robust is None else last_fit.robust.sigma
    fit, all_readings = last_fit.fit, last_fit.compressed.all_readings
    if fit.alone is None:
        scale = estimate_scale(fit, all_readings, sigma)
        is_given = scale.given
    else:
        without_prior = estimate_scale(fit.alone, all_readings, sigma)
        scale = estimate_scale(fit, all_readings, without_prior.sigma)
        is_given = without_prior.given
    # A robust scale is not a stated sigma.
    scale = replace(scale, given=is_given and stated_sigma is not None)
    return scale if scale.sigma is None else replace(scale, sigma=max(scale.sigma, _LEAST_SIGMA))


def _refuse_overflow(fit: Fit, scale: Scale, covariance: FloatArray | None) -> None:
    """Refuse a fit with numbers that are not finite.

    Raises:
        MeasurementError: a compliance, its covariance or chi-square is not finite.
    """
    arrays = [fit.compliance, np.array([scale.chi_square, scale.degrees_of_freedom])]
    if covariance is not None:
        arrays.append(covariance)
    if not all(np.isfinite(array).all() for array in arrays):
        raise MeasurementError(
            "the numbers overflow: the magnitudes of loads, lengths and sigma are inconsistent",
            where="units",
            remedy="check the units of force, length and sigma",
        )


def _propagate_common_errors(problem: _Problem, last_fit: _SingleFit, sigma: float) -> CommonErrors | None:
    """Return the changes of the compliances by one standard uncertainty of each error common to all readings.

    Each kind of error is a term, such as the load point, with k unknowns. The uncertainty of an error is
    stated, or comes from an earlier fit that corrected the readings for the error. None without such errors.

    Args:
        problem: observations and settings.
        last_fit: last fit, whose rows belong to its compliances.
        sigma: standard uncertainty of a coordinate [m], which weighs a prior against the readings.
    """
    measurements, prior = problem.rows.measurements, problem.settings.prior
    corrected = fitted_errors(measurements)  # errors for which the readings were corrected
    stated_terms = _list_terms_to_propagate(measurements)
    if not (stated_terms or corrected.terms):
        return None
    responses = last_fit.compressed.compute_responses(
        last_fit.rows,
        [*stated_terms, *corrected.terms],
        last_fit.compliance,
        joints=np.flatnonzero(~problem.observability.null),
        prior=None if prior is None else prior.in_units_of(sigma),
    )
    common_uncertainty = measurements.common_uncertainty
    by_source = {}
    for term in stated_terms:
        response = responses[term.name]  # (n, k) for unit errors
        # Repeat the term's uncertainties until each of the k unknowns has its own.
        uncertainties = np.resize(term.prior(common_uncertainty), response.shape[1])
        by_source[common_uncertainty.source(term.name)] = uncertainties * response
    if corrected.terms:
        response = np.hstack([responses[term.name] for term in corrected.terms])
        by_source["fitted_causes"] = response @ corrected.root  # root of the covariance of these errors
    terms_in_fit = last_fit.compressed.statements.terms
    in_fit = frozenset(common_uncertainty.source(term.name) for term in terms_in_fit)
    return CommonErrors(by_source, in_fit)


def _list_terms_to_propagate(measurements: Measurements) -> list[Term]:
    """Return the kinds of error whose uncertainty is stated, and that no earlier fit has estimated.

    The uncertainty of errors that an earlier fit has estimated comes from that fit.
    """
    already_estimated = {term.name for term in fitted_errors(measurements).terms}
    stated_terms = []
    for term in TERMS.values():
        is_stated = any(term.prior(measurements.common_uncertainty))
        if is_stated and term.name not in already_estimated:
            stated_terms.append(term)
    return stated_terms


def _profile_short_levers(
    problem: _Problem, last_fit: _SingleFit, fit: Fit, scale: Scale, common_errors: CommonErrors | None
) -> dict[int, LeverProfile]:
    """Return profile-likelihood intervals of the joints near the line of the load, by the joint's index.

    At such a joint an error of the load's place changes the torque by as much as the torque itself, so that
    intervals to first order do not suffice. The errors of the load are free in the profiles. A joint that the
    readings determine only in combination with others has no profile.

    There are no profiles for readings without noise, as these determine the load point, too, so that
    intervals to first order are exact enough.

    Args:
        problem: observations, settings and stated errors.
        last_fit: last fit, whose rows belong to its compliances.
        fit: the fit, with the uncertainty of errors that all observations share.
        scale: sigma.
        common_errors: errors that all observations share; None without any.
    """
    if common_errors is None or not scale.sigma or scale.sigma < LEAST_STATED_SIGMA:
        return {}
    free_load = _build_free_load(problem, last_fit, scale.sigma)
    if free_load is None:
        return {}
    quantiles = scale.list_quantiles(problem.settings.confidence)
    inflation = 1.0 if last_fit.robust is None else last_fit.robust.inflation
    radii = scale.sigma * np.sqrt(inflation) * quantiles
    combined_joints = {j for group in fit.undetermined for j in group.joints}
    profiles = {}
    for index in np.flatnonzero(free_load.has_short_lever).tolist():
        j = int(free_load.joints[index])  # the index of the joint is `index` among those that are seen
        if j in combined_joints:
            continue
        ends = free_load.profile(index).find_ends(radii)
        other_errors = _OtherErrors.of(problem.rows.measurements, common_errors, j, quantiles)
        first_order_uncertainty = scale.sigma * float(np.sqrt(fit.covariance[j, j]))
        profile = _build_profile(ends, other_errors, float(last_fit.compliance[j]), first_order_uncertainty)
        if profile.intervals is not None:
            bounds = problem.settings.constraints.bounds
            profile = replace(
                profile,
                intervals=np.clip(profile.intervals, bounds.lower[j], bounds.upper[j]),
                replaces_first_order=bool(last_fit.compressed.statements.terms),
            )
        profiles[j] = profile
    return profiles


def _build_profile(
    ends: ProfileEnds, other_errors: _OtherErrors, estimate: float, first_order_uncertainty: float
) -> LeverProfile:
    """Return the profile of a joint: intervals of its compliance, and its standard uncertainty.

    The intervals contain those without and those within the constraints, each widened by the joint's errors
    that are no unknowns of the profile. The standard uncertainty comes from the interval without constraints,
    as a constraint may cut an interval short; it is at least that to first order.

    Args:
        ends: intervals by the profile alone, two-sided and one-sided; without an upper end there are none.
        other_errors: errors of the joint that are no unknowns of the profile.
        estimate: fitted compliance [rad/(N·m)].
        first_order_uncertainty: standard uncertainty of the compliance to first order [rad/(N·m)].
    """
    has_all_ends = np.isfinite(np.concatenate(ends)).all()
    if not has_all_ends:
        return LeverProfile()
    unconstrained = other_errors.widen(ends.without_constraints, estimate)
    constrained = other_errors.widen(ends.within_constraints, estimate)
    lower = np.minimum(unconstrained[:, 0], constrained[:, 0])
    upper = np.maximum(unconstrained[:, 1], constrained[:, 1])
    two_sided, quantile = unconstrained[0], float(other_errors.quantiles[0])
    half_width = float(np.ptp(two_sided)) / 2.0
    return LeverProfile(
        intervals=np.column_stack([lower, upper]),
        standard_uncertainty=max(first_order_uncertainty, half_width / quantile),
    )


class _OtherErrors(NamedTuple):
    """Errors of one joint's compliance that are no unknowns of its profile."""

    standard_uncertainty: float  # of the compliance [rad/(N·m)]
    force_scale: float  # relative uncertainty of all forces, which multiplies the compliance
    quantiles: FloatArray  # (q,) expanded uncertainties over the standard uncertainty

    @classmethod
    def of(
        cls, measurements: Measurements, common_errors: CommonErrors, j: int, quantiles: FloatArray
    ) -> _OtherErrors:
        """Return the other errors of joint j: all but the stated errors of load and places."""
        common = measurements.common_uncertainty
        terms_in_profile = list_stated_terms(measurements)
        counted_by_themselves = [*terms_in_profile, FORCE_SCALE]
        sources = [common.source(term.name) for term in counted_by_themselves]
        responses = common_errors.responses_to_others(sources)[j]
        return cls(float(np.linalg.norm(responses)), common.scale, quantiles)

    def widen(self, intervals: FloatArray, estimate: float) -> FloatArray:
        """Return intervals (q, 2) around an estimate, widened by these errors [rad/(N·m)].

        Distances of the ends from the estimate and errors at the ends are added in squares. An interval that
        does not contain the estimate is widened to contain the estimate.
        """
        standard_errors = np.hypot(self.standard_uncertainty, self.force_scale * intervals)
        expanded_errors = self.quantiles[:, None] * standard_errors
        signs = np.array([-1.0, 1.0])  # of the distances from the estimate to lower and upper ends
        distances = np.maximum(signs * (intervals - estimate), 0.0)
        return np.asarray(estimate + signs * np.hypot(distances, expanded_errors))


def _build_free_load(problem: _Problem, last_fit: _SingleFit, sigma: float) -> FreeLoad | None:
    """Return the readings with the errors of the load as unknowns, at the compliances of the last fit.

    None if no joint has a short lever, which means that it is near the line of the load.
    """
    measurements = problem.rows.measurements
    stated_errors = Statements(
        terms=list_stated_terms(measurements),
        common=measurements.common_uncertainty,
        compliance=np.maximum(last_fit.compliance, 0.0),
        sigma=sigma,
    )
    has_effect = ~problem.observability.null
    return FreeLoad.of(last_fit.rows, problem.settings, stated_errors, np.flatnonzero(has_effect))


def _compare_prior_to_data(
    fit_without_prior: Fit | None, prior: Prior | None, sigma: float | None, n: int
) -> FloatArray:
    """Return for each joint the ratio (n,) of the prior's information to the readings' information.

    The ratio is ``s₀⁻² / (sigma² C_jj)⁻¹``, with s₀ the prior's standard uncertainty and C_jj the variance
    from the readings; NaN for joints without a prior, and inf where the readings alone determine only a
    combination with other joints.
    """
    if fit_without_prior is None or prior is None or sigma is None:
        return np.full(n, np.nan)
    variance = sigma**2 * np.diagonal(fit_without_prior.covariance)
    ratio = variance / prior.standard_uncertainty**2
    for group in fit_without_prior.undetermined:
        ratio[list(group.joints)] = np.inf
    return np.where(prior.known, ratio, np.nan)


def _find_largest_standardised_shift(shift: FloatArray | None, estimate: Estimate) -> float | None:
    """Return the largest change of a compliance in standard uncertainties; None if no uncertainty is known.

    Uncertainties that were assumed, not stated, are left out of the standard uncertainty.

    Args:
        shift: (n,) change of the compliances [rad/(N·m)]; None where unknown.
        estimate: estimate of n compliances.
    """
    if shift is None or estimate.covariance is None:
        return None
    variance = _compute_variance_without_assumed_errors(estimate, estimate.covariance)
    has_uncertainty = estimate.estimated & (variance > 0.0)
    if not has_uncertainty.any():
        return None
    standardised_shift = np.abs(shift[has_uncertainty]) / np.sqrt(variance[has_uncertainty])
    return float(standardised_shift.max())


def _compute_variance_without_assumed_errors(estimate: Estimate, covariance: FloatArray) -> FloatArray:
    """Return the variances (n,) of the compliances without errors whose uncertainty was only assumed.

    These are the errors of the load point and of the size of the forces; errors of an assumed load point
    count beyond first order, too.

    Args:
        estimate: estimate of n compliances.
        covariance: (n, n) covariance of the compliances by all errors.
    """
    variance = np.diagonal(covariance)
    common = estimate.common
    if common is None:
        return variance
    for source in ("assumed_load_point", "assumed_force_scale"):
        responses = common.responses_to(source)  # (n, k)
        variance = variance - np.square(responses).sum(axis=1)
    if "assumed_load_point" in common.by_source:
        variance = variance - np.diagonal(estimate.square_second_order())
    return variance
