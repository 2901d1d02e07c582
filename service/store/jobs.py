"""Jobs: records that change until they end; the steps that workers carry out; and the workers that live."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.service.problems import Resource
from jointstiff.service.store.collection import Collection
from jointstiff.service.store.database import Database, Quota
from jointstiff.service.store.tables import (
    OPEN_STATES,
    JobEntry,
    JobRecord,
    heartbeats,
    job_steps,
    jobs,
    of_records,
)

JOB: Final = Resource("job", "jobs")
"""A job of any kind."""

JobChanges = Mapping[str, Any]
"""Columns of a job that change until it ends: `state`, `summary` and `document`."""

_done: Final = (
    sa.select(sa.func.coalesce(sa.func.sum(job_steps.c.units), 0))
    .where(job_steps.c.job_id == jobs.c.id, job_steps.c.result.is_not(None))
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
    """The jobs of one kind, or of all. Every change of one until it ends is safe to repeat."""

    _ended = (~_open,)

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
    ) -> bool:
        """End a job, unless it has ended: a job never changes once ended.

        Args:
            job_id: its id.
            state: its final state.
            changes: return its last form, given the record before and the number of units done.

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
                connection.execute(sa.delete(job_steps).where(job_steps.c.job_id == job_id))
        return ended


PLAN: Final = -1
"""Start of the step that cuts a job into the others."""
_FIRST_TURN: Final = 1  # of a job; to put one together has none to wait for
_SAME_TURN: Final = 2  # steps of a job that are one after the other: then others have their turn
_LAST_TURN: Final = 9  # of a long job, from which on what came first goes first
_undone: Final = job_steps.c.result.is_(None)


@dataclass(frozen=True, slots=True)
class Step:
    """A step of a job that is left to workers. The first one cuts the job, the last one puts it together."""

    job_id: str
    start: int  # its first unit; `PLAN` of the first step
    units: int  # none of the first and of the last step

    @property
    def is_last(self) -> bool:
        """Return whether it puts the job together."""
        return self.units == 0 and self.start != PLAN


