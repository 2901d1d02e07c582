"""Causes fitted together with the joints, and subtracted from the readings (method.md §13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError, SolverError
from jointstiff.solver.evidence.refuted import leave_out
from jointstiff.solver.evidence.scatter import (
    RestrictedLikelihood,
)
from jointstiff.solver.evidence.suspects import (
    MOST_TESTED_OBSERVATIONS,
    group_distinct_loads,
    list_suspects,
)
from jointstiff.solver.evidence.term_tests import TermTests
from jointstiff.solver.fit.observability import Excitation
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import INDEPENDENT, TermsFit, Triangle, solve_nonnegative
from jointstiff.solver.mechanics.block import (
    CorrectedMeasurements,
    FittedErrors,
    Term,
)
from jointstiff.solver.mechanics.measurements import Measurements, Scatter
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import list_stated_terms

_REFITS: Final = 6
"""Largest number of Gauss-Newton steps towards a cause."""
_MOST_WITH_SCATTER: Final = 100
"""Number of observations that suffice to estimate errors that the targets of a posture share."""
_STEP_TOLERANCE: Final = 1e-3
"""Relative size of a Gauss-Newton step at which the iteration ends."""


def fit_causes(
    rows: Rows,
    named: Sequence[tuple[str, str | None]],
    refuted: Sequence[str] = (),
) -> Measurements:
    """Return the measurements with the motion by named causes subtracted, and the causes' uncertainty added.

    The causes are fitted together with the joints.

    Args:
        rows: N observations.
        named: name of each cause, and label of the first observation that the cause concerns; None for all.
        refuted: labels of observations that the fit does not use.

    Raises:
        RequestError: the readings do not show a cause, or a cause implies loads without a balance.
    """
    if not named:
        return rows.measurements
    try:
        return _subtract_named_causes(rows, named, refuted)
    except SolverError as error:
        remedy = "omit the cause, and check the units of force and length"
        raise RequestError(error.reason, where="causes", remedy=remedy) from error


def _subtract_named_causes(
    rows: Rows, named: Sequence[tuple[str, str | None]], refuted: Sequence[str]
) -> Measurements:
    """Return the measurements without the motion by named causes, and with the uncertainty of these causes.

    Args:
        rows: N observations.
        named: causes as (name, label of the observation at which the cause begins, or None).
        refuted: labels of observations with mistaken readings, which are not used for the fit.

    Raises:
        RequestError: the readings do not show a named cause.
        SolverError: a cause implies loads without a balance.
    """
    measurements = rows.measurements
    # What bends behind the encoders is no cause, so that causes are fitted to the targets alone.
    targets_alone = replace(leave_out(measurements, refuted), encoders=None)
    tested = rows.of(targets_alone).select_evenly(MOST_TESTED_OBSERVATIONS)
    of_joints = tested.stack([JOINTS], np.zeros(rows.robot.n)).flat
    compliance, _ = solve_nonnegative(of_joints[:, :-1], of_joints[:, -1])
    terms = _find_named_terms(measurements, tested, compliance, named)
    fitted = _fit_with_scatter(tested, terms, compliance)
    corrected = subtract_errors(rows.at(fitted.compliance), fitted.errors)
    errors = replace(fitted.errors, labels_by_load=group_distinct_loads(measurements))
    return CorrectedMeasurements.from_measurements(corrected, errors)


def _fit_with_scatter(rows: Rows, terms: Sequence[Term], compliance: FloatArray) -> FittedCauses:
    """Fit causes together with the joints, with the scatter from posture to posture that residuals show.

    The targets of a posture share errors, so that they count as fewer readings. The errors of the result
    include the uncertainty of how the causes move the targets.

    Args:
        rows: N observations.
        terms: the causes.
        compliance: (n,) compliances at which the fit starts [rad/(N·m)].

    Raises:
        SolverError: a cause implies loads without a balance.
    """
    fitted = fit_causes_with_joints(rows, terms, compliance)
    scatter = _find_scatter(rows, fitted)
    with_scatter = rows.of(replace(rows.measurements, scatter=scatter))
    if scatter != rows.measurements.scatter:
        fitted = fit_causes_with_joints(with_scatter, terms, fitted.compliance)
    return replace(fitted, errors=_add_uncertainty_of_columns(with_scatter, fitted))


def _find_named_terms(
    measurements: Measurements,
    tested: Rows,
    compliance: FloatArray,
    named: Sequence[tuple[str, str | None]],
) -> list[Term]:
    """Return how each named cause moves the targets.

    Args:
        measurements: N observations.
        tested: some of these observations.
        compliance: (n,) compliances of the joints [rad/(N·m)].
        named: causes as (name, label of the observation at which the cause begins, or None).

    Raises:
        RequestError: the readings do not show a named cause.
    """
    # A turn includes a shift: if both begin at the same observation, only the turn is fitted.
    named = [(name, first) for name, first in named if name != "shift" or ("turn", first) not in named]
    onsets = [first for _, first in named if first is not None]
    suspects = list_suspects(measurements, tested, compliance, (), onsets)
    terms = {(suspect.name, suspect.first): suspect.term for suspect in suspects}
    for name, first in named:
        if (name, first) not in terms:
            since_first = f" since observation '{first}'" if first else ""
            possible_names = sorted({possible_name for possible_name, _ in terms})
            raise RequestError(
                f"`causes` names the error '{name}'{since_first}, but the readings cannot show this error",
                where="causes",
                remedy=f"give one of: {', '.join(possible_names)}",
            )
    return [terms[cause] for cause in named]


@dataclass(frozen=True, eq=False)
class FittedCauses:
    """Result of fitting causes together with the joints."""

    errors: FittedErrors
    compliance: FloatArray  # (n,) of the joints, fitted together with the causes [rad/(N·m)]
    visible: BoolArray  # (n,) whether the readings see each joint
    size: FloatArray  # (k,) typical size of each unknown
    tests: TermTests  # compressed rows of the readings, from which the fitted causes were subtracted
    has_converged: bool  # whether the last step was small


def fit_causes_with_joints(rows: Rows, terms: Sequence[Term], compliance: FloatArray) -> FittedCauses:
    """Fit causes together with the joints, by Gauss-Newton steps.

    Directions of the unknowns that the joints explain equally well stay zero; their standard uncertainty is
    set to the size of the other unknowns.

    Args:
        rows: N observations.
        terms: the causes.
        compliance: (n,) compliances at which the steps start [rad/(N·m)].

    Raises:
        SolverError: a cause implies loads without a balance.
    """
    remaining, before = rows, None
    for _ in range(_REFITS):
        fitted = _take_step(remaining.at(compliance), terms, compliance, before)
        if fitted.has_converged:
            break
        compliance, before = fitted.compliance, fitted
        at_fitted = rows.at(compliance)
        remaining = at_fitted.of(subtract_errors(at_fitted, fitted.errors))
    return fitted


def _take_step(
    remaining: Rows, terms: Sequence[Term], compliance: FloatArray, before: FittedCauses | None
) -> FittedCauses:
    """Take one Gauss-Newton step: fit joints and causes to what the step before leaves of the readings.

    Args:
        remaining: observations, from which the motion by the causes of the step before was subtracted.
        terms: the causes.
        compliance: (n,) compliances at which the rows are linear [rad/(N·m)].
        before: result of the step before; None for the first step.
    """
    # A corrected load may twist joints that the stated load did not twist.
    visible = ~Excitation.of(remaining).observability().null
    tests = TermTests(remaining, compliance, visible, terms, ())
    triangle, sigma = _compress_rows(tests)
    step = triangle.fit_with([term.name for term in terms])
    previous = np.zeros(()) if before is None else np.concatenate(before.errors.unknowns)
    unknowns = previous + step.unknowns
    if before is None:
        size = _compute_typical_sizes(_split_by_term(unknowns, terms, tests.triangle))
    else:
        size = before.size
    unknowns, root = _zero_undetermined_part(unknowns, step, sigma, size)
    unknowns_of_terms = _split_by_term(unknowns, terms, tests.triangle)
    step_length = np.linalg.norm((unknowns - previous) / size)
    return FittedCauses(
        errors=FittedErrors(tuple(terms), unknowns_of_terms, root, determined=step.root.shape[1]),
        compliance=_place_compliances(step.known, visible),
        visible=visible,
        size=size,
        tests=tests,
        has_converged=bool(step_length <= _STEP_TOLERANCE * np.linalg.norm(unknowns / size)),
    )


def _place_compliances(of_visible: FloatArray, visible: BoolArray) -> FloatArray:
    """Return compliances (n,) of at least zero, from those of the visible joints; zero for other joints."""
    compliance = np.zeros(len(visible))
    compliance[visible] = np.maximum(of_visible, 0.0)
    return compliance


def _split_by_term(unknowns: FloatArray, terms: Sequence[Term], triangle: Triangle) -> tuple[FloatArray, ...]:
    """Return the unknowns of each term, from one array of the unknowns of all terms in turn.

    The triangle has a column for each unknown: terms of 3 and 1 columns split 4 unknowns into 3 and 1.
    """
    counts = [len(triangle.span[term.name]) for term in terms]
    starts = np.cumsum(counts)[:-1]  # where the next term begins
    return tuple(np.split(unknowns, starts))


def _compute_typical_sizes(unknowns_of_terms: Sequence[FloatArray]) -> FloatArray:
    """Return a typical size for each unknown of all terms: the root mean square of its term's unknowns."""
    sizes = []
    for unknowns in unknowns_of_terms:
        root_mean_square = float(np.sqrt(np.mean(unknowns**2)))
        sizes.append(np.full(len(unknowns), root_mean_square or 1.0))
    return np.concatenate(sizes)


