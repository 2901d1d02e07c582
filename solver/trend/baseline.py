"""Baseline of a chart, and the scatter between campaigns that its few campaigns leave open.

Model: ``y_i = μ + b_i + e_i``, e_i ~ N(0, u_i²) from the readings, b_i ~ N(0, τ²) between campaigns.
τ is estimated by DerSimonian and Laird (Controlled Clinical Trials 7, 1986), and may be zero. Three campaigns
hardly tell it, so that the limits average over it: a half-normal prior (Röver et al., Research Synthesis
Methods 12, 2021) times its restricted likelihood. All arrays may have leading axes: charts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray

LEAST_BASELINE: Final = 3
"""Fewest campaigns of a baseline."""
PRIOR_SCALE: Final = 0.45
"""Scale of the prior of τ, in units of the readings' standard uncertainty. With the level below it keeps the
rate of false alarms for any τ (`python -m benchmarks trend`)."""
_POOLED_LEVEL: Final = 0.8
_NODES: Final = 48
_REACH: Final = 5.0
"""Scales of the prior that the nodes cover."""


@dataclass(frozen=True)
class Baseline:
    """Mean of a baseline's campaigns. Shapes (...,) are those of the leading axes."""

    values: FloatArray
    uncertainties: FloatArray
    mean: FloatArray  #: weighted mean of ln k (...,)
    #: standard uncertainty of one campaign from its readings, root of the harmonic mean (...,)
    reading: FloatArray
    scatter: FloatArray  #: Q = Σ (y_i - ȳ)² / u_i² (...,), χ² with m - 1 degrees of freedom if τ = 0
    freedom: int  #: m - 1
    between: FloatArray  #: τ by DerSimonian and Laird (...,), zero where the campaigns agree
    variance_of_readings: FloatArray  #: var(mean) if τ = 0 (...,)
    variance_of_between: FloatArray  #: increase of var(mean) by τ², over τ² (...,)

    @classmethod
    def of(cls, values: FloatArray, uncertainties: FloatArray) -> Baseline:
        """Return the baseline of campaigns (..., m) with standard uncertainties (..., m)."""
        w = uncertainties**-2.0
        total, freedom = w.sum(-1), values.shape[-1] - 1
        centre = (w * values).sum(-1) / total
        scatter = (w * (values - centre[..., None]) ** 2).sum(-1)
        spread = total - (w**2).sum(-1) / total
        between = np.sqrt(np.maximum(0.0, (scatter - freedom) / spread))
        weight = 1.0 / (uncertainties**2 + between[..., None] ** 2)
        weight /= weight.sum(-1, keepdims=True)
        return cls(
            values=values,
            uncertainties=uncertainties,
            mean=(weight * values).sum(-1),
            reading=np.sqrt(values.shape[-1] / total),
            scatter=scatter,
            freedom=freedom,
            between=between,
            variance_of_readings=(weight**2 * uncertainties**2).sum(-1),
            variance_of_between=(weight**2).sum(-1),
        )


def pooled_excess(scatter: float | FloatArray, freedom: int) -> FloatArray:
    """Return (τ / u)² that the baselines of all joints show together, beyond what chance explains.

    Args:
        scatter: Q, summed over the joints.
        freedom: degrees of freedom, summed likewise.

    Returns:
        Q / χ²(0.8) - 1, zero in four of five robots whose uncertainties are right.
    """
    quantile = special.chdtri(freedom, 1.0 - _POOLED_LEVEL)
    return np.maximum(0.0, np.asarray(scatter) / quantile - 1.0)


def plausible_between(baseline: Baseline, excess: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values of τ, and their probabilities given the baseline.

    Args:
        baseline: of one joint, or of many with leading axes.
        excess: (τ / u)² that all joints show together, as `pooled_excess` (...,).

    Returns:
        τ (..., G) and probabilities (..., G), which sum to 1.
    """
    scale = baseline.reading * np.sqrt(PRIOR_SCALE**2 + excess)
    steps = (np.arange(_NODES) + 0.5) * (_REACH / _NODES)
    tau = scale[..., None] * steps
    # ``-½ [Σ ln v_i + ln Σ 1/v_i + Σ (y_i - ŷ)²/v_i]``, v_i = u_i² + τ², for each τ (..., G)
    variance = baseline.uncertainties[..., None, :] ** 2 + tau[..., None] ** 2
    precision = 1.0 / variance
    total = precision.sum(-1)
    values = baseline.values[..., None, :]
    centre = (precision * values).sum(-1) / total
    squares = (precision * (values - centre[..., None]) ** 2).sum(-1)
    likelihood: FloatArray = -0.5 * (np.log(variance).sum(-1) + np.log(total) + squares)
    logarithm = -0.5 * steps**2 + likelihood
    weight = np.exp(logarithm - logarithm.max(-1, keepdims=True))
    return tau, weight / weight.sum(-1, keepdims=True)