class Steps:
    """The steps of all jobs that are left to workers. Safe to use from several threads and processes.

    Each is taken by one worker, and what it computes is kept. One may be carried out twice, as when a worker
    is silent for a while: the numbers are the same, and the first ones stay. They go with the end of the job.
    A job that has not ended has a step that is to be done: one follows the others in the same transaction.
    Who changes the steps of a job, or ends it, holds its row of the table of jobs first.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        step = job_steps.c
        taken = sa.bindparam("executor", type_=sa.String)
        # In the order of the index of steps to be done, of which it looks at the first ones alone.
        self._next = (
            sa.select(step.job_id, step.start, step.units)
            .where(_undone, sa.or_(step.executor.is_(None), step.executor == taken))
            .order_by(step.turn, step.sequence, step.start)
            .limit(1)
        )
        self._kind = sa.select(jobs.c.kind).where(jobs.c.id == step.job_id).scalar_subquery()

    def announce(self, connection: sa.Connection, job_id: str) -> None:
        """Leave a job to workers, in the transaction that stores it."""
        self._add(connection, job_id, [(PLAN, 0, _FIRST_TURN)])

    def take(self, executor: str, kinds: Sequence[str] | None = None) -> Step | None:
        """Take the next step; None if there is none. What was taken before and is not done may come again.

        Args:
            executor: name of the worker.
            kinds: names of the kinds of jobs that it knows; others are left alone. None for any.
        """
        asked = {"executor": executor}
        following = self._next if kinds is None else self._next.where(self._kind.in_(kinds))
        if not self._database.rows(following, asked):
            return None  # who only looks does not take the writer's turn
        with self._database.writing() as connection:
            locked = following.with_for_update(skip_locked=True)
            row = connection.execute(locked, asked).one_or_none()
            if row is None:
                return None
            step = Step(*row)
            connection.execute(self._change(step.job_id, step.start).values(executor=executor))
        return step

    def share_out(self, job_id: str, spans: Sequence[tuple[int, int]]) -> None:
        """Put the steps of a job in the place of the first one."""
        with self._database.writing() as connection:
            if not self._hold(connection, job_id):
                return
            first = sa.delete(job_steps).where(job_steps.c.job_id == job_id, job_steps.c.start == PLAN)
            if connection.execute(first).rowcount == 1:  # nobody else has
                steps = [
                    (start, stop - start, min(_FIRST_TURN + place // _SAME_TURN, _LAST_TURN))
                    for place, (start, stop) in enumerate(spans)
                ]
                self._add(connection, job_id, steps or [(0, 0, 0)])

    def keep(self, job_id: str, start: int, result: bytes) -> None:
        """Keep what a step computed, unless something is kept, or the job has ended; the last one follows."""
        mine = job_steps.c.job_id == job_id
        end = sa.select(sa.func.max(job_steps.c.start + job_steps.c.units)).where(mine)
        with self._database.writing() as connection:
            if not self._hold(connection, job_id):
                return
            kept = connection.execute(self._change(job_id, start).values(result=result, executor=None))
            left = connection.execute(sa.select(job_steps.c.start).where(mine, _undone).limit(1)).first()
            if kept.rowcount == 1 and left is None:
                self._add(connection, job_id, [(connection.execute(end).scalar_one(), 0, 0)])

    def results(self, job_id: str) -> list[bytes]:
        """Return what the steps of a job computed, in order."""
        step = job_steps.c
        mine = sa.select(step.result).where(step.job_id == job_id, step.result.is_not(None))
        return [bytes(row.result) for row in self._database.rows(mine.order_by(step.start))]

    def leave(self, executor: str) -> None:
        """Leave to others what a worker that ends has begun."""
        mine = sa.update(job_steps).where(job_steps.c.executor == executor)
        self._database.change(mine.values(executor=None))

    def count_death(self, executor: str) -> dict[str, int]:
        """Leave to others what a worker died over, as `count_deaths` does."""
        return self._count(job_steps.c.executor == executor)

    def count_deaths(self, living: Sequence[str]) -> dict[str, int]:
        """Leave to others what workers died over; return how many did by now over a step of each job.

        Args:
            living: names of all workers that live.
        """
        return self._count(job_steps.c.executor.is_not(None), job_steps.c.executor.not_in(living))

    def forgotten(self) -> dict[str, str]:
        """Return the jobs that have not ended, and have no step that will end them: id → name of the kind."""
        known = sa.exists().where(job_steps.c.job_id == jobs.c.id)
        lost = self._database.rows(sa.select(jobs.c.id, jobs.c.kind).where(_open, ~known))
        return {str(row.id): str(row.kind) for row in lost}

    def _hold(self, connection: sa.Connection, job_id: str) -> bool:
        """Keep others from changing the steps of a job; return whether it goes on."""
        mine = sa.select(jobs.c.id).where(jobs.c.id == job_id, _open)
        return connection.execute(mine.with_for_update()).first() is not None

    def _add(self, connection: sa.Connection, job_id: str, steps: Sequence[tuple[int, int, int]]) -> None:
        """Add steps to a job: start, units and turn of each."""
        sequence = connection.execute(sa.select(jobs.c.sequence).where(jobs.c.id == job_id)).scalar_one()
        names = "start", "units", "turn"
        rows = [
            {"job_id": job_id, "sequence": sequence, **dict(zip(names, step, strict=True))} for step in steps
        ]
        connection.execute(sa.insert(job_steps), rows)

    def _change(self, job_id: str, start: int) -> sa.Update:
        return sa.update(job_steps).where(job_steps.c.job_id == job_id, job_steps.c.start == start, _undone)

    def _count(self, *dead: sa.ColumnElement[bool]) -> dict[str, int]:
        if not self._database.rows(sa.select(job_steps.c.job_id).where(*dead).limit(1)):
            return {}
        step = job_steps.c
        dying = sa.update(job_steps).where(*dead).values(executor=None, deaths=step.deaths + 1)
        with self._database.writing() as connection:
            rows = connection.execute(dying.returning(step.job_id, step.deaths)).all()
        return {
            str(row.job_id): max(each.deaths for each in rows if each.job_id == row.job_id) for row in rows
        }


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
