"""Every process of the command: its memory, its one thread of linear algebra, its versions, and its log.

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
"""Settings of glibc, number and value: what takes more than 4 MiB goes back to the system once it is free."""
ONE_THREAD: Final = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    | {name: str(value) for name, (_, value) in _SETTINGS.items()}
)
"""Environment of a process. The matrices are small: more threads cost more than they bring, and with several
processes they fight for the processors."""


_NEW_OBJECTS: Final = 50_000
"""Between two collections of garbage: at Python's own 700 they take a fifth of a start."""


def collect_rarely() -> None:
    """Let this process collect garbage less often; call it before the libraries are imported."""
    gc.set_threshold(_NEW_OBJECTS)


def use_one_thread() -> None:
    """Limit linear algebra of this process and its children to one thread; call before numpy is imported."""
    os.environ.update(ONE_THREAD)


class _Limit:
    """The limit of linear algebra to one thread, for as long as any computation of this process goes on."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._limiter: Any = None  # restores the numbers of threads before the limit

    def enter(self) -> None:
        """Limit the libraries to one thread, unless another computation has done so."""
        with self._lock:
            if not self._inside:
                self._limiter = _blas_controller().limit(limits=1)
            self._inside += 1

    def leave(self) -> None:
        """Restore the number of threads, unless another computation goes on."""
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._limiter.restore_original_limits()


_LIMIT: Final = _Limit()


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
    """Let glibc return large freed blocks of memory to the system.

    For a running process, which has read the settings in `ONE_THREAD` too early or not at all.
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
"""Logger of one line a request; silent in logs for people."""

REQUEST_ID: Final[ContextVar[str | None]] = ContextVar("REQUEST_ID", default=None)
"""Identifier of the request that is being answered."""

_UNSEEN: Final = re.compile("[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that steer a terminal, end a line or turn a text's direction; JSON leaves them as they are."""

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
        return _UNSEEN.sub(lambda character: f"\\u{ord(character[0]):04x}", text)


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
