"""Optimal weights of a few candidates: Newton's method with an active set on the simplex."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import LinearConstraint, minimize

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.design.criteria import AOptimality, GOptimality, Slope, SmoothCriterion

_STEPS: Final = 60
_CONVERGED: Final = 1e-24
"""Newton's decrement of −log φ that is rounding; the gap of a design is of the order of its root."""
_QUADRATIC: Final = 1e-8
"""Decrement below which a full step is taken: values of −log φ no longer tell the points apart."""
_RIDGE: Final = 1e-12
"""Of the Hessian's mean diagonal: more weights than entries of M leave directions without curvature."""
_DECREASE: Final = 1e-4
_LEAST_SHARE: Final = 1e-9
"""Least share of a place in the dual of the worst one."""
_SHORTEST: Final = 1e-10
"""Share of a step at which the line search gives in."""


def optimal_weights(
    criterion: SmoothCriterion, base: FloatArray, K: FloatArray, weights: FloatArray, limit: float
) -> FloatArray:
    """Maximise φ(base + Σ w_i K_i) subject to Σ w = 1 and 0 ≤ w ≤ limit.

    Args:
        criterion: φ.
        base: (p, p).
        K: (k, p, p).
        weights: (k,) feasible, to start from.
        limit: of a weight.

    Returns:
        (k,) weights, to rounding.
    """
    w = weights
    at, last = _slope(criterion, base, K, w), np.inf
    for _ in range(_STEPS):
        step = _step(at, w, limit)
        decrement = _decrement(at, w, step)
        if decrement <= _CONVERGED:
            break
        moved, after = _line_search(criterion, base, K, w, at, step, limit)
        if decrement < _QUADRATIC and last <= decrement:
            break
        w, at, last = moved, after, decrement
    return w


def worst_place_weights(
    criterion: GOptimality, base: FloatArray, K: FloatArray, weights: FloatArray, limit: float
) -> tuple[FloatArray, FloatArray]:
    """Maximise φ of the worst place, by its dual: the shares π of the places that no weights serve better.

    ``max_π min_w Σ π_r tr(W_r M(w)⁻¹)``, concave in π; the slope is the variances at the best weights.

    Args:
        criterion: φ.
        base: (p, p).
        K: (k, p, p).
        weights: (k,) feasible, to start from.
        limit: of a weight.

    Returns:
        (k,) weights, and the shares (R,) of the places.
    """
    count, best = len(criterion.places), weights

    def negative(shares: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best
        mixed = AOptimality(np.tensordot(np.maximum(shares, 0.0), criterion.places, axes=1))
        best = optimal_weights(mixed, base, K, best, limit)
        variances = criterion.variances(base + np.tensordot(best, K, axes=1))
        served = float(shares @ variances)
        return -float(np.log(served)), -variances / served

    solution = minimize(
        negative,
        np.full(count, 1.0 / count),
        jac=True,
        method="SLSQP",
        bounds=[(_LEAST_SHARE, 1.0)] * count,
        constraints=LinearConstraint(np.ones((1, count)), 1.0, 1.0),
        options={"ftol": 1e-7, "maxiter": 60},
    )
    negative(solution.x)
    return best, solution.x


def _line_search(
    criterion: SmoothCriterion,
    base: FloatArray,
    K: FloatArray,
    w: FloatArray,
    at: Slope,
    step: FloatArray,
    limit: float,
) -> tuple[FloatArray, Slope]:
    """Return the first of the points w + step, w + step/2, … that decreases −log φ enough, and its slope."""
    decrement, size = _decrement(at, w, step), 1.0
    while True:
        moved = np.clip(w + size * step, 0.0, limit)
        moved /= moved.sum()
        after = _slope(criterion, base, K, moved)
        decreased = after.value <= at.value - _DECREASE * size * decrement
        if decreased or decrement < _QUADRATIC or size < _SHORTEST:
            return moved, after
        size *= 0.5


def _decrement(at: Slope, w: FloatArray, step: FloatArray) -> float:
    """Return −gradient · step, less what all entries share: the step sums to zero, and it would round."""
    return -float((at.gradient - at.gradient @ w) @ step)


def _slope(criterion: SmoothCriterion, base: FloatArray, K: FloatArray, w: FloatArray) -> Slope:
    M = base + (w @ K.reshape(len(K), -1)).reshape(base.shape)
    return criterion.slope(M, K)


def _step(at: Slope, w: FloatArray, limit: float) -> FloatArray:
    """Return the step to the minimum of the quadratic model on the simplex, by an active set."""
    hessian = at.hessian + _RIDGE * np.trace(at.hessian) / len(w) * np.eye(len(w))
    free = (w > 0.0) & (w < limit)
    x = w.copy()
    free |= _released(at.gradient, x, free, limit)
    for _ in range(4 * len(w)):
        gradient = at.gradient + hessian @ (x - w)
        step = _equality_step(hessian, gradient, free)
        room = np.where(step < 0.0, -x / np.where(step < 0.0, step, 1.0), np.inf)
        if limit < 1.0:
            room = np.minimum(
                room, np.where(step > 0.0, (limit - x) / np.where(step > 0.0, step, 1.0), np.inf)
            )
        first = int(np.argmin(room))
        if room[first] < 1.0:
            x = np.clip(x + room[first] * step, 0.0, limit)
            x[first] = 0.0 if step[first] < 0.0 else limit
            free[first] = False
            continue
        x = x + step
        released = _released(at.gradient + hessian @ (x - w), x, free, limit)
        if not released.any():
            break
        free |= released
    return x - w


def _equality_step(hessian: FloatArray, gradient: FloatArray, free: BoolArray) -> FloatArray:
    """Return the step of the free weights to the model's minimum on Σ step = 0; zeros elsewhere."""
    index = np.flatnonzero(free)
    step = np.zeros(len(free))
    if len(index) < 2:
        return step
    k = len(index)
    system = np.ones((k + 1, k + 1))
    system[:k, :k] = hessian[np.ix_(index, index)]
    system[k, k] = 0.0
    step[index] = np.linalg.solve(system, np.append(-gradient[index], 0.0))[:k]
    return step


def _released(gradient: FloatArray, x: FloatArray, free: BoolArray, limit: float) -> BoolArray:
    """Return the weight at a bound whose release decreases the model most, as a mask; none at its minimum."""
    level = float(gradient[free].mean()) if free.any() else float(gradient[x > 0.0].max())
    gain = np.where(x <= 0.0, level - gradient, np.where(x >= limit, gradient - level, 0.0))
    gain[free] = 0.0
    mask = np.zeros(len(x), dtype=np.bool_)
    best = int(np.argmax(gain))
    mask[best] = gain[best] > 1e-12 * (1.0 + abs(level))
    return mask
