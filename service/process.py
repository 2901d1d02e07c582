"""Settings of each process: memory, one thread for linear algebra, versions and log.

numpy and the C library read the environment when they are loaded. A log is for people, or JSON lines for
programs; each line of a request has its identifier.
"""

from __future__ import annotations

import ctypes
import gc
import json
import logging
import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from datetime import UTC, datetime
from enum import StrEnum
from functools import cache
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_SETTINGS: Final = {
    "MALLOC_TRIM_THRESHOLD_": (-1, 4 * 1024 * 1024),
    "MALLOC_MMAP_THRESHOLD_": (-3, 4 * 1024 * 1024),
    "MALLOC_ARENA_MAX": (-8, 1),
}
"""Environment variable of glibc → number of the option for `mallopt`, and value.

Freed blocks of more than 4 MiB go back to the system.
"""
ONE_THREAD: Final = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    | {name: str(value) for name, (_, value) in _SETTINGS.items()}
)
"""Environment variables of a process. The matrices are small: more threads of linear algebra cost more than
they gain, and with several processes they compete for the processors."""


_NEW_OBJECTS: Final = 50_000
"""New objects between two garbage collections: with Python's default of 700 they take a fifth of a start."""


def collect_rarely() -> None:
    """Let this process collect garbage less often; call it before the libraries are imported."""
    gc.set_threshold(_NEW_OBJECTS)


def use_one_thread() -> None:
    """Limit linear algebra of this process and its children to one thread; call before numpy is imported."""
    os.environ.update(ONE_THREAD)


class _OneThreadLimit:
    """Limit of linear algebra to one thread while any computation of this process runs."""

    def __init__(self) -> None:
        self._lock, self._running = Lock(), 0  # number of computations that run
        self._limiter: Any = None  # restores the earlier numbers of threads

    def enter(self) -> None:
        """Begin a computation; the first one limits the libraries to one thread."""
        with self._lock:
            if not self._running:
                self._limiter = _blas_controller().limit(limits=1)
            self._running += 1

    def leave(self) -> None:
        """End a computation; the last one restores the earlier numbers of threads."""
        with self._lock:
            self._running -= 1
            if not self._running:
                self._limiter.restore_original_limits()


_LIMIT: Final = _OneThreadLimit()


@cache
def _blas_controller() -> ThreadpoolController:
    """Return the controller of the threads of BLAS; cached, as it searches all loaded libraries when made."""
    import scipy.linalg  # noqa: F401 - loads the second library; numpy's is the first
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread of linear algebra, so that the last digits do not depend on the process.

    Commands and workers set their environment before they import numpy; a program of the user does not.
    The user's own computations have their threads back afterwards.
    """
    _LIMIT.enter()
    try:
        yield
    finally:
        _LIMIT.leave()


def give_memory_back() -> None:
    """Let glibc return large freed blocks of memory to the system, from now on.

    A running process needs this call, as glibc reads environment variables only when a process starts.
    """
    with suppress(OSError, AttributeError, TypeError):  # the C library is not glibc
        for setting in _SETTINGS.values():
            ctypes.CDLL(None).mallopt(*setting)


_DISTRIBUTIONS: Final = MappingProxyType(
    {
        "jointstiff": "jointstiff",
        "pinocchio": "pin",
        "cvxpy": "cvxpy-base",
        "clarabel": "clarabel",
        "numpy": "numpy",
        "scipy": "scipy",
    }
)


@cache
def versions() -> MappingProxyType[str, str]:
    """Return name → version of this software, its numerical libraries and Python, for provenance."""
    from importlib.metadata import version  # takes a while, and few commands need it

    numbers = {name: version(distribution) for name, distribution in _DISTRIBUTIONS.items()}
    return MappingProxyType(numbers | {"python": platform.python_version()})


def jointstiff_version() -> str:
    """Return the version of this software."""
    return versions()["jointstiff"]


FORMAT_VARIABLE: Final = "JOINTSTIFF_LOG_FORMAT"
"""Format of this process's log, and of those that it starts."""
ACCESS_LOGGER: Final = "jointstiff.access"
"""Logger that writes one line for each request, in JSON logs only."""

REQUEST_ID: Final[ContextVar[str | None]] = ContextVar("REQUEST_ID", default=None)
"""Identifier of the request that is being answered."""

_CONTROL_CHARACTERS: Final = re.compile("[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that control a terminal, end a line or change a text's direction; `json.dumps` does not escape
them."""

_EXTRAS: Final = ("method", "path", "status", "seconds")


class LogFormat(StrEnum):
    """Format of a log."""

    TEXT = "text"
    JSON = "json"


class JsonFormatter(logging.Formatter):
    """Format of a log with one JSON object a line: time, level, logger, message, and fields of a request."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a log record as one line of JSON."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        line |= {name: getattr(record, name) for name in _EXTRAS if hasattr(record, name)}
        if request_id := REQUEST_ID.get():
            line["request_id"] = request_id
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        text = json.dumps(line, ensure_ascii=False)
        return _CONTROL_CHARACTERS.sub(lambda character: f"\\u{ord(character[0]):04x}", text)


def set_log_format(log_format: LogFormat) -> None:
    """Set the format in which this process, and processes that it starts, log to standard error."""
    os.environ[FORMAT_VARIABLE] = log_format
    if log_format is LogFormat.TEXT:
        return
    handler = logging.StreamHandler()
    handler.setFormatter(JsonFormatter())
    logging.basicConfig(handlers=[handler], level=logging.WARNING, force=True)
    logging.captureWarnings(capture=True)
    logging.getLogger(ACCESS_LOGGER).setLevel(logging.INFO)
