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
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Final

from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import StoreUnavailableError, WorkerLostError
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.database import refuse_in_memory
from jointstiff.service.store.jobs import SILENT, Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console

ATTEMPTS: Final = 5
"""Deaths of workers over one step of a job, after which it is given up."""
_KNOWN: Final = [kind.name for kind in KINDS]  # jobs of other kinds are left to other versions
_REMOVED: Final = 20  # deleted records of each kind that are removed at a look
_POLL_SECONDS: Final = 0.2  # between two looks for a step
_FIRST_PAUSE: Final = 0.1
_LONGEST_PAUSE: Final = 5.0


class Recovery:
    """Recovery by one worker. It runs at every heartbeat; it is idempotent, and other workers do the same."""

    def __init__(
        self,
        store: Store,
        jobs: Callable[[str], Jobs],
        executor: str,
        *,
        heartbeats: Heartbeats | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Look after the jobs of a store.

        Args:
            store: with their inputs.
            jobs: those of the kind of a job, by its id.
            executor: name of this worker.
            heartbeats: of the workers; those of the store unless others are given.
            now: tells the time, aware, by which deleted jobs are removed.
        """
        self._store, self._jobs, self._executor = store, jobs, executor
        self._heartbeats = heartbeats or store.heartbeats
        self._now = now
        self._silent: dict[str, datetime] = {}

    def look(self) -> None:
        """Show a sign of life, and mend what is found.

        Raises:
            StoreUnavailableError: the database does not answer; look again later.
        """
        living = self._heartbeats.beat(self._executor)
        if not living or living[0] != self._executor:  # one of the living is enough
            return
        # After an outage all others are silent at the first look: lost are who still is at the second.
        before, self._silent = self._silent, self._heartbeats.silent(SILENT)
        lost = dict(self._silent.items() & before.items())
        alive = [*living, *(self._silent.keys() - lost.keys())]
        failures = list[Exception]()
        duties: list[Callable[[], object]] = [
            lambda: self._give_up(self._store.steps.count_deaths(alive)),
            self._fail_forgotten,
            self._purge,
        ]
        for duty in duties:
            try:
                duty()
            except Exception as failure:  # noqa: BLE001 - none keeps from the others
                failures.append(failure)
        if failures:
            raise failures[0]

    def count_own_death(self) -> None:
        """Count what the process before, of the same name, died over: before this one may do so, too.

        Whether it died over its step or with the whole machine cannot be told; five times over the same step
        tells.

        Raises:
            StoreUnavailableError: the database does not answer.
        """
        self._give_up(self._store.steps.count_death(self._executor))

    def hand_over(self) -> None:
        """Leave what this worker has begun to the others, as it is about to end."""
        self._store.steps.leave(self._executor)
        self._heartbeats.forget(self._executor)

    def _give_up(self, deaths: Mapping[str, int]) -> None:
        """Fail a job over a step of which too many workers died, else it would take all others with it."""
        for job_id, count in deaths.items():
            if count >= ATTEMPTS and self._store.kind_of_job(job_id) in _KNOWN:
                reason = f"{ATTEMPTS} workers died over one step of job {job_id}"
                self._jobs(job_id).fail(job_id, WorkerLostError(reason))

    def _fail_forgotten(self) -> None:
        """End open jobs that have no step which would end them."""
        for job_id, kind in self._store.steps.forgotten().items():
            if kind in _KNOWN:
                self._jobs(job_id).fail(job_id, WorkerLostError(f"no step of job {job_id} is left"))

    def _purge(self) -> None:
        """Remove for good what was deleted long ago."""
        before = self._now() - KEEP_DELETED
        for kind in KINDS:
            self._store.jobs(kind.resource).purge(before, _REMOVED)
        self._store.sets.purge(before, _REMOVED)  # before the robots, which they refer to
        self._store.open_sets.purge(before, _REMOVED)
        self._store.robots.purge(before, _REMOVED)


def carry_out_steps(store: Store, jobs: Callable[[str], Jobs], executor: str, stop: threading.Event) -> None:
    """Carry out one step after the other until told to stop."""
    while not stop.is_set():
        if not _patiently(lambda: carry_out_next(store, jobs, executor)):
            stop.wait(_POLL_SECONDS)


def carry_out_next(store: Store, jobs: Callable[[str], Jobs], executor: str) -> bool:
    """Carry out the next step; return whether there was one. A job fails where it does.

    Raises:
        StoreUnavailableError: the database does not answer; the step is taken again then.
    """
    step = store.steps.take(executor, _KNOWN)
    if step is None:
        return False
    mine = jobs(step.job_id)
    try:
        mine.carry_out(step)
    except (StoreUnavailableError, MemoryError):
        raise
    except Exception as failure:  # noqa: BLE001 - the boundary of a job
        mine.fail(step.job_id, failure)
    return True


def _patiently(act: Callable[[], bool]) -> bool:
    """Wait for a database that does not answer: an outage is no result of a step.

    A process without memory ends, as the system would end it: others go on, and count its death.
    """
    pause = _FIRST_PAUSE
    while True:
        try:
            return act()
        except MemoryError:  # no result of a step: where there is more memory, it is carried out
            os.kill(os.getpid(), signal.SIGKILL)
        except StoreUnavailableError:
            time.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)


_BEAT_SECONDS: Final = 5.0  # between two signs of life of a worker
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
    refuse_in_memory(database)
    store = Store.open(database)
    parts = Parts(store)
    recovery = Recovery(store, parts.jobs_of, executor)
    recovery.count_own_death()
    store.heartbeats.beat(executor)  # before it takes any work
    keeper = threading.Thread(target=_look_after, args=(recovery, stop), daemon=True)
    work = threading.Thread(target=carry_out_steps, args=(store, parts.jobs_of, executor, stop), daemon=True)
    gc.freeze()  # libraries stay to the end; looking through them took a third of a large job's end
    try:
        # A thread that ends for want of memory before it has begun leaves who starts it waiting for ever.
        faulthandler.dump_traceback_later(_BEGIN_SECONDS, exit=True)
        for thread in (keeper, work):
            thread.start()
        faulthandler.cancel_dump_traceback_later()
        console().print(f"worker {executor} ready", markup=False)
        while not stop.wait(_LOOK_SECONDS):
            if not _is_fit(parent):
                _end()
    except (MemoryError, RuntimeError):
        _end()
    keeper.join(_GOODBYE_SECONDS)  # with a database that does not answer it could take any time
    # A step under way would keep the process alive to its end; it belongs to someone else by now.
    sys.stdout.flush()
    os._exit(0)


def _look_after(recovery: Recovery, stop: threading.Event) -> None:
    """Look at every beat; at the end, hand over."""
    while not stop.is_set():
        _trying(recovery.look)
        stop.wait(_BEAT_SECONDS)
    _trying(recovery.hand_over)


def _trying(act: Callable[[], None]) -> None:
    """A database that is away now will be back at the next beat."""
    try:
        act()
    except MemoryError:
        _end()
    except Exception:
        _logger.warning("could not look after jobs; trying again", exc_info=True)


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
