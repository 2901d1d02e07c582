"""Trends of robots: comparable runs out of the store, new baselines and acknowledged alarms into it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from jointstiff.schemas import trend as messages
from jointstiff.schemas.job import Requester
from jointstiff.schemas.run import Method, Run, Weighting
from jointstiff.service.computation import Campaign, JointNumbers, TrendInput, trend_of
from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.resources.robots import described
from jointstiff.service.store import JobEntry, MeasurementSetEntry, Store, TrendNote
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


class _Part(BaseModel):
    """Part of a stored document; the rest of it is not looked at, whatever version wrote it."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Reason(_Part):
    message: str


class _Verdict(_Part):
    verdict: str
    reasons: list[_Reason]


class _Numbers(_Part):
    joints: list[JointNumbers]
    assessment: _Verdict | None = None


class _Options(_Part):
    method: Method
    weighting: Weighting
    positive: bool
    elasticity: str = "joints"
    complementary_stiffness: Literal["neglected", "included"] = "neglected"
    priors: dict[str, object] = {}
    stiffness_bounds: dict[str, object] = {}
    stiffness_order: list[object] = []


class _ReadRun(_Part):
    request: _Options
    result: _Numbers


@dataclass(frozen=True)
class _Candidate:
    """A run, and the set that it identified."""

    entry: JobEntry
    run: _ReadRun
    measured: MeasurementSetEntry

    @property
    def at(self) -> datetime:
        """Time of the measurement; where the set does not say, when it was stored."""
        return self.measured.measured_at or self.measured.created_at

    @property
    def selection(self) -> messages.TrendSelection:
        """Common ground that it must share with the others of a trend."""
        asked = self.run.request
        return messages.TrendSelection(
            serial_number=self.measured.serial_number,
            method=asked.method,
            weighting=asked.weighting,
            positive=asked.positive,
            encoders="secondary" if self.measured.encoders == "secondary" else "motor",
            complementary_stiffness=asked.complementary_stiffness,
        )


