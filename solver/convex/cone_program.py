"""The one door to cvxpy and Clarabel: a point near the optimum, for others to polish and certify."""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.equilibrated import Equilibrated

if TYPE_CHECKING:
    import cvxpy as cp  # takes two seconds, and is hardly ever needed: imported where it is

__all__ = ["clarabel_point"]


_CLARABEL = {
    "tol_gap_abs": 1e-13,
    "tol_gap_rel": 1e-13,
    "tol_feas": 1e-13,
    "tol_ktratio": 1e-9,
    "max_iter": 200,
}
"""Clarabel's default absolute gap of 1e-8 bounds the residual only by its square root."""


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


def clarabel_point(
    scaled: Equilibrated, rows: tuple[FloatArray, FloatArray] | None = None
) -> FloatArray | None:
    """Solve by Clarabel; any status but `optimal` is a failure, whatever values it leaves behind.

    Args:
        scaled: the problem.
        rows: (k, n) B and (k,) d of inequalities B x ≥ d besides the bounds.

    Returns:
        (n,) x, or None.
    """
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
