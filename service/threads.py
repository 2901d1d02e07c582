"""One thread for linear algebra, memory given back, garbage collected rarely: every process of the command.

numpy and the C library read the environment when they are loaded.
"""

from __future__ import annotations

import ctypes
import gc
import os
from contextlib import suppress
from types import MappingProxyType
from typing import Final

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
    """Limit this process and those that it starts; call it before numpy is imported."""
    os.environ.update(ONE_THREAD)


def give_memory_back() -> None:
    """Let this process, whose C library has read its environment, give memory back as the others do."""
    with suppress(OSError, AttributeError, TypeError):  # another C library
        for setting in _SETTINGS.values():
            ctypes.CDLL(None).mallopt(*setting)
