"""Units of a campaign document, as the simulator writes and reads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray

__all__ = ["SI_UNITS", "Scales", "in_unit"]

SI_UNITS: Mapping[str, str] = MappingProxyType({"length": "m", "angle": "rad", "force": "N"})

SI_VALUES: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "mm": 1e-3},
    "angle": {"rad": 1.0, "deg": np.pi / 180.0},
    "force": {"N": 1.0, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "moment": {"N.m": 1.0, "N.mm": 1e-3, "kN.m": 1e3, "kgf.m": 9.80665},
}
DEFAULT_MOMENT = "N.m"
SIGNIFICANT_DIGITS = 15  # drops the last bit of a conversion: 0.02, not 0.020000000000000004


@dataclass(frozen=True)
class Scales:
    """SI value of one unit of each quantity: m, rad, N, N·m."""

    length: float  #: Metres in the unit of length
    angle: float  #: Radians in the unit of angle
    force: float  #: Newtons in the unit of force
    moment: float  #: Newton metres in the unit of moment

    def of_joints(self, slides: ArrayLike) -> FloatArray:
        """SI value of one unit of each joint's position [rad or m], (n,): of a length where it slides."""
        return np.where(slides, self.length, self.angle)

    @classmethod
    def of(cls, units: Mapping[str, str]) -> Scales:
        """Look the units up; the unit of moment is N.m where it is not named.

        Args:
            units: Unit of "length", "angle", "force" and, optionally, "moment".

        Raises:
            ValueError: A quantity has no unit, or one that is not known.
        """
        named = {"moment": DEFAULT_MOMENT, **units}
        if named.keys() != SI_VALUES.keys():
            msg = f"units name {sorted(units)}; expected length, angle, force and optionally moment"
            raise ValueError(msg)
        for quantity, unit in named.items():
            if unit not in SI_VALUES[quantity]:
                msg = f"{quantity} in {unit!r}; expected one of {', '.join(SI_VALUES[quantity])}"
                raise ValueError(msg)
        return cls(**{quantity: SI_VALUES[quantity][unit] for quantity, unit in named.items()})


def in_unit(values: ArrayLike, scale: ArrayLike, decimals: int | None = None) -> Any:  # noqa: ANN401
    """Convert SI values to a unit, as a number or nested lists of numbers for a document.

    Args:
        values: Values in SI.
        scale: What the unit is worth in SI.
        decimals: Decimals to keep, in the unit; None for all.
    """
    converted: FloatArray = np.asarray(values, dtype=float) / np.asarray(scale)
    if decimals is not None:
        converted = np.round(converted, decimals)
    tidy = [float(f"{value + 0.0:.{SIGNIFICANT_DIGITS}g}") for value in converted.ravel()]
    return np.reshape(tidy, converted.shape).tolist()
