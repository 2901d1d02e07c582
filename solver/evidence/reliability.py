"""External reliability (Baarda 1968): mistakes that no test would find, and what they move (method.md §13).

A mistake e in a term B moves the readings by B e, and the tests of causes find it by what the joints A leave
of it: ``λ = eᵀ N e / σ²`` with ``N = Bᵀ (I − P_A) B``. The least mistakes that are found with probability
`POWER` have ``λ = λ₀``, the non-centrality at which an F test at the tests' level has that power. They move a
compliance by up to ``√λ₀ σ √(hᵀ N⁻¹ h)``, h the change of the estimate by one unit of each unknown: h is a
row of A⁺B, with statements as rows of A and B.

A term about which something is stated counts with a mistake beyond the statement: its test must find the
mistake with the F test, and must find the statement refuted. The fit itself corrects such a mistake as far as
the readings know better than the statement, so that h is small where little was stated.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import special
from scipy.optimize import brentq

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.suspects import MOST_TESTED_OBSERVATIONS, list_suspected_terms
from jointstiff.solver.evidence.term_tests import MISTAKE_LEVEL, STATEMENT_LEVEL, join_statements
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.statements import list_stated_terms
from jointstiff.solver.fit.triangle import (
    DISTINCT,
    Triangle,
    orthonormal_basis,
    solve_nonnegative,
    unit_columns,
)
from jointstiff.solver.mechanics.block import Term, fitted_errors
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.text import figure, length_text

POWER: Final = 0.8
"""Probability with which the least mistake is found."""
HARMLESS: Final = 3.0
"""Number of standard uncertainties up to which a mistake that no test finds may move a joint."""
_LARGEST: Final[dict[str, float]] = {"load_point": 0.2, "play": 3e-3}
"""Largest mistake that is considered [m, rad]: people see larger ones."""
_LARGEST_FORCE: Final = 0.1
"""Largest error of a force that is considered, as a share of the largest force."""
_NO_MISTAKES: Final = frozenset(
    {"curved_springs", "rope_zero", "hook_weight", "tool", "growth", "growth_over_time"}
)
"""Terms that are no mistake: where no test shows that springs are curved, a straight line through their
deflections is what a stiffness means."""
_BEYOND: Final = 5.0
"""Size, in largest mistakes, at which a direction ends that no test looks at."""
_MOST_NAMED: Final = 3
"""Largest number of mistakes that the remark describes."""
_SMALLEST_COLUMN: Final = 1e-9
"""Singular value of unit columns up to which a direction moves nothing."""
_LARGEST_NONCENTRALITY: Final = 1e8


Unit: TypeAlias = Literal["m", "rad", "N", "1"]


@dataclass(frozen=True)
class LeastMistake:
    """Mistake of a term that tests just find with probability `POWER`, and what it moves the most."""

    name: str  #: name of the term
    unit: Unit  #: unit of the size: m, N, rad, or 1 for a relative error
    size: float  #: length of the unknowns of the mistake; of a shift and turn, of the turn
    joint: str  #: name of the joint that it moves most
    unknowns: tuple[float, ...]  #: unknowns of the mistake, in the term's unit
    moves: float  #: change of this joint's compliance, in its standard uncertainties
    is_assumed: bool = False  #: whether the uncertainty of the load point is assumed, not stated


@dataclass(frozen=True, eq=False)
class _Ellipsoid:
    """Mistakes e with eᵀ M e ≤ 1, which no test finds.

    In coordinates ``y = rows e`` the ellipsoid is the ball ‖y‖ ≤ 1.
    """

    rows: FloatArray  # (r, k) root of M: eᵀ M e = ‖rows e‖²
    positive: bool  # whether all unknowns are positive or zero

    def list_worst(self, responses: FloatArray) -> FloatArray:
        """Return for each joint the mistake (q, k) within the ellipsoid that moves its compliance most.

        `responses` (q, k) are the changes of q joints' compliances per unit of each unknown of the mistake.
        """
        gradients = responses @ self._mistake_of_ball_point  # (q, r) change per unit of each coordinate y
        if self.positive:
            pairs = zip(responses, gradients, strict=True)
            return np.array([self._find_worst_positive(response, gradient) for response, gradient in pairs])
        # The point of the ball that moves a joint most is in the direction of the gradient.
        lengths = np.linalg.norm(gradients, axis=1, keepdims=True)
        ball_points = gradients / np.maximum(lengths, np.finfo(float).tiny)
        return np.asarray(ball_points @ self._mistake_of_ball_point.T)

    def _find_worst_positive(self, response: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the mistake (k,) of positive unknowns that moves the compliance of a joint most.

        Args:
            response: (k,) change of the joint's compliance per unit of each unknown.
            gradient: (r,) change of the joint's compliance per unit of each coordinate y.
        """
        worst = np.zeros_like(response)
        # One of the two mistakes makes the joint softer, the other one stiffer.
        for direction in (gradient, -gradient):
            mistake, _ = solve_nonnegative(self.rows, direction)
            length = float(np.linalg.norm(self.rows @ mistake))
            if length > 0.0:
                mistake = mistake / length  # on the surface of the ellipsoid
            if abs(float(response @ mistake)) > abs(float(response @ worst)):
                worst = mistake
        return worst

    @cached_property
    def _mistake_of_ball_point(self) -> FloatArray:
        """Matrix (k, r) that maps y to the mistake e: pseudo-inverse of the rows, scaled to unit columns.

        Directions that move no reading are left out.
        """
        unit_vectors, length = unit_columns(self.rows)
        U, singular_values, Vt = np.linalg.svd(unit_vectors, full_matrices=False)
        is_shown = singular_values > _SMALLEST_COLUMN
        scaled_mistakes = (Vt[is_shown].T / singular_values[is_shown]) @ U[:, is_shown].T
        return np.asarray(scaled_mistakes / length[:, None])


