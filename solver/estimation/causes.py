"""Causes of deflections that joints alone do not explain, and gross mistakes in the data (method.md §7, §13).

A load point elsewhere, a forgotten force, a load cell's zero, some loads heavier than others, play in the
gears, a tracker or base that moved: each is a term in addition to the joints, which are fitted with K_c to
the targets' rows, without bounds. One triangle of all terms answers every F test. Each test is made twice,
with the weights stated and with equal weights, and the larger p-value counts: a noise of the wrong shape
would accuse clean springs. Causes with a significant test are fitted by Gauss-Newton, and compared by the
Bayesian information criterion (Schwarz 1978), with bending links among them; a difference of less than
`AS_WELL` is a tie. Mistakes are tested before links: added to columns of links, their tests accuse clean
campaigns of elastic arms, and without these tests a load point elsewhere looks like links.

A *gross mistake* leaves numbers plausible: columns exchanged, a wrong joint map, the load as target. Each
such alternative is one more regressor of the same deflections: ``q = M (E q_c + e) + o`` with E exchanging,
reversing or coupling the controller's angles, e offsetting them by quarter turns, as makers' conventions are,
or the load at a target's place. As it has as many parameters as the fit itself, their residual sums compare
directly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, product
from typing import Final, Literal

import numpy as np
from scipy import special

from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.options import ElasticModel
from jointstiff.schemas.run import CauseTest
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError, SolverError
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.observability import Excitation
from jointstiff.solver.estimation.scatter import RestrictedLikelihood
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.estimation.statements import list_stated_terms
from jointstiff.solver.estimation.triangle import (
    INDEPENDENT,
    Triangle,
    compute_triangular_factor,
    orthonormal_basis,
    solve_nonnegative,
    stack_padded,
)
from jointstiff.solver.mechanics.block import (
    CorrectedMeasurements,
    FittedErrors,
    RegressorBlock,
    Rows,
    Term,
    build_rows,
    build_whitened_rows,
    fitted_errors,
    regressor_blocks,
    targets_in_flange,
    unloaded_block,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE, DIAGONAL_LINKS, FULL_BASE, JOINTS
from jointstiff.solver.mechanics.terms import (
    FORCE_SCALE,
    SHIFT,
    TERMS,
    build_load_scale_term,
    build_turn_term,
    limit_to_later,
)

MISTAKE_LEVEL: Final = 1e-5
"""Probability that noise alone makes the test of any cause, or of a bending base, significant."""
STATEMENT_LEVEL: Final = 3e-3
"""p-value of a statement below which the readings refute the statement: a load point some 4 of its standard
uncertainties off."""
LINKS_LEVEL: Final = 3e-3
"""p-value of links below which models with links are compared by cross-validation."""
CLEAR_GAIN: Final = 2.0
"""Gain of a model with links, in paired standard errors, above which joints alone do not fit."""
AS_WELL: Final = 6.0
"""Difference of the information criterion below which neither of two causes is preferred."""
_REFITS: Final = 6
"""Largest number of Gauss-Newton steps towards a cause."""
_STEP_TOLERANCE: Final = 1e-3
"""Relative size of a Gauss-Newton step at which the iteration ends."""
_MOST_COMBINATIONS: Final = 12
"""Number of combinations of link compliances that are tested: those with the largest deflections."""
MOST_TESTED_OBSERVATIONS: Final = 500
"""Number of observations that suffice for the tests."""
_LEAST_PART: Final = 4
"""Least number of observations before and after the onset of a cause, or under one of several loads."""
_DISTINCT: Final = 0.03
"""Relative difference of two loads from which on they are distinct."""
_MOST_LOADS: Final = 6
"""Largest number of distinct loads of a set that may each have a scale of their own."""


@dataclass(frozen=True)
class Suspect:
    """Possible cause that may have moved the targets in addition to the joints, to be tested."""

    name: str  #: name of the cause
    term: Term  #: how the cause moves the targets
    first: str | None = None  #: label of the first observation that the cause concerns; None for all
    tried: int = 1  #: number of observations that were tried as the onset; multiplies the p-value
    least_p: float = 0.0  #: lower limit of the p-value: without the observation that the cause explains most


@dataclass(frozen=True, eq=False)
class Cause:
    """Significant cause, fitted together with the joints until the fit converged."""

    suspect: Suspect
    unknowns: FloatArray  #: (k,) fitted values in the term's unit
    p_value: float  #: p-value of the F test of the cause
    links_p_value: float  #: p-value of the F test of links added to joints and cause
    compliance: FloatArray  #: (n,) of the joints, fitted together with the cause [rad/(N·m)]
    ratio: float  #: sum of squared residuals with the cause, over the sum without the cause
    criterion: float  #: Bayesian information criterion; the least is preferred

    @property
    def makes_links_unnecessary(self) -> bool:
        """True if, with this cause fitted, a test no longer finds that links bend (p ≥ `LINKS_LEVEL`)."""
        return self.links_p_value >= LINKS_LEVEL


@dataclass(frozen=True)
class HeldOutGain:
    """Result of a cross-validation: mean residuals of held-out postures, by two models.

    The models are the best one with links or coupling, and joints alone.
    """

    model: ElasticModel
    error: float  #: mean length of the residuals of that model [m]
    error_of_joints: float  #: mean length of the residuals of joints alone [m]
    standard_error: float  #: of the difference, paired by posture [m]


@dataclass(frozen=True, eq=False)
class Screening:
    """Outcome of the tests for causes, links and base in addition to the joints."""

    links_p_value: float  #: of the test of links added to the joints; 1 where the readings cannot decide
    tests: tuple[
        CauseTest, ...
    ]  #: tests of all causes, the most significant first; empty where no test was possible
    causes: tuple[
        Cause, ...
    ]  #: the best cause and those that explain the readings equally well; may be empty
    gain: HeldOutGain | None = None  #: gain of the cross-validation; None where none was run
    base_p_value: float = 1.0  #: p-value of the test of a base added to the joints
    #: p-value of links added to joints and base, then of a base added to joints and links; 1 if the test of
    #: the base alone is not significant
    links_p_value_with_base: float = 1.0
    base_p_value_with_links: float = 1.0
    comparable: bool = True  #: whether the options allow a comparison of joints alone with elastic links

    @property
    def makes_links_unnecessary(self) -> bool:
        """True if causes were found, and each leaves nothing for links to explain."""
        return bool(self.causes) and all(cause.makes_links_unnecessary for cause in self.causes)

    @property
    def lack_of_fit(self) -> bool:
        """True if a model with links explains the readings better than joints alone.

        The cross-validation decides if one was run, else the F test of links.
        """
        significant, gain = self.links_p_value < MISTAKE_LEVEL, self.gain
        if gain is not None:
            significant = gain.error_of_joints - gain.error > CLEAR_GAIN * gain.standard_error
        return self.links_need_validation and significant

    @property
    def links_need_validation(self) -> bool:
        """True if models with links should be cross-validated.

        The test of links is then significant, and no cause explains what the links would explain.
        """
        return self.links_p_value < LINKS_LEVEL and not self.makes_links_unnecessary

    @property
    def base_needs_validation(self) -> bool:
        """True if models with a bending base should be cross-validated.

        The test of the base is then significant, and no cause explains what links or base would explain.
        """
        return self.base_p_value < MISTAKE_LEVEL and not self.makes_links_unnecessary


def screen_estimate(
    robot: Robot, measurements: Measurements, estimate: Estimate, scattered: bool = False
) -> Screening:
    """Test for causes, links and a base that explain what joints alone leave unexplained.

    Only readings of targets are used, not encoders. If the load has no balance or there are no degrees of
    freedom, no test is significant. Causes that were fitted to these measurements before stay in every fit.

    Args:
        robot: n joints.
        measurements: N observations, with the scatter that was stated.
        estimate: estimate by joints alone.
        scattered: whether the residuals show a scatter of the joints, which tests must account for.
    """
    tested, compliance = (
        measurements.select_evenly(MOST_TESTED_OBSERVATIONS),
        np.maximum(estimate.compliance, 0.0),
    )
    bending_compliance = compliance if estimate.balanced is None else np.maximum(estimate.balanced, 0.0)
    try:
        block = next(regressor_blocks(robot, tested, bending_compliance))
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return Screening(1.0, (), ())
    always_fitted, visible = fitted_errors(measurements).terms, ~estimate.observability.null
    suspects = _list_suspects(measurements, block, compliance, always_fitted)
    triangles = _Triangles(
        block, compliance, visible, always_fitted, [suspect.term for suspect in suspects], scattered=scattered
    )
    links_p_value = triangles.links_p_value()
    # One p-value for each suspect, then that of the base.
    *p_values, base_p_value = triangles.p_values([*(s.term.name for s in suspects), DIAGONAL_BASE.name])
    # A cause sought by its onset is tested once for each onset that was tried (Bonferroni).
    tests = {s: min(1.0, s.tried * max(s.least_p, p)) for s, p in zip(suspects, p_values, strict=True)}
    ordered = sorted(suspects, key=tests.__getitem__)
    causes: list[Cause] = []
    for suspect in ordered:
        if tests[suspect] < MISTAKE_LEVEL / len(suspects):
            with suppress(SolverError):  # a cause that implies loads without a balance is no explanation
                causes.append(_fit_suspected_cause(robot, tested, triangles, suspect, tests[suspect]))
    preferred = _select_best_causes(causes, triangles, links_p_value)
    listed = tuple(CauseTest(name=each.name, first=each.first, p_value=tests[each]) for each in ordered)
    if base_p_value >= MISTAKE_LEVEL:
        return Screening(links_p_value, listed, preferred, base_p_value=base_p_value)
    with_base = _Triangles(block, compliance, visible, always_fitted, [FULL_BASE], scattered=scattered)
    return Screening(
        links_p_value,
        listed,
        preferred,
        base_p_value=base_p_value,
        links_p_value_with_base=with_base.links_p_value(FULL_BASE.name),
        base_p_value_with_links=triangles.p_values([DIAGONAL_BASE.name], DIAGONAL_LINKS.name)[0],
    )


def _select_best_causes(
    causes: list[Cause], triangles: _Triangles, links_p_value: float
) -> tuple[Cause, ...]:
    """Return the best cause and the causes that explain the readings equally well, at most one of each name.

    If links explain the readings better than any cause, only causes that make links unnecessary are returned.
    """
    causes.sort(key=lambda cause: -cause.criterion)
    # The causes are in order of decreasing criterion, so the best cause of each name overwrites the others.
    best_by_name = {cause.suspect.name: cause for cause in causes}
    least = min((cause.criterion for cause in causes), default=np.inf)
    best = tuple(cause for cause in reversed(best_by_name.values()) if cause.criterion <= least + AS_WELL)
    if links_p_value < LINKS_LEVEL and triangles.links_criterion() < least - AS_WELL:
        best = tuple(cause for cause in best if cause.makes_links_unnecessary)
    return best


def fit_causes(
    robot: Robot, measurements: Measurements, named: Sequence[tuple[str, str | None]]
) -> Measurements:
    """Return the measurements with the motion by named causes subtracted, and the causes' uncertainty added.

    The causes are fitted together with the joints.

    Args:
        robot: n joints.
        measurements: N observations.
        named: name of each cause, and label of the first observation that the cause concerns; None for all.

    Raises:
        RequestError: the readings do not show a cause, or a cause implies loads without a balance.
    """
    if not named:
        return measurements
    try:
        return _subtract_named_causes(robot, measurements, named)
    except SolverError as error:
        remedy = "omit the cause, and check the units of force and length"
        raise RequestError(error.reason, where="causes", remedy=remedy) from error


def _subtract_named_causes(
    robot: Robot, measurements: Measurements, named: Sequence[tuple[str, str | None]]
) -> Measurements:
    """Return the measurements with the motion by named causes subtracted, and the causes' uncertainty added.

    Raises:
        RequestError: the readings do not show a named cause.
        SolverError: a cause implies loads without a balance.
    """
    part = measurements.select_evenly(MOST_TESTED_OBSERVATIONS)
    block = next(regressor_blocks(robot, part))
    rows = Stack.from_blocks([block], [JOINTS], np.zeros(robot.n)).flat
    compliance, _ = solve_nonnegative(rows[:, :-1], rows[:, -1])
    # A turn includes a shift: if both begin at the same observation, only the turn is fitted.
    named = [(name, first) for name, first in named if name != "shift" or ("turn", first) not in named]
    firsts = [first for _, first in named if first is not None]
    known = {(s.name, s.first): s for s in _list_suspects(measurements, block, compliance, (), firsts)}
    missing = next((each for each in named if each not in known), None)
    if missing is not None:
        since_first = f" since observation '{missing[1]}'" if missing[1] else ""
        raise RequestError(
            f"the readings do not show the cause '{missing[0]}'{since_first}",
            where="causes",
            remedy=f"give one of: {', '.join(sorted({name for name, _ in known}))}",
        )
    fitted = _fit_causes_with_joints(robot, part, [known[each].term for each in named], compliance)
    corrected = _subtract_errors(robot, measurements, fitted.errors, fitted.compliance)
    return CorrectedMeasurements.from_measurements(corrected, fitted.errors)


@dataclass(frozen=True, eq=False)
class _FittedCauses:
    """Result of fitting causes together with the joints."""

    errors: FittedErrors
    compliance: FloatArray  # (n,) of the joints, fitted together with the causes [rad/(N·m)]
    triangles: _Triangles  # compressed rows of the readings, from which the fitted causes were subtracted


def _fit_causes_with_joints(
    robot: Robot, part: Measurements, terms: Sequence[Term], compliance: FloatArray
) -> _FittedCauses:
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
        triangles = _Triangles(block, compliance, visible, terms, ())
        found = triangles.compress_given_statements(triangles.fitted).fit_with([term.name for term in terms])
        compliance = np.zeros(robot.n)
        compliance[visible] = np.maximum(found.known, 0.0)
        ends = np.cumsum([len(triangles.stated.span[term.name]) for term in terms])[:-1]
        previous, unknowns = unknowns, unknowns + found.unknowns
        if not size.any():  # unit of each term's unknowns: their root mean square after the first step
            by_term = np.split(unknowns, ends)
            size = np.concatenate([np.full(len(each), np.sqrt(np.mean(each**2)) or 1.0) for each in by_term])
        # Set the part of the unknowns that the joints explain equally well to zero.
        hidden = np.linalg.qr(found.hidden / size[:, None])[0]  # orthonormal directions in these units
        unknowns = unknowns - size * (hidden @ (hidden.T @ (unknowns / size)))
        root = np.hstack([triangles.sigma * found.root, size[:, None] * hidden])
        determined = found.root.shape[1]
        errors = FittedErrors(tuple(terms), tuple(np.split(unknowns, ends)), root, determined)
        fitted = _FittedCauses(errors, compliance, triangles)
        if np.linalg.norm((unknowns - previous) / size) <= _STEP_TOLERANCE * np.linalg.norm(unknowns / size):
            break
        remaining = _subtract_errors(robot, part, errors, compliance)
    return fitted


def _fit_suspected_cause(
    robot: Robot, part: Measurements, triangles: _Triangles, suspect: Suspect, p_value: float
) -> Cause:
    """Fit a suspected cause together with the joints until convergence.

    Raises:
        SolverError: the cause implies loads without a balance, or its fitted size is negative although only
            positive sizes are possible.
    """
    fitted = _fit_causes_with_joints(
        robot, part, [*fitted_errors(part).terms, suspect.term], triangles.compliance
    )
    unknowns = fitted.errors.unknowns[-1]
    uncertainty = np.linalg.norm(fitted.errors.root, axis=1)[-len(unknowns) :]
    standardised = unknowns / uncertainty  # the unknown that is known best decides on the sign
    if suspect.term.nonnegative and standardised[np.abs(standardised).argmax()] < 0.0:
        raise SolverError(
            f"{suspect.name} would be negative", where="causes", remedy="look for another cause"
        )
    squares = fitted.triangles.residual_squares()
    # The onset of a cause that sets in later counts as one more unknown.
    count = fitted.errors.determined + (suspect.first is not None)
    return Cause(
        suspect,
        unknowns,
        p_value,
        fitted.triangles.links_p_value(),
        fitted.compliance,
        squares / triangles.residual_squares(),
        fitted.triangles.criterion(squares, count),
    )


def _subtract_errors(
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


def list_suspected_terms(measurements: Measurements, block: RegressorBlock) -> list[Term]:
    """Return the terms that may have moved the targets of all observations.

    Args:
        measurements: N observations.
        block: some of these observations.
    """
    loads = _group_distinct_loads(measurements)
    turn = build_turn_term(block.points[block.measurements.present].mean(axis=0))
    by_load = [build_load_scale_term(loads)] if len(loads) > 1 else []
    return [term for term in (*TERMS.values(), turn, *by_load) if term.suspected]


def _list_suspects(
    measurements: Measurements,
    block: RegressorBlock,
    compliance: FloatArray,
    always_fitted: Sequence[Term],
    firsts: Sequence[str] | None = None,
) -> list[Suspect]:
    """Return the causes that may have moved the targets and are to be tested.

    Each suspect has a lower limit of its p-value, so that a single wrong reading cannot make the suspect
    significant.

    Args:
        measurements: N observations.
        block: some of these observations.
        compliance: (n,) of the joints [rad/(N·m)].
        always_fitted: terms that are fitted in any case; these terms are not suspected again.
        firsts: labels of observations that may be the onset of a cause; None to search for the onset.
    """
    part, labels = block.measurements, measurements.labels
    tried = len(part) - 2 * _LEAST_PART + 1
    whole = list_suspected_terms(measurements, block)
    turn = next(term for term in whole if term.name == "turn")
    # Causes that may set in at a later observation.
    later = {SHIFT.name: SHIFT, turn.name: turn, FORCE_SCALE.name: build_load_scale_term([labels])}
    suspects = [Suspect(term.name, term) for term in whole]
    if firsts is not None:
        known = [first for first in firsts if first in labels]
        suspects += [
            Suspect(t.name, limit_to_later(t, labels, first), first)
            for t in later.values()
            for first in known
        ]
    else:  # fit each term with each observation as the onset, to find the best onset
        terms = [*(each.term for each in suspects), FORCE_SCALE]
        stack = Stack.from_blocks([block], [JOINTS, *always_fitted, *terms], compliance)
        fits = _OnsetFits(
            stack, [term.name for term in terms], [term.name for term in (JOINTS, *always_fitted)]
        )
        least = fits.p_values_without_best_observation(np.zeros(len(terms), np.intp))
        suspects = [replace(each, least_p=p) for each, p in zip(suspects, least.tolist(), strict=False)]
        if tried > 0:
            onsets = fits.find_onsets()
            for each, onset, p in zip(
                terms, onsets.tolist(), fits.p_values_without_best_observation(onsets).tolist(), strict=True
            ):
                if each.name in later:
                    term, first = later[each.name], part.labels[onset]
                    suspects.append(Suspect(term.name, limit_to_later(term, labels, first), first, tried, p))
    return [suspect for suspect in suspects if suspect.term.name not in {term.name for term in always_fitted}]


def _group_distinct_loads(measurements: Measurements) -> list[list[str]]:
    """Return the labels of the observations under each distinct load, from the smallest load to the largest.

    Loads of nearly the same size count as one load. The list is empty for more than `_MOST_LOADS` loads.
    """
    size = np.hypot(np.linalg.norm(measurements.force, axis=1), np.linalg.norm(measurements.moment, axis=1))
    order = np.argsort(size, kind="stable")
    steps = 1 + np.flatnonzero(np.diff(size[order]) > _DISTINCT * size[order][1:])
    groups = [group for group in np.split(order, steps) if len(group) >= _LEAST_PART]
    if len(groups) > _MOST_LOADS:
        return []
    return [[measurements.labels[i] for i in group.tolist()] for group in groups]


class _OnsetFits:
    """Fits of S terms that act only from some observation on, for each of N observations as the onset.

    Each term is fitted together with the joints and other terms. Columns have unit length over all
    observations.
    """

    def __init__(self, stack: Stack, names: Sequence[str], known: Sequence[str]) -> None:
        """Fit each term for each observation as its onset.

        Args:
            stack: N observations.
            names: names of the S terms.
            known: names of terms that are fitted in any case.
        """
        flat = stack.scale_to_unit_columns()[0].flat
        basis = orthonormal_basis(flat[:, np.concatenate([stack.span[name] for name in known])])
        residual = stack.flat[:, -1] - basis @ (basis.T @ stack.flat[:, -1])
        columns = [flat[:, stack.span[name]] for name in names]
        q, self._width = basis.shape[1], np.array([each.shape[1] for each in columns])
        X = stack_padded(columns)  # (S, N m, k)
        shape, k = (len(stack), -1), X.shape[-1]
        rows = np.concatenate([basis, residual[:, None], *X], axis=1).reshape(*shape, q + 1 + len(names) * k)
        trailing = Stack(
            rows, stack.read, {"known": q, "residual": 1, "terms": len(names) * k}
        ).trailing_gram_sums
        # Sums of Gram matrices from each observation to the last give the fits for all onsets at once.
        columns_of_term = (q + 1 + np.arange(len(names) * k)).reshape(len(names), k)
        overlap = trailing[:, :q][:, :, columns_of_term].transpose(2, 0, 1, 3)  # (S, N, q, k)
        # Gram matrix of each term after the known terms have been projected out.
        grams = trailing[:, columns_of_term[:, :, None], columns_of_term[:, None]].transpose(1, 0, 2, 3)
        projected = grams - overlap.mT @ overlap
        self._moment = trailing[:, columns_of_term, q, None].transpose(1, 0, 2, 3)  # (S, N, k, 1)
        self._unknowns = np.linalg.solve(projected + INDEPENDENT * np.eye(k), self._moment)
        self._read, self._X = stack.read, X.reshape(len(names), *shape, k)
        self._known, self._left = basis.reshape(*shape, q), residual.reshape(*shape, 1)

    def find_onsets(self) -> IndexArray:
        """Return the indices (S,) of each term's best onset, with enough observations before and after."""
        gain = (self._moment * self._unknowns).sum(axis=(2, 3))
        allowed = gain[:, _LEAST_PART : gain.shape[1] - _LEAST_PART + 1]
        return np.asarray(_LEAST_PART + np.argmax(allowed, axis=1))

    def p_values_without_best_observation(self, first: IndexArray) -> FloatArray:
        """Return p-values (S,) of the terms from onsets `first` (S,), each without one observation.

        For each term the observation that the term explains best is left out, as the observation may be a
        single wrong reading.
        """
        count = len(self._read)
        motion = self._X @ self._unknowns[np.arange(len(first)), first][:, None]
        motion = np.where(np.arange(count)[:, None, None] >= first[:, None, None, None], motion, 0.0)
        # The known terms absorb part of the motion by the term.
        absorbed = self._known @ np.einsum("brk,sbrl->skl", self._known, motion)[:, None]
        squares, squares_with_term = np.square(self._left), np.square(self._left - motion + absorbed)
        squares, gain = squares.sum(axis=(1, 2)), (squares - squares_with_term).sum(axis=(2, 3))
        others = np.arange(count) != np.argmax(gain, axis=1)[:, None]
        freedom = (others * self._read).sum(axis=1) - self._known.shape[-1] - self._width
        explained = np.maximum((others * gain).sum(axis=1), 0.0)
        residual = np.maximum((others * squares).sum(axis=1) - explained, 1e-300)
        divisor = np.maximum(freedom, 1)  # without freedom the p-value is 1, see below
        p = special.fdtrc(self._width, divisor, explained / self._width / (residual / divisor))
        return np.where(freedom < 1, 1.0, p)


