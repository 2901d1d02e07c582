"""Records of jobs, which change until the jobs end; results of their steps; heartbeats of workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.service.problems import DamagedError, Resource
from jointstiff.service.process import jointstiff_version
from jointstiff.service.store.collection import (
    SEARCHED,
    Collection,
    job_name_columns,
    value_of_parent,
)
from jointstiff.service.store.database import BUSY_SECONDS, Database, Quota, make_insert
from jointstiff.service.store.tables import (
    OPEN_STATES,
    JobEntry,
    JobRecord,
    heartbeats,
    job_steps,
    jobs,
    last_campaigns,
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

    def note(self, job_id: str, changes: JobChanges) -> None:
        """Set columns of a running job, and do nothing if the job has ended."""
        running = sa.update(jobs).where(*self._id_conditions(job_id), jobs.c.state == "running")
        self._database.change(running.values(**changes))

    def end(
        self,
        job_id: str,
        state: str,
        changes: Callable[[JobRecord, int], JobChanges],
        lock_timeout: float = BUSY_SECONDS,
    ) -> bool:
        """End a job and remove the results of its steps; do nothing if the job has ended.

        Each statement is a transaction by itself, so that a lost connection leaves no lock. If this process
        dies before the steps are removed, `Steps.remove_left` removes them.

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
        while True:
            seen = self.status(job_id)
            if seen is None or not seen.is_active:
                return False
            new_values: dict[str, Any] = {"state": state}
            with suppress(DamagedError):  # a damaged job ends, too, so that no worker tries it again
                new_values |= changes(self.get(job_id, include_deleted=True), seen.done)
            # A job that has begun since it was read is read again, as its record has the time of its start.
            ending = sa.update(jobs).where(*is_job, jobs.c.state == seen.state).values(**new_values)
            if self._end_and_mark_campaign(ending, new_values, lock_timeout):
                break
        # In a statement that also ended the job, the removal would miss steps that are stored meanwhile.
        self._database.change(sa.delete(job_steps).where(job_steps.c.job_id == job_id))
        return True

    def _end_and_mark_campaign(
        self, ending: sa.Update, new_values: Mapping[str, Any], lock_timeout: float
    ) -> bool:
        """Carry out the update that ends a job, and mark the last campaign of its robot as outdated.

        Args:
            ending: the update.
            new_values: values of the update; only runs with results have a `trend`.
            lock_timeout: time to wait for other transactions [s].

        Returns:
            True if the update changed the job.
        """
        has_trend = new_values.get("trend") is not None
        if not has_trend:
            return bool(self._database.change_returning(ending.returning(jobs.c.id), at_most=lock_timeout))
        robot_of_run = ending.returning(jobs.c.robot_id)
        if self._database.dialect == "sqlite":  # without statements inside others that change rows
            with self._database.writing(lock_timeout) as connection:
                ended = connection.execute(robot_of_run).all()
                for row in ended:
                    connection.execute(self._count_change(sa.literal(row.robot_id)))
            return bool(ended)
        ended_rows = robot_of_run.cte("ended")
        marking = self._count_change(ended_rows.c.robot_id, ended_rows).cte("marked")
        both = sa.select(ended_rows.c.robot_id).add_cte(marking)
        return bool(self._database.change_returning(both, at_most=lock_timeout))

    def _count_change(self, robot_id: sa.ColumnElement[Any], rows: sa.FromClause | None = None) -> Any:  # noqa: ANN401 - of either dialect
        """Return the statement that counts a change of a robot's runs.

        Args:
            robot_id: id of the robot, or the column of `rows` that has it.
            rows: rows of the ended jobs; None if `robot_id` is a value.
        """
        new_row = sa.select(robot_id, sa.literal(1)).where(sa.true())
        if rows is not None:
            new_row = new_row.select_from(rows)
        insert = make_insert(self._database.dialect, last_campaigns).from_select(
            ["robot_id", "changes"], new_row
        )
        return insert.on_conflict_do_update(
            index_elements=["robot_id"], set_={"changes": last_campaigns.c.changes + 1}
        )

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
            connection.execute(self._count_change(sa.literal(robot_id)))


