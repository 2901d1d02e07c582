"""Trends: comparable runs out of the store put into charts, new baselines and acknowledged alarms into it."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property, lru_cache
from math import exp, hypot
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, ConfigDict

from jointstiff.schemas import trend as messages
from jointstiff.schemas.finding import Assessment
from jointstiff.schemas.job import Requester
from jointstiff.schemas.robot import OpenAlarm, TrendChange
from jointstiff.schemas.run import JointResult, Run, RunRequest, UncertaintyBudget
from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.resources.stored import described
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import JobEntry, MeasurementSetEntry, TrendNote
from jointstiff.solver.compare.campaigns import (
    FALSE_ALARMS,
    LIFE,
    Alarm,
    Change,
    Chart,
    Series,
    charts_of,
    log_stiffness,
)
from jointstiff.solver.errors import RequestError

_RUNS: Final = Resource(Run.kind, Run.collection)
_AT_ONCE: Final = 200
_MOST_RUNS: Final = 2_000
_MOST_ROBOTS: Final = 200
_REMEMBERED: Final = 2_000
_STATES: Final[Mapping[messages.JointState, int]] = {
    "alarm": 0,
    "acknowledged": 1,
    "in_control": 2,
    "unjudged": 3,
}


_OPEN_INTERVAL = "the stiffness has no upper limit, or its uncertainty exceeds a quarter of it"


class _Part(BaseModel):
    """Part of a stored document; the rest of it is not looked at."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Numbers(_Part):
    joints: list[JointResult]
    assessment: Assessment
    links: dict[str, object] | None


class ReadRun(_Part):
    """Part of a run that a trend reads."""

    request: RunRequest
    result: _Numbers


@dataclass(frozen=True)
class Campaign:
    """A run, and the set that it identified."""

    run_id: str
    created_at: datetime  # when the run was posted
    run: ReadRun
    measured: MeasurementSetEntry

    @property
    def at(self) -> datetime:
        """Time of the measurement; where the set does not say, when it was stored."""
        return self.measured.measured_at or self.measured.created_at

    @cached_property
    def joints(self) -> Mapping[str, JointResult]:
        """Results of the run by the joints' names."""
        return {joint.name: joint for joint in self.run.result.joints}

    @property
    def selection(self) -> messages.TrendSelection:
        """Common ground that it must share with the others of a trend."""
        request = self.run.request
        return messages.TrendSelection(
            serial_number=self.measured.serial_number,
            method=request.method,
            weighting=request.weighting,
            positive=request.positive,
            encoders="secondary" if self.measured.encoders == "secondary" else "motor",
            complementary_stiffness=request.complementary_stiffness,
        )


@dataclass(frozen=True)
class _Segment:
    """A joint's campaigns that are compared with one baseline."""

    baseline: int  # its index
    campaigns: list[int]  # indices of the campaigns in the series
    series: Series
    chart: Chart | None  # None where they are too few


def trend_of(
    names: Sequence[str],
    campaigns: Sequence[Campaign],
    notes: Sequence[messages.TrendBaseline] = (),
    acknowledgements: Mapping[tuple[str, str], messages.Acknowledgement] = MappingProxyType({}),
) -> dict[str, Any]:
    """Chart all joints of a robot against each baseline; return the fields of a trend that this makes.

    Args:
        names: joints of the robot.
        campaigns: campaigns that enter, oldest first.
        notes: baselines that were asked for, oldest first; the first campaigns are one by themselves.
        acknowledgements: latest of each alarm of this trend, by its first measurement set and joint.
    """
    baselines = _baselines(campaigns, notes)
    begun = [
        [i for i, one in enumerate(baselines) if i == 0 or one.starts_at <= each.at] for each in campaigns
    ]
    chosen = [indices[-1] for indices in begun]
    parts: dict[str, list[_Segment]] = {name: [] for name in names}
    for index, baseline in enumerate(baselines):
        inside = [i for i, one in enumerate(chosen) if one == index]
        series = [_series(campaigns, name, inside) for name in names]
        charts = charts_of([one for _, one in series], baseline.campaigns)
        for name, (kept, one), chart in zip(names, series, charts, strict=True):
            parts[name].append(_Segment(index, kept, one, chart))
    counted = sum(1 for one in parts.values() if one and one[-1].chart is not None)
    return {
        "campaigns": [
            messages.TrendCampaign(
                run_id=one.run_id,
                measurement_set_id=one.measured.id,
                name=one.measured.name,
                at=one.at,
                time_source="created_at" if one.measured.measured_at is None else "measured_at",
                baseline=index,
                assessment=one.run.result.assessment,
            )
            for one, index in zip(campaigns, chosen, strict=True)
        ],
        "baselines": baselines,
        "joints": [_joint(campaigns, acknowledgements, name, parts[name], baselines) for name in names],
        "false_alarms": messages.FalseAlarms(probability=FALSE_ALARMS, campaigns=LIFE, joints=counted),
        "note": _note(chosen, baselines),
    }


