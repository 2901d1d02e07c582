"""A worker process: carries out long jobs until it is told to stop, and goes on with what dead ones left."""

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
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Final

from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.problems import WorkerLostError
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.jobs import SILENT, Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console
from jointstiff.service.workers.engine import Engine, is_ended, job_of
from jointstiff.service.workers.webhooks import Sender

_KEPT: Final = timedelta(hours=1)  # what the steps of a job computed is kept for so long after its end
ATTEMPTS: Final = 5
"""Deaths of workers over one job, with no step done between them, after which it is given up."""
_REMOVED: Final = 20  # jobs whose steps are removed at a look; deleted jobs of each kind that are


class Recovery:
    """Recovery by one worker. It runs at every heartbeat; it is idempotent, and other workers do the same."""

    def __init__(
        self,
        store: Store,
        jobs: Mapping[str, Jobs],
        engine: Engine,
        executor: str,
        *,
        heartbeats: Heartbeats | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Look after the jobs of a store.

        Args:
            store: with their inputs, and webhooks to tell.
            jobs: by the name of their kind.
            engine: of this worker.
            executor: name of this worker.
            heartbeats: of the workers; those of the store unless others are given.
            now: tells the time, aware, by which deleted jobs are removed.
        """
        self._store, self._jobs, self._engine, self._executor = store, jobs, engine, executor
        self._heartbeats = heartbeats or store.heartbeats
        self._now = now
        self._inherited = dict(engine.inherited)
        self._idle: set[str] = set()
        self._lost: set[str] = set()
        self._silent: dict[str, datetime] = {}

    def look(self) -> None:
        """Show a sign of life, and mend what is found.

        Raises:
            StoreUnavailableError: the database does not answer; look again later.
        """
        living = self._heartbeats.beat(self._executor)
        pending = self._engine.queue.pending()
        duties: list[Callable[[], object]] = [self.count_own_deaths, lambda: self._take_up_idle(pending)]
        if living and living[0] == self._executor:  # one of the living is enough
            abandoned = {name for name, (_, executor) in pending.items() if executor not in living}
            duties += [
                lambda: self._count_deaths(abandoned, pending),
                lambda: self._resume(abandoned, pending),
                self._fail_lost,
                self._look_after_workers,
                self._tidy,
                self._purge,
            ]
        failures = list[Exception]()
        for duty in duties:
            try:
                duty()
            except Exception as failure:  # noqa: BLE001 - none keeps from the others
                failures.append(failure)
        if failures:
            raise failures[0]

    def count_own_deaths(self) -> None:
        """Count once what the process before, of the same name, died over: before this one may do so, too.

        Raises:
            StoreUnavailableError: the database does not answer.
        """
        inherited, self._inherited = self._inherited, {}
        self._count_deaths(set(inherited), inherited)

    def hand_over(self) -> None:
        """Leave what this worker has begun to the others, as it is about to end."""
        pending = self._engine.queue.pending()
        self._resume({name for name, (_, executor) in pending.items() if executor == self._executor}, pending)
        self._heartbeats.forget(self._executor)

    def _take_up_idle(self, pending: dict[str, tuple[str, str]]) -> None:
        """Resume jobs that this process holds but does not run: their thread ended on a database error."""
        mine = {name for name, (_, executor) in pending.items() if executor == self._executor}
        idle = mine - set(self._engine.active)
        self._resume(idle & self._idle, pending)
        self._idle = idle

    def _count_deaths(self, abandoned: set[str], pending: dict[str, tuple[str, str]]) -> None:
        """Fail a job over which too many workers died, else it would take all others with it.

        A worker dies over the job that it shares out, whose part it computes or whose result it puts
        together, not over those that it waits for.
        """
        computed = {job_of(name) for name in abandoned if pending[name][0] == "part"}
        for jobs in self._jobs.values():
            for job_id in {job_of(name) for name in abandoned}:
                if not jobs.records.goes_on(job_id):
                    continue
                waits = self._engine.queue.has_parts(job_id) and not jobs.is_computed(job_id)
                if waits and job_id not in computed:
                    continue
                if jobs.records.died(job_id) >= ATTEMPTS:
                    jobs.fail(
                        job_id, WorkerLostError(f"{ATTEMPTS} workers died over one step of job {job_id}")
                    )

    def _resume(self, names: set[str], pending: dict[str, tuple[str, str]]) -> None:
        self._engine.queue.resume((name, pending[name][0]) for name in names)

    def _look_after_workers(self) -> None:
        """Tell of workers that were silent at two looks in a row: after an outage all are, at the first."""
        before, self._silent = self._silent, self._heartbeats.silent(SILENT)
        for worker, at in self._silent.items() & before.items():
            self._store.webhooks.worker_lost(worker, at)

    def _fail_lost(self) -> None:
        """End open jobs whose workflow has ended without ending them, or is gone, two looks in a row."""
        all_lost = set[str]()
        for jobs in self._jobs.values():
            open_jobs = jobs.records.open_jobs()
            statuses = dict.fromkeys(open_jobs, "unknown") | self._engine.queue.statuses(open_jobs)
            lost = {job for job, status in statuses.items() if status == "unknown" or is_ended(status)}
            for job_id in lost & self._lost:
                reason = f"the job engine does not carry on job {job_id}: {statuses[job_id]}"
                jobs.fail(job_id, WorkerLostError(reason))
            all_lost |= lost
        self._lost = all_lost

    def _tidy(self) -> None:
        """Remove the steps of jobs that ended a while ago: only the result is asked for from then on."""
        ended = self._engine.queue.forget_ended(_KEPT, _REMOVED)
        if ended:
            for jobs in self._jobs.values():
                jobs.records.forget_steps(ended)

    def _purge(self) -> None:
        """Remove for good what was deleted long ago."""
        before = self._now() - KEEP_DELETED
        for jobs in self._jobs.values():
            jobs.records.purge(before, _REMOVED)
        self._store.sets.purge(before, _REMOVED)  # before the robots, which they refer to
        self._store.open_sets.purge(before, _REMOVED)
        self._store.robots.purge(before, _REMOVED)


_BEAT_SECONDS: Final = 5.0  # between two signs of life of a worker
_EARLY_BEAT: Final = 1.0  # the first looks come sooner, as there may be something to take over

_GOODBYE_SECONDS: Final = 8.0  # for handing over; after 30 s of silence others take over by themselves

_FAULT: Final = 70  # exit status of a worker that cannot go on
_SPARE_BYTES: Final = 64 * 1024 * 1024  # memory that must be left to a worker; a step takes more at times
_LOOK_SECONDS: Final = 1.0  # between two looks at whether it can go on
_BEGIN_SECONDS: Final = 20.0  # time for its threads to begin

_logger = logging.getLogger(__name__)


def run_worker(database: str, executor: str, parent: int | None = None) -> None:
    """Work until told to stop; what is under way then is left to others, and the process ends.

    Args:
        database: URL of the store.
        executor: name of this worker, unlike that of any other that lives.
        parent: descriptor of a pipe that ends when the process that started this one does; then this one
            ends too.

    Raises:
        StoreError: the database cannot be used.
    """
    threading.excepthook = _end
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    store = Store.open(database)
    parts = Parts(store)
    jobs = parts.jobs
    store.heartbeats.beat(executor)  # before it takes any work
    engine = Engine(store, jobs, database, executor)
    recovery = Recovery(store, jobs, engine, executor)
    sender = Sender(store, parts.trends)
    recovery.count_own_deaths()
    with engine:
        keeper = threading.Thread(target=_look_after, args=(recovery, stop), daemon=True)
        gc.freeze()  # libraries stay to the end; looking through them took a third of a large job's end
        try:
            # A thread that ends for want of memory before it has begun leaves who starts it waiting for ever.
            faulthandler.dump_traceback_later(_BEGIN_SECONDS, exit=True)
            keeper.start()
            threading.Thread(target=_send, args=(sender, stop), daemon=True).start()
            faulthandler.cancel_dump_traceback_later()
            console().print(f"worker {executor} ready", markup=False)
            while not stop.wait(_LOOK_SECONDS):
                if not _is_fit(parent):
                    _end()
        except (MemoryError, RuntimeError):  # leaving the engine would wait for its threads for ever
            _end()
        keeper.join(_GOODBYE_SECONDS)  # with a database that does not answer it could take any time
        # A step under way would keep the process alive to its end; it belongs to someone else by now.
        sys.stdout.flush()
        os._exit(0)


def _look_after(recovery: Recovery, stop: threading.Event) -> None:
    """Look at every beat; at the end, hand over."""
    pause = _EARLY_BEAT
    while not stop.is_set():
        _patiently(recovery.look)
        stop.wait(pause)
        pause = _BEAT_SECONDS
    _patiently(recovery.hand_over)


def _send(sender: Sender, stop: threading.Event) -> None:
    """Tell webhooks what happened, beside the work."""
    while not stop.wait(_EARLY_BEAT):
        _patiently(sender.look)


def _patiently(act: Callable[[], None]) -> None:
    """A database that is away now will be back at the next beat."""
    try:
        act()
    except MemoryError:
        _end()
    except Exception:
        _logger.warning("could not look after jobs and webhooks; trying again", exc_info=True)


def _end(*_: object) -> None:
    """End the process at once: without memory, or without one of its threads, it would only look alive."""
    try:
        faulthandler.dump_traceback()
    finally:  # it may fail, too, for want of memory
        os._exit(_FAULT)


def _is_fit(parent: int | None) -> bool:
    """Return whether to go on: who started this process is there, and there is memory left to work with.

    Where there is none, no thread starts, and who starts one waits for ever: the main thread has to look.
    """
    try:
        mmap.mmap(-1, _SPARE_BYTES).close()
    except (OSError, MemoryError):
        return False
    return parent is None or not select.select([parent], [], [], 0.0)[0] or bool(os.read(parent, 1024))
