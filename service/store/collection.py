"""The records of one table: added, found, listed, deleted; and journals, to which they are only added."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar, Final, Generic, TypeVar

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from jointstiff.service import problems
from jointstiff.service.store.database import Database, Quota
from jointstiff.service.store.tables import (
    AuditEntry,
    Entry,
    IdempotencyKey,
    LiveEntry,
    MeasurementSetEntry,
    MeasurementSetRecord,
    OpenSetRecord,
    Record,
    RecordPage,
    Row,
    idempotency_keys,
    jobs,
    live_entries,
    measurement_sets,
    of_records,
    open_sets,
    robots,
)

ROBOT: Final = problems.Resource("robot", "robots")
MEASUREMENT_SET: Final = problems.Resource("measurement set", "measurement-sets")
PARENTS: Final[Mapping[sa.Table, problems.Resource]] = MappingProxyType(
    {robots: ROBOT, measurement_sets: MEASUREMENT_SET}
)
"""Tables whose records others name."""

LAST_SEQUENCE: Final = 2**63 - 1
_MAX_INDEXED: Final = 500
"""Characters of an id or a name: PostgreSQL indexes up to 2704 bytes, schemas allow 200."""
_NO_FILTERS: Final[Mapping[str, str]] = MappingProxyType({})
_NO_SPANS: Final[Mapping[str, tuple[datetime | None, datetime | None]]] = MappingProxyType({})
_KEY: Final = sa.insert(idempotency_keys)
KEEP_DELETED: Final = timedelta(days=30)
"""Time for which a deleted resource can be restored."""
_NAMED: Final = 5  # resources that a refusal to delete names


def page_of(
    database: Database,
    table: sa.Table,
    record: type[Row],
    where: Iterable[sa.ColumnElement[bool]],
    limit: int,
    cursor: str | None,
) -> RecordPage[Row]:
    """Return one page of a table, newest first. Records that are added meanwhile do not disturb the next one.

    Args:
        database: of the table.
        table: with a column `sequence`.
        record: dataclass of the columns that are read.
        where: conditions of the listing.
        limit: how many records at most, one or more.
        cursor: `next` of the page before; none for the first page.

    Raises:
        CursorError: no page gave this cursor.
    """
    sequence = table.c.sequence
    before = LAST_SEQUENCE if cursor is None else parse_cursor(cursor)
    query = of_records(table, record).add_columns(sequence).where(sequence < before, *where)
    ordered = query.order_by(sequence.desc()).limit(sa.bindparam("limit", limit + 1, type_=sa.Integer))
    rows = [dict(row._mapping) for row in database.rows(ordered)]
    numbers = [row.pop("sequence") for row in rows]
    records = tuple(record(**row) for row in rows[:limit])
    return RecordPage(records, str(numbers[limit - 1]) if len(rows) > limit else None)


class Collection(Generic[Record, Entry]):
    """The records of one kind. Safe to use from several threads."""

    _ended: ClassVar[Sequence[sa.ColumnElement[bool]]] = ()
    """Conditions on which a record can be deleted."""

    def __init__(
        self,
        database: Database,
        resource: problems.Resource,
        table: sa.Table,
        record: type[Record],
        entry: type[Entry],
        quota: Quota,
        *mine: sa.ColumnElement[bool],
    ) -> None:
        """Keep records in a table, those of some conditions."""
        self._quota = quota
        self.resource = resource  # their names in messages and addresses
        self._database, self._table = database, table
        self._record: type[Record] = record
        self._entry: type[Entry] = entry
        shown, keys = table.c, idempotency_keys.c
        self._insert = sa.insert(table)
        self._mine = mine
        # columns that refer to other tables, with these; and columns of others that refer to this one
        self._references: list[tuple[sa.Column[Any], sa.Table]] = [
            (each, reference.column.table) for each in shown for reference in each.foreign_keys
        ]
        self._children: list[sa.Column[Any]] = [
            each
            for child in (measurement_sets, open_sets, jobs)
            for each in child.c
            if each.references(shown.id)
        ]
        columns = of_records(table, record).selected_columns
        self._visible, self._hidden = shown.deleted_at.is_(None), shown.deleted_at.is_not(None)
        self._exists = sa.select(shown.id).where(shown.id == sa.bindparam("id"), *self._mine)
        self._by_id_or_hidden = self._exists.with_only_columns(*columns)
        self._by_id = self._by_id_or_hidden.where(self._visible)
        self._by_key: sa.Select[Any] = (
            sa.select(keys.body_hash, *columns)
            .join_from(idempotency_keys, table, keys.resource_id == shown.id)
            .where(keys.resource == resource.collection, keys.key_hash == sa.bindparam("key_hash"))
        )

    def add(
        self,
        record: Record,
        key: IdempotencyKey | None = None,
        also: Callable[[sa.Connection], object] | None = None,
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
                raise problems.NotFoundError(parent, identifier)
        try:
            with self._database.writing() as connection:
                if key is not None:  # first, as the loser of a race waits here
                    own = {"resource": self.resource.collection, "key_hash": _hash(key.key)}
                    of_record = {"resource_id": record.id, "created_at": record.created_at}
                    connection.execute(_KEY, {**own, **of_record, "body_hash": key.body_hash})
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
        rows = self._database.rows(self._by_key, {"key_hash": _hash(key.key)})
        if not rows:
            return None
        (row,) = rows
        if row.body_hash != key.body_hash:
            raise problems.IdempotencyConflictError(self.resource, key.key)
        return self._record(**{name: value for name, value in row._mapping.items() if name != "body_hash"})

    def get(self, identifier: str, *, hidden: bool = False) -> Record:
        """Return the record of that id.

        Args:
            identifier: its id.
            hidden: whether it may be deleted.

        Raises:
            NotFoundError: there is none.
            DeletedError: it was deleted.
        """
        self._refuse_unindexable(identifier)
        by_id = self._by_id_or_hidden if hidden else self._by_id
        for row in self._database.rows(by_id, {"id": identifier}):
            return self._record(**row._mapping)
        was_deleted = self._finds(self._exists, identifier)
        raise (problems.DeletedError if was_deleted else problems.NotFoundError)(self.resource, identifier)

    def change(self, identifier: str, values: Mapping[str, object], *, hidden: bool = False) -> Record:
        """Change columns of a record that is no job, and return it as it is then.

        Args:
            identifier: its id.
            values: column → value; the others stay. Only columns that nothing was computed from.
            hidden: whether it may be deleted.

        Raises:
            NotFoundError: there is none.
            DeletedError: it was deleted.
        """
        if values and is_indexable(identifier):
            mine = sa.update(self._table).where(
                self._table.c.id == identifier, sa.true() if hidden else self._visible
            )
            self._database.change(mine.values(**values))
        return self.get(identifier, hidden=hidden)

    def page(
        self,
        *,
        limit: int,
        cursor: str | None = None,
        filters: Mapping[str, str] = _NO_FILTERS,
        spans: Mapping[str, tuple[datetime | None, datetime | None]] = _NO_SPANS,
        deleted: bool = False,
    ) -> RecordPage[Entry]:
        """Return one page, newest first, as `page_of` does.

        Args:
            limit: how many at most, one or more.
            cursor: `next` of the page before; none for the first page.
            filters: column, or field of the summary of a job → value that it must have.
            spans: column → first time that it may have, and the first that it may not have again.
            deleted: only deleted ones instead of the others.

        Raises:
            CursorError: no page gave this cursor.
        """
        if limit < 1 or not all(map(self._narrows, [*filters, *spans])):
            raise ValueError(f"no page of {limit} {self.resource.collection} by {', '.join(filters)}")
        if not all(map(is_indexable, filters.values())):
            return RecordPage((), None)
        columns = self._table.c
        where = [*self._mine, self._hidden if deleted else self._visible]
        where += [columns[name] == value for name, value in sorted(filters.items())]
        where += [columns[name] >= first for name, (first, _) in spans.items() if first is not None]
        where += [columns[name] < end for name, (_, end) in spans.items() if end is not None]
        return page_of(self._database, self._table, self._entry, where, limit, cursor)

    def delete(self, identifier: str, now: datetime | None = None) -> None:
        """Hide a resource; of one that is hidden the time of the first deletion stays.

        Args:
            identifier: its id.
            now: aware, from when on it is kept for `KEEP_DELETED`; the present if absent.

        Raises:
            NotFoundError: there is no such resource.
            NotEndedError: it is a job that has not ended.
            ReferencedError: others refer to it.
        """
        self._refuse_unindexable(identifier)
        hide = sa.update(self._table).where(*self._is(identifier), *self._ended, self._visible)
        now = now or datetime.now(UTC)
        with self._database.writing() as connection:
            if connection.execute(hide.values(deleted_at=now)).rowcount == 1:
                self._refuse_referenced(connection, identifier)  # none comes from now on
                self._follow(connection, identifier, now)
                return
            hidden = sa.select(self._hidden).where(*self._is(identifier))
            record = connection.execute(hidden).scalar_one_or_none()
        if record is None:
            raise problems.NotFoundError(self.resource, identifier)
        if not record:
            raise problems.NotEndedError(self.resource, identifier)

    def restore(self, identifier: str) -> None:
        """Bring a resource back; one that is not hidden stays as it is.

        Raises:
            NotFoundError: there is no such resource, or it has been removed.
            DeletedError: it refers to a robot or measurement set that is deleted.
        """
        self._refuse_unindexable(identifier)
        back = sa.update(self._table).where(*self._is(identifier)).values(deleted_at=None)
        named = [self._table.c.id, *(column for column, _ in self._references)]
        with self._database.writing() as connection:
            row = connection.execute(back.returning(*named)).one_or_none()
            if row is None:
                raise problems.NotFoundError(self.resource, identifier)
            self._hold_parents(connection, row)
            self._follow(connection, identifier, None)

    def refuse_deleted(self, identifier: str) -> None:
        """Do nothing, unless a resource is hidden.

        Raises:
            DeletedError: it is.
        """
        if self._finds(self._exists.where(self._hidden), identifier):
            raise problems.DeletedError(self.resource, identifier)

    def purge(self, before: datetime, limit: int) -> list[str]:
        """Remove for good what was deleted before a time, with the keys that name it.

        Args:
            before: aware.
            limit: resources at most, those deleted first.

        Returns:
            Ids of the resources that are no more; what deleted ones still refer to stays until they are gone.
        """
        keys, columns = idempotency_keys.c, self._table.c
        free: list[sa.ColumnElement[bool]] = [
            ~sa.exists().where(column == columns.id) for column in self._children
        ]
        old = [*self._mine, columns.deleted_at < before, *free]
        first = sa.select(columns.id).where(*old).order_by(columns.deleted_at).limit(limit)
        expired = [str(row.id) for row in self._database.rows(first)]
        if not expired:
            return []
        with self._database.writing() as connection:
            # Asked again in the transaction: one may have been restored meanwhile.
            remove = sa.delete(self._table).where(columns.id.in_(expired), *old).returning(columns.id)
            gone = [str(row.id) for row in connection.execute(remove).all()]
            named = [keys.resource == self.resource.collection, keys.resource_id.in_(gone)]
            connection.execute(sa.delete(idempotency_keys).where(*named))
            self._forget(connection, gone)
        return gone

    def _follow(self, connection: sa.Connection, identifier: str, deleted_at: datetime | None) -> None:
        """Hide what else is kept of a record that is hidden, or bring it back."""

    def _forget(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        """Remove what else is kept of records that are no more."""

    def _narrows(self, name: str) -> bool:
        """Return whether a listing can be narrowed by a column: only by one with an index."""
        return any(name in index.columns and "sequence" in index.columns for index in self._table.indexes)

    def _parents(self, record: object) -> Iterator[tuple[sa.Table, problems.Resource, str]]:
        """Yield the records that this one, or its row, names: table, resource, id."""
        for column, parent in self._references:
            if (identifier := getattr(record, column.name)) is not None:
                yield parent, PARENTS[parent], identifier

    def _hold_parents(self, connection: sa.Connection, record: object) -> None:
        """Keep what this one names from being deleted until it is stored; refuse it if it was."""
        for table, parent, identifier in self._parents(record):
            row = connection.execute(_held(table), {"id": identifier}).one_or_none()
            if row is not None and row.deleted_at is not None:
                raise problems.DeletedError(parent, identifier)

    def _not_added(self, record: Record, key: IdempotencyKey | None, error: IntegrityError) -> Record:
        """Find out which constraint the record broke: its key came before, or a parent is missing."""
        earlier = None if key is None else self.find(key)
        if earlier is not None:
            return earlier
        for table, parent, identifier in self._parents(record):
            if not self._finds(sa.select(table.c.id).where(table.c.id == sa.bindparam("id")), identifier):
                raise problems.NotFoundError(parent, identifier) from error
        raise problems.StoreError(
            f"a {self.resource.name} {record.id} already exists", "give each record a unique id"
        ) from error

    def _refuse_referenced(self, connection: sa.Connection, identifier: str) -> None:
        users: dict[str, str] = {}
        for column in self._children:
            table = column.table
            kind = table.c.kind if table is jobs else sa.literal(MEASUREMENT_SET.name)
            visible = sa.select(table.c.id, kind).where(column == identifier, table.c.deleted_at.is_(None))
            users |= {row[0]: row[1] for row in connection.execute(visible.limit(_NAMED + 1))}
        if users:
            named = [f"{kind} {user}" for user, kind in list(users.items())[:_NAMED]]
            raise problems.ReferencedError(self.resource, identifier, named, more=len(users) > _NAMED)

    def _is(self, identifier: str) -> list[sa.ColumnElement[bool]]:
        return [*self._mine, self._table.c.id == identifier]

    def _refuse_unindexable(self, identifier: str) -> None:
        """Refuse an id that a database may not even take as a text; none of ours is."""
        if not is_indexable(identifier):
            raise problems.NotFoundError(self.resource, identifier)

    def _finds(self, query: sa.Select[Any], identifier: str) -> bool:
        return bool(self._database.rows(query, {"id": identifier}))


class MeasurementSets(Collection[MeasurementSetRecord, MeasurementSetEntry]):
    """The ordinary measurement sets. The record of one that was measured live goes and returns with it."""

    def _follow(self, connection: sa.Connection, identifier: str, deleted_at: datetime | None) -> None:
        own = sa.update(open_sets).where(open_sets.c.id == identifier)
        connection.execute(own.values(deleted_at=deleted_at))


class OpenSets(Collection[OpenSetRecord, OpenSetRecord]):
    """The sets that are measured live, or were."""

    def _forget(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        connection.execute(sa.delete(live_entries).where(live_entries.c.set_id.in_(gone)))


def parse_cursor(cursor: str) -> int:
    """Return the number in the cursor of a page.

    Raises:
        CursorError: no page gave this cursor.
    """
    if cursor.isascii() and cursor.isdecimal() and len(cursor) <= len(str(LAST_SEQUENCE)):
        sequence = int(cursor)
        if 0 < sequence <= LAST_SEQUENCE:
            return sequence
    raise problems.CursorError(cursor)


@cache
def _held(table: sa.Table) -> sa.Select[Any]:
    """Return the query of when a record was deleted; none is from then until the transaction ends."""
    return sa.select(table.c.deleted_at).where(table.c.id == sa.bindparam("id")).with_for_update(read=True)


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


Noted = TypeVar("Noted", AuditEntry, LiveEntry)


class Journal(Generic[Noted]):
    """The records of one table, in the order in which they came. Safe to use from several threads."""

    def __init__(self, database: Database, table: sa.Table, record: type[Noted], quota: Quota | None) -> None:
        """Keep records in a table; without a quota they are added to a full database, too."""
        self._database, self._table, self._quota = database, table, quota
        self._record: type[Noted] = record
        self._all = of_records(table, record)

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
        query = self._all.filter_by(**values).order_by(self._table.c.sequence)
        return [self._record(*row) for row in self._database.rows(query)]

    def page(self, limit: int, cursor: str | None = None, **values: str | None) -> RecordPage[Noted]:
        """Return one page as `page_of` does, of records with these values in these columns; None for any."""
        where = [self._table.c[name] == value for name, value in values.items() if value is not None]
        return page_of(self._database, self._table, self._record, where, limit, cursor)

    def _insert(self, connection: sa.Connection, record: Noted) -> Noted:
        connection.execute(sa.insert(self._table).values(asdict(record)))
        return record


class LiveEntries(Journal[LiveEntry]):
    """The records of open sets. An entry of the same kind and label is not added again."""

    def _insert(self, connection: sa.Connection, record: LiveEntry) -> LiveEntry:
        # Entries of one set take turns: none follows the one that closes it.
        held = sa.select(open_sets.c.deleted_at).where(open_sets.c.id == record.set_id).with_for_update()
        row = connection.execute(held).one_or_none()
        if row is None or row.deleted_at is not None:
            raise problems.NotFoundError(MEASUREMENT_SET, record.set_id)
        columns = live_entries.c
        mine = self._all.where(columns.set_id == record.set_id)
        same = mine.where(columns.change == record.change, columns.label == record.label)
        for found in connection.execute(same):
            return self._record(*found)
        for _ in connection.execute(mine.where(columns.change == "closed")):
            raise problems.ClosedError(record.set_id)
        return super()._insert(connection, record)
