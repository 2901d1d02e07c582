"""The store: robots, measurement sets and jobs in SQLite or PostgreSQL.

Records are never changed here, and are listed in the order in which they came; what changes about a job is
`job_log`'s, how it is deleted `deletion`'s.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from types import MappingProxyType, TracebackType
from typing import Any

from sqlalchemy import Connection, Row, func, select
from sqlalchemy.exc import IntegrityError

from jointstiff.service.store.database import Database, Dialect
from jointstiff.service.store.deletion import Deletions
from jointstiff.service.store.errors import (
    CursorError,
    DeletedError,
    IdempotencyConflictError,
    NotFoundError,
    StoreError,
)
from jointstiff.service.store.heartbeats import Heartbeats
from jointstiff.service.store.job_log import JobLog
from jointstiff.service.store.migrations import migrate
from jointstiff.service.store.records import (
    AnyJobRecord,
    AnyRecord,
    Entry,
    IdempotencyKey,
    Record,
    RecordPage,
)
from jointstiff.service.store.statements import INSERT_KEY, PING, STATEMENTS
from jointstiff.service.store.tables import FILTERS, PARENTS, TABLES

__all__ = ["Store"]

_LAST_SEQUENCE = 2**63 - 1
_MAX_INDEXED = 500
"""Characters of an id or a name: PostgreSQL indexes up to 2704 bytes, schemas allow 200."""

_NO_FILTERS: Mapping[str, str] = MappingProxyType({})


class Store:
    """Robots, measurement sets and jobs, kept. Safe to use from several threads.

    Attributes:
        heartbeats: Of the workers.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.heartbeats = Heartbeats(database)

    @classmethod
    def open(cls, url: str) -> Store:
        """Open the database at `url` and bring it to the version of this software.

        Args:
            url: `sqlite:///path`, `postgresql://…`, or `sqlite://` for a database in memory, whose
                users wait for each other and which is gone when closed.

        Raises:
            StoreError: The URL, or the version of the database, is not one we can work with.
            StoreUnavailableError: There is no answer.
        """
        database = Database.open(url)
        try:
            migrate(database)
        except BaseException:
            database.close()
            raise
        return cls(database)

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def job_log(self, record: type) -> JobLog:
        """What changes about the jobs of a kind of record until they end."""
        return JobLog(self._database, record)

    def deletions(self, record: type[AnyJobRecord]) -> Deletions:
        """How the jobs of a kind of record are deleted and brought back."""
        return Deletions(self._database, record)

    def schema(self) -> str | None:
        """Where its tables are: the schema on PostgreSQL, None on SQLite."""
        if self._database.dialect == "sqlite":
            return None
        with self._database.reading() as connection:
            return str(connection.execute(select(func.current_schema())).scalar_one())

    def ping(self) -> Dialect:
        """Ask the database for something of ours.

        Returns:
            Which database it is.

        Raises:
            StoreUnavailableError: There is no answer.
        """
        with self._database.reading() as connection:
            connection.execute(PING)
        return self._database.dialect

    def add(
        self,
        record: Record,
        key: IdempotencyKey | None = None,
        also: Callable[[Connection], object] | None = None,
    ) -> Record:
        """Store `record` and its idempotency key in one transaction.

        Args:
            record: What to store.
            key: The idempotency key that came with it.
            also: What else belongs into the transaction, such as the work that the record announces.

        Returns:
            `record`; or, if the key came before with the same body, what it created then, even if
            that has been deleted. Of two calls at the same time one creates, and both return what it created.

        Raises:
            NotFoundError: The robot or the measurement set that the record names is not there.
            IdempotencyConflictError: The key came before with another body.
        """
        kind = type(record)
        for column, parent in PARENTS[kind].items():
            if not _is_indexable(identifier := getattr(record, column)):
                raise NotFoundError(parent, identifier)
        try:
            with self._database.writing() as connection:
                if key is not None:  # first, as the loser of a race waits here
                    connection.execute(INSERT_KEY, _key_row(record, key))
                connection.execute(STATEMENTS[kind].insert, _record_row(record))
                if also is not None:
                    also(connection)
        except IntegrityError as error:
            return self._not_added(record, key, error)
        return record

    def find(self, kind: type[Record], key: IdempotencyKey) -> Record | None:
        """What `key` created, if it came before.

        Raises:
            IdempotencyConflictError: It came with another body.
        """
        query = {"resource": TABLES[kind].name, "key_hash": _hash(key.key)}
        with self._database.reading() as connection:
            row = connection.execute(STATEMENTS[kind].by_key, query).one_or_none()
        if row is None:
            return None
        if row.body_hash != key.body_hash:
            raise IdempotencyConflictError(kind, key.key)
        return kind(*_values(row[1:]))

    def get(self, kind: type[Record], identifier: str) -> Record:
        """The record of that id.

        Raises:
            NotFoundError: There is none.
            DeletedError: It was deleted.
        """
        row = None
        if _is_indexable(identifier):
            with self._database.reading() as connection:
                row = connection.execute(STATEMENTS[kind].by_id, {"id": identifier}).one_or_none()
        if row is None:
            deleted = _is_indexable(identifier) and self._exists(kind, identifier)
            raise (DeletedError if deleted else NotFoundError)(kind, identifier)
        return kind(*_values(row))

    def page(
        self,
        kind: type[Entry],
        *,
        limit: int,
        cursor: str | None = None,
        filters: Mapping[str, str] = _NO_FILTERS,
    ) -> RecordPage[Entry]:
        """One page, newest first. Records that are added meanwhile do not disturb the next one.

        Args:
            kind: What to list. Sets and runs are listed as entries, without their contents.
            limit: How many at most, one or more.
            cursor: `next` of the page before; none for the first page.
            filters: Column → value that it must have; the columns are `service.store.tables.FILTERS`.

        Raises:
            CursorError: No page gave this cursor.
        """
        if limit < 1 or not filters.keys() <= FILTERS[kind]:
            raise ValueError(f"no page of {limit} {kind.title}s by {', '.join(filters)}")
        before = _LAST_SEQUENCE if cursor is None else _parse_cursor(cursor)
        if not all(map(_is_indexable, filters.values())):
            return RecordPage((), None)
        query = STATEMENTS[kind].page(sorted(filters))
        with self._database.reading() as connection:
            rows = connection.execute(query, {**filters, "before": before, "limit": limit + 1}).all()
        return _page(kind, rows, limit)

    def _not_added(self, record: Record, key: IdempotencyKey | None, error: IntegrityError) -> Record:
        """Find out which constraint `record` broke: its key came before, or a parent is missing."""
        kind = type(record)
        earlier = None if key is None else self.find(kind, key)
        if earlier is not None:
            return earlier
        for column, parent in PARENTS[kind].items():
            if not self._exists(parent, identifier := getattr(record, column)):
                raise NotFoundError(parent, identifier) from error
        raise StoreError(
            f"there is a {kind.title} {record.id} already", "give each record an id of its own"
        ) from error

    def _exists(self, kind: type[AnyRecord], identifier: str) -> bool:
        with self._database.reading() as connection:
            found = connection.execute(STATEMENTS[kind].exists, {"id": identifier})
            return found.one_or_none() is not None


