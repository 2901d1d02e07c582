"""A worker process: carries out long jobs until it is told to stop."""

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
from collections.abc import Callable
from typing import Final

from jointstiff.service.jobs.parts import Parts
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console
from jointstiff.service.workers.engine import Engine
from jointstiff.service.workers.recovery import Recovery
from jointstiff.service.workers.webhooks import Sender

_BEAT_SECONDS: Final = 5.0
"""Between two signs of life of a worker."""
_EARLY_BEAT: Final = 1.0
"""The first looks come sooner, as there may be something to take over."""

_GOODBYE_SECONDS: Final = 8.0
"""For handing over; after 30 s of silence others take over by themselves."""

_FAULT: Final = 70
"""Exit status of a worker that cannot go on."""
_SPARE_BYTES: Final = 64 * 1024 * 1024
"""Memory that must be left to a worker; a step takes more at times."""
_LOOK_SECONDS: Final = 1.0
"""Between two looks at whether it can go on."""
_BEGIN_SECONDS: Final = 20.0
"""Time for its threads to begin."""

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
    parts = Parts.of(store)
    jobs = parts.jobs
    store.heartbeats.beat(executor)  # before it takes any work
    engine = Engine(store, jobs, database, executor)
    inputs = [store.deletions(kind) for kind in (store.sets.resource, store.robots.resource)]
    recovery = Recovery(
        store.heartbeats, jobs, engine, executor, inputs=inputs, lost=store.webhooks.worker_lost
    )
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
