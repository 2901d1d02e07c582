"""Collections: tables whose records are added, listed, changed and deleted; and journals, which only grow."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar, Final, Generic, TypeVar

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from jointstiff.service import problems
from jointstiff.service.store.database import Database, Quota
from jointstiff.service.store.documents import raise_text
from jointstiff.service.store.layouts import SCHEMA
from jointstiff.service.store.listing import Order, is_indexable, make_search_text, read_page
from jointstiff.service.store.tables import (
    DUE,
    AuditEntry,
    Entry,
    IdempotencyKey,
    JobRecord,
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
"""Table to which other tables refer → its kind of resource, for messages."""

_KINDS_OF_DOCUMENTS: Final[Mapping[sa.Table, str]] = MappingProxyType(
    {robots: "robot", measurement_sets: "measurement_set", open_sets: "open_set"}
)
"""Table → kind of its documents; a job states its kind."""
_NO_FILTERS: Final[Mapping[str, str]] = MappingProxyType({})
_NO_SPANS: Final[Mapping[str, tuple[datetime | None, datetime | None]]] = MappingProxyType({})
_UNKNOWN: Final = object()
_INSERT_KEY: Final = sa.insert(idempotency_keys)
KEEP_DELETED: Final = timedelta(days=30)
"""Time for which a deleted resource can be restored."""
_PORTION: Final = 500  # greatest number of ids in one statement
_MAX_NAMED: Final = 5  # greatest number of resources that a refusal to delete names


def _list_references(table: sa.Table) -> list[tuple[sa.Column[Any], sa.Table]]:
    """Return (column of the table, table to which the column refers) for each reference of a table."""
    return [(column, reference.column.table) for column in table.c for reference in column.foreign_keys]


def _list_referring_columns(table: sa.Table) -> list[sa.Column[Any]]:
    """Return the columns of other tables that refer to the ids of a table."""
    columns = list[sa.Column[Any]]()
    for other in (measurement_sets, open_sets, jobs):
        columns += [column for column in other.c if column.references(table.c.id)]
    return columns


class Collection(Generic[Record, Entry]):
    """The records of one kind. Safe to use from several threads."""

    _deletion_conditions: ClassVar[Sequence[sa.ColumnElement[bool]]] = ()
    """SQL conditions that a record must meet to be deleted."""
    _listing_conditions: ClassVar[Sequence[sa.ColumnElement[bool]]] = ()
    """Further SQL conditions that a record must meet to be listed."""
    _rank: ClassVar[sa.ColumnElement[Any] | None] = None
    """Number of a row for the order `worst`; None if the records have no such order."""

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
        """Serve the records of a table that meet all conditions.

        Args:
            database: database of the table.
            resource: names of the records in messages and addresses.
            table: table of the records.
            record: dataclass of a whole record.
            entry: dataclass of a record in a listing.
            quota: quota of the database.
            conditions: conditions in SQL; rows that do not meet them are not in this collection.
        """
        self._quota = quota
        self.resource = resource  # names of the records in messages and addresses
        self._database, self._table = database, table
        self._record: type[Record] = record
        self._entry: type[Entry] = entry
        self._insert = sa.insert(table)
        self._own_conditions = conditions
        self._references = _list_references(table)
        self._children = _list_referring_columns(table)
        self._entry_query = self._listing_query()
        self._is_visible = table.c.deleted_at.is_(None)
        self._is_deleted = table.c.deleted_at.is_not(None)
        columns = select_fields_of(table, record).selected_columns
        has_id = table.c.id == sa.bindparam("id")
        self._id_query = sa.select(table.c.id).where(has_id, *conditions)
        self._by_id_with_deleted = self._id_query.with_only_columns(*columns)
        self._by_id = self._by_id_with_deleted.where(self._is_visible)
        keys = idempotency_keys.c
        self._record_by_key: sa.Select[Any] = (
            sa.select(keys.body_hash, *columns)
            .join_from(idempotency_keys, table, keys.resource_id == table.c.id)
            .where(keys.resource == resource.collection, keys.key_hash == sa.bindparam("key_hash"))
        )

    def add(
        self,
        record: Record,
        key: IdempotencyKey | None = None,
        write_more: Callable[[sa.Connection], object] | None = None,
    ) -> Record:
        """Store a record and its idempotency key in one transaction.

        Args:
            record: record to store.
            key: idempotency key of the request; None if the request has none.
            write_more: function that writes more in the same transaction, such as an entry in the job queue.

        Returns:
            The stored record. If the key was used before with the same body, the record created then, even if
            that record was deleted. Two simultaneous calls with one key create and return one record.

        Raises:
            NotFoundError: a robot or measurement set that the record names does not exist, or was deleted.
            IdempotencyConflictError: the key was used before with another body.
            QuotaError: the database has reached its quota.
        """
        self._quota.refuse_full()
        self._refuse_unindexable_parents(record)
        try:
            with self._database.writing() as connection:
                if key is not None:  # first, so that the second of two simultaneous posts with one key waits
                    connection.execute(_INSERT_KEY, self._make_key_row(record, key))
                parent_rows = self._lock_parents(connection, record)
                row = asdict(record) | self._collect_name_copies(record, parent_rows)
                connection.execute(self._insert, row)
                if write_more is not None:
                    write_more(connection)
                self._mark_campaign_outdated(connection, record.id)
        except IntegrityError as error:
            return self._return_earlier_record_or_raise(record, key, error)
        return record

    def _refuse_unindexable_parents(self, record: Record) -> None:
        """Refuse a record that names a robot or measurement set by an id that the database cannot store.

        Raises:
            NotFoundError: no record can have this id.
        """
        for _, table, identifier in self._list_parents(record):
            if not is_indexable(identifier):
                raise problems.NotFoundError(PARENTS[table], identifier)

    def _make_key_row(self, record: Record, key: IdempotencyKey) -> dict[str, object]:
        """Return the row that connects an idempotency key with the record that it creates."""
        return {
            "resource": self.resource.collection,
            "key_hash": _hash_key(key.key),
            "body_hash": key.body_hash,
            "resource_id": record.id,
            "created_at": record.created_at,
        }

    def find(self, key: IdempotencyKey) -> Record | None:
        """Return the record that an idempotency key created, even if it was deleted; None for a new key.

        Raises:
            IdempotencyConflictError: the key was used before with another body.
        """
        rows = self._database.rows(self._record_by_key, {"key_hash": _hash_key(key.key)})
        if not rows:
            return None
        (row,) = rows
        if row.body_hash != key.body_hash:
            raise problems.IdempotencyConflictError(self.resource, key.key)
        values = {name: value for name, value in row._mapping.items() if name != "body_hash"}
        return self._make_record(values)

    def get(self, identifier: str, *, include_deleted: bool = False) -> Record:
        """Return the record with an id.

        Args:
            identifier: the id.
            include_deleted: whether a deleted record is returned, too.

        Raises:
            NotFoundError: no record has this id.
            DeletedError: the record was deleted.
        """
        self._refuse_unindexable(identifier)
        by_id = self._by_id_with_deleted if include_deleted else self._by_id
        for row in self._database.rows(by_id, {"id": identifier}):
            return self._make_record(row._mapping)
        if self._has_row(self._id_query, identifier):
            raise problems.DeletedError(self.resource, identifier)
        raise problems.NotFoundError(self.resource, identifier, self._find_other_owner(identifier))

    def _find_other_owner(self, identifier: str) -> str | None:
        """Return the name of the kind of resource that has an id; None if no visible resource has it.

        Every key that may request a resource may read the resources of all kinds.
        """
        kinds = {robots: sa.literal(ROBOT.name), measurement_sets: sa.literal(MEASUREMENT_SET.name)}
        for table, kind in {**kinds, jobs: jobs.c.kind}.items():
            visible = sa.select(kind).where(table.c.id == sa.bindparam("id"), table.c.deleted_at.is_(None))
            for row in self._database.rows(visible, {"id": identifier}):
                return str(row[0])
        return None

    def _make_record(self, values: Mapping[Any, Any]) -> Record:
        """Return the record of a row; a document of an earlier version is raised to today's shape."""
        record = self._record(**values)
        if record.schema < SCHEMA:
            kind = record.kind if isinstance(record, JobRecord) else _KINDS_OF_DOCUMENTS[self._table]
            record = replace(record, document=raise_text(kind, record.document, record.schema))
        return record

    def change(
        self,
        identifier: str,
        find_values: Callable[[Record], Mapping[str, object]],
        *,
        include_deleted: bool = False,
    ) -> Record:
        """Change columns of a record that is no job; return the changed record.

        Nobody else can change the record between the last call of `find_values` and the change. A change that
        finds no values writes nothing and takes no lock.

        Args:
            identifier: id of the record.
            find_values: function of the present record that returns column → new value; only columns such as
                names, on which no result depends.
            include_deleted: whether a deleted record can be changed, too.

        Raises:
            NotFoundError: no record has this id.
            DeletedError: the record was deleted.
        """
        present = self.get(identifier, include_deleted=include_deleted)
        found = find_values(present)
        # A column that the record does not show counts as changed.
        if any(getattr(present, name, _UNKNOWN) != value for name, value in found.items()):
            by_id = self._by_id_with_deleted if include_deleted else self._by_id
            with self._database.writing() as connection:
                # The lock of an UPDATE (`FOR NO KEY UPDATE`) lets others refer to the row. A stronger lock
                # deadlocks with one who has changed a referring row twice: PostgreSQL checks its reference.
                locked_row = by_id.with_for_update(key_share=True)
                for row in connection.execute(locked_row, {"id": identifier}).all():
                    values = find_values(self._make_record(row._mapping))
                    if values:
                        own_row = self._table.c.id == identifier
                        connection.execute(sa.update(self._table).where(own_row).values(**values))
                        self._update_name_copies(connection, identifier)
                        self._mark_campaign_outdated(connection, identifier)
        return self.get(identifier, include_deleted=include_deleted)

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
            cursor: `next` of the page before; None for the first page.
            filters: column → value that the column must have.
            spans: column of times → begin (included) and end (excluded); None for no limit.
            deleted: True to list only the deleted records.
            q: words to search; each must be a part of a name, serial number, operator or instrument.
            sort: `created_at` or `name`, in descending order with a minus in front; or `worst` for robots.
            counted: True to count the records of all pages, which is done with the first page.

        Raises:
            CursorError: no page gave this cursor.
        """
        if limit < 1 or not all(map(self._can_filter_by, [*filters, *spans])):
            names = ", ".join([*filters, *spans]) or "nothing"
            raise ValueError(f"cannot list {limit} {self.resource.collection} filtered by {names}")
        if not all(map(is_indexable, [*filters.values(), q or ""])):
            return RecordPage((), None, 0)
        is_listed = self._is_deleted if deleted else self._is_visible
        conditions = [*self._own_conditions, *self._listing_conditions, is_listed]
        conditions += [self._table.c[name] == value for name, value in sorted(filters.items())]
        conditions += self._limit_times(spans)
        listed = (
            ("collection", self.resource.collection),
            ("deleted", deleted),
            *filters.items(),
            *spans.items(),
        )
        order = Order(limit, cursor, q, sort, counted, self._rank, listed)
        return read_page(self._database, self._table, self._entry_query, self._entry, conditions, order)

    def _limit_times(
        self, spans: Mapping[str, tuple[datetime | None, datetime | None]]
    ) -> list[sa.ColumnElement[bool]]:
        """Return the conditions that times are in spans: first all begins (included), then ends (excluded).

        `spans` is column of times → (begin, end); None for no limit.
        """
        columns = self._table.c
        conditions: list[sa.ColumnElement[bool]] = []
        conditions += [columns[name] >= begin for name, (begin, _) in spans.items() if begin is not None]
        conditions += [columns[name] < end for name, (_, end) in spans.items() if end is not None]
        return conditions

    def delete(self, identifier: str, deletion_time: datetime | None = None) -> None:
        """Hide a resource, which can be restored for the time `KEEP_DELETED`; a repeated call does nothing.

        Args:
            identifier: id of the resource.
            deletion_time: time of the deletion, with a time zone; None for the present.

        Raises:
            NotFoundError: there is no such resource.
            NotEndedError: the resource is a job that has not ended.
            ReferencedError: other resources refer to this resource.
        """
        self._refuse_unindexable(identifier)
        hide_row = sa.update(self._table).where(
            *self._id_conditions(identifier), *self._deletion_conditions, self._is_visible
        )
        deletion_time = deletion_time or datetime.now(UTC)
        with self._database.writing() as connection:
            if connection.execute(hide_row.values(deleted_at=deletion_time)).rowcount == 1:
                # The update locks the row, so that no new reference to it can be stored before the commit.
                self._refuse_referenced(connection, identifier)
                self._hide_or_restore_related(connection, identifier, deletion_time)
                self._mark_campaign_outdated(connection, identifier)
                return
            deleted_query = sa.select(self._is_deleted).where(*self._id_conditions(identifier))
            is_deleted = connection.execute(deleted_query).scalar_one_or_none()
        if is_deleted is None:
            raise problems.NotFoundError(self.resource, identifier)
        if not is_deleted:
            raise problems.NotEndedError(self.resource, identifier)

    def restore(self, identifier: str) -> None:
        """Restore a deleted resource; nothing changes if the resource is not deleted.

        Raises:
            NotFoundError: there is no such resource, or it has been removed.
            DeletedError: the resource refers to a deleted robot or measurement set.
        """
        self._refuse_unindexable(identifier)
        show_row = sa.update(self._table).where(*self._id_conditions(identifier)).values(deleted_at=None)
        own_columns = [self._table.c.id, *(column for column, _ in self._references)]
        with self._database.writing() as connection:
            row = connection.execute(
                sa.select(*own_columns).where(*self._id_conditions(identifier))
            ).one_or_none()
            if row is not None:
                # Parents are locked before this row, as when a name is changed: another order could deadlock.
                self._lock_parents(connection, row)
            if row is None or connection.execute(show_row).rowcount == 0:
                raise problems.NotFoundError(self.resource, identifier)
            self._hide_or_restore_related(connection, identifier, None)
            self._mark_campaign_outdated(connection, identifier)

    def refuse_deleted(self, identifier: str) -> None:
        """Raise an error if a resource is deleted.

        Raises:
            DeletedError: the resource is deleted.
        """
        if self._has_row(self._id_query.where(self._is_deleted), identifier):
            raise problems.DeletedError(self.resource, identifier)

    def purge(self, before: datetime, limit: int) -> list[str]:
        """Remove resources for good that were deleted before a time, and their idempotency keys.

        A resource is kept as long as other resources, also deleted ones, refer to it.

        Args:
            before: time of deletion up to which resources are removed, with a time zone.
            limit: greatest number of resources; those deleted first are removed first.

        Returns:
            Ids of the removed resources.
        """
        columns = self._table.c
        unreferenced: list[sa.ColumnElement[bool]] = [
            ~sa.exists().where(column == columns.id) for column in self._children
        ]
        removable = [*self._own_conditions, columns.deleted_at < before, *unreferenced]
        oldest = sa.select(columns.id).where(*removable).order_by(columns.deleted_at).limit(limit)
        candidate_ids = [str(row.id) for row in self._database.rows(oldest)]
        if not candidate_ids:
            return []
        # Conditions are checked again in the transaction: a resource may have been restored meanwhile.
        removal = sa.delete(self._table).where(columns.id.in_(candidate_ids), *removable)
        with self._database.writing() as connection:
            removed_ids = [str(row.id) for row in connection.execute(removal.returning(columns.id)).all()]
            self._delete_keys(connection, removed_ids)
            self._delete_related(connection, removed_ids)
        return removed_ids

    def _delete_keys(self, connection: sa.Connection, identifiers: Sequence[str]) -> None:
        """Delete the idempotency keys of removed resources."""
        keys = idempotency_keys.c
        is_of_removed = [keys.resource == self.resource.collection, keys.resource_id.in_(identifiers)]
        connection.execute(sa.delete(idempotency_keys).where(*is_of_removed))

    def _hide_or_restore_related(
        self, connection: sa.Connection, identifier: str, deleted_at: datetime | None
    ) -> None:
        """Hide the rows of a record, or restore them if `deleted_at` is None; a hook for subclasses."""

    def _listing_query(self) -> sa.Select[Any]:
        """Return the query of the columns that a listing shows."""
        return select_fields_of(self._table, self._entry)

    def _collect_name_copies(self, record: Record, parent_rows: Mapping[str, Any]) -> dict[str, str | None]:  # noqa: ARG002 - subclasses use it
        """Return column → text of the columns that hold copies of names: of the record and of its parents.

        Args:
            record: record that is about to be stored.
            parent_rows: column → row of the record to which the column refers.
        """
        return make_robot_name_columns(record.name or "")

    def _update_name_copies(self, connection: sa.Connection, identifier: str) -> None:
        """Update the copies of a record's name in other rows; subclasses with such copies override this."""

    def _mark_campaign_outdated(self, connection: sa.Connection, identifier: str) -> None:
        """Mark the last campaign of the record's robot as outdated; subclasses with a robot override this.

        This function is called last in a transaction.
        """

    def _delete_related(self, connection: sa.Connection, removed_ids: Sequence[str]) -> None:
        """Delete rows of other tables that belong to removed records; a hook for subclasses."""

    def _can_filter_by(self, name: str) -> bool:
        """Return whether a listing can be filtered by a column: an index must contain the column."""
        return any(name in index.columns for index in self._table.indexes)

    def _list_parents(self, record: object) -> Iterator[tuple[sa.Column[Any], sa.Table, str]]:
        """Yield (column, table, id) for each record to which a record, or its row, refers."""
        for column, parent in self._references:
            if (identifier := getattr(record, column.name)) is not None:
                yield column, parent, identifier

    def _lock_parents(self, connection: sa.Connection, record: object) -> dict[str, Any]:
        """Lock the records to which a record refers until the transaction ends.

        Returns:
            Column → row to which the column refers; None if there is no such row.

        Raises:
            DeletedError: a record to which the record refers was deleted.
        """
        parent_rows = {}
        for column, table, identifier in self._list_parents(record):
            row = connection.execute(_make_parent_locking_query(table), {"id": identifier}).one_or_none()
            if row is not None and row.deleted_at is not None:
                raise problems.DeletedError(PARENTS[table], identifier)
            parent_rows[column.name] = row
        return parent_rows

    def _return_earlier_record_or_raise(
        self, record: Record, key: IdempotencyKey | None, error: IntegrityError
    ) -> Record:
        """Return the record that an idempotency key created before; else raise why the insertion failed.

        Args:
            record: record that could not be inserted.
            key: idempotency key of the request; None if the request has none.
            error: error of the database.

        Raises:
            NotFoundError: a record to which the record refers does not exist.
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
        """Raise `ReferencedError` if records that are not deleted refer to a record."""
        # Id of a record that refers to this record → name of its kind
        referring: dict[str, str] = {}
        for column in self._children:
            table = column.table
            kind = table.c.kind if table is jobs else sa.literal(MEASUREMENT_SET.name)
            visible = sa.select(table.c.id, kind).where(column == identifier, table.c.deleted_at.is_(None))
            referring |= {row[0]: row[1] for row in connection.execute(visible.limit(_MAX_NAMED + 1))}
        if referring:
            named = [f"{kind} {referring_id}" for referring_id, kind in list(referring.items())[:_MAX_NAMED]]
            has_more = len(referring) > _MAX_NAMED
            raise problems.ReferencedError(self.resource, identifier, named, more=has_more)

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
    """The robots; a listing shows the last campaign of each robot, derived from the robot's runs."""

    # Robots without a measured arm come last.
    _rank = sa.func.coalesce(
        sa.select(last_campaigns.c.rank)
        .where(last_campaigns.c.robot_id == robots.c.id)
        .correlate(robots)
        .scalar_subquery(),
        -1.0,
    )

    def __init__(self, database: Database, quota: Quota) -> None:
        super().__init__(database, ROBOT, robots, RobotRecord, RobotEntry, quota)

    def entry(self, identifier: str) -> RobotEntry:
        """Return the entry of a robot in a listing.

        Raises:
            NotFoundError: there is no such robot.
        """
        for row in self._database.rows(self._entry_query.where(robots.c.id == identifier)):
            return RobotEntry(**row._mapping)
        raise problems.NotFoundError(ROBOT, identifier)

    def list_outdated(self, limit: int) -> list[RobotEntry]:
        """Return robots whose last campaign is outdated, at most `limit`."""
        outdated_ids = sa.select(last_campaigns.c.robot_id).where(sa.text(DUE)).limit(limit)
        rows = self._database.rows(self._entry_query.where(robots.c.id.in_(outdated_ids)))
        return [RobotEntry(**row._mapping) for row in rows]

    def store_last_campaign(
        self,
        entry: RobotEntry,
        campaign: dict[str, Any] | None,
        arms: list[Any] | None = None,
        rank: float | None = None,
    ) -> None:
        """Store the last campaign of a robot, which the caller derived after reading the robot's `entry`.

        If the robot, its runs or its sets changed meanwhile, the campaign stays marked as outdated.

        Args:
            entry: the robot.
            campaign: its last campaign; None without a run.
            arms: its arms that were measured; None without a run.
            rank: greatest rank of the arms; None without an arm.
        """
        is_outdated = [last_campaigns.c.robot_id == entry.id, last_campaigns.c.changes >= entry.changes]
        is_older = sa.func.coalesce(last_campaigns.c.arms_derived, 0) < entry.changes
        update = sa.update(last_campaigns).where(*is_outdated, is_older)
        derived = {"derived": entry.changes, "arms_derived": entry.changes}
        self._database.change(update.values(**derived, campaign=campaign, arms=arms, rank=rank))

    def _listing_query(self) -> sa.Select[Any]:
        """Return the query of robots with their last campaigns."""
        campaign_columns = last_campaigns.c
        return (
            select_fields_of(robots, RobotRow)
            .add_columns(
                campaign_columns.changes,
                campaign_columns.arms_derived,
                campaign_columns.campaign,
                campaign_columns.arms,
            )
            .outerjoin_from(robots, last_campaigns, campaign_columns.robot_id == robots.c.id)
        )

    def _mark_campaign_outdated(self, connection: sa.Connection, identifier: str) -> None:
        """Mark the last campaign of the robot as outdated: it depends on the robot's references."""
        mark_campaigns_outdated(connection, last_campaigns.c.robot_id == identifier)

    def _update_name_copies(self, connection: sa.Connection, identifier: str) -> None:
        """Update the copies of a robot's name in its own row (the text for searches), its sets and its jobs.

        `identifier` is the id of the robot.
        """
        _copy_names(connection, robots.c.id, identifier)
        # Sets are updated before jobs, as when a set is renamed: in another order two transactions could
        # deadlock.
        for table in (measurement_sets, open_sets, jobs):
            _copy_names(connection, table.c.robot_id, identifier)

    def _delete_related(self, connection: sa.Connection, removed_ids: Sequence[str]) -> None:
        """Delete the last campaigns of removed robots."""
        connection.execute(sa.delete(last_campaigns).where(last_campaigns.c.robot_id.in_(removed_ids)))


