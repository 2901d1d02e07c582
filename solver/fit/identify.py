"""Identification of joint stiffnesses: the story from measurements to an estimate (method.md §2-§6, §8).

Fit once without the complementary stiffness K_c; with K_c, fit again until the fitted compliances equal those
with which the robot was bent. Then propagate the errors that all observations share, and compute sigma,
uncertainties, intervals and verdicts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
from jointstiff.solver.fit.lever import FreeLoad, Profile, ProfileEnds
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
from jointstiff.solver.fit.problem import Certificate
from jointstiff.solver.fit.rest import find_rest
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import (
    Likelihood,
    MethodFit,
    RobustFit,
    Scale,
    SolvedMethod,
    TargetRows,
    estimate_scale,
    fit_huber,
    solve_method,
)
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.fit.triangle import Triangle
from jointstiff.solver.mechanics.block import Term, fitted_errors
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.springs import NEGLECTED_STIFFNESS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, LOAD_POINT, TERMS, list_stated_terms
from jointstiff.solver.models import JOINTS, ElasticModel

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
_WEAKENING: Final = 3.0
"""Factor on the uncertainty of a fitted load point, if a fit to the same readings leaves the point free.

The statement then has a tenth of their weight."""
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
        JointstiffError: one of the errors of `fit_scalars` and `describe`.
    """
    return describe(fit_scalars(rows, settings))


def fit_scalars(rows: Rows, settings: Settings) -> JointsFit:
    """Fit the joint compliances of a robot to measured deflections, without their uncertainties.

    If the fit fails with the complementary stiffness K_c, the joints are fitted without K_c, and the fit
    records why. So it fails if the joints are so soft that the load has no balance with K_c, as readings in a
    wrong unit make them appear.

    Args:
        rows: N observations of a robot with n joints.
        settings: settings of the fit.

    Raises:
        UnsupportedMethodError: the readings or the robot cannot support the method or weighting.
        NotObservableError: the readings determine no joint.
        MeasurementError: an array has a wrong shape or wrong numbers, or the numbers overflow.
        SolverError: an optimum could not be certified.
    """
    try:
        return _fit_as_stated(rows, settings)
    except SolverError as error:
        if error.where != "complementary_stiffness":
            raise
        why_without_k_c = error.reason
    settings_without_k_c = replace(settings, complementary_stiffness=False)
    without_k_c = _fit_as_stated(rows, settings_without_k_c)
    return replace(without_k_c, why_without_k_c=why_without_k_c)


def _fit_as_stated(rows: Rows, settings: Settings) -> JointsFit:
    """Fit the joint compliances with exactly these settings.

    Raises:
        SolverError: an optimum could not be certified, or the load has no balance with K_c.
    """
    refuse_unsupported(rows, settings)
    unloaded_rows = rows.at(None)  # in the postures without the load
    problem, compressed = _state_problem(unloaded_rows, settings)
    fit = _fit_until_at_rest(problem, first=problem.fit_unbent_robot(compressed))
    _refuse_overflow(fit.compliance, fit.scale, covariance=None)
    return fit


def describe(fit: JointsFit) -> Estimate:
    """Return the estimate of a fit: sigma, uncertainties, intervals and a verdict on each joint.

    The last least-squares problem is solved again by Clarabel, as a witness of the optimum.

    Raises:
        MeasurementError: the numbers overflow.
        SolverError: an optimum or the end of an interval could not be certified.
    """
    estimate = _build_estimate(fit.problem, fit.last.certify(), fit.scale)
    return replace(
        estimate,
        characteristic_length=fit.problem.method.characteristic_length,
        complementary_stiffness=_describe_complementary_stiffness(fit, estimate),
        statements_dropped=fit.statements_dropped,
    )


