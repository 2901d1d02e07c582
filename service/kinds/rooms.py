"""The rooms of the kinds of work, found by their packages; the packages' other modules are not imported."""

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


def _import_rooms() -> dict[str, Room]:
    """Return the `ROOM` of each package in this folder, by the package's name, in order of `Room.place`."""
    names = [each.name for each in iter_modules(kinds.__path__) if each.ispkg]
    rooms: dict[str, Room] = {name: import_module(f"{kinds.__name__}.{name}").ROOM for name in names}
    return dict(sorted(rooms.items(), key=lambda item: item[1]))


ROOMS: Final[Mapping[str, Room]] = MappingProxyType(_import_rooms())
"""Rooms by name of the kind, such as `run`: in package `run`, the module `kind` declares `RUN`."""


def import_kind(name: str) -> AnyKind:
    """Import a kind's module, but no other kind, and return its declaration, such as `RUN` for "run".

    A name that has no room is that of a retired kind.
    """
    if name not in ROOMS:
        retired: AnyKind = import_module(f"{kinds.__name__}.retired").RETIRED[name]
        return retired
    kind: AnyKind = getattr(import_module(f"{kinds.__name__}.{name}.kind"), name.upper())
    return kind
