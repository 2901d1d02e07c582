"""Journals: records that are added and never changed, such as the audit, notes in trends, authorisations."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any, Final, Generic, TypeVar

from sqlalchemy import Connection, Select, Table, insert, select

from jointstiff.service.store.collection import LAST_SEQUENCE, is_indexable, parse_cursor
from jointstiff.service.store.database import Database
from jointstiff.service.store.quota import Quota
from jointstiff.service.store.records import AuditEntry, AuthorisationRecord, TrendNote
from jointstiff.service.store.tables import authorisations, jobs

Noted = TypeVar("Noted", AuditEntry, TrendNote, AuthorisationRecord)


class Journal(Generic[Noted]):
    """The records of one table, in the order in which they came. Safe to use from several threads."""

    def __init__(self, database: Database, table: Table, record: type[Noted], quota: Quota | None) -> None:
        """Keep records in a table; without a quota they are added to a full database, too."""
        self._database, self._table, self._quota = database, table, quota
        self._record: type[Noted] = record
        self._all = select(*(table.c[field.name] for field in fields(record)))

    def add(self, record: Noted) -> Noted:
        """Add a record and return it.

        Raises:
            QuotaError: the database has the size that it may have.
        """
        if self._quota is not None:
            self._quota.refuse_full()
        with self._database.writing() as connection:
            return self._insert(connection, record)

    def of(self, **values: str) -> list[Noted]:
        """Return the records that have these values in these columns, oldest first."""
        if not all(map(is_indexable, values.values())):
            return []
        with self._database.reading() as connection:
            return self._found(connection, self._all.filter_by(**values).order_by(self._table.c.sequence))

    def page(
        self, limit: int, cursor: str | None = None, **values: str | None
    ) -> tuple[list[Noted], str | None]:
        """Return one page, newest first, and the cursor of the next one.

        Args:
            limit: how many records at most, one or more.
            cursor: that the page before returned; none for the first page.
            values: column → value that it must have; None for any.

        Raises:
            CursorError: no page gave this cursor.
        """
        sequence = self._table.c.sequence
        before = LAST_SEQUENCE if cursor is None else parse_cursor(cursor)
        query = (
            select(*self._all.selected_columns, sequence)
            .where(sequence < before)
            .filter_by(**{name: value for name, value in values.items() if value is not None})
            .order_by(sequence.desc())
            .limit(limit + 1)
        )
        with self._database.reading() as connection:
            rows = connection.execute(query).all()
        shown = [self._record(*row[:-1]) for row in rows[:limit]]
        return shown, str(rows[limit - 1].sequence) if len(rows) > limit else None

    def _insert(self, connection: Connection, record: Noted) -> Noted:
        connection.execute(insert(self._table).values(asdict(record)))
        return record

    def _found(self, connection: Connection, query: Select[Any]) -> list[Noted]:
        return [self._record(*row) for row in connection.execute(query)]


_SAME: Final = ("content_hash", "key_id", "key_name", "note", "supersedes")


class Authorisations(Journal[AuthorisationRecord]):
    """The authorisations of all reports. One that repeats the latest of its run is not added again."""

    def _insert(self, connection: Connection, record: AuthorisationRecord) -> AuthorisationRecord:
        # Of two at the same time, one waits here; on SQLite it waited for the transaction to begin.
        connection.execute(select(jobs.c.id).where(jobs.c.id == record.run_id).with_for_update())
        mine = self._all.filter_by(run_id=record.run_id).order_by(authorisations.c.sequence.desc()).limit(1)
        latest = self._found(connection, mine)
        if latest and all(getattr(latest[0], name) == getattr(record, name) for name in _SAME):
            return latest[0]
        if record.number != (latest[0].number if latest else 0) + 1:
            raise NumberTakenError
        return super()._insert(connection, record)


class NumberTakenError(Exception):
    """Another report of the run was authorised meanwhile, and has the number."""
