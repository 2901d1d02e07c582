"""Deletion of jobs: hidden at once, brought back on demand, removed for good after a while."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Final

from sqlalchemy import ColumnElement, and_, delete, select, update

from jointstiff.service.problems import DeletedError, NotEndedError, NotFoundError, Resource
from jointstiff.service.store.database import Database
from jointstiff.service.store.job_log import OPEN_STATES
from jointstiff.service.store.tables import idempotency_keys, job_steps, jobs

KEEP_DELETED: Final = timedelta(days=30)
"""Time for which a deleted job can be restored."""


class Deletions:
    """The deleted jobs of one kind. Every change is safe to repeat."""

    def __init__(self, database: Database, resource: Resource) -> None:
        self._database = database
        self._resource = resource
        self._kind = jobs.c.kind == resource.name

    def delete(self, job_id: str, now: datetime) -> None:
        """Hide a job that has ended; of one that is hidden the time of the first deletion stays.

        Args:
            job_id: its id.
            now: aware; from here on it is kept for `KEEP_DELETED`.

        Raises:
            NotFoundError: there is no such job.
            NotEndedError: it has not ended.
        """
        ended = jobs.c.state.not_in(OPEN_STATES)
        with self._database.writing() as connection:
            hide = update(jobs).where(self._is(job_id), ended, jobs.c.deleted_at.is_(None))
            if connection.execute(hide.values(deleted_at=now)).rowcount == 1:
                return
            state = connection.execute(select(jobs.c.state).where(self._is(job_id))).scalar_one_or_none()
        if state is None:
            raise NotFoundError(self._resource, job_id)
        if state in OPEN_STATES:
            raise NotEndedError(self._resource, job_id)

    def restore(self, job_id: str) -> None:
        """Bring a job back; one that is not hidden stays as it is.

        Raises:
            NotFoundError: there is no such job, or it has been removed.
        """
        with self._database.writing() as connection:
            found = connection.execute(update(jobs).where(self._is(job_id)).values(deleted_at=None))
        if found.rowcount == 0:
            raise NotFoundError(self._resource, job_id)

    def refuse_deleted(self, job_id: str) -> None:
        """Do nothing, unless a job is hidden.

        Raises:
            DeletedError: it is.
        """
        hidden = select(jobs.c.id).where(self._is(job_id), jobs.c.deleted_at.is_not(None))
        with self._database.reading() as connection:
            if connection.execute(hidden).one_or_none() is not None:
                raise DeletedError(self._resource, job_id)

    def purge(self, before: datetime, limit: int) -> list[str]:
        """Remove for good what was deleted before a time, with the keys and steps that name it.

        Args:
            before: aware.
            limit: jobs at most, those deleted first.

        Returns:
            Ids of the jobs that are no more.
        """
        keys, old = idempotency_keys.c, [self._kind, jobs.c.deleted_at < before]
        first = select(jobs.c.id).where(*old).order_by(jobs.c.deleted_at).limit(limit)
        with self._database.reading() as connection:
            found = [str(row.id) for row in connection.execute(first)]
        if not found:
            return []
        with self._database.writing() as connection:
            # Asked again in the transaction: one may have been restored meanwhile.
            remove = delete(jobs).where(jobs.c.id.in_(found), *old).returning(jobs.c.id)
            gone = [str(row.id) for row in connection.execute(remove).all()]
            connection.execute(
                delete(idempotency_keys).where(
                    keys.resource == self._resource.collection, keys.resource_id.in_(gone)
                )
            )
            connection.execute(delete(job_steps).where(job_steps.c.job_id.in_(gone)))
        return gone

    def _is(self, job_id: str) -> ColumnElement[bool]:
        return and_(self._kind, jobs.c.id == job_id)
