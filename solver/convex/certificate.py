"""Proof of optimality: the conditions of Karush, Kuhn and Tucker, from the data alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.active_set import multipliers_of, rows_of
from jointstiff.solver.convex.problem import TOLERANCE, IdentificationProblem, Scaled, gradient_violation

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

    primal: float  #: of a bound
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
