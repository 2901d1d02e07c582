"""Uncertainty of tracker readings (method.md §3): covariances of positions, and of their differences.

A laser tracker measures a distance and two angles: in the line of sight ``σ_r = a + b d``, across it
``σ_t = c + e d``, d the distance from the station. So the covariance of a position is anisotropic, turns
with the line of sight and grows with the distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.triangle import ISOTROPIC_DIFFERENCE

SHORTEST_SIGHT: Final = 0.01
"""Distance from station to target [m] below which the line of sight is undefined."""
LEAST_SIGMA: Final = 1e-12
"""Least standard uncertainty of an instrument [m]: a picometre."""
LARGEST_CONDITION: Final = 1e12
"""Largest condition number of a covariance: standard uncertainties in a ratio of a million, beyond any
instrument's."""


@dataclass(frozen=True)
class Instrument:
    """A laser tracker at its station."""

    station: tuple[float, float, float]  #: where it stands, in R0 [m]
    range_constant: float  #: a [m]
    range_per_distance: float  #: b [m/m]
    transverse_constant: float  #: c [m]
    transverse_per_distance: float  #: e [m/m]

    def covariance(self, places: FloatArray) -> FloatArray:
        """Σ = σ_t² I + (σ_r² − σ_t²) u uᵀ, u the line of sight.

        Args:
            places: (..., 3) of targets in R0 [m].

        Returns:
            (..., 3, 3) covariance of a reading there, axes of R0 [m²].

        Raises:
            MeasurementError: a target stands at the station, or the instrument is exact or far beyond any.
        """
        sight = places - np.array(self.station)
        distance = np.linalg.norm(sight, axis=-1)
        if (distance < SHORTEST_SIGHT).any():
            raise MeasurementError(
                f"a target is only {1e3 * distance.min():.3g} mm away from the tracker",
                where="noise.instrument.station",
                remedy="give the tracker's station in R0, in `units.length`",
            )
        along = self.range_constant + self.range_per_distance * distance
        across = self.transverse_constant + self.transverse_per_distance * distance
        least = min(float(along.min()), float(across.min()))
        ratio = float(np.maximum(along / across, across / along).max()) if least > 0.0 else np.inf
        if least < LEAST_SIGMA or ratio**2 > LARGEST_CONDITION:
            raise MeasurementError(
                f"the standard uncertainties of {along.max():.3g} m along and {across.max():.3g} m across "
                "the line of sight are implausible for a tracker",
                where="noise.instrument",
                remedy="check the constants, which are in `units.length`, and the terms per distance",
            )
        u = sight / distance[..., None]
        spread = (along**2 - across**2)[..., None, None] * u[..., :, None] * u[..., None, :]
        covariance: FloatArray = (across**2)[..., None, None] * np.eye(3) + spread
        return covariance

    def typical_sigma(self, places: FloatArray) -> float:
        """Return the root mean square of the standard uncertainties of all coordinates (K, 3) [m]."""
        covariance = self.covariance(places)
        return float(np.sqrt(np.trace(covariance, axis1=-2, axis2=-1).mean() / 3.0))


@dataclass(frozen=True, eq=False)
class DifferenceNoise:
    """Stated noise of N observations of T targets as `Measurements` takes it."""

    #: root mean square, over the coordinates of all readings, of the standard uncertainty of a position
    #: [m]. It only is the unit of `covariance`: no estimate depends on it.
    sigma: float
    covariance: FloatArray  #: (N, T, 3, 3) covariance of the deflections, in units of sigma²

    @classmethod
    def of(cls, unloaded: FloatArray, loaded: FloatArray, coordinates: IndexArray) -> DifferenceNoise:
        """Both readings count: Σ_d = Σ_unloaded + Σ_loaded.

        Args:
            unloaded: (N, T, 3, 3) covariance of the positions before the load [m²].
            loaded: (N, T, 3, 3) under load [m²].
            coordinates: (N, T) number of coordinates that each reading shows.
        """
        total = unloaded + loaded
        trace = np.trace(total, axis1=-2, axis2=-1)
        variance = np.average(trace, weights=coordinates) / 6.0
        read = (coordinates > 0)[..., None, None]
        covariance = np.where(read, total / variance, ISOTROPIC_DIFFERENCE)
        return cls(float(np.sqrt(variance)), covariance)

    @classmethod
    def by(cls, instrument: Instrument, robot: Robot, plain: Measurements) -> DifferenceNoise:
        """Return the noise of measurements that were read by an instrument."""
        return cls.of(*position_covariances(instrument, robot, plain), plain.coordinates)


def position_covariances(
    instrument: Instrument, robot: Robot, plain: Measurements
) -> tuple[FloatArray, FloatArray]:
    """(N, T, 3, 3) covariances [m²] of the unloaded and the loaded positions that an instrument read."""
    places = places_in_base(robot, plain.joints, plain.position, plain.in_flange)
    before = at_read_places(places, plain.present)
    return instrument.covariance(before), instrument.covariance(before + plain.deflection)


def at_read_places(places: FloatArray, present: BoolArray) -> FloatArray:
    """Put targets that were not read, which have no place, where one was read: it does not matter where."""
    return np.where(present[..., None], places, places[present][0])


def places_in_base(
    robot: Robot, joints: FloatArray, position: FloatArray, in_flange: BoolArray
) -> FloatArray:
    """(N, T, 3) places of the targets in R0 [m], by the model where they are given in the flange frame.

    Args:
        robot: n joints.
        joints: (N, n) controller angles [rad].
        position: (N, T, 3) [m].
        in_flange: (N, T) whether it is in the flange frame.
    """
    if not in_flange.any():
        return position
    configurations = Configurations(robot, robot.joint_map.model_angles(joints))
    return np.where(in_flange[..., None], configurations.to_base(position), position)


def refuse_no_covariance(covariance: FloatArray, present: BoolArray, field: str) -> None:
    """Refuse matrices that are no covariance of anything.

    Args:
        covariance: (N, T, 3, 3) [any unit].
        present: (N, T) which of them count.
        field: of a reading, for the message.

    Raises:
        MeasurementError: the first that is not symmetric and positive definite within rounding.
    """
    skew = np.abs(covariance - np.swapaxes(covariance, -1, -2)).max(axis=(-1, -2))
    values = np.linalg.eigvalsh(covariance)
    good = (values[..., 0] * LARGEST_CONDITION > values[..., -1]) & (values[..., 0] > 0.0)
    good &= skew <= 1e-9 * np.abs(values).max(axis=-1)
    bad = np.argwhere(present & ~good)
    if len(bad):
        i, t = bad[0].tolist()
        position = int(present[i, :t].sum())
        raise MeasurementError(
            "the covariance matrix is not symmetric and positive definite",
            where=f"observations[{i}].readings[{position}].{field}",
            remedy="give the covariance of the three coordinates, axes of R0, in `units.length` squared",
        )
