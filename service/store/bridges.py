"""Bridges from trackers to pages, in a database: each is a pair of letter boxes with one letter each."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime, timedelta
from typing import Final

import sqlalchemy as sa

from jointstiff.service.store.database import Database
from jointstiff.service.store.tables import BridgeRecord, bridges, select_fields_of

CODE_LASTS: Final = timedelta(minutes=10)
"""Time for which the code of a bridge can be used, once."""
BRIDGE_LASTS: Final = timedelta(hours=12)
"""Time after which a bridge ends."""
MOST_BRIDGES: Final = 8
"""Greatest number of bridges of an open set; a further bridge ends the oldest one."""

_RECORDS: Final = select_fields_of(bridges, BridgeRecord)


class Bridges:
    """The bridges in a database. Safe to use from several threads."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: BridgeRecord) -> None:
        """Store a new bridge; remove bridges that have ended, and those of its set beyond `MOST_BRIDGES`."""
        columns = bridges.c
        kept = (
            sa.select(columns.id)
            .where(columns.set_id == record.set_id)
            .order_by(columns.created_at.desc(), columns.id)
            .limit(MOST_BRIDGES - 1)
        )
        self._database.change(
            sa.delete(bridges).where(columns.created_at <= record.created_at - BRIDGE_LASTS),
            sa.delete(bridges).where(columns.set_id == record.set_id, columns.id.not_in(kept)),
            sa.insert(bridges).values(asdict(record)),
        )

    def find(self, bridge_id: str, now: datetime) -> BridgeRecord | None:
        """Return a bridge; None if there is none, or it has ended."""
        columns = bridges.c
        query = _RECORDS.where(columns.id == bridge_id, columns.created_at > now - BRIDGE_LASTS)
        return next((BridgeRecord(*row) for row in self._database.rows(query)), None)

    def join(self, code_hash: str, command_key: str, now: datetime) -> str | None:
        """Let a command join the bridge with a code, which ends the code; return the id of the bridge.

        Of two simultaneous calls only the first returns the id. Return None for an invalid code, which is
        unknown, was used before, or is older than `CODE_LASTS`.
        """
        columns = bridges.c
        is_valid = sa.and_(columns.code_hash == code_hash, columns.created_at > now - CODE_LASTS)
        if not self._database.rows(sa.select(columns.id).where(is_valid)):
            return None  # an invalid code costs only a read, so that no writer has to wait
        joining = (
            sa.update(bridges).where(is_valid).values(code_hash=None, command_key=command_key, heard_at=now)
        )
        with self._database.writing() as connection:
            row = connection.execute(joining.returning(columns.id)).one_or_none()
        return None if row is None else str(row.id)

    def put_stand(self, bridge_id: str, stand: str) -> None:
        """Store the stand (JSON text) that the page shows, in place of the stand before."""
        self._database.change(sa.update(bridges).where(bridges.c.id == bridge_id).values(stand=stand))

    def put_reading(self, bridge_id: str, reading: str, now: datetime) -> None:
        """Store the last positions (JSON text) of the tracker, in place of those before."""
        update = sa.update(bridges).where(bridges.c.id == bridge_id)
        self._database.change(update.values(reading=reading, heard_at=now))

    def remove(self, bridge_id: str) -> None:
        """End a bridge; a repeated call changes nothing."""
        self._database.change(sa.delete(bridges).where(bridges.c.id == bridge_id))
