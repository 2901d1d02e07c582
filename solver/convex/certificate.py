"""Proof of optimality: the conditions of Karush, Kuhn and Tucker, from the data alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.equilibrated import Equilibrated
from jointstiff.solver.convex.least_distance import conditions
from jointstiff.solver.convex.problem import IdentificationProblem

__all__ = ["CERTIFICATE_TOLERANCE", "Certificate", "SupportFinder", "certify", "certify_within_bounds"]

SupportFinder = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]

CERTIFICATE_TOLERANCE = 1e-12
"""Greatest relative violation of an optimality condition that is taken for rounding."""

_ROUNDING = 64 * np.finfo(float).eps
"""Of a gradient, relative to the largest variable."""


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


def certify_within_bounds(scaled: Equilibrated, x: FloatArray, solved_by: SupportFinder) -> Certificate:
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


def certify(problem: IdentificationProblem, compliance: FloatArray, solved_by: SupportFinder) -> Certificate:
    """Evaluate the optimality conditions of a problem at compliances found elsewhere.

    Args:
        problem: as for `jointstiff.solver.convex.solve.solve`.
        compliance: (n,) [rad/(N·m)].
        solved_by: what found them.
    """
    scaled = Equilibrated.of(problem)
    x = compliance / scaled.unit
    if problem.inequalities is None:
        return certify_within_bounds(scaled, x, solved_by)
    return Certificate(*conditions(scaled.rows(problem.inequalities), x), 0.0, solved_by)