class MeasurementSets(Collection[MeasurementSetRecord, MeasurementSetEntry]):
    """The measurement sets that are not live.

    A set that was measured live is deleted and restored together with its `OpenSetRecord`.
    """

    def rows_with_names(self, set_ids: Sequence[str]) -> list[Any]:
        """Return a row for each set, with names and content hashes of the set and of its robot.

        Deleted sets are included; `set_ids` are the ids of the sets.
        """
        sets = measurement_sets.c
        query = sa.select(
            sets.id,
            sets.name,
            sets.robot_id,
            sets.content_hash,
            robots.c.name.label("robot_name"),
            robots.c.content_hash.label("robot_hash"),
        ).join_from(measurement_sets, robots, robots.c.id == sets.robot_id)
        return [
            row
            for ids in _iterate_portions(set_ids)
            for row in self._database.rows(query.where(sets.id.in_(ids)))
        ]

    def _hide_or_restore_related(
        self, connection: sa.Connection, identifier: str, deleted_at: datetime | None
    ) -> None:
        """Hide or restore the live campaign from which a measurement set was made."""
        update = sa.update(open_sets).where(open_sets.c.id == identifier)
        connection.execute(update.values(deleted_at=deleted_at))

    def _collect_name_copies(
        self, record: MeasurementSetRecord, parent_rows: Mapping[str, Any]
    ) -> dict[str, str | None]:
        """Return column → text for a new set: the robot's name, and the text for searches."""
        robot = value_of_parent(parent_rows, "robot_id")
        return make_set_name_columns(
            record.name, robot, record.serial_number, record.operator, record.instrument
        )

    def _update_name_copies(self, connection: sa.Connection, identifier: str) -> None:
        """Update the copies of a set's name in its own row and in its jobs."""
        _copy_names(connection, measurement_sets.c.id, identifier)
        _copy_names(connection, jobs.c.measurement_set_id, identifier)

    def _mark_campaign_outdated(self, connection: sa.Connection, identifier: str) -> None:
        """Mark the last campaign of the set's robot as outdated."""
        robot_of_set = sa.select(measurement_sets.c.robot_id).where(measurement_sets.c.id == identifier)
        mark_campaigns_outdated(connection, last_campaigns.c.robot_id.in_(robot_of_set))


