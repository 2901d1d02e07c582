"""Jointstiff identifies the joint stiffnesses of an industrial robot from laser-tracker readings.

    import jointstiff

    run = jointstiff.identify("campaign.json")               # in this process; a table in a notebook
    run.joints["joint_2"].stiffness                          # [N·m/rad]
    jointstiff.predict(run, "postures.csv")                  # plan, map, compensate, compare, geometry

    with jointstiff.Client("http://127.0.0.1:8000") as client:   # the same names against a service
        run = client.identify("campaign.json")

`help(jointstiff.identify)` lists the options of a verb. What is heavy is imported when it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointstiff.schemas.comparison import Comparison
    from jointstiff.schemas.deflection import Map
    from jointstiff.schemas.geometry import Geometry
    from jointstiff.schemas.plan import Plan
    from jointstiff.schemas.program import Program
    from jointstiff.service.library.campaigns import Campaign
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.errors import CampaignError, RefusedError
    from jointstiff.service.library.results import TabledRun
    from jointstiff.service.library.robots import robot
    from jointstiff.service.library.verbs import Verb, import_files, pair, predict

    identify: Verb[TabledRun]
    compare: Verb[Comparison]
    geometry: Verb[Geometry]
    plan: Verb[Plan]
    map: Verb[Map]  # noqa: A001 - the kind's name
    compensate: Verb[Program]

__all__ = [
    "Campaign",
    "CampaignError",
    "Client",
    "RefusedError",
    "TabledRun",
    "compare",
    "compensate",
    "geometry",
    "identify",
    "import_files",
    "map",
    "pair",
    "plan",
    "predict",
    "robot",
]

_HOMES = {
    "Campaign": "campaigns",
    "CampaignError": "errors",
    "Client": "client",
    "RefusedError": "errors",
    "TabledRun": "results",
    "import_files": "verbs",
    "pair": "verbs",
    "predict": "verbs",
    "robot": "robots",
}
"""Modules of the names that are no kinds of work."""


def __getattr__(name: str) -> object:
    """Import a name of this package when it is first used."""
    if name == "__version__":
        return import_module("jointstiff.service.versions").JOINTSTIFF_VERSION
    if name in _HOMES:
        return getattr(import_module(f"jointstiff.service.library.{_HOMES[name]}"), name)
    from jointstiff.service.kinds.rooms import ROOMS

    if any(room.command == name for room in ROOMS.values()):
        return import_module("jointstiff.service.library.verbs").function_of(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names of this package, imported or not."""
    return sorted([*__all__, "__version__"])
