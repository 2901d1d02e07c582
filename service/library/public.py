"""Jointstiff identifies the joint stiffnesses of an industrial robot from laser-tracker readings.

    import jointstiff

    run = jointstiff.identify("campaign.json")               # in this process; a table in a notebook
    run.joints["joint_2"].stiffness                          # [N·m/rad]
    runs = jointstiff.identify_many(files, executor=pool)    # by processes or a cluster
    jointstiff.identify(jointstiff.datasets.load("pull"))    # a campaign to try; datasets.names()
    jointstiff.predict(run, "postures.csv")                  # plan, map, correct, compare
    run.correct(poses, tool=tool, forces=(0, 0, -500))       # arrays of poses, or a robot program
    run.save("run.json")                                     # with its campaign; every verb reads the file
    run = jointstiff.load("run.json")

    with jointstiff.Client("http://127.0.0.1:8000") as client:   # the same names against a service
        run = client.identify("campaign.json")

`help(jointstiff.identify)` lists the options of a verb. What is heavy is imported when it is used.
`Client` needs `pip install "jointstiff[client]"`.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointstiff.schemas.comparison import CampaignComparison
    from jointstiff.schemas.correction import CorrectionOptions
    from jointstiff.schemas.deflection import DeflectionOptions, LoadCase, MapOptions
    from jointstiff.schemas.gearbox import GearboxRequest
    from jointstiff.schemas.geometry import GeometryRequest
    from jointstiff.schemas.measurement import Noise, Units
    from jointstiff.schemas.options import RunOptions
    from jointstiff.schemas.plan import PlanOptions
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.library import datasets
    from jointstiff.service.library.campaigns import Campaign
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.correction import Correction
    from jointstiff.service.library.here import Here, predict
    from jointstiff.service.library.many import identify_many
    from jointstiff.service.library.measure import measure
    from jointstiff.service.library.motion_logs import read_log
    from jointstiff.service.library.reading import ImportedReadings, read
    from jointstiff.service.library.rehearse import Rehearsal, rehearse
    from jointstiff.service.library.results import Prediction, RobotTrend, TabledRun
    from jointstiff.service.library.robots import robot
    from jointstiff.service.library.saved import load
    from jointstiff.service.problems import CampaignError, RefusedError

    _here = Here()
    identify = _here.identify
    compare = _here.compare
    correct = _here.correct
    geometry = _here.geometry
    gearbox = _here.gearbox
    plan = _here.plan
    map = _here.map  # noqa: A001 - the command's name

_HOMES = {
    "Campaign": "service.library.campaigns",
    "CampaignComparison": "schemas.comparison",
    "CampaignError": "service.problems",
    "Client": "service.library.client",
    "Correction": "service.library.correction",
    "CorrectionOptions": "schemas.correction",
    "DeflectionOptions": "schemas.deflection",
    "GearboxRequest": "schemas.gearbox",
    "GeometryRequest": "schemas.geometry",
    "LoadCase": "schemas.deflection",
    "MapOptions": "schemas.deflection",
    "Noise": "schemas.measurement",
    "PlanOptions": "schemas.plan",
    "Prediction": "service.library.results",
    "RefusedError": "service.problems",
    "RobotDocument": "schemas.robot",
    "RunOptions": "schemas.options",
    "TabledRun": "service.library.results",
    "Units": "schemas.measurement",
    "ImportedReadings": "service.library.reading",
    "RobotTrend": "service.library.results",
    "identify_many": "service.library.many",
    "load": "service.library.saved",
    "measure": "service.library.measure",
    "Rehearsal": "service.library.rehearse",
    "predict": "service.library.here",
    "read": "service.library.reading",
    "rehearse": "service.library.rehearse",
    "read_log": "service.library.motion_logs",
    "robot": "service.library.robots",
}
"""Module of each public name that does not belong to a kind of work."""

__all__ = [
    "Campaign",
    "CampaignComparison",
    "CampaignError",
    "Client",
    "Correction",
    "CorrectionOptions",
    "DeflectionOptions",
    "GearboxRequest",
    "GeometryRequest",
    "ImportedReadings",
    "LoadCase",
    "MapOptions",
    "Noise",
    "PlanOptions",
    "Prediction",
    "RefusedError",
    "Rehearsal",
    "RobotDocument",
    "RobotTrend",
    "RunOptions",
    "TabledRun",
    "Units",
    "compare",
    "correct",
    "datasets",
    "gearbox",
    "geometry",
    "identify",
    "identify_many",
    "load",
    "map",
    "measure",
    "plan",
    "predict",
    "read",
    "read_log",
    "rehearse",
    "robot",
]


if not TYPE_CHECKING:  # a misspelt name is an error in an editor

    def __getattr__(name: str) -> object:
        """Return a public name of this package, which is imported when it is first used."""
        if name == "__version__":
            return import_module("jointstiff.service.process").jointstiff_version()
        if name == "datasets":
            return import_module("jointstiff.service.library.datasets")
        if name in _HOMES:
            try:
                return getattr(import_module(f"jointstiff.{_HOMES[name]}"), name)
            except ImportError as error:
                raise import_module("jointstiff.service.problems").explain_missing_library(
                    name, error
                ) from None
        from jointstiff.service.kinds.rooms import ROOMS

        if any(room.command == name for room in ROOMS.values()):
            return getattr(import_module("jointstiff.service.library.here").Here(), name)
        module = sys.modules[__name__]  # for Python's own suggestion of a name
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=module)


def __dir__() -> list[str]:
    """Return the public names of this package, including those that are not imported yet."""
    return sorted([*__all__, "__version__"])
