"""The audit: who tried to change what, and with which outcome. Entries are added, never changed."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Final

from sqlalchemy import insert, select

from jointstiff.service.store.collection import LAST_SEQUENCE, parse_cursor
from jointstiff.service.store.database import Database
from jointstiff.service.store.records import AuditEntry
from jointstiff.service.store.tables import audit

_SHOWN: Final = [audit.c[field.name] for field in fields(AuditEntry)]


class Audit:
    """The audit in a database, newest first. Safe to use from several threads."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, entry: AuditEntry) -> None:
        """Add an entry."""
        with self._database.writing() as connection:
            connection.execute(insert(audit).values(asdict(entry)))

    def page(
        self, limit: int, cursor: str | None = None, key_id: str | None = None
    ) -> tuple[list[AuditEntry], str | None]:
        """Return one page, and the cursor of the next one.

        Args:
            limit: how many entries at most, one or more.
            cursor: that the page before returned; none for the first page.
            key_id: only entries of this key.

        Raises:
            CursorError: no page gave this cursor.
        """
        before = LAST_SEQUENCE if cursor is None else parse_cursor(cursor)
        mine = [] if key_id is None else [audit.c.key_id == key_id]
        query = (
            select(audit.c.sequence, *_SHOWN)
            .where(audit.c.sequence < before, *mine)
            .order_by(audit.c.sequence.desc())
            .limit(limit + 1)
        )
        with self._database.reading() as connection:
            rows = connection.execute(query).all()
        entries = [AuditEntry(*list(row)[1:]) for row in rows[:limit]]
        return entries, str(rows[limit - 1].sequence) if len(rows) > limit else None
