"""A worker process: carries out long jobs until it is told to stop."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable
from datetime import timedelta
from typing import Final

from jointstiff.service.jobs.parts import Parts
from jointstiff.service.store.heartbeats import SILENT_SECONDS
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console
from jointstiff.service.workers.engine import Engine
from jointstiff.service.workers.recovery import BEAT_SECONDS, Recovery

_EARLY_BEAT: Final = 1.0
"""The first looks come sooner, as there may be something to take over."""

_GOODBYE_SECONDS: Final = 8.0
"""For handing over; after 30 s of silence others take over by themselves."""

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
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    store = Store.open(database)
    jobs = Parts.of(store).jobs
    store.heartbeats.beat(executor, timedelta(seconds=SILENT_SECONDS))  # before it takes any work
    engine = Engine(store, jobs, database, executor)
    inputs = [store.deletions(kind) for kind in (store.sets.resource, store.robots.resource)]
    recovery = Recovery(store.heartbeats, jobs, engine, executor, inputs=inputs)
    recovery.count_own_deaths()
    with engine:
        keeper = threading.Thread(target=_look_after, args=(recovery, stop), daemon=True)
        gc.freeze()  # libraries stay to the end; looking through them took a third of a large job's end
        console().print(f"worker {executor} ready", markup=False)
        keeper.start()
        stop.wait()
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
        pause = BEAT_SECONDS
    _patiently(recovery.hand_over)


def _patiently(act: Callable[[], None]) -> None:
    """A database that is away now will be back at the next beat."""
    try:
        act()
    except Exception:
        _logger.warning("could not check the jobs; trying again", exc_info=True)


def _end_with(parent: int) -> None:
    while os.read(parent, 1024):
        pass
    os._exit(0)
