"""Charts of the joints' stiffness over campaigns: baseline, EWMA, limits and alarms."""

from __future__ import annotations

from jointstiff.solver.trend.alarms import Alarm, alarms_of
from jointstiff.solver.trend.baseline import LEAST_BASELINE
from jointstiff.solver.trend.chart import Chart, charts_of
from jointstiff.solver.trend.monitor import FALSE_ALARMS, LIFE, Monitored, alarm_level, monitor
from jointstiff.solver.trend.series import MOST_RELATIVE, Change, Series, change_between, log_stiffness

__all__ = [
    "FALSE_ALARMS",
    "LEAST_BASELINE",
    "LIFE",
    "MOST_RELATIVE",
    "Alarm",
    "Change",
    "Chart",
    "Monitored",
    "Series",
    "alarm_level",
    "alarms_of",
    "change_between",
    "charts_of",
    "log_stiffness",
    "monitor",
]
