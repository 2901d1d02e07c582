"""Waits in a database: jobs that do not move and why, parts in the queue, lost sessions of PostgreSQL.

The parts of jobs are read from the table `workflow_status` of DBOS, which `workers/engine.py` fills. Services
and `jointstiff status` read the table without an engine, which would make tables and connections of its own.
"""

from __future__ import annotations

import time
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from statistics import median
from typing import Any, Final, Literal, NamedTuple

import sqlalchemy as sa

from jointstiff.service.store.database import PROGRAM, Database, connection_name
from jointstiff.service.store.jobs import SILENT, is_open
from jointstiff.service.store.tables import heartbeats, job_steps, jobs

STILL_SECONDS: Final = 30.0
"""Time without a stored step after which a job counts as stuck, if there is a reason."""
_STEPS_WITHOUT: Final = 5
"""Multiple of a job's median step; a job of longer steps counts as stuck after this time."""
COMPUTING_SECONDS: Final = 300.0
"""Time without a stored step after which a job counts as stuck, though its worker computes."""
_SILENT_SECONDS: Final = 0.5 * SILENT.total_seconds()
"""Time without a heartbeat after which a worker is named as a reason; a worker beats every 5 s."""
LOST_SECONDS: Final = 20.0
"""Time for which a session of ours may wait for the rest of a message of its program [s]."""
_LOCK_SECONDS: Final = 60.0
"""Time for which a wait for a lock explains why a job does not move, as a part is handed back meanwhile."""
_MOST_JOBS: Final = 1_000  # jobs that are examined, the oldest first
_MOST_EXPLAINED: Final = 50  # jobs whose steps are read
DELAYS_SIGN: Final = "~"
"""Sign before the number of times that a part was handed back, at the end of the part's id."""


def read_delays(part_id: str) -> int:
    """Return the number of times that a part was handed back because of a lock, from its id."""
    number = part_id.partition(DELAYS_SIGN)[2]
    return int(number) if number.isdecimal() else 0


PartState = Literal["ENQUEUED", "PENDING", "DELAYED"]
"""State of a part in the table of DBOS: waits, is claimed by a worker, is offered later."""


@dataclass(frozen=True, slots=True)
class StillJob:
    """A job that has not moved for a while."""

    job_id: str
    kind: str
    seconds: float  # time since its last step was stored, or since the job was posted
    why: str  # reason, as the end of a sentence
    is_stuck: bool = True  # False if the job waits until jobs before it in the queue have ended

    def describe(self) -> str:
        """Return a sentence with the job and the reason."""
        return f"{self.kind} {self.job_id} has not moved for {self.seconds:.0f} s: {self.why}"


@dataclass(frozen=True, slots=True)
class Waiting:
    """Waits in a database at a time."""

    still: tuple[StillJob, ...] = ()
    parts: int = 0  # number of parts that wait for a worker
    oldest_seconds: float = 0.0  # time for which the oldest of these parts has waited

    @property
    def stuck(self) -> list[StillJob]:
        """Jobs that do more than wait for their turn."""
        return [job for job in self.still if job.is_stuck]


@dataclass(frozen=True, slots=True)
class LockWait:
    """A worker that waits for a lock of another session."""

    worker: str
    blocker: str  # words for the program with the lock

    def describe(self) -> str:
        """Return the end of a sentence that names both."""
        return f"worker {self.worker} waits for a lock of {self.blocker}"


class _NotedWait(NamedTuple):
    """A wait for a lock, and when it was seen."""

    wait: LockWait
    at: float  # monotonic time [s]


@dataclass(frozen=True, slots=True)
class _PartRow:
    """A part of a job in the queue."""

    part_id: str
    job_id: str
    state: PartState
    worker: str  # worker that claimed the part; empty for other states
    seconds: float  # time since the part was added to the queue
    seconds_left: float  # time until a delayed part is offered
    priority: int  # parts with a lower number come first


@dataclass(frozen=True, slots=True)
class _OpenJob:
    """A job that has not ended."""

    job_id: str
    kind: str
    seconds: float  # time since the job moved


_PARTS: Final = "workflow_status"  # table of DBOS
_PART_COLUMNS: Final = (
    *("workflow_uuid", "status", "executor_id", "priority"),
    *("created_at", "delay_until_epoch_ms"),
)


def name_queue_schema(store_schema: str) -> str:
    """Return the name of the schema of the queue's tables, given the schema of the store's tables."""
    return "jointstiff_queue" if store_schema == "public" else f"{store_schema}_queue"


