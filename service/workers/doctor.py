"""Faults of a database: its file, its rows, the documents in them, and jobs that nobody will end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.measurement import measurement_set as messages
from jointstiff.schemas.robot import Robot, RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.readings import ReadingArrays, content_hash
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.store.inspection import Fault, Inspection
from jointstiff.service.store.job_log import OPEN_STATES
from jointstiff.service.store.records import JobRecord, MeasurementSetRecord, RobotRecord
from jointstiff.service.workers.queue import is_ended

_KINDS: Final[Mapping[str, AnyKind]] = MappingProxyType({kind.name: kind for kind in KINDS})
_RESTORE: Final = "restore a backup, or post it again"


@dataclass
class Examination:
    """Outcome of a look at a database."""

    counted: dict[str, int] = field(default_factory=dict)  # records read, by what they are
    faults: list[Fault] = field(default_factory=list)  # what is wrong


def examine(url: str) -> Examination:
    """Look for faults in a database, which is not changed; a service may go on meanwhile.

    Raises:
        StoreError: it is not there, or cannot be read at all.
    """
    examination = Examination()
    with Inspection.of(url) as inspection:
        examination.faults += inspection.file_faults()
        if examination.faults:  # what is read from a damaged file says nothing
            return examination
        examination.faults += inspection.schema_faults()
        if examination.faults:
            return examination
        examination.faults += [*inspection.orphans(), *_pickles(inspection)]
        workflows = inspection.workflows()
        for record in inspection.records():
            name = record.kind if isinstance(record, JobRecord) else _NAMES[type(record)]
            examination.counted[name] = examination.counted.get(name, 0) + 1
            examination.faults += _faults_of(record, name)
            if isinstance(record, JobRecord) and record.state in OPEN_STATES:
                examination.faults += _endless(record, workflows)
    return examination


def _faults_of(record: RobotRecord | MeasurementSetRecord | JobRecord, name: str) -> Iterator[Fault]:
    where = f"{name} {record.id}"
    try:
        if isinstance(record, JobRecord):
            yield from _job_faults(record, where)
        else:
            expected = _robot_hash(record) if isinstance(record, RobotRecord) else _set_hash(record)
            if expected != record.content_hash:
                yield Fault("hash", where, "its content is not what was stored: the hash differs", _RESTORE)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is a fault of the document
        reason = (str(error) or type(error).__name__).splitlines()[0][:200]
        yield Fault("document", where, f"its document cannot be read ({reason})", _RESTORE)


def _robot_hash(record: RobotRecord) -> str:
    stored = Robot.model_validate_json(record.document)
    document = RobotDocument(name=stored.name, model=stored.model, joint_map=stored.joint_map)
    return prepare_robot(document).content_hash


def _set_hash(record: MeasurementSetRecord) -> str:
    stored = messages.StoredMeasurementSet.model_validate_json(record.document)
    return content_hash(stored, ReadingArrays.unpack(record.arrays), stored.resolved_frame)


def _job_faults(record: JobRecord, where: str) -> Iterator[Fault]:
    if record.kind not in _KINDS:
        yield Fault("kind", where, "there is no such kind of job", _RESTORE)
        return
    job = _KINDS[record.kind].message.model_validate_json(record.document)
    if record.state not in OPEN_STATES and job.state != record.state:
        yield Fault("state", where, f"its row says {record.state}, its document {job.state}", _RESTORE)
    if record.state == "succeeded" and job.result is None:
        yield Fault("result", where, "it succeeded, but has no result", _RESTORE)


def _endless(record: JobRecord, workflows: Mapping[str, str] | None) -> Iterator[Fault]:
    """Yield a fault if nobody will end a job."""
    state = (workflows or {}).get(record.id)
    where, remedy = f"{record.kind} {record.id}", "start a worker, which will finish it"
    if state is None:
        yield Fault("endless", where, f"it is {record.state}, but the job engine does not know it", remedy)
    elif is_ended(state):
        yield Fault("endless", where, f"it is {record.state}, but its workflow has ended ({state})", remedy)


def _pickles(inspection: Inspection) -> Iterator[Fault]:
    if count := inspection.pickles():
        yield Fault(
            "pickle",
            "the engine's tables",
            f"{count} rows have a pickled object, which is never read",
            "this may be an attack: find out who writes to this table",
        )


_NAMES: Final[Mapping[type, str]] = MappingProxyType(
    {RobotRecord: "robot", MeasurementSetRecord: "measurement set"}
)
