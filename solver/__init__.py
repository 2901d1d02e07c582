"""Numerical core: from arrays of readings to joint compliances with their evidence.

    estimate = identify(robot, measurements, settings)

Everything is in SI units and in the base frame R0. `docs/architecture.md` shows how the packages lie on each
other. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointstiff.solver.errors import JointstiffError
    from jointstiff.solver.fitting.settings import Settings
    from jointstiff.solver.identification import identify
    from jointstiff.solver.inference.estimate import Estimate
    from jointstiff.solver.inference.prediction import predict
    from jointstiff.solver.readings.measurements import Measurements
    from jointstiff.solver.robot.chain import KinematicChain
    from jointstiff.solver.robot.model import Robot

__all__ = [
    "Estimate",
    "JointstiffError",
    "KinematicChain",
    "Measurements",
    "Robot",
    "Settings",
    "identify",
    "predict",
]

_HOMES = {
    "Estimate": "inference.estimate",
    "JointstiffError": "errors",
    "KinematicChain": "robot.chain",
    "Measurements": "readings.measurements",
    "Robot": "robot.model",
    "Settings": "fitting.settings",
    "identify": "identification",
    "predict": "inference.prediction",
}


def __getattr__(name: str) -> object:
    """Import a name from its module when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
