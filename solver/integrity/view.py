"""A measurement set seen from the flange: what all checks start from, computed once.

Thresholds of the checks, from a stated rate of false alarms.

Every statistical check of a set is allowed `FALSE_ALARM` of false findings, divided among its comparisons
(Bonferroni). Where the scale is not stated but taken from the data, robustly, its own uncertainty counts:
quantiles are then those of F with the degrees of freedom that a median leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import unloaded_configurations

IN_ORDER: Final = 0.8
"""Correlation of a joint's angle with the row."""


@dataclass(frozen=True, eq=False)
class View:
    """N observations of T targets of a robot with n joints."""

    robot: Robot  #: as its model says
    measurements: Measurements  #: as they came
    degrees: bool  #: whether the angles were posted in degrees
    configurations: Configurations  #: configurations by the model, without load

    @classmethod
    def of(cls, robot: Robot, measurements: Measurements, *, degrees: bool) -> View:
        """Compute the kinematics."""
        return cls(robot, measurements, degrees, unloaded_configurations(robot, measurements))

    @property
    def targets(self) -> tuple[str, ...]:
        """(T,) names of the targets."""
        return self.measurements.targets

    @cached_property
    def measured(self) -> BoolArray:
        """(N, T) whose positions were read in R0."""
        return np.asarray(self.measurements.present & ~self.measurements.in_flange)

    @cached_property
    def places(self) -> FloatArray:
        """(N, T, 3) of the unloaded targets as the model sees them from the flange [m]; nan if not measured.

        A target sits still on the flange, so with a perfect model each stays where it is.
        """
        return seen_from_flange(self.configurations, self.measurements.position, self.measured)

    @cached_property
    def reading_sigma(self) -> FloatArray:
        """(N, T) standard uncertainty of a position in its worst direction [m]; zero where unknown."""
        m = self.measurements
        if m.sigma is None:
            return np.zeros(m.present.shape)
        worst = np.linalg.eigvalsh(m.covariance)[..., -1]
        return np.broadcast_to(m.sigma * np.sqrt(worst / 2.0), m.present.shape)

    @cached_property
    def in_order(self) -> bool:
        """Return whether the postures were measured in the order of a joint's angle.

        What the model has wrong then changes with the rows as a drift does.
        """
        q = self.measurements.joints
        time = np.arange(len(q)) - 0.5 * (len(q) - 1)
        off = q - q.mean(axis=0)
        size = np.linalg.norm(off, axis=0) * np.linalg.norm(time)
        return bool((np.abs(time @ off) > IN_ORDER * size).any())

    @cached_property
    def loaded(self) -> BoolArray:
        """(N,) which observations have a load at all."""
        return np.asarray(self.measurements.force.any(axis=1) | self.measurements.moment.any(axis=1))


def seen_from_flange(configurations: Configurations, position: FloatArray, measured: BoolArray) -> FloatArray:
    """(N, T, 3) positions in R0 [m] brought into the flange frame; nan where not measured."""
    arm = position - configurations.flange_translation[:, None]
    return np.where(measured[..., None], arm @ configurations.flange_rotation, np.nan)


FALSE_ALARM: Final = 1e-6
"""Significance level of a check: a dozen checks, a set a day for centuries."""
MODEL_ALLOWANCE: Final = 1.5
"""Factor for deviations that are not noise: they are not normal, and their extremes may be larger."""
MEDIAN_EFFICIENCY: Final = 0.37
"""Confidence of a scale estimated by medians, as the standard deviation of that share of the readings."""
_MEDIAN_SIZE: Final = 0.6744897501960817
"""Median of the absolute value of one."""


def normal_quantile(comparisons: int) -> float:
    """Standard deviations that one of so many normal variables exceeds, on either side, at `FALSE_ALARM`."""
    return float(-special.ndtri(FALSE_ALARM / (2.0 * max(comparisons, 1))))


def vector_quantile(comparisons: int, freedom: float, coordinates: int = 3) -> float:
    """Norm, over its scale, that one of so many vectors exceeds at `FALSE_ALARM`.

    Args:
        comparisons: how many vectors.
        freedom: number of coordinates from which medians took the scale.
        coordinates: of a vector.
    """
    below = 1.0 - FALSE_ALARM / max(comparisons, 1)
    F = special.fdtri(coordinates, max(1.0, MEDIAN_EFFICIENCY * freedom), below)
    return float(np.sqrt(coordinates * F))


def median(sizes: FloatArray) -> float:
    """Return the median of finite numbers, at least one; `np.median` takes five times as long."""
    middle = (sizes.size - 1) // 2, sizes.size // 2
    ordered = np.partition(sizes.ravel(), middle)
    return float(0.5 * (ordered[middle[0]] + ordered[middle[1]]))


def vector_scale(norms: FloatArray, coordinates: int = 3) -> float:
    """Standard deviation of a coordinate, by the median of the norms (K,) of vectors; 0 for none."""
    unit = float(np.sqrt(2.0 * special.gammaincinv(0.5 * coordinates, 0.5)))
    return median(norms) / unit if norms.size else 0.0


def length_scale(sizes: FloatArray) -> float:
    """Standard deviation of numbers of these sizes (K,), by their median; 0 for none."""
    return median(sizes) / _MEDIAN_SIZE if sizes.size else 0.0
