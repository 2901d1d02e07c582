"""Jointstiff identifies the joint stiffnesses of an industrial robot from laser-tracker readings.

    import jointstiff

    run = jointstiff.identify("campaign.json")               # in this process; a table in a notebook
    run.result.joints[1].stiffness                           # [N·m/rad]

    with jointstiff.Client("http://127.0.0.1:8000") as client:   # against a service
        run = client.identify("campaign.json")

What is heavy is imported when it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.errors import CampaignError, RefusedError
    from jointstiff.service.library.tabled_run import TabledRun, identify

__all__ = ["CampaignError", "Client", "RefusedError", "TabledRun", "identify"]

_HOMES = {
    "CampaignError": "errors",
    "Client": "client",
    "RefusedError": "errors",
    "TabledRun": "tabled_run",
    "identify": "tabled_run",
}


def __getattr__(name: str) -> object:
    """Import a name of this package when it is first used."""
    if name == "__version__":
        return import_module("jointstiff.service.versions").JOINTSTIFF_VERSION
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"jointstiff.service.library.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """Return the names of this package, imported or not."""
    return sorted([*__all__, "__version__"])
