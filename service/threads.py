"""One thread for linear algebra, and memory that is given back, in every process that the command starts.

numpy and the C library read the environment when they are loaded.
"""

from __future__ import annotations

import os
from types import MappingProxyType
from typing import Final

ONE_THREAD: Final = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    | dict.fromkeys(("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_"), str(4 * 1024 * 1024))
    | {"MALLOC_ARENA_MAX": "1"}
)
"""Environment of a process. The matrices are small: more threads cost more than they bring, and with several
processes they fight for the processors. An array of more than 4 MiB goes back to the system once it is free.
"""


def use_one_thread() -> None:
    """Limit this process and those that it starts; call it before numpy is imported."""
    os.environ.update(ONE_THREAD)
