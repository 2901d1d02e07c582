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

import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from solver.exceptions import SolverError
from solver.least_distance import Inequality, active_rows, conditions, multipliers_of, polish
from solver.problem import IdentificationProblem, Inequalities

if TYPE_CHECKING:
    import cvxpy as cp  # takes two seconds, and is hardly ever needed: imported where it is

__all__ = ["CERTIFICATE_TOLERANCE", "Certificate", "Solution", "solve"]

FloatArray = npt.NDArray[np.float64]
Support = npt.NDArray[np.int8]
SupportFinder = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]

CERTIFICATE_TOLERANCE = 1e-12
"""Greatest relative violation of an optimality condition that is taken for rounding."""

_ROUNDING = 64 * np.finfo(float).eps
"""Of a gradient, relative to the largest variable."""

_NO_DIRECTION = 1e-13
"""Relative singular value that is a zero up to rounding."""

_CLARABEL = {
    "tol_gap_abs": 1e-13,
    "tol_gap_rel": 1e-13,
    "tol_feas": 1e-13,
    "tol_ktratio": 1e-9,
    "max_iter": 200,
}
"""Clarabel's default absolute gap of 1e-8 bounds the residual only by its square root."""

_FREE, _LOWER, _UPPER = 0, -1, 1

_TOUCHES = 1e-6
"""Slack at which an interior point may stand from a row that is tight at the optimum."""

_PIVOTS = 8
"""Rounds of pivoting: each costs a tenth of a call of cvxpy."""


@dataclass(frozen=True)
class Certificate:
    """Violation of the optimality conditions, dimensionless, from the data alone.

    Attributes:
        primal: greatest violation of a bound, in equilibrated variables.
        dual: greatest gradient of the wrong sign at a bound, or of any sign off the bounds, beyond
            rounding; a gradient is the cosine between a column and the residual, times ‖residual‖/‖z‖.
        complementarity: greatest min(multiplier, slack), beyond rounding.
        solved_by: what found the support.
    """

    primal: float
    dual: float
    complementarity: float
    solved_by: SupportFinder

    @property
    def holds(self) -> bool:
        """Whether all violations are rounding."""
        return max(self.primal, self.dual, self.complementarity) <= CERTIFICATE_TOLERANCE


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
    tight: npt.NDArray[np.bool_] | None = None

    @property
    def constrained(self) -> bool:
        """Whether a constraint holds with equality."""
        return bool(self.active.any()) or (self.tight is not None and bool(self.tight.any()))


@dataclass(frozen=True, eq=False)
class _Scaled:
    """The problem in equilibrated variables: unit columns, unit right-hand side."""

    A: FloatArray
    b: FloatArray
    lower: FloatArray
    upper: FloatArray


def solve(problem: IdentificationProblem) -> Solution:
    """Solve a problem exactly and prove it.

    Args:
        problem: finite, with non-zero columns.

    Returns:
        The optimum with its certificate. Where R is rank deficient the fitted R c is unique, but c
        is one of many; see `solver.identifiability`.

    Raises:
        SolverError: if no candidate satisfies the optimality conditions.
    """
    column_norms = problem.column_norms
    size = float(np.linalg.norm(problem.z)) or 1.0
    unit = size / column_norms
    scaled = _Scaled(
        problem.R / column_norms,
        problem.z / size,
        problem.bounds.lower / unit,
        problem.bounds.upper / unit,
    )
    within_bounds = _solve_within_bounds(problem, scaled, unit)
    if problem.inequalities is None:
        return within_bounds
    return _solve_with_inequalities(problem, problem.inequalities, scaled, unit, within_bounds)


def _solve_within_bounds(problem: IdentificationProblem, scaled: _Scaled, unit: FloatArray) -> Solution:
    """The optimum as if there were no inequalities besides the bounds."""
    finders: tuple[tuple[SupportFinder, Callable[[_Scaled], Support | None]], ...] = (
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
        certificate = _certify(scaled, x, name)
        if certificate.holds:
            return _unscaled(problem, x, unit, certificate)
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
    scaled: _Scaled,
    unit: FloatArray,
    within_bounds: Solution,
) -> Solution:
    """The optimum under the inequalities, given that without them."""
    slack = inequalities.matrix @ within_bounds.compliance - inequalities.least
    if (slack >= 0).all():
        return replace(within_bounds, tight=slack <= 0)
    general = _as_rows(scaled, inequalities.matrix * unit, inequalities.least)
    start = within_bounds.compliance / unit
    finders: tuple[tuple[SupportFinder, Callable[[], tuple[npt.NDArray[np.bool_], FloatArray] | None]], ...]
    finders = (
        ("least_distance", lambda: _rows_from_least_distance(general, start)),
        ("clarabel", lambda: _rows_from_clarabel(scaled, general)),
    )
    certificate = Certificate(np.inf, np.inf, 0.0, "least_distance")
    for name, find in finders:
        found = find()
        if found is None:
            continue
        x = polish(general, *found)
        # Rows that the proposal left out but that hold up to rounding, and pull, are put on it exactly.
        x = _snap(scaled, polish(general, multipliers_of(general, x) > 0, x))
        primal, dual = conditions(general, x)
        certificate = Certificate(primal, dual, 0.0, name)
        if certificate.holds:
            tight = general.tight(x)[-len(slack) :]
            return replace(_unscaled(problem, x, unit, certificate), tight=tight)
    raise _not_certified(certificate)


