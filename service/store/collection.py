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
from jointstiff.service.store.listing import Order, is_indexable, page_of, words_of
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

_NO_FILTERS: Final[Mapping[str, str]] = MappingProxyType({})
_NO_SPANS: Final[Mapping[str, tuple[datetime | None, datetime | None]]] = MappingProxyType({})
_KEY: Final = sa.insert(idempotency_keys)
KEEP_DELETED: Final = timedelta(days=30)
"""Time for which a deleted resource can be restored."""
_PORTION: Final = 500  # ids that one statement names
_NAMED: Final = 5  # resources that a refusal to delete names


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
        self._entries = self._rows_listed()
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
        for _, table, identifier in self._parents(record):
            if not is_indexable(identifier):
                raise problems.NotFoundError(PARENTS[table], identifier)
        try:
            with self._database.writing() as connection:
                if key is not None:  # first, as the loser of a race waits here
                    own = {"resource": self.resource.collection, "key_hash": _hash(key.key)}
                    of_record = {"resource_id": record.id, "created_at": record.created_at}
                    connection.execute(_KEY, {**own, **of_record, "body_hash": key.body_hash})
                named = self._hold_parents(connection, record)
                connection.execute(self._insert, asdict(record) | self._copied(record, named))
                if also is not None:
                    also(connection)
                self._touch(connection, record.id)
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
            mine = [self._table.c.id == identifier, sa.true() if hidden else self._visible]
            with self._database.writing() as connection:
                if connection.execute(sa.update(self._table).where(*mine).values(**values)).rowcount:
                    self._rename(connection, identifier)
                    self._touch(connection, identifier)
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
        """Return one page as `page_of` does.

        Args:
            limit: how many at most, one or more.
            cursor: `next` of the page before; none for the first page.
            filters: column → value that it must have.
            spans: column → first time that it may have, and the first that it may not have again.
            deleted: only deleted ones instead of the others.
            q: words that are all parts of a name that the listing shows.
            sort: `created_at` or `name`; with a minus downwards.
            counted: whether to count the records on all pages, at the first one.

        Raises:
            CursorError: no page gave this cursor.
        """
        if limit < 1 or not all(map(self._narrows, [*filters, *spans])):
            raise ValueError(f"no page of {limit} {self.resource.collection} by {', '.join(filters)}")
        if not all(map(is_indexable, [*filters.values(), q or ""])):
            return RecordPage((), None, 0)
        columns = self._table.c
        where = [*self._mine, *self._listed, self._hidden if deleted else self._visible]
        where += [columns[name] == value for name, value in sorted(filters.items())]
        where += [columns[name] >= first for name, (first, _) in spans.items() if first is not None]
        where += [columns[name] < end for name, (_, end) in spans.items() if end is not None]
        order = Order(limit, cursor, q, sort, counted)
        return page_of(self._database, self._table, self._entries, self._entry, where, order)

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
                self._touch(connection, identifier)
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
            row = connection.execute(sa.select(*named).where(*self._is(identifier))).one_or_none()
            if row is not None:
                self._hold_parents(connection, row)  # before its own row, as those who rename them do
            if row is None or connection.execute(back).rowcount == 0:
                raise problems.NotFoundError(self.resource, identifier)
            self._follow(connection, identifier, None)
            self._touch(connection, identifier)

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
            # Checked again in the transaction: one may have been restored meanwhile.
            remove = sa.delete(self._table).where(columns.id.in_(expired), *old).returning(columns.id)
            gone = [str(row.id) for row in connection.execute(remove).all()]
            named = [keys.resource == self.resource.collection, keys.resource_id.in_(gone)]
            connection.execute(sa.delete(idempotency_keys).where(*named))
            self._forget(connection, gone)
        return gone

    def _follow(self, connection: sa.Connection, identifier: str, deleted_at: datetime | None) -> None:
        """Hide what else is kept of a record that is hidden, or bring it back."""

    def _rows_listed(self) -> sa.Select[Any]:
        """Return the query of what a listing shows."""
        return of_records(self._table, self._entry)

    def _copied(self, record: Record, named: Mapping[str, Any]) -> dict[str, str | None]:  # noqa: ARG002 - for those who copy
        """Return columns that are copies of names, for listings: of the record, and of what it names.

        Args:
            record: which is about to be stored.
            named: column → row of what it names.
        """
        return _names_of_robot(record.name or "")

    def _rename(self, connection: sa.Connection, identifier: str) -> None:
        """Copy names once more, after a change of a record."""

    def _touch(self, connection: sa.Connection, identifier: str) -> None:
        """Note that what is derived of a record is to be derived anew: the last act of a transaction."""

    def _forget(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        """Delete the related rows of deleted records; a hook for collections that have some."""

    def _narrows(self, name: str) -> bool:
        """Return whether a listing can be narrowed by a column: only by one of an index."""
        return any(name in index.columns for index in self._table.indexes)

    def _parents(self, record: object) -> Iterator[tuple[sa.Column[Any], sa.Table, str]]:
        """Yield the records that this one, or its row, names: column, table, id."""
        for column, parent in self._references:
            if (identifier := getattr(record, column.name)) is not None:
                yield column, parent, identifier

    def _hold_parents(self, connection: sa.Connection, record: object) -> dict[str, Any]:
        """Keep what this one names from being changed until it is stored; refuse it if that was deleted.

        Returns:
            Column → row of what it names.
        """
        named = {}
        for column, table, identifier in self._parents(record):
            row = connection.execute(_held(table), {"id": identifier}).one_or_none()
            if row is not None and row.deleted_at is not None:
                raise problems.DeletedError(PARENTS[table], identifier)
            named[column.name] = row
        return named

    def _not_added(self, record: Record, key: IdempotencyKey | None, error: IntegrityError) -> Record:
        """Find out which constraint the record broke: its key came before, or a parent is missing."""
        earlier = None if key is None else self.find(key)
        if earlier is not None:
            return earlier
        for _, table, identifier in self._parents(record):
            if not self._finds(sa.select(table.c.id).where(table.c.id == sa.bindparam("id")), identifier):
                raise problems.NotFoundError(PARENTS[table], identifier) from error
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


class Robots(Collection[RobotRecord, RobotEntry]):
    """The robots. A listing shows the last campaign of each as it was derived."""

    def __init__(self, database: Database, quota: Quota) -> None:
        super().__init__(database, ROBOT, robots, RobotRecord, RobotEntry, quota)

    def entry(self, identifier: str) -> RobotEntry:
        """Return a robot as it is listed.

        Raises:
            NotFoundError: there is none.
        """
        for row in self._database.rows(self._entries.where(robots.c.id == identifier)):
            return RobotEntry(**row._mapping)
        raise problems.NotFoundError(ROBOT, identifier)

    def due(self, most: int) -> list[RobotEntry]:
        """Return some robots whose last campaign is to be derived anew."""
        named = sa.select(last_campaigns.c.robot_id).where(sa.text(DUE)).limit(most)
        rows = self._database.rows(self._entries.where(robots.c.id.in_(named)))
        return [RobotEntry(**row._mapping) for row in rows]

    def derive(self, entry: RobotEntry, campaign: dict[str, Any] | None) -> None:
        """Keep the last campaign of a robot, derived from its runs and sets after the entry was read.

        If they changed since then, the entry read next says so.
        """
        mine = [last_campaigns.c.robot_id == entry.id, last_campaigns.c.changes >= entry.changes]
        older = sa.func.coalesce(last_campaigns.c.derived, 0) < entry.changes
        keep = sa.update(last_campaigns).where(*mine, older)
        self._database.change(keep.values(derived=entry.changes, campaign=campaign))

    def _rows_listed(self) -> sa.Select[Any]:
        derived = last_campaigns.c
        return (
            of_records(robots, RobotRow)
            .add_columns(derived.changes, derived.derived, derived.campaign)
            .outerjoin_from(robots, last_campaigns, derived.robot_id == robots.c.id)
        )

    def _rename(self, connection: sa.Connection, identifier: str) -> None:
        _copy_names(connection, robots.c.id, identifier)
        # Sets before jobs, as those who rename a set do: else two could wait for each other.
        for table in (measurement_sets, open_sets, jobs):
            _copy_names(connection, table.c.robot_id, identifier)

    def _forget(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        connection.execute(sa.delete(last_campaigns).where(last_campaigns.c.robot_id.in_(gone)))


class MeasurementSets(Collection[MeasurementSetRecord, MeasurementSetEntry]):
    """The ordinary measurement sets. The record of one that was measured live goes and returns with it."""

    def named(self, set_ids: Sequence[str]) -> list[Any]:
        """Return rows of the names and hashes of some sets and of their robots, deleted or not."""
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

    def last_of_robots(self) -> dict[str, list[str]]:
        """Return the ids of the sets of each robot, the one that was measured last first; none deleted."""
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
        """Yield id and readings of some sets."""
        query = sa.select(measurement_sets.c.id, measurement_sets.c.arrays)
        for ids in _portions(set_ids):
            for row in self._database.rows(query.where(measurement_sets.c.id.in_(ids))):
                yield str(row.id), row.arrays

    def _follow(self, connection: sa.Connection, identifier: str, deleted_at: datetime | None) -> None:
        own = sa.update(open_sets).where(open_sets.c.id == identifier)
        connection.execute(own.values(deleted_at=deleted_at))

    def _copied(self, record: MeasurementSetRecord, named: Mapping[str, Any]) -> dict[str, str | None]:
        return _names_of_set(record.name, name_of(named, "robot_id"), record.serial_number)

    def _rename(self, connection: sa.Connection, identifier: str) -> None:
        _copy_names(connection, measurement_sets.c.id, identifier)
        _copy_names(connection, jobs.c.measurement_set_id, identifier)

    def _touch(self, connection: sa.Connection, identifier: str) -> None:
        robot_of = sa.select(measurement_sets.c.robot_id).where(measurement_sets.c.id == identifier)
        derive_anew(connection, last_campaigns.c.robot_id.in_(robot_of))


class OpenSets(Collection[OpenSetRecord, OpenSetRecord]):
    """The sets that are measured live, or were. Those that still are can be listed."""

    _listed = (
        ~sa.exists().where(live_entries.c.set_id == open_sets.c.id, live_entries.c.change == "closed"),
    )

    def _copied(self, record: OpenSetRecord, named: Mapping[str, Any]) -> dict[str, str | None]:
        return _names_of_set(record.name, name_of(named, "robot_id"), None)

    def _forget(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        connection.execute(sa.delete(live_entries).where(live_entries.c.set_id.in_(gone)))


def _portions(identifiers: Sequence[str]) -> Iterator[Sequence[str]]:
    """Yield ids, a few hundred at a time: a database has a limit of what a statement names."""
    known = [each for each in identifiers if is_indexable(each)]
    for first in range(0, len(known), _PORTION):
        yield known[first : first + _PORTION]


def name_of(named: Mapping[str, Any], column: str, name: str = "name") -> str | None:
    """Return a name of what a record names in a column; None if it names nothing there."""
    row = named.get(column)
    return None if row is None else getattr(row, name)


def _names_of_robot(name: str) -> dict[str, str | None]:
    return {"words": words_of(name)}


def _names_of_set(name: str, robot: str | None, serial_number: str | None) -> dict[str, str | None]:
    return {"robot_name": robot, "words": words_of(name, robot, serial_number)}


def names_of_job(
    name: str | None, robot: str | None, measurement_set: str | None, serial_number: str | None
) -> dict[str, str | None]:
    """Return the copied columns of a job by its names; one without a name is sorted by that of its set."""
    return {
        "robot_name": robot,
        "measurement_set_name": measurement_set,
        "serial_number": serial_number,
        "words": words_of(name or measurement_set, robot, serial_number, name and measurement_set),
    }


def _of_robot(table: sa.Table, serial_number: sa.ColumnElement[Any]) -> sa.Select[Any]:
    """Return the query of the names of sets."""
    names = sa.select(table.c.sequence, table.c.name, robots.c.name, serial_number)
    return names.join_from(table, robots, robots.c.id == table.c.robot_id)


_NAMES: Final[Mapping[sa.Table, tuple[sa.Select[Any], Callable[..., dict[str, str | None]]]]] = (
    MappingProxyType(
        {
            robots: (sa.select(robots.c.sequence, robots.c.name), _names_of_robot),
            measurement_sets: (_of_robot(measurement_sets, measurement_sets.c.serial_number), _names_of_set),
            open_sets: (_of_robot(open_sets, sa.null()), _names_of_set),
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
                names_of_job,
            ),
        }
    )
)
"""Names of the records of each table, and the columns that are made of them."""


def _copy_names(connection: sa.Connection, column: sa.Column[Any], identifier: str) -> None:
    """Copy the names of the records with an id in a column once more, after one of the names changed."""
    table = column.table
    names, copied = _NAMES[table]
    # In one order: else two who rename a robot and a set could wait for each other.
    found = connection.execute(names.where(column == identifier).order_by(table.c.sequence)).all()
    if changes := [{"own": number, **copied(*row)} for number, *row in found]:
        connection.execute(sa.update(table).where(table.c.sequence == sa.bindparam("own")), changes)


def derive_anew(connection: sa.Connection, where: sa.ColumnElement[bool]) -> bool:
    """Note that last campaigns are to be derived anew; return whether there are such.

    It is the last act of a transaction, as others who change runs of the robot wait for its end.
    """
    more = sa.update(last_campaigns).where(where).values(changes=last_campaigns.c.changes + 1)
    return connection.execute(more).rowcount > 0


@cache
def _held(table: sa.Table) -> sa.Select[Any]:
    """Return the query of a record's names and deletion; they stay until the transaction ends."""
    named = [table.c[name] for name in ("deleted_at", "name", "serial_number") if name in table.c]
    return sa.select(*named).where(table.c.id == sa.bindparam("id")).with_for_update(read=True)


def _hash(key: str) -> str:
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


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

    def page(
        self, limit: int, cursor: str | None = None, *, counted: bool = False, **values: str | None
    ) -> RecordPage[Noted]:
        """Return one page as `page_of` does, of records with these values in these columns; None for any."""
        where = [self._table.c[name] == value for name, value in values.items() if value is not None]
        order = Order(limit, cursor, counted=counted)
        return page_of(self._database, self._table, self._all, self._record, where, order)

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
