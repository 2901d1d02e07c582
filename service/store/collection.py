"""The records of one table: added, found, listed, deleted; and journals, to which they are only added."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar, Final, Generic, TypeVar

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from jointstiff.service import problems
from jointstiff.service.store.database import Database, Quota
from jointstiff.service.store.listing import Order, is_indexable, read_page, search_text_of
from jointstiff.service.store.tables import (
    DUE,
    AuditEntry,
    Entry,
    IdempotencyKey,
    LiveEntry,
    MeasurementSetEntry,
    MeasurementSetRecord,
    OpenSetRecord,
    Record,
    RecordPage,
    RobotEntry,
    RobotRecord,
    RobotRow,
    idempotency_keys,
    jobs,
    last_campaigns,
    live_entries,
    measurement_sets,
    open_sets,
    robots,
    select_fields_of,
)

ROBOT: Final = problems.Resource("robot", "robots")
MEASUREMENT_SET: Final = problems.Resource("measurement set", "measurement-sets")
PARENTS: Final[Mapping[sa.Table, problems.Resource]] = MappingProxyType(
    {robots: ROBOT, measurement_sets: MEASUREMENT_SET}
)
"""Tables whose records are named by other records, and their names in messages."""

_NO_FILTERS: Final[Mapping[str, str]] = MappingProxyType({})
_NO_SPANS: Final[Mapping[str, tuple[datetime | None, datetime | None]]] = MappingProxyType({})
_KEY: Final = sa.insert(idempotency_keys)
KEEP_DELETED: Final = timedelta(days=30)
"""Time for which a deleted resource can be restored."""
_PORTION: Final = 500  # greatest number of ids in one statement
_NAMED: Final = 5  # greatest number of resources that a refusal to delete names


class Collection(Generic[Record, Entry]):
    """The records of one kind. Safe to use from several threads."""

    _ended: ClassVar[Sequence[sa.ColumnElement[bool]]] = ()
    """Conditions on which a record can be deleted."""
    _listed: ClassVar[Sequence[sa.ColumnElement[bool]]] = ()
    """Further conditions on which a record is listed."""

    def __init__(
        self,
        database: Database,
        resource: problems.Resource,
        table: sa.Table,
        record: type[Record],
        entry: type[Entry],
        quota: Quota,
        *conditions: sa.ColumnElement[bool],
    ) -> None:
        """Serve the records of a table that meet all conditions."""
        self._quota = quota
        self.resource = resource  # names of the records in messages and addresses
        self._database, self._table = database, table
        self._record: type[Record] = record
        self._entry: type[Entry] = entry
        shown, keys = table.c, idempotency_keys.c
        self._insert = sa.insert(table)
        self._own_conditions = conditions
        # Columns that refer to other tables, with these tables; and columns of other tables that refer here.
        self._references: list[tuple[sa.Column[Any], sa.Table]] = [
            (each, reference.column.table) for each in shown for reference in each.foreign_keys
        ]
        self._children: list[sa.Column[Any]] = [
            each
            for child in (measurement_sets, open_sets, jobs)
            for each in child.c
            if each.references(shown.id)
        ]
        columns = select_fields_of(table, record).selected_columns
        self._entries = self._rows_listed()
        self._visible, self._hidden = shown.deleted_at.is_(None), shown.deleted_at.is_not(None)
        self._exists = sa.select(shown.id).where(shown.id == sa.bindparam("id"), *self._own_conditions)
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
            also: function that writes more in the same transaction, such as an entry in the queue of jobs.

        Returns:
            The record; or, if the key came before with the same body, the record that it created then, even
            a deleted one. Of two simultaneous calls one creates, and both return the same record.

        Raises:
            NotFoundError: a robot or measurement set that the record names does not exist, or was deleted.
            IdempotencyConflictError: the key came before with another body.
            QuotaError: the database has reached its quota.
        """
        self._quota.refuse_full()
        for _, table, identifier in self._list_parents(record):
            if not is_indexable(identifier):
                raise problems.NotFoundError(PARENTS[table], identifier)
        try:
            with self._database.writing() as connection:
                if key is not None:  # first: the second of two equal posts waits here for the first one
                    own = {"resource": self.resource.collection, "key_hash": _hash(key.key)}
                    of_record = {"resource_id": record.id, "created_at": record.created_at}
                    connection.execute(_KEY, {**own, **of_record, "body_hash": key.body_hash})
                named = self._lock_parents(connection, record)
                connection.execute(self._insert, asdict(record) | self._copied_names(record, named))
                if also is not None:
                    also(connection)
                self._mark_campaign_outdated(connection, record.id)
        except IntegrityError as error:
            return self._explain_failed_insert(record, key, error)
        return record

    def find(self, key: IdempotencyKey) -> Record | None:
        """Return the record that an idempotency key created, deleted or not; None for a new key.

        Raises:
            IdempotencyConflictError: the key came before with another body.
        """
        rows = self._database.rows(self._by_key, {"key_hash": _hash(key.key)})
        if not rows:
            return None
        (row,) = rows
        if row.body_hash != key.body_hash:
            raise problems.IdempotencyConflictError(self.resource, key.key)
        return self._record(**{name: value for name, value in row._mapping.items() if name != "body_hash"})

    def get(self, identifier: str, *, hidden: bool = False) -> Record:
        """Return the record with an id.

        Args:
            identifier: the id.
            hidden: whether a deleted record is returned, too.

        Raises:
            NotFoundError: no record has this id.
            DeletedError: the record was deleted.
        """
        self._refuse_unindexable(identifier)
        by_id = self._by_id_or_hidden if hidden else self._by_id
        for row in self._database.rows(by_id, {"id": identifier}):
            return self._record(**row._mapping)
        was_deleted = self._has_row(self._exists, identifier)
        raise (problems.DeletedError if was_deleted else problems.NotFoundError)(self.resource, identifier)

    def change(self, identifier: str, values: Mapping[str, object], *, hidden: bool = False) -> Record:
        """Change columns of a record that is no job; return the changed record.

        Args:
            identifier: id of the record.
            values: column → new value; only columns from which nothing was computed.
            hidden: whether a deleted record can be changed, too.

        Raises:
            NotFoundError: no record has this id.
            DeletedError: the record was deleted.
        """
        if values and is_indexable(identifier):
            is_record = [self._table.c.id == identifier, sa.true() if hidden else self._visible]
            with self._database.writing() as connection:
                if connection.execute(sa.update(self._table).where(*is_record).values(**values)).rowcount:
                    self._rename(connection, identifier)
                    self._mark_campaign_outdated(connection, identifier)
        return self.get(identifier, hidden=hidden)

    def page(
        self,
        *,
        limit: int,
        cursor: str | None = None,
        filters: Mapping[str, str] = _NO_FILTERS,
        spans: Mapping[str, tuple[datetime | None, datetime | None]] = _NO_SPANS,
        deleted: bool = False,
        q: str | None = None,
        sort: str = "-created_at",
        counted: bool = False,
    ) -> RecordPage[Entry]:
        """Return one page of the records, filtered, searched and sorted.

        Args:
            limit: greatest number of records, one or more.
            cursor: `next` of the page before; none for the first page.
            filters: column → value that it must have.
            spans: column of times → begin (included) and end (excluded); None for no limit.
            deleted: whether to list deleted records in place of the others.
            q: words that are all parts of a name that the listing shows.
            sort: `created_at` or `name`; with a minus downwards.
            counted: whether to count the records on all pages, at the first one.

        Raises:
            CursorError: no page gave this cursor.
        """
        if limit < 1 or not all(map(self._can_filter_by, [*filters, *spans])):
            raise ValueError(f"no page of {limit} {self.resource.collection} by {', '.join(filters)}")
        if not all(map(is_indexable, [*filters.values(), q or ""])):
            return RecordPage((), None, 0)
        columns = self._table.c
        where = [*self._own_conditions, *self._listed, self._hidden if deleted else self._visible]
        where += [columns[name] == value for name, value in sorted(filters.items())]
        where += [columns[name] >= first for name, (first, _) in spans.items() if first is not None]
        where += [columns[name] < end for name, (_, end) in spans.items() if end is not None]
        order = Order(limit, cursor, q, sort, counted)
        return read_page(self._database, self._table, self._entries, self._entry, where, order)

    def delete(self, identifier: str, now: datetime | None = None) -> None:
        """Hide a resource, which can be restored for `KEEP_DELETED`; a repeated call changes nothing.

        Args:
            identifier: id of the resource.
            now: time of the deletion, with a time zone; None for the present.

        Raises:
            NotFoundError: there is no such resource.
            NotEndedError: the resource is a job that has not ended.
            ReferencedError: other resources refer to it.
        """
        self._refuse_unindexable(identifier)
        hide = sa.update(self._table).where(*self._id_conditions(identifier), *self._ended, self._visible)
        now = now or datetime.now(UTC)
        with self._database.writing() as connection:
            if connection.execute(hide.values(deleted_at=now)).rowcount == 1:
                self._refuse_referenced(
                    connection, identifier
                )  # its row is locked: no reference comes from now on
                self._hide_or_restore_related(connection, identifier, now)
                self._mark_campaign_outdated(connection, identifier)
                return
            hidden = sa.select(self._hidden).where(*self._id_conditions(identifier))
            record = connection.execute(hidden).scalar_one_or_none()
        if record is None:
            raise problems.NotFoundError(self.resource, identifier)
        if not record:
            raise problems.NotEndedError(self.resource, identifier)

    def restore(self, identifier: str) -> None:
        """Bring a deleted resource back; a resource that is not deleted stays as it is.

        Raises:
            NotFoundError: there is no such resource, or it has been removed.
            DeletedError: the resource refers to a deleted robot or measurement set.
        """
        self._refuse_unindexable(identifier)
        back = sa.update(self._table).where(*self._id_conditions(identifier)).values(deleted_at=None)
        named = [self._table.c.id, *(column for column, _ in self._references)]
        with self._database.writing() as connection:
            row = connection.execute(sa.select(*named).where(*self._id_conditions(identifier))).one_or_none()
            if row is not None:
                self._lock_parents(
                    connection, row
                )  # locked before the own row, in the order of renaming: no deadlock
            if row is None or connection.execute(back).rowcount == 0:
                raise problems.NotFoundError(self.resource, identifier)
            self._hide_or_restore_related(connection, identifier, None)
            self._mark_campaign_outdated(connection, identifier)

    def refuse_deleted(self, identifier: str) -> None:
        """Raise an error if a resource is deleted.

        Raises:
            DeletedError: the resource is deleted.
        """
        if self._has_row(self._exists.where(self._hidden), identifier):
            raise problems.DeletedError(self.resource, identifier)

    def purge(self, before: datetime, limit: int) -> list[str]:
        """Remove resources for good that were deleted before a time, with their idempotency keys.

        A resource stays as long as others refer to it, even deleted ones.

        Args:
            before: the time, with a time zone.
            limit: greatest number of resources; those deleted first are removed first.

        Returns:
            Ids of the removed resources.
        """
        keys, columns = idempotency_keys.c, self._table.c
        free: list[sa.ColumnElement[bool]] = [
            ~sa.exists().where(column == columns.id) for column in self._children
        ]
        old = [*self._own_conditions, columns.deleted_at < before, *free]
        first = sa.select(columns.id).where(*old).order_by(columns.deleted_at).limit(limit)
        expired = [str(row.id) for row in self._database.rows(first)]
        if not expired:
            return []
        with self._database.writing() as connection:
            # Conditions are checked again in the transaction: a resource may have been restored meanwhile.
            remove = sa.delete(self._table).where(columns.id.in_(expired), *old).returning(columns.id)
            gone = [str(row.id) for row in connection.execute(remove).all()]
            named = [keys.resource == self.resource.collection, keys.resource_id.in_(gone)]
            connection.execute(sa.delete(idempotency_keys).where(*named))
            self._delete_related(connection, gone)
        return gone

    def _hide_or_restore_related(
        self, connection: sa.Connection, identifier: str, deleted_at: datetime | None
    ) -> None:
        """Hide the related rows of a hidden record, or bring them back (`deleted_at` None); a hook."""

    def _rows_listed(self) -> sa.Select[Any]:
        """Return the query of the columns that a listing shows."""
        return select_fields_of(self._table, self._entry)

    def _copied_names(self, record: Record, named: Mapping[str, Any]) -> dict[str, str | None]:  # noqa: ARG002 - for those who copy
        """Return the columns with copies of names, for listings: names of the record and of its parents.

        Args:
            record: record that is about to be stored.
            named: column → row of the parent that the column names.
        """
        return _robot_name_columns(record.name or "")

    def _rename(self, connection: sa.Connection, identifier: str) -> None:
        """Update the copies of names after a change of a record; a hook."""

    def _mark_campaign_outdated(self, connection: sa.Connection, identifier: str) -> None:
        """Mark the last campaign of the record's robot as outdated, last in a transaction; a hook."""

    def _delete_related(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        """Delete the related rows of deleted records; a hook for collections that have some."""

    def _can_filter_by(self, name: str) -> bool:
        """Return whether a listing can be filtered by a column, that is whether an index has the column."""
        return any(name in index.columns for index in self._table.indexes)

    def _list_parents(self, record: object) -> Iterator[tuple[sa.Column[Any], sa.Table, str]]:
        """Yield the parents that a record, or its row, names: column, table and id of each."""
        for column, parent in self._references:
            if (identifier := getattr(record, column.name)) is not None:
                yield column, parent, identifier

    def _lock_parents(self, connection: sa.Connection, record: object) -> dict[str, Any]:
        """Lock the parents that a record names until the transaction ends.

        Returns:
            Column → row of the parent that the column names.

        Raises:
            DeletedError: a parent was deleted.
        """
        named = {}
        for column, table, identifier in self._list_parents(record):
            row = connection.execute(_lock_parent_query(table), {"id": identifier}).one_or_none()
            if row is not None and row.deleted_at is not None:
                raise problems.DeletedError(PARENTS[table], identifier)
            named[column.name] = row
        return named

    def _explain_failed_insert(
        self, record: Record, key: IdempotencyKey | None, error: IntegrityError
    ) -> Record:
        """Find out which constraint an insert broke; return the record that its key created before.

        Raises:
            NotFoundError: a parent does not exist.
            StoreError: the id exists already.
        """
        earlier = None if key is None else self.find(key)
        if earlier is not None:
            return earlier
        for _, table, identifier in self._list_parents(record):
            if not self._has_row(sa.select(table.c.id).where(table.c.id == sa.bindparam("id")), identifier):
                raise problems.NotFoundError(PARENTS[table], identifier) from error
        raise problems.StoreError(
            f"a {self.resource.name} {record.id} already exists", "give each record a unique id"
        ) from error

    def _refuse_referenced(self, connection: sa.Connection, identifier: str) -> None:
        """Raise `ReferencedError` if visible records refer to a record."""
        users: dict[str, str] = {}
        for column in self._children:
            table = column.table
            kind = table.c.kind if table is jobs else sa.literal(MEASUREMENT_SET.name)
            visible = sa.select(table.c.id, kind).where(column == identifier, table.c.deleted_at.is_(None))
            users |= {row[0]: row[1] for row in connection.execute(visible.limit(_NAMED + 1))}
        if users:
            named = [f"{kind} {user}" for user, kind in list(users.items())[:_NAMED]]
            raise problems.ReferencedError(self.resource, identifier, named, more=len(users) > _NAMED)

    def _id_conditions(self, identifier: str) -> list[sa.ColumnElement[bool]]:
        """Return the conditions of the row with an id in this collection."""
        return [*self._own_conditions, self._table.c.id == identifier]

    def _refuse_unindexable(self, identifier: str) -> None:
        """Raise `NotFoundError` for an id that a database cannot look up, such as a very long text."""
        if not is_indexable(identifier):
            raise problems.NotFoundError(self.resource, identifier)

    def _has_row(self, query: sa.Select[Any], identifier: str) -> bool:
        """Return whether a query with the parameter `id` finds a row."""
        return bool(self._database.rows(query, {"id": identifier}))


class Robots(Collection[RobotRecord, RobotEntry]):
    """The robots; a listing shows the last campaign of each robot, which is derived from its runs."""

    def __init__(self, database: Database, quota: Quota) -> None:
        super().__init__(database, ROBOT, robots, RobotRecord, RobotEntry, quota)

    def entry(self, identifier: str) -> RobotEntry:
        """Return the entry of a robot in a listing.

        Raises:
            NotFoundError: there is no such robot.
        """
        for row in self._database.rows(self._entries.where(robots.c.id == identifier)):
            return RobotEntry(**row._mapping)
        raise problems.NotFoundError(ROBOT, identifier)

    def list_outdated(self, most: int) -> list[RobotEntry]:
        """Return at most so many robots whose last campaign is outdated."""
        named = sa.select(last_campaigns.c.robot_id).where(sa.text(DUE)).limit(most)
        rows = self._database.rows(self._entries.where(robots.c.id.in_(named)))
        return [RobotEntry(**row._mapping) for row in rows]

    def store_last_campaign(self, entry: RobotEntry, campaign: dict[str, Any] | None) -> None:
        """Store the last campaign of a robot, which was derived after its entry was read.

        If runs or sets changed since then, the campaign stays marked as outdated.
        """
        is_outdated = [last_campaigns.c.robot_id == entry.id, last_campaigns.c.changes >= entry.changes]
        older = sa.func.coalesce(last_campaigns.c.derived, 0) < entry.changes
        keep = sa.update(last_campaigns).where(*is_outdated, older)
        self._database.change(keep.values(derived=entry.changes, campaign=campaign))

    def _rows_listed(self) -> sa.Select[Any]:
        """Return the query of robots with their last campaigns."""
        derived = last_campaigns.c
        return (
            select_fields_of(robots, RobotRow)
            .add_columns(derived.changes, derived.derived, derived.campaign)
            .outerjoin_from(robots, last_campaigns, derived.robot_id == robots.c.id)
        )

    def _rename(self, connection: sa.Connection, identifier: str) -> None:
        """Update the copies of a robot's name in its sets and jobs."""
        _copy_names(connection, robots.c.id, identifier)
        # Sets before jobs, as when a set is renamed: in another order two transactions could deadlock.
        for table in (measurement_sets, open_sets, jobs):
            _copy_names(connection, table.c.robot_id, identifier)

    def _delete_related(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        """Delete the last campaigns of removed robots."""
        connection.execute(sa.delete(last_campaigns).where(last_campaigns.c.robot_id.in_(gone)))


class MeasurementSets(Collection[MeasurementSetRecord, MeasurementSetEntry]):
    """The ordinary measurement sets. The open set from which one was made is hidden and restored with it."""

    def named(self, set_ids: Sequence[str]) -> list[Any]:
        """Return rows with names and content hashes of some sets and their robots; sets may be deleted."""
        sets = measurement_sets.c
        names = sa.select(
            sets.id,
            sets.name,
            sets.robot_id,
            sets.content_hash,
            robots.c.name.label("robot_name"),
            robots.c.content_hash.label("robot_hash"),
        ).join_from(measurement_sets, robots, robots.c.id == sets.robot_id)
        return [
            row for ids in _portions(set_ids) for row in self._database.rows(names.where(sets.id.in_(ids)))
        ]

    def list_by_robot(self) -> dict[str, list[str]]:
        """Return robot id → ids of its sets, the last measured first; without deleted robots and sets."""
        sets = measurement_sets.c
        measured = sa.func.coalesce(sets.measured_at, sets.created_at)
        listed = (
            sa.select(sets.robot_id, sets.id)
            .join_from(measurement_sets, robots, robots.c.id == sets.robot_id)
            .where(sets.deleted_at.is_(None), robots.c.deleted_at.is_(None))
            .order_by(robots.c.sequence, measured.desc(), sets.sequence.desc())
        )
        found = dict[str, list[str]]()
        for row in self._database.rows(listed):
            found.setdefault(str(row.robot_id), []).append(str(row.id))
        return found

    def arrays(self, set_ids: Sequence[str]) -> Iterator[tuple[str, bytes]]:
        """Yield id and packed readings (npz) of some sets."""
        query = sa.select(measurement_sets.c.id, measurement_sets.c.arrays)
        for ids in _portions(set_ids):
            for row in self._database.rows(query.where(measurement_sets.c.id.in_(ids))):
                yield str(row.id), row.arrays

    def _hide_or_restore_related(
        self, connection: sa.Connection, identifier: str, deleted_at: datetime | None
    ) -> None:
        """Hide or restore the open set from which a measurement set was made."""
        own = sa.update(open_sets).where(open_sets.c.id == identifier)
        connection.execute(own.values(deleted_at=deleted_at))

    def _copied_names(self, record: MeasurementSetRecord, named: Mapping[str, Any]) -> dict[str, str | None]:
        """Return the robot's name and the text for searches, for a new set."""
        return _set_name_columns(record.name, value_of_parent(named, "robot_id"), record.serial_number)

    def _rename(self, connection: sa.Connection, identifier: str) -> None:
        """Update the copies of a set's name in its own row and in its jobs."""
        _copy_names(connection, measurement_sets.c.id, identifier)
        _copy_names(connection, jobs.c.measurement_set_id, identifier)

    def _mark_campaign_outdated(self, connection: sa.Connection, identifier: str) -> None:
        """Mark the last campaign of the set's robot as outdated."""
        robot_of = sa.select(measurement_sets.c.robot_id).where(measurement_sets.c.id == identifier)
        mark_campaigns_outdated(connection, last_campaigns.c.robot_id.in_(robot_of))


class OpenSets(Collection[OpenSetRecord, OpenSetRecord]):
    """The sets that are or were measured live; a listing has only those that are not closed."""

    _listed = (
        ~sa.exists().where(live_entries.c.set_id == open_sets.c.id, live_entries.c.change == "closed"),
    )

    def _copied_names(self, record: OpenSetRecord, named: Mapping[str, Any]) -> dict[str, str | None]:
        """Return the robot's name and the text for searches, for a new open set."""
        return _set_name_columns(record.name, value_of_parent(named, "robot_id"), None)

    def _delete_related(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        """Delete the entries of removed open sets."""
        connection.execute(sa.delete(live_entries).where(live_entries.c.set_id.in_(gone)))


def _portions(identifiers: Sequence[str]) -> Iterator[Sequence[str]]:
    """Yield ids in portions of a few hundred, as databases limit the parameters of a statement."""
    known = [each for each in identifiers if is_indexable(each)]
    for first in range(0, len(known), _PORTION):
        yield known[first : first + _PORTION]


def value_of_parent(named: Mapping[str, Any], column: str, name: str = "name") -> str | None:
    """Return the value of a column of a parent; None if the record names no parent in `column`."""
    row = named.get(column)
    return None if row is None else getattr(row, name)


def _robot_name_columns(name: str) -> dict[str, str | None]:
    """Return the columns with copies of names for a robot."""
    return {"words": search_text_of(name)}


def _set_name_columns(name: str, robot: str | None, serial_number: str | None) -> dict[str, str | None]:
    """Return the columns with copies of names for a measurement set, given the robot's name."""
    return {"robot_name": robot, "words": search_text_of(name, robot, serial_number)}


def job_name_columns(
    name: str | None, robot: str | None, measurement_set: str | None, serial_number: str | None
) -> dict[str, str | None]:
    """Return the columns with copies of names for a job; one without name is sorted by that of its set."""
    return {
        "robot_name": robot,
        "measurement_set_name": measurement_set,
        "serial_number": serial_number,
        "words": search_text_of(name or measurement_set, robot, serial_number, name and measurement_set),
    }


def _set_names_query(table: sa.Table, serial_number: sa.ColumnElement[Any]) -> sa.Select[Any]:
    """Return the query of sequence, name, robot's name and serial number of the sets in a table."""
    names = sa.select(table.c.sequence, table.c.name, robots.c.name, serial_number)
    return names.join_from(table, robots, robots.c.id == table.c.robot_id)


_NAMES: Final[Mapping[sa.Table, tuple[sa.Select[Any], Callable[..., dict[str, str | None]]]]] = (
    MappingProxyType(
        {
            robots: (sa.select(robots.c.sequence, robots.c.name), _robot_name_columns),
            measurement_sets: (
                _set_names_query(measurement_sets, measurement_sets.c.serial_number),
                _set_name_columns,
            ),
            open_sets: (_set_names_query(open_sets, sa.null()), _set_name_columns),
            jobs: (
                sa.select(
                    jobs.c.sequence,
                    jobs.c.name,
                    robots.c.name,
                    measurement_sets.c.name,
                    measurement_sets.c.serial_number,
                )
                .outerjoin_from(jobs, robots, robots.c.id == jobs.c.robot_id)
                .outerjoin(measurement_sets, measurement_sets.c.id == jobs.c.measurement_set_id),
                job_name_columns,
            ),
        }
    )
)
"""For each table the query of its names, and the function that makes the copied columns of them."""


def _copy_names(connection: sa.Connection, column: sa.Column[Any], identifier: str) -> None:
    """Update the copies of names in all rows with an id in a column, after a name changed."""
    table = column.table
    names, copied = _NAMES[table]
    # Rows are changed in one order: otherwise two transactions that rename could deadlock.
    found = connection.execute(names.where(column == identifier).order_by(table.c.sequence)).all()
    if changes := [{"own": number, **copied(*row)} for number, *row in found]:
        connection.execute(sa.update(table).where(table.c.sequence == sa.bindparam("own")), changes)


def mark_campaigns_outdated(connection: sa.Connection, where: sa.ColumnElement[bool]) -> bool:
    """Mark last campaigns that meet a condition as outdated; return whether there are any.

    It comes last in a transaction, as other transactions on runs of the robot wait until this one ends.
    """
    more = sa.update(last_campaigns).where(where).values(changes=last_campaigns.c.changes + 1)
    return connection.execute(more).rowcount > 0


@cache
def _lock_parent_query(table: sa.Table) -> sa.Select[Any]:
    """Return the query of a parent's names and time of deletion that locks its row against changes."""
    named = [table.c[name] for name in ("deleted_at", "name", "serial_number") if name in table.c]
    return sa.select(*named).where(table.c.id == sa.bindparam("id")).with_for_update(read=True)


def _hash(key: str) -> str:
    """Return the SHA-256 of an idempotency key, which may be any text."""
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


Noted = TypeVar("Noted", AuditEntry, LiveEntry)


class Journal(Generic[Noted]):
    """Records of one table that are only added, in the order of their arrival. Safe for several threads."""

    def __init__(self, database: Database, table: sa.Table, record: type[Noted], quota: Quota | None) -> None:
        """Keep records in a table; without a quota also in a full database."""
        self._database, self._table, self._quota = database, table, quota
        self._record: type[Noted] = record
        self._all = select_fields_of(table, record)

    def add(self, record: Noted) -> Noted:
        """Add a record and return it.

        Raises:
            QuotaError: the database has reached its quota.
        """
        if self._quota is not None:
            self._quota.refuse_full()
        with self._database.writing() as connection:
            return self._insert(connection, record)

    def find(self, **values: str) -> list[Noted]:
        """Return the records that have these values in these columns, oldest first."""
        if not all(map(is_indexable, values.values())):
            return []
        query = self._all.filter_by(**values).order_by(self._table.c.sequence)
        return [self._record(*row) for row in self._database.rows(query)]

    def page(
        self, limit: int, cursor: str | None = None, *, counted: bool = False, **values: str | None
    ) -> RecordPage[Noted]:
        """Return one page of the records with these values in these columns; None allows any value."""
        where = [self._table.c[name] == value for name, value in values.items() if value is not None]
        order = Order(limit, cursor, counted=counted)
        return read_page(self._database, self._table, self._all, self._record, where, order)

    def _insert(self, connection: sa.Connection, record: Noted) -> Noted:
        """Insert a record and return it."""
        connection.execute(sa.insert(self._table).values(asdict(record)))
        return record


class LiveEntries(Journal[LiveEntry]):
    """Entries of open sets. For an entry of a known kind and label the stored entry is returned."""

    def _insert(self, connection: sa.Connection, record: LiveEntry) -> LiveEntry:
        """Insert an entry and return it, or return the stored entry of the same kind and label.

        Raises:
            NotFoundError: there is no such open set, or it was deleted.
            ClosedError: the set is closed.
        """
        # The lock on the set lets its entries come one by one: no entry follows the closing one.
        held = sa.select(open_sets.c.deleted_at).where(open_sets.c.id == record.set_id).with_for_update()
        row = connection.execute(held).one_or_none()
        if row is None or row.deleted_at is not None:
            raise problems.NotFoundError(MEASUREMENT_SET, record.set_id)
        columns = live_entries.c
        of_set = self._all.where(columns.set_id == record.set_id)
        same = of_set.where(columns.change == record.change, columns.label == record.label)
        for found in connection.execute(same):
            return self._record(*found)
        for _ in connection.execute(of_set.where(columns.change == "closed")):
            raise problems.ClosedError(record.set_id)
        return super()._insert(connection, record)
