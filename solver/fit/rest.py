"""Rest of a fixed-point iteration: a fit whose columns depend on the fit's own result (method.md §8)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.optimize import root

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError

_DEPTH: Final = 3
"""Number of earlier steps that are mixed: one for each direction of slow convergence; a load point moves in
three directions."""


def find_rest(
    step: Callable[[FloatArray], FloatArray], start: FloatArray, *, unit: FloatArray, most_steps: int
) -> FloatArray:
    """Find a fixed point of a function, ``step(x) = x``, by Anderson's mixing of the last steps.

    D. G. Anderson, *Iterative procedures for nonlinear integral equations*, J. ACM 12(4), 1965. Mixing needs
    far fewer calls of `step` than calling it again and again. The last call of `step` is that at the returned
    point.

    Args:
        step: function that maps a point (n,) to the next point (n,).
        start: (n,) first point.
        unit: (n,) tolerance of each coordinate, positive: the search ends when a step changes no coordinate
            by more.
        most_steps: greatest number of steps.

    Raises:
        SolverError: the point still changes by more than `unit` after so many steps.
    """

    def compute_change(scaled_point: FloatArray) -> FloatArray:
        """Return the change (n,) of a point by a step; points and changes are divided by `unit`."""
        point = scaled_point * unit
        return (step(point) - point) / unit

    answer = root(
        compute_change,
        start / unit,
        method="anderson",
        options={
            "fatol": 1.0,  # changes are divided by their tolerance
            "tol_norm": _largest,
            "maxiter": most_steps,
            "line_search": None,
            "jac_options": {"alpha": 1.0, "M": _DEPTH},
        },
    )
    if not answer.success:
        raise _build_no_rest_error(most_steps, _largest(answer.fun))
    return np.asarray(answer.x * unit)


def _largest(changes: FloatArray) -> float:
    """Return the greatest magnitude among changes (n,)."""
    return float(np.abs(changes).max())


def _build_no_rest_error(steps: int, change: float) -> SolverError:
    """Build the error for a search without an end; the last step changed the point by `change` units."""
    return SolverError(
        f"the fit did not converge: after {steps} repetitions the compliances still change by "
        f"{change:.1e} times the tolerance",
        where="complementary_stiffness",
        remedy="neglect the complementary stiffness, or add postures and loads that twist every joint",
    )
