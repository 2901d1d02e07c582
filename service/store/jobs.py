"""Records of jobs, which change until the jobs end; results of their steps; heartbeats of workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.service.problems import DamagedError, Resource
from jointstiff.service.store.collection import (
    SEARCHED,
    Collection,
    job_name_columns,
    mark_campaigns_outdated,
    value_of_parent,
)
from jointstiff.service.store.database import BUSY_SECONDS, Database, Quota, insert_unless_present
from jointstiff.service.store.tables import (
    OPEN_STATES,
    JobEntry,
    JobRecord,
    heartbeats,
    job_steps,
    jobs,
    last_campaigns,
    select_fields_of,
)

JOB: Final = Resource("job", "jobs")
"""A job of any kind."""

JobChanges = Mapping[str, Any]
"""Columns of a job that change until it ends: `state`, `summary` and `document`."""

_finished_units: Final = (
    sa.select(sa.func.coalesce(sa.func.sum(job_steps.c.units), 0))
    .where(job_steps.c.job_id == jobs.c.id)
    .scalar_subquery()
    .label("done")
)
is_open: Final = jobs.c.state.in_([sa.literal_column(repr(state)) for state in OPEN_STATES])
"""SQL condition of a job that has not ended; with literal values the database uses an index."""


@dataclass(frozen=True, slots=True)
class JobStatus:
    """State of a job."""

    state: str
    done: int  # number of finished units of work; 0 once the job has ended

    @property
    def is_active(self) -> bool:
        """True if the job has not ended."""
        return self.state in OPEN_STATES


class JobRecords(Collection[JobRecord, JobEntry]):
    """The jobs of one kind, or of all kinds. Until a job ends, every change may be repeated safely."""

    _deletion_conditions = (~is_open,)

    def __init__(self, database: Database, resource: Resource, quota: Quota) -> None:
        self._kind = sa.true() if resource == JOB else jobs.c.kind == resource.name
        super().__init__(database, resource, jobs, JobRecord, JobEntry, quota, self._kind)
        self._status_query = sa.select(jobs.c.id, jobs.c.state, _finished_units).where(
            self._kind, jobs.c.id.in_(sa.bindparam("ids", expanding=True))
        )

    def status(self, job_id: str) -> JobStatus | None:
        """Return state and progress of a job; None if no job has this id."""
        return self.statuses([job_id]).get(job_id)

    def statuses(self, job_ids: Iterable[str]) -> dict[str, JobStatus]:
        """Return job id → state and progress; ids without a job are left out."""
        rows = self._database.rows(self._status_query, {"ids": list(job_ids)})
        return {str(row.id): JobStatus(str(row.state), int(row.done)) for row in rows}

    def is_active(self, job_id: str) -> bool:
        """Return whether a job exists and has not ended."""
        status = self.status(job_id)
        return status is not None and status.is_active

    def open_jobs(self) -> list[str]:
        """Return the ids of the jobs that have not ended."""
        return [str(row.id) for row in self._database.rows(sa.select(jobs.c.id).where(self._kind, is_open))]

    def start(self, job_id: str, changes: JobChanges) -> None:
        """Set columns of a job that starts, and do nothing if the job is not queued any more.

        `changes` is column → new value.
        """
        queued = sa.update(jobs).where(*self._id_conditions(job_id), jobs.c.state == "queued")
        self._database.change(queued.values(**changes))

    def end(
        self,
        job_id: str,
        state: str,
        changes: Callable[[JobRecord, int], JobChanges],
        lock_timeout: float = BUSY_SECONDS,
    ) -> bool:
        """End a job and remove the results of its steps; do nothing if the job has ended.

        Args:
            job_id: id of the job.
            state: final state of the job.
            changes: function that returns new values of columns, given the stored record and the number of
                finished units.
            lock_timeout: time to wait for a worker that has the job locked [s].

        Returns:
            True if this call ended the job, False if the job had ended before.

        Raises:
            StoreUnavailableError: the job is locked, or the database does not answer.
        """
        is_job = self._id_conditions(job_id)
        record_query = select_fields_of(jobs, JobRecord).add_columns(_finished_units).where(*is_job)
        with self._database.writing(lock_timeout) as connection:
            set_state = sa.update(jobs).where(*is_job, is_open).values(state=state)
            was_ended_now = connection.execute(set_state).rowcount == 1
            if was_ended_now:  # the update has locked the row, so that no other transaction changes it
                with suppress(DamagedError):  # a damaged job ends, too, so that no worker tries it again
                    columns = dict(connection.execute(record_query).one()._mapping)
                    finished_units = int(columns.pop("done"))
                    new_values = changes(self._make_record(columns), finished_units)
                    connection.execute(sa.update(jobs).where(*is_job).values(**new_values))
                connection.execute(sa.delete(job_steps).where(job_steps.c.job_id == job_id))
                self._mark_campaign_outdated(connection, job_id)
        return was_ended_now

    def _collect_name_copies(
        self, record: JobRecord, parent_rows: Mapping[str, Any]
    ) -> dict[str, str | None]:
        """Return column → text, for copies of the names of the job's robot and set, and for searches."""
        set_column = "measurement_set_id"
        return job_name_columns(
            record.name,
            value_of_parent(parent_rows, "robot_id"),
            *(value_of_parent(parent_rows, set_column, name) for name in ("name", *SEARCHED)),
        )

    def _mark_campaign_outdated(self, connection: sa.Connection, identifier: str) -> None:
        """Mark the last campaign of a run's robot as outdated; do nothing for jobs that are no runs."""
        robot_of_run = sa.select(jobs.c.robot_id).where(
            *self._id_conditions(identifier), jobs.c.trend.is_not(None)
        )
        for (robot_id,) in connection.execute(robot_of_run):
            is_robot = last_campaigns.c.robot_id == robot_id
            if not mark_campaigns_outdated(connection, is_robot):
                new_row = insert_unless_present(connection, last_campaigns).values(
                    robot_id=robot_id, changes=1
                )
                # Another process may have inserted the row meanwhile.
                if connection.execute(new_row).rowcount == 0:
                    mark_campaigns_outdated(connection, is_robot)