def _select_parts(schema: str | None) -> sa.Select[Any]:
    """Return the query of the parts that have not ended, the oldest first, from a schema's table."""
    parts = sa.table(_PARTS, *map(sa.column, _PART_COLUMNS), schema=schema)
    states: list[sa.ColumnElement[str]] = [
        sa.literal_column(f"'{state}'") for state in ("ENQUEUED", "PENDING", "DELAYED")
    ]
    of_open_parts = sa.select(parts).where(parts.c.status.in_(states))
    return of_open_parts.order_by(parts.c.created_at).limit(20 * _MOST_JOBS)


_last_step: Final = (
    sa.select(sa.func.max(job_steps.c.stored_at)).where(job_steps.c.job_id == jobs.c.id).scalar_subquery()
)
_JOBS_QUERY: Final = (
    sa.select(jobs.c.id, jobs.c.kind, jobs.c.created_at, _last_step.label("stored_at"))
    .where(is_open)
    .order_by(jobs.c.sequence)
    .limit(_MOST_JOBS)
)
# Sessions are named `jointstiff` or `jointstiff:NAME`.
_LOCKS_QUERY: Final = sa.text(
    "SELECT waiting.application_name AS waiting, blocking.application_name AS blocking, blocking.state, "
    "extract(epoch FROM now() - blocking.state_change)::float AS seconds "
    "FROM pg_stat_activity AS waiting, unnest(pg_blocking_pids(waiting.pid)) AS blocking_pid "
    "JOIN pg_stat_activity AS blocking ON blocking.pid = blocking_pid "
    "WHERE waiting.usename = current_user AND waiting.datname = current_database() "
    "AND waiting.wait_event_type = 'Lock' AND waiting.application_name LIKE 'jointstiff:%'"
)
# Such a session waits for the rest of a message. Long statements and dumps are not in this state.
_ENDING_QUERY: Final = sa.text(
    "SELECT application_name, pg_terminate_backend(pid) AS ended FROM pg_stat_activity "
    "WHERE usename = current_user AND datname = current_database() AND pid <> pg_backend_pid() "
    "AND (application_name = 'jointstiff' OR application_name LIKE 'jointstiff:%') "
    "AND state = 'active' AND wait_event = 'ClientRead' "
    "AND state_change < now() - make_interval(secs => :seconds)"
)


def _build_part(row: sa.Row[Any], now: float) -> _PartRow:
    """Return a row of the table of DBOS as a part of a job; `now` is the present time since 1970 [ms].

    The id of a part begins with that of its job, with a hyphen behind it.
    """
    is_claimed = row.status == "PENDING"
    return _PartRow(
        part_id=row.workflow_uuid,
        job_id=row.workflow_uuid.partition("-")[0],
        state=row.status,
        worker=str(row.executor_id or "") if is_claimed else "",
        seconds=max(0.0, (now - row.created_at) / 1000.0),
        seconds_left=max(0.0, ((row.delay_until_epoch_ms or 0.0) - now) / 1000.0),
        priority=row.priority or 0,
    )


