"""Faults of a database: its file, its rows, the documents in them, and jobs that nobody will end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.schemas import measurement as messages
from jointstiff.schemas.robot import Robot, RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.readings import ReadingArrays, content_hash
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.store.collection import MEASUREMENT_SET, ROBOT
from jointstiff.service.store.database import Database, open_existing
from jointstiff.service.store.jobs import Steps
from jointstiff.service.store.tables import (
    OPEN_STATES,
    AnyRecord,
    JobRecord,
    MeasurementSetRecord,
    RobotRecord,
    has_tables,
    idempotency_keys,
    job_steps,
    jobs,
    measurement_sets,
    of_records,
    robots,
)

_SHOWN: Final = 20
_AT_ONCE: Final = 50
_TABLES: Final[tuple[tuple[sa.Table, type[AnyRecord]], ...]] = (
    (robots, RobotRecord),
    (measurement_sets, MeasurementSetRecord),
    (jobs, JobRecord),
)
_KINDS: Final[Mapping[str, AnyKind]] = MappingProxyType({kind.name: kind for kind in KINDS})
_NAMES: Final[Mapping[type, str]] = MappingProxyType(
    {RobotRecord: "robot", MeasurementSetRecord: "measurement set"}
)
_BACKUP: Final = "restore a backup; keep this database for the investigation"
_RESTORE: Final = "restore a backup, or post it again"


@dataclass(frozen=True, slots=True)
class Fault:
    """Something wrong in a database."""

    code: str  # code of the kind of fault
    where: str  # table or resource
    reason: str  # what is wrong
    remedy: str  # what to do about it


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
    with closing(open_existing(url)) as database:
        for look in (_file_faults, _schema_faults):
            examination.faults += look(database)
            if examination.faults:  # what is read from a damaged file, or other tables, says nothing
                return examination
        examination.faults += [*_orphans(database), *_endless(database)]
        for record in _records(database):
            name = record.kind if isinstance(record, JobRecord) else _NAMES[type(record)]
            examination.counted[name] = examination.counted.get(name, 0) + 1
            examination.faults += _faults_of(record, name)
    return examination


def _file_faults(database: Database) -> list[Fault]:
    """Return what SQLite's own check finds; PostgreSQL checks its pages when it reads them."""
    if database.dialect != "sqlite":
        return []
    try:
        with database.reading() as connection:
            faults = connection.exec_driver_sql(f"PRAGMA integrity_check({_SHOWN})").scalars().all()
    except StoreUnavailableError as error:  # too damaged for the check
        faults = [error.reason]
    return [Fault("file", "file", str(line), _BACKUP) for line in faults if line != "ok"]


def _schema_faults(database: Database) -> list[Fault]:
    """Return the fault of tables that this version does not read; empty if it does."""
    try:
        with database.reading() as connection:
            if has_tables(connection):
                return []
        reason, remedy = "no Jointstiff tables here", "check the URL of the database"
    except StoreError as error:
        reason, remedy = error.reason, error.remedy
    return [Fault("schema", "alembic_version", reason, remedy)]


def _orphans(database: Database) -> list[Fault]:
    """Return rows that name what is not there."""
    with database.reading() as connection:
        return [
            Fault("orphan", f"{name} {identifier}", f"refers to {what}, which does not exist", _BACKUP)
            for name, what, query in _orphan_queries()
            for identifier in connection.execute(query.limit(_SHOWN)).scalars()
        ]


def _endless(database: Database) -> list[Fault]:
    """Return jobs that nobody will end."""
    reason, remedy = "it has not ended, and no step is left of it", "start a worker, which will end it"
    lost = Steps(database).forgotten()
    return [Fault("endless", f"{kind} {job_id}", reason, remedy) for job_id, kind in lost.items()]


def _orphan_queries() -> Iterator[tuple[str, str, sa.Select[Any]]]:
    """Yield name of the table, what is missing, and the query for the rows' ids."""
    for table, _ in _TABLES:
        for column in table.c:
            for reference in column.foreign_keys:
                missing = ~sa.exists().where(reference.column == column)
                yield table.name, column.name, sa.select(table.c.id).where(column.is_not(None), missing)
    steps = (
        sa.select(job_steps.c.job_id).distinct().where(~sa.exists().where(jobs.c.id == job_steps.c.job_id))
    )
    yield job_steps.name, "a job", steps
    keys = idempotency_keys.c
    inputs = [ROBOT.collection, MEASUREMENT_SET.collection]
    for what, table, mine in (
        (inputs[0], robots, keys.resource == inputs[0]),
        (inputs[1], measurement_sets, keys.resource == inputs[1]),
        ("a job", jobs, keys.resource.not_in(inputs)),
    ):
        gone = ~sa.exists().where(table.c.id == keys.resource_id)
        yield idempotency_keys.name, what, sa.select(keys.resource_id).where(mine, gone)


def _records(database: Database) -> Iterator[AnyRecord]:
    """Yield all records, those of deleted jobs as well."""
    for table, record in _TABLES:
        query, last = of_records(table, record).add_columns(table.c.sequence), 0
        while True:
            found = query.where(table.c.sequence > last).order_by(table.c.sequence).limit(_AT_ONCE)
            rows = [dict(row._mapping) for row in database.rows(found)]
            if not rows:
                break
            last = [row.pop("sequence") for row in rows][-1]
            yield from (record(**row) for row in rows)


def _faults_of(record: RobotRecord | MeasurementSetRecord | JobRecord, name: str) -> Iterator[Fault]:
    where = f"{name} {record.id}"
    try:
        if isinstance(record, JobRecord):
            yield from _job_faults(record, where)
            return
        if isinstance(record, RobotRecord):
            robot = Robot.model_validate_json(record.document)
            document = RobotDocument(name=robot.name, model=robot.model, joint_map=robot.joint_map)
            expected = prepare_robot(document).content_hash
        else:
            stored = messages.StoredMeasurementSet.model_validate_json(record.document)
            expected = content_hash(stored, ReadingArrays.unpack(record.arrays), stored.resolved_frame)
        if expected != record.content_hash:
            yield Fault("hash", where, "its content is not what was stored: the hash differs", _RESTORE)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is a fault of the document
        reason = (str(error) or type(error).__name__).splitlines()[0][:200]
        yield Fault("document", where, f"its document cannot be read ({reason})", _RESTORE)


def _job_faults(record: JobRecord, where: str) -> Iterator[Fault]:
    if record.kind not in _KINDS:
        yield Fault("kind", where, "there is no such kind of job", _RESTORE)
        return
    job = _KINDS[record.kind].message.model_validate_json(record.document)
    if record.state not in OPEN_STATES and job.state != record.state:
        yield Fault("state", where, f"its row says {record.state}, its document {job.state}", _RESTORE)
    if record.state == "succeeded" and job.result is None:
        yield Fault("result", where, "it succeeded, but has no result", _RESTORE)
