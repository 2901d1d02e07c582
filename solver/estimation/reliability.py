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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from scipy import special
from scipy.optimize import brentq

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.method import Prior
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.estimation.statements import list_stated_terms
from jointstiff.solver.estimation.suspects import MOST_TESTED_OBSERVATIONS, list_suspected_terms
from jointstiff.solver.estimation.term_tests import MISTAKE_LEVEL, STATEMENT_LEVEL, join_statements
from jointstiff.solver.estimation.triangle import (
    DISTINCT,
    Triangle,
    orthonormal_basis,
    solve_nonnegative,
    unit_columns,
)
from jointstiff.solver.mechanics.block import Term, fitted_errors, regressor_blocks
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
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
_NO_MISTAKES: Final = frozenset({"curved_springs"})
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
    """Mistakes eᵀ M e ≤ 1 that no test finds, with the largest of them."""

    rows: FloatArray  # (r, k) root of M: eᵀ M e = ‖rows e‖²
    positive: bool  # whether all unknowns are positive or zero

    def find_worst(self, response: FloatArray) -> FloatArray:
        """Return the mistake (k,) that moves a joint most, with the joint's response (k,) per unit."""
        unit, length = unit_columns(self.rows)
        U, s, Vt = np.linalg.svd(unit, full_matrices=False)
        seen = s > _SMALLEST_COLUMN
        goal = U[:, seen] @ ((Vt[seen] @ (response / length)) / s[seen])
        if not self.positive:
            worst = Vt[seen].T @ ((U[:, seen].T @ goal) / s[seen]) / length
            return np.asarray(worst / max(float(np.linalg.norm(goal)), np.finfo(float).tiny))
        found = [solve_nonnegative(self.rows, sign * goal)[0] for sign in (1.0, -1.0)]
        sizes = [float(np.linalg.norm(self.rows @ each)) for each in found]
        found = [each / size if size > 0.0 else each for each, size in zip(found, sizes, strict=True)]
        return max(found, key=lambda each: abs(float(response @ each)))


@dataclass(frozen=True, eq=False)
class _Remaining:
    """Motion by a term that joints and causes known before leave unexplained."""

    columns: FloatArray  # (N, m, k) for each observation, per unit of each unknown
    largest: float  # largest length of a mistake

    @classmethod
    def from_stack(
        cls, stack: Stack, term: Term, known: Sequence[str], visible: IndexArray, force: float
    ) -> _Remaining:
        """Project the known terms out of the columns of a term; of the joints only those that are seen.

        The largest force [N] bounds errors of forces.
        """
        span = stack.span | {JOINTS.name: visible}
        basis = orthonormal_basis(unit_columns(stack.flat[:, np.concatenate([span[n] for n in known])])[0])
        columns = stack.flat[:, span[term.name]]
        left = columns - basis @ (basis.T @ columns)
        largest = _LARGEST_FORCE * force if term.unit == "N" and force else _LARGEST.get(term.name, np.inf)
        return cls(left.reshape(*stack.rows.shape[:2], -1), largest)

    def enlarge(self, mistake: FloatArray) -> FloatArray:
        """Return a mistake (k,) enlarged to show without the observation it moves most, within limits."""
        squares = np.square(self.columns @ mistake).sum(axis=1)
        others = 1.0 - squares.max() / max(float(squares.sum()), np.finfo(float).tiny)
        length = float(np.linalg.norm(mistake))
        limit = self.largest / length if length > 0.0 else 1.0
        factor = min(1.0 / np.sqrt(max(others, np.finfo(float).eps)), limit)
        return np.asarray(factor * mistake)