def _baselines(
    campaigns: Sequence[Campaign], stated: Sequence[messages.TrendBaseline]
) -> list[messages.TrendBaseline]:
    """Return the first campaigns, unless a baseline begins there, then what was asked for."""
    if not campaigns or any(one.starts_at <= campaigns[0].at for one in stated):
        return list(stated)
    first = messages.TrendBaseline(
        run_id=campaigns[0].run_id,
        starts_at=campaigns[0].at,
        campaigns=messages.LEAST_BASELINE,
    )
    return [first, *stated]


def _series(campaigns: Sequence[Campaign], name: str, inside: Sequence[int]) -> tuple[list[int], Series]:
    instruments = {campaigns[i].measured.instrument for i in inside}
    same = len(instruments) == 1 and None not in instruments
    joints = {i: campaigns[i].joints.get(name) for i in inside}
    budgets = [joint.budget for joint in joints.values() if joint is not None and joint.budget is not None]
    # A load point of which no campaign states anything is that of the same hook in all of them.
    hook = all(budget.assumed_load_point > 0.0 for budget in budgets)
    cell = all(budget.assumed_force_scale > 0.0 for budget in budgets)  # and that of one load cell
    numbers = (
        (i, _number(joint, same_load_cell=same, same_hook=hook, assumed_cell=cell))
        for i, joint in joints.items()
    )
    charted = [(i, number) for i, number in numbers if number is not None]
    values, uncertainties = np.array([number for _, number in charted]).reshape(-1, 2).T
    return [i for i, _ in charted], Series(values, uncertainties)


def _number(
    joint: JointResult | None,
    *,
    same_load_cell: bool = False,
    same_hook: bool = False,
    assumed_cell: bool = False,
) -> tuple[float, float] | None:
    if joint is None or joint.status != "identified" or joint.verdict == "do_not_use":
        return None
    budget = joint.budget or UncertaintyBudget(readings=0.0)
    shared = hypot(
        budget.assumed_load_point if same_hook else 0.0,
        budget.force_scale if same_load_cell else 0.0,
        budget.assumed_force_scale if assumed_cell else 0.0,
    )
    return log_stiffness(joint.compliance, joint.standard_uncertainty, shared)


def _joint(
    campaigns: Sequence[Campaign],
    acknowledgements: Mapping[tuple[str, str], messages.Acknowledgement],
    name: str,
    parts: Sequence[_Segment],
    baselines: Sequence[messages.TrendBaseline],
) -> messages.TrendJoint:
    points = [_bare_point(campaign.joints.get(name)) for campaign in campaigns]
    for part in parts:
        for place, i in enumerate(part.campaigns):
            points[i] = _point(points[i], part, place, baselines[part.baseline].campaigns)
    alarms = [
        _alarm(campaigns, acknowledgements, name, part, alarm)
        for part in parts
        for alarm in (part.chart.alarms if part.chart else ())
    ]
    last = parts[-1] if parts else None
    chart = None if last is None else last.chart
    judged = chart is not None and last is not None and len(last.campaigns) > chart.size
    state: messages.JointState = "in_control" if judged else "unjudged"
    if last is not None and judged and alarms and alarms[-1].until is None:
        state = "alarm" if alarms[-1].acknowledgement is None else "acknowledged"
    return messages.TrendJoint(
        name=name,
        kind=next((one.joints[name].kind for one in campaigns if name in one.joints), "revolute"),
        state=state,
        points=points,
        charts=[
            messages.TrendChart(
                baseline=part.baseline,
                stiffness=exp(float(part.chart.baseline.mean)),
                relative_uncertainty=part.chart.baseline_uncertainty,
                between=float(part.chart.baseline.between),
            )
            for part in parts
            if part.chart is not None
        ],
        alarms=alarms,
        latest=_change(chart.change(len(last.campaigns) - 1)) if chart and last and judged else None,
        pair=_pair(last) if last is not None and chart is None else None,
    )


