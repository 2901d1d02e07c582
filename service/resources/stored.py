"""Robots and measurement sets of a store: checked when posted, loaded when a request names them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from functools import lru_cache, partial
from typing import Any, Final, Generic, NamedTuple, TypeVar
from uuid import uuid4

import numpy as np
import pinocchio as pin

from jointstiff.schemas import measurement as messages
from jointstiff.schemas import robot as robots
from jointstiff.schemas.fields import ResourceChange, Vector3
from jointstiff.schemas.finding import Finding, FindingCode
from jointstiff.schemas.geometry import Drift, Geometry, GeometryRequest, GeometryResult
from jointstiff.schemas.job import Job
from jointstiff.schemas.live import MeasurementSet
from jointstiff.schemas.measurement import Frame, MeasurementSetRequest, ResolvedFrame, Rigid, SetMetadata
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.prepared import (
    PreparedRobot,
    PreparedSet,
    build_robot,
    check_set,
    frame_fields,
    leave_out_observations,
    prepare_robot,
    read_stated_transform,
    to_base_targets,
    to_resolved_frame,
    transform_to_base,
)
from jointstiff.service.conversion.readings import ReadingArrays, hash_texts
from jointstiff.service.conversion.robots import describe_joints
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.resources.inputs import MeasuredRun, NamedSet
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.service.store.collection import MEASUREMENT_SET, Collection
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import (
    Entry,
    IdempotencyKey,
    MeasurementSetEntry,
    MeasurementSetRecord,
    Record,
    RobotEntry,
    RobotRecord,
)
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.geometry.identification import report_drift
from jointstiff.solver.mechanics.postures import find_wrist
from jointstiff.solver.mechanics.robot import KnownRobot, Robot

AnyJob = TypeVar("AnyJob", bound=Job)
Prepared = TypeVar("Prepared")

FRAME_CODES: Final[frozenset[FindingCode]] = frozenset({"base_drifted", "base_target_moved"})
"""Codes of warnings about a frame, which do not depend on the observations."""
_ROBOTS: Final = 64
"""Greatest number of robots that are kept in memory, ready for computation."""
_SETS: Final = 16
"""Greatest number of measurement sets that are kept in memory, ready for computation."""
_METADATA: Final = tuple(SetMetadata.model_fields)
_COLUMNS: Final = ("name", *_METADATA)
"""Fields of a set that can be changed: their values are in columns of the table, not in the document."""


class StoredInputs(Generic[Record, Entry, Prepared]):
    """Stored robots, or stored measurement sets, which jobs need as inputs: load, change and delete them."""

    def __init__(
        self, records: Collection[Record, Entry], prepare: Callable[[str], Prepared], most: int
    ) -> None:
        """Serve the resources of a collection.

        Args:
            records: records of the resources.
            prepare: function that loads a resource, given its id, and prepares it for computation.
            most: number of prepared resources that are kept in memory.
        """
        self.records: Collection[Record, Entry] = records
        self.load_prepared = lru_cache(most)(prepare)  # function: id → resource prepared for computation

    def change(self, identifier: str, change: ResourceChange) -> Record:
        """Change fields of a resource, delete it or restore it; return its record.

        Raises:
            NotFoundError: no resource has this id, or it has been removed for good.
            DeletedError: the resource, or a resource to which it refers, is deleted.
            ReferencedError: the resource cannot be deleted, as other resources refer to it.
        """
        if change.deleted is False:
            self.records.restore(identifier)
        find_values = partial(self._list_changed_columns, change)
        record = self.records.change(identifier, find_values, include_deleted=change.deleted is True)
        self.load_prepared.cache_clear()
        if change.deleted:
            self.delete(identifier)
        return record

    def _list_changed_columns(self, change: ResourceChange, _record: Record) -> dict[str, object]:
        """Return column → new value for the fields of a record that a change states."""
        stated = {name: getattr(change, name) for name in change.model_fields_set - {"deleted"}}
        # A name cannot be removed: null leaves it unchanged.
        return {name: value for name, value in stated.items() if name != "name" or value is not None}

    def delete(self, identifier: str) -> None:
        """Delete a resource: hide it, so that it can be restored. A repeated call changes nothing.

        Raises:
            NotFoundError: no resource has this id.
            ReferencedError: other resources refer to this resource.
        """
        self.records.delete(identifier)
        self.load_prepared.cache_clear()


class Robots(StoredInputs[RobotRecord, RobotEntry, tuple[Robot, str]]):
    """Create and load the robots of a store."""

    def __init__(self, store: Store) -> None:
        super().__init__(store.robots, self._load_robot, _ROBOTS)
        self._store = store

    def create(self, request: robots.RobotDocument, key: IdempotencyKey | None) -> RobotRecord:
        """Check a robot and store it; return its record.

        Args:
            request: description of the robot.
            key: idempotency key of the request; if it was used before, the record created then is returned.

        Raises:
            RobotError: the description of the robot cannot be used.
            RequestError: the geometry or the arm that the description names does not exist.
            IdempotencyConflictError: the key was used before with another body.
        """
        if key is not None and (earlier_record := self._store.robots.find(key)) is not None:
            return earlier_record
        described = self._describe_robot(request)
        prepared = prepare_robot(described.document)
        return self._store.robots.add(_build_robot_record(prepared, described.origin), key)

    def load(self, robot_id: str) -> tuple[Robot, str]:
        """Return (robot prepared for computation, hash of its content).

        Raises:
            NotFoundError: no robot has this id.
        """
        robot, content_hash = self.load_prepared(robot_id)
        return robot.with_payload(self.read_payload(robot_id)), content_hash

    def read_payload(self, robot_id: str) -> float | None:
        """Return the payload of a stored robot [kg], which another process may have changed; None if unknown.

        Raises:
            NotFoundError: no robot has this id.
        """
        payload: float | None = json.loads(self._store.robots.get(robot_id).document).get("payload")
        return payload

    def find(self, robot_id: str | None, document: robots.RobotDocument | None) -> Robot:
        """Return the robot that a document describes, without storing it; without a document, a stored robot.

        Raises:
            NotFoundError: no robot has the id `robot_id`.
            RobotError: the description of the robot cannot be used.
        """
        if document is not None:
            return prepare_robot(self._describe_robot(document).document).robot
        return self.load(robot_id or "")[0]

    def list_confusable_robots(self) -> Iterator[KnownRobot]:
        """Yield robots that may have been measured by mistake: the newest stored robots, then catalogue arms.

        Catalogue arms that are among these stored robots are not yielded twice.
        """
        page = self._store.robots.page(limit=_ROBOTS)
        for record in page.records:
            yield KnownRobot(record.name, self.load_prepared(record.id)[0], record.id)
        yield from catalogue_robots(excluded={record.content_hash for record in page.records})

    def change(self, identifier: str, change: ResourceChange) -> RobotRecord:
        """Change fields of a robot as `StoredInputs.change` does; references must be sets of the robot.

        Raises:
            RequestError: a new reference is no set of the robot, or a mark cannot be added or removed.
        """
        if isinstance(change, robots.RobotChange) and change.reference_set_ids:
            self._refuse_foreign_references(identifier, change.reference_set_ids)
        return super().change(identifier, change)

    def _list_changed_columns(self, change: ResourceChange, record: RobotRecord) -> dict[str, object]:
        """Return column → new value for the fields of a robot that a change states.

        Marks and payload are changed in what the record has now, which nobody else can change meanwhile.

        Raises:
            RequestError: a mark cannot be added or removed.
        """
        columns = super()._list_changed_columns(change, record)
        if not isinstance(change, robots.RobotChange):
            return columns
        for name in ("add_mark", "remove_mark", "reference_set_ids", "payload"):
            columns.pop(name, None)
        if change.add_mark is not None or change.remove_mark is not None:
            columns["marks"] = _change_marks(record, change)
        if change.reference_set_ids is not None:
            columns["reference_set_ids"] = change.reference_set_ids
        if change.payload is not None:
            columns["document"] = _change_payload(record, change.payload)
        return columns

    def _refuse_foreign_references(self, robot_id: str, set_ids: Sequence[str]) -> None:
        """Refuse new references that are no sets of the robot.

        Raises:
            RequestError: one of the sets is neither a set of the robot nor one of its references.
        """
        known = {entry.id for entry in self._store.sets_of_robot(robot_id)}
        known |= {*(self._store.robots.get(robot_id, include_deleted=True).reference_set_ids or ())}
        for set_id in set_ids:
            if set_id not in known:
                raise RequestError(
                    f"the robot has no measurement set '{set_id}'",
                    remedy="give ids of measurement sets of this robot",
                    where="reference_set_ids",
                )

    def _describe_robot(self, request: robots.RobotDocument) -> _DescribedRobot:
        """Return the complete document of a requested robot, whose model may be a geometry or an arm's name.

        Raises:
            RequestError: the geometry or the arm that the request names does not exist.
        """
        model = request.model
        if isinstance(model, robots.GeometryModel):
            return self._describe_by_geometry(request, model.geometry_id)
        if isinstance(model, robots.CatalogueModel):
            return _describe_by_catalogue(request, model.arm)
        return _DescribedRobot(_complete_document(request, model, request.joint_map, request.payload), {})

    def _describe_by_geometry(self, request: robots.RobotDocument, geometry_id: str) -> _DescribedRobot:
        """Return the robot that a geometry identified, with name, bodies and payload of the request."""
        _, result = load_succeeded_geometry(self._store, geometry_id, "model.geometry_id")
        payload = result.robot.payload if request.payload is None else request.payload
        stated = {"name": request.name, "bodies": request.bodies, "payload": payload}
        document = result.robot.model_copy(update=stated)
        return _DescribedRobot(document, {"geometry_id": geometry_id})

    def _load_robot(self, robot_id: str) -> tuple[Robot, str]:
        """Build a stored robot; return (robot, hash of its content)."""
        record = self._store.robots.get(robot_id)
        return build_robot(robot_from_record(record)), record.content_hash


class _DescribedRobot(NamedTuple):
    """Complete document of a requested robot, and from where its model is."""

    document: robots.RobotDocument
    # {"geometry_id": id}, {"nominal_arm": name of the arm}, or {} for a model in the request
    origin: dict[str, str]


def _describe_by_catalogue(request: robots.RobotDocument, name: str) -> _DescribedRobot:
    """Return a robot with the model of a catalogue arm; joint map and payload are the arm's unless stated.

    Raises:
        RequestError: the catalogue has no arm of this name.
    """
    arm = find_arm(name, "model.arm")
    joint_map = request.joint_map or arm.joint_map
    payload = arm.payload if request.payload is None else request.payload
    document = _complete_document(request, arm.model, joint_map, payload)
    return _DescribedRobot(document, {"nominal_arm": arm.name})


def _complete_document(
    request: robots.RobotDocument,
    model: robots.Model,
    joint_map: robots.JointMap | None,
    payload: float | None,
) -> robots.RobotDocument:
    """Return the document of a requested robot with a model, a joint map and a payload; it is validated."""
    return robots.RobotDocument(
        name=request.name, model=model, joint_map=joint_map, bodies=request.bodies, payload=payload
    )


def _build_robot_record(prepared: PreparedRobot, origin: Mapping[str, str]) -> RobotRecord:
    """Return the record of a new robot, with a new id; `origin` is from where its model is."""
    message = _build_robot_message(prepared, origin)
    return RobotRecord(
        id=message.id,
        name=message.name,
        created_at=message.created_at,
        content_hash=message.content_hash,
        summary=message.model_dump(mode="json", include={"joints", "nominal_arm"}),
        document=message.model_dump_json(exclude={"last_campaign"}),
    )


def _build_robot_message(prepared: PreparedRobot, origin: Mapping[str, str]) -> robots.StoredRobot:
    """Return the message of a new robot, with what its kinematics show: its joints and its wrist."""
    document, robot = prepared.document, prepared.robot
    wrist = find_wrist(robot)
    return robots.StoredRobot(
        **document.model_dump(exclude={"model"}),
        model=document.model,
        id=uuid4().hex,
        joints=describe_joints(robot),
        spherical_wrist=wrist is not None and wrist.spherical,
        wrist_miss_distance=None if wrist is None else wrist.miss_distance,
        **origin,
        content_hash=prepared.content_hash,
        created_at=datetime.now(UTC),
    )


def _change_payload(record: RobotRecord, payload: float) -> str:
    """Return the document of a stored robot, in JSON, with another payload [kg]."""
    stored = robots.StoredRobot.model_validate_json(record.document)
    changed = stored.model_copy(update={"payload": payload})
    return changed.model_dump_json(exclude={"last_campaign"})


def _change_marks(record: RobotRecord, change: robots.RobotChange) -> list[dict[str, Any]]:
    """Return the marks of a robot after a change, oldest first, as its record stores them.

    Raises:
        RequestError: the mark to be removed is no mark of the robot, or the robot has too many marks.
    """
    marks = [robots.Mark.model_validate(mark) for mark in record.marks or ()]
    if change.remove_mark is not None:
        marks = _remove_mark(marks, change.remove_mark)
    if change.add_mark is not None:
        marks = [*marks, change.add_mark]
    if len(marks) > robots.MAX_MARKS:
        raise RequestError(
            f"the robot already has {robots.MAX_MARKS} marks, and more marks cannot be stored",
            remedy="remove a mark by `remove_mark` first",
            where="add_mark",
        )
    oldest_first = sorted(marks, key=lambda mark: mark.at)
    return [mark.model_dump(mode="json") for mark in oldest_first]


def _remove_mark(marks: Sequence[robots.Mark], removed: robots.Mark) -> list[robots.Mark]:
    """Return the marks of a robot without one of them; other marks that are equal to it remain.

    Raises:
        RequestError: it is not among the marks.
    """
    if removed not in marks:
        raise RequestError(
            "the robot has no such mark",
            remedy="read the robot again: another user may have removed the mark",
            where="remove_mark",
        )
    remaining = list(marks)
    remaining.remove(removed)
    return remaining


def robot_from_record(record: RobotRecord) -> robots.Robot:
    """Return the API message of a stored robot, with its present name, its marks and its references.

    They may have been changed since the document in the record was written.
    """
    stored = robots.Robot.model_validate_json(record.document)
    columns = {
        "name": record.name,
        "marks": [robots.Mark.model_validate(mark) for mark in record.marks or ()],
        "reference_set_ids": record.reference_set_ids or [],
    }
    return stored.model_copy(update=columns)


def load_job(store: Store, message: type[AnyJob], job_id: str) -> AnyJob:
    """Return a stored job as a message of the given class.

    Raises:
        NotFoundError: no job has this id, or it was deleted.
    """
    record = store.jobs(Resource(message.kind_name(), message.collection)).get(job_id)
    return message.model_validate_json(record.document)


def load_succeeded_geometry(store: Store, geometry_id: str, where: str) -> tuple[Geometry, GeometryResult]:
    """Return (stored geometry, its result).

    Args:
        store: store of the service.
        geometry_id: id of the geometry.
        where: field of the request that has the id, for errors.

    Raises:
        RequestError: no geometry has this id, it was deleted, or it has no result.
    """
    try:
        geometry = load_job(store, Geometry, geometry_id)
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=where) from error
    if geometry.result is None:
        raise RequestError(
            f"geometry '{geometry_id}' has no identified robot, as its state is {geometry.state}",
            remedy="use a geometry that has succeeded",
            where=where,
        )
    return geometry, geometry.result


class MeasurementSets(StoredInputs[MeasurementSetRecord, MeasurementSetEntry, PreparedSet]):
    """The measurement sets of a store."""

    def __init__(self, store: Store, robots: Robots) -> None:
        super().__init__(store.sets, self._prepare, _SETS)
        self._store = store
        self._robots = robots

    def create(
        self,
        request: messages.MeasurementSetRequest,
        key: IdempotencyKey | None,
        identifier: str | None = None,
    ) -> MeasurementSetRecord:
        """Check a measurement set, inspect it for mistakes and store it with findings; return its record.

        Args:
            request: robot and readings.
            key: idempotency key; if it was used before, the record created then is returned.
            identifier: id of the set; None for a new id.

        Raises:
            MeasurementError: the set cannot be used.
            RequestError: the frame of the set names an unknown geometry.
            IdempotencyConflictError: the key was used before with another body.
        """
        if key is not None and (earlier_record := self._store.sets.find(key)) is not None:
            return earlier_record
        robot = self._load_robot(request.robot_id)
        resolved, drift = resolve_frame(self._store, request)
        others = self._robots.list_confusable_robots()
        checked = check_set(request, robot, resolved, drift, others)
        message = messages.StoredMeasurementSet(
            **request.model_dump(exclude={"observations", "open"}),
            id=identifier or uuid4().hex,
            **frame_fields(resolved),
            warnings=checked.warnings,
            content_hash=checked.content_hash,
            created_at=datetime.now(UTC),
        )
        return self._store.sets.add(_build_set_record(message, checked), key)

    def _load_robot(self, robot_id: str) -> Robot:
        """Return the robot of a set to be stored.

        Raises:
            MeasurementError: no robot has this id.
        """
        try:
            return self._robots.load(robot_id)[0]
        except NotFoundError as error:
            raise MeasurementError(error.reason, remedy=error.remedy, where="robot_id") from error

    def document(self, set_id: str) -> MeasurementSet:
        """Return a measurement set as it was posted, together with the warnings that were stored with it.

        Raises:
            NotFoundError: no set has this id.
        """
        return set_from_record(self._store.sets.get(set_id))

    def prepared(self, set_id: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a set prepared for computation.

        Args:
            set_id: id of the set.
            leave_out: labels of observations to leave out; the other observations are checked anew.

        Raises:
            NotFoundError: no set has this id.
            RequestError: the set has no observation with such a label, or no observation remains.
        """
        if leave_out:
            return self._prepare_part(self.document(set_id), frozenset(leave_out))
        prepared = self.load_prepared(set_id)
        robot = prepared.robot.with_payload(self._robots.read_payload(prepared.robot_id))
        return replace(prepared, robot=robot)

    def _prepare_part(self, stored: MeasurementSet, leave_out: frozenset[str]) -> PreparedSet:
        """Return a stored set without some observations, checked anew and prepared for computation.

        The observations keep their numbers in the whole set.

        Raises:
            RequestError: the set has no observation with such a label, or no observation remains.
        """
        kept = leave_out_observations(stored.observations, leave_out)
        robot, robot_hash = self._robots.load(stored.robot_id)
        part = check_set(
            stored.model_copy(update={"observations": kept}),
            robot,
            stored.resolved,
            [warning for warning in stored.warnings if warning.code in FRAME_CODES],
            self._robots.list_confusable_robots(),
            robot_id=stored.robot_id,
            robot_hash=robot_hash,
        )
        return part.number_as_in(stored.observations)

    def _prepare(self, set_id: str) -> PreparedSet:
        """Load a stored set and prepare it for computation, without the checks made when it was stored."""
        record = self._store.sets.get(set_id)
        stored = messages.StoredMeasurementSet.model_validate_json(record.document)
        readings = ReadingArrays.unpack(record.arrays)
        robot, robot_hash = self._robots.load(stored.robot_id)
        return PreparedSet(
            robot=robot,
            robot_id=stored.robot_id,
            robot_hash=robot_hash,
            readings=readings,
            measurements=to_measurements(*transform_to_base(stored, readings, stored.resolved), robot),
            warnings=stored.warnings,
            content_hash=record.content_hash,
        )


