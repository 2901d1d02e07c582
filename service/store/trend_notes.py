"""Notes in trends: new baselines and acknowledged alarms. They are added, never changed."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Final

from sqlalchemy import insert, select

from jointstiff.service.store.collection import is_indexable
from jointstiff.service.store.database import Database
from jointstiff.service.store.quota import Quota
from jointstiff.service.store.records import TrendNote
from jointstiff.service.store.tables import trend_notes

_SHOWN: Final = [trend_notes.c[field.name] for field in fields(TrendNote)]


class TrendNotes:
    """The notes of all robots. Safe to use from several threads."""

    def __init__(self, database: Database, quota: Quota) -> None:
        self._database, self._quota = database, quota

    def add(self, note: TrendNote) -> None:
        """Add a note.

        Raises:
            QuotaError: the database has the size that it may have.
        """
        self._quota.refuse_full()
        with self._database.writing() as connection:
            connection.execute(insert(trend_notes).values(asdict(note)))

    def of(self, robot_id: str) -> list[TrendNote]:
        """Return the notes of a robot, oldest first."""
        if not is_indexable(robot_id):
            return []
        query = select(*_SHOWN).where(trend_notes.c.robot_id == robot_id).order_by(trend_notes.c.sequence)
        with self._database.reading() as connection:
            return [TrendNote(**row._mapping) for row in connection.execute(query)]
