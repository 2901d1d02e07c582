"""Range of linear functions over the points whose penalised least squares are near the optimum."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.semidefinite.cone import SemidefiniteProgram

_LADDER: Final = (1e-8, 1e-7, 1e-6)
"""Tolerances of Clarabel, tried in this order: relative to the estimate, no end needs more than the last."""


def penalised_range(
    program: SemidefiniteProgram, x: FloatArray, rise: float, functions: FloatArray
) -> FloatArray:
    """Return the least and the greatest value of linear functions where the objective is near its optimum.

    ``min, max aᵀy subject to ‖R y − z‖² + pᵀy ≤ ‖R x − z‖² + pᵀx + rise``, y in the cone.

    Args:
        program: the program.
        x: (p,) its optimum.
        rise: of the objective, positive.
        functions: (K, p) a.

    Returns:
        (K, 2); NaN where an end is not found.
    """
    T, z = program.fit.compressed
    limit = float(np.square(T @ x - z).sum() + program.penalty @ x) + rise
    cone = program.cone
    stated = programs.penalised_end(T, z, program.penalty, limit, cone.nonnegative, cone.sizes)
    ends = np.full((len(functions), 2), np.nan)
    for number, a in enumerate(functions):
        size = float(np.linalg.norm(a))
        for side, sign in enumerate((1.0, -1.0)):
            for tolerance in _LADDER if size > 0.0 else ():
                point = stated.solve({"a": sign * a / size}, tolerance)
                if point is not None:
                    ends[number, side] = a @ point
                    break
    return ends