def find_least_mistakes(
    robot: Robot, measurements: Measurements, estimate: Estimate, suspects: int, prior: Prior | None = None
) -> tuple[LeastMistake, ...]:
    """Return the least mistake of each suspected term that the tests of causes find, the most moving first.

    Args:
        robot: n joints.
        measurements: N observations, with the scatter of the fit.
        estimate: estimate by joints alone, fitted to these measurements.
        suspects: number of causes that were tested; no mistake is found without tests.
        prior: prior of the fit, in units of sigma.
    """
    sigma, fitted = estimate.sigma, fitted_errors(measurements).terms
    moving = [
        j
        for j, joint in enumerate(estimate.joints)
        if joint.status in ("identified", "uncertain") and joint.standard_uncertainty
    ]
    if not (suspects and sigma and moving):
        return ()
    part = measurements.select_evenly(MOST_TESTED_OBSERVATIONS)
    compliance, names = np.maximum(estimate.compliance, 0.0), {term.name for term in fitted}
    try:
        blocks = list(regressor_blocks(robot, part, estimate.balanced))
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return ()
    suspected = list_suspected_terms(measurements, blocks[0])
    terms = {term.name: term for term in suspected if term.name not in {*names, *_NO_MISTAKES}}
    stated = {term.name: term for term in list_stated_terms(measurements)}
    stack = Stack.from_blocks(blocks, [JOINTS, *fitted, *(stated | terms).values()], compliance)
    whole, visible = stack.triangle(), np.flatnonzero(~estimate.observability.null)
    responses = estimate.triangles.rebuild(blocks).compute_responses(
        blocks, [*terms.values()], compliance, np.flatnonzero(estimate.estimated), prior
    )
    known, force = (JOINTS.name, *names), float(np.linalg.norm(part.force, axis=1).max())
    uncertainty = [joint.standard_uncertainty or np.inf for joint in estimate.joints]
    # A mistake moves a large set as it moves the part, whose tests are the tests of the set.
    common, level, found = measurements.common_uncertainty, MISTAKE_LEVEL / suspects, []
    for name, term in terms.items():
        others = [other for each, other in stated.items() if each != name]
        given = join_statements(whole, others, measurements, sigma)
        given.span[JOINTS.name] = visible
        # The test leaves out the observation that a mistake moves most: it may be a single wrong reading.
        given.rows -= int(stack.read.max())
        prior_of_term = term.prior(common) if name in stated else ()
        remaining = _Remaining.from_stack(stack, term, known, visible, force)
        ellipsoids = [*_list_ellipsoids(given, term, known, sigma, level, prior_of_term)]
        worst = [
            (abs(float(response @ mistake)) / uncertainty[j], j, mistake)
            for j, response in enumerate(responses[name])
            if j in moving
            for mistake in (remaining.enlarge(each.find_worst(response)) for each in ellipsoids)
        ]
        moves, j, mistake = max(worst, key=lambda each: each[0], default=(0.0, 0, np.zeros(0)))
        if moves > 0.0:
            is_turn = term.unit == "m, rad"
            found.append(
                LeastMistake(
                    name=name,
                    unit=_UNITS[term.unit],
                    size=float(np.linalg.norm(mistake[3:] if is_turn else mistake)),
                    joint=robot.joint_names[j],
                    moves=moves,
                    unknowns=tuple(mistake.tolist()),
                    is_assumed=name in common.assumed,
                )
            )
    return tuple(sorted(found, key=lambda each: -each.moves))