def _state_problem(rows: Rows, settings: Settings) -> tuple[_Problem, MethodRows | None]:
    """Return the data of a fit: method, observability, and the stated errors to fit with the joints.

    Stated errors are errors of the load and of places whose standard uncertainty the user stated.

    Returns:
        The data, and the rows of the first fit, compressed in the same pass over the observations. The rows
        are None if the first fit needs something that must be found before.

    Raises:
        NotObservableError: the readings determine no joint.
    """
    length_must_be_found = (
        settings.weighting == "characteristic_length" and settings.characteristic_length is None
    )
    compressed = None
    if settings.loss == "squared" and not length_must_be_found:  # Huber's loss gives the rows weights
        method = Method(rows.robot, settings, settings.characteristic_length)
        excitation = Excitation(rows.robot.joint_kinds)
        compressed = MethodRows.compress(method, rows, excitation=excitation)
        observability = _require_observable(excitation)
    else:
        observability = _require_observable(Excitation.of(rows))
        method = Method(rows.robot, settings, _find_characteristic_length(rows, settings, observability))
    stated_errors = _list_stated_errors_to_fit(rows.measurements, settings, method)
    return _Problem(rows, settings, method, observability, stated_errors), compressed


@dataclass(frozen=True, eq=False)
class JointsFit:
    """Joint compliances that fit N observations best, in balance with the loads; `describe` has the rest."""

    problem: _Problem  #: problem of the last fit: without stated errors if the readings contradict them
    first: _SingleFit  #: fit without K_c and stated errors
    last: _SingleFit  #: fit of the robot that is bent by these compliances
    iterations: int  #: number of fits after the first
    #: (n,) change of the compliances by K_c to first order, from which the search for the rest started
    #: [rad/(N·m)]; None without K_c
    expected_shift: FloatArray | None = None
    statements_dropped: str | None = None  #: why stated errors were not fitted after all; None if they were
    why_without_k_c: str | None = None  #: why K_c was neglected although it was requested; None if it was not

    @property
    def model(self) -> ElasticModel:
        """Model of the parts that bend: the joints alone."""
        return JOINTS

    @property
    def statements(self) -> Statements:
        """Stated errors that were fitted together with the compliances."""
        return self.last.compressed.statements

    @property
    def certificates(self) -> tuple[Certificate, ...]:
        """Certificates of the stages of the last fit."""
        return self.last.list_certificates()

    @property
    def settings(self) -> Settings:
        """Settings of the fit: without K_c if the fit with K_c failed."""
        return self.problem.settings

    @property
    def method(self) -> Method:
        """Method of the fit, with its stages."""
        return self.problem.method

    @property
    def observability(self) -> Observability:
        """Observability of the joints in the readings."""
        return self.problem.observability

    @property
    def compliance(self) -> FloatArray:
        """Fitted compliances (n,) [rad/(N·m)]."""
        return self.last.compliance

    @property
    def balanced(self) -> FloatArray | None:
        """Compliances (n,) that bent the robot in the last fit [rad/(N·m)]; None without K_c."""
        return self.last.rows.balanced

    @cached_property
    def scale(self) -> Scale:
        """Sigma, as stated or from the residuals, and the chi-square of the targets' residuals."""
        return _estimate_final_scale(self.problem, self.last, self.last.describe())


def _fit_until_at_rest(problem: _Problem, first: _SingleFit) -> JointsFit:
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
            return _fit_with_stated_errors(problem, first)
        except SolverError as error:
            why_dropped = error.reason
    without_stated_errors = replace(problem, stated_errors=())
    fit = JointsFit(without_stated_errors, first, last=first, iterations=0)
    if problem.settings.complementary_stiffness:
        fit = _repeat_until_at_rest(without_stated_errors, first)
    return replace(fit, statements_dropped=why_dropped)


def _fit_with_stated_errors(problem: _Problem, first: _SingleFit) -> JointsFit:
    """Fit joints together with stated errors, until the compliances come to rest.

    Raises:
        SolverError: the compliances do not come to rest, or the readings contradict the stated errors.
    """
    fit = _repeat_until_at_rest(problem, first)
    _refuse_contradicted_statements(fit.last)
    return fit


