"""The rooms of the kinds of work, in order: the one list that names them. Nothing else is imported."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jointstiff.service.kinds.kind import AnyKind


@dataclass(frozen=True)
class Room:
    """A kind of work as the command line and `import jointstiff` name it."""

    command: str  # verb, such as `identify`
    summary: str  # one line for the list of commands


ROOMS: Final[Mapping[str, Room]] = MappingProxyType(
    {
        "run": Room("identify", "Identify the joint stiffnesses of a campaign, without a server."),
        "comparison": Room(
            "compare", "Compare the methods on a campaign, unconstrained and constrained, as the paper does."
        ),
        "pair": Room("pair", "Compare two campaigns: motors' and secondary encoders, before and after."),
        "geometry": Room(
            "geometry",
            "Find axes, base frame, wrist centre, targets and the identified robot.",
        ),
        "plan": Room("plan", "Plan which postures and loads to measure, with a certificate."),
        "map": Room("map", "Map a work area: deflection, compliance and intervals at each place."),
        "program": Room(
            "compensate", "Correct a program so that the loaded tool reaches the programmed points."
        ),
    }
)
"""By the name of the kind: each is a package of this one, whose declaration has that name in capitals."""


def kind_of(name: str) -> AnyKind:
    """Return the declaration of a kind; nothing of the others is imported."""
    kind: AnyKind = getattr(import_module(f"jointstiff.service.kinds.{name}"), name.upper())
    return kind
