"""Noise that readings state of their own, as arrays: stored beside them, in the units of their set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement.measurement_set import Reading
from jointstiff.schemas.measurement.noise import Matrix3, Noise
from jointstiff.service.conversion.units import to_instrument
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.measurements import (
    ASSUMED_LOAD_POINT,
    ISOTROPIC_DIFFERENCE,
    CommonUncertainty,
    Measurements,
)
from jointstiff.solver.readings.tracker_noise import DifferenceNoise, refuse_no_covariance
from jointstiff.solver.robot.model import Robot

_NAMES = ("sigma", "unloaded", "loaded")
_PREFIX = "noise_"


@dataclass(frozen=True, eq=False)
class PointNoise:
    """Noise stated by N observations of T targets; zero where a reading states the other kind or none."""

    sigma: FloatArray  # (N, T)
    unloaded: FloatArray  # (N, T, 3, 3) covariance before the load
    loaded: FloatArray  # (N, T, 3, 3) under load

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], place: tuple[list[int], list[int]], readings: list[Reading]
    ) -> PointNoise | None:
        """Arrange what the readings state; None if none states anything.

        Args:
            shape: N and T.
            place: observation and target of each reading.
            readings: all of the set.

        Raises:
            MeasurementError: some readings state their noise, and others do not.
        """
        stated = [r.sigma is not None or r.unloaded_covariance is not None for r in readings]
        if not any(stated):
            return None
        _refuse_gaps(stated, place[0])
        sigma, unloaded, loaded = np.zeros(shape), np.zeros((*shape, 3, 3)), np.zeros((*shape, 3, 3))
        for i, t, reading in zip(*place, readings, strict=True):
            if reading.sigma is not None:
                sigma[i, t] = reading.sigma
            else:
                unloaded[i, t], loaded[i, t] = reading.unloaded_covariance, reading.loaded_covariance
        return cls(sigma, unloaded, loaded)

    def fields(self, i: int, t: int) -> dict[str, Any]:
        """Return what a reading stated, by the names of its fields."""
        if self.sigma[i, t]:
            return {"sigma": float(self.sigma[i, t])}
        return {
            "unloaded_covariance": _rows(self.unloaded[i, t]),
            "loaded_covariance": _rows(self.loaded[i, t]),
        }

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return covariances (N, T, 3, 3) of unloaded and loaded positions, unit of length squared."""
        isotropic = (self.sigma**2)[..., None, None] * np.eye(3)
        return self.unloaded + isotropic, self.loaded + isotropic

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by the names under which they are stored."""
        return {f"{_PREFIX}{name}": getattr(self, name) for name in _NAMES}

    @classmethod
    def from_archive(cls, archive: Mapping[str, npt.NDArray[Any]]) -> PointNoise | None:
        """Read them back; None for a set without."""
        if f"{_PREFIX}sigma" not in archive:
            return None
        return cls(*(archive[f"{_PREFIX}{name}"] for name in _NAMES))


def _rows(matrix: FloatArray) -> Matrix3:
    x, y, z = (tuple(row) for row in matrix.tolist())
    return x, y, z


def _refuse_gaps(stated: list[bool], observations: list[int]) -> None:
    if all(stated):
        return
    i = observations[stated.index(False)]
    raise MeasurementError(
        "some readings give their own noise, but this observation has one that does not",
        where=f"observations[{i}].readings",
        remedy="give every reading its `sigma` or its covariances, or none and `noise` for the set",
    )


def to_noise(
    noise: Noise | None, points: PointNoise | None, robot: Robot, plain: Measurements, *, length: float
) -> tuple[float | None, FloatArray]:
    """Return sigma [m], None where nothing is stated, and the deflections' covariance in units of sigma².

    Args:
        noise: of the set.
        points: what its readings state of their own.
        robot: n joints.
        plain: the readings, without noise.
        length: metres in the set's unit of length.

    Raises:
        MeasurementError: two kinds of noise, or one that is none.
    """
    if points is not None:
        if noise is not None and (noise.sigma is not None or noise.instrument is not None):
            kind = "sigma" if noise.sigma is not None else "instrument"
            raise MeasurementError(
                f"both the readings and noise.{kind} give the noise",
                where=f"noise.{kind}",
                remedy="give only one: omit it here, or in every reading",
            )
        present = plain.present
        unloaded, loaded = points.covariances()
        refuse_no_covariance(unloaded, present, "unloaded_covariance")
        refuse_no_covariance(loaded, present, "loaded_covariance")
        stated = DifferenceNoise.of(length**2 * unloaded, length**2 * loaded, present)
    elif noise is not None and noise.instrument is not None:
        stated = DifferenceNoise.by(to_instrument(noise.instrument, length), robot, plain)
    else:
        sigma = None if noise is None or noise.sigma is None else length * noise.sigma
        return sigma, ISOTROPIC_DIFFERENCE
    return stated.sigma, stated.covariance


def to_common_uncertainty(noise: Noise | None, length: float) -> CommonUncertainty:
    """Return the uncertainty of what all observations share; that of the load point is assumed if not stated.

    Args:
        noise: of the set.
        length: metres in the set's unit of length.
    """
    if noise is None:
        return CommonUncertainty(load_point=ASSUMED_LOAD_POINT, load_point_assumed=True)
    return CommonUncertainty(
        0.0 if noise.force is None else noise.force.scale,
        0.0 if noise.force is None else noise.force.direction,
        ASSUMED_LOAD_POINT if noise.load_point is None else length * noise.load_point,
        length * (noise.target_places or 0.0),
        0.0 if noise.axes is None else length * noise.axes.position,
        0.0 if noise.axes is None else noise.axes.direction,
        noise.load_point is None,
    )
