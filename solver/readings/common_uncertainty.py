"""Errors that all observations of a set share: of one load cell, one load hook, one set of reflectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.errors import MeasurementError


@dataclass(frozen=True)
class CommonUncertainty:
    """Standard uncertainties, each fully correlated over the observations (method.md §8).

    The true wrench is ``(1 + ε) (I + φ×) W``: ε scales force and moment of all observations alike, φ turns
    both about the axes of R0. Load and targets are off their stated places in the flange frame.

    Raises:
        MeasurementError: one is negative or not finite.
    """

    scale: float = 0.0  #: of ε, dimensionless
    direction: float = 0.0  #: of each component of φ [rad]
    load_point: float = 0.0  #: of each coordinate of the place where the load acts [m]
    #: of each coordinate of each target's place, independent of the other targets [m]
    target_places: float = 0.0
    #: of each joint axis's place in the robot's model, in each direction across it [m]
    axis_position: float = 0.0
    #: of each joint axis's direction in the model, about each direction across it [rad]
    axis_direction: float = 0.0

    def __post_init__(self) -> None:
        for where, value in (
            ("force.scale", self.scale),
            ("force.direction", self.direction),
            ("load_point", self.load_point),
            ("target_places", self.target_places),
            ("axes.position", self.axis_position),
            ("axes.direction", self.axis_direction),
        ):
            if not (np.isfinite(value) and value >= 0.0):
                raise MeasurementError(
                    f"the standard uncertainty is {value}",
                    where=f"noise.{where}",
                    remedy="give a number that is zero or positive",
                )
