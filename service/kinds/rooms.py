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
        "run": Room("identify", "Identify the joint stiffnesses of a campaign."),
        "comparison": Room("compare", "Compare methods on a campaign, or two campaigns of one robot."),
        "geometry": Room("geometry", "Identify the geometry of a robot from sweeps or poses."),
        "plan": Room("plan", "Plan which postures and loads to measure."),
        "map": Room("map", "Map deflection and compliance over a work area."),
        "fleet": Room("fleet", "Identify the campaigns of many robots in one job."),
        "program": Room("compensate", "Compensate a program for the deflection under load."),
    }
)
"""By the name of the kind: each is a module or package of this one, whose declaration has that name in
capitals."""


def kind_of(name: str) -> AnyKind:
    """Return the declaration of a kind; nothing of the others is imported."""
    kind: AnyKind = getattr(import_module(f"jointstiff.service.kinds.{name}"), name.upper())
    return kind