def _describe_complementary_stiffness(fit: JointsFit, estimate: Estimate) -> ComplementaryStiffness:
    """Return the effect of the complementary stiffness K_c on a fit.

    K_c (n, n) is the change of the joints' torques by their deflections, as the load moves with the arm.

    Args:
        fit: fit of the joints.
        estimate: estimate of this fit.
    """
    is_included = fit.settings.complementary_stiffness
    shift = _find_shift_by_complementary_stiffness(fit, estimate.sigma)
    ratios = np.abs(estimate.compliance)[:, None] * fit.observability.greatest_stiffness  # |K_c,ij| c_i
    ratios_of_estimates = ratios[np.ix_(estimate.estimated, estimate.estimated)]
    return ComplementaryStiffness(
        included=is_included,
        iterations=fit.iterations if is_included else 0,
        largest_ratio=float(ratios_of_estimates.max(initial=0.0)),
        largest_shift=_find_largest_standardised_shift(shift, estimate),
        shift=shift,
        obstacle=fit.why_without_k_c,
    )


def _find_shift_by_complementary_stiffness(fit: JointsFit, sigma: float | None) -> FloatArray:
    """Return the change (n,) of the compliances by the complementary stiffness K_c [rad/(N·m)].

    Where nothing but K_c distinguishes the last fit from the first, the change is the difference of the two;
    else it is estimated to first order.

    Args:
        fit: fit of the joints.
        sigma: standard uncertainty of a coordinate [m], which weighs a prior; None if unknown.
    """
    only_k_c_changed_the_fit = fit.settings.complementary_stiffness and not fit.problem.stated_errors
    if only_k_c_changed_the_fit:
        return fit.compliance - fit.first.compliance
    has_prior = fit.settings.prior is not None
    if fit.expected_shift is not None and not has_prior:  # the final sigma would only weigh a prior anew
        return fit.expected_shift
    return _estimate_neglected_shift(fit.problem, fit.first, sigma)


def _find_characteristic_length(rows: Rows, settings: Settings, observability: Observability) -> float | None:
    """Return the characteristic length [m] that makes displacements and rotations comparable.

    It is the length of the settings, or else that of the least condition number; None for other weightings.
    """
    if settings.weighting != "characteristic_length" or settings.characteristic_length is not None:
        return settings.characteristic_length
    with_unit_length = Method(rows.robot, settings, length=1.0)
    return find_length_of_least_condition(with_unit_length, rows, observability.null)


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
    needs_rotations = settings.weighting == "characteristic_length"
    if settings.prior is not None:
        problem = (
            "does not use the uncertainty of the readings, so a prior cannot be weighed against the readings"
        )
        alternative = "omit `priors`"
    elif measurements.encoders is not None:
        problem = "cannot combine encoder readings (angles) with positions (lengths)"
        alternative = "omit the encoder readings"
    elif needs_rotations and settings.method != "complete_pose":
        problem = f"needs rotations, but method {settings.method} does not use rotations"
        alternative = "method complete_pose"
    else:
        return
    raise UnsupportedMethodError(
        f"weighting {settings.weighting} {problem}",
        where="weighting",
        remedy=f"use weighting covariance, or {alternative}",
    )