@dataclass(frozen=True, eq=False)
class _Remaining:
    """Motion of the targets by a mistake, without the part that joints and fitted causes can absorb."""

    columns: FloatArray  # (N, m, k) for each observation, per unit of each unknown
    largest: float  # largest plausible length of a mistake

    @classmethod
    def from_stack(cls, stack: Stack, term: Term, fitted_basis: FloatArray, force: float) -> _Remaining:
        """Return the columns of a term without the part that the fitted terms explain.

        Args:
            stack: rows of all terms.
            term: term whose mistake is sought.
            fitted_basis: orthonormal columns that span the fitted terms, which are projected out.
            force: largest force of a load [N], which bounds errors of forces.
        """
        columns = stack.flat[:, stack.span[term.name]]
        remaining_columns = columns - fitted_basis @ (fitted_basis.T @ columns)
        observation_count, row_count = stack.rows.shape[:2]
        is_force = term.unit == "N" and force > 0.0
        largest_mistake = _LARGEST_FORCE * force if is_force else _LARGEST.get(term.name, np.inf)
        return cls(remaining_columns.reshape(observation_count, row_count, -1), largest_mistake)

    def enlarge(self, mistakes: FloatArray) -> FloatArray:
        """Return mistakes (q, k) enlarged so that each shows even without the observation that it moves most.

        A mistake stays below the largest plausible size.
        """
        tiny = np.finfo(float).tiny
        squared_motion = np.square(self.columns @ mistakes.T).sum(axis=1)  # (N, q) of each observation
        total_motion = np.maximum(squared_motion.sum(axis=0), tiny)
        share_of_others = 1.0 - squared_motion.max(axis=0) / total_motion
        needed_factor = 1.0 / np.sqrt(np.maximum(share_of_others, np.finfo(float).eps))
        length = np.linalg.norm(mistakes, axis=1)
        largest_factor = np.full(len(mistakes), 1.0)
        np.divide(self.largest, length, out=largest_factor, where=length > 0.0)
        return np.asarray(np.minimum(needed_factor, largest_factor)[:, None] * mistakes)


