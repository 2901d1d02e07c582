"""Charts of the joints' stiffness over campaigns: baseline, EWMA, limits and alarms.

Model: ``y_i = ln k_i = μ + b_i + e_i``, e_i ~ N(0, u_i²), b_i ~ N(0, τ²) between campaigns,
u_i from the readings. τ is estimated by DerSimonian and Laird (Controlled Clinical Trials 7, 1986), and may
be zero. Three campaigns hardly tell it, so that the limits average over it: a half-normal prior (Röver et
al., Research Synthesis Methods 12, 2021) times its restricted likelihood.

After the baseline ``z_t = (1 - λ_t) z_{t-1} + λ_t y_t``, z_0 the baseline's mean (Roberts, Technometrics 1,
1959). λ_t is λ for a campaign as precise as those of the baseline, less for one that says less. ``z_t - z_0``
is normal given τ, with the variance of its campaigns *and of the baseline* (Jones, Champ and Rigdon,
Technometrics 43, 2001). All arrays may have leading axes: charts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from math import exp, expm1, hypot, log, sqrt
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError

MOST_RELATIVE: Final = 0.25
"""Largest u(c) / c of a point in a chart: beyond it, ln c is neither normal nor free of bias (u² / 2)."""
_MOST_SHARED: Final = 0.999999
"""Largest share of an uncertainty that may be the same in all campaigns: readings always have their own."""
LEAST_BASELINE: Final = 3
"""Fewest campaigns of a baseline."""
PRIOR_SCALE: Final = 0.45
"""Scale of the prior of τ, in units of the readings' standard uncertainty. With the level below it keeps the
rate of false alarms for any τ (`python -m benchmarks trend`)."""
_POOLED_LEVEL: Final = 0.8
_NODES: Final = 48
_REACH: Final = 5.0
"""Scales of the prior that the nodes cover."""
SMOOTHING: Final = 0.2
"""λ, the weight of a campaign as precise as those of the baseline."""
FALSE_ALARMS: Final = 0.05
"""Probability of any false alarm of a robot in the life of its chart, at most, over all its joints."""
LIFE: Final = 20
"""Campaigns after the baseline for which that holds."""
_BISECTIONS: Final = 60


@dataclass(frozen=True)
class Change:
    """Change of ln k, with its standard uncertainty."""

    difference: float  #: difference of ln k
    standard_uncertainty: float  #: standard uncertainty of the difference

    @property
    def relative(self) -> float:
        """Relative change of the stiffness, such as -0.1 for a joint that is 10 % softer."""
        return exp(self.difference) - 1.0

    @property
    def relative_uncertainty(self) -> float:
        """Standard uncertainty of the relative change."""
        return exp(self.difference) * self.standard_uncertainty

    @property
    def p_value(self) -> float:
        """Probability of a change at least as large if the stiffness is the same (two-sided)."""
        return float(2.0 * special.ndtr(-abs(self.difference) / self.standard_uncertainty))

    def in_words(self) -> str:
        """Return the relative change with its standard uncertainty, in percent."""
        word = "softer" if self.difference < 0 else "stiffer"
        return f"{100.0 * abs(self.relative):.1f} ± {100.0 * self.relative_uncertainty:.1f} % {word}"


@dataclass(frozen=True, eq=False)
class Series:
    """Stiffness of one joint over its campaigns, oldest first."""

    values: FloatArray  #: ln k (m,), k in N·m/rad
    uncertainties: FloatArray  #: standard uncertainties of ln k (m,), positive

    def change(self, first: int, second: int) -> Change:
        """Return the change between two campaigns: a test of the pair, with the readings' noise alone."""
        u = self.uncertainties
        return Change(float(self.values[second] - self.values[first]), hypot(u[first], u[second]))


def log_stiffness(
    compliance: float | None, standard_uncertainty: float | None, shared: float = 0.0
) -> tuple[float, float] | None:
    """Return ln k = -ln c and its standard uncertainty u(c) / c.

    Compliance is what the readings determine; its logarithm has the same relative uncertainty as that of
    the stiffness, and no greatest value has to be made up for a joint that may be rigid.

    Args:
        compliance: [rad/(N·m)].
        standard_uncertainty: of the compliance [rad/(N·m)].
        shared: part of it that is the same error in all campaigns, such as the scale of one load cell
            [rad/(N·m)]: no difference between campaigns holds it.

    Returns:
        None for a joint without a number, for a rigid one, and where the campaign's own part of u(c) / c
        exceeds `MOST_RELATIVE`: an interval of such a stiffness is open or nearly so.
    """
    if compliance is None or standard_uncertainty is None or not compliance > 0:
        return None
    own = standard_uncertainty**2 - min(shared, _MOST_SHARED * standard_uncertainty) ** 2
    relative = sqrt(own) / compliance
    return (-log(compliance), relative) if 0 < relative <= MOST_RELATIVE else None