@dataclass(frozen=True, eq=False)
class _SingleFit:
    """One fit of all observations; with K_c or stated errors several fits follow each other."""

    rows: Rows  # observations with the weights of the fit, at the compliances that bend the robot
    compressed: MethodRows  # rows that were fitted
    solved: SolvedMethod  # optimum
    without_prior: MethodFit | None  # fit without the prior; None without a prior
    robust: RobustFit | None  # weights of the readings by the Huber loss; None for the squared loss
    #: rows for the Huber loss; None for the squared loss, or after the fit if a further fit follows
    targets: TargetRows | None

    @property
    def compliance(self) -> FloatArray:
        """Fitted compliances (n,) [rad/(N·m)]."""
        return self.solved.compliance

    def certify(self) -> _SingleFit:
        """Return the fit, solved again by Clarabel, whose own answer is a witness of the optimum."""
        return replace(self, solved=self.solved.certify())

    def describe(self) -> MethodFit:
        """Return the fit with its covariance, and with what the readings determine."""
        return replace(self.solved.describe(), without_prior=self.without_prior)

    def list_certificates(self) -> tuple[Certificate, ...]:
        """Return the certificates of the stages, after that of the robust fit, if there is one."""
        of_stages = [stage.solution.certificate for stage in self.solved.stages.values()]
        of_robust_fit = [] if self.robust is None else [self.robust.certificate]
        return (*of_robust_fit, *of_stages)

    def compute_huber_chi_square(self) -> float | None:
        """Return chi-square with residuals limited to the threshold of the Huber loss.

        None for the squared loss.
        """
        if self.robust is None or self.targets is None:
            return None
        return self.targets.chi_square(
            self.compliance, sigma=self.robust.sigma, threshold=self.robust.threshold
        )

    def estimate_sigma_from_residuals(self) -> float:
        """Return sigma, the standard deviation of a coordinate, from the residuals [m].

        The result is 0 without degrees of freedom to estimate sigma from.
        """
        return self.estimate_sigma(self.describe())

    def estimate_sigma(self, fit: MethodFit) -> float:
        """Return sigma from the residuals of this fit, whose description is known [m]."""
        scale = estimate_scale(fit, self.compressed.all_readings, None)
        return scale.sigma or 0.0


@dataclass(frozen=True, eq=False)
class _Problem:
    """Observations, settings and stated errors of a fit, which all repetitions share."""

    rows: Rows  # N observations in their unloaded postures
    settings: Settings
    method: Method
    observability: Observability  # in the unloaded postures
    stated_errors: tuple[Term, ...]  # errors with stated uncertainties, fitted together with the joints

    def fit_unbent_robot(self, compressed: MethodRows | None) -> _SingleFit:
        """Fit all observations once, without a certificate; neglect K_c and stated errors.

        `compressed` are the rows of this fit; they are computed if None.
        """
        if compressed is None:
            return self._fit_joints(self.rows, stated_errors=None, before=None)
        solved, without_prior = self._solve_compressed_rows(compressed, None)
        return _SingleFit(self.rows, compressed, solved, without_prior, robust=None, targets=None)

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
        solved, without_prior = self._solve_compressed_rows(compressed, robust)
        return _SingleFit(rows, compressed, solved, without_prior, robust, targets)

    def _solve_compressed_rows(
        self, compressed: MethodRows, robust: RobustFit | None
    ) -> tuple[SolvedMethod, MethodFit | None]:
        """Return the optimum for compressed rows, with the prior of the settings, and the fit without prior.

        The latter is None if the settings have no prior.

        Args:
            compressed: compressed rows of all observations.
            robust: fit with the Huber loss, which gives sigma; None for the squared loss.
        """
        constraints, has_no_effect = self.settings.constraints, self.observability.null
        solved = solve_method(compressed, has_no_effect, constraints)
        if self.settings.prior is None:
            return solved, None
        # A prior is weighed against the noise of the readings. A sigma that is not stated is estimated from
        # the readings alone, without the prior.
        without_prior = solved.describe()
        stated_sigma = self.rows.measurements.sigma if robust is None else robust.sigma
        sigma = _require_sigma_for_prior(estimate_scale(without_prior, compressed.all_readings, stated_sigma))
        prior = self.settings.prior.in_units_of(sigma)
        solved = solve_method(compressed, has_no_effect, constraints, prior)
        return solved, without_prior

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
        raise _build_no_joint_error(observability)
    return observability


def _build_no_joint_error(observability: Observability) -> NotObservableError:
    """Build the error for readings that determine no joint, with the distinct reasons of the joints.

    The reason of a joint begins with what is missing, up to a colon: `the load never twists this joint`.
    """
    short_reasons = [str(reason).split(":")[0] for reason in observability.reasons]
    distinct_reasons = ", or ".join(dict.fromkeys(short_reasons))
    return NotObservableError(
        f"the readings do not determine any joint: {distinct_reasons}",
        where="observations",
        remedy="add loads with a torque about the joints' axes, and targets away from these axes",
    )


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


