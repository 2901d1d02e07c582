"""The characteristic length, kept as the baseline that the paper compares with (method.md §3, §4)."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray

_DECADES = (-3.0, 3.0)


def least_condition_length(linear: FloatArray, angular: FloatArray) -> float:
    """The length L that minimises the condition number of the rows [A_v / L; A_ω] (Khan & Angeles).

    Columns are brought to unit norm first, as for the solve: otherwise the spread of the torques
    between arm and wrist decides, and the least condition number lies at an infinite length.

    Args:
        linear: (k, p) compressed regressor of the translations [m/(rad/(N·m))].
        angular: (k, p) compressed regressor of the rotations [rad/(rad/(N·m))].

    Returns:
        L between 1 mm and 1 km [m].
    """
    from scipy.optimize import minimize_scalar  # takes a second to import, which few processes need

    def log_condition(decade: float) -> float:
        stacked = np.concatenate([linear / 10.0**decade, angular])
        singular = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0), compute_uv=False)
        return float(np.log(singular[0] / max(singular[-1], np.finfo(float).tiny)))

    # The condition number has several local minima where singular values cross: scan, then refine.
    grid = np.linspace(*_DECADES, 121)
    best = int(np.argmin([log_condition(decade) for decade in grid]))
    step = grid[1] - grid[0]
    refined = minimize_scalar(
        log_condition,
        bounds=(grid[best] - step, grid[best] + step),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(10.0 ** np.clip(refined.x, *_DECADES))