class Resources:
    """The robots, measurement sets and runs of a store, which requests name with ids."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.robots = Robots(store)
        self.sets = MeasurementSets(store, self.robots)
        # Function: id of a job → why the job does not move; None if it moves, or is not watched
        self.find_reason: Callable[[str], str | None] = lambda _: None

    def robot(self, robot_id: str, where: str) -> tuple[Robot, str]:
        """Return (stored robot, hash of its content).

        `where` is the field of the request that has the robot's id, for errors.
        """
        with _refuse_at_field(where):
            return self.robots.load(robot_id)

    def list_confusable_robots(self) -> Iterator[KnownRobot]:
        """Yield robots that may have been measured by mistake: stored robots, then arms of the catalogue."""
        return self.robots.list_confusable_robots()

    def measured(self, set_id: str, where: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a stored measurement set, prepared for computation.

        Args:
            set_id: id of the set.
            where: field of the request that has the id, for errors.
            leave_out: labels of observations to leave out.
        """
        with _refuse_at_field(where):
            return self.sets.prepared(set_id, leave_out)

    def named_sets(self, set_ids: Sequence[str], where: str) -> list[NamedSet]:
        """Return ids and names of stored sets, also of deleted sets, in the order of `set_ids`.

        Args:
            set_ids: ids of the sets.
            where: field of the request that has the ids, for errors.
        """
        rows = {row.id: row for row in self.store.sets.rows_with_names(set_ids)}
        for i, set_id in enumerate(set_ids):
            if set_id not in rows:
                with _refuse_at_field(f"{where}[{i}]"):
                    raise NotFoundError(MEASUREMENT_SET, set_id)
        return [
            NamedSet(
                id=set_id,
                name=rows[set_id].name,
                robot_id=rows[set_id].robot_id,
                robot_name=rows[set_id].robot_name,
                content=hash_texts(rows[set_id].robot_hash, rows[set_id].content_hash),
            )
            for set_id in set_ids
        ]

    def job_summaries(self, message: type[Job], robot_id: str) -> Iterator[Mapping[str, Any]]:
        """Yield the summaries of the newest jobs of a kind on a robot, at most 1,000.

        `message` is the class of the jobs.
        """
        collection = self.store.jobs(Resource(message.kind_name(), message.collection))
        cursor = None
        for _ in range(10):  # 10 pages of 100 jobs
            page = collection.page(limit=100, cursor=cursor, filters={"robot_id": robot_id})
            yield from ({"id": record.id, **record.summary} for record in page.records)
            if (cursor := page.next) is None:
                return

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a stored run with its measurement set.

        `where` is the field of the request that has the run's id, for errors.
        """
        with _refuse_at_field(where):
            run = load_job(self.store, Run, run_id)
            return MeasuredRun(run, self.sets.prepared(run.request.measurement_set_id))


@contextmanager
def _refuse_at_field(field: str) -> Iterator[None]:
    """Turn a `NotFoundError` of the block into a `RequestError` at a field of the request."""
    try:
        yield
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=field) from error


def _build_set_record(message: messages.StoredMeasurementSet, checked: PreparedSet) -> MeasurementSetRecord:
    """Return the record of a new measurement set, whose message has no readings; `checked` has these.

    Fields that can be changed later have columns of their own.
    """
    changeable = {name: getattr(message, name) for name in _METADATA}
    return MeasurementSetRecord(
        id=message.id,
        robot_id=message.robot_id,
        name=message.name,
        encoders=message.encoders,
        observation_count=len(checked.readings.labels),
        warning_count=len(message.warnings),
        created_at=message.created_at,
        content_hash=checked.content_hash,
        document=message.model_dump_json(exclude=set(_METADATA)),
        arrays=checked.readings.pack(),
        **changeable,
    )


def set_from_record(record: MeasurementSetRecord) -> MeasurementSet:
    """Return the API message of a stored measurement set, with its observations."""
    stored = messages.StoredMeasurementSet.model_validate_json(record.document)
    observations = ReadingArrays.unpack(record.arrays).observations()
    fields = {name: getattr(stored, name) for name in messages.StoredMeasurementSet.model_fields}
    fields |= {name: getattr(record, name) for name in _COLUMNS}
    # `model_construct` does not validate: fields and observations were validated when they were stored.
    return MeasurementSet.model_construct(**fields, observations=observations)


def resolve_frame(store: Store, request: MeasurementSetRequest) -> tuple[ResolvedFrame | None, list[Finding]]:
    """Return (transform from the frame of a set's readings to R0, warnings about drift).

    The transform is None if the readings are in R0. It corrects the drift of the tracker since the geometry,
    which the warnings state, if base targets were read again.

    Raises:
        MeasurementError: the stated rotation is not a rotation, or base targets cannot be compared.
        RequestError: no geometry has the stated id, or the geometry has no result.
    """
    frame = request.frame
    if frame is None:
        return None, []
    if frame.geometry_id is None:
        stated = read_stated_transform(frame, LENGTH[request.units.length])
        return to_resolved_frame(stated), []
    geometry, result = load_succeeded_geometry(store, frame.geometry_id, "frame.geometry_id")
    transform = _to_rigid_motion(result.transform_tracker_to_base)
    warnings: list[Finding] = []
    if frame.base_targets is not None:
        drift, warnings = _estimate_drift(geometry.request, result, request, frame.base_targets)
        transform = transform * _to_rigid_motion(drift.transform_after_to_before)
    flange_targets = _find_targets_in_flange(store, frame, request.robot_id, geometry, result)
    return to_resolved_frame(transform, flange_targets), warnings


def _to_rigid_motion(stated: Rigid) -> pin.SE3:
    """Convert the rotation (3, 3) and the translation (3,) [m] of a message to a motion of Pinocchio."""
    return pin.SE3(np.array(stated.rotation), np.array(stated.translation))


def _estimate_drift(
    geometry: GeometryRequest,
    result: GeometryResult,
    request: MeasurementSetRequest,
    positions_after: Mapping[str, Vector3],
) -> tuple[Drift, list[Finding]]:
    """Return (drift of the tracker between a geometry and a set, findings about the drift).

    Args:
        geometry: request of the geometry, with base targets.
        result: result of the geometry.
        request: request of the set.
        positions_after: base targets read with the set: name → position in the set's unit of length.

    Raises:
        MeasurementError: the geometry has no base targets.
    """
    unit_ratio = LENGTH[request.units.length] / LENGTH[geometry.units.length]
    after = _scale_positions(positions_after, unit_ratio)  # in the unit of length of the geometry
    base_targets = to_base_targets(geometry, result.sigma, after)
    if base_targets is None:
        raise MeasurementError(
            "the geometry has no base targets for the comparison",
            where="frame.base_targets",
            remedy="omit `base_targets`, or give `base_targets_before` with the geometry",
        )
    middle = _find_middle_of_readings(request)
    # The drift is stated at the middle of the readings, where it matters.
    drift = base_targets.fit_drift(
        result.sigma, base_targets.after.mean(axis=0) if middle is None else middle
    )
    findings = report_drift(drift, base_targets)
    return drift, [_state_correction(finding) for finding in findings]


def _scale_positions(positions: Mapping[str, Vector3], factor: float) -> dict[str, Vector3]:
    """Return name → position (3,) times a factor."""
    return {name: (factor * x, factor * y, factor * z) for name, (x, y, z) in positions.items()}


def _find_middle_of_readings(request: MeasurementSetRequest) -> FloatArray | None:
    """Return the mean position (3,) [m] without load of all readings of a set; None without positions."""
    readings = (reading for observation in request.observations for reading in observation.readings)
    positions = [reading.unloaded for reading in readings if reading.unloaded is not None]
    if not positions:
        return None
    return np.asarray(LENGTH[request.units.length] * np.mean(positions, axis=0))


def _state_correction(finding: Finding) -> Finding:
    """Return a finding about drift that says that the set's transform corrects the drift.

    A drift that is corrected is no reason against the set; findings about single targets remain as they are.
    """
    if finding.code != "base_drifted":
        return finding
    remedy = "the drift is corrected in this set; let the tracker warm up, and mount the tracker more rigidly"
    return finding.model_copy(update={"weight": "use", "remedy": remedy})


def _find_targets_in_flange(
    store: Store, frame: Frame, robot_id: str, geometry: Geometry, result: GeometryResult
) -> dict[str, Vector3]:
    """Return target → position [m] in the flange frame of a set's robot, from a geometry.

    The result is empty if the geometry was identified for another flange.
    """
    robot = robot_from_record(store.robots.get(robot_id))
    is_of_same_nominal_robot = result.flange == "nominal" and geometry.request.robot_id == robot_id
    if robot.geometry_id != frame.geometry_id and not is_of_same_nominal_robot:
        return {}
    return {target.name: target.position for target in result.targets}
