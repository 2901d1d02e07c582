"""The rooms of the kinds of work, found by their packages, in order; nothing else of them is imported."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from jointstiff.service import kinds
from jointstiff.service.kinds.room import Room

if TYPE_CHECKING:
    from jointstiff.service.kinds.kind import AnyKind


def _found() -> dict[str, Room]:
    names = [each.name for each in iter_modules(kinds.__path__) if each.ispkg]
    rooms: dict[str, Room] = {name: import_module(f"{kinds.__name__}.{name}").ROOM for name in names}
    return dict(sorted(rooms.items(), key=lambda item: item[1]))


ROOMS: Final[Mapping[str, Room]] = MappingProxyType(_found())
"""By the name of the kind: that of its package, whose module `kind` declares the kind in capitals."""


def kind_of(name: str) -> AnyKind:
    """Return the declaration of a kind; nothing of the others is imported."""
    kind: AnyKind = getattr(import_module(f"{kinds.__name__}.{name}.kind"), name.upper())
    return kind
