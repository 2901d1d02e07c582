"""Causes fitted together with the joints, and subtracted from the readings (method.md §13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

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
from jointstiff.solver.fit.statements import list_stated_terms
from jointstiff.solver.fit.triangle import INDEPENDENT, TermsFit, Triangle, solve_nonnegative
from jointstiff.solver.mechanics.block import (
    CorrectedMeasurements,
    FittedErrors,
    Term,
)
from jointstiff.solver.mechanics.measurements import NO_SCATTER, Measurements, Scatter
from jointstiff.solver.mechanics.springs import JOINTS

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
    read = replace(leave_out(measurements, refuted), encoders=None)
    tested = rows.of(read).select_evenly(MOST_TESTED_OBSERVATIONS)
    of_joints = tested.stack([JOINTS], np.zeros(rows.robot.n)).flat
    compliance, _ = solve_nonnegative(of_joints[:, :-1], of_joints[:, -1])
    # A turn includes a shift: if both begin at the same observation, only the turn is fitted.
    named = [(name, first) for name, first in named if name != "shift" or ("turn", first) not in named]
    firsts = [first for _, first in named if first is not None]
    suspect_by_cause = {
        (suspect.name, suspect.first): suspect
        for suspect in list_suspects(measurements, tested, compliance, (), firsts)
    }
    missing = next((each for each in named if each not in suspect_by_cause), None)
    if missing is not None:
        since_first = f" since observation '{missing[1]}'" if missing[1] else ""
        raise RequestError(
            f"the readings do not show the cause '{missing[0]}'{since_first}",
            where="causes",
            remedy=f"give one of: {', '.join(sorted({name for name, _ in suspect_by_cause}))}",
        )
    terms = [suspect_by_cause[each].term for each in named]
    fitted = fit_causes_with_joints(tested, terms, compliance)
    scatter = _find_scatter(tested, fitted)
    with_scatter = tested.of(replace(tested.measurements, scatter=scatter))
    if scatter != tested.measurements.scatter:  # three targets with one error are one reading
        fitted = fit_causes_with_joints(with_scatter, terms, fitted.compliance)
    errors = _add_uncertainty_of_columns(with_scatter, fitted)
    corrected = subtract_errors(rows.at(fitted.compliance), errors)
    errors = replace(errors, loads=group_distinct_loads(measurements))
    return CorrectedMeasurements.from_measurements(corrected, errors)


@dataclass(frozen=True, eq=False)
class FittedCauses:
    """Result of fitting causes together with the joints."""

    errors: FittedErrors
    compliance: FloatArray  # (n,) of the joints, fitted together with the causes [rad/(N·m)]
    visible: BoolArray  # (n,) whether the readings see each joint
    size: FloatArray  # (k,) typical size of each unknown
    tests: TermTests  # compressed rows of the readings, from which the fitted causes were subtracted


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
    remaining, unknowns, unit = rows, np.zeros(()), np.zeros(0)
    for _ in range(_REFITS):
        remaining = remaining.at(compliance)
        # A corrected load may twist joints that the stated load did not twist.
        visible = ~Excitation.of(remaining).observability().null
        tests = TermTests(remaining, compliance, visible, terms, ())
        triangle, sigma = _compress_rows(tests)
        terms_fit = triangle.fit_with([term.name for term in terms])
        compliance = np.zeros(rows.robot.n)
        compliance[visible] = np.maximum(terms_fit.known, 0.0)
        last_unknowns = np.cumsum([len(tests.stated.span[term.name]) for term in terms])[:-1]
        previous, unknowns = unknowns, unknowns + terms_fit.unknowns
        if not unit.any():  # unit of each term's unknowns: their root mean square after the first step
            unknowns_of_terms = np.split(unknowns, last_unknowns)
            unit = np.concatenate(
                [np.full(len(each), np.sqrt(np.mean(each**2)) or 1.0) for each in unknowns_of_terms]
            )
        unknowns, root = _zero_undetermined_part(unknowns, terms_fit, sigma, unit)
        determined_count = terms_fit.root.shape[1]
        errors = FittedErrors(tuple(terms), tuple(np.split(unknowns, last_unknowns)), root, determined_count)
        fitted = FittedCauses(errors, compliance, visible, unit, tests)
        if np.linalg.norm((unknowns - previous) / unit) <= _STEP_TOLERANCE * np.linalg.norm(unknowns / unit):
            break
        at_fitted = rows.at(compliance)
        remaining = at_fitted.of(subtract_errors(at_fitted, errors))
    return fitted


def _compress_rows(tests: TermTests) -> tuple[Triangle, float]:
    """Return (triangle, sigma): the compressed rows of the terms that are fitted in any case, and sigma [m].

    Sigma is the stated standard uncertainty, or that of the residuals if it is larger.
    """
    triangle = tests.compress_given_statements(tests.fitted)
    degrees_of_freedom = max(1, triangle.rows - triangle.rank(tests.fitted, INDEPENDENT))
    residual = float(np.sqrt(max(triangle.residual_squares(tests.fitted), 0.0) / degrees_of_freedom))
    return triangle, max(tests.rows.measurements.sigma or 0.0, residual)


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
    # Orthonormal directions in units of the size
    undetermined = np.linalg.qr(terms_fit.hidden / unit[:, None])[0]
    unknowns = unknowns - unit * (undetermined @ (undetermined.T @ (unknowns / unit)))
    return unknowns, np.hstack([sigma * terms_fit.root, unit[:, None] * undetermined])


def _add_uncertainty_of_columns(rows: Rows, fitted: FittedCauses) -> FittedErrors:
    """Return the fitted causes with the uncertainty of their columns, such as when play is taken up.

    For each such cause a further term is fitted, whose unknowns are stated as zero with a standard
    uncertainty of 1.
    """
    errors, compliance = fitted.errors, fitted.compliance
    pairs = zip(errors.terms, errors.unknowns, strict=True)
    doubtful_terms = [term.doubt(values) for term, values in pairs if term.doubt is not None]
    if not doubtful_terms:
        return errors
    terms = (*errors.terms, *doubtful_terms)
    at_fitted = rows.at(compliance)
    remaining = at_fitted.of(subtract_errors(at_fitted, errors))
    triangle, sigma = _compress_rows(TermTests(remaining, compliance, fitted.visible, terms, ()))
    for term in doubtful_terms:
        triangle = triangle.state(term.name, np.ones(len(triangle.span[term.name])), sigma)
    triangle.span[JOINTS.name] = np.flatnonzero(fitted.visible)
    terms_fit = triangle.fit_with([term.name for term in terms])
    unit = np.concatenate([fitted.size, np.ones(len(terms_fit.unknowns) - len(fitted.size))])
    unknowns_before = np.concatenate([*errors.unknowns, np.zeros(len(unit) - len(fitted.size))])
    unknowns, root = _zero_undetermined_part(unknowns_before + terms_fit.unknowns, terms_fit, sigma, unit)
    last_unknowns = np.cumsum([len(triangle.span[term.name]) for term in terms])[:-1]
    return FittedErrors(terms, tuple(np.split(unknowns, last_unknowns)), root, errors.determined)


def _find_scatter(rows: Rows, fitted: FittedCauses) -> Scatter:
    """Return the errors that the targets of a posture share, from the residuals of joints and causes.

    Args:
        rows: N observations.
        fitted: the causes, fitted together with the joints.
    """
    at_fitted = rows.at(fitted.compliance)
    tested = at_fitted.of(subtract_errors(at_fitted, fitted.errors)).select_evenly(_MOST_WITH_SCATTER)
    terms = [JOINTS, *fitted.errors.terms]
    fitted_names = {term.name for term in terms}
    stated_terms = [each for each in list_stated_terms(tested.measurements) if each.name not in fitted_names]
    tested = tested.with_scatter(NO_SCATTER)
    stack = tested.stack([*terms, *stated_terms], fitted.compliance)
    fitted_columns = np.concatenate([np.flatnonzero(fitted.visible), *list(stack.span.values())[1:]])
    likelihood = RestrictedLikelihood(tested.block, stack, fitted_columns)
    return likelihood.find_believable(tested.block) or rows.measurements.scatter


def subtract_errors(rows: Rows, errors: FittedErrors) -> Measurements:
    """Return the measurements without the motion by fitted errors.

    Args:
        rows: N observations, with their loads in balance at the compliances on which the motion depends.
        errors: fitted errors, with the values of their unknowns.
    """
    measurements, balanced = rows.measurements, rows.balanced
    compliance = np.zeros(rows.robot.n) if balanced is None else balanced
    terms_and_values = list(zip(errors.terms, errors.unknowns, strict=True))
    # Errors of the load change the measurements' loads; the motion by all other errors is subtracted.
    for term, values in terms_and_values:
        if term.change_loads is not None:
            measurements = term.change_loads(rows.robot, measurements, values)
    terms_and_values = [(term, values) for term, values in terms_and_values if term.change_loads is None]
    if not terms_and_values:
        return measurements
    targets, joints = [], []
    for block in rows.of(measurements).generate_blocks():
        motions = [(block.move(term, compliance), values) for term, values in terms_and_values]
        targets.append(np.sum([motion.targets @ values for motion, values in motions], axis=0))
        turns = [motion.joints @ values for motion, values in motions if motion.joints is not None]
        joints.append(np.sum([np.zeros_like(block.torque), *turns], axis=0))
    target_motion = np.where(measurements.present[..., None], np.concatenate(targets), 0.0)
    encoders = measurements.encoders
    if encoders is not None:
        remaining = np.where(encoders.present, encoders.deflection - np.concatenate(joints), 0.0)
        encoders = replace(encoders, deflection=remaining)
    return replace(measurements, deflection=measurements.deflection - target_motion, encoders=encoders)
