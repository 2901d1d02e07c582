"""Proof of optimality: the conditions of Karush, Kuhn and Tucker, from the data alone.

Exact active sets, for ties that an interior point blurs, and the proof under linear inequalities.

Bounds are solved by bounded-variable least squares (Stark & Parker 1995). Linear inequalities are turned into
a problem of least distance, whose dual is a non-negative least-squares problem that ends after finitely many
steps (Lawson & Hanson 1974, chapter 23); bounds are rows like any others there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, Support
from jointstiff.solver.convex.problem import TOLERANCE, IdentificationProblem, Scaled, gradient_violation

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


Proposer = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]
"""Algorithm that found the support: which bounds and inequalities are active."""

_ROUNDING = 64 * np.finfo(float).eps
"""Rounding of a gradient, relative to the largest variable."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """Evidence that an answer is the optimum of a convex program, from the data at the answer itself.

    Violations are dimensionless, and beyond rounding. For least squares in equilibrated variables a gradient
    is the cosine between a column and the residual, times ‖residual‖/‖z‖.
    """

    primal: float  #: greatest violation of a constraint, of a cone by a scalar or an eigenvalue
    #: greatest part of the gradient that the multipliers do not balance. For a cone, how far the slack was
    #: outside of it before the multipliers were moved, over the weight of the penalty
    dual: float
    #: greatest min(multiplier, slack). For a cone, root of the objective's excess over what the multipliers
    #: prove, with ‖z‖ = 1: the fitted readings differ from the optimum's by no more. For a robust loss, the
    #: excess itself
    gap: float
    #: (n + k,) of the bounds, positive at a lower and negative at an upper one, then of the inequalities. For
    #: a cone, (m,) or (K, 3) of the equations that define the residuals
    multipliers: FloatArray
    solved_by: Proposer  #: algorithm that found the support

    def is_optimal(self, eps: float = TOLERANCE) -> bool:
        """Return whether no violation exceeds a tolerance; rounding if none is given."""
        return max(self.primal, self.dual, self.gap) <= eps


@dataclass(frozen=True)
class StagesCertificate:
    """The greatest violations of the optimality conditions over the stages of a method, dimensionless."""

    primal: float  #: greatest violation of a bound
    dual: float  #: gradient of the wrong sign
    complementarity: float  #: min(multiplier, slack)
    solved_by: tuple[str, ...]  #: what found the support of each stage

    @classmethod
    def of(cls, stages: Sequence[Certificate]) -> StagesCertificate:
        """Combine the certificates of the stages, at least one."""
        return cls(
            primal=max(stage.primal for stage in stages),
            dual=max(stage.dual for stage in stages),
            complementarity=max(stage.gap for stage in stages),
            solved_by=tuple(stage.solved_by for stage in stages),
        )


def certify(problem: IdentificationProblem, compliance: FloatArray, solved_by: Proposer) -> Certificate:
    """Evaluate the optimality conditions of a problem at compliances found elsewhere.

    Args:
        problem: as for `solve`.
        compliance: (n,) [rad/(N·m)].
        solved_by: algorithm that found them.
    """
    scaled = Scaled.of(problem)
    return certify_scaled(scaled, compliance / scaled.unit, solved_by)


def certify_scaled(scaled: Scaled, x: FloatArray, solved_by: Proposer) -> Certificate:
    """Evaluate the optimality conditions at x (n,), in equilibrated variables."""
    gradient, size = scaled.gradient(x), max(1.0, float(np.abs(x).max()))
    if len(scaled.d):
        return _certify_rows(scaled, x, gradient, size, solved_by)
    below, above = x - scaled.lower, scaled.upper - x
    # The multiplier of a lower bound is the positive part of the gradient, of an upper the negative.
    product = np.maximum(
        np.minimum(np.maximum(gradient, 0.0), below), np.minimum(np.maximum(-gradient, 0.0), above)
    )
    # A gradient is known to the rounding of the terms that cancel in it.
    wrong = gradient_violation(x, gradient, scaled.lower, scaled.upper)
    return Certificate(
        primal=max(0.0, float(-np.minimum(below, above).min())),
        dual=max(0.0, float(wrong.max()) - _ROUNDING * size),
        gap=max(0.0, float(product.max()) - _ROUNDING * size),
        multipliers=np.where((x <= scaled.lower) | (x >= scaled.upper), gradient, 0.0),
        solved_by=solved_by,
    )


def _certify_rows(
    scaled: Scaled, x: FloatArray, gradient: FloatArray, size: float, solved_by: Proposer
) -> Certificate:
    """Evaluate them where inequalities hold besides the bounds.

    Multipliers that are not negative are sought for the tight rows alone, so complementarity holds by
    construction, and it does not matter that the rows may depend on each other.
    """
    G, h = rows_of(scaled)
    multipliers = multipliers_of(scaled, x)
    left = np.abs(gradient - G.T @ multipliers)
    # A balance is known to the rounding of its largest terms: rows that are nearly parallel, as where a joint
    # hardly shows, pull against each other with multipliers far beyond the gradient.
    largest = max(size, float((np.abs(G.T) @ multipliers).max(initial=0.0)))
    bounds, inequalities = len(h) - len(scaled.d), multipliers[len(h) - len(scaled.d) :]
    return Certificate(
        primal=max(0.0, float((h - G @ x).max(initial=0.0)) - _ROUNDING * size),
        dual=max(0.0, float(left.max()) - _ROUNDING * largest),
        gap=0.0,
        multipliers=np.concatenate([G[:bounds].T @ multipliers[:bounds], inequalities]),
        solved_by=solved_by,
    )