class OpenSets(Collection[OpenSetRecord, OpenSetRecord]):
    """The declarations of live campaigns; a listing shows only campaigns that are not closed."""

    _listing_conditions = (
        ~sa.exists().where(live_entries.c.set_id == open_sets.c.id, live_entries.c.change == "closed"),
    )

    def _collect_name_copies(
        self, record: OpenSetRecord, parent_rows: Mapping[str, Any]
    ) -> dict[str, str | None]:
        """Return column → text for a new live campaign: the robot's name, and the text for searches."""
        return make_set_name_columns(record.name, value_of_parent(parent_rows, "robot_id"))

    def _delete_related(self, connection: sa.Connection, removed_ids: Sequence[str]) -> None:
        """Delete the entries of removed live campaigns."""
        connection.execute(sa.delete(live_entries).where(live_entries.c.set_id.in_(removed_ids)))


def _iterate_portions(identifiers: Sequence[str]) -> Iterator[Sequence[str]]:
    """Yield ids in portions of at most `_PORTION`: databases limit the parameters of a statement."""
    valid_ids = [identifier for identifier in identifiers if is_indexable(identifier)]
    for start in range(0, len(valid_ids), _PORTION):
        yield valid_ids[start : start + _PORTION]


def value_of_parent(parent_rows: Mapping[str, Any], column: str, name: str = "name") -> str | None:
    """Return a field of the row to which a column refers; None if there is no such row.

    Args:
        parent_rows: column → row to which the column refers.
        column: column that refers to the row.
        name: field of the row.
    """
    row = parent_rows.get(column)
    return None if row is None else getattr(row, name)


