"""Jobs: records that change until they end; results of their steps; and the workers that live."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.service.problems import DamagedError, Resource
from jointstiff.service.store.collection import Collection, derive_anew, name_of, names_of_job
from jointstiff.service.store.database import BUSY_SECONDS, Database, Quota, inserting
from jointstiff.service.store.tables import (
    OPEN_STATES,
    JobEntry,
    JobRecord,
    heartbeats,
    job_steps,
    jobs,
    last_campaigns,
    of_records,
)

JOB: Final = Resource("job", "jobs")
"""A job of any kind."""

JobChanges = Mapping[str, Any]
"""Columns of a job that change until it ends: `state`, `summary` and `document`."""

_done: Final = (
    sa.select(sa.func.coalesce(sa.func.sum(job_steps.c.units), 0))
    .where(job_steps.c.job_id == jobs.c.id)
    .scalar_subquery()
    .label("done")
)
is_open: Final = jobs.c.state.in_([sa.literal_column(repr(state)) for state in OPEN_STATES])
"""Whether a job has not ended: in the words of the index of such jobs, which has no parameters."""


@dataclass(frozen=True, slots=True)
class JobStatus:
    """State of a job."""

    state: str  # its state
    done: int  # units of its work that are done, while it has not ended

    @property
    def is_active(self) -> bool:
        """Return whether the job has not ended."""
        return self.state in OPEN_STATES


class JobRecords(Collection[JobRecord, JobEntry]):
    """The jobs of one kind, or of all. Every change of one until it ends is safe to repeat."""

    _ended = (~is_open,)

    def __init__(self, database: Database, resource: Resource, quota: Quota) -> None:
        self._kind = sa.true() if resource == JOB else jobs.c.kind == resource.name
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

    def is_active(self, job_id: str) -> bool:
        """Return whether there is such a job, and it has not ended."""
        status = self.status(job_id)
        return status is not None and status.is_active

    def open_jobs(self) -> list[str]:
        """Return the ids of the jobs that have not ended."""
        return [str(row.id) for row in self._database.rows(sa.select(jobs.c.id).where(self._kind, is_open))]

    def start(self, job_id: str, changes: JobChanges) -> None:
        """Write that a queued job is running."""
        queued = sa.update(jobs).where(*self._is(job_id), jobs.c.state == "queued")
        self._database.change(queued.values(**changes))

    def end(
        self,
        job_id: str,
        state: str,
        changes: Callable[[JobRecord, int], JobChanges],
        at_most: float = BUSY_SECONDS,
    ) -> bool:
        """End a job, unless it has ended: a job never changes once ended.

        Args:
            job_id: its id.
            state: its final state.
            changes: return its last form, given the record before and the number of units done.
            at_most: time to wait for a worker that has the job locked [s].

        Returns:
            Whether it was this call that ended it.

        Raises:
            StoreUnavailableError: the job is locked, or the database does not answer.
        """
        mine = self._is(job_id)
        last = of_records(jobs, JobRecord).add_columns(_done).where(*mine)
        with self._database.writing(at_most) as connection:
            end = sa.update(jobs).where(*mine, is_open).values(state=state)
            ended = connection.execute(end).rowcount == 1
            if ended:  # no one else can end or start it any more
                with suppress(DamagedError):  # it must not keep workers busy
                    before = dict(connection.execute(last).one()._mapping)
                    done = int(before.pop("done"))
                    final = changes(JobRecord(**before), done)
                    connection.execute(sa.update(jobs).where(*mine).values(**final))
                connection.execute(sa.delete(job_steps).where(job_steps.c.job_id == job_id))
                self._touch(connection, job_id)
        return ended

    def _copied(self, record: JobRecord, named: Mapping[str, Any]) -> dict[str, str | None]:
        measured = "measurement_set_id"
        serial_number = name_of(named, measured, "serial_number")
        return names_of_job(record.name, name_of(named, "robot_id"), name_of(named, measured), serial_number)

    def _touch(self, connection: sa.Connection, identifier: str) -> None:
        numbers = sa.select(jobs.c.robot_id).where(*self._is(identifier), jobs.c.trend.is_not(None))
        for (robot_id,) in connection.execute(numbers):
            mine = last_campaigns.c.robot_id == robot_id
            if not derive_anew(connection, mine):
                first = inserting(connection, last_campaigns).values(robot_id=robot_id, changes=1)
                if connection.execute(first).rowcount == 0:  # another one was faster
                    derive_anew(connection, mine)


class Steps:
    """Results of the steps of jobs that have not ended. Safe to use from several threads and processes.

    Two workers may carry out the same step, for instance when one of them is silent for a while: their
    numbers are equal, and the first result stays. All results go when their job ends.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def keep(self, job_id: str, span: tuple[int, int], result: bytes) -> bool:
        """Keep the result of a step, unless a result is kept or the job has ended.

        Args:
            job_id: id of the job.
            span: first unit of the step, and one past the last.
            result: what the step computed.

        Returns:
            Whether the job goes on.
        """
        # The lock keeps the job from ending until the row is there: the end would not remove it.
        is_active = sa.select(jobs.c.id).where(jobs.c.id == job_id, is_open).with_for_update()
        row = {"job_id": job_id, "start": span[0], "units": span[1] - span[0], "result": result}
        with self._database.writing() as connection:
            if connection.execute(is_active).first() is None:
                return False
            connection.execute(inserting(connection, job_steps).values(row))
        return True

    def done(self, job_id: str) -> set[int]:
        """Return the first units of those steps of a job whose results are kept."""
        rows = self._database.rows(sa.select(job_steps.c.start).where(job_steps.c.job_id == job_id))
        return {int(row.start) for row in rows}

    def results(self, job_id: str) -> list[bytes]:
        """Return the results of the steps of a job, in order."""
        mine = sa.select(job_steps.c.result).where(job_steps.c.job_id == job_id)
        return [bytes(row.result) for row in self._database.rows(mine.order_by(job_steps.c.start))]

    def others_begun(self, job_id: str) -> int:
        """Return the number of other jobs than this one that have results and have not ended."""
        begun = sa.select(sa.func.count(sa.distinct(job_steps.c.job_id))).where(job_steps.c.job_id != job_id)
        return int(self._database.rows(begun)[0][0])


SILENT: Final = timedelta(seconds=30)
"""A worker not heard of for so long is taken for dead."""

_FORGET: Final = 100  # silences after which the row of an executor is removed


class Heartbeats:
    """Signs of life of the workers of a store."""

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

    def forget(self, executor: str) -> None:
        """Remove an executor that ends or has ended."""
        self._database.change(sa.delete(heartbeats).where(heartbeats.c.executor == executor))

    def check_writable(self) -> None:
        """Check that the database can be written: write a heartbeat without a worker's name.

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