def _as_rows(scaled: _Scaled, matrix: FloatArray, least: FloatArray) -> Inequality:
    """Bounds and inequalities as rows of unit norm, the inequalities last."""
    below, above = np.isfinite(scaled.lower), np.isfinite(scaled.upper)
    identity = np.eye(len(scaled.lower))
    norms = np.linalg.norm(matrix, axis=1)
    return Inequality(
        scaled.A,
        scaled.b,
        np.vstack([identity[below], -identity[above], matrix / norms[:, None]]),
        np.concatenate([scaled.lower[below], -scaled.upper[above], least / norms]),
    )


def _rows_from_least_distance(
    general: Inequality, start: FloatArray
) -> tuple[npt.NDArray[np.bool_], FloatArray] | None:
    active = active_rows(general)
    return None if active is None else (active, start)


def _rows_from_clarabel(
    scaled: _Scaled, general: Inequality
) -> tuple[npt.NDArray[np.bool_], FloatArray] | None:
    """The rows with a multiplier among those that Clarabel's point all but touches."""
    k = len(general.d) - int(np.isfinite(scaled.lower).sum() + np.isfinite(scaled.upper).sum())
    x = _clarabel(scaled, (general.B[-k:], general.d[-k:]))
    return None if x is None else (multipliers_of(general, x, _TOUCHES) > 0, x)


def _snap(scaled: _Scaled, x: FloatArray) -> FloatArray:
    """Put on its bound what is beyond it, or not off it by more than rounding. Certified is the outcome."""
    x = np.where(x - scaled.lower <= CERTIFICATE_TOLERANCE, scaled.lower, x)
    return np.where(scaled.upper - x <= CERTIFICATE_TOLERANCE, scaled.upper, x)


def _unscaled(
    problem: IdentificationProblem, x: FloatArray, unit: FloatArray, certificate: Certificate
) -> Solution:
    """The solution in rad/(N·m), with the bounds exactly as they were asked for."""
    bounds = problem.bounds
    below, above = x == bounds.lower / unit, x == bounds.upper / unit
    active = np.where(below, _LOWER, np.where(above, _UPPER, _FREE)).astype(np.int8)
    compliance = np.where(below, bounds.lower, np.where(above, bounds.upper, x * unit))
    return Solution(np.clip(compliance, bounds.lower, bounds.upper), active, certificate)


def _polish(scaled: _Scaled, active: Support) -> FloatArray:
    """Least squares on the support, the other parameters exactly at their bounds."""
    x = np.where(active == _LOWER, scaled.lower, np.where(active == _UPPER, scaled.upper, 0.0))
    free = active == _FREE
    if free.any():
        rhs = scaled.b - scaled.A @ x
        x[free] = np.linalg.lstsq(scaled.A[:, free], rhs, rcond=_NO_DIRECTION)[0]
    return x


def _certify(scaled: _Scaled, x: FloatArray, solved_by: SupportFinder) -> Certificate:
    """Evaluate the conditions of Karush, Kuhn and Tucker at x, whatever led to it."""
    gradient = scaled.A.T @ (scaled.A @ x - scaled.b)
    below, above = x - scaled.lower, scaled.upper - x
    # The multiplier of a lower bound is the positive part of the gradient, of an upper the negative.
    wrong = np.where(below <= 0, -gradient, np.where(above <= 0, gradient, np.abs(gradient)))
    product = np.maximum(
        np.minimum(np.maximum(gradient, 0.0), below), np.minimum(np.maximum(-gradient, 0.0), above)
    )
    # A gradient is known to the rounding of the terms that cancel in it.
    rounding = _ROUNDING * max(1.0, float(np.abs(x).max()))
    return Certificate(
        primal=max(0.0, float(-np.minimum(below, above).min())),
        dual=max(0.0, float(wrong.max()) - rounding),
        complementarity=max(0.0, float(product.max()) - rounding),
        solved_by=solved_by,
    )


