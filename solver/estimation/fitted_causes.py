"""Causes fitted together with the joints, and subtracted from the readings (method.md §13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError, SolverError
from jointstiff.solver.estimation.observability import Excitation
from jointstiff.solver.estimation.refuted import leave_out
from jointstiff.solver.estimation.scatter import (
    LARGEST_REPEATABILITY,
    SCATTER_LEVEL,
    RestrictedLikelihood,
    compute_target_motion,
)
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.estimation.statements import list_stated_terms
from jointstiff.solver.estimation.suspects import (
    MOST_TESTED_OBSERVATIONS,
    group_distinct_loads,
    list_suspects,
)
from jointstiff.solver.estimation.term_tests import TermTests
from jointstiff.solver.estimation.triangle import INDEPENDENT, TermsFit, Triangle, solve_nonnegative
from jointstiff.solver.mechanics.block import (
    CorrectedMeasurements,
    FittedErrors,
    Term,
    regressor_blocks,
)
from jointstiff.solver.mechanics.measurements import Measurements, Scatter
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS

_REFITS: Final = 6
"""Largest number of Gauss-Newton steps towards a cause."""
_MOST_WITH_SCATTER: Final = 100
"""Number of observations that suffice to estimate errors that the targets of a posture share."""
_STEP_TOLERANCE: Final = 1e-3
"""Relative size of a Gauss-Newton step at which the iteration ends."""


def fit_causes(
    robot: Robot,
    measurements: Measurements,
    named: Sequence[tuple[str, str | None]],
    refuted: Sequence[str] = (),
) -> Measurements:
    """Return the measurements with the motion by named causes subtracted, and the causes' uncertainty added.

    The causes are fitted together with the joints.

    Args:
        robot: n joints.
        measurements: N observations.
        named: name of each cause, and label of the first observation that the cause concerns; None for all.
        refuted: labels of observations that the fit does not use.

    Raises:
        RequestError: the readings do not show a cause, or a cause implies loads without a balance.
    """
    if not named:
        return measurements
    try:
        return _subtract_named_causes(robot, measurements, named, refuted)
    except SolverError as error:
        remedy = "omit the cause, and check the units of force and length"
        raise RequestError(error.reason, where="causes", remedy=remedy) from error


def _subtract_named_causes(
    robot: Robot,
    measurements: Measurements,
    named: Sequence[tuple[str, str | None]],
    refuted: Sequence[str],
) -> Measurements:
    """Return the measurements with the motion by named causes subtracted, and the causes' uncertainty added.

    Raises:
        RequestError: the readings do not show a named cause.
        SolverError: a cause implies loads without a balance.
    """
    part = leave_out(measurements, refuted).select_evenly(MOST_TESTED_OBSERVATIONS)
    block = next(regressor_blocks(robot, part))
    rows = Stack.from_blocks([block], [JOINTS], np.zeros(robot.n)).flat
    compliance, _ = solve_nonnegative(rows[:, :-1], rows[:, -1])
    # A turn includes a shift: if both begin at the same observation, only the turn is fitted.
    named = [(name, first) for name, first in named if name != "shift" or ("turn", first) not in named]
    firsts = [first for _, first in named if first is not None]
    known = {(s.name, s.first): s for s in list_suspects(measurements, block, compliance, (), firsts)}
    missing = next((each for each in named if each not in known), None)
    if missing is not None:
        since_first = f" since observation '{missing[1]}'" if missing[1] else ""
        raise RequestError(
            f"the readings do not show the cause '{missing[0]}'{since_first}",
            where="causes",
            remedy=f"give one of: {', '.join(sorted({name for name, _ in known}))}",
        )
    terms = [known[each].term for each in named]
    fitted = fit_causes_with_joints(robot, part, terms, compliance)
    scatter = _find_scatter(robot, subtract_errors(robot, part, fitted.errors, fitted.compliance), fitted)
    if scatter != part.scatter:  # three targets with one error are one reading
        fitted = fit_causes_with_joints(robot, replace(part, scatter=scatter), terms, fitted.compliance)
    errors = _add_doubts(robot, replace(part, scatter=scatter), fitted)
    corrected = subtract_errors(robot, measurements, errors, fitted.compliance)
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


def fit_causes_with_joints(
    robot: Robot, part: Measurements, terms: Sequence[Term], compliance: FloatArray
) -> FittedCauses:
    """Fit causes together with the joints by Gauss-Newton, starting at a compliance (n,) of the joints.

    Directions of the unknowns that the joints explain equally well stay zero; their standard uncertainty is
    set to the size of the other unknowns.

    Raises:
        SolverError: a cause implies loads without a balance.
    """
    remaining, unknowns, size = part, np.zeros(()), np.zeros(0)
    for _ in range(_REFITS):
        block = next(regressor_blocks(robot, remaining, compliance))
        # A corrected load may twist joints that the stated load did not twist.
        excitation = Excitation(robot.joint_kinds)
        excitation.add(block)
        visible = ~excitation.observability().null
        triangles = TermTests(block, compliance, visible, terms, ())
        given, sigma = _compress(part, triangles)
        found = given.fit_with([term.name for term in terms])
        compliance = np.zeros(robot.n)
        compliance[visible] = np.maximum(found.known, 0.0)
        ends = np.cumsum([len(triangles.stated.span[term.name]) for term in terms])[:-1]
        previous, unknowns = unknowns, unknowns + found.unknowns
        if not size.any():  # unit of each term's unknowns: their root mean square after the first step
            by_term = np.split(unknowns, ends)
            size = np.concatenate([np.full(len(each), np.sqrt(np.mean(each**2)) or 1.0) for each in by_term])
        unknowns, root = _set_hidden_to_zero(unknowns, found, sigma, size)
        determined = found.root.shape[1]
        errors = FittedErrors(tuple(terms), tuple(np.split(unknowns, ends)), root, determined)
        fitted = FittedCauses(errors, compliance, visible, size, triangles)
        if np.linalg.norm((unknowns - previous) / size) <= _STEP_TOLERANCE * np.linalg.norm(unknowns / size):
            break
        remaining = subtract_errors(robot, part, errors, compliance)
    return fitted


def _compress(part: Measurements, tests: TermTests) -> tuple[Triangle, float]:
    """Return the triangle of the terms that are fitted in any case, and sigma: as stated, or larger [m]."""
    given = tests.compress_given_statements(tests.fitted)
    freedom = max(1, given.rows - given.rank(tests.fitted, INDEPENDENT))
    residual = float(np.sqrt(max(given.residual_squares(tests.fitted), 0.0) / freedom))
    return given, max(part.sigma or 0.0, residual)


def _set_hidden_to_zero(
    unknowns: FloatArray, found: TermsFit, sigma: float, size: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Set the part of unknowns (k,) that the joints explain equally well to zero.

    Returns the unknowns, and a root of their covariance, in which that part has the unknowns' typical size.
    """
    hidden = np.linalg.qr(found.hidden / size[:, None])[0]  # orthonormal directions in units of the size
    unknowns = unknowns - size * (hidden @ (hidden.T @ (unknowns / size)))
    return unknowns, np.hstack([sigma * found.root, size[:, None] * hidden])


