"""Charts of all joints of a robot, controlled together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import expm1

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.trend.baseline import LEAST_BASELINE, Baseline, plausible_between, pooled_excess
from jointstiff.solver.trend.monitor import Monitored, alarm_level, monitor
from jointstiff.solver.trend.series import Change, Series


@dataclass(frozen=True)
class Chart:
    """Chart of one joint."""

    series: Series  #: all its campaigns: those of the baseline, then those after it
    baseline: Baseline  #: of the first campaigns
    size: int  #: how many they are
    #: standard uncertainty of the baseline's mean, scatter between campaigns included
    baseline_uncertainty: float
    between: float  #: root mean square of the plausible τ, in ln k
    monitored: Monitored  #: campaigns after the baseline
    limits: FloatArray  #: of their deviation (N,)

    def change(self, campaign: int) -> Change:
        """Return the change of one campaign (index into the series) against the baseline's mean."""
        u = self.series.uncertainties[campaign]
        spread = np.sqrt(u**2 + self.between**2 + self.baseline_uncertainty**2)
        return Change(float(self.series.values[campaign] - self.baseline.mean), float(spread))

    def smoothed_change(self, campaign: int) -> Change:
        """Return the change of the EWMA at one campaign after the baseline (index into the series)."""
        t = campaign - self.size
        found = self.monitored
        return Change(float(found.deviation[t]), float(found.standard_uncertainty[t]))


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
            f"a baseline of {size} campaigns does not tell chance from change",
            where="size",
            remedy=f"take {LEAST_BASELINE} campaigns or more; two are compared as a pair",
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
    latest: Change  #: of the last one itself
    limit: float  #: of that change of ln k

    def in_words(self, joint: str, since: str) -> str:
        """Return joint, change with its uncertainty, that of the EWMA with its limit, and the beginning.

        Args:
            joint: its name.
            since: day or name of the first campaign.
        """
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
    found: list[Alarm] = []
    start = 0
    for t, sign in enumerate(signs):
        if t and sign != signs[t - 1]:
            start = t
        ends = t + 1 == signs.size or signs[t + 1] != sign
        if sign and ends:
            first, last = start + chart.size, t + chart.size
            change, limit = chart.smoothed_change(last), float(chart.limits[t])
            found.append(Alarm(first, last, t + 1 == signs.size, change, chart.change(last), limit))
    return found
