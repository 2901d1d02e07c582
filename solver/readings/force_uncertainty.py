"""Uncertainty of the load that all observations of a set share: that of one scale or load cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError


@dataclass(frozen=True)
class ForceUncertainty:
    """Standard uncertainties of the wrench, each fully correlated over the observations (method.md §8).

    The true wrench is ``(1 + ε) (I + φ×) W``: ε scales force and moment of all observations alike, φ turns
    both about the axes of R0.

    Attributes:
        scale: of ε, dimensionless.
        direction: of each component of φ [rad].

    Raises:
        MeasurementError: one is negative or not finite.
    """

    scale: float = 0.0
    direction: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("scale", self.scale), ("direction", self.direction)):
            if not (np.isfinite(value) and value >= 0.0):
                raise MeasurementError(
                    f"the standard uncertainty is {value}",
                    where=f"noise.force.{name}",
                    remedy="give a number that is zero or positive",
                )

    @property
    def standard_uncertainties(self) -> FloatArray:
        """Return those of (ε, φ_x, φ_y, φ_z), (4,)."""
        return np.array([self.scale, self.direction, self.direction, self.direction])