def make_robot_name_columns(name: str) -> dict[str, str | None]:
    """Return column → text for the columns of a robot's row that hold copies of its name."""
    return {"words": make_search_text(name)}


def make_set_name_columns(
    name: str,
    robot: str | None,
    serial_number: str | None = None,
    operator: str | None = None,
    instrument: str | None = None,
) -> dict[str, str | None]:
    """Return column → text for the columns of a set's row that hold copies of names; `robot` is a name."""
    words = make_search_text(name, robot, serial_number, operator, instrument)
    return {"robot_name": robot, "words": words}


def job_name_columns(
    name: str | None,
    robot: str | None,
    measurement_set: str | None,
    serial_number: str | None,
    operator: str | None,
    instrument: str | None,
) -> dict[str, str | None]:
    """Return column → text for the columns of a job's row that hold copies of names.

    `robot` and `measurement_set` are names. A job without name is sorted by the name of its set.
    """
    own_set = name and measurement_set
    return {
        "robot_name": robot,
        "measurement_set_name": measurement_set,
        "serial_number": serial_number,
        "words": make_search_text(
            name or measurement_set, robot, serial_number, own_set, operator, instrument
        ),
    }


def _make_set_names_query(table: sa.Table, *searched: sa.ColumnElement[Any]) -> sa.Select[Any]:
    """Return the query of sequence, name, robot's name and further columns of the sets in a table."""
    names = sa.select(table.c.sequence, table.c.name, robots.c.name, *searched)
    return names.join_from(table, robots, robots.c.id == table.c.robot_id)