def _repeat_until_at_rest(problem: _Problem, first: _SingleFit) -> JointsFit:
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
    expected_shift = _expect_shift(problem, first)
    start = first.compliance if expected_shift is None else first.compliance + expected_shift
    find_rest(
        repetition.fit,
        start=start,
        unit=_list_changes_at_rest(problem.observability, first),
        most_steps=MAX_ITERATIONS,
    )
    # The last fit is that at the fixed point. The targets' rows of the first fit are not needed any more.
    return JointsFit(
        problem,
        first=replace(first, targets=None),
        last=repetition.last,
        iterations=repetition.count,
        expected_shift=expected_shift,
    )


def _expect_shift(problem: _Problem, first: _SingleFit) -> FloatArray | None:
    """Return the change (n,) of the first fit's compliances by K_c, to first order [rad/(N·m)].

    With noisy readings and without stated errors, a single further fit at the changed compliances suffices.
    None if K_c is not part of the model.
    """
    if not problem.settings.complementary_stiffness:
        return None
    sigma = problem.rows.measurements.sigma or first.estimate_sigma_from_residuals()
    return _estimate_neglected_shift(problem, first, sigma)


def _list_changes_at_rest(observability: Observability, first: _SingleFit) -> FloatArray:
    """Return the greatest changes (n,) of the compliances by a further fit that count as rest [rad/(N·m)].

    They are small compared with the compliance, or with its standard uncertainty if that is larger. The size
    of a compliance is at least the one that would cause all of the measured deflections.
    """
    # A joint that nothing moves has no compliance to compare with.
    reference = np.maximum(observability.reference_compliance, np.finfo(np.float64).tiny)
    size = np.maximum(np.abs(first.compliance), reference)
    fit = first.describe()
    uncertainty = first.estimate_sigma(fit) * np.sqrt(np.diagonal(fit.covariance))
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
    solved = without_k_c.solved
    sample = without_k_c.rows.at(None).select_evenly(SHIFT_OBSERVATIONS)
    is_free = ~problem.observability.null & (solved.active == 0)
    prior = problem.settings.prior
    weighed_prior = prior.in_units_of(sigma) if prior and sigma else None
    responses = without_k_c.compressed.compute_responses(
        sample, [NEGLECTED_STIFFNESS], solved.compliance, np.flatnonzero(is_free), weighed_prior
    )
    bias = responses[NEGLECTED_STIFFNESS.name][:, 0]  # by neglecting K_c
    return -bias * (len(problem.rows) / len(sample))


@dataclass(frozen=True, eq=False)
class _DescribedFit:
    """Last fit together with its uncertainties."""

    problem: _Problem  # observations, settings and stated errors
    last: _SingleFit  # last fit, whose rows belong to its compliances
    scale: Scale  # sigma and the residuals under sigma
    fit: MethodFit  # last fit, with the uncertainty of all errors in its covariance
    common_errors: CommonErrors | None  # errors that all observations share; None without any

    @classmethod
    def of(cls, problem: _Problem, last: _SingleFit, scale: Scale) -> _DescribedFit:
        """Describe the last fit of a problem; where sigma is unknown, there are no common errors."""
        fit = last.describe()
        if last.robust is not None:
            # The weights of the Huber loss come from the residuals, which makes the covariance larger.
            fit = fit.multiply_covariance(last.robust.inflation)
        common_errors = None
        if scale.sigma is not None:
            common_errors = _propagate_common_errors(problem, last, scale.sigma)
        if scale.sigma is not None and common_errors is not None:
            # The covariance of a fit is in units of sigma.
            fit = fit.add_common_errors(common_errors.responses_to_unfitted_errors / scale.sigma)
        return cls(problem, last, scale, fit, common_errors)

    @property
    def covariance(self) -> FloatArray | None:
        """Covariance (n, n) of the unconstrained estimate [(rad/(N·m))²]; None where sigma is unknown."""
        if self.scale.sigma is None:
            return None
        return np.asarray(np.float64(self.scale.sigma) ** 2 * self.fit.covariance)

    @property
    def combined_joints(self) -> frozenset[int]:
        """Joints that the readings determine only in combination with other joints."""
        return frozenset(j for group in self.fit.undetermined for j in group.joints)

    def collect_evidence(self) -> Evidence:
        """Return the data on which the verdicts on the joints are based.

        They include profile-likelihood intervals of joints near the line of the load, where intervals to
        first order do not suffice.
        """
        settings = self.problem.settings
        prior_to_data = _compare_prior_to_data(
            self.fit.without_prior, settings.prior, self.scale.sigma, joint_count=len(self.fit.compliance)
        )
        return Evidence(
            names=self.problem.rows.robot.joint_names,
            fit=self.fit,
            observability=self.problem.observability,
            scale=self.scale,
            constraints=settings.constraints,
            confidence=settings.confidence,
            prior_to_data=prior_to_data,
            prior=settings.prior,
            profiles=_profile_joints_near_load(self),
        )