def _support_without_bounds(scaled: _Scaled) -> Support:
    """Where plain least squares respects the bounds it is the optimum."""
    return np.zeros(len(scaled.lower), dtype=np.int8)


def _support_from_pivoting(scaled: _Scaled) -> Support:
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


def _support_from_clarabel(scaled: _Scaled) -> Support | None:
    """A parameter is at a bound where its multiplier exceeds its slack; None if Clarabel fails."""
    x = _clarabel(scaled)
    if x is None:
        return None
    gradient = scaled.A.T @ (scaled.A @ x - scaled.b)
    active = np.zeros(len(x), dtype=np.int8)
    active[gradient > x - scaled.lower] = _LOWER
    active[-gradient > scaled.upper - x] = _UPPER
    return active


def _support_from_active_set(scaled: _Scaled) -> Support:
    """Exact active-set least squares (Stark & Parker's BVLS), for ties that an interior point blurs."""
    from scipy.optimize import lsq_linear

    outcome = lsq_linear(scaled.A, scaled.b, bounds=(scaled.lower, scaled.upper), method="bvls", tol=1e-15)
    return np.asarray(outcome.active_mask, dtype=np.int8)


@dataclass(frozen=True, eq=False)
class _Parametrised:
    """The problem for one size, compiled once by cvxpy; `lock` because a cvxpy problem is mutable."""

    problem: cp.Problem
    x: cp.Variable
    A: cp.Parameter
    b: cp.Parameter
    below: tuple[cp.Parameter, cp.Parameter]
    above: tuple[cp.Parameter, cp.Parameter]
    rows: tuple[cp.Parameter, cp.Parameter] | None
    lock: threading.Lock


@lru_cache(maxsize=64)
def _parametrised(rows: int, columns: int, inequalities: int) -> _Parametrised:
    import cvxpy as cp

    x, r = cp.Variable(columns), cp.Variable(rows)
    A, b = cp.Parameter((rows, columns)), cp.Parameter(rows)
    # A bound that does not exist has selector 0 and limit 0: 0 x ≥ 0 always holds.
    below = cp.Parameter(columns, nonneg=True), cp.Parameter(columns)
    above = cp.Parameter(columns, nonneg=True), cp.Parameter(columns)
    constraints = [
        r == A @ x - b,
        cp.multiply(below[0], x) >= below[1],
        cp.multiply(above[0], x) <= above[1],
    ]
    general = None
    if inequalities:
        general = cp.Parameter((inequalities, columns)), cp.Parameter(inequalities)
        constraints.append(general[0] @ x >= general[1])
    problem = cp.Problem(cp.Minimize(cp.sum_squares(r)), constraints)
    return _Parametrised(problem, x, A, b, below, above, general, threading.Lock())


def _clarabel(scaled: _Scaled, rows: tuple[FloatArray, FloatArray] | None = None) -> FloatArray | None:
    """Solve by Clarabel; any status but `optimal` is a failure, whatever values it leaves behind."""
    import cvxpy as cp

    compiled = _parametrised(*scaled.A.shape, 0 if rows is None else len(rows[1]))
    with compiled.lock, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate answer is recognised by its status below
        compiled.A.value, compiled.b.value = scaled.A, scaled.b
        if compiled.rows is not None and rows is not None:
            compiled.rows[0].value, compiled.rows[1].value = rows
        for (selector, limit), bound in (
            (compiled.below, scaled.lower),
            (compiled.above, scaled.upper),
        ):
            exists = np.isfinite(bound)
            selector.value, limit.value = exists.astype(float), np.where(exists, bound, 0.0)
        try:
            compiled.problem.solve(solver=cp.CLARABEL, **_CLARABEL)
        except cp.SolverError:
            return None
        status, value = compiled.problem.status, compiled.x.value
    if status != cp.OPTIMAL or value is None or not np.isfinite(value).all():
        return None
    return np.asarray(value, dtype=np.float64)


def certify(problem: IdentificationProblem, compliance: FloatArray, solved_by: SupportFinder) -> Certificate:
    """Evaluate the optimality conditions of a problem at compliances found elsewhere.

    Args:
        problem: as for `solve`.
        compliance: (n,) [rad/(N·m)].
        solved_by: what found them.
    """
    column_norms = problem.column_norms
    size = float(np.linalg.norm(problem.z)) or 1.0
    unit = size / column_norms
    scaled = _Scaled(
        problem.R / column_norms,
        problem.z / size,
        problem.bounds.lower / unit,
        problem.bounds.upper / unit,
    )
    if problem.inequalities is None:
        return _certify(scaled, compliance / unit, solved_by)
    inequalities = problem.inequalities
    general = _as_rows(scaled, inequalities.matrix * unit, inequalities.least)
    return Certificate(*conditions(general, compliance / unit), 0.0, solved_by)
