"""A database as it is, without being brought to this version: what is wrong with its files and its rows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from typing import Any, Final

from sqlalchemy import Connection, MetaData, Select, Table, exists, func, select
from sqlalchemy.exc import NoSuchTableError

from jointstiff.service.problems.errors import StoreError, StoreUnavailableError
from jointstiff.service.store.collection import MEASUREMENT_SET, ROBOT
from jointstiff.service.store.database import Database, open_existing
from jointstiff.service.store.migrations import has_tables
from jointstiff.service.store.records import AnyRecord, JobRecord, MeasurementSetRecord, RobotRecord
from jointstiff.service.store.tables import idempotency_keys, job_steps, jobs, measurement_sets, robots

_SHOWN: Final = 20
_AT_ONCE: Final = 50
_TABLES: Final[tuple[tuple[Table, type[AnyRecord]], ...]] = (
    (robots, RobotRecord),
    (measurement_sets, MeasurementSetRecord),
    (jobs, JobRecord),
)


@dataclass(frozen=True, slots=True)
class Fault:
    """Something wrong in a database."""

    code: str  # code of the kind of fault
    where: str  # table or resource
    reason: str  # what is wrong
    remedy: str  # what to do about it


class Inspection:
    """One look at a database, in which it only reads."""

    def __init__(self, database: Database) -> None:
        self._database = database

    @classmethod
    @contextmanager
    def of(cls, url: str) -> Iterator[Inspection]:
        """Open a database that is there.

        Raises:
            StoreError: it is not, or cannot be read at all.
        """
        with closing(open_existing(url)) as database:
            yield cls(database)

    def schema_faults(self) -> list[Fault]:
        """Return the fault of tables that this version does not read; empty if it does."""
        try:
            with self._database.reading() as connection:
                if has_tables(connection):
                    return []
        except StoreError as error:
            return [Fault("schema", "alembic_version", error.reason, error.remedy)]
        return [
            Fault("schema", "alembic_version", "no Jointstiff tables here", "check the URL of the database")
        ]

    def file_faults(self) -> list[Fault]:
        """Return what SQLite's own check finds; PostgreSQL checks its pages when it reads them."""
        if self._database.dialect != "sqlite":
            return []
        try:
            with self._database.reading() as connection:
                faults = connection.exec_driver_sql(f"PRAGMA integrity_check({_SHOWN})").scalars().all()
        except StoreUnavailableError as error:  # too damaged for the check
            faults = [error.reason]
        return [Fault("file", "file", str(line), _BACKUP) for line in faults if line != "ok"]

    def orphans(self) -> list[Fault]:
        """Return rows that name what is not there."""
        with self._database.reading() as connection:
            return [
                Fault("orphan", f"{name} {identifier}", f"refers to {what}, which does not exist", _BACKUP)
                for name, what, query in _orphans()
                for identifier in connection.execute(query.limit(_SHOWN)).scalars()
            ]

    def records(self) -> Iterator[AnyRecord]:
        """Yield all records, those of deleted jobs as well."""
        for table, record in _TABLES:
            columns, last = [table.c[field.name] for field in fields(record)], 0
            while True:
                query = select(table.c.sequence, *columns).where(table.c.sequence > last)
                with self._database.reading() as connection:
                    rows = connection.execute(query.order_by(table.c.sequence).limit(_AT_ONCE)).all()
                if not rows:
                    break
                names = [column.name for column in columns]
                yield from (record(**dict(zip(names, row[1:], strict=True))) for row in rows)
                last = rows[-1].sequence

    def workflows(self) -> dict[str, str] | None:
        """Return the state of each workflow of the engine by its id; None if it has no tables here."""
        table = self._engine_table("workflow_status")
        if table is None:
            return None
        with self._database.reading() as connection:
            return {
                row[0]: row[1] for row in connection.execute(select(table.c.workflow_uuid, table.c.status))
            }

    def pickles(self) -> int:
        """Return the number of rows of the engine that hold a pickled object."""
        count = 0
        for name in ("workflow_status", "operation_outputs"):
            table = self._engine_table(name)
            if table is not None:
                query = select(func.count()).select_from(table).where(table.c.serialization == "py_pickle")
                with self._database.reading() as connection:
                    count += int(connection.execute(query).scalar_one())
        return count

    def _engine_table(self, name: str) -> Table | None:
        with self._database.reading() as connection:
            try:
                return Table(name, MetaData(schema=self._engine_schema(connection)), autoload_with=connection)
            except NoSuchTableError:
                return None

    def _engine_schema(self, connection: Connection) -> str | None:
        if self._database.dialect == "sqlite":
            return None
        schema = connection.execute(select(func.current_schema())).scalar_one()
        return "dbos" if schema == "public" else f"dbos_{schema}"


_BACKUP: Final = "restore a backup; keep this database for the investigation"


def _orphans() -> Iterator[tuple[str, str, Select[Any]]]:
    """Yield name of the table, what is missing, and the query for the rows' ids."""
    for table, _ in _TABLES:
        for column in table.c:
            for reference in column.foreign_keys:
                missing = ~exists().where(reference.column == column)
                yield table.name, column.name, select(table.c.id).where(column.is_not(None), missing)
    steps = select(job_steps.c.job_id).distinct().where(~exists().where(jobs.c.id == job_steps.c.job_id))
    yield job_steps.name, "a job", steps
    keys = idempotency_keys.c
    for resource, table in ((ROBOT.collection, robots), (MEASUREMENT_SET.collection, measurement_sets)):
        gone = ~exists().where(table.c.id == keys.resource_id)
        yield idempotency_keys.name, resource, select(keys.resource_id).where(keys.resource == resource, gone)
    others = keys.resource.not_in([ROBOT.collection, MEASUREMENT_SET.collection])
    gone = ~exists().where(jobs.c.id == keys.resource_id)
    yield idempotency_keys.name, "a job", select(keys.resource_id).where(others, gone)
