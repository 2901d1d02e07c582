"""Deletion: hidden at once, brought back on demand, removed for good after a while.

Robots and measurement sets are only deleted when nothing refers to them, and nothing that refers to one is
stored or brought back while it is deleted.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Any, Final

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    Table,
    and_,
    delete,
    exists,
    literal,
    select,
    true,
    update,
)

from jointstiff.service.problems.errors import (
    AuthorisedError,
    DeletedError,
    NotEndedError,
    NotFoundError,
    ReferencedError,
    Resource,
)
from jointstiff.service.store.collection import MEASUREMENT_SET, PARENTS, is_indexable
from jointstiff.service.store.database import Database
from jointstiff.service.store.job_log import OPEN_STATES
from jointstiff.service.store.tables import (
    authorisations,
    idempotency_keys,
    job_steps,
    jobs,
    measurement_sets,
)

KEEP_DELETED: Final = timedelta(days=30)
"""Time for which a deleted resource can be restored."""
_NAMED: Final = 5


class Deletions:
    """The deleted resources of one kind. Every change is safe to repeat."""

    def __init__(self, database: Database, resource: Resource, table: Table) -> None:
        """Hide and bring back rows of a table; of that of jobs, those of the resource's kind."""
        self._database = database
        self._resource = resource
        self._table = table
        self._hidden = table.c.deleted_at.is_not(None)
        self._kind = jobs.c.kind == resource.name if table is jobs else true()
        self._ended = jobs.c.state.not_in(OPEN_STATES) if table is jobs else true()
        self._children = list(_children(table))

    def delete(self, identifier: str, now: datetime) -> None:
        """Hide a resource; of one that is hidden the time of the first deletion stays.

        Args:
            identifier: its id.
            now: aware; from here on it is kept for `KEEP_DELETED`.

        Raises:
            NotFoundError: there is no such resource.
            NotEndedError: it is a job that has not ended.
            ReferencedError: others refer to it.
            AuthorisedError: it is a run whose report was authorised.
        """
        self._refuse_odd(identifier)
        hide = update(self._table).where(self._is(identifier), self._ended, ~self._hidden)
        with self._database.writing() as connection:
            if connection.execute(hide.values(deleted_at=now)).rowcount == 1:
                self._refuse_referenced(connection, identifier)  # none comes from now on
                self._refuse_authorised(connection, identifier)
                return
            hidden = select(self._hidden).where(self._is(identifier))
            record = connection.execute(hidden).scalar_one_or_none()
        if record is None:
            raise NotFoundError(self._resource, identifier)
        if not record:
            raise NotEndedError(self._resource, identifier)

    def restore(self, identifier: str) -> None:
        """Bring a resource back; one that is not hidden stays as it is.

        Raises:
            NotFoundError: there is no such resource, or it has been removed.
            DeletedError: it refers to a robot or measurement set that is deleted.
        """
        self._refuse_odd(identifier)
        back = update(self._table).where(self._is(identifier)).values(deleted_at=None)
        with self._database.writing() as connection:
            if connection.execute(back).rowcount == 0:
                raise NotFoundError(self._resource, identifier)
            self._refuse_orphan(connection, identifier)

    def refuse_deleted(self, identifier: str) -> None:
        """Do nothing, unless a resource is hidden.

        Raises:
            DeletedError: it is.
        """
        hidden = select(self._table.c.id).where(self._is(identifier), self._hidden)
        with self._database.reading() as connection:
            if connection.execute(hidden).one_or_none() is not None:
                raise DeletedError(self._resource, identifier)

    def purge(self, before: datetime, limit: int) -> list[str]:
        """Remove for good what was deleted before a time, with the keys and steps that name it.

        Args:
            before: aware.
            limit: resources at most, those deleted first.

        Returns:
            Ids of the resources that are no more; what deleted ones still refer to stays until they are gone.
        """
        keys, columns = idempotency_keys.c, self._table.c
        free = [~exists().where(column == columns.id) for _, column in self._children]
        old = [self._kind, columns.deleted_at < before, *free]
        first = select(columns.id).where(*old).order_by(columns.deleted_at).limit(limit)
        with self._database.reading() as connection:
            expired = [str(row.id) for row in connection.execute(first)]
        if not expired:
            return []
        with self._database.writing() as connection:
            # Asked again in the transaction: one may have been restored meanwhile.
            remove = delete(self._table).where(columns.id.in_(expired), *old).returning(columns.id)
            gone = [str(row.id) for row in connection.execute(remove).all()]
            connection.execute(
                delete(idempotency_keys).where(
                    keys.resource == self._resource.collection, keys.resource_id.in_(gone)
                )
            )
            if self._table is jobs:
                connection.execute(delete(job_steps).where(job_steps.c.job_id.in_(gone)))
        return gone

    def _refuse_odd(self, identifier: str) -> None:
        """Refuse an id that a database may not even take as a text; none of ours is."""
        if not is_indexable(identifier):
            raise NotFoundError(self._resource, identifier)

    def _refuse_referenced(self, connection: Connection, identifier: str) -> None:
        users: dict[str, str] = {}
        for table, column in self._children:
            kind = table.c.kind if table is jobs else literal(MEASUREMENT_SET.name)
            visible = select(table.c.id, kind).where(column == identifier, table.c.deleted_at.is_(None))
            users |= {row[0]: row[1] for row in connection.execute(visible.limit(_NAMED + 1))}
        if users:
            named = [f"{kind} {user}" for user, kind in list(users.items())[:_NAMED]]
            raise ReferencedError(self._resource, identifier, named, more=len(users) > _NAMED)

    def _refuse_authorised(self, connection: Connection, identifier: str) -> None:
        own = select(authorisations.c.run_id).where(authorisations.c.run_id == identifier).limit(1)
        if self._table is jobs and connection.execute(own).one_or_none() is not None:
            raise AuthorisedError(identifier)

    def _refuse_orphan(self, connection: Connection, identifier: str) -> None:
        """Refuse what refers to a deleted resource; hold that resource, so that it stays."""
        for column in self._table.c:
            for reference in column.foreign_keys:
                parent = reference.column.table
                query = (
                    select(parent.c.id, parent.c.deleted_at)
                    .where(parent.c.id == select(column).where(self._is(identifier)).scalar_subquery())
                    .with_for_update(read=True)
                )
                row = connection.execute(query).one_or_none()
                if row is not None and row.deleted_at is not None:
                    raise DeletedError(PARENTS[parent], row.id)

    def _is(self, identifier: str) -> ColumnElement[bool]:
        return and_(self._kind, self._table.c.id == identifier)


def _children(parent: Table) -> Iterator[tuple[Table, Column[Any]]]:
    """Yield tables and columns that refer to a table."""
    for table in (measurement_sets, jobs):
        for column in table.c:
            if column.references(parent.c.id):
                yield table, column