def _record_row(record: AnyRecord) -> dict[str, object]:
    return {field.name: getattr(record, field.name) for field in fields(record)}


def _key_row(record: AnyRecord, key: IdempotencyKey) -> dict[str, object]:
    return {
        "resource": TABLES[type(record)].name,
        "key_hash": _hash(key.key),
        "body_hash": key.body_hash,
        "resource_id": record.id,
        "created_at": record.created_at,
    }


def _page(kind: type[Entry], rows: Sequence[Row[Any]], limit: int) -> RecordPage[Entry]:
    """The page from its rows, each led by its place in the sequence, one more than it shows."""
    shown = rows[:limit]
    records = tuple(kind(*_values(row[1:])) for row in shown)
    return RecordPage(records, str(shown[-1].sequence) if len(rows) > limit else None)


def _values(row: Sequence[Any]) -> Sequence[Any]:
    """A row without the type of its columns, which mypy would count."""
    return row


def _parse_cursor(cursor: str) -> int:
    if cursor.isascii() and cursor.isdecimal() and len(cursor) <= len(str(_LAST_SEQUENCE)):
        sequence = int(cursor)
        if 0 < sequence <= _LAST_SEQUENCE:
            return sequence
    raise CursorError(cursor)


def _hash(key: str) -> str:
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


def _is_indexable(text: str) -> bool:
    """Whether both databases can hold `text` in an index; what they cannot hold is not there."""
    if len(text) > _MAX_INDEXED or "\x00" in text:
        return False
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