def _bare_point(joint: JointResult | None) -> messages.TrendPoint:
    """Return a joint in a campaign beside the chart, with the reason why it has no place in one."""
    if joint is None:
        return messages.TrendPoint(reason="the run has no such joint")
    reason = None if _number(joint) else _OPEN_INTERVAL
    if joint.status != "identified":
        reason = joint.reason or f"the joint is {joint.status.replace('_', ' ')}"
    elif joint.verdict == "do_not_use":
        reason = joint.reason or "its verdict is: do not use"
    return messages.TrendPoint(stiffness=joint.stiffness, interval=joint.stiffness_interval, reason=reason)


def _point(bare: messages.TrendPoint, part: _Segment, place: int, size: int) -> messages.TrendPoint:
    chart = part.chart
    if place < size:
        return bare.model_copy(update={"role": "baseline"})
    if chart is None:
        return bare
    t = place - chart.size
    mean, limit = float(chart.baseline.mean), float(chart.monitored.limits[t])
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


def _alarm(
    campaigns: Sequence[Campaign],
    acknowledgements: Mapping[tuple[str, str], messages.Acknowledgement],
    name: str,
    part: _Segment,
    alarm: Alarm,
) -> messages.TrendAlarm:
    first, last = (campaigns[part.campaigns[i]] for i in (alarm.first, alarm.last))
    return messages.TrendAlarm(
        run_id=first.run_id,
        since=first.at,
        until=None if alarm.is_open else last.at,
        change=_change(alarm.change),
        message=alarm.in_words(name, f"{first.at:%Y-%m-%d}"),
        acknowledgement=acknowledgements.get((first.measured.id, name)),
    )


def _change(change: Change) -> TrendChange:
    return TrendChange(relative=change.relative, standard_uncertainty=change.relative_uncertainty)


def _pair(part: _Segment) -> messages.TrendPair | None:
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
        return f"{have} of {size} reference campaigns: no chart, only a test of the latest against the first"
    if have == size:
        return "the reference campaigns are complete: the next campaign is the first compared with them"
    return None


def selection_of(
    runs: Iterable[Sequence[Campaign]], query: messages.TrendQuery
) -> messages.TrendSelection | None:
    """Return what was asked for, completed by the newest campaign that has it."""
    filters = query.model_dump(exclude_none=True)
    fitting = [
        one
        for candidates in runs
        for one in candidates
        if _unfit(one) is None and filters.items() <= one.selection.model_dump().items()
    ]
    newest = max(fitting, key=lambda one: (one.at, one.created_at), default=None)
    return None if newest is None else newest.selection


def selections_of(runs: Iterable[Sequence[Campaign]], least: int) -> list[messages.TrendSelection]:
    """Return what trends of so many campaigns at least share, that of the newest campaign first."""
    newest: dict[messages.TrendSelection, list[tuple[datetime, datetime]]] = {}
    for candidates in runs:
        for selection, one in {one.selection: one for one in candidates if _unfit(one) is None}.items():
            newest.setdefault(selection, []).append((one.at, one.created_at))
    selections = [selection for selection, times in newest.items() if len(times) >= least]
    return sorted(selections, key=lambda selection: max(newest[selection]), reverse=True)


def _unfit(candidate: Campaign) -> str | None:
    """Return why a run enters no trend at all; None if it may."""
    request, result = candidate.run.request, candidate.run.result
    verdict = result.assessment
    if verdict.verdict == "do_not_use":
        why = f" ({verdict.reasons[0].message})" if verdict.reasons else ""
        return f"its assessment is: do not use{why}"
    if result.links is not None:
        return "it has elastic links or coupling, so its joint stiffnesses are effective values"
    if request.weight is not None:
        return "it is by own weight, so that an error of the masses shifts all stiffnesses"
    for name, value in (
        ("priors", request.priors),
        ("bounds of the stiffness", request.stiffness_bounds),
        ("an order of the joints", request.stiffness_order),
    ):
        if value:
            return f"it was identified with {name}, which shift the stiffnesses"
    return None


