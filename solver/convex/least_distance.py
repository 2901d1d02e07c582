"""Least squares under linear inequalities: the exact active set, the polish on it and the proof.

The problem ``minimise ‖A x − b‖² subject to B x ≥ d`` is turned into one of least distance, whose dual is a
non-negative least-squares problem that ends after finitely many steps (Lawson & Hanson 1974, chapter 23).
Bounds are rows of B like any others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray

__all__ = ["Inequality", "active_rows", "conditions", "multipliers_of", "polish"]


_NO_DIRECTION = 1e-13
"""Relative singular value that is a zero up to rounding."""
_ROUNDING = 64 * np.finfo(float).eps
_TIGHT = 1e-12
"""Greatest slack, relative to the variables, that is taken for rounding."""


@dataclass(frozen=True, eq=False)
class Inequality:
    """``minimise ‖A x − b‖² subject to B x ≥ d``.

    Attributes:
        A: (m, n) columns of unit norm.
        b: (m,) norm at most one.
        B: (k, n) rows of unit norm.
        d: (k,).
    """

    A: FloatArray
    b: FloatArray
    B: FloatArray
    d: FloatArray

    def tight(self, x: FloatArray, slack: float = _TIGHT) -> BoolArray:
        """(k,) rows that hold with equality up to a slack relative to the variables; to rounding."""
        return np.asarray(self.B @ x - self.d <= slack * max(1.0, float(np.abs(x).max())))


def active_rows(problem: Inequality) -> BoolArray | None:
    """The rows that hold with equality at the optimum; None where A has not full rank, or it failed.

    With A = Q R and w = R x − Qᵀb the rows are ``B R⁻¹ w ≥ d − B R⁻¹ Qᵀ b =: g``, and w is wanted of least
    length: NNLS on ``E = [(B R⁻¹)ᵀ; gᵀ]`` with right-hand side (0, …, 0, 1) has its multipliers.
    """
    from scipy.optimize import nnls

    Q, R = np.linalg.qr(problem.A)
    diagonal = np.abs(np.diagonal(R))
    if len(R) < R.shape[1] or diagonal.min() <= 1e-9 * diagonal.max():
        return None
    rows = np.linalg.solve(R.T, problem.B.T).T
    least = problem.d - rows @ (Q.T @ problem.b)
    E = np.vstack([rows.T, least])
    scale = np.linalg.norm(E, axis=0)
    target = np.zeros(len(E))
    target[-1] = 1.0
    try:
        multipliers, _ = nnls(E / scale, target)
    except RuntimeError:
        return None
    return np.asarray(multipliers > 0)


def polish(problem: Inequality, active: BoolArray, near: FloatArray) -> FloatArray:
    """Least squares on the face where the active rows hold with equality, nearest to a given point.

    Args:
        problem: what is solved.
        active: (k,) rows that hold with equality.
        near: (n,) decides where the optimum is not unique.
    """
    rows, values = problem.B[active], problem.d[active]
    x = near
    along = np.eye(len(x))
    if len(rows):
        U, singular, Vt = np.linalg.svd(rows, full_matrices=True)
        rank = int((singular > _NO_DIRECTION * singular[0]).sum())
        x = x + Vt[:rank].T @ ((U[:, :rank].T @ (values - rows @ x)) / singular[:rank])
        along = Vt[rank:].T
    # Twice: rows that are nearly parallel may have taken x far away, and the first step leaves its rounding.
    for _ in range(2 if along.shape[1] else 0):
        step = np.linalg.lstsq(problem.A @ along, problem.b - problem.A @ x, rcond=_NO_DIRECTION)[0]
        x = x + along @ step
    return np.asarray(x, dtype=np.float64)


def conditions(problem: Inequality, x: FloatArray) -> tuple[float, float]:
    """Violation of the conditions of Karush, Kuhn and Tucker at x, dimensionless, beyond rounding.

    Multipliers that are not negative are sought for the tight rows alone, so complementarity holds by
    construction, and it does not matter that the rows may depend on each other.

    Returns:
        Greatest violation of a row; greatest component of the gradient that no multipliers balance.
    """
    size = max(1.0, float(np.abs(x).max()))
    violation = float((problem.d - problem.B @ x).max(initial=0.0))
    gradient = problem.A.T @ (problem.A @ x - problem.b)
    multipliers = multipliers_of(problem, x)
    left = np.abs(gradient - problem.B.T @ multipliers)
    # A balance is known to the rounding of its largest terms: rows that are nearly parallel, as where a joint
    # hardly shows, pull against each other with multipliers far beyond the gradient.
    largest = max(size, float((np.abs(problem.B.T) @ multipliers).max(initial=0.0)))
    return max(0.0, violation - _ROUNDING * size), max(0.0, float(left.max()) - _ROUNDING * largest)


def multipliers_of(problem: Inequality, x: FloatArray, slack: float = _TIGHT) -> FloatArray:
    """The multipliers (k,), none negative, that best balance the gradient at x.

    Args:
        problem: what is solved.
        x: (n,) a point.
        slack: relative to the variables, beyond which a row has none; rounding if not given.
    """
    from scipy.optimize import nnls

    multipliers = np.zeros(len(problem.d))
    tight = problem.tight(x, slack)
    if tight.any():
        gradient = problem.A.T @ (problem.A @ x - problem.b)
        try:
            multipliers[tight] = nnls(problem.B[tight].T, gradient)[0]
        except RuntimeError:  # it gave up: without multipliers nothing is certified
            return multipliers
    return multipliers
