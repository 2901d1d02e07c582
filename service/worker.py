"""A worker process: carries out long runs, shows that it lives, and adopts what dead workers left."""

from __future__ import annotations

import os
import signal
import sys
import threading
from datetime import UTC, datetime, timedelta
from typing import Final

from service.api.parts import Parts
from service.engine import Engine
from service.store import Store
from service.store_errors import StoreUnavailableError
from service.supervisor import DATABASE_VARIABLE
from service.terminal import console

__all__ = ["run_worker"]

BEAT_SECONDS: Final = 5.0
SILENT_SECONDS: Final = 30.0
"""A worker not heard of for so long is taken for dead, and its work is shared out."""


def run_worker(database: str, executor: str, parent: int | None = None) -> None:
    """Work until told to stop.

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
    with Store.open(database) as store, Engine(store, Parts.of(store).runs, database, executor) as engine:
        console().print(f"worker {executor} ready", markup=False)
        while not stop.is_set():
            _watch(store, engine, executor)
            stop.wait(BEAT_SECONDS)


def _watch(store: Store, engine: Engine, executor: str) -> None:
    """Show a sign of life, and look for those who show none."""
    now = datetime.now(UTC)
    silence = now - timedelta(seconds=SILENT_SECONDS)
    try:
        store.run_log.beat(executor, now)
        for dead in store.run_log.silent(silence):
            if store.run_log.forget(dead, silence):
                engine.adopt(dead)
    except StoreUnavailableError:
        return  # the engine waits for the database as well; the next beat tries again


def _end_with(parent: int) -> None:
    while os.read(parent, 1024):
        pass
    os._exit(0)


if __name__ == "__main__":
    run_worker(os.environ[DATABASE_VARIABLE], sys.argv[1], sys.stdin.fileno())
