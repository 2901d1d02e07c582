"""Runs that may stand in one trend, sorted out with reasons; and the notes in it, as the store keeps them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict

from jointstiff.schemas import trend as messages
from jointstiff.schemas.assessment import Assessment
from jointstiff.schemas.job import Requester
from jointstiff.schemas.options import Method, Weighting
from jointstiff.service.kinds.trend.work import Campaign, JointNumbers
from jointstiff.service.store.records import JobEntry, MeasurementSetEntry, TrendNote


class _Part(BaseModel):
    """Part of a stored document; the rest of it is not looked at."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Numbers(_Part):
    joints: list[JointNumbers]
    assessment: Assessment
    links: dict[str, object] | None


class _Options(_Part):
    method: Method
    weighting: Weighting
    positive: bool
    complementary_stiffness: Literal["neglected", "included"]
    priors: dict[str, object]
    stiffness_bounds: dict[str, object]
    stiffness_order: list[object]
    weight: dict[str, object] | None = None


class ReadRun(_Part):
    """Part of a run that a trend reads."""

    request: _Options
    result: _Numbers


@dataclass(frozen=True)
class Candidate:
    """A run, and the set that it identified."""

    entry: JobEntry
    run: ReadRun
    measured: MeasurementSetEntry

    @property
    def at(self) -> datetime:
        """Time of the measurement; where the set does not say, when it was stored."""
        return self.measured.measured_at or self.measured.created_at

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


def selection_of(
    runs: Iterable[Sequence[Candidate]], query: messages.TrendQuery
) -> messages.TrendSelection | None:
    """Return what was asked for, completed by the newest campaign that has it."""
    filters = query.model_dump(exclude_none=True)
    fitting = [
        one
        for candidates in runs
        for one in candidates
        if _unfit(one) is None and filters.items() <= one.selection.model_dump().items()
    ]
    newest = max(fitting, key=lambda one: (one.at, one.entry.created_at), default=None)
    return None if newest is None else newest.selection


def selections_of(runs: Iterable[Sequence[Candidate]], least: int) -> list[messages.TrendSelection]:
    """Return what trends of so many campaigns at least share, that of the newest campaign first."""
    newest: dict[messages.TrendSelection, list[tuple[datetime, datetime]]] = {}
    for candidates in runs:
        for selection, one in {one.selection: one for one in candidates if _unfit(one) is None}.items():
            newest.setdefault(selection, []).append((one.at, one.entry.created_at))
    selections = [selection for selection, times in newest.items() if len(times) >= least]
    return sorted(selections, key=lambda selection: max(newest[selection]), reverse=True)


def _unfit(candidate: Candidate) -> str | None:
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
    runs: Mapping[str, Sequence[Candidate]],
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
    return [_campaign(candidate) for candidate in entering], left_out


def _difference(candidate: Candidate, selection: messages.TrendSelection | None) -> str | None:
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


def _campaign(candidate: Candidate) -> Campaign:
    measured = candidate.measured
    return Campaign(
        run_id=candidate.entry.id,
        set_id=measured.id,
        name=measured.name,
        at=candidate.at,
        time_source="created_at" if measured.measured_at is None else "measured_at",
        assessment=candidate.run.result.assessment,
        joints={joint.name: joint for joint in candidate.run.result.joints},
        instrument=measured.instrument,
    )


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
