"""Doors that import a name of their package when it is first used.

    if TYPE_CHECKING:
        from jointstiff.solver.robot import Robot
    else:
        __getattr__ = names_of(__name__, robot="Robot")

Type checkers and import rules read the first branch, the interpreter the second.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module


def names_of(package: str, **modules: str) -> Callable[[str], object]:
    """Return the `__getattr__` of a package.

    Args:
        package: the package's name.
        modules: names that each module of the package offers, separated by blanks. No name may be a module's.
    """
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def import_name(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value: object = getattr(import_module(f"{package}.{homes[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return import_name