class Steps:
    """Results of the steps of jobs that have not ended. Safe to use from several threads and processes.

    Two workers may carry out the same step, for instance if one of them sent no heartbeats for a while: their
    results are equal, and the first is kept. The results of a job are of one version of the program. All
    results of a job are removed when the job ends.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def store_result(
        self, job_id: str, span: tuple[int, int], result: bytes, version: str | None = None
    ) -> bool:
        """Store the result of a step, unless the step has a result already or the job has ended.

        Args:
            job_id: id of the job.
            span: the step as (first unit of work, one past the last unit).
            result: packed result of the step.
            version: version of the program that computed the result; None for this program.

        Returns:
            False if the job has ended or has results of another version, else True.
        """
        version = version or jointstiff_version()
        start, end = span
        new_row = self._select_step(job_id, start, end - start, result, version)
        insert = make_insert(self._database.dialect, job_steps).from_select(
            ["job_id", "start", "units", "result", "stored_at", "version"], new_row
        )
        # A result that was stored before is kept. The row is written all the same, as only rows that a
        # statement writes are returned.
        kept = insert.on_conflict_do_update(
            index_elements=["job_id", "start"],
            set_={"units": insert.excluded.units},
            where=job_steps.c.version == version,
        )
        return bool(self._database.change_returning(kept.returning(job_steps.c.start)))

    def _select_step(
        self, job_id: str, start: int, units: int, result: bytes, version: str
    ) -> sa.Select[Any]:
        """Return the query of a new row of `job_steps`: none if the job ended or has other versions' results.

        The lock of the job's row keeps the job from ending before the step is stored; the end then removes
        the step.
        """
        columns, others = job_steps.c, sa.alias(job_steps)
        step = sa.select(
            jobs.c.id,
            sa.literal(start),
            sa.literal(units),
            sa.literal(result, columns.result.type),
            self._database.make_now(),
            sa.literal(version),
        )
        has_others = sa.exists().where(others.c.job_id == job_id, others.c.version.is_distinct_from(version))
        of_open_job = step.where(jobs.c.id == job_id, is_open, ~has_others)
        return of_open_job.with_for_update(read=True, of=jobs)

    def list_versions(self, job_id: str) -> set[str | None]:
        """Return the versions that computed a job's stored results; None for a program of layout 0018."""
        query = sa.select(job_steps.c.version).where(job_steps.c.job_id == job_id).distinct()
        return {row.version for row in self._database.rows(query)}

    def keep_version(self, job_id: str, version: str) -> None:
        """Remove the results of a job that other versions computed."""
        is_other = job_steps.c.version.is_distinct_from(version)
        self._database.change(sa.delete(job_steps).where(job_steps.c.job_id == job_id, is_other))

    def remove_left(self) -> int:
        """Remove steps of jobs that have ended, which a process left that died; return their number."""
        is_left = ~sa.exists().where(jobs.c.id == job_steps.c.job_id, is_open)
        if not self._database.rows(sa.select(job_steps.c.job_id).where(is_left).limit(1)):
            return 0  # usually: no writer has to wait
        return self._database.change(sa.delete(job_steps).where(is_left))

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
        self._clock = clock
        self._now = clock or database.now

    def beat(self, executor: str) -> list[str]:
        """Store a heartbeat of an executor (a worker process); return the names of all living executors."""
        insert = make_insert(self._database.dialect, heartbeats)
        beat = insert.on_conflict_do_update(
            index_elements=["executor"], set_={"beat_at": insert.excluded.beat_at}
        ).returning(heartbeats.c.beat_at)
        with self._database.writing_once() as connection:
            now = self._clock(connection) if self._clock else self._database.make_now()
            beat_at: datetime = connection.execute(beat.values(executor=executor, beat_at=now)).scalar_one()
        with self._database.reading() as connection:
            return self._living(connection, beat_at, SILENT)

    def remove_old(self) -> None:
        """Remove the heartbeats of executors that have been silent for long."""
        with self._database.reading() as connection:
            is_old = heartbeats.c.beat_at < self._now(connection) - _REMOVE_AFTER * SILENT
            has_old = connection.execute(sa.select(heartbeats.c.executor).where(is_old).limit(1)).first()
        if has_old is not None:
            self._database.change(sa.delete(heartbeats).where(is_old))

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
