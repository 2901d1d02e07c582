"""Trend of a robot: campaigns put into charts by the numerical core, and its answers as messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import exp, hypot
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from jointstiff.schemas import trend as messages
from jointstiff.schemas.alarm import TrendChange
from jointstiff.schemas.assessment import Assessment
from jointstiff.solver.compare.trend import (
    FALSE_ALARMS,
    LIFE,
    Alarm,
    Change,
    Chart,
    Series,
    charts_of,
    log_stiffness,
)

_OPEN_INTERVAL = "the stiffness has no upper limit, or its uncertainty exceeds a quarter of it"


class JointBudget(BaseModel):
    """Part of a joint's budget that a trend reads."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    force_scale: float = 0.0
    assumed_load_point: float = 0.0


class JointNumbers(BaseModel):
    """Part of a joint's result that a trend reads."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    name: str
    status: str
    verdict: str
    compliance: float | None
    standard_uncertainty: float | None
    budget: JointBudget | None = None
    stiffness: float | None
    stiffness_interval: tuple[float, float | None] | None
    reason: str | None


@dataclass(frozen=True)
class Campaign:
    """A campaign that enters a trend."""

    run_id: str
    set_id: str
    name: str
    at: datetime
    time_source: Literal["measured_at", "created_at"]
    assessment: Assessment  # assessment of its run
    joints: Mapping[str, JointNumbers]  # its run's results by name
    instrument: str | None = None  # instrument that the measurement set names, tracker and load cell


@dataclass(frozen=True)
class TrendInput:
    """Input of a trend."""

    names: Sequence[str]  # joints of the robot
    campaigns: Sequence[Campaign]  # oldest first
    # that were asked for, oldest first; the first campaigns are one by themselves
    baselines: Sequence[messages.TrendBaseline] = ()
    # latest of each alarm of this trend, by its first measurement set and joint
    acknowledgements: Mapping[tuple[str, str], messages.Acknowledgement] = field(default_factory=dict)


@dataclass(frozen=True)
class TrendNumbers:
    """The part of a trend that is computed."""

    campaigns: list[messages.TrendCampaign]
    baselines: list[messages.TrendBaseline]
    joints: list[messages.TrendJoint]
    false_alarms: messages.FalseAlarms
    note: str | None


@dataclass(frozen=True)
class _Part:
    """A joint's campaigns that are compared with one baseline."""

    baseline: int  # its index
    campaigns: list[int]  # indices of the campaigns in the series
    series: Series
    chart: Chart | None  # None where they are too few


def trend_of(given: TrendInput) -> TrendNumbers:
    """Chart all joints of a robot against each baseline."""
    baselines = _baselines(given)
    chosen = [_baseline_of(campaign.at, baselines) for campaign in given.campaigns]
    parts: dict[str, list[_Part]] = {name: [] for name in given.names}
    for index, baseline in enumerate(baselines):
        inside = [i for i, one in enumerate(chosen) if one == index]
        series = [_series(given, name, inside) for name in given.names]
        charts = charts_of([one for _, one in series], baseline.campaigns)
        for name, (kept, one), chart in zip(given.names, series, charts, strict=True):
            parts[name].append(_Part(index, kept, one, chart))
    joints = [_joint(given, name, parts[name], baselines) for name in given.names]
    counted = sum(1 for one in parts.values() if one and one[-1].chart is not None)
    return TrendNumbers(
        campaigns=[
            messages.TrendCampaign(
                run_id=one.run_id,
                measurement_set_id=one.set_id,
                name=one.name,
                at=one.at,
                time_source=one.time_source,
                baseline=index,
                assessment=one.assessment,
            )
            for one, index in zip(given.campaigns, chosen, strict=True)
        ],
        baselines=baselines,
        joints=joints,
        false_alarms=messages.FalseAlarms(probability=FALSE_ALARMS, campaigns=LIFE, joints=counted),
        note=_note(chosen, baselines),
    )


def _baselines(given: TrendInput) -> list[messages.TrendBaseline]:
    """Return the first campaigns, unless a baseline begins there, then what was asked for."""
    if not given.campaigns:
        return list(given.baselines)
    first = given.campaigns[0]
    if any(one.starts_at <= first.at for one in given.baselines):
        return list(given.baselines)
    implicit = messages.TrendBaseline(
        run_id=first.run_id,
        starts_at=first.at,
        campaigns=messages.LEAST_BASELINE,
        reason=None,
        set_by=None,
        set_at=None,
    )
    return [implicit, *given.baselines]


def _baseline_of(at: datetime, baselines: Sequence[messages.TrendBaseline]) -> int:
    return max(i for i, one in enumerate(baselines) if i == 0 or one.starts_at <= at)


def _series(given: TrendInput, name: str, inside: Sequence[int]) -> tuple[list[int], Series]:
    instruments = {given.campaigns[i].instrument for i in inside}
    same = len(instruments) == 1 and None not in instruments
    joints = {i: given.campaigns[i].joints.get(name) for i in inside}
    budgets = [joint.budget for joint in joints.values() if joint is not None and joint.budget is not None]
    # A load point of which no campaign states anything is that of the same hook in all of them.
    hook = all(budget.assumed_load_point > 0.0 for budget in budgets)
    numbers = ((i, _number(joint, same_load_cell=same, same_hook=hook)) for i, joint in joints.items())
    charted = [(i, number) for i, number in numbers if number is not None]
    values, uncertainties = np.array([number for _, number in charted]).reshape(-1, 2).T
    return [i for i, _ in charted], Series(values, uncertainties)