def _compress_rows(tests: TermTests) -> tuple[Triangle, float]:
    """Return (triangle, sigma): the compressed rows of the terms that are fitted in any case, and sigma [m].

    The triangle is the factor R of a QR decomposition of the rows [A d]: fits to R are fits to the rows.
    Sigma is the stated standard uncertainty, or that of the residuals if it is larger.
    """
    triangle = tests.compress_given_statements(tests.fitted)
    degrees_of_freedom = max(1, triangle.rows - triangle.rank(tests.fitted, INDEPENDENT))
    residual_squares = max(triangle.residual_squares(tests.fitted), 0.0)
    sigma_of_residuals = float(np.sqrt(residual_squares / degrees_of_freedom))
    stated_sigma = tests.rows.measurements.sigma or 0.0
    return triangle, max(stated_sigma, sigma_of_residuals)


def _zero_undetermined_part(
    unknowns: FloatArray, terms_fit: TermsFit, sigma: float, unit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Set the part of unknowns to zero that the joints explain equally well.

    Args:
        unknowns: (k,) unknowns of the causes.
        terms_fit: last fit of the causes, with the directions that the joints explain equally well.
        sigma: standard uncertainty of a coordinate of a reading [m].
        unit: (k,) typical size of each unknown.

    Returns:
        The unknowns; and a root of their covariance, in which the zeroed part has the typical size.
    """
    scaled_unknowns = unknowns / unit
    undetermined_directions, _ = np.linalg.qr(terms_fit.hidden / unit[:, None])
    undetermined_part = undetermined_directions @ (undetermined_directions.T @ scaled_unknowns)
    root_of_determined = sigma * terms_fit.root
    root_of_undetermined = unit[:, None] * undetermined_directions
    return unknowns - unit * undetermined_part, np.hstack([root_of_determined, root_of_undetermined])


def _add_uncertainty_of_columns(rows: Rows, fitted: FittedCauses) -> FittedErrors:
    """Return the fitted causes with the uncertainty of how they move the targets.

    For example, play moves a target when the load takes it up, but when that happens is uncertain. For each
    such cause a further term of doubt is fitted, whose unknowns are stated as 0 ± 1.
    """
    errors = fitted.errors
    doubts = _list_doubts(errors)
    if not doubts:
        return errors
    terms = (*errors.terms, *doubts)
    triangle, sigma = _compress_with_doubts(rows, fitted, doubts)
    correction = triangle.fit_with([term.name for term in terms])
    doubt_count = len(correction.unknowns) - len(fitted.size)
    typical_size = np.concatenate([fitted.size, np.ones(doubt_count)])
    before_correction = np.concatenate([*errors.unknowns, np.zeros(doubt_count)])
    unknowns, root = _zero_undetermined_part(
        before_correction + correction.unknowns, correction, sigma, typical_size
    )
    return FittedErrors(terms, _split_by_term(unknowns, terms, triangle), root, errors.determined)


def _list_doubts(errors: FittedErrors) -> list[Term]:
    """Return a term of doubt for each fitted cause whose motion of the targets is uncertain."""
    doubts = []
    for term, unknowns in zip(errors.terms, errors.unknowns, strict=True):
        if term.doubt is not None:
            doubts.append(term.doubt(unknowns))
    return doubts


def _compress_with_doubts(rows: Rows, fitted: FittedCauses, doubts: Sequence[Term]) -> tuple[Triangle, float]:
    """Return (triangle, sigma): the rows that fitted causes leave, with terms of doubt, and sigma [m].

    The unknowns of the doubts are stated as 0 ± 1.

    Args:
        rows: N observations, with the scatter of the fit.
        fitted: the causes.
        doubts: terms of doubt about how the causes move the targets.
    """
    at_fitted = rows.at(fitted.compliance)
    remaining = at_fitted.of(subtract_errors(at_fitted, fitted.errors))
    terms = (*fitted.errors.terms, *doubts)
    triangle, sigma = _compress_rows(TermTests(remaining, fitted.compliance, fitted.visible, terms, ()))
    for term in doubts:
        uncertainties = np.ones(len(triangle.span[term.name]))
        triangle = triangle.state_as_zero(term.name, uncertainties, sigma)
    triangle.span[JOINTS.name] = np.flatnonzero(fitted.visible)
    return triangle, sigma


def _find_scatter(rows: Rows, fitted: FittedCauses) -> Scatter:
    """Estimate the errors that the targets of a posture share, from prior and residuals of joints and causes.

    Args:
        rows: N observations.
        fitted: the causes, fitted together with the joints.
    """
    at_fitted = rows.at(fitted.compliance)
    remaining = at_fitted.of(subtract_errors(at_fitted, fitted.errors))
    tested = remaining.select_evenly(_MOST_WITH_SCATTER)
    terms = [JOINTS, *fitted.errors.terms]
    fitted_names = {term.name for term in terms}
    stated_terms = [term for term in list_stated_terms(tested.measurements) if term.name not in fitted_names]
    terms = [*terms, *stated_terms]
    likelihood = RestrictedLikelihood.from_rows(tested, terms, fitted.compliance, fitted.visible)
    return likelihood.find_believable(tested.block).scatter


def subtract_errors(rows: Rows, errors: FittedErrors) -> Measurements:
    """Return the measurements without the motion by fitted errors.

    Errors of the load correct the loads; the motion by all other errors is subtracted from the readings.

    Args:
        rows: N observations, with their loads in balance at the compliances on which the motion depends.
        errors: fitted errors, with the values of their unknowns.
    """
    measurements = rows.measurements
    moving_terms = []
    for term, values in zip(errors.terms, errors.unknowns, strict=True):
        if term.change_loads is None:
            moving_terms.append((term, values))
        else:
            measurements = term.change_loads(rows.robot, measurements, values)
    if not moving_terms:
        return measurements
    motion = _compute_motion(rows.of(measurements), moving_terms)
    of_targets = np.where(measurements.present[..., None], motion.targets, 0.0)
    encoders = measurements.encoders
    if encoders is not None:
        corrected = encoders.deflection - motion.joints
        encoders = replace(encoders, deflection=np.where(encoders.present, corrected, 0.0))
    return replace(measurements, deflection=measurements.deflection - of_targets, encoders=encoders)


class _ErrorMotion(NamedTuple):
    """Motion by errors in N observations of T targets and n joints."""

    targets: FloatArray  # (N, T, 3) axes of R0 [m]
    joints: FloatArray  # (N, n) of the joints, as their encoders see them [rad]


def _compute_motion(rows: Rows, terms: Sequence[tuple[Term, FloatArray]]) -> _ErrorMotion:
    """Return the motion by some terms, each given with the values of its unknowns.

    The motion by an error depends on the compliances: those that bend the robot, or zero for a rigid robot.
    """
    compliance = np.zeros(rows.robot.n) if rows.balanced is None else rows.balanced
    targets_of_blocks, joints_of_blocks = [], []
    for block in rows.generate_blocks():
        targets, joints = np.zeros_like(block.measurements.deflection), np.zeros_like(block.torque)
        for term, values in terms:
            by_unit = block.move(term, compliance)
            targets += by_unit.targets @ values
            if by_unit.joints is not None:
                joints += by_unit.joints @ values
        targets_of_blocks.append(targets)
        joints_of_blocks.append(joints)
    return _ErrorMotion(np.concatenate(targets_of_blocks), np.concatenate(joints_of_blocks))