SEARCHED: Final = ("serial_number", "operator", "instrument")
"""Columns of a measurement set that are searched together with its name."""

_NAME_QUERIES: Final[Mapping[sa.Table, tuple[sa.Select[Any], Callable[..., dict[str, str | None]]]]] = (
    MappingProxyType(
        {
            robots: (sa.select(robots.c.sequence, robots.c.name), make_robot_name_columns),
            measurement_sets: (
                _make_set_names_query(measurement_sets, *(measurement_sets.c[name] for name in SEARCHED)),
                make_set_name_columns,
            ),
            open_sets: (_make_set_names_query(open_sets), make_set_name_columns),
            jobs: (
                sa.select(
                    jobs.c.sequence,
                    jobs.c.name,
                    robots.c.name,
                    measurement_sets.c.name,
                    *(measurement_sets.c[name] for name in SEARCHED),
                )
                .outerjoin_from(jobs, robots, robots.c.id == jobs.c.robot_id)
                .outerjoin(measurement_sets, measurement_sets.c.id == jobs.c.measurement_set_id),
                job_name_columns,
            ),
        }
    )
)
"""Table → (query of sequence and names, function of the names that returns the columns with copies)."""


def _copy_names(connection: sa.Connection, column: sa.Column[Any], identifier: str) -> None:
    """Update the copies of names, after a name changed, in all rows whose `column` has the id."""
    table = column.table
    query, make_copies = _NAME_QUERIES[table]
    # Rows are changed in one order: otherwise two transactions that rename could deadlock.
    rows = connection.execute(query.where(column == identifier).order_by(table.c.sequence)).all()
    if changes := [{"own": sequence, **make_copies(*names)} for sequence, *names in rows]:
        connection.execute(sa.update(table).where(table.c.sequence == sa.bindparam("own")), changes)