def _add_doubts(robot: Robot, part: Measurements, fitted: FittedCauses) -> FittedErrors:
    """Return the fitted causes with what is uncertain about their columns, such as when play is taken up.

    The doubts are fitted together with the causes, each stated as zero with a standard uncertainty of 1.
    """
    errors, compliance = fitted.errors, fitted.compliance
    pairs = zip(errors.terms, errors.unknowns, strict=True)
    doubts = [term.doubt(values) for term, values in pairs if term.doubt is not None]
    if not doubts:
        return errors
    terms = (*errors.terms, *doubts)
    block = next(regressor_blocks(robot, subtract_errors(robot, part, errors, compliance), compliance))
    given, sigma = _compress(part, TermTests(block, compliance, fitted.visible, terms, ()))
    for term in doubts:
        given = given.state(term.name, np.ones(len(given.span[term.name])), sigma)
    given.span[JOINTS.name] = np.flatnonzero(fitted.visible)
    found = given.fit_with([term.name for term in terms])
    size = np.concatenate([fitted.size, np.ones(len(found.unknowns) - len(fitted.size))])
    before = np.concatenate([*errors.unknowns, np.zeros(len(size) - len(fitted.size))])
    unknowns, root = _set_hidden_to_zero(before + found.unknowns, found, sigma, size)
    ends = np.cumsum([len(given.span[term.name]) for term in terms])[:-1]
    return FittedErrors(terms, tuple(np.split(unknowns, ends)), root, errors.determined)


def _find_scatter(robot: Robot, corrected: Measurements, fitted: FittedCauses) -> Scatter:
    """Return the errors that the targets of a posture share, as what joints and causes leave shows them.

    Args:
        robot: n joints.
        corrected: some observations, from which the fitted causes were subtracted.
        fitted: the causes, fitted together with the joints.
    """
    if corrected.encoders is not None:
        return corrected.scatter
    part = corrected.select_evenly(_MOST_WITH_SCATTER)
    block = next(regressor_blocks(robot, part, fitted.compliance))
    compliance = fitted.compliance
    terms = [JOINTS, *fitted.errors.terms]
    stated = [each for each in list_stated_terms(part) if each.name not in {term.name for term in terms}]
    stack = Stack.from_blocks([block], [*terms, *stated], compliance)
    seen = np.concatenate([np.flatnonzero(fitted.visible), *list(stack.span.values())[1:]])
    likelihood = RestrictedLikelihood(block, stack, seen)
    scatter, p_value = likelihood.find_significant()
    motion = compute_target_motion(block, scatter, part.sigma or likelihood.sigma(scatter))
    is_believable = p_value < SCATTER_LEVEL and motion <= LARGEST_REPEATABILITY
    return scatter if is_believable else corrected.scatter


def subtract_errors(
    robot: Robot, measurements: Measurements, errors: FittedErrors, compliance: FloatArray
) -> Measurements:
    """Return the measurements with the motion by fitted errors subtracted, at a joint compliance (n,)."""
    pairs = list(zip(errors.terms, errors.unknowns, strict=True))
    # Errors of the load change the measurements' loads; the motion by all other errors is subtracted.
    for term, values in pairs:
        if term.change_loads is not None:
            measurements = term.change_loads(robot, measurements, values)
    pairs = [(term, values) for term, values in pairs if term.change_loads is None]
    if not pairs:
        return measurements
    targets, joints = [], []
    for block in regressor_blocks(robot, measurements, compliance):
        motions = [(term.motion(block, compliance), values) for term, values in pairs]
        targets.append(np.sum([motion.targets @ values for motion, values in motions], axis=0))
        turns = [motion.joints @ values for motion, values in motions if motion.joints is not None]
        joints.append(np.sum([np.zeros_like(block.torque), *turns], axis=0))
    target_motion = np.where(measurements.present[..., None], np.concatenate(targets), 0.0)
    encoders = measurements.encoders
    if encoders is not None:
        remaining = np.where(encoders.present, encoders.deflection - np.concatenate(joints), 0.0)
        encoders = replace(encoders, deflection=remaining)
    return replace(measurements, deflection=measurements.deflection - target_motion, encoders=encoders)
