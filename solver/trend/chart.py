"""Charts of all joints of a robot, controlled together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