def mark_campaigns_outdated(connection: sa.Connection, condition: sa.ColumnElement[bool]) -> bool:
    """Mark the last campaigns that meet a condition as outdated; return whether there is any.

    Call this function last in a transaction: other transactions on runs of the robot wait until it ends.
    """
    increment_changes = (
        sa.update(last_campaigns).where(condition).values(changes=last_campaigns.c.changes + 1)
    )
    return connection.execute(increment_changes).rowcount > 0


@cache
def _make_parent_locking_query(table: sa.Table) -> sa.Select[Any]:
    """Return the query that locks a row, given its id, and reads its names and its time of deletion."""
    columns = [table.c[name] for name in ("deleted_at", "name", *SEARCHED) if name in table.c]
    return sa.select(*columns).where(table.c.id == sa.bindparam("id")).with_for_update(read=True)


def _hash_key(key: str) -> str:
    """Return the SHA-256 of an idempotency key, which may be any text."""
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


JournalRecord = TypeVar("JournalRecord", AuditEntry, LiveEntry)


class Journal(Generic[JournalRecord]):
    """Records of one table that are only added, in the order of their arrival. Safe for several threads."""

    def __init__(
        self, database: Database, table: sa.Table, record: type[JournalRecord], quota: Quota | None
    ) -> None:
        """Keep records in a table; if `quota` is None, records are added even to a full database."""
        self._database, self._table, self._quota = database, table, quota
        self._record: type[JournalRecord] = record
        self._select_all = select_fields_of(table, record)

    def add(self, record: JournalRecord) -> JournalRecord:
        """Add a record and return it.

        Raises:
            QuotaError: the database has reached its quota.
        """
        if self._quota is not None:
            self._quota.refuse_full()
        with self._database.writing() as connection:
            return self._insert(connection, record)

    def find(self, **values: str) -> list[JournalRecord]:
        """Return the records that have the given values in the columns of these names, oldest first."""
        if not all(map(is_indexable, values.values())):
            return []
        query = self._select_all.filter_by(**values).order_by(self._table.c.sequence)
        return [self._record(*row) for row in self._database.rows(query)]

    def page(
        self, limit: int, cursor: str | None = None, *, counted: bool = False, **values: str | None
    ) -> RecordPage[JournalRecord]:
        """Return one page of the records that have the given values in the columns of these names.

        Args:
            limit: greatest number of records.
            cursor: `next` of the page before; None for the first page.
            counted: whether the records of all pages are counted, too.
            values: column → value; None allows any value.
        """
        where = [self._table.c[name] == value for name, value in values.items() if value is not None]
        order = Order(limit, cursor, counted=counted, filters=tuple(values.items()))
        return read_page(self._database, self._table, self._select_all, self._record, where, order)

    def _insert(self, connection: sa.Connection, record: JournalRecord) -> JournalRecord:
        """Insert a record and return it."""
        connection.execute(sa.insert(self._table).values(asdict(record)))
        return record


class LiveEntries(Journal[LiveEntry]):
    """Entries of the records of live campaigns; each kind and label of a set is stored once."""

    def _insert(self, connection: sa.Connection, record: LiveEntry) -> LiveEntry:
        """Insert an entry and return it, or return the stored entry of the same kind and label.

        Raises:
            NotFoundError: there is no such live campaign, or it was deleted.
            ClosedError: the campaign is closed.
        """
        # The lock makes entries come one after the other, so that no entry can follow the closing entry.
        lock_set = sa.select(open_sets.c.deleted_at).where(open_sets.c.id == record.set_id).with_for_update()
        row = connection.execute(lock_set).one_or_none()
        if row is None or row.deleted_at is not None:
            raise problems.NotFoundError(MEASUREMENT_SET, record.set_id)
        columns = live_entries.c
        entries_of_set = self._select_all.where(columns.set_id == record.set_id)
        same_entry_query = entries_of_set.where(
            columns.change == record.change, columns.label == record.label
        )
        for stored_row in connection.execute(same_entry_query):
            return self._record(*stored_row)
        for _ in connection.execute(entries_of_set.where(columns.change == "closed")):
            raise problems.ClosedError(record.set_id)
        return super()._insert(connection, record)
