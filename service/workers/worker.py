"""A worker process: carries out long jobs until it is stopped, and continues the jobs of lost workers."""

from __future__ import annotations

import faulthandler
import gc
import logging
import mmap
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from typing import Final

from jointstiff.service.jobs import Jobs, Part, Parts
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.problems import LockedError, StoreError, StoreUnavailableError, WorkerLostError
from jointstiff.service.runs.trend import Trends
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.database import name_connections, refuse_in_memory, refuse_missing
from jointstiff.service.store.jobs import SILENT, Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console
from jointstiff.service.workers.engine import ATTEMPTS, LATER_SECONDS, Engine, Queue

# Jobs of other kinds are left to workers of other versions.
_KNOWN_KINDS: Final = [kind.name for kind in (*KINDS, *RETIRED)]
# Greatest numbers of deleted records of each kind that are removed, and of robots whose summary is renewed,
# in one call of `Recovery.check_and_recover`
_MAX_REMOVED: Final = 20
_MAX_RENEWED: Final = 20
_REWRITE_SECONDS: Final = 1.0  # time for documents of earlier forms in one call
_FIRST_PAUSE: Final = 0.1
_LONGEST_PAUSE: Final = 5.0
_MAX_STALLED_CHECKS: Final = 4
"""Successive checks without processor time of a part after which its thread is regarded as frozen."""


_MOST_REFUSALS: Final = 3
"""Number of times that a lock is not available to a part, after which the worker hands the part back."""


class FrozenError(Exception):
    """Error: the thread that carries out a part of a job neither computes nor ends."""


def _find_outage(act: Callable[[], object]) -> StoreUnavailableError | None:
    """Call a function; return the error of a database that does not answer, or None if the call succeeded.

    A process that lacks memory kills itself, as the system would: the job must not fail, because another
    worker may have more memory. That worker continues the part, and DBOS counts a failed attempt.
    """
    try:
        act()
    except MemoryError:
        os.kill(os.getpid(), signal.SIGKILL)
    except StoreUnavailableError as error:
        return error
    return None


class Retries:
    """Retries of the part that a worker carries out. One thread retries, another one looks."""

    def __init__(self) -> None:
        self._waits_since: float | None = None  # monotonic time of the first failure [s]

    def waits_since(self, moment: float) -> bool:
        """Return whether the part has only waited for the database since a monotonic time [s]."""
        since = self._waits_since
        return since is not None and since <= moment

    def retry(self, act: Callable[[], object], hand_back: Callable[[], object] | None = None) -> None:
        """Call a function again and again until the database answers, as an outage must not fail a job.

        The pauses between the calls double, to a longest pause.

        Args:
            act: the function.
            hand_back: function that is called instead, once a lock was not available for `_MOST_REFUSALS`
                times, so that this worker can carry out other parts; None to wait without end.
        """
        pause, refused_locks = _FIRST_PAUSE, 0
        while True:
            gives_up = hand_back is not None and refused_locks >= _MOST_REFUSALS
            outage = _find_outage(hand_back if gives_up and hand_back is not None else act)
            if outage is None:
                break
            refused_locks += isinstance(outage, LockedError)
            if self._waits_since is None:
                self._waits_since = time.monotonic()
            time.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)
        self._waits_since = None