@dataclass(frozen=True, eq=False)
class Baseline:
    """Mean of a baseline's campaigns. Shapes (...,) are those of the leading axes."""

    values: FloatArray  #: ln k of its campaigns (..., m)
    uncertainties: FloatArray  #: standard uncertainties of ln k (..., m)
    mean: FloatArray  #: weighted mean of ln k (...,)
    #: standard uncertainty of one campaign from its readings, root of the harmonic mean (...,)
    reading: FloatArray
    scatter: FloatArray  #: Q = Σ (y_i - ȳ)² / u_i² (...,), χ² with m - 1 degrees of freedom if τ = 0
    between: FloatArray  #: τ by DerSimonian and Laird (...,), zero where the campaigns agree
    variance_of_readings: FloatArray  #: var(mean) if τ = 0 (...,)
    variance_of_between: FloatArray  #: increase of var(mean) by τ², over τ² (...,)

    @classmethod
    def of(cls, values: FloatArray, uncertainties: FloatArray) -> Baseline:
        """Return the baseline of campaigns (..., m) with standard uncertainties (..., m)."""
        w = uncertainties**-2.0
        total = w.sum(-1)
        centre = (w * values).sum(-1) / total
        scatter = (w * (values - centre[..., None]) ** 2).sum(-1)
        spread = total - (w**2).sum(-1) / total
        between = np.sqrt(np.maximum(0.0, (scatter - (values.shape[-1] - 1)) / spread))
        weight = 1.0 / (uncertainties**2 + between[..., None] ** 2)
        weight /= weight.sum(-1, keepdims=True)
        return cls(
            values=values,
            uncertainties=uncertainties,
            mean=(weight * values).sum(-1),
            reading=np.sqrt(values.shape[-1] / total),
            scatter=scatter,
            between=between,
            variance_of_readings=(weight**2 * uncertainties**2).sum(-1),
            variance_of_between=(weight**2).sum(-1),
        )

    def plausible_between(self, excess: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values of τ (..., G), and their probabilities (..., G) given the baseline, which sum to 1.

        Args:
            excess: (τ / u)² that all joints show together, as `pooled_excess` (...,).
        """
        scale = self.reading * np.sqrt(PRIOR_SCALE**2 + excess)
        steps = (np.arange(_NODES) + 0.5) * (_REACH / _NODES)
        tau = scale[..., None] * steps
        # ``-½ [Σ ln v_i + ln Σ 1/v_i + Σ (y_i - ŷ)²/v_i]``, v_i = u_i² + τ², for each τ (..., G)
        variance = self.uncertainties[..., None, :] ** 2 + tau[..., None] ** 2
        precision = 1.0 / variance
        total = precision.sum(-1)
        values = self.values[..., None, :]
        centre = (precision * values).sum(-1) / total
        squares = (precision * (values - centre[..., None]) ** 2).sum(-1)
        likelihood: FloatArray = -0.5 * (np.log(variance).sum(-1) + np.log(total) + squares)
        logarithm = -0.5 * steps**2 + likelihood
        weight = np.exp(logarithm - logarithm.max(-1, keepdims=True))
        return tau, weight / weight.sum(-1, keepdims=True)


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


def alarm_level(joints: int) -> float:
    """Return the probability of a false alarm at one campaign of one joint.

    The sum over joints and campaigns bounds the probability of any false alarm, however they depend on
    each other (Boole's inequality).
    """
    return FALSE_ALARMS / (LIFE * max(1, joints))


@dataclass(frozen=True, eq=False)
class Monitored:
    """EWMA of the campaigns after the baseline, with leading axes (...,)."""

    deviation: FloatArray  #: EWMA minus the baseline's mean (..., N)
    readings: FloatArray  #: its variance if τ = 0 (..., N)
    between: FloatArray  #: increase of that variance by τ², over τ² (..., N)
    tau: FloatArray  #: plausible τ (..., G)
    probability: FloatArray  #: probabilities of these values (..., G)
    level: float  #: probability of a false alarm at one campaign

    @property
    def tau_square(self) -> FloatArray:
        """Mean of τ² over its plausible values (...,)."""
        return np.asarray((self.probability * self.tau**2).sum(-1))

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Standard uncertainty of the deviation, over the plausible τ (..., N)."""
        return np.asarray(np.sqrt(self.readings + self.between * self.tau_square[..., None]))

    @property
    def exceeded(self) -> BoolArray:
        """(..., N) whether the deviation is beyond its limit."""
        return np.asarray(self._chance(np.abs(self.deviation)) < self.level)

    @property
    def limits(self) -> FloatArray:
        """Deviations (..., N) that chance exceeds with the probability `level`, by bisection."""
        low: FloatArray = np.zeros_like(self.deviation)
        high: FloatArray = 40.0 * np.sqrt(self.readings + self.between * self.tau.max(-1, keepdims=True) ** 2)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            inside = self._chance(middle) > self.level
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return high

    def _chance(self, deviation: FloatArray) -> FloatArray:
        """Return the probability of a larger deviation (..., N), averaged over τ."""
        spread = np.sqrt(self.readings[..., None] + self.between[..., None] * self.tau[..., None, :] ** 2)
        tails = special.ndtr(-deviation[..., None] / spread)
        return np.asarray(2.0 * (self.probability[..., None, :] * tails).sum(-1))


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
    deviation, readings, between = (np.empty_like(values) for _ in range(3))
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
    return Monitored(deviation, readings, between, *baseline.plausible_between(excess), level)


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
            f"{joint} is {self.latest.in_words()} than its baseline (± standard uncertainty); "
            f"the average of its campaigns (EWMA) is {self.change.in_words()}, "
            f"beyond the limit of {allowed:.1f} %, since {since}"
        )


@dataclass(frozen=True, eq=False)
class Chart:
    """Chart of one joint."""

    series: Series  #: all its campaigns: those of the baseline, then those after it
    baseline: Baseline  #: baseline of the first campaigns
    size: int  #: how many they are
    monitored: Monitored  #: campaigns after the baseline
    limits: FloatArray  #: limits of their deviation (N,)

    @property
    def baseline_uncertainty(self) -> float:
        """Standard uncertainty of the baseline's mean, scatter between campaigns included."""
        scatter = self.monitored.tau_square * self.baseline.variance_of_between
        return float(np.sqrt(self.baseline.variance_of_readings + scatter))

    def change(self, campaign: int) -> Change:
        """Return the change of one campaign (index into the series) against the baseline's mean."""
        u = self.series.uncertainties[campaign]
        spread = np.sqrt(u**2 + self.monitored.tau_square + self.baseline_uncertainty**2)
        return Change(float(self.series.values[campaign] - self.baseline.mean), float(spread))

    @property
    def alarms(self) -> list[Alarm]:
        """Alarms, oldest first."""
        monitored = self.monitored
        deviation, uncertainty = monitored.deviation, monitored.standard_uncertainty
        signs = np.where(monitored.exceeded, np.sign(deviation), 0.0)
        alarms = []
        for sign, run in groupby(range(signs.size), key=lambda t: signs[t]):
            places = list(run)
            first, last = places[0], places[-1]
            if sign:
                alarms.append(
                    Alarm(
                        first=self.size + first,
                        last=self.size + last,
                        is_open=last + 1 == signs.size,
                        change=Change(float(deviation[last]), float(uncertainty[last])),
                        latest=self.change(self.size + last),
                        limit=float(self.limits[last]),
                    )
                )
        return alarms


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
    baselines = [
        Baseline.of(one.values[:size], one.uncertainties[:size]) if one.values.size >= size else None
        for one in series
    ]
    scatters = [float(one.scatter) for one in baselines if one is not None]
    excess, level = pooled_excess(sum(scatters), len(scatters) * (size - 1)), alarm_level(len(scatters))
    charts: list[Chart | None] = []
    for one, baseline in zip(series, baselines, strict=True):
        if baseline is None:
            charts.append(None)
            continue
        monitored = monitor(baseline, excess, one.values[size:], one.uncertainties[size:], level)
        charts.append(Chart(one, baseline, size, monitored, monitored.limits))
    return charts
