"""Identification of joint stiffnesses: the story from measurements to an estimate (method.md §2-§6, §8).

Fit once without the complementary stiffness K_c; with K_c, fit again until the fitted compliances equal those
with which the robot was bent. Then propagate the errors that all observations share, and compute sigma,
uncertainties, intervals and verdicts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, NotObservableError, SolverError, UnsupportedMethodError
from jointstiff.solver.fit.estimate import (
    CommonErrors,
    ComplementaryStiffness,
    Estimate,
    Evidence,
    LeverProfile,
)
from jointstiff.solver.fit.lever import FreeLoad
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
from jointstiff.solver.fit.solution import solve, solve_step
from jointstiff.solver.fit.stages import (
    Find,
    Fit,
    Likelihood,
    RobustFit,
    Scale,
    TargetRows,
    estimate_scale,
    fit_huber,
    fit_method,
)
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements, list_stated_terms
from jointstiff.solver.mechanics.block import Term, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import NEGLECTED_STIFFNESS, complementary_stiffness
from jointstiff.solver.mechanics.terms import FORCE_SCALE, TERMS

MAX_ITERATIONS: Final = 60
"""Maximum number of fits: with K_c alone two or three suffice, with statements five to fifteen."""
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
    refuse_unsupported(rows, settings)
    problem = _state_problem(rows.at(None), settings)
    first = problem.fit_once()
    settled = _settle(problem, first)
    estimate = _build_estimate(settled.problem, settled.problem.certify(settled.last))
    effect = _describe_complementary_stiffness(settled, first, estimate)
    return replace(
        estimate,
        characteristic_length=problem.method.characteristic_length,
        complementary_stiffness=effect,
        statements_dropped=settled.statements_dropped,
    )


def _state_problem(rows: Rows, settings: Settings) -> _Problem:
    """Return the problem of a fit: method, observability, and the statements to be fitted with the joints.

    Raises:
        NotObservableError: the readings determine no joint.
    """
    observability = _require_observable(Excitation.of(rows))
    method = Method(rows.robot, settings, _find_length(rows, settings, observability))
    stated_terms = _list_fitted_statements(rows.measurements, settings, method)
    return _Problem(rows, settings, method, observability, stated_terms)


class _Settled(NamedTuple):
    """Last of several fits, at which the rows belong to the fitted compliances."""

    problem: _Problem  #: problem of the last fit: without statements if the readings contradict them
    last: _Pass
    iterations: int  #: number of fits after the first
    statements_dropped: str | None = None  #: why statements were dropped; None if they were not


def _settle(problem: _Problem, first: _Pass) -> _Settled:
    """Repeat the fit until the rows belong to the fitted compliances.

    Rows depend on the compliances by the complementary stiffness K_c, which bends the robot, and by columns
    of statements. If the readings contradict the statements, these are dropped: their errors are propagated
    after the fit instead.

    Args:
        problem: observations, settings and statements.
        first: fit without K_c and statements.

    Raises:
        SolverError: the load has no balance with K_c, or the compliances do not come to rest.
    """
    statements_dropped = None
    if problem.stated_terms:
        try:
            last, iterations = _iterate_to_rest(problem, first)
            _refuse_contradicted(last)
            return _Settled(problem, last, iterations)
        except SolverError as error:
            problem, statements_dropped = replace(problem, stated_terms=()), error.reason
    last, iterations = first, 0
    if problem.settings.complementary_stiffness:
        last, iterations = _iterate_to_rest(problem, first)
    return _Settled(problem, last, iterations, statements_dropped)


def _describe_complementary_stiffness(
    settled: _Settled, first: _Pass, estimate: Estimate
) -> ComplementaryStiffness:
    """Return the effect of the complementary stiffness K_c on a fit.

    Args:
        settled: last fit.
        first: fit without K_c and statements.
        estimate: estimate from the last fit.
    """
    problem = settled.problem
    is_included = problem.settings.complementary_stiffness
    if is_included and not problem.stated_terms:
        shift = settled.last.fit.compliance - first.fit.compliance
    else:
        shift = _estimate_neglected_shift(problem, first, estimate.sigma)
    estimated = estimate.estimated
    stiffness_ratios = np.abs(estimate.compliance)[:, None] * _find_largest_stiffness(problem.rows)
    return ComplementaryStiffness(
        included=is_included,
        iterations=settled.iterations if is_included else 0,
        largest_ratio=float(stiffness_ratios[np.ix_(estimated, estimated)].max(initial=0.0)),
        largest_shift=_find_largest_standardised_shift(shift, estimate),
        shift=shift,
    )


def _find_length(rows: Rows, settings: Settings, observability: Observability) -> float | None:
    """Return the characteristic length [m], as given or of least condition; None for other weightings."""
    if settings.weighting != "characteristic_length":
        return None
    if settings.characteristic_length is not None:
        return settings.characteristic_length
    with_unit_length = Method(rows.robot, settings, 1.0)
    return find_length_of_least_condition(with_unit_length, rows, observability.null)


def _find_largest_stiffness(rows: Rows) -> FloatArray:
    """Return the largest entries (n, n) of K_c in the unloaded postures of a set [N·m/rad]."""
    largest_of_blocks = [
        np.abs(complementary_stiffness(block)).max(axis=0) for block in rows.generate_blocks()
    ]
    return np.asarray(np.max(largest_of_blocks, axis=0))


def _refuse_contradicted(fit: _Pass) -> None:
    """Refuse a fit that explains the readings by errors far larger than stated.

    Raises:
        SolverError: an error is more than `_MOST_UNCERTAINTIES` standard uncertainties from zero.
    """
    unknowns = fit.compressed.fit_statements(fit.fit.compliance).unknowns
    greatest = float(np.abs(unknowns).max(initial=0.0))
    if greatest > _MOST_UNCERTAINTIES:
        raise SolverError(f"the fit moves an error by {greatest:.0f} times its standard uncertainty")


def _list_fitted_statements(
    measurements: Measurements, settings: Settings, method: Method
) -> tuple[Term, ...]:
    """Return the terms with stated uncertainties that are fitted together with the joints.

    Only a method of one stage with weights by covariance can fit them. With other methods the errors are
    propagated after the fit, and no term is returned.
    """
    can_fit = method.by_covariance and len(method.stages) == 1 and settings.loss == "squared"
    return list_stated_terms(measurements) if can_fit else ()


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
        neglected = replace(settings, complementary_stiffness=False)
        estimate = identify(rows, neglected)
        if estimate.complementary_stiffness is None:
            raise
        effect = replace(estimate.complementary_stiffness, obstacle=error.reason)
        return neglected, replace(estimate, complementary_stiffness=effect)


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
    weighting = settings.weighting
    not_by_covariance = weighting != "covariance"
    by_length = weighting == "characteristic_length"
    for refused, why, remedy in (
        (
            not_by_covariance and settings.prior is not None,
            "does not use the uncertainty of the readings, so a prior cannot be weighed against the readings",
            "use weighting covariance, or omit `priors`",
        ),
        (
            not_by_covariance and measurements.encoders is not None,
            "cannot combine encoder readings (angles) with positions (lengths)",
            "use weighting covariance, or omit the encoder readings",
        ),
        (
            by_length and settings.method != "complete_pose",
            f"needs rotations, but method {settings.method} does not use rotations",
            "use weighting covariance, or method complete_pose",
        ),
    ):
        if refused:
            raise UnsupportedMethodError(f"weighting {weighting} {why}", where="weighting", remedy=remedy)


@dataclass(frozen=True, eq=False)
class _Pass:
    """One fit of all observations; with K_c or statements several fits follow each other."""

    rows: Rows  # observations with the weights of the fit, at the compliances that bend the robot
    compressed: MethodRows  # rows that were fitted
    fit: Fit
    robust: RobustFit | None  # weights of the readings by the Huber loss; None for the squared loss
    targets: TargetRows | None  # rows for the Huber loss; None for the squared loss

    def estimate_noise(self) -> float:
        """Return sigma, the standard deviation of a coordinate, from the residuals [m]; 0 if none remain."""
        return estimate_scale(self.fit, self.compressed.all_readings, None).sigma or 0.0


@dataclass(frozen=True, eq=False)
class _Problem:
    """Observations, settings and statements of a fit, which all passes share."""

    rows: Rows  # N observations in their unloaded postures
    settings: Settings
    method: Method
    observability: Observability  # in the unloaded postures
    stated_terms: tuple[Term, ...]  # terms with stated uncertainties, fitted together with the joints

    def fit_once(self, compliance: FloatArray | None = None, before: _Pass | None = None) -> _Pass:
        """Fit all observations once, without a certificate.

        Args:
            compliance: (n,) compliances that bend the robot, with K_c, and at which the columns of statements
                are computed; None for a fit that neglects K_c and statements.
            before: the fit before; None for the first fit.
        """
        rows, settings = self.rows, self.settings
        if settings.complementary_stiffness:
            rows = rows.at(compliance)
        robust, targets = None, None
        if settings.loss == "huber":
            targets = TargetRows.of(rows)
            robust = self._fit_huber(targets, before)
            rows = rows.of(robust.reweight(rows.measurements))
        statements = None if before is None else self._state(compliance, before)
        compressed = MethodRows.compress(self.method, rows, statements)
        return _Pass(rows, compressed, self._solve(compressed, robust, solve_step), robust, targets)

    def certify(self, last: _Pass) -> _Pass:
        """Return the last fit with certificates of its optimum."""
        return replace(last, fit=self._solve(last.compressed, last.robust, solve))

    def _solve(self, compressed: MethodRows, robust: RobustFit | None, solve_problem: Find) -> Fit:
        """Return the fit of compressed rows, with the prior of the settings."""
        settings, null = self.settings, self.observability.null
        fit = fit_method(compressed, null, settings.constraints, solve_problem=solve_problem)
        if settings.prior is None:
            return fit
        # A prior's weight is sigma/s₀; a sigma that is not given is estimated from the readings alone.
        sigma = self.rows.measurements.sigma if robust is None else robust.sigma
        scale = estimate_scale(fit, compressed.all_readings, sigma)
        prior = settings.prior.in_units_of(_require_sigma_for_prior(scale))
        with_prior = fit_method(compressed, null, settings.constraints, prior, solve_problem)
        return replace(with_prior, alone=fit)

    def _fit_huber(self, targets: TargetRows, before: _Pass | None) -> RobustFit:
        """Fit the joints with Huber's loss; an unknown sigma is estimated by the first fit and then kept."""
        sigma = self.rows.measurements.sigma
        if before is not None and before.robust is not None:
            sigma = before.robust.sigma
        return fit_huber(
            targets,
            self.observability.null,
            self.settings.constraints,
            prior=self.settings.prior,
            sigma=sigma,
            threshold=self.settings.huber_threshold,
        )

    def _state(self, compliance: FloatArray | None, before: _Pass) -> Statements | None:
        """Return what is stated, with columns at compliances (n,); None without stated terms."""
        if not self.stated_terms or compliance is None:
            return None
        measurements = self.rows.measurements
        return Statements(
            terms=self.stated_terms,
            common=measurements.common_uncertainty,
            compliance=np.maximum(compliance, 0.0),
            sigma=max(measurements.sigma or before.estimate_noise(), LEAST_STATED_SIGMA),
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
    observability = excitation.observability()
    if not excitation.anything_moved:
        raise NotObservableError(
            "no target moved, so no compliance can be identified",
            where="observations",
            remedy="check that the loaded readings were taken with the load applied",
        )
    if observability.null.all():
        reasons = ", or ".join(dict.fromkeys(str(each).split(":")[0] for each in observability.reasons))
        raise NotObservableError(
            f"the readings do not determine any joint: {reasons}",
            where="observations",
            remedy="add loads with a torque about the joints' axes, and targets away from these axes",
        )
    return observability


def _iterate_to_rest(problem: _Problem, first: _Pass) -> tuple[_Pass, int]:
    """Repeat the fit until the fitted compliances equal those of the fit before.

    With the complementary stiffness K_c, the compliances bend the robot; the columns of statements depend on
    them, too. The iteration starts from a first-order estimate of the effect of K_c, so that with noisy
    readings a single fit suffices without statements.

    Returns:
        The last fit, and the number of fits after the first.

    Raises:
        SolverError: the compliances do not come to rest in `MAX_ITERATIONS` fits.
    """
    start = first.fit.compliance
    if problem.settings.complementary_stiffness:
        sigma = problem.rows.measurements.sigma or first.estimate_noise()
        start = start + _estimate_neglected_shift(problem, first, sigma)
    last, rounds = first, 0

    def fit_at(compliance: FloatArray) -> FloatArray:
        """Return the fitted compliances (n,) where the robot was bent with other compliances (n,)."""
        nonlocal last, rounds
        last, rounds = problem.fit_once(compliance, last), rounds + 1
        return last.fit.compliance

    unit = _list_changes_at_rest(problem.observability, first)
    find_rest(fit_at, start, unit=unit, most_steps=MAX_ITERATIONS)
    return last, rounds


def _list_changes_at_rest(observability: Observability, first_fit: _Pass) -> FloatArray:
    """Return the greatest changes (n,) of the compliances by a further fit that count as rest [rad/(N·m)]."""
    # A joint that nothing moves has no compliance to compare with.
    reference = np.maximum(observability.reference_compliance, np.finfo(np.float64).tiny)
    size = np.maximum(np.abs(first_fit.fit.compliance), reference)
    uncertainty = first_fit.estimate_noise() * np.sqrt(np.diagonal(first_fit.fit.covariance))
    uncertainty = np.where(np.isfinite(uncertainty), uncertainty, 0.0)
    return np.maximum(_CHANGE_TOLERANCE * size, _CHANGE_IN_UNCERTAINTIES * uncertainty)


def _estimate_neglected_shift(problem: _Problem, without_k_c: _Pass, sigma: float | None) -> FloatArray:
    """Return the change (n,) of the compliances if K_c were included, to first order [rad/(N·m)].

    The deflections by K_c are subtracted from the readings; joints at a bound stay at the bound. Of a large
    set only `SHIFT_OBSERVATIONS` evenly spread observations are used, and the change is multiplied by the
    ratio of the numbers of observations; where loads in all directions cancel, this overstates the change. A
    prior is included where sigma [m] is known.
    """
    fit, sample = without_k_c.fit, without_k_c.rows.at(None).select_evenly(SHIFT_OBSERVATIONS)
    estimated = np.flatnonzero(~problem.observability.null & (fit.active == 0))
    prior = problem.settings.prior
    responses = without_k_c.compressed.compute_responses(
        sample,
        [NEGLECTED_STIFFNESS],
        fit.compliance,
        estimated,
        prior.in_units_of(sigma) if prior and sigma else None,
    )
    return -responses[NEGLECTED_STIFFNESS.name][:, 0] * (len(problem.rows) / len(sample))


def _build_estimate(problem: _Problem, last_fit: _Pass) -> Estimate:
    """Build the estimate from the last fit: sigma, uncertainties, intervals and a verdict on each joint.

    With the Huber loss, a robust scale replaces a sigma that is unknown.
    """
    settings, measurements = problem.settings, problem.rows.measurements
    robot, observability = problem.rows.robot, problem.observability
    fit, robust, all_readings = last_fit.fit, last_fit.robust, last_fit.compressed.all_readings
    sigma = measurements.sigma if robust is None else robust.sigma
    # With a prior, sigma comes from the fit without the prior, and chi-square from the fit with the prior.
    scale = estimate_scale(fit if fit.alone is None else fit.alone, all_readings, sigma)
    if fit.alone is not None:
        scale = replace(estimate_scale(fit, all_readings, scale.sigma), given=scale.given)
    scale = replace(scale, given=scale.given and measurements.sigma is not None)
    # The weights of the Huber loss come from the residuals, which makes the covariance larger.
    fit = fit.multiply_covariance(1.0 if robust is None else robust.inflation)
    common_errors = None
    if scale.sigma is not None:
        scale = replace(scale, sigma=max(scale.sigma, _LEAST_SIGMA))
        common_errors = _propagate_common_errors(problem, last_fit, scale.sigma or 1.0)
        if common_errors is not None:
            fit = fit.add_common_errors(common_errors.responses_to_unfitted_errors / (scale.sigma or 1.0))
    covariance = None if scale.sigma is None else np.float64(scale.sigma) ** 2 * fit.covariance
    numbers = [fit.compliance, np.array([scale.chi_square, scale.degrees_of_freedom])]
    numbers += [] if covariance is None else [covariance]
    if not all(np.isfinite(array).all() for array in numbers):
        raise MeasurementError(
            "the numbers overflow: the magnitudes of loads, lengths and sigma are inconsistent",
            where="units",
            remedy="check the units of force, length and sigma",
        )
    prior_to_data = np.full(robot.n, np.nan)
    if fit.alone is not None and settings.prior is not None and scale.sigma is not None:
        prior_to_data = _compare_prior_to_data(fit.alone, settings.prior, scale.sigma)
    chi_square, certificates = scale.chi_square, fit.certificates
    if robust is not None and last_fit.targets is not None:
        chi_square = last_fit.targets.chi_square(
            fit.compliance, sigma=robust.sigma, threshold=robust.threshold
        )
        certificates = (robust.certificate, *certificates)
    evidence = Evidence(
        robot.joint_names,
        fit,
        observability,
        scale,
        settings.constraints,
        settings.confidence,
        prior_to_data,
        _profile_short_levers(problem, last_fit, fit, scale, common_errors),
    )
    joints = evidence.derive_joint_results()
    likelihood: Likelihood | None = fit.likelihood
    second_order = None
    if evidence.profiles:
        # Beyond first order, errors of the load add to the uncertainty of joints near the line of the load.
        second_order = evidence.compute_extra_uncertainties()
        covariance = None if covariance is None else covariance + np.diag(np.square(second_order))
        widened = fit.add_common_errors(np.diag(second_order) / (scale.sigma or 1.0)).likelihood
        known = widened.leave_out(evidence.list_open_joints())
        likelihood = known if len(known.joints) else None
    return Estimate(
        joints=joints,
        compliance=fit.compliance,
        balanced=last_fit.rows.balanced,
        covariance=covariance,
        sigma=scale.sigma,
        sigma_given=scale.given,
        chi_square=chi_square,
        degrees_of_freedom=scale.degrees_of_freedom,
        identifiability=fit.identifiability,
        certificates=certificates,
        compressed=last_fit.compressed,
        observability=observability,
        likelihood=likelihood,
        common=common_errors,
        second_order=second_order,
        robust=robust,
    )


def _propagate_common_errors(problem: _Problem, last_fit: _Pass, sigma: float) -> CommonErrors | None:
    """Return the changes of the estimate by one standard uncertainty of each error common to all.

    The result is None if no such error has an uncertainty. `sigma` [m] weighs a prior against the readings.
    """
    measurements, settings = problem.rows.measurements, problem.settings
    common_uncertainty, errors = measurements.common_uncertainty, fitted_errors(measurements)
    fitted_terms = errors.terms
    # For each term: the name in the budget, and the standard uncertainties of the unknowns.
    source_and_prior = {
        name: (common_uncertainty.source(name), term.prior(common_uncertainty))
        for name, term in TERMS.items()
    }
    # An error fitted from the readings replaces a stated uncertainty
    fitted_names = {term.name for term in fitted_terms}
    terms = [
        TERMS[name]
        for name, (_, uncertainties) in source_and_prior.items()
        if any(uncertainties) and name not in fitted_names
    ]
    if not (terms or fitted_terms):
        return None
    responses = last_fit.compressed.compute_responses(
        last_fit.rows,
        [*terms, *fitted_terms],
        last_fit.fit.compliance,
        np.flatnonzero(~problem.observability.null),
        None if settings.prior is None else settings.prior.in_units_of(sigma),
    )
    by_source = {}
    terms_in_fit = last_fit.compressed.statements.terms
    for source, uncertainties, response in (
        (*source_and_prior[term.name], responses[term.name]) for term in terms
    ):
        # `resize` repeats the uncertainties for each column.
        by_source[source] = np.resize(uncertainties, response.shape[1]) * response
    in_fit = frozenset(source_and_prior[term.name][0] for term in terms_in_fit)
    if fitted_terms:
        responses_to_causes = np.hstack([responses[term.name] for term in fitted_terms])
        by_source["fitted_causes"] = responses_to_causes @ errors.root
    return CommonErrors(by_source, in_fit)


def _profile_short_levers(
    problem: _Problem, last_fit: _Pass, fit: Fit, scale: Scale, common_errors: CommonErrors | None
) -> dict[int, LeverProfile]:
    """Return the profiles of joints near the line of the load, whatever the method.

    Errors that the profiles do not know, such as that of the force's scale, widen them.

    Args:
        problem: observations, settings and statements.
        last_fit: last fit, whose rows belong to its compliances.
        fit: the fit, with the uncertainty of errors that all observations share.
        scale: sigma.
        common_errors: errors that all observations share; None without any.
    """
    settings, measurements = problem.settings, problem.rows.measurements
    # Readings without noise determine the load point, too: to first order is exact enough.
    if common_errors is None or not scale.sigma or scale.sigma < LEAST_STATED_SIGMA:
        return {}
    free = _free_load(problem, last_fit, scale.sigma)
    if free is None:
        return {}
    compliance, common = last_fit.fit.compliance, measurements.common_uncertainty
    quantiles = scale.list_quantiles(settings.confidence)
    inflation = 1.0 if last_fit.robust is None else last_fit.robust.inflation
    in_profiles = {common.source(term.name) for term in (*list_stated_terms(measurements), FORCE_SCALE)}
    others = replace(common_errors, in_fit=frozenset(in_profiles)).responses_to_unfitted_errors
    is_same_likelihood = bool(last_fit.compressed.statements.terms)
    bounds, profiles = settings.constraints.bounds, {}
    for index in np.flatnonzero(free.weak).tolist():
        j = int(free.joints[index])
        if any(j in group.joints for group in fit.undetermined):
            continue
        ends = free.profile(index).find_ends(scale.sigma * np.sqrt(inflation) * quantiles)
        if not np.isfinite(np.concatenate(ends)).all():
            profiles[j] = LeverProfile()
            continue
        value, other_error = float(compliance[j]), float(np.linalg.norm(others[j]))
        first_order = scale.sigma * float(np.sqrt(fit.covariance[j, j]))
        unconstrained, within = (
            _widen_profile(each, value, quantiles[:, None] * np.hypot(other_error, common.scale * each))
            for each in ends
        )
        lower = np.minimum(unconstrained[:, 0], within[:, 0])
        upper = np.maximum(unconstrained[:, 1], within[:, 1])
        half_width = float(np.ptp(unconstrained[0])) / 2.0
        profiles[j] = LeverProfile(
            np.clip(np.column_stack([lower, upper]), bounds.lower[j], bounds.upper[j]),
            max(first_order, half_width / float(quantiles[0])),
            replaces_first_order=is_same_likelihood,
        )
    return profiles


def _free_load(problem: _Problem, last_fit: _Pass, sigma: float) -> FreeLoad | None:
    """Return the last fit with the errors of the load free; None if no joint has a short lever."""
    measurements = problem.rows.measurements
    statements = Statements(
        list_stated_terms(measurements),
        measurements.common_uncertainty,
        np.maximum(last_fit.fit.compliance, 0.0),
        sigma,
    )
    joints = np.flatnonzero(~problem.observability.null)
    return FreeLoad.of(last_fit.rows, problem.settings, statements, joints)


def _widen_profile(intervals: FloatArray, value: float, beyond: FloatArray) -> FloatArray:
    """Return intervals (q, 2) that contain an estimate, and errors that the profile does not know.

    Args:
        intervals: (q, 2) by the profile [rad/(N·m)].
        value: estimate.
        beyond: (q, 2) expanded uncertainties by other errors, at the ends.
    """
    sides = np.array([-1.0, 1.0])
    distance = np.maximum(sides * (intervals - value), 0.0)
    return np.asarray(value + sides * np.hypot(distance, beyond))


def _compare_prior_to_data(fit_without_prior: Fit, prior: Prior, sigma: float) -> FloatArray:
    """Return for each joint the ratio (n,) of the prior's information to the readings' information.

    The ratio is ``s₀⁻² / (sigma² C_jj)⁻¹``, with s₀ the prior's standard uncertainty and C_jj the variance
    from the readings; NaN for joints without a prior, and inf where the readings alone determine only a
    combination with other joints.
    """
    variance = sigma**2 * np.diagonal(fit_without_prior.covariance)
    ratio = np.where(prior.known, variance / prior.standard_uncertainty**2, np.nan)
    for group in fit_without_prior.undetermined:
        for joint in group.joints:
            ratio[joint] = np.inf if prior.known[joint] else np.nan
    return ratio


def _find_largest_standardised_shift(shift: FloatArray | None, estimate: Estimate) -> float | None:
    """Return the largest change of a compliance in standard uncertainties; None if no uncertainty is known.

    Uncertainties that were assumed, not stated, are left out of the standard uncertainty.
    """
    if shift is None or estimate.covariance is None:
        return None
    variance = np.diagonal(estimate.covariance)
    if estimate.common is not None:
        for source in ("assumed_load_point", "assumed_force_scale"):
            variance = variance - np.square(estimate.common.responses_to(source)).sum(axis=1)
        is_assumed = "assumed_load_point" in estimate.common.by_source
        variance = variance - np.diagonal(estimate.square_second_order(is_assumed))
    has_uncertainty = estimate.estimated & (variance > 0.0)
    return (
        float((np.abs(shift[has_uncertainty]) / np.sqrt(variance[has_uncertainty])).max())
        if has_uncertainty.any()
        else None
    )