def _list_ellipsoids(
    triangle: Triangle, term: Term, fitted: Sequence[str], sigma: float, level: float, stated: Sequence[float]
) -> Iterator[_Ellipsoid]:
    """Yield the mistakes that the F test of a term does not find, then those that keep to its statement.

    Args:
        triangle: all terms, given the statements about other terms.
        term: term that is tested.
        fitted: names of the terms that are fitted in any case.
        sigma: standard uncertainty of a coordinate of a reading [m].
        level: level of the F test.
        stated: standard uncertainties of the term's unknowns, which repeat; empty without a statement.
    """
    known = orthonormal_basis(triangle.unit_columns(fitted))
    unit, length = unit_columns(triangle.matrix[:, triangle.span[term.name]])
    _, s, Vt = np.linalg.svd(unit - known @ (known.T @ unit), full_matrices=False)
    tested = s > DISTINCT
    width = int(tested.sum())
    freedom = triangle.rows - known.shape[1] - width
    noncentrality = compute_noncentrality(width, freedom, level)
    rows = (s[tested, None] * Vt[tested]) * length / (sigma * np.sqrt(noncentrality))
    largest = _LARGEST.get(term.name)
    if largest is not None:
        rows = np.vstack([rows, np.eye(len(length)) / (_BEYOND * largest)])
    if len(rows):
        yield _Ellipsoid(rows, term.nonnegative)
    if len(stated) and width:
        size = np.resize(stated, len(length))
        _, s, Vt = np.linalg.svd((unit - known @ (known.T @ unit)) * (length * size), full_matrices=False)
        refuted = compute_noncentrality(width, freedom, STATEMENT_LEVEL)
        weight = s / np.sqrt((np.square(s) + sigma**2) * refuted)
        rows = weight[:, None] * Vt / size
        yield _Ellipsoid(rows, False)


def compute_noncentrality(width: int, freedom: int, level: float) -> float:
    """Return the non-centrality λ₀ at which an F test has the power `POWER`; inf where there is no test.

    Args:
        width: degrees of freedom of the tested term.
        freedom: degrees of freedom of the residuals.
        level: significance level of the test.
    """
    if width < 1 or freedom < 1:
        return np.inf
    critical = float(special.fdtri(width, freedom, 1.0 - level))

    def missing(noncentrality: float) -> float:
        """Return the probability that the test finds nothing, above that of a mistake that just shows."""
        return float(special.ncfdtr(width, freedom, noncentrality, critical)) - (1.0 - POWER)

    most = float(width)
    while missing(most) > 0.0:
        most *= 4.0
        if most > _LARGEST_NONCENTRALITY:
            return np.inf
    return float(brentq(missing, 0.0, most, xtol=1e-6))


_UNITS: Final[dict[str, Unit]] = {"m": "m", "rad": "rad", "N": "N", "1": "1", "m, rad": "rad"}
"""Unit of the size of a mistake for each unit of unknowns."""
_SIZES: Final[dict[str, tuple[float, str]]] = {
    "rad": (1e3, "mrad"),
    "N": (1.0, "N"),
    "1": (1e2, "%"),
}
_MISTAKES: Final[dict[str, tuple[str, str]]] = {
    "load_point": (
        "a load point up to {} off",
        "check the load point to {}, or hang the load on a second point in four postures",
    ),
    "constant_force": ("a constant force of up to {} (axes of R0)", "read the load cell without load"),
    "load_zero": ("a load cell's zero up to {} off", "read the load cell without load in two postures"),
    "load_scale": ("loads that disagree by up to {}", "weigh the loads to {}"),
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
    """Return a sentence on the mistakes that no test finds and that would move a joint beyond `HARMLESS`.

    The sentence says what to do about them; None without such mistakes. Clean campaigns have them, too.
    """
    harmful = [each for each in mistakes if each.moves > HARMLESS]
    if not harmful:
        return None
    effects, remedies = [], []
    for each in harmful[:_MOST_NAMED]:
        words, remedy = _MISTAKES[each.name]
        if each.is_assumed:
            remedy = _REMEDY_OF_ASSUMED
        effects.append(
            f"{words.format(_format_size(each.size, each.unit))}, which would move {each.joint} by "
            f"{figure(each.moves, '.2g')} times its standard uncertainty"
        )
        remedies.append(remedy.format(_format_size(each.size / each.moves, each.unit)))
    more = len(harmful) - _MOST_NAMED
    others = f" (and {more} more, in `causes`)" if more > 0 else ""
    advice = "; ".join(remedies)
    return f"The readings cannot show {'; nor '.join(effects)}{others}. To show such mistakes, {advice}."


def _format_size(size: float, unit: str) -> str:
    """Format the size of a mistake in SI units for people."""
    if unit == "m":
        return length_text(size)
    factor, shown = _SIZES[unit]
    return f"{figure(factor * size, '.2g')} {shown}"