def _number(
    joint: JointNumbers | None, *, same_load_cell: bool = False, same_hook: bool = False
) -> tuple[float, float] | None:
    if joint is None or joint.status != "identified" or joint.verdict == "do_not_use":
        return None
    budget = joint.budget or JointBudget()
    shared = hypot(
        budget.assumed_load_point if same_hook else 0.0, budget.force_scale if same_load_cell else 0.0
    )
    return log_stiffness(joint.compliance, joint.standard_uncertainty, shared)


def _joint(
    given: TrendInput, name: str, parts: Sequence[_Part], baselines: Sequence[messages.TrendBaseline]
) -> messages.TrendJoint:
    points = [_bare_point(campaign.joints.get(name)) for campaign in given.campaigns]
    for part in parts:
        for place, i in enumerate(part.campaigns):
            points[i] = _point(points[i], part, place, baselines[part.baseline].campaigns)
    alarms = [alarm for part in parts for alarm in _alarms(given, name, part)]
    last = parts[-1] if parts else None
    chart = None if last is None else last.chart
    judged = chart is not None and last is not None and len(last.campaigns) > chart.size
    state: messages.JointState = "in_control" if judged else "unjudged"
    if last is not None and judged and alarms and alarms[-1].until is None:
        state = "alarm" if alarms[-1].acknowledgement is None else "acknowledged"
    return messages.TrendJoint(
        name=name,
        state=state,
        points=points,
        charts=[_chart(part.baseline, part.chart) for part in parts if part.chart is not None],
        alarms=alarms,
        latest=_change(chart.change(len(last.campaigns) - 1)) if chart and last and judged else None,
        pair=_pair(last) if last is not None and chart is None else None,
    )


def _bare_point(joint: JointNumbers | None) -> messages.TrendPoint:
    return messages.TrendPoint(
        stiffness=None if joint is None else joint.stiffness,
        interval=None if joint is None else joint.stiffness_interval,
        role="not_charted",
        reason=_why_not(joint),
        smoothed=None,
        lower_limit=None,
        upper_limit=None,
        exceeded=False,
        change=None,
    )


def _why_not(joint: JointNumbers | None) -> str | None:
    if joint is None:
        return "the run has no such joint"
    if joint.status != "identified":
        return joint.reason or f"the joint is {joint.status.replace('_', ' ')}"
    if joint.verdict == "do_not_use":
        return joint.reason or "its verdict is: do not use"
    return None if _number(joint) else _OPEN_INTERVAL


def _point(bare: messages.TrendPoint, part: _Part, place: int, size: int) -> messages.TrendPoint:
    chart = part.chart
    if place < size:
        return bare.model_copy(update={"role": "baseline"})
    if chart is None:
        return bare
    t = place - chart.size
    mean, limit = float(chart.baseline.mean), float(chart.limits[t])
    return bare.model_copy(
        update={
            "role": "monitored",
            "smoothed": exp(mean + float(chart.monitored.deviation[t])),
            "lower_limit": exp(mean - limit),
            "upper_limit": exp(mean + limit),
            "exceeded": bool(chart.monitored.exceeded[t]),
            "change": _change(chart.change(place)),
        }
    )


def _chart(baseline: int, chart: Chart) -> messages.TrendChart:
    return messages.TrendChart(
        baseline=baseline,
        stiffness=exp(float(chart.baseline.mean)),
        relative_uncertainty=chart.baseline_uncertainty,
        between=float(chart.baseline.between),
    )


def _alarms(given: TrendInput, name: str, part: _Part) -> list[messages.TrendAlarm]:
    alarms = [] if part.chart is None else part.chart.alarms
    return [_alarm(given, name, part, alarm) for alarm in alarms]


def _alarm(given: TrendInput, name: str, part: _Part, alarm: Alarm) -> messages.TrendAlarm:
    first, last = (given.campaigns[part.campaigns[i]] for i in (alarm.first, alarm.last))
    return messages.TrendAlarm(
        run_id=first.run_id,
        since=first.at,
        until=None if alarm.is_open else last.at,
        change=_change(alarm.change),
        message=alarm.in_words(name, f"{first.at:%Y-%m-%d}"),
        acknowledgement=given.acknowledgements.get((first.set_id, name)),
    )


def _change(change: Change) -> TrendChange:
    return TrendChange(relative=change.relative, standard_uncertainty=change.relative_uncertainty)


def _pair(part: _Part) -> messages.TrendPair | None:
    if len(part.campaigns) < 2:
        return None
    change = part.series.change(0, len(part.campaigns) - 1)
    return messages.TrendPair(change=_change(change), p_value=change.p_value)


def _note(chosen: Sequence[int], baselines: Sequence[messages.TrendBaseline]) -> str | None:
    """Return what the charts cannot say yet; None where they compare."""
    if not chosen:
        return "no campaign is charted: identify measurement sets of this robot by the same method"
    size, have = baselines[-1].campaigns, sum(1 for one in chosen if one == len(baselines) - 1)
    if have < size:
        return (
            f"the baseline has {have} of {size} campaigns: there is no chart yet, only a test of the latest "
            "campaign against the first"
        )
    if have == size:
        return "the baseline is complete; the next campaign is the first that is compared with it"
    return None
