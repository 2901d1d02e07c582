"""All kinds of work, in order: routes, listings, commands, clients, deletion and tests iterate over them."""

from __future__ import annotations

from importlib import import_module
from typing import Final

from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS


def kind_of(name: str) -> AnyKind:
    """Return the declaration of a kind; nothing of the others is imported."""
    kind: AnyKind = getattr(import_module(f"jointstiff.service.kinds.{name}"), name.upper())
    return kind


KINDS: Final[tuple[AnyKind, ...]] = tuple(map(kind_of, ROOMS))
