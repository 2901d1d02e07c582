"""Many small box-constrained least-squares problems at once, from their Gram matrices (method.md §5).

With G = AᵀA and h = Aᵀd the problem is ``minimise cᵀ G c − 2 hᵀ c subject to lower ≤ c ≤ upper``. The Gram
matrix squares the condition number, so it is asked only where it can answer to about nine digits; whoever
has the rows goes back to them for the rest. As in `solve_step` no answer leaves without a certificate,
and where pivoting does not find it, `solve_step` does, one problem at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, Support
from jointstiff.solver.convex.problem import (
    FREE,
    TOLERANCE,
    Bounds,
    IdentificationProblem,
    gradient_violation,
    held,
    pivot,
    snap,
    support_at,
)
from jointstiff.solver.convex.solution import solve_step
from jointstiff.solver.errors import SolverError

LEAST_EIGENVALUE = 1e-6
"""Largest condition of an equilibrated Gram matrix: rounding of 1e-16 in its entries grows to 1e-10 in the
answer."""

_ROUNDING = 64 * np.finfo(float).eps
"""Tolerance of a gradient, relative to the largest variable."""

MOST_PIVOTS = 8
"""Rounds of pivoting; nearly all problems settle in two or three."""


@dataclass(frozen=True, eq=False)
class BatchSolution:
    """The optima of K problems over n parameters."""

    compliance: FloatArray  #: (K, n) [rad/(N·m)]; NaN where not certified
    active: Support  #: (K, n) -1 where the lower bound holds it, 1 where the upper one does, else 0
    #: (K,) whether the optimality conditions hold to `TOLERANCE`. False means that the Gram matrix is
    #: singular or too ill-conditioned to answer.
    certified: BoolArray


@dataclass(frozen=True, eq=False)
class _Scaled:
    """K problems in equilibrated variables: A has a unit diagonal, the greatest entry of |b| is one."""

    A: FloatArray  # (K, n, n)
    b: FloatArray  # (K, n)
    lower: FloatArray  # (K, n)
    upper: FloatArray  # (K, n)

    def select(self, which: IndexArray) -> _Scaled:
        """Some of the problems."""
        return _Scaled(self.A[which], self.b[which], self.lower[which], self.upper[which])


def solve_batch(gram: FloatArray, moment: FloatArray, bounds: Bounds) -> BatchSolution:
    """Solve K problems ``minimise cᵀ G c − 2 hᵀ c subject to lower ≤ c ≤ upper``.

    Each problem is solved by itself, by operations of its own size: its numbers do not depend, to the
    last bit, on which others are in the batch.

    Args:
        gram: (K, n, n) G = AᵀA, symmetric, in any unit.
        moment: (K, n) h = Aᵀd.
        bounds: on the n parameters of every problem.

    Returns:
        The optima, certified from G and h.

    Raises:
        SolverError: if a number is not finite, or `solve_step` finds no certificate either.
    """
    if not (np.isfinite(gram).all() and np.isfinite(moment).all()):
        raise SolverError(
            "the Gram matrices overflow", remedy="check the units and magnitudes of the readings"
        )
    scaled, unit = _equilibrate(gram, moment, bounds)
    sound = np.flatnonzero(_well_conditioned(scaled.A))
    x, active = np.full(moment.shape, np.nan), np.zeros(moment.shape, dtype=np.int8)
    x[sound], active[sound] = _optima(scaled.select(sound))
    certified = np.zeros(len(moment), dtype=np.bool_)
    certified[sound] = True
    return BatchSolution(exactly_at_bounds(x * unit, active, bounds), active, certified)


def exactly_at_bounds(c: FloatArray, active: Support, bounds: Bounds) -> FloatArray:
    """Undo the rounding of a scaling, so that a zero is a zero and no compliance is below it.

    Args:
        c: (K, n) compliances [rad/(N·m)]; NaN stays NaN.
        active: (K, n) as in `BatchSolution`.
        bounds: on the n compliances.
    """
    c = np.where(active == FREE, c, held(active, bounds.lower, bounds.upper))
    return np.clip(c, bounds.lower, bounds.upper)


def _equilibrate(gram: FloatArray, moment: FloatArray, bounds: Bounds) -> tuple[_Scaled, FloatArray]:
    """The scaled problems, and the units (K, n) with c = unit · x; zero columns are left as they are."""
    diagonal = np.diagonal(gram, axis1=1, axis2=2)
    norms = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    b = moment / norms
    greatest = np.abs(b).max(axis=1, keepdims=True, initial=0.0)
    size = np.where(greatest > 0, greatest, 1.0)
    unit = size / norms
    A = gram / (norms[:, :, None] * norms[:, None, :])
    return _Scaled(A, b / size, bounds.lower / unit, bounds.upper / unit), unit


def _well_conditioned(A: FloatArray) -> BoolArray:
    """Return whether the eigenvalues of Gram matrices (K, n, n) are at least `LEAST_EIGENVALUE`.

    Their diagonals are one at most, so the mean of all eigenvalues but the least is n/(n − 1) at most, and
    ``det A ≤ λ (n/(n − 1))ⁿ⁻¹``: most need no eigenvalues.
    """
    n = A.shape[1]
    sound = np.asarray(np.linalg.det(A) * (1.0 - 1.0 / n) ** (n - 1) >= LEAST_EIGENVALUE)
    sound[~sound] = np.linalg.eigvalsh(A[~sound])[:, 0] >= LEAST_EIGENVALUE
    return sound


def _optima(problems: _Scaled) -> tuple[FloatArray, Support]:
    """Optimum and support of well-conditioned problems, by pivoting or else by the exact path."""
    x = snap(_pivoted(problems), problems.lower, problems.upper)
    # The conditions of Karush, Kuhn and Tucker at x, which keeps its bounds: the gradient vanishes off the
    # bounds, is positive at a lower bound and negative at an upper one. It is known to the rounding of the
    # terms that cancel in it.
    gradient = _gradient(problems, x)
    wrong = gradient_violation(x, gradient, problems.lower, problems.upper)
    rounding = _ROUNDING * np.maximum(1.0, np.abs(x).max(axis=1))
    holds: BoolArray = wrong.max(axis=1) <= TOLERANCE + rounding
    for k in np.flatnonzero(~holds):
        # Solve one problem by `solve_step`, stated by a triangle R with RᵀR = A and z with Rᵀz = b
        factor = np.linalg.cholesky(problems.A[k])
        z = np.linalg.solve(factor, problems.b[k])
        bounds = Bounds(problems.lower[k], problems.upper[k])
        x[k] = solve_step(IdentificationProblem(factor.T, z, bounds)).compliance
    return x, support_at(x, problems.lower, problems.upper)


def _pivoted(problems: _Scaled) -> FloatArray:
    """Return the polished points (K, n) of the supports that pivoting no longer changes; see `pivot`."""
    points, active = np.empty(problems.b.shape), np.zeros(problems.b.shape, dtype=np.int8)
    unsettled, part = np.arange(len(active)), problems
    for _ in range(MOST_PIVOTS):
        side = active[unsettled]
        points[unsettled] = x = _polish(part, side)
        moved = pivot(side, x, _gradient(part, x), part.lower, part.upper)
        changed = (moved != side).any(axis=1)
        unsettled = unsettled[changed]
        active[unsettled] = moved[changed]
        if not len(unsettled):
            return points
        part = problems.select(unsettled)
    points[unsettled] = _polish(part, active[unsettled])
    return points


def _polish(problems: _Scaled, active: Support) -> FloatArray:
    """Least squares on each support: rows and columns at a bound become those of the unit matrix.

    The eigenvalues of what is left lie between those of A, so no system is singular.
    """
    free = active == FREE
    at_bounds = held(active, problems.lower, problems.upper)
    system = np.where(free[:, :, None] & free[:, None, :], problems.A, np.eye(free.shape[1]))
    right = np.where(free, -_gradient(problems, at_bounds), at_bounds)
    x = np.linalg.solve(system, right[:, :, None])[:, :, 0]
    return np.where(free, x, at_bounds)


def _gradient(problems: _Scaled, x: FloatArray) -> FloatArray:
    """(K, n) A x − b, summed without BLAS, whose order of summation may depend on threads."""
    product: FloatArray = (problems.A * x[:, None, :]).sum(axis=2)
    return product - problems.b
