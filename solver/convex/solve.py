"""The one door to the solver: cvxpy states the problem, Clarabel solves it, exact algebra polishes it.

The recipe is METHOD.md §5. Columns and right-hand side are brought to unit norm, so that neither the
units nor twelve decades between the joints matter. A quadratic program's answer is exact once its
*support* (the parameters away from their bounds) is known: least squares on the support, accepted only
if the optimality conditions hold in the data. Supports are proposed cheapest first, and the first one
with a certificate is the answer, by convexity, whoever proposed it: least squares where no bound is
active, then pivoting, then Clarabel, then an exact active set. Stating a problem in cvxpy, compiled or
not, costs several times what the rest of an identification does; so what pivoting settles never gets there.
Where linear inequalities hold besides, the same goes for the rows that are tight: none of the inequalities,
then those of an exact least-distance problem, then Clarabel's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, Support
from jointstiff.solver.convex.certificate import (
    CERTIFICATE_TOLERANCE,
    Certificate,
    SupportFinder,
    certify_within_bounds,
)
from jointstiff.solver.convex.cone_program import clarabel_point
from jointstiff.solver.convex.equilibrated import Equilibrated
from jointstiff.solver.convex.least_distance import (
    Inequality,
    active_rows,
    conditions,
    multipliers_of,
    polish,
)
from jointstiff.solver.convex.problem import IdentificationProblem, Inequalities
from jointstiff.solver.errors import SolverError

__all__ = ["Solution", "solve"]


_NO_DIRECTION = 1e-13
"""Relative singular value that is a zero up to rounding."""

_FREE, _LOWER, _UPPER = 0, -1, 1

_TOUCHES = 1e-6
"""Slack at which an interior point may stand from a row that is tight at the optimum."""

_PIVOTS = 8
"""Rounds of pivoting: each costs a tenth of a call of cvxpy."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum of an `IdentificationProblem`.

    Attributes:
        compliance: (n,) [rad/(N·m)].
        active: (n,) -1 where the lower bound holds it, 1 where the upper one does, else 0.
        certificate: evidence that it is the optimum.
        tight: (k,) inequalities that hold with equality up to rounding; None where the problem has none.
    """

    compliance: FloatArray
    active: Support
    certificate: Certificate
    tight: BoolArray | None = None

    @property
    def constrained(self) -> bool:
        """Whether a constraint holds with equality."""
        return bool(self.active.any()) or (self.tight is not None and bool(self.tight.any()))


def solve(problem: IdentificationProblem) -> Solution:
    """Solve a problem exactly and prove it.

    Args:
        problem: finite, with non-zero columns.

    Returns:
        The optimum with its certificate. Where R is rank deficient the fitted R c is unique, but c
        is one of many; see `jointstiff.solver.observability.identifiability`.

    Raises:
        SolverError: if no candidate satisfies the optimality conditions.
    """
    scaled = Equilibrated.of(problem)
    within_bounds = _solve_within_bounds(problem, scaled)
    if problem.inequalities is None:
        return within_bounds
    return _solve_with_inequalities(problem, problem.inequalities, scaled, within_bounds)


def _solve_within_bounds(problem: IdentificationProblem, scaled: Equilibrated) -> Solution:
    """The optimum as if there were no inequalities besides the bounds."""
    finders: tuple[tuple[SupportFinder, Callable[[Equilibrated], Support | None]], ...] = (
        ("least_squares", _support_without_bounds),
        ("pivoting", _support_from_pivoting),
        ("clarabel", _support_from_clarabel),
        ("active_set", _support_from_active_set),
    )
    for name, find in finders:
        active = find(scaled)
        if active is None:
            continue
        x = _snap(scaled, _polish(scaled, active))
        certificate = certify_within_bounds(scaled, x, name)
        if certificate.holds:
            return _unscaled(problem, scaled, x, certificate)
    raise _not_certified(certificate)


def _not_certified(certificate: Certificate) -> SolverError:
    return SolverError(
        f"no solution satisfies the optimality conditions to {CERTIFICATE_TOLERANCE:g} "
        f"(primal {certificate.primal:.1e}, dual {certificate.dual:.1e})",
        remedy="report this with the data",
    )


def _solve_with_inequalities(
    problem: IdentificationProblem,
    inequalities: Inequalities,
    scaled: Equilibrated,
    within_bounds: Solution,
) -> Solution:
    """The optimum under the inequalities, given that without them."""
    slack = inequalities.matrix @ within_bounds.compliance - inequalities.least
    if (slack >= 0).all():
        return replace(within_bounds, tight=slack <= 0)
    general = scaled.rows(inequalities)
    start = within_bounds.compliance / scaled.unit
    finders: tuple[tuple[SupportFinder, Callable[[], tuple[BoolArray, FloatArray] | None]], ...]
    finders = (
        ("least_distance", lambda: _rows_from_least_distance(general, start)),
        ("clarabel", lambda: _rows_from_clarabel(scaled, general)),
    )
    certificate = Certificate(np.inf, np.inf, 0.0, "least_distance")
    for name, find in finders:
        found = find()
        if found is None:
            continue
        near = polish(general, *found)
        # Rows that the proposal left out but that hold up to rounding, and pull, are put on it exactly;
        # unless that asks too much, as where a tiny variable holds a large one to its own rounding.
        for x in (polish(general, multipliers_of(general, near) > 0, near), near):
            x = _snap(scaled, x)
            certificate = Certificate(*conditions(general, x), 0.0, name)
            if certificate.holds:
                tight = general.tight(x)[-len(slack) :]
                return replace(_unscaled(problem, scaled, x, certificate), tight=tight)
    raise _not_certified(certificate)


def _rows_from_least_distance(general: Inequality, start: FloatArray) -> tuple[BoolArray, FloatArray] | None:
    active = active_rows(general)
    return None if active is None else (active, start)


def _rows_from_clarabel(scaled: Equilibrated, general: Inequality) -> tuple[BoolArray, FloatArray] | None:
    """The rows with a multiplier among those that Clarabel's point all but touches."""
    k = len(general.d) - int(np.isfinite(scaled.lower).sum() + np.isfinite(scaled.upper).sum())
    x = clarabel_point(scaled, (general.B[-k:], general.d[-k:]))
    return None if x is None else (multipliers_of(general, x, _TOUCHES) > 0, x)


