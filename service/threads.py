"""One thread for linear algebra in every process that the command starts.

numpy reads the environment when it is imported.
"""

from __future__ import annotations

import os
from types import MappingProxyType
from typing import Final

ONE_THREAD: Final = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)
"""Environment of a process. The matrices are small: more threads cost more than they bring, and with several
processes they fight for the processors."""


def use_one_thread() -> None:
    """Limit this process and those that it starts; call it before numpy is imported."""
    os.environ.update(ONE_THREAD)