class Trends:
    """The trends of a store's robots."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._read = lru_cache(_REMEMBERED)(self._parse)  # a run never changes once it has ended

    def trend(self, robot_id: str, query: messages.TrendQuery) -> messages.Trend:
        """Return the trend of a robot.

        Raises:
            NotFoundError: there is no such robot.
        """
        names = [joint.name for joint in described(self._store.robots.get(robot_id)).joints]
        sets = list(self._sets(robot_id))
        runs = self._candidates(robot_id, sets)
        selection = _selection(runs.values(), query)
        entering, left_out = _sorted_out(sets, runs, selection)
        notes = self._store.trend_notes.of(robot_id)
        numbers = trend_of(
            TrendInput(
                names=names,
                campaigns=entering,
                baselines=[] if selection is None else _baselines(notes, selection, sets),
                acknowledgements=_acknowledgements(notes),
            )
        )
        return messages.Trend(
            robot_id=robot_id,
            selection=selection,
            serial_numbers=sorted({one.serial_number for one in sets if one.serial_number is not None}),
            campaigns=numbers.campaigns,
            baselines=numbers.baselines,
            joints=numbers.joints,
            false_alarms=numbers.false_alarms,
            left_out=left_out,
            note=numbers.note,
        )

    def add_baseline(
        self, robot_id: str, request: messages.BaselineRequest, by: Requester | None
    ) -> messages.TrendBaseline:
        """Begin a new baseline with a campaign; the charts before it stay.

        Raises:
            NotFoundError: there is no such robot.
            RequestError: it has no such run, or the run has no numbers.
        """
        found = self._run(robot_id, request.run_id)
        now = datetime.now(UTC)
        document = request.model_dump() | {
            "measurement_set_id": found.measured.id,
            "serial_number": found.measured.serial_number,
            "starts_at": found.at.isoformat(),
        }
        self._store.trend_notes.add(_note(robot_id, "baseline", document, by, now))
        return messages.TrendBaseline(
            run_id=request.run_id,
            starts_at=found.at,
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
        found = self._run(robot_id, request.run_id)
        asked = found.selection.model_dump(exclude={"complementary_stiffness"})
        trend = self.trend(robot_id, messages.TrendQuery(**asked))
        alarms = (one for joint in trend.joints if joint.name == request.joint for one in joint.alarms)
        if all(alarm.run_id != request.run_id for alarm in alarms):
            raise RequestError(
                f"no alarm of '{request.joint}' begins with run '{request.run_id}'",
                where="run_id",
                remedy="give joint and `run_id` of an alarm in the trend",
            )
        now = datetime.now(UTC)
        document = request.model_dump() | {"measurement_set_id": found.measured.id}
        self._store.trend_notes.add(_note(robot_id, "acknowledgement", document, by, now))
        return messages.Acknowledgement(note=request.note, acknowledged_by=by, acknowledged_at=now)

    def fleet(self) -> messages.Fleet:
        """Return a row for each robot and serial number, those in alarm first."""
        page = self._store.robots.page(limit=_MOST_ROBOTS)
        rows = [row for record in page.records for row in self._rows(record.id, record.name)]
        return messages.Fleet(items=sorted(rows, key=_urgency), is_whole=page.next is None)

    def _rows(self, robot_id: str, name: str) -> Iterator[messages.FleetRow]:
        first = self.trend(robot_id, messages.TrendQuery())
        shown = None if first.selection is None else first.selection.serial_number
        others = [number for number in first.serial_numbers if number != shown]
        yield _row(first, name)
        for number in others:
            yield _row(self.trend(robot_id, messages.TrendQuery(serial_number=number)), name, number)

    def _sets(self, robot_id: str) -> Iterator[MeasurementSetEntry]:
        cursor = None
        while True:
            page = self._store.sets.page(limit=_AT_ONCE, cursor=cursor, filters={"robot_id": robot_id})
            yield from page.records
            cursor = page.next
            if cursor is None:
                return

    def _candidates(self, robot_id: str, sets: Iterable[MeasurementSetEntry]) -> dict[str, list[_Candidate]]:
        """Return the runs with numbers, newest first, by their sets."""
        known = {one.id: one for one in sets}
        found: dict[str, list[_Candidate]] = {}
        for entry in self._entries(robot_id):
            set_id = str(entry.summary["measurement_set_id"])
            if set_id in known and (run := self._read(entry.id)) is not None:
                found.setdefault(set_id, []).append(_Candidate(entry, run, known[set_id]))
        return found

    def _entries(self, robot_id: str) -> Iterator[JobEntry]:
        filters, cursor = {"robot_id": robot_id, "state": "succeeded"}, None
        for _ in range(_MOST_RUNS // _AT_ONCE):
            page = self._store.jobs(_RUNS).page(limit=_AT_ONCE, cursor=cursor, filters=filters)
            yield from page.records
            cursor = page.next
            if cursor is None:
                return

    def _parse(self, run_id: str) -> _ReadRun | None:
        try:
            return _ReadRun.model_validate_json(self._store.jobs(_RUNS).get(run_id).document)
        except (ValidationError, NotFoundError):  # of another version, or deleted meanwhile
            return None

    def _run(self, robot_id: str, run_id: str) -> _Candidate:
        self._store.robots.get(robot_id)
        for candidates in self._candidates(robot_id, self._sets(robot_id)).values():
            for one in candidates:
                if one.entry.id == run_id:
                    return one
        raise RequestError(
            f"the robot has no run '{run_id}' with numbers",
            where="run_id",
            remedy="give the id of a succeeded run of this robot",
        )


def _selection(
    runs: Iterable[Sequence[_Candidate]], query: messages.TrendQuery
) -> messages.TrendSelection | None:
    """Return what was asked for, completed by the newest campaign that has it."""
    asked = query.model_dump(exclude_none=True)
    fitting = [
        one
        for candidates in runs
        for one in candidates
        if _unfit(one) is None and asked.items() <= one.selection.model_dump().items()
    ]
    newest = max(fitting, key=lambda one: (one.at, one.entry.created_at), default=None)
    return None if newest is None else newest.selection


def _unfit(candidate: _Candidate) -> str | None:
    """Return why a run enters no trend at all; None if it may."""
    asked, result = candidate.run.request, candidate.run.result
    verdict = result.assessment
    if verdict is not None and verdict.verdict == "do_not_use":
        why = f" ({verdict.reasons[0].message})" if verdict.reasons else ""
        return f"its assessment is: do not use{why}"
    if asked.elasticity != "joints":
        return "its links or coupling are elastic, so that its joints' numbers are effective ones"
    for name, stated in (
        ("priors", asked.priors),
        ("bounds of the stiffness", asked.stiffness_bounds),
        ("an order of the joints", asked.stiffness_order),
    ):
        if stated:
            return f"it was identified with {name}, which draw the numbers together"
    return None


def _sorted_out(
    sets: Sequence[MeasurementSetEntry],
    runs: Mapping[str, Sequence[_Candidate]],
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
            reason = _difference(candidates[0], selection) if candidates else "it has no run with numbers"
            left_out.append(messages.LeftOut(measurement_set_id=one.id, name=one.name, reason=reason or ""))
    entering.sort(key=lambda candidate: (candidate.at, candidate.measured.created_at))
    return [_campaign(candidate) for candidate in entering], left_out


def _difference(candidate: _Candidate, selection: messages.TrendSelection | None) -> str | None:
    """Return why a run is not comparable; None if it is."""
    if (unfit := _unfit(candidate)) is not None or selection is None:
        return unfit or "no run was found that fits the query"
    mine, wanted = candidate.selection.model_dump(), selection.model_dump()
    differing = [name for name in wanted if mine[name] != wanted[name]]
    return ", ".join(f"{name.replace('_', ' ')}: {_shown(mine[name])}" for name in differing) or None


def _shown(value: object) -> str:
    if value is None:
        return "not stated"
    return ("yes" if value else "no") if isinstance(value, bool) else str(value).replace("_", " ")


def _campaign(candidate: _Candidate) -> Campaign:
    measured = candidate.measured
    return Campaign(
        run_id=candidate.entry.id,
        set_id=measured.id,
        name=measured.name,
        at=candidate.at,
        time_source="created_at" if measured.measured_at is None else "measured_at",
        joints={joint.name: joint for joint in candidate.run.result.joints},
    )


def _note(
    robot_id: str, kind: str, document: Mapping[str, object], by: Requester | None, now: datetime
) -> TrendNote:
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


def _baselines(
    notes: Iterable[TrendNote], selection: messages.TrendSelection, sets: Iterable[MeasurementSetEntry]
) -> list[messages.TrendBaseline]:
    """Return the baselines of a serial number by time; of two from the same campaign on, the later one."""
    times = {one.id: one.measured_at or one.created_at for one in sets}
    found: dict[datetime, messages.TrendBaseline] = {}
    for note in notes:
        stated = json.loads(note.document)
        if note.kind != "baseline" or stated["serial_number"] != selection.serial_number:
            continue
        gone = stated["measurement_set_id"] not in times
        at = times.get(stated["measurement_set_id"]) or datetime.fromisoformat(stated["starts_at"])
        found[at] = messages.TrendBaseline(
            run_id=None if gone else stated["run_id"],
            starts_at=at,
            campaigns=stated["campaigns"],
            reason=stated["reason"],
            set_by=_by(note),
            set_at=note.noted_at,
        )
    return [found[at] for at in sorted(found)]


def _acknowledgements(notes: Iterable[TrendNote]) -> dict[tuple[str, str], messages.Acknowledgement]:
    found = {}
    for note in notes:
        if note.kind == "acknowledgement":
            stated = json.loads(note.document)
            found[stated["measurement_set_id"], str(stated["joint"])] = messages.Acknowledgement(
                note=stated["note"], acknowledged_by=_by(note), acknowledged_at=note.noted_at
            )
    return found


def _row(trend: messages.Trend, name: str, serial_number: str | None = None) -> messages.FleetRow:
    worst = min(trend.joints, key=_joint_urgency, default=None)
    alarm = worst.alarms[-1] if worst is not None and worst.alarms else None
    return messages.FleetRow(
        robot_id=trend.robot_id,
        name=name,
        serial_number=serial_number if trend.selection is None else trend.selection.serial_number,
        state="unjudged" if worst is None else worst.state,
        joint=None if worst is None or _change_of(worst) is None else worst.name,
        change=None if worst is None else _change_of(worst),
        alarm=None if alarm is None or alarm.until is not None else alarm.message,
        measured_at=trend.campaigns[-1].at if trend.campaigns else None,
        campaigns=len(trend.campaigns),
        missing=trend.note,
    )


def _change_of(joint: messages.TrendJoint) -> messages.TrendChange | None:
    return joint.latest or (None if joint.pair is None else joint.pair.change)


def _joint_urgency(joint: messages.TrendJoint) -> tuple[int, float]:
    change = _change_of(joint)
    size = 0.0 if change is None else abs(change.relative) / change.standard_uncertainty
    return _STATES[joint.state], -size


def _urgency(row: messages.FleetRow) -> tuple[int, float, str]:
    size = 0.0 if row.change is None else abs(row.change.relative) / row.change.standard_uncertainty
    return _STATES[row.state], -size, row.name
