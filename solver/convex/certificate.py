"""Proof of optimality: the conditions of Karush, Kuhn and Tucker, from the data alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.active_set import conditions
from jointstiff.solver.convex.problem import IdentificationProblem
from jointstiff.solver.convex.scaled import Scaled
from jointstiff.solver.convex.supports import TOLERANCE, gradient_violation

Proposer = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]
"""Algorithm that found the support: which bounds and inequalities are active."""

_ROUNDING = 64 * np.finfo(float).eps
"""Rounding of a gradient, relative to the largest variable."""


@dataclass(frozen=True)
class Certificate:
    """Violation of the optimality conditions, dimensionless, from the data alone."""

    primal: float  #: greatest violation of a bound, in equilibrated variables
    #: greatest gradient of the wrong sign at a bound, or of any sign off the bounds, beyond rounding; a
    #: gradient is the cosine between a column and the residual, times ‖residual‖/‖z‖
    dual: float
    complementarity: float  #: greatest min(multiplier, slack), beyond rounding
    solved_by: Proposer  #: algorithm that found the support

    @property
    def holds(self) -> bool:
        """Return whether all violations are rounding."""
        return max(self.primal, self.dual, self.complementarity) <= TOLERANCE


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
    if len(scaled.d):
        return Certificate(*conditions(scaled, x), 0.0, solved_by)
    gradient = scaled.gradient(x)
    below, above = x - scaled.lower, scaled.upper - x
    # The multiplier of a lower bound is the positive part of the gradient, of an upper the negative.
    product = np.maximum(
        np.minimum(np.maximum(gradient, 0.0), below), np.minimum(np.maximum(-gradient, 0.0), above)
    )
    # A gradient is known to the rounding of the terms that cancel in it.
    rounding = _ROUNDING * max(1.0, float(np.abs(x).max()))
    wrong = gradient_violation(x, gradient, scaled.lower, scaled.upper)
    return Certificate(
        primal=max(0.0, float(-np.minimum(below, above).min())),
        dual=max(0.0, float(wrong.max()) - rounding),
        complementarity=max(0.0, float(product.max()) - rounding),
        solved_by=solved_by,
    )
