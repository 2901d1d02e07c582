"""What changes about a run until it ends: its state, and which of its steps are done."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from typing import Any, Final

from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.database import Database
from service.records import RunRecord
from service.tables import TABLES, heartbeats, run_steps

__all__ = ["OPEN_STATES", "RunLog"]

OPEN_STATES: Final = ("queued", "running")
"""States of a run that goes on; all others are final."""

_runs = TABLES[RunRecord]


class RunLog:
    """The changing side of the runs of a store. Every change is safe to repeat."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def state(self, run_id: str) -> str | None:
        """The state of a run; None if there is no such run."""
        with self._database.reading() as connection:
            found = connection.execute(select(_runs.c.state).where(_runs.c.id == run_id)).scalar_one_or_none()
        return None if found is None else str(found)

    def start(self, run_id: str) -> None:
        """A queued run is running now."""
        with self._database.writing() as connection:
            connection.execute(
                update(_runs).where(_runs.c.id == run_id, _runs.c.state == "queued").values(state="running")
            )

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

    def beat(self, executor: str, now: datetime) -> None:
        """An executor lives."""
        with suppress(IntegrityError), self._database.writing() as connection:
            known = connection.execute(
                update(heartbeats).where(heartbeats.c.executor == executor).values(beat_at=now)
            )
            if known.rowcount == 0:
                connection.execute(insert(heartbeats).values(executor=executor, beat_at=now))

    def silent(self, before: datetime) -> Sequence[str]:
        """The executors that have not been heard of since."""
        with self._database.reading() as connection:
            rows: Sequence[Any] = connection.execute(
                select(heartbeats.c.executor).where(heartbeats.c.beat_at < before)
            ).all()
        return [str(row.executor) for row in rows]

    def forget(self, executor: str, before: datetime) -> bool:
        """Give up an executor that has not been heard of since.

        Returns:
            Whether it was this call: of those who notice, one takes over.
        """
        with self._database.writing() as connection:
            gone = connection.execute(
                delete(heartbeats).where(heartbeats.c.executor == executor, heartbeats.c.beat_at < before)
            )
        return gone.rowcount == 1
