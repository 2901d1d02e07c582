"""Measurement sets as resources: checked and inspected when they come in; their readings never change."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from typing import Final
from uuid import uuid4

from jointstiff.schemas import measurement as messages
from jointstiff.schemas.measurement import SetChange, SetMetadata
from jointstiff.service.conversion.prepared import PreparedSet, check_set, in_base, without
from jointstiff.service.conversion.readings import ReadingArrays, hash_of, to_measurements
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.resources.frames import FRAME_CODES, resolve_frame
from jointstiff.service.resources.robots import Robots
from jointstiff.service.store.records import IdempotencyKey, MeasurementSetRecord
from jointstiff.service.store.store import Store
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.robot.model import Robot

_CACHED = 16
_METADATA: Final = tuple(SetMetadata.model_fields)
_COLUMNS: Final = ("name", "archived", *_METADATA)
"""Fields of a set that may change: they stand in columns, and not in the document."""


class MeasurementSets:
    """The measurement sets of a store."""

    def __init__(self, store: Store, robots: Robots) -> None:
        self._store = store
        self._robots = robots
        self._deletions = store.deletions(store.sets.resource)
        self._prepared = lru_cache(_CACHED)(self._prepare)

    def create(
        self, request: messages.MeasurementSetRequest, key: IdempotencyKey | None
    ) -> MeasurementSetRecord:
        """Check a set, look for the usual mistakes, and store it with what was found.

        Raises:
            MeasurementError: the set cannot be used; with the place and the remedy.
            RequestError: its frame names a geometry that is not there.
            IdempotencyConflictError: the key came before with another body.
        """
        if key is not None and (before := self._store.sets.find(key)) is not None:
            return before
        robot = self._robot(request.robot_id)
        resolved, drift = resolve_frame(self._store, request)
        checked = check_set(request, robot, resolved, drift)
        stored = messages.StoredMeasurementSet(
            **request.model_dump(exclude={"observations"}),
            id=uuid4().hex,
            resolved_frame=resolved,
            warnings=checked.warnings,
            content_hash=checked.content_hash,
            created_at=datetime.now(UTC),
        )
        return self._store.sets.add(
            MeasurementSetRecord(
                id=stored.id,
                robot_id=stored.robot_id,
                name=stored.name,
                encoders=stored.encoders,
                observation_count=len(checked.readings.labels),
                warning_count=len(stored.warnings),
                created_at=stored.created_at,
                content_hash=stored.content_hash,
                document=stored.model_dump_json(exclude={*_METADATA, "archived"}),
                arrays=checked.readings.pack(),
                **{name: getattr(stored, name) for name in _METADATA},
            ),
            key,
        )

    def change(self, set_id: str, change: SetChange) -> MeasurementSetRecord:
        """Change name, metadata or place of a set; its readings, hash and runs stay as they are.

        Raises:
            NotFoundError: there is no such set.
            DeletedError: it was deleted.
        """
        changes = {name: getattr(change, name) for name in change.model_fields_set}
        kept = {name for name in ("name", "archived") if changes.get(name) is None}
        return self._store.sets.change(set_id, {n: value for n, value in changes.items() if n not in kept})

    def delete(self, set_id: str) -> None:
        """Hide a set that no job refers to; to do so again changes nothing.

        Raises:
            NotFoundError: there is no such set.
            ReferencedError: jobs refer to it.
        """
        self._deletions.delete(set_id, datetime.now(UTC))
        self._prepared.cache_clear()

    def restore(self, set_id: str) -> messages.MeasurementSet:
        """Bring a deleted set back, and return it; to do so again changes nothing.

        Raises:
            NotFoundError: there is no such set, or it has been removed for good.
            DeletedError: its robot is deleted.
        """
        self._deletions.restore(set_id)
        return self.document(set_id)

    def document(self, set_id: str) -> messages.MeasurementSet:
        """The set as it was posted, with what was noticed.

        Raises:
            NotFoundError: there is no such set.
        """
        return assembled(self._store.sets.get(set_id))

    def prepared(self, set_id: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a set ready for computation.

        Args:
            set_id: its id.
            leave_out: labels of observations that are left out; the others are inspected without them.

        Raises:
            NotFoundError: there is no such set.
            RequestError: it has no observation of such a label, or none remains.
        """
        return self._without(set_id, frozenset(leave_out)) if leave_out else self._prepared(set_id)

    def _without(self, set_id: str, labels: frozenset[str]) -> PreparedSet:
        stored = self.document(set_id)
        kept = without(stored.observations, labels)
        robot, robot_hash = self._robots.load(stored.robot_id)
        noticed = [warning for warning in stored.warnings if warning.code in FRAME_CODES]
        checked = check_set(
            stored.model_copy(update={"observations": kept}), robot, stored.resolved_frame, noticed
        )
        content = hash_of(robot_hash, checked.content_hash)
        return PreparedSet(robot, checked.measurements, checked.warnings, stored.robot_id, content)

    def _prepare(self, set_id: str) -> PreparedSet:
        record = self._store.sets.get(set_id)
        stored = messages.StoredMeasurementSet.model_validate_json(record.document)
        readings = ReadingArrays.unpack(record.arrays)
        robot, robot_hash = self._robots.load(stored.robot_id)
        return PreparedSet(
            robot=robot,
            measurements=to_measurements(*in_base(stored, readings, stored.resolved_frame), robot),
            warnings=stored.warnings,
            robot_id=stored.robot_id,
            content=hash_of(robot_hash, stored.content_hash),
        )

    def _robot(self, robot_id: str) -> Robot:
        try:
            return self._robots.load(robot_id)[0]
        except NotFoundError as error:
            raise MeasurementError(error.reason, remedy=error.remedy, where="robot_id") from error


def assembled(record: MeasurementSetRecord) -> messages.MeasurementSet:
    """The message of a stored set."""
    stored = messages.StoredMeasurementSet.model_validate_json(record.document)
    observations = ReadingArrays.unpack(record.arrays).observations()
    parts = {name: getattr(stored, name) for name in messages.StoredMeasurementSet.model_fields}
    parts |= {name: getattr(record, name) for name in _COLUMNS}
    # Both parts were validated when they were stored.
    return messages.MeasurementSet.model_construct(**parts, observations=observations)
