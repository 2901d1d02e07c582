"""Notes in trends, between messages and the store: new baselines and acknowledged alarms."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from datetime import datetime

from jointstiff.schemas import trend as messages
from jointstiff.schemas.job import Requester
from jointstiff.service.store.records import MeasurementSetEntry, TrendNote


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


def acknowledgements_of(
    notes: Iterable[TrendNote], selection: messages.TrendSelection
) -> dict[tuple[str, str], messages.Acknowledgement]:
    """Return the latest acknowledgement of each alarm of a trend, by its first measurement set and joint.

    That of the same joint by another method, weighting or constraint is another alarm.
    """
    found = {}
    for note in notes:
        if note.kind == "acknowledgement":
            stated = json.loads(note.document)
            if stated["selection"] != selection.model_dump():
                continue
            found[stated["measurement_set_id"], str(stated["joint"])] = messages.Acknowledgement(
                note=stated["note"], acknowledged_by=_by(note), acknowledged_at=note.noted_at
            )
    return found