def sorted_out(
    sets: Sequence[MeasurementSetEntry],
    runs: Mapping[str, Sequence[Campaign]],
    selection: messages.TrendSelection | None,
) -> tuple[list[Campaign], list[messages.LeftOut]]:
    """Return the campaigns of a trend, oldest first, and why others are none."""
    entering, left_out = [], []
    for one in sets:
        candidates = runs.get(one.id, ())
        fitting = [c for c in candidates if _difference(c, selection) is None]
        if fitting:
            entering.append(fitting[0])
        else:
            reason = _difference(candidates[0], selection) if candidates else "it has no run with stiffnesses"
            left_out.append(messages.LeftOut(measurement_set_id=one.id, name=one.name, reason=reason or ""))
    entering.sort(key=lambda candidate: (candidate.at, candidate.measured.created_at))
    return entering, left_out


def _difference(candidate: Campaign, selection: messages.TrendSelection | None) -> str | None:
    """Return why a run is not comparable; None if it is."""
    if (unfit := _unfit(candidate)) is not None or selection is None:
        return unfit or "no run of it matches the query"
    mine, wanted = candidate.selection.model_dump(), selection.model_dump()
    differing = [name for name in wanted if mine[name] != wanted[name]]
    return ", ".join(f"{name.replace('_', ' ')}: {_shown(mine[name])}" for name in differing) or None


def _shown(value: object) -> str:
    if value is None:
        return "not stated"
    return ("yes" if value else "no") if isinstance(value, bool) else str(value).replace("_", " ")


def note_of(
    robot_id: str, kind: str, document: Mapping[str, object], by: Requester | None, now: datetime
) -> TrendNote:
    """Return a note as the store keeps it."""
    return TrendNote(
        robot_id=robot_id,
        kind=kind,
        noted_at=now,
        key_id=None if by is None else by.key_id,
        key_name=None if by is None else by.key_name,
        document=json.dumps(document),
    )


def _by(note: TrendNote) -> Requester | None:
    if note.key_id is None or note.key_name is None:
        return None
    return Requester(key_id=note.key_id, key_name=note.key_name)


def baselines_of(
    notes: Iterable[TrendNote], selection: messages.TrendSelection, sets: Iterable[MeasurementSetEntry]
) -> list[messages.TrendBaseline]:
    """Return the baselines of a serial number by time; of two from the same campaign on, the later one."""
    times = {one.id: one.measured_at or one.created_at for one in sets}
    baselines: dict[datetime, messages.TrendBaseline] = {}
    for note in notes:
        document = json.loads(note.document)
        if note.kind != "baseline" or document["serial_number"] != selection.serial_number:
            continue
        gone = document["measurement_set_id"] not in times
        at = times.get(document["measurement_set_id"]) or datetime.fromisoformat(document["starts_at"])
        baselines[at] = messages.TrendBaseline(
            run_id=None if gone else document["run_id"],
            starts_at=at,
            campaigns=document["campaigns"],
            reason=document["reason"],
            set_by=_by(note),
            set_at=note.noted_at,
        )
    return [baselines[at] for at in sorted(baselines)]


def acknowledgements_of(
    notes: Iterable[TrendNote], selection: messages.TrendSelection
) -> dict[tuple[str, str], messages.Acknowledgement]:
    """Return the latest acknowledgement of each alarm of a trend, by its first measurement set and joint.

    That of the same joint by another method, weighting or constraint is another alarm.
    """
    acknowledgements = {}
    for note in notes:
        if note.kind == "acknowledgement":
            document = json.loads(note.document)
            if document["selection"] != selection.model_dump():
                continue
            acknowledgements[document["measurement_set_id"], str(document["joint"])] = (
                messages.Acknowledgement(
                    note=document["note"], acknowledged_by=_by(note), acknowledged_at=note.noted_at
                )
            )
    return acknowledgements


