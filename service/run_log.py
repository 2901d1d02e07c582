"""What changes about a run until it ends: its state, and which of its steps are done."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Final

from sqlalchemy import Connection, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.database import Database
from service.records import RunRecord
from service.tables import TABLES, heartbeats, run_steps

__all__ = ["OPEN_STATES", "RunLog"]

OPEN_STATES: Final = ("queued", "running")
"""States of a run that goes on; all others are final."""

_runs = TABLES[RunRecord]
_FORGET: Final = 100
"""Silences after which the row of an executor is removed."""


class RunLog:
    """The changing side of the runs of a store. Every change is safe to repeat."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def state(self, run_id: str) -> str | None:
        """The state of a run; None if there is no such run."""
        with self._database.reading() as connection:
            found = connection.execute(select(_runs.c.state).where(_runs.c.id == run_id)).scalar_one_or_none()
        return None if found is None else str(found)

    def open_runs(self) -> list[str]:
        """The runs that go on."""
        with self._database.reading() as connection:
            rows = connection.execute(select(_runs.c.id).where(_runs.c.state.in_(OPEN_STATES))).all()
        return [str(row.id) for row in rows]

    def start(self, run_id: str, document: str) -> None:
        """A queued run is running now."""
        queued = _runs.c.id == run_id, _runs.c.state == "queued"
        with self._database.writing() as connection:
            connection.execute(update(_runs).where(*queued).values(state="running", document=document))

    def end(self, run_id: str, state: str, document: str) -> bool:
        """End a run, unless it has ended: a run never changes once ended.

        Returns:
            Whether it was this call that ended it.
        """
        with self._database.writing() as connection:
            ended = connection.execute(
                update(_runs)
                .where(_runs.c.id == run_id, _runs.c.state.in_(OPEN_STATES))
                .values(state=state, document=document)
            )
        return ended.rowcount == 1

    def report(self, run_id: str, start: int, stop: int) -> None:
        """The draws from start to stop of a run are done; to say so again changes nothing."""
        row = {"run_id": run_id, "start": start, "done": stop - start}
        with suppress(IntegrityError), self._database.writing() as connection:
            connection.execute(insert(run_steps).values(**row))

    def done(self, run_id: str) -> int:
        """How many draws of a run are done."""
        total = select(func.sum(run_steps.c.done)).where(run_steps.c.run_id == run_id)
        with self._database.reading() as connection:
            return int(connection.execute(total).scalar_one() or 0)

    def beat(self, executor: str, silence: timedelta) -> list[str]:
        """An executor lives.

        Args:
            executor: its name.
            silence: how long one may be silent and still count as living.

        Returns:
            Those that live, by the database's clock; no worker's own may be trusted.
        """
        mine = heartbeats.c.executor == executor
        with self._database.writing() as connection:
            now = self._now(connection)
            if connection.execute(update(heartbeats).where(mine).values(beat_at=now)).rowcount == 0:
                connection.execute(insert(heartbeats).values(executor=executor, beat_at=now))
            rows = connection.execute(
                select(heartbeats.c.executor).where(heartbeats.c.beat_at >= now - silence)
            ).all()
            connection.execute(delete(heartbeats).where(heartbeats.c.beat_at < now - _FORGET * silence))
        return sorted(str(row.executor) for row in rows)

    def forget(self, executor: str) -> None:
        """An executor is about to end."""
        with self._database.writing() as connection:
            connection.execute(delete(heartbeats).where(heartbeats.c.executor == executor))

    def _now(self, connection: Connection) -> datetime:
        if self._database.dialect == "sqlite":  # all who use it share this machine's clock
            return datetime.now(UTC)
        now: datetime = connection.execute(select(func.now())).scalar_one()
        return now
