"""Solution of an identification problem: Clarabel proposes, exact algebra polishes, a certificate decides.

The steps are those of method.md §5. Columns and right-hand side are brought to unit norm, so that
neither units nor twelve decades between the joints matter. The program stated in `programs` is solved by
Clarabel; its answer tells which bounds and inequalities are active, and least squares on these are exact. The
point is accepted only if the optimality conditions hold in the data. Where an interior point blurs a tie, an
exact active set takes its place. By convexity it does not matter who proposed what is certified.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, Support
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.certificate import (
    Certificate,
    Proposer,
    active_rows,
    certify_scaled,
    exact_support,
    multipliers_of,
    polish,
    tight_rows,
)
from jointstiff.solver.convex.problem import (
    FREE,
    LOWER,
    TOLERANCE,
    UPPER,
    IdentificationProblem,
    Scaled,
    held,
    pivot,
    snap,
    support_at,
)
from jointstiff.solver.errors import SolverError

_NO_DIRECTION = 1e-13
"""Relative singular value that counts as zero."""

_TOUCHES = 1e-6
"""Largest slack of an interior point at a row that is active at the optimum."""

MOST_PIVOTS = 8
"""Maximum rounds of pivoting; starting from Clarabel's support, one round confirms it."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum of an `IdentificationProblem`."""

    compliance: FloatArray  #: (n,) [rad/(N·m)]
    active: Support  #: (n,) -1 where the lower bound holds it, 1 where the upper one does, else 0
    certificate: Certificate  #: evidence that it is the optimum
    #: (k,) inequalities that hold with equality up to rounding; None where the problem has none
    tight: BoolArray | None = None

    @property
    def constrained(self) -> bool:
        """Return whether a constraint holds with equality."""
        return bool(self.active.any()) or (self.tight is not None and bool(self.tight.any()))


def solve(problem: IdentificationProblem) -> Solution:
    """Solve a problem by Clarabel, polish its answer exactly and prove it.

    Returns:
        The optimum with its certificate. Where R is rank deficient the fitted R c is unique, but c
        is one of many; see `solver.observability`.

    Raises:
        SolverError: if no candidate satisfies the optimality conditions.
    """
    scaled = Scaled.of(problem)
    if len(scaled.d):
        return _first_certified(problem, scaled, (_rows_from_clarabel, _rows_from_least_distance))
    return _first_certified(problem, scaled, (_from_clarabel, _from_active_set))


def solve_step(problem: IdentificationProblem) -> Solution:
    """Solve a problem that is one step of many, proposing its support by pivoting from plain least squares.

    It has the certificate that `solve` gives, which takes over where pivoting finds none.

    Raises:
        SolverError: as `solve`.
    """
    scaled = Scaled.of(problem)
    if len(scaled.d):
        return _first_certified(problem, scaled, (_rows_from_least_distance, _rows_from_clarabel))
    return _first_certified(problem, scaled, (_from_pivoting, _from_clarabel, _from_active_set))


