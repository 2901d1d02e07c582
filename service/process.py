"""Settings of each process: memory, one thread for linear algebra, versions and log.

numpy and the C library read the environment variables when they are loaded. The log is text for people, or
JSON lines for programs; each line about a request has the identifier of the request.
"""

from __future__ import annotations

import ctypes
import gc
import json
import logging
import os
import platform
import re
import sys
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

_MALLOC_SETTINGS: Final = {
    "MALLOC_TRIM_THRESHOLD_": (-1, 4 * 1024 * 1024),
    "MALLOC_MMAP_THRESHOLD_": (-3, 4 * 1024 * 1024),
    "MALLOC_ARENA_MAX": (-8, 1),
}
"""Environment variable of glibc → (number of the option for `mallopt`, value).

With these values, freed blocks of more than 4 MiB go back to the system.
"""
ONE_THREAD: Final = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    | {name: str(value) for name, (_, value) in _MALLOC_SETTINGS.items()}
)
"""Environment variable → value, for each process.

The matrices are small: a second thread of linear algebra costs more time than it saves, and the threads of
several processes compete for the processors.
"""


_NEW_OBJECTS: Final = 50_000
"""Number of new objects after which garbage is collected: with Python's default of 700, collections take a
fifth of the time of a start."""


def collect_rarely() -> None:
    """Let this process collect garbage less often; call it before the libraries are imported."""
    gc.set_threshold(_NEW_OBJECTS)


def use_one_thread() -> None:
    """Limit linear algebra of this process and its children to one thread; call before numpy is imported."""
    os.environ.update(ONE_THREAD)


class _OneThreadLimit:
    """Limit of linear algebra to one thread while at least one computation of this process runs."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._computations = 0  # number of computations that run at present
        self._limiter: Any = None  # restores the earlier numbers of threads

    def enter(self) -> None:
        """Begin a computation; the first one limits the libraries to one thread."""
        with self._lock:
            if not self._computations:
                self._limiter = _find_blas_libraries().limit(limits=1)
            self._computations += 1

    def leave(self) -> None:
        """End a computation; the last one restores the earlier numbers of threads."""
        with self._lock:
            self._computations -= 1
            if not self._computations:
                self._limiter.restore_original_limits()


_LIMIT: Final = _OneThreadLimit()


@cache
def _find_blas_libraries() -> ThreadpoolController:
    """Return the controller of the threads of all BLAS libraries; cached, as the search takes time."""
    import scipy.linalg  # noqa: F401 - loads the BLAS library of scipy; numpy has another
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread of linear algebra, so that the last digits do not depend on the process.

    Commands and workers limit the threads before they import numpy; a program of the user does not, and has
    the earlier numbers of threads again after the block.
    """
    _LIMIT.enter()
    try:
        yield
    finally:
        _LIMIT.leave()


def give_memory_back() -> None:
    """Let glibc return large freed blocks of memory to the system, from now on.

    A running process needs this call, as glibc reads its environment variables only when a process starts.
    """
    with suppress(OSError, AttributeError, TypeError):  # the C library is not glibc
        for option, value in _MALLOC_SETTINGS.values():
            ctypes.CDLL(None).mallopt(option, value)


def trim_memory() -> None:
    """Let glibc return all free memory to the system now, also between blocks that are in use."""
    with suppress(OSError, AttributeError, TypeError):  # the C library is not glibc
        ctypes.CDLL(None).malloc_trim(0)


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
"""Name of a library for people → name of its package."""


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
"""Environment variable with the format of the logs of this process and of processes that it starts."""
ACCESS_LOGGER: Final = "jointstiff.access"
"""Name of the logger that writes one line for each request, in JSON logs only."""

REQUEST_ID: Final[ContextVar[str | None]] = ContextVar("REQUEST_ID", default=None)
"""Identifier of the request that is being answered."""

_CONTROL_CHARACTERS: Final = re.compile("[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that control a terminal, end a line or change a text's direction; `json.dumps` does not escape
them."""

_REQUEST_FIELDS: Final = ("method", "path", "status", "seconds")
"""Fields that the access logger adds to a log record."""


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
        line |= {name: getattr(record, name) for name in _REQUEST_FIELDS if hasattr(record, name)}
        if request_id := REQUEST_ID.get():
            line["request_id"] = request_id
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        text = json.dumps(line, ensure_ascii=False)
        return _CONTROL_CHARACTERS.sub(lambda character: f"\\u{ord(character[0]):04x}", text)


def build_own_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of this package in a process of its own.

    With `-m` alone, Python would first search the working folder: a file `numpy.py` among readings would run.
    """
    return [sys.executable, "-P", "-m", module, *arguments]


def set_log_format(log_format: LogFormat) -> None:
    """Set the format in which this process, and processes that it starts, log to standard error."""
    os.environ[FORMAT_VARIABLE] = log_format
    if log_format is LogFormat.TEXT:  # Python's default
        return
    handler = logging.StreamHandler()
    handler.setFormatter(JsonFormatter())
    logging.basicConfig(handlers=[handler], level=logging.WARNING, force=True)
    logging.captureWarnings(capture=True)
    logging.getLogger(ACCESS_LOGGER).setLevel(logging.INFO)
