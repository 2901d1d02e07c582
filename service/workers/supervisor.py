"""Worker processes of the service: started with it, replaced when they die, ended with it."""

from __future__ import annotations

import logging
import os
import secrets
import select
import subprocess
import threading
import time
from collections.abc import Callable
from typing import Final

from jointstiff.service.process import ONE_THREAD, build_own_command

DATABASE_VARIABLE: Final = "JOINTSTIFF_DATABASE"
"""Environment variable in which a worker finds the URL of the store."""
_SHORT_LIFE_SECONDS: Final = 60.0
"""A worker that ends within this time after its start ended early; loading the libraries may take 10 s."""
_PAUSE_SECONDS: Final = 2.0
_LONGEST_PAUSE_SECONDS: Final = 60.0
_MIN_SHORT_LIVES: Final = 2
"""Number of early ends in succession after which a worker is regarded as failing."""
_END_SECONDS: Final = 10.0
_START_SECONDS: Final = 120.0
_SILENCE_SECONDS: Final = 45.0
"""A worker without a sign of life on its output for this time is ended and replaced."""

_logger = logging.getLogger(__name__)


def pause_after(short_lives: int) -> float:
    """Return the pause [s] before a worker is started again after `short_lives` early ends in succession.

    The pause doubles each time, as a worker that cannot start must not keep a processor busy.
    """
    return min(_PAUSE_SECONDS * 2.0 ** min(short_lives - 1, 10), _LONGEST_PAUSE_SECONDS)


def process_name(name: str) -> str:
    """Return a unique name for a new process of a worker: the worker's name and random digits.

    Two machines may have the same host name, and a process must not take over the parts of another one.
    """
    return f"{name}-{secrets.token_hex(4)}"


class Supervisor:
    """Worker processes that are kept running.

    Each worker has a pipe from this process, so that it ends when this process ends.
    """

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
            workers: number of workers, which may be 0.
            prefix: beginning of the names of these workers.
            forget: function that is called with the name of a worker process that has ended.
            start: longest time until a worker's first sign of life [s].
            silence: time without a sign of life after which a worker is ended [s].
        """
        self._forget = forget
        self._start_seconds, self._silence_seconds = start, silence
        self._short_lives: dict[str, int] = {}
        self._alive_since: dict[str, float] = {}
        self._stopping = threading.Event()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._watchers = [
            threading.Thread(
                target=self._keep_worker_running, args=(database, f"{prefix}-{number}"), daemon=True
            )
            for number in range(1, workers + 1)
        ]
        for watcher in self._watchers:
            watcher.start()

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        """End all workers; kill those that have not ended after `_END_SECONDS`."""
        self._stopping.set()
        for process in list(self._processes.values()):
            process.terminate()
        deadline = time.monotonic() + _END_SECONDS
        for watcher in self._watchers:
            watcher.join(max(0.0, deadline - time.monotonic()))
        # A worker without memory may not have reacted to the first signal.
        for process in list(self._processes.values()):
            process.kill()

    @property
    def failing(self) -> int:
        """Number of workers that repeatedly end soon after their start."""
        now, alive_since = time.monotonic(), dict(self._alive_since)
        return sum(
            # A worker that now has run for long enough is no longer failing.
            short_lives >= _MIN_SHORT_LIVES and now - alive_since.get(name, now) < _SHORT_LIFE_SECONDS
            for name, short_lives in list(self._short_lives.items())
        )

    def _keep_worker_running(self, database: str, name: str) -> None:
        """Start a worker of this name again whenever it ends, until the supervisor stops."""
        while not self._stopping.is_set():
            started_at = self._alive_since[name] = time.monotonic()
            try:
                self._run_worker(database, name)
            except Exception:  # such as a lack of memory: the worker is needed nevertheless
                _logger.warning("cannot start worker %s; trying again", name, exc_info=True)
            self._alive_since.pop(name)
            if time.monotonic() - started_at >= _SHORT_LIFE_SECONDS:
                self._short_lives.pop(name, 0)
            else:
                self._short_lives[name] = self._short_lives.get(name, 0) + 1
                self._stopping.wait(pause_after(self._short_lives[name]))

    def _run_worker(self, database: str, name: str) -> None:
        """Start a worker process, wait for its end, and log an end that was not requested."""
        executor = process_name(name)
        with subprocess.Popen(
            build_own_command("jointstiff.service.workers", executor),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # Not as an argument, which all users can see: the URL may hold a password.
            env=os.environ | ONE_THREAD | {DATABASE_VARIABLE: database},
            process_group=0,  # Ctrl-C must reach only the service, which ends its workers
        ) as process:
            self._processes[name] = process
            if self._stopping.is_set():  # the process was started while `__exit__` ended the others
                process.terminate()
            status = self._wait_for_end(process, executor)
        if not self._stopping.is_set():
            exit_words = f"signal {-status}" if status < 0 else f"status {status}"
            _logger.warning("worker %s ended with %s; starting another one", executor, exit_words)
            self._forget(executor)

    def _wait_for_end(self, process: subprocess.Popen[bytes], executor: str) -> int:
        """Wait for the end of a worker, and kill it if it shows no sign of life; return its exit status.

        Signs of life come through a pipe, not the database, which a suspended worker may have locked.
        """
        sign_pipe, longest_wait = process.stdout, self._start_seconds
        while sign_pipe is not None and select.select([sign_pipe], [], [], longest_wait)[0]:
            if not os.read(sign_pipe.fileno(), 4096):  # the output ends with the process
                return process.wait()
            longest_wait = self._silence_seconds
        _logger.warning("worker %s is silent; ending it", executor)
        process.kill()
        return process.wait()
