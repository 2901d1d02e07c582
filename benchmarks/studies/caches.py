"""A plugin of pytest that forgets before each test what the solver's functions remember.

Coverage then tells of each test the lines that it needs, not only of the first one in its process.
"""

from __future__ import annotations

import sys

__all__ = ["forget", "pytest_runtest_setup"]


def pytest_runtest_setup() -> None:
    """Clear the caches of all functions of the solver."""
    forget("jointstiff.solver")


def forget(package: str = "jointstiff") -> None:
    """Clear the caches of all functions of a package."""
    for name, module in tuple(sys.modules.items()):
        if name.startswith(package):
            for function in tuple(vars(module).values()):
                if hasattr(function, "cache_clear"):
                    function.cache_clear()
