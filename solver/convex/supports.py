"""Supports of bounded problems: which parameters are free, and which a bound holds.

Every function works on one problem (n,) and on many at once (K, n).
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray, Support

FREE, LOWER, UPPER = 0, -1, 1

TOLERANCE = 1e-12
"""Largest violation of an optimality condition, in equilibrated variables, that counts as rounding."""


def support_at(x: FloatArray, lower: FloatArray, upper: FloatArray) -> Support:
    """Return the support of a point whose parameters lie exactly on their bounds or within them."""
    return np.where(x == lower, LOWER, np.where(x == upper, UPPER, FREE)).astype(np.int8)


def held(active: Support, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the bound of each parameter that one holds, and zero for those that are free."""
    return np.where(active == LOWER, lower, np.where(active == UPPER, upper, 0.0))


def snap(x: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Clip to the bounds and snap values within rounding of one; the certificate is computed afterwards."""
    x = np.where(x - lower <= TOLERANCE, lower, x)
    return np.where(upper - x <= TOLERANCE, upper, x)


def pivot(
    active: Support, x: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> Support:
    """Move all parameters that violate their condition: one round of block principal pivoting.

    A free parameter outside its bounds goes to the bound, one at a bound with a multiplier of the wrong sign
    is freed. Rounds may cycle, which the certificate detects (Portugal, Júdice & Vicente 1994).
    """
    pull = np.where(active == LOWER, gradient, np.where(active == UPPER, -gradient, 1.0))
    moved = np.where(pull < 0, FREE, active)
    return np.where(x < lower, LOWER, np.where(x > upper, UPPER, moved)).astype(np.int8)


def gradient_violation(
    x: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return the gradient's part of the wrong sign at a bound, and all of it off the bounds."""
    return np.asarray(
        np.where(x <= lower, -gradient, np.where(x >= upper, gradient, np.abs(gradient))), dtype=np.float64
    )