class _BeyondFirstOrder(NamedTuple):
    """Uncertainty of the compliances by all errors, with errors of the load beyond first order."""

    covariance: FloatArray | None  # (n, n) [(rad/(N·m))²]; None where sigma is unknown
    likelihood: Likelihood | None  # of the joints whose compliance has an upper end; None without any
    #: (n,) standard uncertainties that the load's errors beyond first order add [rad/(N·m)]; None if no joint
    #: is near the line of the load
    added: FloatArray | None

    @classmethod
    def of(cls, described: _DescribedFit, evidence: Evidence) -> _BeyondFirstOrder:
        """Add the errors of the load beyond first order, for joints near the line of the load."""
        fit, covariance = described.fit, described.covariance
        if not evidence.profiles:
            return cls(covariance, fit.likelihood, added=None)
        added = evidence.compute_extra_uncertainties()
        if covariance is not None:
            covariance = covariance + np.diag(np.square(added))
        in_units_of_sigma = added / (described.scale.sigma or 1.0)
        likelihood = _widen_likelihood(fit, in_units_of_sigma, evidence.list_open_joints())
        return cls(covariance, likelihood, added)


def _build_estimate(problem: _Problem, last_fit: _SingleFit, scale: Scale) -> Estimate:
    """Build the estimate from the last fit: uncertainties, intervals and a verdict on each joint.

    Args:
        problem: observations and settings.
        last_fit: last fit.
        scale: sigma, and the chi-square of this fit.

    Raises:
        MeasurementError: the numbers overflow.
        SolverError: the end of an interval could not be certified.
    """
    described = _DescribedFit.of(problem, last_fit, scale)
    fit = described.fit
    _refuse_overflow(fit.compliance, scale, described.covariance)
    evidence = described.collect_evidence()
    uncertainty = _BeyondFirstOrder.of(described, evidence)
    return Estimate(
        joints=evidence.derive_joint_results(),
        compliance=fit.compliance,
        balanced=last_fit.rows.balanced,
        covariance=uncertainty.covariance,
        sigma=scale.sigma,
        sigma_given=scale.given,
        chi_square=scale.chi_square,
        degrees_of_freedom=scale.degrees_of_freedom,
        identifiability=fit.identifiability,
        certificates=last_fit.list_certificates(),
        compressed=last_fit.compressed,
        observability=problem.observability,
        likelihood=uncertainty.likelihood,
        common=described.common_errors,
        second_order=uncertainty.added,
        robust=last_fit.robust,
    )


def _widen_likelihood(fit: MethodFit, uncertainty: FloatArray, open_joints: IndexArray) -> Likelihood | None:
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


