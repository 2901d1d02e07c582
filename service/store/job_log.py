"""Changes of a job until it ends: its state, and which of its steps are done."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any, Final

from sqlalchemy import ColumnElement, Connection, and_, bindparam, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from jointstiff.service.problems.errors import Resource
from jointstiff.service.store.database import Database
from jointstiff.service.store.records import JobRecord
from jointstiff.service.store.tables import job_steps, jobs

OPEN_STATES: Final = ("queued", "running")
"""States of a job that has not ended; all others are final."""

JobChanges = Mapping[str, Any]
"""Columns of a job that change until it ends: `state`, `summary` and `document`."""

_done: Final = (
    select(func.coalesce(func.sum(job_steps.c.done), 0))
    .where(job_steps.c.job_id == jobs.c.id)
    .scalar_subquery()
    .label("done")
)
_record: Final = [jobs.c[field.name] for field in fields(JobRecord)]
_open: Final = jobs.c.state.in_(OPEN_STATES)


@dataclass(frozen=True, slots=True)
class JobStatus:
    """State of a job."""

    state: str  # its state
    done: int  # units of its work that are done, while it has not ended

    @property
    def goes_on(self) -> bool:
        """Return whether the job has not ended."""
        return self.state in OPEN_STATES


class JobLog:
    """The changing side of the jobs of one kind. Every change is safe to repeat."""

    def __init__(self, database: Database, resource: Resource) -> None:
        self._database = database
        self._kind = jobs.c.kind == resource.name
        self._standings = select(jobs.c.id, jobs.c.state, _done).where(
            self._kind, jobs.c.id.in_(bindparam("ids", expanding=True))
        )

    def status(self, job_id: str) -> JobStatus | None:
        """Return state and progress of a job; None if there is no such job."""
        return self.statuses([job_id]).get(job_id)

    def statuses(self, job_ids: Collection[str]) -> dict[str, JobStatus]:
        """Return state and progress of those of some jobs that exist, by id."""
        with self._database.reading() as connection:
            rows = connection.execute(self._standings, {"ids": list(job_ids)}).all()
        return {str(row.id): JobStatus(str(row.state), int(row.done)) for row in rows}

    def state(self, job_id: str) -> str | None:
        """Return the state of a job; None if there is no such job."""
        with self._database.reading() as connection:
            state = connection.execute(select(jobs.c.state).where(self._is(job_id))).scalar_one_or_none()
        return None if state is None else str(state)

    def open_jobs(self) -> list[str]:
        """Return the ids of the jobs that have not ended."""
        with self._database.reading() as connection:
            return [str(row.id) for row in connection.execute(select(jobs.c.id).where(self._kind, _open))]

    def start(self, job_id: str, changes: JobChanges) -> None:
        """Write that a queued job is running."""
        with self._database.writing() as connection:
            connection.execute(
                update(jobs).where(self._is(job_id), jobs.c.state == "queued").values(**changes)
            )

    def end(
        self,
        job_id: str,
        state: str,
        changes: Callable[[JobRecord, int], JobChanges],
        also: Callable[[Connection], object] = lambda _: None,
    ) -> bool:
        """End a job, unless it has ended: a job never changes once ended.

        Args:
            job_id: its id.
            state: its final state.
            changes: return its last form, given the record before and the number of units done.
            also: what else belongs into the transaction that ends it.

        Returns:
            Whether it was this call that ended it.
        """
        mine = self._is(job_id)
        with self._database.writing() as connection:
            ended = connection.execute(update(jobs).where(mine, _open).values(state=state)).rowcount == 1
            if ended:  # no one else can end or start it any more
                *before, done = connection.execute(select(*_record, _done).where(mine)).one()
                final = changes(JobRecord(*before), int(done))
                connection.execute(update(jobs).where(mine).values(**final))
                also(connection)
        return ended

    def report(self, job_id: str, start: int, stop: int) -> None:
        """Write that the units from start to stop of a job are done; to do so again changes nothing.

        Deaths that were counted before are forgotten: the job goes on.
        """
        row = {"job_id": job_id, "start": start, "done": stop - start}
        with suppress(IntegrityError), self._database.writing() as connection:
            connection.execute(insert(job_steps).values(**row))
            connection.execute(update(jobs).where(self._is(job_id), jobs.c.deaths > 0).values(deaths=0))

    def done(self, job_id: str) -> int:
        """Return the number of units of a job that are done."""
        status = self.status(job_id)
        return 0 if status is None else status.done

    def died(self, job_id: str) -> int:
        """Count a worker that died over a job.

        Returns:
            How many have by now.
        """
        with self._database.writing() as connection:
            connection.execute(update(jobs).where(self._is(job_id)).values(deaths=jobs.c.deaths + 1))
            return int(connection.execute(select(jobs.c.deaths).where(self._is(job_id))).scalar_one())

    def forget_steps(self, job_ids: Sequence[str]) -> None:
        """Remove what was reported of some jobs."""
        with self._database.writing() as connection:
            connection.execute(delete(job_steps).where(job_steps.c.job_id.in_(job_ids)))
            connection.execute(update(jobs).where(self._kind, jobs.c.id.in_(job_ids)).values(deaths=0))

    def _is(self, job_id: Any) -> ColumnElement[bool]:  # noqa: ANN401 - an id, or a parameter
        return and_(self._kind, jobs.c.id == job_id)