class Recovery:
    """Recovery of jobs of lost workers, run by each worker at every heartbeat. Repeating it is safe."""

    def __init__(
        self,
        store: Store,
        jobs: Callable[[str], Jobs],
        engine: Engine,
        executor: str,
        *,
        heartbeats: Heartbeats | None = None,
        retries: Retries | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Prepare the recovery of the jobs of a store.

        Args:
            store: store of the jobs.
            jobs: function that returns the jobs of one kind, by the id of a job of this kind.
            engine: engine of this worker.
            executor: name of this worker.
            heartbeats: heartbeats of the workers; default: those of the store.
            retries: retries of the part that this worker carries out; default: there are none.
            now: function that returns the time, with a time zone; old deleted jobs are removed by this clock.
        """
        self._store, self._jobs, self._engine, self._executor = store, jobs, engine, executor
        self._heartbeats = heartbeats or store.heartbeats
        self._retries = retries or Retries()
        self._now = now
        self._trends = Trends(store)
        # State at the last check: silent worker → time of its last heartbeat; id of a part that runs in this
        # process → its processor time [s]; ids of parts that this worker has claimed but that do not run.
        self._silent_before: dict[str, datetime] = {}
        self._seconds_by_part: dict[str, float] = {}
        self._idle_before: set[str] = set()
        self._stalled_checks = 0
        self._checked_at = time.monotonic()

    def seconds_since_check(self) -> float:
        """Return the time since the last check began [s]."""
        return time.monotonic() - self._checked_at

    def check_and_recover(self) -> None:
        """Store a heartbeat if the running part makes progress, and recover the jobs of lost workers.

        A worker without a recent heartbeat is silent. A worker that is silent at two checks is lost. Retries
        are no progress: a worker that has only waited for the database since the last check is silent.

        Raises:
            FrozenError: the running part has made no progress for `_MAX_STALLED_CHECKS` checks.
            StoreUnavailableError: the database does not answer; check again later.
        """
        last_check, self._checked_at = self._checked_at, time.monotonic()
        self._end_lost_sessions()
        if not self._is_stalled() and not self._retries.waits_since(last_check):
            self._beat_and_recover()

    def _end_lost_sessions(self) -> None:
        """End lost sessions of PostgreSQL. Each worker does so, as the first one may wait for their locks."""
        try:
            for name in self._store.waits.end_lost_sessions():
                _logger.warning("ended a lost session of %s, which waited for the rest of a message", name)
        except Exception:
            _logger.warning("cannot end lost sessions of PostgreSQL; trying again", exc_info=True)

    def _beat_and_recover(self) -> None:
        """Store a heartbeat; the first active worker also recovers jobs and removes what is not needed."""
        # Claims are read before the heartbeats: a worker stores a heartbeat before it claims a part.
        worker_by_part = self._engine.claimed_parts()
        active_workers = self._heartbeats.beat(self._executor)
        self._offer_idle_parts(worker_by_part)
        # Only the first active worker recovers jobs, because one is enough.
        if not active_workers or active_workers[0] != self._executor:
            return
        # Claims of workers without any heartbeat are recovered, too: these workers ended or were lost before.
        workers_to_keep = {*active_workers, *self._find_silent_workers_to_keep()}
        failures = list[Exception]()
        tasks: list[Callable[[], object]] = [
            lambda: self._engine.recover(set(worker_by_part.values()) - workers_to_keep),
            self._fail_given_up_jobs,
            lambda: self._engine.remove_ended_parts(self._store.find_unfinished_jobs),
            self._store.steps.remove_left,
            self._heartbeats.remove_old,
            lambda: purge(self._store, self._now() - KEEP_DELETED),
            lambda: self._trends.renew_outdated_summaries(_MAX_RENEWED),
            lambda: self._store.old_documents.rewrite(_REWRITE_SECONDS),
        ]
        for task in tasks:
            try:
                task()
            except Exception as failure:  # noqa: BLE001 - the other tasks must be done nevertheless
                failures.append(failure)
        if failures:
            raise failures[0]

    def _find_silent_workers_to_keep(self) -> set[str]:
        """Return the silent workers that are not lost yet, and note which workers are silent at this check.

        After an outage of the database all other workers are silent at the first check.
        """
        silent_before, silent_now = self._silent_before, self._heartbeats.silent(SILENT)
        self._silent_before = silent_now
        lost = dict(silent_now.items() & silent_before.items())
        return silent_now.keys() - lost.keys()

    def hand_over(self) -> None:
        """Offer the parts claimed by this worker to other workers, and remove its heartbeat."""
        self._engine.stop()
        self._heartbeats.forget(self._executor)

    def _is_stalled(self) -> bool:
        """Return whether the running part has used no processor time since the last check.

        Raises:
            FrozenError: the part used no processor time at `_MAX_STALLED_CHECKS` checks in succession.
        """
        seconds_at_last_check, self._seconds_by_part = (
            self._seconds_by_part,
            self._engine.seconds_of_running_parts(),
        )
        # A part with the same processor time at two checks has computed nothing between them.
        is_stalled = bool(seconds_at_last_check.items() & self._seconds_by_part.items())
        self._stalled_checks = self._stalled_checks + 1 if is_stalled else 0
        if self._stalled_checks >= _MAX_STALLED_CHECKS:
            raise FrozenError(f"no progress with the part {', '.join(self._seconds_by_part)}")
        return is_stalled

    def _offer_idle_parts(self, worker_by_part: Mapping[str, str]) -> None:
        """Offer to all workers the claimed parts of this worker that did not run at two successive checks.

        Args:
            worker_by_part: part's id → name of the worker that claimed the part.
        """
        own_parts = {part for part, worker in worker_by_part.items() if worker == self._executor}
        idle_parts = own_parts - self._engine.seconds_of_running_parts().keys()
        self._engine.put_back(idle_parts & self._idle_before)
        self._idle_before = idle_parts

    def _fail_given_up_jobs(self) -> None:
        """Mark unfinished jobs as failed if a part was given up, or is missing in the queue."""
        kind_by_open_job = self._store.open_jobs(_KNOWN_KINDS)
        reason_by_job = dict.fromkeys(
            self._engine.find_unknown_jobs(kind_by_open_job), "job {} has no part in the queue any more"
        )
        for job_id, workers_died in self._engine.find_given_up_jobs().items():
            reason_by_job[job_id] = (
                f"{ATTEMPTS} workers died over one step of job {{}}"
                if workers_died
                else "a part of job {} cannot be carried out"
            )
        for job_id in reason_by_job.keys() & kind_by_open_job.keys():
            self._jobs(job_id).fail(job_id, WorkerLostError(reason_by_job[job_id].format(job_id)))


def purge(store: Store, before: datetime) -> None:
    """Remove for good the records that were deleted before a time, at most `_MAX_REMOVED` of each kind."""
    for kind in (*KINDS, *RETIRED):
        store.jobs(kind.resource).purge(before, _MAX_REMOVED)
    store.sets.purge(before, _MAX_REMOVED)  # sets are removed before the robots to which they refer
    store.open_sets.purge(before, _MAX_REMOVED)
    store.robots.purge(before, _MAX_REMOVED)


def carry_out(store: Store, jobs: Callable[[str], Jobs], part: Part, queue: Queue) -> None:
    """Carry out a part of a job; if the part fails, the job fails.

    A part of a kind that this version of the program does not know is offered again later.

    Args:
        store: store of the job.
        jobs: function that returns the jobs of one kind, by the id of a job of this kind.
        part: part to carry out.
        queue: queue to which the parts that follow are added.

    Raises:
        StoreUnavailableError: the database does not answer; carry out the part again later.
    """
    kind = store.kind_of_job(part.job_id)
    if kind is None:  # the job was removed
        return
    if kind not in _KNOWN_KINDS:
        queue.offer_again([part], LATER_SECONDS)
        return
    jobs_of_kind = jobs(part.job_id)
    try:
        jobs_of_kind.carry_out(part, queue)
    except (StoreUnavailableError, MemoryError):
        raise
    except Exception as failure:  # noqa: BLE001 - the boundary of a job
        jobs_of_kind.fail(part.job_id, failure)


_BEAT_SECONDS: Final = 5.0  # between two signs of life of a worker
# Time to offer parts to other workers, which take the parts of a silent worker after 30 s anyway
_GOODBYE_SECONDS: Final = 8.0

_FAULT_EXIT_CODE: Final = 70  # exit status of a worker that cannot go on
_SPARE_BYTES: Final = 64 * 1024 * 1024  # memory that must be free for a worker; some steps need more
_LOOK_SECONDS: Final = 1.0  # between two checks of memory and of the parent process
_MISSING_REMEDY: Final = (
    "the service makes the file: start `jointstiff serve`, and give --database the URL that the service has, "
    "with an absolute path: sqlite:////path/to/file.db"
)
DATABASE_SECONDS: Final = 60.0
"""Time for which a worker waits for a database that comes up [s]."""
DATABASE_PAUSE: Final = 1.0
"""Time between two attempts to open the database [s]."""
_BEGIN_SECONDS: Final = 60.0  # time for the worker's threads to begin
# Longest check of the recovery thread [s]; a locked database takes half of this time.
_LONGEST_CHECK_SECONDS: Final = 60.0

_logger = logging.getLogger(__name__)


def run_worker(
    database: str,
    executor: str,
    parent_pipe: int | None = None,
    sign_pipe: int | None = None,
    upgrade: Callable[[str], object] | None = None,
) -> None:
    """Carry out parts of jobs until a signal stops this worker; then hand over its parts and end the process.

    Args:
        database: URL of the store.
        executor: name of this process, which no other process has or had.
        parent_pipe: file descriptor of a pipe from the parent process; when the parent process ends, this
            process ends, too. None without a parent process.
        sign_pipe: file descriptor to which a byte is written each second while the recovery thread works;
            None to write no signs of life.
        upgrade: function that is called with a sentence for each step, if the tables are upgraded; None to
            refuse tables that must be upgraded.

    Raises:
        StoreError: the database cannot be used.
    """
    threading.excepthook = _end_process
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    refuse_in_memory(database)
    database = name_connections(database, executor)
    store = _open_patiently(database, upgrade, stop)
    parts = Parts(store)
    gc.freeze()  # libraries stay to the end: the garbage collector need not search them
    try:
        # If a thread fails to begin for lack of memory, `Thread.start()` never returns.
        faulthandler.dump_traceback_later(_BEGIN_SECONDS, exit=True)
        store.heartbeats.beat(executor)  # before it claims any work
        retries = Retries()
        engine = Engine(
            store,
            database,
            executor,
            lambda part: retries.retry(
                lambda: carry_out(store, parts.jobs_of, part, engine), lambda: engine.hand_back(part)
            ),
        )
        recovery = Recovery(store, parts.jobs_of, engine, executor, retries=retries)
        recovery_thread = threading.Thread(target=_run_recovery, args=(recovery, stop), daemon=True)
        recovery_thread.start()
        faulthandler.cancel_dump_traceback_later()
        console().print(f"worker {executor} ready", markup=False)
        while not stop.wait(_LOOK_SECONDS):
            if not _has_memory():
                _end_process()
            if sign_pipe is not None and recovery.seconds_since_check() < _LONGEST_CHECK_SECONDS:
                _show_sign_of_life(sign_pipe)
            if _parent_has_ended(parent_pipe):  # stop in order: the running part is offered to other workers
                stop.set()
    except (MemoryError, RuntimeError):
        _end_process()
    recovery_thread.join(_GOODBYE_SECONDS)  # not longer: the database may not answer
    # A running step would keep the process alive, though its part has been offered to others.
    sys.stdout.flush()
    os._exit(0)


def _open_patiently(database: str, upgrade: Callable[[str], object] | None, stop: threading.Event) -> Store:
    """Open a store; wait for a server that does not answer yet, and for an SQLite file that is not there yet.

    The process ends if `stop` is set meanwhile.

    Raises:
        StoreError: the database cannot be used, or its file does not exist after `DATABASE_SECONDS`.
        StoreUnavailableError: the server does not answer within `DATABASE_SECONDS`.
    """
    deadline = time.monotonic() + DATABASE_SECONDS
    has_warned = False
    while True:
        opened = _open_or_explain(database, upgrade)
        if isinstance(opened, Store):
            return opened
        if time.monotonic() > deadline:
            raise opened
        if not has_warned:
            words = f"{opened}; waiting up to {DATABASE_SECONDS:.0f} s"
            console(stderr=True).print(words, markup=False, soft_wrap=True)
        has_warned = True
        if stop.wait(DATABASE_PAUSE):
            sys.exit(0)


def _open_or_explain(database: str, upgrade: Callable[[str], object] | None) -> Store | StoreError:
    """Open a store; return the error instead if the store may be there a little later.

    Raises:
        StoreError: the database cannot be used.
    """
    try:
        refuse_missing(database, _MISSING_REMEDY)
    except StoreError as error:
        return error
    try:
        return Store.open(database, upgrade=upgrade)
    except StoreUnavailableError as error:
        if database.startswith("sqlite"):
            raise
        return error


def _run_recovery(recovery: Recovery, stop: threading.Event) -> None:
    """Run the recovery every `_BEAT_SECONDS` until `stop`; then offer this worker's parts to others."""
    while not stop.is_set():
        _act_despite_outage(recovery.check_and_recover)
        stop.wait(_BEAT_SECONDS)
    _act_despite_outage(recovery.hand_over)


def _act_despite_outage(act: Callable[[], None]) -> None:
    """Call a function; log an error such as an outage of the database; end a process that cannot go on."""
    try:
        act()
    except MemoryError:
        _end_process()
    except FrozenError:
        _logger.exception("this worker makes no progress; it ends, and another worker takes over its part")
        _end_process()
    except Exception:
        _logger.warning("cannot recover the jobs of lost workers; trying again", exc_info=True)


def _end_process(*_: object) -> None:
    """Print the stacks of all threads and end the process at once, as it can do no more work."""
    try:
        faulthandler.dump_traceback()
    finally:  # the dump may fail, too, if memory is missing
        os._exit(_FAULT_EXIT_CODE)


def _show_sign_of_life(sign_pipe: int) -> None:
    """Write a byte to a pipe to the parent process, to show that this process works."""
    with suppress(OSError):  # the parent process has ended, or does not read
        os.write(sign_pipe, b".")


def _has_memory() -> bool:
    """Return whether at least `_SPARE_BYTES` of memory can be allocated.

    Without memory no thread starts, and `Thread.start` never returns: the main thread has to check.
    """
    try:
        mmap.mmap(-1, _SPARE_BYTES).close()
    except (OSError, MemoryError):
        return False
    return True


def _parent_has_ended(parent_pipe: int | None) -> bool:
    """Return whether the parent process has ended; False without a pipe from the parent.

    The read end of the pipe reaches end of file when the parent process ends.
    """
    if parent_pipe is None:
        return False
    is_readable = bool(select.select([parent_pipe], [], [], 0.0)[0])
    return is_readable and not os.read(parent_pipe, 1024)
