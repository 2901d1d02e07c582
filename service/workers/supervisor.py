"""Worker processes of the service: started with it, replaced when they die, ended with it."""

from __future__ import annotations

import logging
import os
import secrets
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Final

from jointstiff.service.process import ONE_THREAD

DATABASE_VARIABLE: Final = "JOINTSTIFF_DATABASE"
"""Where a worker finds the URL of the store."""
_SHORT_LIFE_SECONDS: Final = 60.0  # reading its libraries alone takes ten on a busy machine
_PAUSE_SECONDS: Final = 2.0
_LONGEST_PAUSE_SECONDS: Final = 60.0
_FAILING: Final = 2
"""Short lives, one after the other, from which on a worker counts as one that cannot start."""
_END_SECONDS: Final = 10.0
_START_SECONDS: Final = 120.0
_SILENCE_SECONDS: Final = 45.0
"""A worker that showed no sign of life on its output for so long is ended and replaced."""

_logger = logging.getLogger(__name__)


def pause_after(short_lives: int) -> float:
    """Return how long to wait before a worker is started again, doubled with each short life [s].

    A worker that cannot start, for want of memory or of its database, must not keep a processor busy.
    """
    return min(_PAUSE_SECONDS * 2.0 ** min(short_lives - 1, 10), _LONGEST_PAUSE_SECONDS)


def process_name(name: str) -> str:
    """Return a name for a new process of a worker, which no other process has or had.

    Two machines may have one host name: what a process of an equal name has begun is not a new one's.
    """
    return f"{name}-{secrets.token_hex(4)}"


class Supervisor:
    """N worker processes. Each holds a pipe from this process and ends when this process does, however."""

    def __init__(
        self,
        database: str,
        workers: int,
        prefix: str,
        forget: Callable[[str], object] = lambda _: None,
        start: float = _START_SECONDS,
        silence: float = _SILENCE_SECONDS,
    ) -> None:
        """Start the workers.

        Args:
            database: URL of the store.
            workers: how many; none is allowed.
            prefix: of the names of these workers.
            forget: called with the name of a worker process that has ended.
            start: time that a worker has for its start [s].
            silence: time between two signs of life after which a worker is ended [s].
        """
        self._forget = forget
        self._start, self._silence = start, silence
        self._short_lives: dict[str, int] = {}
        self._alive_since: dict[str, float] = {}
        self._stopping = threading.Event()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._watchers = [
            threading.Thread(target=self._keep_worker, args=(database, f"{prefix}-{number}"), daemon=True)
            for number in range(1, workers + 1)
        ]
        for watcher in self._watchers:
            watcher.start()

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        for process in list(self._processes.values()):
            process.terminate()
        deadline = time.monotonic() + _END_SECONDS
        for watcher in self._watchers:
            watcher.join(max(0.0, deadline - time.monotonic()))
        for process in list(self._processes.values()):  # one without memory may not hear
            process.kill()

    @property
    def failing(self) -> int:
        """Return the number of workers that end soon after each start."""
        now, alive_since = time.monotonic(), dict(self._alive_since)
        return sum(
            lives >= _FAILING and now - alive_since.get(name, now) < _SHORT_LIFE_SECONDS
            for name, lives in list(self._short_lives.items())
        )

    def _keep_worker(self, database: str, name: str) -> None:
        """Keep a worker of this name running."""
        while not self._stopping.is_set():
            began = self._alive_since[name] = time.monotonic()
            try:
                self._run_worker(database, name)
            except Exception:  # such as no memory, no thread: whatever it is, the worker is needed
                _logger.warning("cannot start worker %s; trying again", name, exc_info=True)
            self._alive_since.pop(name)
            if time.monotonic() - began >= _SHORT_LIFE_SECONDS:
                self._short_lives.pop(name, 0)
            else:
                self._short_lives[name] = self._short_lives.get(name, 0) + 1
                self._stopping.wait(pause_after(self._short_lives[name]))

    def _run_worker(self, database: str, name: str) -> None:
        """Start a worker, and wait for its end."""
        executor = process_name(name)
        with subprocess.Popen(
            [sys.executable, "-m", "jointstiff.service.workers", executor],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # The URL is there, as the arguments of a process are for all to see.
            env=os.environ | ONE_THREAD | {DATABASE_VARIABLE: database},
            process_group=0,  # Ctrl-C at the service's terminal is the service's to hear
        ) as process:
            self._processes[name] = process
            if self._stopping.is_set():  # it was started while all others were being ended
                process.terminate()
            status = self._end_of(process, executor)
        if not self._stopping.is_set():
            how = f"signal {-status}" if status < 0 else f"status {status}"
            _logger.warning("worker %s ended with %s; starting another one", executor, how)
            self._forget(executor)

    def _end_of(self, process: subprocess.Popen[bytes], executor: str) -> int:
        """Wait for the end of a worker; end one that shows no sign of life: it is stopped, or without memory.

        The signs do not pass through the database, which a worker that is stopped may have locked.
        """
        signs, pause = process.stdout, self._start
        while signs is not None and select.select([signs], [], [], pause)[0]:
            if not os.read(signs.fileno(), 4096):  # the end of its output is that of the process
                return process.wait()
            pause = self._silence
        _logger.warning("worker %s is silent; ending it", executor)
        process.kill()
        return process.wait()
