"""Versions of this software and of what it computes with."""

from __future__ import annotations

import platform
from functools import lru_cache
from importlib.metadata import version
from types import MappingProxyType

JOINTSTIFF_VERSION = version("jointstiff")

_DISTRIBUTIONS = MappingProxyType(
    {
        "jointstiff": "jointstiff",
        "pinocchio": "pin",
        "cvxpy": "cvxpy-base",
        "clarabel": "clarabel",
        "numpy": "numpy",
        "scipy": "scipy",
    }
)


@lru_cache(maxsize=1)
def versions() -> MappingProxyType[str, str]:
    """Name to version, for the provenance of a run."""
    numbers = {name: version(distribution) for name, distribution in _DISTRIBUTIONS.items()}
    return MappingProxyType(numbers | {"python": platform.python_version()})
