"""Numerical core: from arrays of readings to joint compliances with their evidence.

    estimate = identify(rows, settings)
    estimate = identify_weight(readings)                    # own weight instead of loads

Everything is in SI units and in the base frame R0. `CONTRIBUTING.md` shows how the packages lie on each
other. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointstiff.solver.errors import JointstiffError
    from jointstiff.solver.fit.estimate import Estimate
    from jointstiff.solver.fit.identify import identify
    from jointstiff.solver.fit.method import Settings
    from jointstiff.solver.fit.weight_rows import Balancer, Burden, WeightReadings
    from jointstiff.solver.geometry.poses import Poses
    from jointstiff.solver.mechanics.chain import KinematicChain
    from jointstiff.solver.mechanics.measurements import Measurements
    from jointstiff.solver.mechanics.robot import Body, Robot
    from jointstiff.solver.own_weight.estimate import WeightEstimate, identify_weight

__all__ = [
    "Balancer",
    "Body",
    "Burden",
    "Estimate",
    "JointstiffError",
    "KinematicChain",
    "Measurements",
    "Poses",
    "Robot",
    "Settings",
    "WeightEstimate",
    "WeightReadings",
    "identify",
    "identify_weight",
]

_HOMES = {
    "Balancer": "fit.weight_rows",
    "Body": "mechanics.robot",
    "Burden": "fit.weight_rows",
    "Estimate": "fit.estimate",
    "JointstiffError": "errors",
    "KinematicChain": "mechanics.robot",
    "Measurements": "mechanics.measurements",
    "Poses": "geometry.poses",
    "Robot": "mechanics.robot",
    "Settings": "fit.method",
    "WeightEstimate": "own_weight.estimate",
    "WeightReadings": "fit.weight_rows",
    "identify": "fit.identify",
    "identify_weight": "own_weight.estimate",
}


def __getattr__(name: str) -> object:
    """Import a public name of this package from its module when the name is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
