"""Authorisations of reports. They are added, never changed."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from typing import Final

from sqlalchemy import ColumnElement, Connection, insert, select

from jointstiff.service.store.collection import is_indexable
from jointstiff.service.store.database import Database
from jointstiff.service.store.quota import Quota
from jointstiff.service.store.records import AuthorisationRecord
from jointstiff.service.store.tables import authorisations, jobs

_SHOWN: Final = [authorisations.c[field.name] for field in fields(AuthorisationRecord)]


class Authorisations:
    """The authorisations of all reports. Safe to use from several threads."""

    def __init__(self, database: Database, quota: Quota) -> None:
        self._database, self._quota = database, quota

    def add(self, record: AuthorisationRecord) -> AuthorisationRecord:
        """Add an authorisation and return it; the latest of its run, if that is the same but for the time.

        Raises:
            QuotaError: the database has the size that it may have.
        """
        self._quota.refuse_full()
        with self._database.writing() as connection:
            # Of two at the same time, one waits here.
            connection.execute(select(jobs.c.id).where(jobs.c.id == record.run_id).with_for_update())
            latest = self._query(authorisations.c.run_id == record.run_id, connection)[-1:]
            if latest and replace(latest[0], authorised_at=record.authorised_at) == record:
                return latest[0]
            connection.execute(insert(authorisations).values(asdict(record)))
        return record

    def of(self, run_id: str) -> list[AuthorisationRecord]:
        """Return the authorisations of a run's report, oldest first."""
        return self._where(run_id, authorisations.c.run_id == run_id)

    def superseding(self, run_id: str) -> list[AuthorisationRecord]:
        """Return the authorisations of reports that replace that of a run, oldest first."""
        return self._where(run_id, authorisations.c.supersedes == run_id)

    def _where(self, run_id: str, condition: ColumnElement[bool]) -> list[AuthorisationRecord]:
        if not is_indexable(run_id):
            return []
        with self._database.reading() as connection:
            return self._query(condition, connection)

    @staticmethod
    def _query(condition: ColumnElement[bool], connection: Connection) -> list[AuthorisationRecord]:
        query = select(*_SHOWN).where(condition).order_by(authorisations.c.sequence)
        return [AuthorisationRecord(**row._mapping) for row in connection.execute(query)]
