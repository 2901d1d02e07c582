"""Thresholds of the checks, from a stated rate of false alarms.

Every statistical check of a set is allowed `FALSE_ALARM` of false findings, divided among its comparisons
(Bonferroni). Where the scale is not stated but taken from the data, robustly, its own uncertainty counts:
quantiles are then those of F with the degrees of freedom that a median leaves.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray

FALSE_ALARM: Final = 1e-6
"""Significance level of a check: a dozen checks, a set a day for centuries."""
MODEL_ALLOWANCE: Final = 1.5
"""Factor for deviations that are not noise: they are not normal, and their extremes may be larger."""
MEDIAN_EFFICIENCY: Final = 0.37
"""Confidence of a scale estimated by medians, as the standard deviation of that share of the readings."""
_MEDIAN_NORM: Final = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.5)))
"""Median of the norm of three standard normal coordinates."""
_MEDIAN_SIZE: Final = 0.6744897501960817
"""Median of the absolute value of one."""


def normal_quantile(comparisons: int) -> float:
    """Standard deviations that one of so many normal variables exceeds, on either side, at `FALSE_ALARM`."""
    return float(-special.ndtri(FALSE_ALARM / (2.0 * max(comparisons, 1))))


def vector_quantile(comparisons: int, freedom: float) -> float:
    """Norm, over its scale, that one of so many vectors of three coordinates exceeds at `FALSE_ALARM`.

    Args:
        comparisons: how many vectors.
        freedom: number of coordinates from which medians took the scale.
    """
    below = 1.0 - FALSE_ALARM / max(comparisons, 1)
    return float(np.sqrt(3.0 * special.fdtri(3.0, max(1.0, MEDIAN_EFFICIENCY * freedom), below)))


def vector_scale(norms: FloatArray) -> float:
    """Standard deviation of a coordinate, by the median of the norms (K,) of vectors of three; 0 for none."""
    return float(np.median(norms)) / _MEDIAN_NORM if norms.size else 0.0


def length_scale(sizes: FloatArray) -> float:
    """Standard deviation of numbers of these sizes (K,), by their median; 0 for none."""
    return float(np.median(sizes)) / _MEDIAN_SIZE if sizes.size else 0.0