def huber_point(
    A: FloatArray, d: FloatArray, S: FloatArray, t: FloatArray, squared: IdentificationProblem
) -> FloatArray | None:
    """Solve Huber's problem by Clarabel, to its tolerance.

    Args:
        A: (K, 3, n) rows of K targets, in units of the threshold.
        d: (K, 3).
        S: (q, n) rows whose loss stays squared.
        t: (q,).
        squared: the same problem with the squared loss; its constraints hold, its columns scale.

    Returns:
        (n,) compliances [rad/(N·m)]; None if Clarabel fails.
    """
    scaled = Scaled.of(squared)
    x = programs.huber(A * scaled.unit, d, S * scaled.unit, t, scaled)
    return None if x is None else snap(x, scaled.lower, scaled.upper) * scaled.unit


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A point (n,) in equilibrated variables, and the algorithm that found its support."""

    x: FloatArray
    solved_by: Proposer


_Finder = Callable[[Scaled], list[_Candidate]]


def _first_certified(
    problem: IdentificationProblem, scaled: Scaled, finders: tuple[_Finder, ...]
) -> Solution:
    certificate = Certificate(np.inf, np.inf, 0.0, np.zeros(0), "clarabel")
    for find in finders:
        for candidate in find(scaled):
            x = snap(candidate.x, scaled.lower, scaled.upper)
            certificate = certify_scaled(scaled, x, candidate.solved_by)
            if certificate.is_optimal():
                # Solution in rad/(N·m), with the bounds exactly as they were asked for
                bounds, active = problem.bounds, support_at(x, scaled.lower, scaled.upper)
                compliance = np.where(
                    active == FREE, x * scaled.unit, held(active, bounds.lower, bounds.upper)
                )
                tight = tight_rows(scaled, x)[-len(scaled.d) :] if len(scaled.d) else None
                return Solution(np.clip(compliance, bounds.lower, bounds.upper), active, certificate, tight)
    raise SolverError(
        f"no solution satisfies the optimality conditions to {TOLERANCE:g} (primal "
        f"{certificate.primal:.1e}, dual {certificate.dual:.1e})"
    )


def _from_clarabel(scaled: Scaled) -> list[_Candidate]:
    """Put a parameter at a bound where its multiplier exceeds its slack."""
    near = programs.least_squares(scaled)
    return [] if near is None else _within_bounds(scaled, near)


def _within_bounds(scaled: Scaled, near: FloatArray) -> list[_Candidate]:
    gradient = scaled.gradient(near)
    active = np.zeros(len(near), dtype=np.int8)
    active[gradient > near - scaled.lower] = LOWER
    active[-gradient > scaled.upper - near] = UPPER
    # Where the optimum is not unique, the shortest point may violate a bound that Clarabel's point keeps.
    points = (_pivoted(scaled, active), _polished(scaled, active, near))
    return [_Candidate(x, "clarabel") for x in points]


def _from_active_set(scaled: Scaled) -> list[_Candidate]:
    return [_Candidate(_polished(scaled, exact_support(scaled)), "active_set")]


def _from_pivoting(scaled: Scaled) -> list[_Candidate]:
    x = _pivoted(scaled, np.zeros(len(scaled.lower), dtype=np.int8))
    inside = bool(((x > scaled.lower) & (x < scaled.upper)).all())
    return [_Candidate(x, "least_squares" if inside else "pivoting")]


def _pivoted(scaled: Scaled, active: Support) -> FloatArray:
    """Return the polished point of a support that pivoting no longer changes, or of its last round."""
    x = _polished(scaled, active)
    for _ in range(MOST_PIVOTS):
        moved = pivot(active, x, scaled.gradient(x), scaled.lower, scaled.upper)
        if (moved == active).all():
            break
        active = moved
        x = _polished(scaled, active)
    return x


def _polished(scaled: Scaled, active: Support, near: FloatArray | None = None) -> FloatArray:
    """Solve least squares on the support, the others at their bounds; nearest to `near`, or shortest."""
    free = active == FREE
    x = held(active, scaled.lower, scaled.upper)
    if near is not None:
        x[free] = near[free]
    if free.any():
        rhs = scaled.b - scaled.A @ x
        x[free] += np.linalg.lstsq(scaled.A[:, free], rhs, rcond=_NO_DIRECTION)[0]
    return x


def _rows_from_clarabel(scaled: Scaled) -> list[_Candidate]:
    """Take the rows with a multiplier among those that Clarabel's point all but touches."""
    near = programs.least_squares(scaled)
    if near is None:
        return []
    active = multipliers_of(scaled, near, _TOUCHES) > 0
    if not active[-len(scaled.d) :].any():  # the inequalities have slack: the answer is that without them
        return _within_bounds(scaled, near)
    return _on_rows(scaled, active, near, "clarabel")


def _rows_from_least_distance(scaled: Scaled) -> list[_Candidate]:
    active = active_rows(scaled)
    if active is None:
        return []
    return _on_rows(scaled, active, np.zeros(len(scaled.lower)), "least_distance")


def _on_rows(scaled: Scaled, active: BoolArray, near: FloatArray, name: Proposer) -> list[_Candidate]:
    """Polish on the active rows, then also on those left out that hold up to rounding, and pull.

    The second comes first; it asks too much where a tiny variable holds a large one to its rounding.
    """
    x = polish(scaled, active, near)
    return [_Candidate(each, name) for each in (polish(scaled, multipliers_of(scaled, x) > 0, x), x)]