class _WorstMistake(NamedTuple):
    """Mistake that moves a joint by most uncertainties, among those of a term that no test finds."""

    moves: float  # change of the joint's compliance, in its standard uncertainties; 0 if no joint moves
    joint: int  # position of the joint among the joints that were compared
    unknowns: FloatArray  # (k,) unknowns of the mistake, in the term's unit


def _find_worst_mistake(
    ellipsoids: Iterable[_Ellipsoid],
    remaining: _Remaining,
    responses: FloatArray,
    uncertainties: FloatArray,
) -> _WorstMistake:
    """Find the mistake that moves a joint by most standard uncertainties.

    Args:
        ellipsoids: mistakes that the tests do not find.
        remaining: motion of the targets by the mistake that the fitted terms cannot absorb.
        responses: (q, k) changes of q joints' compliances per unit of each unknown [rad/(N·m)].
        uncertainties: (q,) standard uncertainties of these compliances [rad/(N·m)].
    """
    worst = _WorstMistake(0.0, 0, np.zeros(0))
    for ellipsoid in ellipsoids:
        mistakes = remaining.enlarge(ellipsoid.list_worst(responses))  # one for each joint
        moves = np.abs((responses * mistakes).sum(axis=1)) / uncertainties
        joint = int(moves.argmax())
        if moves[joint] > worst.moves:
            worst = _WorstMistake(float(moves[joint]), joint, mistakes[joint])
    return worst


def find_least_mistakes(
    rows: Rows, estimate: Estimate, suspects: int, prior: Prior | None = None
) -> tuple[LeastMistake, ...]:
    """Return the least mistake of each suspected term that the tests of causes find, the most moving first.

    Args:
        rows: N observations, with the scatter of the fit.
        estimate: estimate by joints alone, fitted to these measurements.
        suspects: number of causes that were tested; no mistake is found without tests.
        prior: prior of the fit, in units of sigma.
    """
    measurements = rows.measurements
    sigma, fitted = estimate.sigma, fitted_errors(measurements).terms
    determined_joints = [
        index
        for index, result in enumerate(estimate.joints)
        if result.status in ("identified", "uncertain") and result.standard_uncertainty
    ]
    if not (suspects and sigma and determined_joints):
        return ()
    tested = rows.select_evenly(MOST_TESTED_OBSERVATIONS).at(estimate.balanced)
    compliance = np.maximum(estimate.compliance, 0.0)
    fitted_term_names = {term.name for term in fitted}
    try:
        suspected = list_suspected_terms(measurements, tested)
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return ()
    terms = {term.name: term for term in suspected if term.name not in {*fitted_term_names, *_NO_MISTAKES}}
    stated_terms = {term.name: term for term in list_stated_terms(measurements)}
    stack = tested.stack([JOINTS, *fitted, *(stated_terms | terms).values()], compliance)
    triangle, visible = stack.triangle(), np.flatnonzero(~estimate.observability.null)
    compressed = estimate.compressed.compress_again(tested)
    responses = compressed.compute_responses(
        tested, [*terms.values()], compliance, np.flatnonzero(estimate.estimated), prior
    )
    fitted_names = (JOINTS.name, *fitted_term_names)
    # Joints that the readings do not show are not projected out.
    fitted_columns = np.concatenate([visible, *(stack.span[name] for name in fitted_term_names)])
    fitted_basis = orthonormal_basis(unit_columns(stack.flat[:, fitted_columns])[0])
    force = float(np.linalg.norm(tested.measurements.force, axis=1).max())
    uncertainty = np.array([joint.standard_uncertainty or np.inf for joint in estimate.joints])
    # A mistake moves a large set as it moves the part, whose tests are the tests of the set.
    common_uncertainty = measurements.common_uncertainty
    level = MISTAKE_LEVEL / suspects
    mistakes = []
    for name, term in terms.items():
        other_stated_terms = [stated for stated in stated_terms.values() if stated.name != name]
        triangle_given_statements = join_statements(triangle, other_stated_terms, measurements, sigma)
        triangle_given_statements.span[JOINTS.name] = visible
        # The test leaves out the observation that a mistake moves most: it may be a single wrong reading.
        triangle_given_statements.rows -= int(stack.read.max())
        prior_of_term = term.prior(common_uncertainty) if name in stated_terms else ()
        remaining = _Remaining.from_stack(stack, term, fitted_basis, force)
        ellipsoids = _list_ellipsoids(
            triangle_given_statements, term, fitted_names, sigma, level, prior_of_term
        )
        worst = _find_worst_mistake(
            ellipsoids, remaining, responses[name][determined_joints], uncertainty[determined_joints]
        )
        if worst.moves > 0.0:
            is_shift_and_turn = term.unit == "m, rad"
            turn_or_all = worst.unknowns[3:] if is_shift_and_turn else worst.unknowns
            mistakes.append(
                LeastMistake(
                    name=name,
                    unit=_UNITS[term.unit],
                    size=float(np.linalg.norm(turn_or_all)),
                    joint=rows.robot.joint_names[determined_joints[worst.joint]],
                    moves=worst.moves,
                    unknowns=tuple(worst.unknowns.tolist()),
                    is_assumed=name in common_uncertainty.assumed,
                )
            )
    return tuple(sorted(mistakes, key=lambda mistake: -mistake.moves))