@dataclass(frozen=True)
class _Ground:
    """Data of a robot's trends, looked up once."""

    names: list[str]  # names of its joints
    stored: list[MeasurementSetEntry]  # its sets that are not archived
    archived: list[MeasurementSetEntry]  # those that are
    notes: list[TrendNote]  # in its trends
    sets: list[MeasurementSetEntry]  # sets of `stored`, those that are looked at
    runs: dict[str, list[Campaign]]  # with numbers, of `sets`

    def by_serial_number(self) -> Iterator[tuple[str, _Ground]]:
        """Yield each serial number with its sets and runs alone: a robot may stand for thousands of arms."""
        entries: dict[str, list[MeasurementSetEntry]] = {}
        for one in self.sets:
            if one.serial_number is not None:
                entries.setdefault(one.serial_number, []).append(one)
        for number in sorted(entries):
            runs = {one.id: self.runs[one.id] for one in entries[number] if one.id in self.runs}
            yield number, replace(self, archived=[], sets=entries[number], runs=runs)


class Trends:
    """The trends of a store's robots."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._read = lru_cache(_REMEMBERED)(self._parse)  # a run never changes once it has ended
        self._open = lru_cache(_REMEMBERED)(self._derive)  # by what the alarms are derived from

    def trend(self, robot_id: str, query: messages.TrendQuery) -> messages.Trend:
        """Return the trend of a robot.

        Raises:
            NotFoundError: there is no such robot.
        """
        ground = self._ground(robot_id)
        return self._trend(robot_id, ground, selection_of(ground.runs.values(), query))

    def _ground(self, robot_id: str) -> _Ground:
        names = [joint.name for joint in described(self._store.robots.get(robot_id)).joints]
        sets = list(self._sets(robot_id))
        return _Ground(
            names=names,
            stored=sets,
            archived=list(self._sets(robot_id, archived=True)),
            notes=self._store.trend_notes.of(robot_id=robot_id),
            sets=sets,
            runs=self._candidates(robot_id, sets),
        )

    def _trend(
        self, robot_id: str, ground: _Ground, selection: messages.TrendSelection | None
    ) -> messages.Trend:
        sets, notes = ground.sets, ground.notes
        entering, left_out = sorted_out(sets, ground.runs, selection)
        left_out += [  # else an alarm could be put away without a trace
            messages.LeftOut(measurement_set_id=one.id, name=one.name, reason="it is archived")
            for one in ground.archived
        ]
        baselines = [] if selection is None else baselines_of(notes, selection, ground.stored)
        acknowledgements = {} if selection is None else acknowledgements_of(notes, selection)
        return messages.Trend(
            robot_id=robot_id,
            selection=selection,
            serial_numbers=sorted({one.serial_number for one in sets if one.serial_number is not None}),
            left_out=left_out,
            **trend_of(ground.names, entering, baselines, acknowledgements),
        )

    def note(
        self, robot_id: str, request: messages.TrendNoteRequest, by: Requester | None
    ) -> messages.TrendBaseline | messages.Acknowledgement:
        """Begin a new baseline, or note that an alarm was seen; raises as these do."""
        if isinstance(request.root, messages.BaselineRequest):
            return self.add_baseline(robot_id, request.root, by)
        return self.acknowledge(robot_id, request.root, by)

    def add_baseline(
        self, robot_id: str, request: messages.BaselineRequest, by: Requester | None
    ) -> messages.TrendBaseline:
        """Begin a new baseline with a campaign; the charts before it stay.

        Raises:
            NotFoundError: there is no such robot.
            RequestError: it has no such run, or the run has no numbers.
        """
        candidate = self._run(robot_id, request.run_id)
        now = datetime.now(UTC)
        document = request.model_dump() | {
            "measurement_set_id": candidate.measured.id,
            "serial_number": candidate.measured.serial_number,
            "starts_at": candidate.at.isoformat(),
        }
        self._store.trend_notes.add(note_of(robot_id, "baseline", document, by, now))
        return messages.TrendBaseline(
            run_id=request.run_id,
            starts_at=candidate.at,
            campaigns=request.campaigns,
            reason=request.reason,
            set_by=by,
            set_at=now,
        )

    def acknowledge(
        self, robot_id: str, request: messages.AcknowledgementRequest, by: Requester | None
    ) -> messages.Acknowledgement:
        """Note that somebody has seen an alarm.

        Raises:
            NotFoundError: there is no such robot.
            RequestError: it has no such run, or no alarm of that joint begins with it.
        """
        candidate = self._run(robot_id, request.run_id)
        filters = candidate.selection.model_dump(exclude={"complementary_stiffness"})
        trend = self.trend(robot_id, messages.TrendQuery(**filters))
        alarms = (one for joint in trend.joints if joint.name == request.joint for one in joint.alarms)
        if all(alarm.run_id != request.run_id for alarm in alarms):
            raise RequestError(
                f"no alarm of '{request.joint}' begins with run '{request.run_id}'",
                where="run_id",
                remedy="give joint and `run_id` of an alarm in the trend",
            )
        now = datetime.now(UTC)
        document = request.model_dump() | {
            "measurement_set_id": candidate.measured.id,
            "selection": candidate.selection.model_dump(),
        }
        self._store.trend_notes.add(note_of(robot_id, "acknowledgement", document, by, now))
        return messages.Acknowledgement(note=request.note, acknowledged_by=by, acknowledged_at=now)

    def alarms(self, robot_ids: Collection[str]) -> dict[str, list[OpenAlarm]]:
        """Return the alarms of robots that last and that nobody has acknowledged; most robots have none."""
        least = messages.LEAST_BASELINE + 1
        marks = self._store.trend_marks(robot_ids, least)
        found = {robot_id: self._open(robot_id, mark) for robot_id, mark in marks.items()}
        return {robot_id: alarms for robot_id, alarms in found.items() if alarms}

    def alarms_of(self, robot_id: str, serial_number: str | None) -> list[OpenAlarm]:
        """Return those of one arm: a robot may stand for many."""
        alarms = self.alarms([robot_id]).get(robot_id, [])
        return [alarm for alarm in alarms if alarm.serial_number == serial_number]

    def _derive(self, robot_id: str, _mark: str) -> list[OpenAlarm]:
        """Return the alarms of all trends of a robot; of a joint in several of them that of the newest."""
        ground = self._ground(robot_id)
        arms = dict(ground.by_serial_number())
        alarms: dict[tuple[str | None, str], OpenAlarm] = {}
        for selection in selections_of(ground.runs.values(), messages.LEAST_BASELINE + 1):
            trend = self._trend(robot_id, arms.get(selection.serial_number or "", ground), selection)
            sets = {campaign.run_id: campaign.measurement_set_id for campaign in trend.campaigns}
            for joint in trend.joints:
                if joint.state == "alarm":
                    alarm = joint.alarms[-1]
                    shown = OpenAlarm(
                        serial_number=selection.serial_number,
                        joint=joint.name,
                        change=joint.latest or alarm.change,
                        since=alarm.since,
                        run_id=alarm.run_id,
                        measurement_set_id=sets[alarm.run_id],
                        message=alarm.message,
                    )
                    alarms.setdefault((selection.serial_number, joint.name), shown)
        return list(alarms.values())

    def sisters(
        self, robot_id: str, serial_number: str | None, encoders: str
    ) -> list[Mapping[str, JointResult]]:
        """Return the newest results of each other arm of the same kinematics, joints by their names.

        Only independent evidence: runs with priors or with the verdict `do_not_use` are left out, and joints
        without a number that can be used. A set without a serial number may be of any arm of its robot.

        Args:
            robot_id: of the arm.
            serial_number: of the arm; robots stand for an arm of each serial number.
            encoders: behind which joints' readings were taken; those of others do not compare.

        Raises:
            NotFoundError: there is no such robot.
        """
        own = self._store.robots.get(robot_id)
        twins = self._store.robots.page(limit=_MOST_ROBOTS, filters={"content_hash": own.content_hash})
        newest: dict[tuple[str, str | None], Campaign] = {}
        for twin in twins.records:
            for runs in self._candidates(twin.id, self._sets(twin.id)).values():
                own_runs = (each for each in runs if not each.run.request.priors)  # by own readings alone
                usable = (each for each in own_runs if each.run.result.assessment.verdict != "do_not_use")
                one = next(usable, None)
                if one is None:
                    continue
                number = one.measured.serial_number
                arm = twin.id, number
                alike = (one.selection.encoders == "secondary") == (encoders == "secondary")
                same = number == serial_number is not None
                own_run = same or (twin.id == robot_id and None in (number, serial_number))
                if alike and not own_run and (arm not in newest or one.at > newest[arm].at):
                    newest[arm] = one
        return [
            {name: joint for name, joint in one.joints.items() if _number(joint) is not None}
            for one in newest.values()
        ]

    def fleet(self) -> messages.Fleet:
        """Return a row for each robot and serial number, those in alarm first, those never measured last."""
        page = self._store.robots.page(limit=_MOST_ROBOTS)
        rows = [row for record in page.records for row in self._rows(record.id, record.name)]
        rows.sort(key=lambda row: (*_urgency(row.state, row.change, row.measured_at is not None), row.name))
        return messages.Fleet(items=rows, is_whole=page.next is None)

    def _rows(self, robot_id: str, name: str) -> Iterator[messages.FleetRow]:
        ground = self._ground(robot_id)
        newest = selection_of(ground.runs.values(), messages.TrendQuery())
        shown = None if newest is None else newest.serial_number
        yield _row(self._trend(robot_id, ground, newest), name, shown)
        for number, part in ground.by_serial_number():
            if number != shown:
                selection = selection_of(part.runs.values(), messages.TrendQuery())
                yield _row(self._trend(robot_id, part, selection), name, number)

    def _sets(self, robot_id: str, *, archived: bool = False) -> Iterator[MeasurementSetEntry]:
        filters, cursor = {"robot_id": robot_id}, None
        while True:
            page = self._store.sets.page(limit=_AT_ONCE, cursor=cursor, filters=filters, archived=archived)
            yield from page.records
            cursor = page.next
            if cursor is None:
                return

    def _candidates(self, robot_id: str, sets: Iterable[MeasurementSetEntry]) -> dict[str, list[Campaign]]:
        """Return the runs with numbers, newest first, by their sets."""
        known = {one.id: one for one in sets}
        candidates: dict[str, list[Campaign]] = {}
        for entry in self._entries(robot_id):
            set_id = str(entry.summary["measurement_set_id"])
            if set_id in known and (run := self._read(entry.id)) is not None:
                candidates.setdefault(set_id, []).append(
                    Campaign(entry.id, entry.created_at, run, known[set_id])
                )
        return candidates

    def _entries(self, robot_id: str) -> Iterator[JobEntry]:
        filters, cursor = {"robot_id": robot_id, "state": "succeeded"}, None
        for _ in range(_MOST_RUNS // _AT_ONCE):
            page = self._store.jobs(_RUNS).page(limit=_AT_ONCE, cursor=cursor, filters=filters)
            yield from page.records
            cursor = page.next
            if cursor is None:
                return

    def _parse(self, run_id: str) -> ReadRun | None:
        try:
            return ReadRun.model_validate_json(self._store.jobs(_RUNS).get(run_id).document)
        except NotFoundError:  # deleted meanwhile
            return None

    def _run(self, robot_id: str, run_id: str) -> Campaign:
        self._store.robots.get(robot_id)
        for candidates in self._candidates(robot_id, self._sets(robot_id)).values():
            for one in candidates:
                if one.run_id == run_id:
                    return one
        raise RequestError(
            f"the robot has no run '{run_id}' with stiffnesses",
            where="run_id",
            remedy="give the id of a succeeded run of this robot",
        )


def _row(trend: messages.Trend, name: str, serial_number: str | None) -> messages.FleetRow:
    worst = min(trend.joints, key=lambda joint: _urgency(joint.state, _change_of(joint), True), default=None)
    alarm = worst.alarms[-1] if worst is not None and worst.alarms else None
    return messages.FleetRow(
        robot_id=trend.robot_id,
        name=name,
        serial_number=serial_number,
        state="unjudged" if worst is None else worst.state,
        joint=None if worst is None or _change_of(worst) is None else worst.name,
        change=None if worst is None else _change_of(worst),
        alarm=None if alarm is None or alarm.until is not None else alarm.message,
        measured_at=trend.campaigns[-1].at if trend.campaigns else None,
        verdict=trend.campaigns[-1].assessment.verdict if trend.campaigns else None,
        campaigns=len(trend.campaigns),
        missing=trend.note,
    )


def _change_of(joint: messages.TrendJoint) -> TrendChange | None:
    return joint.latest or (None if joint.pair is None else joint.pair.change)


def _urgency(
    state: messages.JointState, change: TrendChange | None, measured: bool
) -> tuple[int, bool, float]:
    size = 0.0 if change is None else abs(change.relative) / change.standard_uncertainty
    return _STATES[state], not measured, -size