class Waits:
    """Reader of what waits in a database. Only one thread at a time calls `read`."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._parts_query: sa.Select[Any] | None = None  # once the table of DBOS was seen
        self._last_locks: dict[str, _NotedWait] = {}  # by the id of the job whose worker waited last

    def end_lost_sessions(self, seconds: float = LOST_SECONDS) -> list[str]:
        """End sessions of this program that have waited for the rest of a message for some time [s].

        Such a session keeps its locks for ever, as no timeout of the server ends it. Return the names of the
        ended connections. Nothing happens on SQLite.
        """
        if self._database.dialect == "sqlite":
            return []
        rows = self._database.rows(_ENDING_QUERY, {"seconds": seconds})
        return [str(row.application_name) for row in rows if row.ended]

    def read(self, unwritable: str | None = None) -> Waiting:
        """Return what waits now.

        Args:
            unwritable: reason why the database cannot be written; None if it can be written.

        Raises:
            StoreUnavailableError: the database does not answer.
        """
        with self._database.reading() as connection:
            now = self._database.now(connection)
            open_jobs = [
                _OpenJob(str(row.id), str(row.kind), _seconds_between(now, row.created_at, row.stored_at))
                for row in connection.execute(_JOBS_QUERY)
            ]
        parts = self._read_parts(now)
        waiting_seconds = [part.seconds for part in parts if part.state == "ENQUEUED"]
        return Waiting(
            still=tuple(self._find_still_jobs(open_jobs, parts, now, unwritable)),
            parts=len(waiting_seconds),
            oldest_seconds=max(waiting_seconds, default=0.0),
        )

    def _find_still_jobs(
        self, open_jobs: Iterable[_OpenJob], parts: Sequence[_PartRow], now: datetime, unwritable: str | None
    ) -> list[StillJob]:
        """Return the jobs that do not move, each with the reason.

        Args:
            open_jobs: jobs that have not ended.
            parts: parts in the queue.
            now: present time.
            unwritable: reason why the database cannot be written; None if it can be written.
        """
        candidates = [job for job in open_jobs if job.seconds >= STILL_SECONDS]
        if not candidates:
            return []
        beats = self._read_beats(now)
        self._note_locks(parts, beats)
        median_steps = self._read_median_steps([job.job_id for job in candidates[:_MOST_EXPLAINED]])
        queue = _Queue(parts, beats, unwritable)
        still = list[StillJob]()
        for job in candidates:
            longest = _STEPS_WITHOUT * median_steps.get(job.job_id, 0.0)
            if job.seconds >= longest:
                noted = self._last_locks.get(job.job_id)
                still += queue.explain_stillness(job, longest, None if noted is None else noted.wait)
        return still

    def _read_parts(self, now: datetime) -> list[_PartRow]:
        """Return the parts that wait, are claimed, or are offered later; none without a queue."""
        with self._database.reading() as connection:
            if self._parts_query is None:
                self._parts_query = self._find_parts_query(connection)
            if self._parts_query is None:
                return []
            rows = connection.execute(self._parts_query).all()
        milliseconds = 1000.0 * now.timestamp()
        return [_build_part(row, milliseconds) for row in rows]

    def _find_parts_query(self, connection: sa.Connection) -> sa.Select[Any] | None:
        """Return the query of the parts; None as long as there is no table of them."""
        schema = None
        if self._database.dialect != "sqlite":
            schema = name_queue_schema(str(connection.execute(sa.select(sa.func.current_schema())).scalar()))
        return _select_parts(schema) if sa.inspect(connection).has_table(_PARTS, schema=schema) else None

    def _read_beats(self, now: datetime) -> dict[str, float]:
        """Return worker → time since its last heartbeat [s]."""
        rows = self._database.rows(sa.select(heartbeats).where(heartbeats.c.executor != ""))
        return {str(row.executor): (now - row.beat_at).total_seconds() for row in rows}

    def _note_locks(self, parts: Iterable[_PartRow], beats: Mapping[str, float]) -> None:
        """Note for which locks workers with parts of jobs wait now; forget waits of long ago."""
        at = time.monotonic()
        self._last_locks = {
            job_id: noted for job_id, noted in self._last_locks.items() if at - noted.at < _LOCK_SECONDS
        }
        if self._database.dialect == "sqlite":
            return
        locks = self._read_locks(beats)
        for part in parts:
            if part.worker in locks:
                self._last_locks[part.job_id] = _NotedWait(locks[part.worker], at)

    def _read_locks(self, workers: Iterable[str]) -> dict[str, LockWait]:
        """Return worker → the lock for which it waits now, for some of the `workers`."""
        worker_of_connection = {connection_name(worker): worker for worker in workers}
        locks = {}
        for row in self._database.rows(_LOCKS_QUERY):
            worker = worker_of_connection.get(row.waiting)
            if worker is not None:
                locks[worker] = LockWait(worker, _describe_blocker(row, worker_of_connection))
        return locks

    def _read_median_steps(self, job_ids: Sequence[str]) -> dict[str, float]:
        """Return job's id → median time between two steps that were stored one after the other [s]."""
        columns = job_steps.c
        query = (
            sa.select(columns.job_id, columns.stored_at)
            .where(columns.job_id.in_(job_ids), columns.stored_at.is_not(None))
            .order_by(columns.job_id, columns.stored_at)
        )
        times: dict[str, list[datetime]] = {}
        for row in self._database.rows(query):
            times.setdefault(str(row.job_id), []).append(row.stored_at)
        return {
            job_id: median((later - earlier).total_seconds() for earlier, later in pairwise(stored))
            for job_id, stored in times.items()
            if len(stored) > 1
        }


