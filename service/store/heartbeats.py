"""The workers that live, by the database's clock."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Final

from sqlalchemy import Connection, delete, func, insert, select, update

from jointstiff.service.store.database import Database
from jointstiff.service.store.tables import heartbeats

SILENT: Final = timedelta(seconds=30)
"""A worker not heard of for so long is taken for dead."""

_FORGET: Final = 100
"""Silences after which the row of an executor is removed."""


class Heartbeats:
    """Signs of life of the workers of a store."""

    def __init__(self, database: Database, clock: Callable[[Connection], datetime] | None = None) -> None:
        """Keep the beats in a database; its own clock tells the time unless another is given."""
        self._database = database
        self._now = clock or self._database_time

    def beat(self, executor: str) -> list[str]:
        """Record that an executor lives; return all that live, by the clock of the database alone."""
        mine = heartbeats.c.executor == executor
        with self._database.writing() as connection:
            now = self._now(connection)
            if connection.execute(update(heartbeats).where(mine).values(beat_at=now)).rowcount == 0:
                connection.execute(insert(heartbeats).values(executor=executor, beat_at=now))
            living = self._living(connection, now, SILENT)
            connection.execute(delete(heartbeats).where(heartbeats.c.beat_at < now - _FORGET * SILENT))
        return living

    def living(self, silence: timedelta) -> list[str]:
        """The executors that live, none of them silent for longer than that."""
        with self._database.reading() as connection:
            return self._living(connection, self._now(connection), silence)

    def silent(self, silence: timedelta) -> dict[str, datetime]:
        """The executors that were silent for longer than that, with their last beat."""
        with self._database.reading() as connection:
            old = heartbeats.c.beat_at < self._now(connection) - silence
            rows = connection.execute(select(heartbeats.c.executor, heartbeats.c.beat_at).where(old)).all()
        return {str(row.executor): row.beat_at for row in rows}

    def forget(self, executor: str) -> datetime | None:
        """Remove an executor that ends or has ended; return its last beat, None if there is none."""
        mine = delete(heartbeats).where(heartbeats.c.executor == executor)
        with self._database.writing() as connection:
            return connection.execute(mine.returning(heartbeats.c.beat_at)).scalar()

    def prove(self) -> None:
        """Write a row that is no worker's.

        Raises:
            StoreUnavailableError: the database cannot be written.
        """
        self.beat("")

    def _living(self, connection: Connection, now: datetime, silence: timedelta) -> list[str]:
        # Nor later than now: a clock that was set back would keep the dead alive until it caught up.
        living = heartbeats.c.beat_at.between(now - silence, now + silence)
        named = select(heartbeats.c.executor).where(living, heartbeats.c.executor != "")
        rows = connection.execute(named).all()
        return sorted(str(row.executor) for row in rows)

    def _database_time(self, connection: Connection) -> datetime:
        if self._database.dialect == "sqlite":  # all who use it share this machine's clock
            return datetime.now(UTC)
        now: datetime = connection.execute(select(func.now())).scalar_one()
        return now