class _Triangles:
    """Compressed rows of joints, causes, links and base, with the stated and with equal weights.

    Attributes:
        stated: triangle with the weights stated with the readings.
    """

    def __init__(
        self,
        block: RegressorBlock,
        compliance: FloatArray,
        visible: BoolArray,
        always_fitted: Sequence[Term],
        terms: Sequence[Term],
        *,
        scattered: bool = False,
    ) -> None:
        """Compress a block's rows.

        Args:
            block: the observations.
            compliance: (n,) of the joints [rad/(N·m)].
            visible: (n,) whether the readings see each joint; other joints are left out.
            always_fitted: terms that are fitted with the joints in any case.
            terms: terms to be tested.
            scattered: whether the residuals show a scatter of the joints, which tests must account for.
        """
        self.fitted = (JOINTS.name, *(term.name for term in always_fitted))
        self.compliance = compliance
        self._block, self._visible = block, visible
        self._scattered = scattered
        self._stated_terms = list_stated_terms(block.measurements)
        self._terms = [JOINTS, *always_fitted, *terms, DIAGONAL_LINKS, DIAGONAL_BASE]
        self.stated = self._compress_rows(build_whitened_rows)

    @cached_property
    def _equally_weighted(self) -> Triangle:
        """Triangle with equal weights of all readings."""
        return self._compress_rows(build_rows)

    def _compress_rows(self, build: Callable[..., Rows]) -> Triangle:
        """Return the triangle of all terms, with rows built by `build`."""
        triangle = Stack.from_blocks([self._block], self._terms, self.compliance, build).triangle()
        triangle.span[JOINTS.name] = np.flatnonzero(self._visible)
        return triangle

    def _largest_p_values(
        self, level: float, names: Sequence[str], fitted: Sequence[str], test: Callable[..., FloatArray]
    ) -> FloatArray:
        """Return for each tested term the largest p-value of up to three tests.

        The weights are those stated, then equal weights, then those that account for statements and for
        scatter from posture to posture. Where the p-value with stated weights is above `level`, no other
        weights are tried.

        Args:
            level: significance level.
            names: tested terms.
            fitted: terms that are fitted in any case.
            test: function of a triangle, and of the names of tested terms, that returns their p-values.
        """
        p = test(self.stated, names)
        # Readings that share one covariance (3, 3) have equal weights already.
        if (p < level).any() and self._block.measurements.covariance.ndim > 2:
            p = np.where(p < level, np.maximum(p, test(self._equally_weighted, names)), p)
        if self._scattered or self._stated_terms:
            for k in np.flatnonzero(p < level).tolist():
                p[k] = max(p[k], self._p_value_given_all(names[k], fitted, test))
        return p

    def _p_value_given_all(self, name: str, fitted: Sequence[str], test: Callable[..., FloatArray]) -> float:
        """Return the p-value of a term, given statements and the scatter that is most likely with the term.

        The scatter that residuals of joints alone show also holds the motion by the tested cause. A cause
        about which something is stated is tested against the statement.

        Args:
            name: tested term.
            fitted: terms that are fitted in any case.
            test: function of a triangle, and of the names of tested terms, that returns their p-values.
        """
        triangle = self.compress_given_statements((*fitted, name))
        own = next((term for term in self._stated_terms if term.name == name), None)
        if own is None:
            return float(test(triangle, [name])[0])
        common = self._block.measurements.common_uncertainty
        uncertainty = np.resize(own.prior(common), len(triangle.span[name]))
        p_value = triangle.statement_p_value(name, fitted, uncertainty)
        return float(test(triangle, [name])[0]) if p_value < STATEMENT_LEVEL else p_value

    def compress_given_statements(self, names: Sequence[str]) -> Triangle:
        """Return the triangle of some terms, in which statements about all other terms are fitted.

        If the residuals show scatter, the rows have the scatter that is most likely with these terms.
        """
        others = [term for term in self._stated_terms if term.name not in names]
        terms = [*(term for term in self._terms if term.name in names), *others]
        block = self._block
        if self._scattered:
            stack = Stack.from_blocks([block], terms, self.compliance)
            seen = np.concatenate([np.flatnonzero(self._visible), *list(stack.span.values())[1:]])
            scatter, _ = RestrictedLikelihood(block, stack, seen).maximise()
            block = replace(block, measurements=replace(block.measurements, scatter=scatter))
        triangle = Stack.from_blocks([block], terms, self.compliance).triangle()
        sigma = block.measurements.sigma or triangle.sigma([term.name for term in terms])
        for term in others:
            width = len(triangle.span[term.name])
            uncertainty = np.resize(term.prior(block.measurements.common_uncertainty), width)
            triangle = triangle.given(term.name, uncertainty, sigma)
        triangle.span[JOINTS.name] = np.flatnonzero(self._visible)
        return triangle

    def p_values(self, names: Sequence[str], *others: str) -> list[float]:
        """Return the p-value of each named term added to the joints and to other terms."""
        fitted = (*self.fitted, *others)
        p = self._largest_p_values(
            MISTAKE_LEVEL, names, fitted, lambda triangle, tested: triangle.p_values(tested, fitted)
        )
        return [*p.tolist()]

    def links_p_value(self, *others: str) -> float:
        """Return the p-value of elastic links added to the joints and to other terms."""
        fitted = (*self.fitted, *others)
        p = self._largest_p_values(
            LINKS_LEVEL,
            [DIAGONAL_LINKS.name],
            fitted,
            lambda triangle, tested: triangle.p_values(
                tested, fitted, most=self._leading_count, least=INDEPENDENT
            ),
        )
        return float(p[0])

    @property
    def _leading_count(self) -> int:
        """Number of combinations of link compliances to test, fewer if there are few readings."""
        return max(0, min(_MOST_COMBINATIONS, (self.stated.rows - len(self._visible)) // 3))

    @property
    def sigma(self) -> float:
        """Standard uncertainty of a coordinate [m]: as stated, or from the residuals if larger."""
        freedom = max(1, self.stated.rows - orthonormal_basis(self.stated.unit_columns(self.fitted)).shape[1])
        stated = self._block.measurements.sigma or 0.0
        return max(stated, float(np.sqrt(self.residual_squares() / freedom)))

    def residual_squares(self) -> float:
        """Return the sum of squared residuals of the joints and the terms that are fitted in any case."""
        return max(self.stated.residual_squares(self.fitted), 1e-300)

    def criterion(self, squares: float, unknowns: int) -> float:
        """Return the Bayesian information criterion of a fit.

        Args:
            squares: sum of squared residuals of the fit.
            unknowns: number of unknowns in addition to the joints.
        """
        return self.stated.rows * float(np.log(squares)) + unknowns * float(np.log(self.stated.rows))

    def links_criterion(self) -> float:
        """Return the Bayesian information criterion of joints with the leading combinations of links."""
        known = orthonormal_basis(self.stated.unit_columns(self.fitted))
        links = self.stated.unit_columns([DIAGONAL_LINKS.name])
        leading = orthonormal_basis(links - known @ (known.T @ links), INDEPENDENT)[:, : self._leading_count]
        explained = float(np.square(leading.T @ self.stated.rhs).sum())
        return self.criterion(max(self.residual_squares() - explained, 1e-300), leading.shape[1])


AlternativeKind = Literal[
    "columns_exchanged",
    "sign_reversed",
    "zero_offset",
    "joints_coupled",
    "joint_map",
    "load_and_target_exchanged",
]

FALSE_ALARM: Final = 1e-4
"""Probability that noise alone makes any alternative of a set fit better."""
LARGEST_RATIO: Final = 0.7
"""Largest ratio of the residual sums, alternative to fit: model errors favour a wrong alternative by less."""
LEAST_COMPENSATION: Final = 0.7
"""Least compensation of an acceptable alternative; if that of the data as given is less, joint maps are
tried."""
_MAPPED_JOINTS: Final = 7
"""Number of joints up to which whole joint maps are tried: each further joint doubles the number of maps."""
_MOST_COMPARED_OBSERVATIONS: Final = 60
"""Number of observations that suffice to find a mistake that all observations share."""
_PRESELECTION_COORDINATES: Final = 3
"""Number of coordinates, for each joint, in the observations that preselect alternatives."""
_MOST_TARGETS: Final = 8
_READINGS: Final = 24_576
"""Maximum number of readings over all alternatives: with many joints fewer observations are compared."""
_LEAST_FREEDOM: Final = 3


@dataclass(frozen=True, eq=False)
class Alternative:
    """Possible mistake in the data, with the change that undoes the mistake."""

    kind: AlternativeKind  #: kind of mistake
    joints: tuple[int, ...]  #: indices of the affected joints of the controller
    matrix: FloatArray  #: (n, n) E, dimensionless: correct controller angles are E q_c + e
    offset: FloatArray  #: (n,) e [rad]
    #: index of the target whose place and the load point are exchanged; None for other kinds
    target: int | None = None


@dataclass(frozen=True, eq=False)
class BetterAlternative:
    """An alternative that explains the readings far better than the set as given."""

    alternative: Alternative  #: the mistake that was undone
    #: residual sum of squares with the mistake undone, over the residual sum of the data as given
    ratio: float
    compensation: float  #: share of the mean deflection that the joints explain with the mistake undone
    compensation_as_given: float  #: share of the mean deflection that the joints explain as given


def find_better_alternative(robot: Robot, measurements: Measurements) -> BetterAlternative | None:
    """Find the mistake in the data whose correction explains the readings far better; None if none does.

    The gain must be larger than noise and model errors explain: significant by an F test in which the
    correction counts as n further parameters. All fits have compliances ≥ 0.
    """
    best, given_compensation = _find_best_alternative(
        robot, measurements, _list_alternatives(robot.joint_kinds, measurements.present.shape[1])
    )
    if given_compensation < LEAST_COMPENSATION and 2 < robot.n <= _MAPPED_JOINTS:
        mapped, _ = _find_best_alternative(robot, measurements, _list_joint_maps(robot.joint_kinds))
        found = [each for each in (best, mapped) if each is not None]
        best = min(found, key=lambda each: each.ratio, default=None)
    return best


def _find_best_alternative(
    robot: Robot, measurements: Measurements, alternatives: Sequence[Alternative]
) -> tuple[BetterAlternative | None, float]:
    """Return the best significant alternative, or None, and the compensation of the data as given."""
    affordable = _READINGS // (measurements.present.shape[1] * (len(alternatives) + 1))
    part = measurements.select_evenly(max(1, min(_MOST_COMPARED_OBSERVATIONS, affordable)))
    # A rigid flange moves by six coordinates at most.
    coordinates = int(np.minimum(part.coordinates.sum(axis=1), 6).sum())
    freedom = coordinates - robot.n
    if freedom < _LEAST_FREEDOM:
        return None, 1.0
    # Noise alone makes a ratio of residual sums fall below `ratio` with probability `FALSE_ALARM` at most.
    quantile = float(special.fdtri(robot.n, freedom, 1.0 - FALSE_ALARM / len(alternatives)))
    ratio = min(LARGEST_RATIO, 1.0 / (1.0 + robot.n * quantile / freedom))
    # Some of the observations select the alternatives to examine.
    preselection = part.select_evenly(
        math.ceil(_PRESELECTION_COORDINATES * robot.n * len(part) / coordinates)
    )
    rows = _build_alternative_rows(robot, preselection, alternatives)
    as_given, given_compensation = _fit_nonnegative_compliances(rows[0])
    alternatives = [
        a for a, left in zip(alternatives, _bound_residual_sums(rows[1:]), strict=True) if left < as_given
    ]
    if not alternatives:
        return None, given_compensation
    rows = _build_alternative_rows(robot, part, alternatives)
    as_given, given_compensation = _fit_nonnegative_compliances(rows[0])
    needed, best = as_given * ratio, None
    # rows[0] are the data as given, rows[k] those of alternative k − 1.
    for k in (1 + np.flatnonzero(_bound_residual_sums(rows[1:]) < needed)).tolist():
        squares, compensation = _fit_nonnegative_compliances(rows[k])
        if squares < needed and compensation >= LEAST_COMPENSATION:
            best, needed = (
                BetterAlternative(alternatives[k - 1], squares / as_given, compensation, given_compensation),
                squares,
            )
    # If every force has the wrong sign, nearly any alternative fits better than the data as given; then the
    # integrity checks report the sign, and no alternative is returned.
    if (
        best is not None
        and _fit_nonnegative_compliances(rows[0] * np.append(np.ones(robot.n), -1.0))[0] < needed
    ):
        return None, given_compensation
    return best, given_compensation


@lru_cache
def _list_alternatives(kinds: tuple[JointKind, ...], targets: int) -> tuple[Alternative, ...]:
    """Return the possible mistakes, one change each; only joints of one kind are exchanged or coupled."""
    n, turning = len(kinds), [j for j, kind in enumerate(kinds) if kind == "revolute"]
    identity, no_offset = np.eye(n), np.zeros(n)
    mistakes: list[Alternative] = []
    for j, k in ((j, k) for j, k in combinations(range(n), 2) if kinds[j] == kinds[k]):
        order = np.arange(n)
        order[[j, k]] = k, j
        mistakes.append(Alternative("columns_exchanged", (j, k), identity[order], no_offset))
    for j, row in enumerate(identity):
        reversed_joint = identity - 2.0 * np.outer(row, row)
        mistakes.append(Alternative("sign_reversed", (j,), reversed_joint, no_offset))
    for sign in (1.0, -1.0) if n > 2 and kinds[1] == kinds[2] else ():
        coupled = identity + sign * np.outer(identity[2], identity[1])
        mistakes.append(Alternative("joints_coupled", (1, 2), coupled, no_offset))
    for j, turn in product(turning, (0.5 * np.pi, -0.5 * np.pi, np.pi)):
        mistakes.append(Alternative("zero_offset", (j,), identity, turn * identity[j]))
    exchanges = [
        Alternative("load_and_target_exchanged", (), identity, no_offset, t)
        for t in range(min(targets, _MOST_TARGETS))
    ]
    return (*mistakes, *exchanges)


@lru_cache
def _list_joint_maps(kinds: tuple[JointKind, ...]) -> tuple[Alternative, ...]:
    """Return the joint maps to compare that differ from the stated map by more than one mistake.

    Any signs may be reversed, and the third joint may be coupled to the second.
    """
    n, maps = len(kinds), list[Alternative]()
    identity, couplings = np.eye(n), (0.0, 1.0, -1.0) if kinds[1] == kinds[2] else (0.0,)
    for coupling, signs in product(couplings, product((1.0, -1.0), repeat=n)):
        concerned = {*np.flatnonzero(np.array(signs) < 0.0).tolist()}
        if len(concerned) + abs(coupling) > 1:
            joints = tuple(sorted(concerned | ({1, 2} if coupling else set())))
            matrix = np.diag(signs) @ (identity + coupling * np.outer(identity[2], identity[1]))
            maps.append(Alternative("joint_map", joints, matrix, np.zeros(n)))
    return tuple(maps)


def _build_alternative_rows(
    robot: Robot, given: Measurements, alternatives: Sequence[Alternative]
) -> FloatArray:
    """Return whitened rows (K + 1, R, n + 1) [A d]: of the measurements as given, then of K alternatives."""
    count, copies = len(given), len(alternatives) + 1
    matrices = np.array([np.eye(robot.n), *(each.matrix for each in alternatives)])
    offsets = np.array([np.zeros(robot.n), *(each.offset for each in alternatives)])
    joints = (given.joints @ matrices.transpose(0, 2, 1) + offsets[:, None]).reshape(copies * count, -1)
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    stacked = given[np.tile(np.arange(count), copies)]
    load_point, position = stacked.load_point.copy(), stacked.position.copy()
    # Places (N, T, 3) of the targets in the flange frame [m].
    places = np.where(given.in_flange[..., None], given.position, targets_in_flange(robot, given))
    for k, t in enumerate((each.target for each in alternatives), 1):
        if t is not None:  # the alternative exchanges load point and target
            part = slice(k * count, (k + 1) * count)
            load_point[part] = places[:, t]
            position[part, t] = np.where(given.in_flange[:, t, None], given.load_point, given.position[:, t])
    block = unloaded_block(
        robot, postures, replace(stacked, joints=joints, load_point=load_point, position=position)
    )
    return Stack.from_blocks([block], [JOINTS], np.zeros(robot.n)).rows.reshape(copies, -1, robot.n + 1)


def _bound_residual_sums(rows: FloatArray) -> FloatArray:
    """Return lower limits (K,) of the residual sums of squares of K fits to rows (K, R, n + 1) [A d].

    A fit without bounds on the compliances has no larger residual sum than a fit with bounds.
    """
    return np.square(compute_triangular_factor(rows)[:, -1, -1])


def _fit_nonnegative_compliances(rows: FloatArray) -> tuple[float, float]:
    """Fit compliances ≥ 0 to rows (R, n + 1) [A d].

    Returns the residual sum of squares, and the share of the mean deflection that the fit explains.
    """
    A, d = rows[:, :-1], rows[:, -1]
    residual = d - A @ solve_nonnegative(A, d)[0]
    residual_length = np.linalg.norm(residual.reshape(-1, 3), axis=1).sum()
    deflection_length = np.linalg.norm(d.reshape(-1, 3), axis=1).sum()
    explained = float(1.0 - residual_length / deflection_length) if deflection_length > 0.0 else 0.0
    return float(residual @ residual), explained
