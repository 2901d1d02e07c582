"""Jobs: records that change until they end, with the steps that are done; and the workers that live."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from jointstiff.service.problems import AuthorisedError, Resource
from jointstiff.service.store.collection import Collection
from jointstiff.service.store.database import Database, Quota
from jointstiff.service.store.tables import (
    OPEN_STATES,
    JobEntry,
    JobRecord,
    authorisations,
    heartbeats,
    job_steps,
    jobs,
    of_records,
)

JobChanges = Mapping[str, Any]
"""Columns of a job that change until it ends: `state`, `summary` and `document`."""

_done: Final = (
    sa.select(sa.func.coalesce(sa.func.sum(job_steps.c.done), 0))
    .where(job_steps.c.job_id == jobs.c.id)
    .scalar_subquery()
    .label("done")
)
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


class JobRecords(Collection[JobRecord, JobEntry]):
    """The jobs of one kind. Every change of one until it ends is safe to repeat."""

    _ended = (~_open,)

    def __init__(self, database: Database, resource: Resource, quota: Quota) -> None:
        self._kind = jobs.c.kind == resource.name
        super().__init__(database, resource, jobs, JobRecord, JobEntry, quota, self._kind)
        self._standings = sa.select(jobs.c.id, jobs.c.state, _done).where(
            self._kind, jobs.c.id.in_(sa.bindparam("ids", expanding=True))
        )

    def status(self, job_id: str) -> JobStatus | None:
        """Return state and progress of a job; None if there is no such job."""
        return self.statuses([job_id]).get(job_id)

    def statuses(self, job_ids: Iterable[str]) -> dict[str, JobStatus]:
        """Return state and progress of those of some jobs that exist, by id."""
        rows = self._database.rows(self._standings, {"ids": list(job_ids)})
        return {str(row.id): JobStatus(str(row.state), int(row.done)) for row in rows}

    def goes_on(self, job_id: str) -> bool:
        """Return whether there is such a job, and it has not ended."""
        status = self.status(job_id)
        return status is not None and status.goes_on

    def open_jobs(self) -> list[str]:
        """Return the ids of the jobs that have not ended."""
        return [str(row.id) for row in self._database.rows(sa.select(jobs.c.id).where(self._kind, _open))]

    def start(self, job_id: str, changes: JobChanges) -> None:
        """Write that a queued job is running."""
        queued = sa.update(jobs).where(*self._is(job_id), jobs.c.state == "queued")
        self._database.change(queued.values(**changes))

    def end(
        self,
        job_id: str,
        state: str,
        changes: Callable[[JobRecord, int], JobChanges],
        also: Callable[[sa.Connection], object] = lambda _: None,
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
        last = of_records(jobs, JobRecord).add_columns(_done).where(*mine)
        with self._database.writing() as connection:
            ended = connection.execute(sa.update(jobs).where(*mine, _open).values(state=state)).rowcount == 1
            if ended:  # no one else can end or start it any more
                *before, done = connection.execute(last).one()
                final = changes(JobRecord(*before), int(done))
                connection.execute(sa.update(jobs).where(*mine).values(**final))
                also(connection)
        return ended

    def report(self, job_id: str, start: int, stop: int) -> None:
        """Write that the units from start to stop of a job are done; to do so again changes nothing.

        Deaths that were counted before are forgotten: the job goes on.
        """
        step = sa.insert(job_steps).values(job_id=job_id, start=start, done=stop - start)
        with suppress(IntegrityError):
            self._database.change(
                step, sa.update(jobs).where(*self._is(job_id), jobs.c.deaths > 0).values(deaths=0)
            )

    def died(self, job_id: str) -> int:
        """Count a worker that died over a job.

        Returns:
            How many have by now.
        """
        with self._database.writing() as connection:
            dying = sa.update(jobs).where(*self._is(job_id)).values(deaths=jobs.c.deaths + 1)
            return int(connection.execute(dying.returning(jobs.c.deaths)).scalar_one())

    def forget_steps(self, job_ids: Sequence[str]) -> None:
        """Remove what was reported of some jobs."""
        steps = sa.delete(job_steps).where(job_steps.c.job_id.in_(job_ids))
        self._database.change(
            steps, sa.update(jobs).where(self._kind, jobs.c.id.in_(job_ids)).values(deaths=0)
        )

    def _refuse_referenced(self, connection: sa.Connection, identifier: str) -> None:
        """Refuse to delete a run whose report was authorised."""
        own = sa.select(authorisations.c.run_id).where(authorisations.c.run_id == identifier).limit(1)
        if connection.execute(own).one_or_none() is not None:
            raise AuthorisedError(identifier)

    def _forget(self, connection: sa.Connection, gone: Sequence[str]) -> None:
        connection.execute(sa.delete(job_steps).where(job_steps.c.job_id.in_(gone)))


SILENT: Final = timedelta(seconds=30)
"""A worker not heard of for so long is taken for dead."""

_FORGET: Final = 100  # silences after which the row of an executor is removed


class Heartbeats:
    """Signs of life of the workers of a store.

    DBOS has none: by itself it goes on only with what a process of the same name left behind.
    """

    def __init__(self, database: Database, clock: Callable[[sa.Connection], datetime] | None = None) -> None:
        """Keep the beats in a database; its own clock tells the time unless another is given."""
        self._database = database
        self._now = clock or database.now

    def beat(self, executor: str) -> list[str]:
        """Record that an executor lives; return all that live, by the clock of the database alone."""
        mine = heartbeats.c.executor == executor
        with self._database.writing() as connection:
            now = self._now(connection)
            if connection.execute(sa.update(heartbeats).where(mine).values(beat_at=now)).rowcount == 0:
                connection.execute(sa.insert(heartbeats).values(executor=executor, beat_at=now))
            living = self._living(connection, now, SILENT)
            connection.execute(sa.delete(heartbeats).where(heartbeats.c.beat_at < now - _FORGET * SILENT))
        return living

    def living(self, silence: timedelta) -> list[str]:
        """The executors that live, none of them silent for longer than that."""
        with self._database.reading() as connection:
            return self._living(connection, self._now(connection), silence)

    def silent(self, silence: timedelta) -> dict[str, datetime]:
        """The executors that were silent for longer than that, with their last beat."""
        with self._database.reading() as connection:
            old = heartbeats.c.beat_at < self._now(connection) - silence
            rows = connection.execute(sa.select(heartbeats.c.executor, heartbeats.c.beat_at).where(old)).all()
        return {str(row.executor): row.beat_at for row in rows}

    def forget(self, executor: str) -> datetime | None:
        """Remove an executor that ends or has ended; return its last beat, None if there is none."""
        mine = sa.delete(heartbeats).where(heartbeats.c.executor == executor)
        with self._database.writing() as connection:
            return connection.execute(mine.returning(heartbeats.c.beat_at)).scalar()

    def prove(self) -> None:
        """Write a row that is no worker's.

        Raises:
            StoreUnavailableError: the database cannot be written.
        """
        self.beat("")

    def _living(self, connection: sa.Connection, now: datetime, silence: timedelta) -> list[str]:
        # Nor later than now: a clock that was set back would keep the dead alive until it caught up.
        living = heartbeats.c.beat_at.between(now - silence, now + silence)
        named = sa.select(heartbeats.c.executor).where(living, heartbeats.c.executor != "")
        rows = connection.execute(named).all()
        return sorted(str(row.executor) for row in rows)
