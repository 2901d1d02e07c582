"""A worker process: carries out long jobs until it is stopped, and continues the jobs of dead workers."""

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
from jointstiff.service.problems import StoreUnavailableError, WorkerLostError
from jointstiff.service.runs.trend import Trends
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.database import refuse_in_memory
from jointstiff.service.store.jobs import SILENT, Heartbeats
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console
from jointstiff.service.workers.engine import ATTEMPTS, Engine, Queue

_KNOWN: Final = [kind.name for kind in KINDS]  # jobs of other kinds are left to other versions
_REMOVED: Final = 20  # deleted records of each kind that are removed at a look
_DERIVED: Final = 20  # last campaigns of robots that are derived at a look
_FIRST_PAUSE: Final = 0.1
_LONGEST_PAUSE: Final = 5.0
_STILL_LOOKS: Final = 4
"""Looks, one after the other, between which a part under way took no processor time: its thread is frozen."""


class FrozenError(Exception):
    """The thread that carries out a part neither computes nor ends."""


class Recovery:
    """Recovery by one worker. It runs at every heartbeat; it is idempotent, and other workers do the same."""

    def __init__(
        self,
        store: Store,
        jobs: Callable[[str], Jobs],
        engine: Engine,
        executor: str,
        *,
        heartbeats: Heartbeats | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Look after the jobs of a store.

        Args:
            store: with their inputs.
            jobs: those of the kind of a job, by its id.
            engine: of this worker.
            executor: name of this worker.
            heartbeats: of the workers; those of the store unless others are given.
            now: tells the time, aware, by which deleted jobs are removed.
        """
        self._store, self._jobs, self._engine, self._executor = store, jobs, engine, executor
        self._heartbeats = heartbeats or store.heartbeats
        self._now = now
        self._trends = Trends(store)
        self._silent: dict[str, datetime] = {}
        self._active: dict[str, float] = {}
        self._idle: set[str] = set()
        self._still = 0
        self._looked_at = time.monotonic()

    def seconds_since_look(self) -> float:
        """Return the time since the last look began [s]."""
        return time.monotonic() - self._looked_at

    def look(self) -> None:
        """Show a sign of life if the part under way makes progress, and mend what is found.

        Raises:
            FrozenError: the part under way has made no progress for `_STILL_LOOKS` looks.
            StoreUnavailableError: the database does not answer; look again later.
        """
        self._looked_at = time.monotonic()
        if self._stands_still():
            return
        pending = self._engine.pending()  # whoever claimed one of these has shown a sign of life
        living = self._heartbeats.beat(self._executor)
        self._take_up_idle(pending)
        if not living or living[0] != self._executor:  # one of the living is enough
            return
        # After an outage all others are silent at the first look: lost are who still is at the second.
        before, self._silent = self._silent, self._heartbeats.silent(SILENT)
        lost = dict(self._silent.items() & before.items())
        alive = {*living, *(self._silent.keys() - lost.keys())}
        failures = list[Exception]()
        duties: list[Callable[[], object]] = [
            lambda: self._engine.recover(set(pending.values()) - alive),
            self._fail_given_up,
            lambda: self._engine.forget(self._store.going_on),
            lambda: purge(self._store, self._now() - KEEP_DELETED),
            lambda: self._trends.derive_due(_DERIVED),
        ]
        for duty in duties:
            try:
                duty()
            except Exception as failure:  # noqa: BLE001 - none keeps from the others
                failures.append(failure)
        if failures:
            raise failures[0]

    def hand_over(self) -> None:
        """Offer what this worker has begun to the others, as it is about to end."""
        self._engine.stop()
        self._heartbeats.forget(self._executor)

    def _stands_still(self) -> bool:
        """Return whether a part under way took no processor time since the last look."""
        before, self._active = self._active, self._engine.active()
        is_still = bool(before.items() & self._active.items())
        self._still = self._still + 1 if is_still else 0
        if self._still >= _STILL_LOOKS:
            raise FrozenError(f"no progress of {', '.join(self._active)}")
        return is_still

    def _take_up_idle(self, pending: Mapping[str, str]) -> None:
        """Offer anew what DBOS says is carried out here, and is not, at two looks."""
        mine = {part for part, executor in pending.items() if executor == self._executor}
        idle = mine - self._engine.active().keys()
        self._engine.hand_over(idle & self._idle)
        self._idle = idle

    def _fail_given_up(self) -> None:
        """End open jobs that no worker will end: too many died over a part, or no part is left."""
        going = self._store.open_jobs(_KNOWN)
        lost = dict.fromkeys(self._engine.unknown(going), "no part of job {} is left")
        for job_id, is_deadly in self._engine.given_up().items():
            died = f"{ATTEMPTS} workers died over one step of job {{}}"
            lost[job_id] = died if is_deadly else "a part of job {} cannot be carried out"
        for job_id in lost.keys() & going.keys():
            self._jobs(job_id).fail(job_id, WorkerLostError(lost[job_id].format(job_id)))


def purge(store: Store, before: datetime) -> None:
    """Remove for good what was deleted before a time, some of each kind at a call."""
    for kind in KINDS:
        store.jobs(kind.resource).purge(before, _REMOVED)
    store.sets.purge(before, _REMOVED)  # before the robots, which they refer to
    store.open_sets.purge(before, _REMOVED)
    store.robots.purge(before, _REMOVED)


def carry_out(store: Store, jobs: Callable[[str], Jobs], part: Part, queue: Queue) -> None:
    """Carry out a part of a job; a job fails where the part does.

    A job of another version's kind is left to that version.

    Args:
        store: with the job.
        jobs: those of the kind of a job, by its id.
        part: the part.
        queue: takes what follows.

    Raises:
        StoreUnavailableError: the database does not answer; carry out the part again then.
    """
    kind = store.kind_of_job(part.job_id)
    if kind is None:  # it was removed
        return
    if kind not in _KNOWN:
        queue.offer_later(part)
        return
    mine = jobs(part.job_id)
    try:
        mine.carry_out(part, queue)
    except (StoreUnavailableError, MemoryError):
        raise
    except Exception as failure:  # noqa: BLE001 - the boundary of a job
        mine.fail(part.job_id, failure)


def patiently(act: Callable[[], object]) -> None:
    """Wait for a database that does not answer: an outage is no result of a part.

    A process without memory ends, as the system would end it: others go on, and count its death.
    """
    pause = _FIRST_PAUSE
    while True:
        try:
            act()
        except MemoryError:  # no result of a step: where there is more memory, it is carried out
            os.kill(os.getpid(), signal.SIGKILL)
        except StoreUnavailableError:
            time.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)
        else:
            return


_BEAT_SECONDS: Final = 5.0  # between two signs of life of a worker
_GOODBYE_SECONDS: Final = 8.0  # for handing over; after 30 s of silence others take over by themselves

_FAULT: Final = 70  # exit status of a worker that cannot go on
_SPARE_BYTES: Final = 64 * 1024 * 1024  # memory that must be left to a worker; a step takes more at times
_LOOK_SECONDS: Final = 1.0  # between two looks at whether it can go on
_BEGIN_SECONDS: Final = 60.0  # time for its threads to begin
_KEEPER_SECONDS: Final = 60.0  # for a look of the keeper; with a locked database it takes half of that

_logger = logging.getLogger(__name__)


def run_worker(database: str, executor: str, parent: int | None = None, signs: int | None = None) -> None:
    """Work until stopped; unfinished work is left to other workers, and the process ends.

    Args:
        database: URL of the store.
        executor: name of this process, which no other process has or had.
        parent: descriptor of a pipe that ends when the process that started this one does; then this one
            ends too.
        signs: descriptor that gets a byte each second while this process looks after its jobs.

    Raises:
        StoreError: the database cannot be used.
    """
    threading.excepthook = _end_process
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    refuse_in_memory(database)
    store = Store.open(database)
    parts = Parts(store)
    gc.freeze()  # libraries stay to the end; looking through them took a third of a large job's end
    try:
        # If a thread fails to begin for lack of memory, `Thread.start()` never returns.
        faulthandler.dump_traceback_later(_BEGIN_SECONDS, exit=True)
        store.heartbeats.beat(executor)  # before it claims any work
        engine = Engine(
            store,
            database,
            executor,
            lambda part: patiently(lambda: carry_out(store, parts.jobs_of, part, engine)),
        )
        recovery = Recovery(store, parts.jobs_of, engine, executor)
        keeper = threading.Thread(target=_look_after, args=(recovery, stop), daemon=True)
        keeper.start()
        faulthandler.cancel_dump_traceback_later()
        console().print(f"worker {executor} ready", markup=False)
        while not stop.wait(_LOOK_SECONDS):
            if not _has_memory():
                _end_process()
            if signs is not None and recovery.seconds_since_look() < _KEEPER_SECONDS:
                _show_sign(signs)
            if _parent_has_ended(parent):  # nobody died over what is under way: it is handed over
                stop.set()
    except (MemoryError, RuntimeError):
        _end_process()
    keeper.join(_GOODBYE_SECONDS)  # with a database that does not answer it could take any time
    # A step under way would keep the process alive to its end; it belongs to someone else by now.
    sys.stdout.flush()
    os._exit(0)


def _look_after(recovery: Recovery, stop: threading.Event) -> None:
    """Look at every beat; at the end, hand over."""
    while not stop.is_set():
        _tolerate_absence(recovery.look)
        stop.wait(_BEAT_SECONDS)
    _tolerate_absence(recovery.hand_over)


def _tolerate_absence(act: Callable[[], None]) -> None:
    """A database that is away now will be back at the next beat."""
    try:
        act()
    except MemoryError:
        _end_process()
    except FrozenError:
        _logger.exception("this worker ends, and leaves its part to others")
        _end_process()
    except Exception:
        _logger.warning("could not look after jobs; trying again", exc_info=True)


def _end_process(*_: object) -> None:
    """End the process at once: without memory, or without one of its threads, it would only look alive."""
    try:
        faulthandler.dump_traceback()
    finally:  # it may fail, too, for want of memory
        os._exit(_FAULT)


def _show_sign(signs: int) -> None:
    """Write a byte to the process that started this one."""
    with suppress(OSError):  # it does not read, or has ended
        os.write(signs, b".")


def _has_memory() -> bool:
    """Return whether there is memory left to work with.

    Where there is none, no thread starts, and who starts one waits for ever: the main thread has to look.
    """
    try:
        mmap.mmap(-1, _SPARE_BYTES).close()
    except (OSError, MemoryError):
        return False
    return True


def _parent_has_ended(parent: int | None) -> bool:
    """Return whether the parent process has ended: then its pipe, a file descriptor, is at end of file."""
    return parent is not None and bool(select.select([parent], [], [], 0.0)[0]) and not os.read(parent, 1024)
