"""Trends of robots: comparable runs out of the store, new baselines and acknowledged alarms into it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from typing import Final

from jointstiff.schemas import trend as messages
from jointstiff.schemas.alarm import OpenAlarm, TrendChange
from jointstiff.schemas.job import Requester
from jointstiff.schemas.run import Run
from jointstiff.service.kinds.trend.comparable_runs import (
    Candidate,
    ReadRun,
    acknowledgements_of,
    baselines_of,
    note_of,
    selection_of,
    selections_of,
    sorted_out,
)
from jointstiff.service.kinds.trend.work import TrendInput, trend_of
from jointstiff.service.problems.errors import NotFoundError, Resource
from jointstiff.service.resources.robots import described
from jointstiff.service.store.records import JobEntry, MeasurementSetEntry, TrendNote
from jointstiff.service.store.store import Store
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


@dataclass(frozen=True)
class _Ground:
    """Data of a robot's trends, looked up once."""

    names: list[str]  # names of its joints
    stored: list[MeasurementSetEntry]  # its sets that are not archived
    archived: list[MeasurementSetEntry]  # those that are
    notes: list[TrendNote]  # in its trends
    sets: list[MeasurementSetEntry]  # sets of `stored`, those that are looked at
    runs: dict[str, list[Candidate]]  # with numbers, of `sets`

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
        numbers = trend_of(
            TrendInput(
                names=ground.names,
                campaigns=entering,
                baselines=[] if selection is None else baselines_of(notes, selection, ground.stored),
                acknowledgements={} if selection is None else acknowledgements_of(notes, selection),
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

    def fleet(self) -> messages.Fleet:
        """Return a row for each robot and serial number, those in alarm first."""
        page = self._store.robots.page(limit=_MOST_ROBOTS)
        rows = [row for record in page.records for row in self._rows(record.id, record.name)]
        return messages.Fleet(items=sorted(rows, key=_urgency), is_whole=page.next is None)

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

    def _candidates(self, robot_id: str, sets: Iterable[MeasurementSetEntry]) -> dict[str, list[Candidate]]:
        """Return the runs with numbers, newest first, by their sets."""
        known = {one.id: one for one in sets}
        candidates: dict[str, list[Candidate]] = {}
        for entry in self._entries(robot_id):
            set_id = str(entry.summary["measurement_set_id"])
            if set_id in known and (run := self._read(entry.id)) is not None:
                candidates.setdefault(set_id, []).append(Candidate(entry, run, known[set_id]))
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

    def _run(self, robot_id: str, run_id: str) -> Candidate:
        self._store.robots.get(robot_id)
        for candidates in self._candidates(robot_id, self._sets(robot_id)).values():
            for one in candidates:
                if one.entry.id == run_id:
                    return one
        raise RequestError(
            f"the robot has no run '{run_id}' with stiffnesses",
            where="run_id",
            remedy="give the id of a succeeded run of this robot",
        )


def _row(trend: messages.Trend, name: str, serial_number: str | None) -> messages.FleetRow:
    worst = min(trend.joints, key=_joint_urgency, default=None)
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


def _joint_urgency(joint: messages.TrendJoint) -> tuple[int, float]:
    change = _change_of(joint)
    size = 0.0 if change is None else abs(change.relative) / change.standard_uncertainty
    return _STATES[joint.state], -size


def _urgency(row: messages.FleetRow) -> tuple[int, float, str]:
    size = 0.0 if row.change is None else abs(row.change.relative) / row.change.standard_uncertainty
    return _STATES[row.state], -size, row.name
