"""Alarms of a chart: campaigns in a row whose EWMA is beyond its limit, with the reason in words."""

from __future__ import annotations

from dataclasses import dataclass
from math import expm1

import numpy as np

from jointstiff.solver.trend.chart import Chart
from jointstiff.solver.trend.series import Change


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