class _Queue:
    """Parts of all jobs in the queue, and signs of life of the workers."""

    def __init__(self, parts: Sequence[_PartRow], beats: Mapping[str, float], unwritable: str | None) -> None:
        """Describe a queue at a time.

        Args:
            parts: parts of all jobs.
            beats: worker → time since its last heartbeat [s].
            unwritable: reason why the database cannot be written; None if it can be written.
        """
        self._beats, self._unwritable = beats, unwritable
        self._parts_by_job = defaultdict[str, list[_PartRow]](list)
        for part in parts:
            self._parts_by_job[part.job_id].append(part)
        self._waiting_priorities = sorted(part.priority for part in parts if part.state == "ENQUEUED")

    def explain_stillness(self, job: _OpenJob, longest: float, lock: LockWait | None) -> list[StillJob]:
        """Return the job with the reason why it does not move; nothing if it moves as soon as it can.

        Args:
            job: job that has not moved for some time.
            longest: time without a step that is usual for this job [s].
            lock: lock for which its worker waits, or waited lately; None if for none.
        """
        parts = self._parts_by_job[job.job_id]
        reason = self._unwritable or explain(parts, self._beats, lock)
        if reason is None and job.seconds >= max(COMPUTING_SECONDS, longest):
            reason = _explain_computing(parts)
        if reason:
            return [StillJob(job.job_id, job.kind, job.seconds, reason)]
        turn = _explain_turn(parts, self._waiting_priorities)
        return [StillJob(job.job_id, job.kind, job.seconds, turn, is_stuck=False)] if turn else []


def explain(parts: Sequence[_PartRow], beats: Mapping[str, float], lock: LockWait | None) -> str | None:
    """Return why a job does not move, as the end of a sentence; None if it moves as soon as it can.

    Args:
        parts: parts of the job in the queue.
        beats: worker → time since its last heartbeat [s].
        lock: wait of a worker of the job for a lock, a short while ago; None if there was none.
    """
    claimed = [part for part in parts if part.state == "PENDING"]
    delayed = [part for part in parts if part.state == "DELAYED"]
    if lock is not None and claimed:
        return lock.describe()
    for part in claimed:
        silence = beats.get(part.worker)
        if silence is None:
            return f"worker {part.worker} has ended; another worker takes over its part"
        if silence > _SILENT_SECONDS:
            return f"worker {part.worker} has shown no sign of life for {silence:.0f} s"
    if delayed and not claimed:
        return _explain_delay(delayed[0], lock)
    if not any(silence <= SILENT.total_seconds() for silence in beats.values()):
        return "no worker is running; start one with `jointstiff worker`, or serve with `--workers 1`"
    return None


def _explain_delay(part: _PartRow, lock: LockWait | None) -> str:
    """Return why a part is offered later, as the end of a sentence."""
    later = f"it is offered again in {part.seconds_left:.0f} s"
    delays = read_delays(part.part_id)
    if delays == 0:
        return f"no worker of its version has claimed its part; {later}"
    times = "once" if delays == 1 else f"{delays} times"
    reason = "its rows were locked" if lock is None else lock.describe().replace(" waits ", " waited ")
    return f"its part was handed back {times}, as {reason}; {later}"


def _explain_computing(parts: Iterable[_PartRow]) -> str | None:
    """Return that a worker computes a part of a job; None if no part is claimed."""
    workers = [part.worker for part in parts if part.state == "PENDING"]
    return f"worker {workers[0]} computes a step" if workers else None


def _explain_turn(parts: Iterable[_PartRow], waiting_priorities: Sequence[int]) -> str | None:
    """Return how many parts come before those of a job; None if a part of the job is not waiting.

    `waiting_priorities` are the sorted priorities of all parts that wait.
    """
    own = [part.priority for part in parts if part.state == "ENQUEUED"]
    if not own or any(part.state == "PENDING" for part in parts):
        return None
    before = bisect_left(waiting_priorities, min(own))
    return f"its part waits for a worker; {before} parts of other jobs come first"


def _describe_blocker(row: sa.Row[Any], workers: Mapping[str, str]) -> str:
    """Return words for the session that has a lock.

    Args:
        row: row of `_LOCKS_QUERY`.
        workers: name of the connections of a worker → the worker.
    """
    name = row.blocking or ""
    state = f" ({row.state} for {row.seconds:.0f} s)" if row.state and row.seconds else ""
    if name in workers:
        return f"worker {workers[name]}{state}"
    if name.partition(":")[0] == PROGRAM:
        return f"another process of Jointstiff{state}"
    return f"another program{f' ({name})' if name else ''}{state}"


def _seconds_between(now: datetime, *times: datetime | None) -> float:
    """Return the time from the latest of some times to now [s], at least 0."""
    latest = max(time.astimezone(UTC) for time in times if time is not None)
    return max(0.0, (now - latest).total_seconds())
