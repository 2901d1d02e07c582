"""The records of one kind: added, found, and listed in the order in which they came."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, fields
from datetime import datetime
from types import MappingProxyType
from typing import Any, Final, Generic

from sqlalchemy import Connection, Integer, Select, Table, bindparam, insert, select, true, update
from sqlalchemy.exc import IntegrityError

from jointstiff.service.problems.errors import (
    CursorError,
    DeletedError,
    IdempotencyConflictError,
    NotFoundError,
    Resource,
    StoreError,
)
from jointstiff.service.store.database import Database
from jointstiff.service.store.quota import Quota
from jointstiff.service.store.records import Entry, IdempotencyKey, Record, RecordPage
from jointstiff.service.store.tables import idempotency_keys, jobs, measurement_sets, robots

ROBOT: Final = Resource("robot", "robots")
MEASUREMENT_SET: Final = Resource("measurement set", "measurement-sets")
PARENTS: Final[Mapping[Table, Resource]] = MappingProxyType(
    {robots: ROBOT, measurement_sets: MEASUREMENT_SET}
)
"""Tables whose records others name."""

LAST_SEQUENCE: Final = 2**63 - 1
_MAX_INDEXED: Final = 500
"""Characters of an id or a name: PostgreSQL indexes up to 2704 bytes, schemas allow 200."""
_NO_FILTERS: Final[Mapping[str, str]] = MappingProxyType({})
_NO_SPANS: Final[Mapping[str, tuple[datetime | None, datetime | None]]] = MappingProxyType({})
_KEY: Final = insert(idempotency_keys)


class Collection(Generic[Record, Entry]):
    """The records of one kind. Safe to use from several threads."""

    def __init__(
        self,
        database: Database,
        resource: Resource,
        table: Table,
        record: type[Record],
        entry: type[Entry],
        quota: Quota,
    ) -> None:
        """Keep records in a table; of the table of jobs, those of the resource's kind."""
        self._quota = quota
        self.resource = resource  # their names in messages and addresses
        self._database, self._table = database, table
        self._record: type[Record] = record
        self._entry: type[Entry] = entry
        shown, keys = table.c, idempotency_keys.c
        self._insert = insert(table)
        self._mine = [table.c.kind == resource.name] if table is jobs else []
        columns = [shown[field.name] for field in fields(record)]
        self._visible, self._hidden = shown.deleted_at.is_(None), shown.deleted_at.is_not(None)
        self._exists = select(shown.id).where(shown.id == bindparam("id"), *self._mine)
        self._by_id = self._exists.with_only_columns(*columns).where(self._visible)
        self._by_key: Select[Any] = (
            select(keys.body_hash, *columns)
            .join_from(idempotency_keys, table, keys.resource_id == shown.id)
            .where(keys.resource == resource.collection, keys.key_hash == bindparam("key_hash"))
        )

    def add(
        self,
        record: Record,
        key: IdempotencyKey | None = None,
        also: Callable[[Connection], object] | None = None,
    ) -> Record:
        """Store a record and its idempotency key in one transaction.

        Args:
            record: what to store.
            key: the idempotency key that came with it.
            also: what else belongs into the transaction, such as the work that the record announces.

        Returns:
            The record; or, if the key came before with the same body, what it created then, even if that
            has been deleted. Of two calls at the same time one creates, and both return what it created.

        Raises:
            NotFoundError: a robot or measurement set that the record names is not there, or was deleted.
            IdempotencyConflictError: the key came before with another body.
            QuotaError: the database has the size that it may have.
        """
        self._quota.refuse_full()
        for _, parent, identifier in self._parents(record):
            if not is_indexable(identifier):
                raise NotFoundError(parent, identifier)
        try:
            with self._database.writing() as connection:
                if key is not None:  # first, as the loser of a race waits here
                    connection.execute(_KEY, self._key_row(record, key))
                self._hold_parents(connection, record)
                connection.execute(self._insert, asdict(record))
                if also is not None:
                    also(connection)
        except IntegrityError as error:
            return self._not_added(record, key, error)
        return record

    def find(self, key: IdempotencyKey) -> Record | None:
        """Return what a key created, deleted or not; None if it did not come before.

        Raises:
            IdempotencyConflictError: it came with another body.
        """
        with self._database.reading() as connection:
            row = connection.execute(self._by_key, {"key_hash": _hash(key.key)}).one_or_none()
        if row is None:
            return None
        if row.body_hash != key.body_hash:
            raise IdempotencyConflictError(self.resource, key.key)
        return self._record(**{name: value for name, value in row._mapping.items() if name != "body_hash"})

    def get(self, identifier: str) -> Record:
        """Return the record of that id.

        Raises:
            NotFoundError: there is none.
            DeletedError: it was deleted.
        """
        row = None
        if is_indexable(identifier):
            with self._database.reading() as connection:
                row = connection.execute(self._by_id, {"id": identifier}).one_or_none()
        if row is None:
            deleted = is_indexable(identifier) and self._finds(self._exists, identifier)
            raise (DeletedError if deleted else NotFoundError)(self.resource, identifier)
        return self._record(**row._mapping)

    def change(self, identifier: str, values: Mapping[str, object]) -> Record:
        """Change columns of a record that is no job, and return it as it is then.

        Args:
            identifier: its id.
            values: column → value; the others stay. Only columns that nothing was computed from.

        Raises:
            NotFoundError: there is none.
            DeletedError: it was deleted.
        """
        if values and is_indexable(identifier):
            mine = update(self._table).where(self._table.c.id == identifier, self._visible)
            with self._database.writing() as connection:
                connection.execute(mine.values(**values))
        return self.get(identifier)

    def page(
        self,
        *,
        limit: int,
        cursor: str | None = None,
        filters: Mapping[str, str] = _NO_FILTERS,
        spans: Mapping[str, tuple[datetime | None, datetime | None]] = _NO_SPANS,
        deleted: bool = False,
        archived: bool = False,
    ) -> RecordPage[Entry]:
        """Return one page, newest first. Records that are added meanwhile do not disturb the next one.

        Args:
            limit: how many at most, one or more.
            cursor: `next` of the page before; none for the first page.
            filters: column, or field of the summary of a job → value that it must have.
            spans: column → first time that it may have, and the first that it may not have again.
            deleted: only deleted ones instead of the others.
            archived: only archived ones instead of the others; of deleted ones all are shown.

        Raises:
            CursorError: no page gave this cursor.
        """
        if limit < 1 or not all(map(self._narrows, [*filters, *spans])):
            raise ValueError(f"no page of {limit} {self.resource.collection} by {', '.join(filters)}")
        before = LAST_SEQUENCE if cursor is None else parse_cursor(cursor)
        if not all(map(is_indexable, filters.values())):
            return RecordPage((), None)
        columns = self._table.c
        query = (
            select(columns.sequence, *(columns[field.name] for field in fields(self._entry)))
            .where(columns.sequence < before, *self._mine, self._hidden if deleted else self._visible)
            .where(true() if deleted or "archived" not in columns else columns.archived.is_(archived))
            .where(*(columns[name] == value for name, value in sorted(filters.items())))
            .where(*(columns[name] >= first for name, (first, _) in spans.items() if first is not None))
            .where(*(columns[name] < end for name, (_, end) in spans.items() if end is not None))
            .order_by(columns.sequence.desc())
            .limit(bindparam("limit", limit + 1, type_=Integer))
        )
        with self._database.reading() as connection:
            rows = connection.execute(query).all()
        names = [field.name for field in fields(self._entry)]
        records = tuple(self._entry(**dict(zip(names, row[1:], strict=True))) for row in rows[:limit])
        return RecordPage(records, str(rows[limit - 1].sequence) if len(rows) > limit else None)

    def _narrows(self, name: str) -> bool:
        """Return whether a listing can be narrowed by a column: only by one with an index."""
        return any(name in index.columns and "sequence" in index.columns for index in self._table.indexes)

    def _parents(self, record: Record) -> Iterator[tuple[Table, Resource, str]]:
        """Yield the records that this one names: table, resource, id."""
        for column in self._table.c:
            for reference in column.foreign_keys:
                parent = reference.column.table
                if (identifier := getattr(record, column.name)) is not None:
                    yield parent, PARENTS[parent], identifier

    def _hold_parents(self, connection: Connection, record: Record) -> None:
        """Keep the records that this one names from being deleted until it is stored."""
        for table, parent, identifier in self._parents(record):
            held = select(table.c.deleted_at).where(table.c.id == identifier).with_for_update(read=True)
            row = connection.execute(held).one_or_none()
            if row is not None and row.deleted_at is not None:
                raise DeletedError(parent, identifier)

    def _not_added(self, record: Record, key: IdempotencyKey | None, error: IntegrityError) -> Record:
        """Find out which constraint the record broke: its key came before, or a parent is missing."""
        earlier = None if key is None else self.find(key)
        if earlier is not None:
            return earlier
        for table, parent, identifier in self._parents(record):
            if not self._finds(select(table.c.id).where(table.c.id == bindparam("id")), identifier):
                raise NotFoundError(parent, identifier) from error
        raise StoreError(
            f"a {self.resource.name} {record.id} already exists", "give each record a unique id"
        ) from error

    def _finds(self, query: Select[Any], identifier: str) -> bool:
        with self._database.reading() as connection:
            return connection.execute(query, {"id": identifier}).one_or_none() is not None

    def _key_row(self, record: Record, key: IdempotencyKey) -> dict[str, object]:
        return {
            "resource": self.resource.collection,
            "key_hash": _hash(key.key),
            "body_hash": key.body_hash,
            "resource_id": record.id,
            "created_at": record.created_at,
        }


def parse_cursor(cursor: str) -> int:
    """Return the number in the cursor of a page.

    Raises:
        CursorError: no page gave this cursor.
    """
    if cursor.isascii() and cursor.isdecimal() and len(cursor) <= len(str(LAST_SEQUENCE)):
        sequence = int(cursor)
        if 0 < sequence <= LAST_SEQUENCE:
            return sequence
    raise CursorError(cursor)


def _hash(key: str) -> str:
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


def is_indexable(text: str) -> bool:
    """Return whether both databases can hold a text in an index; what they cannot hold is not there."""
    if len(text) > _MAX_INDEXED or "\x00" in text:
        return False
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