def _list_ellipsoids(
    triangle: Triangle,
    term: Term,
    fitted: Sequence[str],
    sigma: float,
    level: float,
    stated_uncertainties: Sequence[float],
) -> Iterator[_Ellipsoid]:
    """Yield the sets of mistakes of a term that its tests do not find, as ellipsoids.

    First the mistakes that the F test of the term does not find; then, if the term has a statement, those
    that the statement does not contradict.

    Args:
        triangle: triangular factor R of the rows of all terms, given the statements about other terms.
        term: term that is tested.
        fitted: names of the terms that are fitted in any case.
        sigma: standard uncertainty of a coordinate of a reading [m].
        level: level of the F test.
        stated_uncertainties: standard uncertainties of the term's unknowns, which repeat; empty without a
            statement.
    """
    fitted_basis = orthonormal_basis(triangle.unit_columns(fitted))
    unit_vectors, length = unit_columns(triangle.matrix[:, triangle.span[term.name]])
    # What the fitted terms explain of a mistake no test can find.
    remaining = unit_vectors - fitted_basis @ (fitted_basis.T @ unit_vectors)
    _, singular_values, Vt = np.linalg.svd(remaining, full_matrices=False)
    is_tested = singular_values > DISTINCT
    tested_count = int(is_tested.sum())
    degrees_of_freedom = triangle.rows - fitted_basis.shape[1] - tested_count
    noncentrality = compute_noncentrality(tested_count, degrees_of_freedom, level)
    # A mistake is found if it moves the readings, in sigma, by more than the root of the non-centrality.
    motion = singular_values[is_tested, None] * Vt[is_tested] * length
    rows = motion / (sigma * np.sqrt(noncentrality))
    largest_mistake = _LARGEST.get(term.name)
    if largest_mistake is not None:  # bounds also the directions that no test looks at
        rows = np.vstack([rows, np.eye(len(length)) / (_BEYOND * largest_mistake)])
    if len(rows):
        yield _Ellipsoid(rows, term.nonnegative)
    if len(stated_uncertainties) and tested_count:
        uncertainties = np.resize(stated_uncertainties, len(length))
        _, singular_values, Vt = np.linalg.svd(remaining * (length * uncertainties), full_matrices=False)
        refuting_noncentrality = compute_noncentrality(tested_count, degrees_of_freedom, STATEMENT_LEVEL)
        variance = np.square(singular_values) + sigma**2
        weight = singular_values / np.sqrt(variance * refuting_noncentrality)
        yield _Ellipsoid(weight[:, None] * Vt / uncertainties, positive=False)


