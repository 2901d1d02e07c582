"""Numerical core: from arrays of readings to joint compliances with their evidence.

    estimate = identify(robot, measurements, settings)

Everything is in SI units and in the base frame R0. Each package has a door of its own; `docs/architecture.md`
shows how they lie on each other. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointstiff.solver.errors import JointstiffError
    from jointstiff.solver.fitting import Settings
    from jointstiff.solver.identification import identify
    from jointstiff.solver.inference import Estimate, predict
    from jointstiff.solver.readings import Measurements
    from jointstiff.solver.robot import KinematicChain, Robot

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

_ROOMS = {
    "Estimate": "inference",
    "JointstiffError": "errors",
    "KinematicChain": "robot",
    "Measurements": "readings",
    "Robot": "robot",
    "Settings": "fitting",
    "identify": "identification",
    "predict": "inference",
}


def __getattr__(name: str) -> object:
    """Import a name from its room, for those who ask for it here."""
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ROOMS[name]}"), name)
