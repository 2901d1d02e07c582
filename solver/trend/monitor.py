"""EWMA of the campaigns after a baseline, and the limits that it may reach by chance.

``z_t = (1 - λ_t) z_{t-1} + λ_t y_t``, z_0 the baseline's mean (Roberts, Technometrics 1, 1959). λ_t is λ for
a campaign as precise as those of the baseline, less for one that says less. ``z_t - z_0`` is normal given
τ, with the variance of its campaigns *and of the baseline* (Jones, Champ and Rigdon, Technometrics 43, 2001).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.trend.baseline import Baseline, plausible_between

SMOOTHING: Final = 0.2
"""λ, the weight of a campaign as precise as those of the baseline."""
FALSE_ALARMS: Final = 0.05
"""Probability of any false alarm of a robot in the life of its chart, at most, over all its joints."""
LIFE: Final = 20
"""Campaigns after the baseline for which that holds."""
_BISECTIONS: Final = 60


def alarm_level(joints: int) -> float:
    """Return the probability of a false alarm at one campaign of one joint.

    The sum over joints and campaigns bounds the probability of any false alarm, however they depend on
    each other (Boole's inequality).
    """
    return FALSE_ALARMS / (LIFE * max(1, joints))


@dataclass(frozen=True)
class Monitored:
    """EWMA of the campaigns after the baseline, with leading axes (...,)."""

    deviation: FloatArray  #: EWMA minus the baseline's mean (..., N)
    readings: FloatArray  #: its variance if τ = 0 (..., N)
    between: FloatArray  #: what τ² adds to it, over τ² (..., N)
    tau: FloatArray  #: plausible τ (..., G)
    probability: FloatArray  #: theirs (..., G)
    exceeded: BoolArray  #: whether the deviation is beyond its limit (..., N)

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Standard uncertainty of the deviation, over the plausible τ (..., N)."""
        square = (self.probability * self.tau**2).sum(-1)[..., None]
        uncertainty: FloatArray = np.sqrt(self.readings + self.between * square)
        return uncertainty

    def limits(self, level: float) -> FloatArray:
        """Return the deviations (..., N) that chance exceeds with the probability `level`, by bisection."""
        low: FloatArray = np.zeros_like(self.deviation)
        high: FloatArray = 40.0 * np.sqrt(self.readings + self.between * self.tau.max(-1, keepdims=True) ** 2)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            inside = _chance(middle, self.readings, self.between, self.tau, self.probability) > level
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return high


def monitor(
    baseline: Baseline, excess: FloatArray, values: FloatArray, uncertainties: FloatArray, level: float
) -> Monitored:
    """Follow the campaigns after a baseline.

    Args:
        baseline: of the same leading axes (...,).
        excess: (τ / u)² that the baselines of all joints show together (...,).
        values: ln k of the campaigns (..., N), oldest first.
        uncertainties: of theirs (..., N).
        level: probability of a false alarm at one campaign.
    """
    deviation = np.empty_like(values)
    readings, between = np.empty_like(values), np.empty_like(values)
    tau, probability = plausible_between(baseline, excess)
    # λ_t = λ w_t / (λ w_t + (1 - λ) w), w the weight of a campaign of the baseline (..., N)
    between_square = baseline.between[..., None] ** 2
    weight = (baseline.reading[..., None] ** 2 + between_square) / (uncertainties**2 + between_square)
    smoothing: FloatArray = SMOOTHING * weight / (SMOOTHING * weight + 1.0 - SMOOTHING)
    z, reach, square, noise = (np.zeros_like(baseline.mean) for _ in range(4))
    for t in range(values.shape[-1]):
        a = smoothing[..., t]
        z = (1.0 - a) * z + a * (values[..., t] - baseline.mean)
        reach = (1.0 - a) * reach + a
        square = (1.0 - a) ** 2 * square + a**2
        noise = (1.0 - a) ** 2 * noise + a**2 * uncertainties[..., t] ** 2
        deviation[..., t] = z
        readings[..., t] = noise + reach**2 * baseline.variance_of_readings
        between[..., t] = square + reach**2 * baseline.variance_of_between
    exceeded = _chance(np.abs(deviation), readings, between, tau, probability) < level
    return Monitored(deviation, readings, between, tau, probability, exceeded)


def _chance(
    deviation: FloatArray, readings: FloatArray, between: FloatArray, tau: FloatArray, probability: FloatArray
) -> FloatArray:
    """Return the probability of a larger deviation (..., N), averaged over τ."""
    spread = np.sqrt(readings[..., None] + between[..., None] * tau[..., None, :] ** 2)
    tails = special.ndtr(-deviation[..., None] / spread)
    chance: FloatArray = 2.0 * (probability[..., None, :] * tails).sum(-1)
    return chance