def _estimate_final_scale(problem: _Problem, last_fit: _SingleFit, fit: MethodFit) -> Scale:
    """Return sigma, as stated or from the residuals, and the chi-square of the last fit.

    The Huber loss has a sigma of its own: the stated one, or a robust scale of the residuals if sigma is
    unknown; and its chi-square limits each residual to the threshold of the loss. Sigma is at least the
    rounding error of a position.

    Args:
        problem: observations and settings.
        last_fit: last fit.
        fit: description of this fit.
    """
    stated_sigma = problem.rows.measurements.sigma
    all_readings = last_fit.compressed.all_readings
    sigma = stated_sigma if last_fit.robust is None else last_fit.robust.sigma
    scale = _estimate_scale_with_prior(fit, all_readings, sigma)
    huber_chi_square = last_fit.compute_huber_chi_square()
    if huber_chi_square is not None:
        is_stated = scale.given and stated_sigma is not None  # a robust scale is not a stated sigma
        scale = replace(scale, given=is_stated, chi_square=huber_chi_square)
    return scale if scale.sigma is None else replace(scale, sigma=max(scale.sigma, _LEAST_SIGMA))


def _estimate_scale_with_prior(fit: MethodFit, all_readings: Triangle, sigma: float | None) -> Scale:
    """Return the scale of the residuals, for sigma [m] or, if it is None, for sigma from the residuals.

    With a prior, sigma comes from the fit without the prior, and chi-square from the fit with the prior.
    """
    if fit.without_prior is None:
        return estimate_scale(fit, all_readings, sigma)
    without_prior = estimate_scale(fit.without_prior, all_readings, sigma)
    with_prior = estimate_scale(fit, all_readings, without_prior.sigma)
    return replace(with_prior, given=without_prior.given)


def _refuse_overflow(compliance: FloatArray, scale: Scale, covariance: FloatArray | None) -> None:
    """Refuse a fit with numbers that are not finite.

    Raises:
        MeasurementError: a compliance, its covariance or chi-square is not finite.
    """
    arrays = [compliance, np.array([scale.chi_square, scale.degrees_of_freedom])]
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
    common = measurements.common_uncertainty
    by_source = _scale_by_stated_uncertainties(responses, stated_terms, common)
    if corrected.terms:
        response = np.hstack([responses[term.name] for term in corrected.terms])
        by_source["fitted_causes"] = response @ corrected.root  # root of the covariance of these errors
    in_fit = frozenset(common.source(term.name) for term in last_fit.compressed.statements.terms)
    return CommonErrors(by_source, in_fit)


def _scale_by_stated_uncertainties(
    responses: Mapping[str, FloatArray], terms: Sequence[Term], common: CommonUncertainty
) -> dict[str, FloatArray]:
    """Return the changes (n, k) of n compliances by one standard uncertainty of each of a term's k unknowns.

    Args:
        responses: changes (n, k) by one unit of each unknown, by the term's name.
        terms: kinds of error whose uncertainty is stated.
        common: the stated standard uncertainties.

    Returns:
        The changes by the source of the error, such as "load_point", or "assumed_load_point" if the
        uncertainty is assumed.
    """
    by_source = dict[str, FloatArray]()
    for term in terms:
        response = responses[term.name]
        # Repeat the term's uncertainties until each of the k unknowns has its own.
        uncertainties = np.resize(term.prior(common), response.shape[1])
        by_source[common.source(term.name)] = uncertainties * response
    return by_source


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


def _profile_joints_near_load(described: _DescribedFit) -> dict[int, LeverProfile]:
    """Return profile-likelihood intervals of the joints near the line of the load, by the joint's index.

    At such a joint an error of the load's place changes the torque by as much as the torque itself, so that
    intervals to first order do not suffice. The errors of the load are free in the profiles. A joint that the
    readings determine only in combination with others has no profile.

    There are no profiles for readings without noise, as these determine the load point, too, so that
    intervals to first order are exact enough.
    """
    common_errors, sigma = described.common_errors, described.scale.sigma
    if common_errors is None or not sigma or sigma < LEAST_STATED_SIGMA:
        return {}
    free_load = _build_free_load(described.problem, described.last, sigma)
    if free_load is None:
        return {}
    profiles = dict[int, LeverProfile]()
    for index in np.flatnonzero(free_load.has_short_lever).tolist():
        joint = int(free_load.joints[index])  # `index` counts the joints that the readings show
        if joint not in described.combined_joints:
            other_errors = _OtherErrors.of(described, common_errors, joint)
            profile = free_load.profile(index)
            profiles[joint] = _profile_joint(described, profile, joint, other_errors)
    return profiles


