"""Convex programs of designs whose criterion is not smooth, stated in cvxpy (docs/method.md §10).

    maximise t  subject to  M(w) − t diag(V⁻², 0) ⪰ 0                worst combination of parameters (E)
    minimise t  subject to  tr(B_rᵀ M(w)⁻¹ B_r) ≤ t for all r         worst place (G), W_r = B_r B_rᵀ

with M(w) = M0 + Σ w_i K_i, Σ w = 1 and 0 ≤ w ≤ limit. Weights and dual variables are near an optimum, to
Clarabel's tolerance: the certificate of a design is computed from the data.
"""

from __future__ import annotations

import warnings
from contextlib import suppress
from typing import TYPE_CHECKING, Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.programs import COMPILING
from jointstiff.solver.errors import SolverError

if TYPE_CHECKING:
    import cvxpy as cp  # takes a second to import: done where a program is stated

_TOLERANCES: Final = (1e-9, 1e-7)


def best_for_worst_direction(
    base: FloatArray, K: FloatArray, metric: FloatArray, limit: float
) -> tuple[FloatArray, FloatArray]:
    """Maximise the least eigenvalue of V C V, C the information on the first s parameters.

    Args:
        base: M0 (p, p).
        K: (k, p, p).
        metric: V (s,).
        limit: of a weight.

    Returns:
        Weights (k,) and Z (s, s), the dual variable.

    Raises:
        SolverError: Clarabel does not solve it.
    """
    import cvxpy as cp

    s = len(metric)
    E = np.zeros(base.shape)
    E[:s, :s] = np.diag(metric**-2.0)
    with COMPILING:
        w, t = cp.Variable(len(K)), cp.Variable()
        inequality = _matrix(base, K, w) - t * E >> 0
        _solve(cp.Problem(cp.Maximize(t), [inequality, *_simplex(w, limit)]))
        dual = np.asarray(inequality.dual_value)[:s, :s] / np.outer(metric, metric)
    return _weights(w, limit), dual


def best_for_worst_place(
    base: FloatArray, K: FloatArray, places: FloatArray, limit: float
) -> tuple[FloatArray, FloatArray]:
    """Minimise the greatest tr(W_r M⁻¹).

    Args:
        base: M0 (p, p).
        K: (k, p, p).
        places: W_r (R, p, p), positive semidefinite.
        limit: of a weight.

    Returns:
        Weights (k,) and π (R,), the dual variables.

    Raises:
        SolverError: Clarabel does not solve it.
    """
    import cvxpy as cp

    size = float(np.trace(places.mean(axis=0)))
    with COMPILING:
        w, t = cp.Variable(len(K)), cp.Variable()
        M = _matrix(base, K, w)
        below = [cp.matrix_frac(_root(W / size), M) <= t for W in places]
        _solve(cp.Problem(cp.Minimize(t), [*below, *_simplex(w, limit)]))
        dual = np.array([float(each.dual_value) for each in below])
    return _weights(w, limit), dual


def _matrix(base: FloatArray, K: FloatArray, w: cp.Variable) -> cp.Expression:
    import cvxpy as cp

    p = len(base)
    M = cp.reshape(K.reshape(len(K), -1).T @ w + base.ravel(), (p, p), order="C")
    return 0.5 * (M + M.T)


def _simplex(w: cp.Variable, limit: float) -> list[cp.Constraint]:
    import cvxpy as cp

    return [cp.sum(w) == 1, w >= 0, *([w <= limit] if limit < 1.0 else [])]


def _solve(problem: cp.Problem) -> None:
    import cvxpy as cp

    for tolerance in _TOLERANCES:
        settings = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
        with suppress(cp.SolverError), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the status says the same
            problem.solve(solver=cp.CLARABEL, max_threads=1, **settings)
        if problem.status == cp.OPTIMAL:
            return
    raise SolverError(f"Clarabel ended a design's program as {problem.status}")


def _weights(w: cp.Variable, limit: float) -> FloatArray:
    weights = np.clip(np.asarray(w.value, dtype=np.float64), 0.0, limit)
    weights[weights < 1e-7] = 0.0
    scaled: FloatArray = weights / weights.sum()
    return scaled


def _root(W: FloatArray) -> FloatArray:
    """Return B (p, r) with ``B Bᵀ = W``."""
    values, vectors = np.linalg.eigh(W)
    kept = values > values[-1] * 1e-12
    root: FloatArray = vectors[:, kept] * np.sqrt(values[kept])
    return root