def compute_noncentrality(tested_count: int, degrees_of_freedom: int, level: float) -> float:
    """Return the non-centrality at which an F test has the power `POWER`; inf if there can be no test.

    Args:
        tested_count: degrees of freedom of the tested term.
        degrees_of_freedom: degrees of freedom of the residuals.
        level: significance level of the test.
    """
    if tested_count < 1 or degrees_of_freedom < 1:
        return np.inf
    critical_f = float(special.fdtri(tested_count, degrees_of_freedom, 1.0 - level))

    def compute_missing_power(noncentrality: float) -> float:
        """Return `POWER` minus the probability that the test finds a mistake of this non-centrality."""
        miss_probability = float(special.ncfdtr(tested_count, degrees_of_freedom, noncentrality, critical_f))
        return miss_probability - (1.0 - POWER)

    upper_limit = float(tested_count)
    while compute_missing_power(upper_limit) > 0.0:
        upper_limit *= 4.0
        if upper_limit > _LARGEST_NONCENTRALITY:
            return np.inf
    return float(brentq(compute_missing_power, 0.0, upper_limit, xtol=1e-6))


_UNITS: Final[dict[str, Unit]] = {"m": "m", "rad": "rad", "N": "N", "1": "1", "m, rad": "rad"}
"""Unit of the size of a mistake for each unit of unknowns."""
_SIZES: Final[dict[str, tuple[float, str]]] = {
    "rad": (1e3, "mrad"),
    "N": (1.0, "N"),
    "1": (1e2, "%"),
}
_MISTAKES: Final[dict[str, tuple[str, str]]] = {
    "load_point": (
        "an error of the load point up to {}",
        "check the load point to within {}, or hang the load on a second point in four postures",
    ),
    "constant_force": ("a constant force up to {} (axes of R0)", "read the load cell without load"),
    "load_zero": (
        "a zero error of the load cell up to {}",
        "read the load cell without load in two postures",
    ),
    "load_scale": ("loads that disagree by up to {}", "weigh the loads to within {}"),
    "play": ("play of up to {} in the gears", "read three postures again at half the load"),
    "shift": (
        "a shift of up to {} of all readings under load",
        "read a fixed target with and without the load",
    ),
    "turn": (
        "a turn of up to {} of all readings under load",
        "read two fixed targets with and without the load",
    ),
}
"""Words for each mistake, with a place for its size, and remedy, with a place for the size that moves a joint
by one standard uncertainty."""
_REMEDY_OF_ASSUMED: Final = (
    "measure the load point and state its uncertainty (`noise.load_point`), or hang the load on a second "
    "point in four postures"
)


def describe_unseen_mistakes(mistakes: Sequence[LeastMistake]) -> str | None:
    """Return a sentence on mistakes that no test finds and that would move a joint by more than `HARMLESS`.

    The sentence says what to do about these mistakes; None without such mistakes. Clean campaigns have such
    mistakes, too.
    """
    harmful = [mistake for mistake in mistakes if mistake.moves > HARMLESS]
    if not harmful:
        return None
    effects, remedies = [], []
    for mistake in harmful[:_MOST_NAMED]:
        words, remedy = _MISTAKES[mistake.name]
        if mistake.is_assumed:
            remedy = _REMEDY_OF_ASSUMED
        size_text = words.format(_format_size(mistake.size, mistake.unit))
        effects.append(
            f"{size_text}, which would change the compliance of {mistake.joint} by "
            f"{figure(mistake.moves, '.2g')} times its standard uncertainty"
        )
        size_of_one_uncertainty = mistake.size / mistake.moves
        remedies.append(remedy.format(_format_size(size_of_one_uncertainty, mistake.unit)))
    more = len(harmful) - _MOST_NAMED
    others_text = f" (and {more} more, in `causes`)" if more > 0 else ""
    effects_text, advice = "; nor ".join(effects), "; ".join(remedies)
    return f"The readings cannot show {effects_text}{others_text}. To show such mistakes, {advice}."


def _format_size(size: float, unit: str) -> str:
    """Return the size of a mistake as text for people, with its unit; `size` is in the SI unit `unit`."""
    if unit == "m":
        return length_text(size)
    factor, shown = _SIZES[unit]
    return f"{figure(factor * size, '.2g')} {shown}"
