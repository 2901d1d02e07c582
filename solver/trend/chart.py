"""Charts of all joints of a robot, controlled together.

EWMA of the campaigns after a baseline, and the limits that it may reach by chance.

``z_t = (1 - λ_t) z_{t-1} + λ_t y_t``, z_0 the baseline's mean (Roberts, Technometrics 1, 1959). λ_t is λ for
a campaign as precise as those of the baseline, less for one that says less. ``z_t - z_0`` is normal given
τ, with the variance of its campaigns *and of the baseline* (Jones, Champ and Rigdon, Technometrics 43, 2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import expm1
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.trend.baseline import LEAST_BASELINE, Baseline, plausible_between, pooled_excess
from jointstiff.solver.trend.series import Change, Series

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
    between: FloatArray  #: increase of that variance by τ², over τ² (..., N)
    tau: FloatArray  #: plausible τ (..., G)
    probability: FloatArray  #: probabilities of these values (..., G)
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


@dataclass(frozen=True)
class Chart:
    """Chart of one joint."""

    series: Series  #: all its campaigns: those of the baseline, then those after it
    baseline: Baseline  #: baseline of the first campaigns
    size: int  #: how many they are
    #: standard uncertainty of the baseline's mean, scatter between campaigns included
    baseline_uncertainty: float
    between: float  #: root mean square of the plausible τ, in ln k
    monitored: Monitored  #: campaigns after the baseline
    limits: FloatArray  #: limits of their deviation (N,)

    def change(self, campaign: int) -> Change:
        """Return the change of one campaign (index into the series) against the baseline's mean."""
        u = self.series.uncertainties[campaign]
        spread = np.sqrt(u**2 + self.between**2 + self.baseline_uncertainty**2)
        return Change(float(self.series.values[campaign] - self.baseline.mean), float(spread))

    def smoothed_change(self, campaign: int) -> Change:
        """Return the change of the EWMA at one campaign after the baseline (index into the series)."""
        t = campaign - self.size
        monitored = self.monitored
        return Change(float(monitored.deviation[t]), float(monitored.standard_uncertainty[t]))


def charts_of(series: Sequence[Series], size: int) -> list[Chart | None]:
    """Return the chart of each joint, all controlled together.

    Args:
        series: of each joint, from the baseline's first campaign on.
        size: campaigns of the baseline.

    Returns:
        None for a joint with fewer campaigns than the baseline takes.

    Raises:
        RequestError: a baseline takes fewer than three campaigns.
    """
    if size < LEAST_BASELINE:
        raise RequestError(
            f"a baseline of {size} campaigns cannot distinguish chance from change",
            where="size",
            remedy=f"use at least {LEAST_BASELINE} campaigns; compare two campaigns as a pair",
        )
    enough = [one for one in series if one.values.size >= size]
    baselines = [Baseline.of(one.values[:size], one.uncertainties[:size]) for one in enough]
    freedom = sum(baseline.freedom for baseline in baselines)
    excess = pooled_excess(sum(float(one.scatter) for one in baselines), freedom) if freedom else np.zeros(())
    level = alarm_level(len(baselines))
    found = iter(
        [_chart(one, baseline, size, excess, level) for one, baseline in zip(enough, baselines, strict=True)]
    )
    return [next(found) if one.values.size >= size else None for one in series]


def _chart(series: Series, baseline: Baseline, size: int, excess: FloatArray, level: float) -> Chart:
    monitored = monitor(baseline, excess, series.values[size:], series.uncertainties[size:], level)
    tau, probability = plausible_between(baseline, excess)
    square = float((probability * tau**2).sum())
    variance = float(baseline.variance_of_readings + square * baseline.variance_of_between)
    return Chart(
        series=series,
        baseline=baseline,
        size=size,
        baseline_uncertainty=variance**0.5,
        between=square**0.5,
        monitored=monitored,
        limits=monitored.limits(level),
    )


@dataclass(frozen=True)
class Alarm:
    """Campaigns in a row beyond the limit, on one side."""

    first: int  #: index of the first one in the series
    last: int  #: index of the last one
    is_open: bool  #: whether the latest campaign is one of them
    change: Change  #: of the EWMA against the baseline at the last one; it lags behind that of the joint
    latest: Change  #: change of the last campaign itself
    limit: float  #: limit of that change of ln k

    def in_words(self, joint: str, since: str) -> str:
        """Return joint, change with its uncertainty, that of the EWMA with its limit, and the beginning."""
        allowed = 100.0 * abs(expm1(np.copysign(self.limit, self.change.difference)))
        return (
            f"{joint} is {_sized(self.latest)} than its baseline (± standard uncertainty); "
            f"the average of its campaigns (EWMA) is {_sized(self.change)}, "
            f"beyond the limit of {allowed:.1f} %, since {since}"
        )


def _sized(change: Change) -> str:
    word = "softer" if change.difference < 0 else "stiffer"
    return f"{100.0 * abs(change.relative):.1f} ± {100.0 * change.relative_uncertainty:.1f} % {word}"


def alarms_of(chart: Chart) -> list[Alarm]:
    """Return the alarms of a chart, oldest first."""
    signs = np.where(chart.monitored.exceeded, np.sign(chart.monitored.deviation), 0.0)
    alarms: list[Alarm] = []
    start = 0
    for t, sign in enumerate(signs):
        if t and sign != signs[t - 1]:
            start = t
        ends = t + 1 == signs.size or signs[t + 1] != sign
        if sign and ends:
            first, last = start + chart.size, t + chart.size
            change, limit = chart.smoothed_change(last), float(chart.limits[t])
            alarms.append(Alarm(first, last, t + 1 == signs.size, change, chart.change(last), limit))
    return alarms
