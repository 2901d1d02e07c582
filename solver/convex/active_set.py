"""Exact active sets, for ties that an interior point blurs, and the proof under linear inequalities.

Bounds are solved by bounded-variable least squares (Stark & Parker 1995). Linear inequalities are turned into
a problem of least distance, whose dual is a non-negative least-squares problem that ends after finitely many
steps (Lawson & Hanson 1974, chapter 23); bounds are rows like any others there.
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, Support
from jointstiff.solver.convex.problem import Scaled

_NO_DIRECTION = 1e-13
"""Relative singular value that counts as zero."""
_TIGHT = 1e-12
"""Largest slack, relative to the variables, that counts as rounding."""


def exact_support(scaled: Scaled) -> Support:
    """Find the support (n,) under bounds alone."""
    from scipy.optimize import lsq_linear

    outcome = lsq_linear(scaled.A, scaled.b, bounds=(scaled.lower, scaled.upper), method="bvls", tol=1e-15)
    return np.asarray(outcome.active_mask, dtype=np.int8)


def rows_of(scaled: Scaled) -> tuple[FloatArray, FloatArray]:
    """Return ``G x ≥ h``: rows (k, n) of unit norm for the bounds, then for the inequalities."""
    below, above = np.isfinite(scaled.lower), np.isfinite(scaled.upper)
    identity = np.eye(len(scaled.lower))
    return (
        np.vstack([identity[below], -identity[above], scaled.B]),
        np.concatenate([scaled.lower[below], -scaled.upper[above], scaled.d]),
    )


def tight_rows(scaled: Scaled, x: FloatArray, slack: float = _TIGHT) -> BoolArray:
    """Return which rows (k,) hold with equality up to a slack relative to the variables; to rounding."""
    G, h = rows_of(scaled)
    return np.asarray(G @ x - h <= slack * max(1.0, float(np.abs(x).max())))


def active_rows(scaled: Scaled) -> BoolArray | None:
    """Find the rows (k,) that are tight at the optimum; None where A has not full rank, or it failed.

    With A = Q R and w = R x − Qᵀb the rows are ``G R⁻¹ w ≥ h − G R⁻¹ Qᵀ b =: g``, and w is wanted of least
    length: NNLS on ``E = [(G R⁻¹)ᵀ; gᵀ]`` with right-hand side (0, …, 0, 1) has its multipliers.
    """
    from scipy.optimize import nnls

    Q, R = np.linalg.qr(scaled.A)
    diagonal = np.abs(np.diagonal(R))
    if len(R) < R.shape[1] or diagonal.min() <= 1e-9 * diagonal.max():
        return None
    G, h = rows_of(scaled)
    rows = np.linalg.solve(R.T, G.T).T
    least = h - rows @ (Q.T @ scaled.b)
    E = np.vstack([rows.T, least])
    scale = np.linalg.norm(E, axis=0)
    target = np.zeros(len(E))
    target[-1] = 1.0
    try:
        multipliers, _ = nnls(E / scale, target)
    except RuntimeError:
        return None
    return np.asarray(multipliers > 0)


def polish(scaled: Scaled, active: BoolArray, near: FloatArray) -> FloatArray:
    """Solve least squares on the face where the active rows hold with equality, nearest to a given point.

    Args:
        scaled: the problem.
        active: (k,) rows that hold with equality.
        near: (n,) decides where the optimum is not unique.
    """
    G, h = rows_of(scaled)
    rows, values = G[active], h[active]
    x = near
    along = np.eye(len(x))
    if len(rows):
        U, singular, Vt = np.linalg.svd(rows, full_matrices=True)
        rank = int((singular > _NO_DIRECTION * singular[0]).sum())
        x = x + Vt[:rank].T @ ((U[:, :rank].T @ (values - rows @ x)) / singular[:rank])
        along = Vt[rank:].T
    # Twice: rows that are nearly parallel may have taken x far away, and the first step leaves its rounding.
    for _ in range(2 if along.shape[1] else 0):
        step = np.linalg.lstsq(scaled.A @ along, scaled.b - scaled.A @ x, rcond=_NO_DIRECTION)[0]
        x = x + along @ step
    return np.asarray(x, dtype=np.float64)


def multipliers_of(scaled: Scaled, x: FloatArray, slack: float = _TIGHT) -> FloatArray:
    """Return the multipliers (k,), none negative, that best balance the gradient at x.

    Args:
        scaled: the problem.
        x: (n,) a point.
        slack: relative to the variables, beyond which a row has none; rounding if not given.
    """
    from scipy.optimize import nnls

    G, h = rows_of(scaled)
    multipliers = np.zeros(len(h))
    tight = tight_rows(scaled, x, slack)
    if tight.any():
        try:
            multipliers[tight] = nnls(G[tight].T, scaled.gradient(x))[0]
        except RuntimeError:  # it gave up: without multipliers nothing is certified
            return multipliers
    return multipliers
