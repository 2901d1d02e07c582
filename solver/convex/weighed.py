"""Least squares over cones of products, and the ends of linear functions near the optimum, certified.

Clarabel proposes; a bound from the dual, evaluated in the data by `Cones.least`, decides. Whatever x:

    ‖A y − b‖² ≥ ‖A x − b‖² + 2 gᵀ(y − x),   g = Aᵀ(A x − b): the excess is at most 2 (gᵀx − min gᵀy)
    aᵀy ≥ uᵀb − ‖u‖ + min (a − Aᵀu)ᵀy   for all y with ‖A y − b‖ ≤ 1, for any u
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.convex.perspective import Cones
from jointstiff.solver.errors import SolverError

GAP: Final = 1e-8
"""Greatest excess of an objective over the optimum, with ‖b‖ = 1, that a certificate lets pass."""
_LEAST_RADIUS: Final = 1e-6
"""Radius of the ball of `ends`, beside ‖b‖, below which Clarabel's rounding shows: exact readings."""
_LADDER: Final = (1e-10, 1e-9, 1e-8)
"""Tolerances of Clarabel, tried in this order."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """The optimum of `least_squares`, with its evidence."""

    x: FloatArray  #: (p,) in the set
    loss: float  #: ‖A x − b‖²
    #: its gap is the greatest excess of the loss over the optimum, with ‖b‖ = 1; its multipliers (rows,) are
    #: those of the equations that define the residuals
    certificate: Certificate


def least_squares(A: FloatArray, b: FloatArray, cones: Cones) -> Weighed:
    """Solve ``minimise ‖A x − b‖²`` over the set, and prove it.

    Args:
        A: (rows, p).
        b: (rows,), not zero.
        cones: of x, in units in which it is about ‖b‖.

    Raises:
        SolverError: no answer is certified.
    """
    size = float(np.linalg.norm(b)) or 1.0
    program = programs.weighed(len(b), cones.blocks)
    best: Weighed | None = None
    for tolerance in _LADDER:
        point = program.solve({"A": A, "b": b / size, "cap": cones.cap / size}, tolerance)
        if point is None:
            continue
        x = cones.projected(size * point)
        residual = A @ x - b
        gradient = A.T @ residual
        outside = -2.0 * cones.least(gradient) / size**2
        gap = outside + 2.0 * float(gradient @ x) / size**2
        if best is None or gap < best.certificate.gap:
            evidence = Certificate(0.0, outside, gap, residual / size, "clarabel")
            best = Weighed(x, float(residual @ residual), evidence)
        if best.certificate.is_optimal(GAP):
            return best
    raise SolverError(
        "the fit of compliances and weights could not be certified"
        + ("" if best is None else f": its gap is {best.certificate.gap:.1g}")
    )


@dataclass(frozen=True, eq=False)
class Ends:
    """Least and greatest c of each block where ‖A x − b‖² is near its optimum; outer bounds."""

    ends: FloatArray  #: (n, 2) bounds from the dual; NaN where Clarabel has no answer
    gap: FloatArray  #: (n, 2) distance of each to the value of Clarabel's point, beside c's range


def ends(A: FloatArray, b: FloatArray, optimum: Weighed, rise: float, cones: Cones) -> Ends:
    """Bound each block's c over the points of the set with ``‖A x − b‖² ≤ loss + rise``.

    Every point has a c of at most the bounds found so far, which sharpens the others.

    Args:
        A: (rows, p).
        b: (rows,).
        optimum: of `least_squares`.
        rise: of the loss, positive.
        cones: of x.
    """
    radius = max(float(np.sqrt(optimum.loss + rise)), _LEAST_RADIUS * float(np.linalg.norm(b)))
    program = programs.weighed_end(len(b), cones.blocks)
    data = {"A": A, "b": (b - A @ optimum.x) / radius, "near": optimum.x / radius, "cap": cones.cap / radius}
    values, duals = np.full((len(cones.cap), 2), np.nan), {}
    for j, side in np.ndindex(values.shape):
        a = np.zeros(len(optimum.x))
        a[cones.first[j]] = size = (1.0, -1.0)[side]
        for tolerance in _LADDER:
            solution = program.solve_with_duals({"a": a, **data}, tolerance)
            if solution is not None:
                values[j, side] = size * (a @ optimum.x + radius * (a @ solution[0]))
                duals[j, side] = a, solution[1][1 : 1 + len(b)]
                break
    bounds, cap = np.full(values.shape, np.nan), cones.cap
    for _ in range(2):
        for (j, side), (a, u) in duals.items():
            least = u @ b - radius * float(np.linalg.norm(u)) + Cones(cones.blocks, cap).least(a - A.T @ u)
            bounds[j, side] = least if side == 0 else -least
        cap = np.fmin(cap, bounds[:, 1])
    bounds[:, 0] = np.fmax(bounds[:, 0], 0.0)
    gap = np.array([1.0, -1.0]) * (np.clip(values, 0.0, None) - bounds)
    return Ends(bounds, gap / (bounds[:, 1:] - bounds[:, :1]))