def _snap(scaled: Equilibrated, x: FloatArray) -> FloatArray:
    """Put on its bound what is beyond it, or not off it by more than rounding. Certified is the outcome."""
    x = np.where(x - scaled.lower <= CERTIFICATE_TOLERANCE, scaled.lower, x)
    return np.where(scaled.upper - x <= CERTIFICATE_TOLERANCE, scaled.upper, x)


def _unscaled(
    problem: IdentificationProblem, scaled: Equilibrated, x: FloatArray, certificate: Certificate
) -> Solution:
    """The solution in rad/(N·m), with the bounds exactly as they were asked for."""
    bounds = problem.bounds
    below, above = x == scaled.lower, x == scaled.upper
    active = np.where(below, _LOWER, np.where(above, _UPPER, _FREE)).astype(np.int8)
    compliance = np.where(below, bounds.lower, np.where(above, bounds.upper, x * scaled.unit))
    return Solution(np.clip(compliance, bounds.lower, bounds.upper), active, certificate)


def _polish(scaled: Equilibrated, active: Support) -> FloatArray:
    """Least squares on the support, the other parameters exactly at their bounds."""
    x = np.where(active == _LOWER, scaled.lower, np.where(active == _UPPER, scaled.upper, 0.0))
    free = active == _FREE
    if free.any():
        rhs = scaled.b - scaled.A @ x
        x[free] = np.linalg.lstsq(scaled.A[:, free], rhs, rcond=_NO_DIRECTION)[0]
    return x


def _support_without_bounds(scaled: Equilibrated) -> Support:
    """Where plain least squares respects the bounds it is the optimum."""
    return np.zeros(len(scaled.lower), dtype=np.int8)


def _support_from_pivoting(scaled: Equilibrated) -> Support:
    """Block principal pivoting (Portugal, Júdice & Vicente 1994), a few rounds of it.

    All parameters that break their condition change sides at once: a free one outside its bounds goes to
    the bound, one at a bound with a multiplier of the wrong sign is freed. It mostly ends in two or three
    rounds at the optimum, and may cycle, which the certificate finds out.
    """
    active = np.zeros(len(scaled.lower), dtype=np.int8)
    for _ in range(_PIVOTS):
        x = _polish(scaled, active)
        gradient = scaled.A.T @ (scaled.A @ x - scaled.b)
        pull = np.where(active == _LOWER, gradient, np.where(active == _UPPER, -gradient, 1.0))
        moved = np.where(pull < 0, _FREE, active)
        moved = np.where(x < scaled.lower, _LOWER, np.where(x > scaled.upper, _UPPER, moved))
        if (moved == active).all():
            break
        active = moved.astype(np.int8)
    return active


def _support_from_clarabel(scaled: Equilibrated) -> Support | None:
    """A parameter is at a bound where its multiplier exceeds its slack; None if Clarabel fails."""
    x = clarabel_point(scaled)
    if x is None:
        return None
    gradient = scaled.A.T @ (scaled.A @ x - scaled.b)
    active = np.zeros(len(x), dtype=np.int8)
    active[gradient > x - scaled.lower] = _LOWER
    active[-gradient > scaled.upper - x] = _UPPER
    return active


def _support_from_active_set(scaled: Equilibrated) -> Support:
    """Exact active-set least squares (Stark & Parker's BVLS), for ties that an interior point blurs."""
    from scipy.optimize import lsq_linear

    outcome = lsq_linear(scaled.A, scaled.b, bounds=(scaled.lower, scaled.upper), method="bvls", tol=1e-15)
    return np.asarray(outcome.active_mask, dtype=np.int8)