def _profile_joint(
    described: _DescribedFit, profile: Profile, joint: int, other_errors: _OtherErrors
) -> LeverProfile:
    """Return the profile-likelihood intervals of one joint, within the bounds of its compliance.

    Args:
        described: last fit with its uncertainties.
        profile: least sum of squares for each compliance of the joint, with the errors of the load free.
        joint: index of the joint.
        other_errors: errors of the joint that are no unknowns of the profile.
    """
    sigma, last = described.scale.sigma or 0.0, described.last
    inflation = 1.0 if last.robust is None else last.robust.inflation
    radii = sigma * np.sqrt(inflation) * other_errors.quantiles
    first_order_uncertainty = sigma * float(np.sqrt(described.fit.covariance[joint, joint]))
    ends = profile.find_ends(radii)
    found = _build_profile(ends, other_errors, float(last.compliance[joint]), first_order_uncertainty)
    if found.intervals is None:
        return found
    bounds = described.problem.settings.constraints.bounds
    return replace(
        found,
        intervals=np.clip(found.intervals, bounds.lower[joint], bounds.upper[joint]),
        replaces_first_order=bool(last.compressed.statements.terms),
    )


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
    def of(cls, described: _DescribedFit, common_errors: CommonErrors, joint: int) -> _OtherErrors:
        """Return the other errors of a joint: all but the stated errors of load and places."""
        measurements = described.problem.rows.measurements
        quantiles = described.scale.list_quantiles(described.problem.settings.confidence)
        common = measurements.common_uncertainty
        terms_in_profile = list_stated_terms(measurements)
        counted_by_themselves = [*terms_in_profile, FORCE_SCALE]
        sources = [common.source(term.name) for term in counted_by_themselves]
        responses = common_errors.responses_to_others(sources)[joint]
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

    A load point that was fitted as a cause is free, too, with a weak statement of its place.
    None if no joint has a short lever, which means that it is near the line of the load.
    """
    measurements = problem.rows.measurements
    terms, common = list_stated_terms(measurements), measurements.common_uncertainty
    fitted_uncertainty = _find_uncertainty_of_fitted_load_point(measurements)
    if fitted_uncertainty is not None:
        terms = (*terms, LOAD_POINT)
        common = replace(common, load_point=_WEAKENING * fitted_uncertainty)
    stated_errors = Statements(
        terms=terms,
        common=common,
        compliance=np.maximum(last_fit.compliance, 0.0),
        sigma=sigma,
    )
    has_effect = ~problem.observability.null
    return FreeLoad.of(last_fit.rows, problem.settings, stated_errors, np.flatnonzero(has_effect))


def _find_uncertainty_of_fitted_load_point(measurements: Measurements) -> float | None:
    """Return the greatest standard uncertainty of a coordinate of a load point fitted as a cause [m].

    None if the load point was not fitted.
    """
    errors = fitted_errors(measurements)
    start = 0
    for term, unknowns in zip(errors.terms, errors.unknowns, strict=True):
        rows = slice(start, start + len(unknowns))
        if term.name == LOAD_POINT.name:
            return float(np.linalg.norm(errors.root[rows], axis=1).max())
        start += len(unknowns)
    return None


def _compare_prior_to_data(
    fit_without_prior: MethodFit | None, prior: Prior | None, sigma: float | None, *, joint_count: int
) -> FloatArray:
    """Return for each joint the ratio (n,) of the prior's information to the readings' information.

    The ratio is ``s₀⁻² / (sigma² C_jj)⁻¹``, with s₀ the prior's standard uncertainty and C_jj the variance
    from the readings; NaN for joints without a prior, and inf where the readings alone determine only a
    combination with other joints.
    """
    if fit_without_prior is None or prior is None or sigma is None:
        return np.full(joint_count, np.nan)
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