class Steps:
    """Results of the steps of jobs that have not ended. Safe to use from several threads and processes.

    Two workers may carry out the same step, for instance if one of them sent no heartbeats for a while: their
    results are equal, and the first is kept. All results of a job are removed when the job ends.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def store_result(self, job_id: str, span: tuple[int, int], result: bytes) -> bool:
        """Store the result of a step, unless the step has a result already or the job has ended.

        Args:
            job_id: id of the job.
            span: the step as (first unit of work, one past the last unit).
            result: packed result of the step.

        Returns:
            False if the job has ended, else True.
        """
        # The lock keeps the job from ending before the row is stored; the end then removes the row.
        is_active = sa.select(jobs.c.id).where(jobs.c.id == job_id, is_open).with_for_update()
        row = {"job_id": job_id, "start": span[0], "units": span[1] - span[0], "result": result}
        with self._database.writing() as connection:
            if connection.execute(is_active).first() is None:
                return False
            connection.execute(insert_unless_present(connection, job_steps).values(row))
        return True

    def done_starts(self, job_id: str) -> set[int]:
        """Return the first unit, which identifies the step, of each step of a job with a stored result."""
        rows = self._database.rows(sa.select(job_steps.c.start).where(job_steps.c.job_id == job_id))
        return {int(row.start) for row in rows}

    def results(self, job_id: str) -> list[bytes]:
        """Return the stored results of the steps of a job, in the order of the steps."""
        query = sa.select(job_steps.c.result).where(job_steps.c.job_id == job_id)
        return [bytes(row.result) for row in self._database.rows(query.order_by(job_steps.c.start))]

    def count_other_begun_jobs(self, job_id: str) -> int:
        """Return the number of other jobs that have begun and not ended.

        Only such jobs have stored results of steps.
        """
        query = sa.select(sa.func.count(sa.distinct(job_steps.c.job_id))).where(job_steps.c.job_id != job_id)
        return int(self._database.rows(query)[0][0])


SILENT: Final = timedelta(seconds=30)
"""Time without a heartbeat after which a worker counts as dead."""

_REMOVE_AFTER: Final = 100  # multiple of `SILENT` after which the row of an executor is removed


class Heartbeats:
    """Signs of life of the workers of a store."""

    def __init__(self, database: Database, clock: Callable[[sa.Connection], datetime] | None = None) -> None:
        """Keep heartbeats in a database; `clock` returns the time, by default that of the database."""
        self._database = database
        self._now = clock or database.now

    def beat(self, executor: str) -> list[str]:
        """Store a heartbeat of an executor (a worker process); return the names of all living executors."""
        is_executor = heartbeats.c.executor == executor
        with self._database.writing() as connection:
            now = self._now(connection)
            if connection.execute(sa.update(heartbeats).where(is_executor).values(beat_at=now)).rowcount == 0:
                connection.execute(sa.insert(heartbeats).values(executor=executor, beat_at=now))
            living = self._living(connection, now, SILENT)
            connection.execute(
                sa.delete(heartbeats).where(heartbeats.c.beat_at < now - _REMOVE_AFTER * SILENT)
            )
        return living

    def living(self, silence: timedelta) -> list[str]:
        """Return the sorted names of the executors whose last heartbeat is at most `silence` ago."""
        with self._database.reading() as connection:
            return self._living(connection, self._now(connection), silence)

    def silent(self, silence: timedelta) -> dict[str, datetime]:
        """Return executor → last heartbeat, for executors without a heartbeat for `silence`."""
        with self._database.reading() as connection:
            old = heartbeats.c.beat_at < self._now(connection) - silence
            rows = connection.execute(sa.select(heartbeats.c.executor, heartbeats.c.beat_at).where(old)).all()
        return {str(row.executor): row.beat_at for row in rows}

    def forget(self, executor: str) -> None:
        """Remove the heartbeat of an executor that ends or has ended."""
        self._database.change(sa.delete(heartbeats).where(heartbeats.c.executor == executor))

    def check_writable(self) -> None:
        """Check that the database can be written: write a heartbeat without a worker's name.

        Raises:
            StoreUnavailableError: the database cannot be written.
        """
        self.beat("")

    def _living(self, connection: sa.Connection, now: datetime, silence: timedelta) -> list[str]:
        """Return the names of the executors with a heartbeat at most `silence` before `now`, sorted."""
        # After a clock was set back, heartbeats of lost workers can lie in the future: those do not count.
        is_living = heartbeats.c.beat_at.between(now - silence, now + silence)
        query = sa.select(heartbeats.c.executor).where(is_living, heartbeats.c.executor != "")
        rows = connection.execute(query).all()
        return sorted(str(row.executor) for row in rows)
