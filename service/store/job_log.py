"""What changes about a job until it ends: its state, and which of its steps are done."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Select, bindparam, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from jointstiff.service.store.database import Database
from jointstiff.service.store.tables import TABLES, job_deaths, job_steps

__all__ = ["OPEN_STATES", "JobLog", "Standing"]

OPEN_STATES: Final = ("queued", "running")
"""States of a job that goes on; all others are final."""


@dataclass(frozen=True, slots=True)
class Standing:
    """Where a job stands.

    Attributes:
        state: of the job.
        done: units of its work that are done, while it goes on.
    """

    state: str
    done: int

    @property
    def goes_on(self) -> bool:
        """Whether the job has not ended."""
        return self.state in OPEN_STATES


class JobLog:
    """The changing side of the jobs of one kind. Every change is safe to repeat."""

    def __init__(self, database: Database, record: type) -> None:
        """Log the jobs of a database.

        Args:
            database: where they are.
            record: what the store keeps of such a job.
        """
        self._database = database
        self._table = table = TABLES[record]
        done = select(func.coalesce(func.sum(job_steps.c.done), 0)).where(job_steps.c.job_id == table.c.id)
        self._standings = select(table.c.id, table.c.state, done.scalar_subquery().label("done")).where(
            table.c.id.in_(bindparam("ids", expanding=True))
        )

    def standing(self, job_id: str) -> Standing | None:
        """Where a job stands; None if there is no such job."""
        return self.standings([job_id]).get(job_id)

    def standings(self, job_ids: Collection[str]) -> dict[str, Standing]:
        """Return where some jobs stand, by id, without those that do not exist."""
        with self._database.reading() as connection:
            rows = connection.execute(self._standings, {"ids": list(job_ids)}).all()
        return {str(row.id): Standing(str(row.state), int(row.done)) for row in rows}

    def state(self, job_id: str) -> str | None:
        """The state of a job; None if there is no such job."""
        query = select(self._table.c.state).where(self._table.c.id == job_id)
        with self._database.reading() as connection:
            found = connection.execute(query).scalar_one_or_none()
        return None if found is None else str(found)

    def open_jobs(self) -> list[str]:
        """The jobs that go on."""
        query = select(self._table.c.id).where(self._table.c.state.in_(OPEN_STATES))
        with self._database.reading() as connection:
            return [str(row.id) for row in connection.execute(query).all()]

    def start(self, job_id: str, document: str) -> None:
        """A queued job is running now."""
        queued = self._table.c.id == job_id, self._table.c.state == "queued"
        with self._database.writing() as connection:
            connection.execute(update(self._table).where(*queued).values(state="running", document=document))

    def end(self, job_id: str, state: str, document: Callable[[str, int], str]) -> bool:
        """End a job, unless it has ended: a job never changes once ended.

        Args:
            job_id: of the job.
            state: its final one.
            document: makes its last document of the one before and of how many of its units are done.

        Returns:
            Whether it was this call that ended it.
        """
        goes_on = self._table.c.id == job_id, self._table.c.state.in_(OPEN_STATES)
        with self._database.writing() as connection:
            ended = connection.execute(update(self._table).where(*goes_on).values(state=state)).rowcount == 1
            if ended:  # no one else can end or start it any more
                before = connection.execute(select(self._table.c.document).where(goes_on[0])).scalar_one()
                text = document(str(before), int(connection.execute(_done_of(job_id)).scalar_one() or 0))
                connection.execute(update(self._table).where(goes_on[0]).values(document=text))
        return ended

    def report(self, job_id: str, start: int, stop: int) -> None:
        """The units from start to stop of a job are done; to say so again changes nothing."""
        row = {"job_id": job_id, "start": start, "done": stop - start}
        with suppress(IntegrityError), self._database.writing() as connection:
            connection.execute(insert(job_steps).values(**row))

    def done(self, job_id: str) -> int:
        """How many units of a job are done."""
        with self._database.reading() as connection:
            return int(connection.execute(_done_of(job_id)).scalar_one() or 0)

    def died(self, job_id: str) -> int:
        """A worker died over a job.

        Returns:
            How many have by now.
        """
        mine = job_deaths.c.job_id == job_id
        with self._database.writing() as connection:
            more = update(job_deaths).where(mine).values(deaths=job_deaths.c.deaths + 1)
            if connection.execute(more).rowcount == 0:
                connection.execute(insert(job_deaths).values(job_id=job_id, deaths=1))
            return int(connection.execute(select(job_deaths.c.deaths).where(mine)).scalar_one())

    def forget_steps(self, job_ids: Sequence[str]) -> None:
        """Remove what was reported of some jobs, when no one asks for it any more."""
        with self._database.writing() as connection:
            for table in (job_steps, job_deaths):
                connection.execute(delete(table).where(table.c.job_id.in_(job_ids)))


def _done_of(job_id: str) -> Select[Any]:
    return select(func.sum(job_steps.c.done)).where(job_steps.c.job_id == job_id)
