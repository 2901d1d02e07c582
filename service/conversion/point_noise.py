"""Noise that readings state of their own, as arrays: stored beside them, in the units of their set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jointstiff.schemas.measurement import Matrix3, Noise, Reading
from jointstiff.service.conversion.array_group import ArrayGroup
from jointstiff.service.conversion.units import to_instrument
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.measurements import (
    ASSUMED_LOAD_POINT,
    CommonUncertainty,
    Measurements,
)
from jointstiff.solver.readings.tracker_noise import (
    DifferenceNoise,
    position_covariances,
    refuse_no_covariance,
)
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.triangle import ISOTROPIC_DIFFERENCE


@dataclass(frozen=True, eq=False)
class PointNoise(ArrayGroup):
    """Noise stated by N observations of T targets; zero where a reading states the other kind or none."""

    prefix = "noise_"

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
            MeasurementError: some readings of the tracker state their noise, and others do not.
        """
        stated = [r.sigma is not None or r.unloaded_covariance is not None for r in readings]
        if not any(stated):
            return None
        tracker = [i for i, r in enumerate(readings) if r.displacement is None]
        _refuse_gaps([stated[i] for i in tracker], [place[0][i] for i in tracker])
        sigma, unloaded, loaded = np.zeros(shape), np.zeros((*shape, 3, 3)), np.zeros((*shape, 3, 3))
        for i, t, reading in zip(*place, readings, strict=True):
            if reading.sigma is not None:
                sigma[i, t] = reading.sigma
            elif reading.unloaded_covariance is not None:
                unloaded[i, t], loaded[i, t] = reading.unloaded_covariance, reading.loaded_covariance
        return cls(sigma, unloaded, loaded)

    def fields(self, i: int, t: int) -> dict[str, Any]:
        """Return what a reading stated, by the names of its fields."""
        if self.sigma[i, t]:
            return {"sigma": float(self.sigma[i, t])}
        if not self.unloaded[i, t].any():
            return {}
        return {
            "unloaded_covariance": _rows(self.unloaded[i, t]),
            "loaded_covariance": _rows(self.loaded[i, t]),
        }

    @property
    def stated(self) -> BoolArray:
        """(N, T) readings that state their noise."""
        return np.asarray((self.sigma > 0.0) | self.unloaded.any(axis=(-1, -2)))

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return covariances (N, T, 3, 3) of unloaded and loaded positions, unit of length squared."""
        isotropic = (self.sigma**2)[..., None, None] * np.eye(3)
        return self.unloaded + isotropic, self.loaded + isotropic


def _rows(matrix: FloatArray) -> Matrix3:
    x, y, z = (tuple(row) for row in matrix.tolist())
    return x, y, z


def _refuse_gaps(stated: list[bool], observations: list[int]) -> None:
    if len(set(stated)) < 2:
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
    present = plain.present
    own = np.zeros_like(present) if points is None else points.stated
    _refuse_unclear(noise, own, plain)
    instrument = (
        None if noise is None or noise.instrument is None else to_instrument(noise.instrument, length)
    )
    sigma = None if noise is None or noise.sigma is None else length * noise.sigma
    if points is None and instrument is None:
        return sigma, ISOTROPIC_DIFFERENCE
    of_set = ((sigma or 0.0) ** 2 * np.eye(3),) * 2
    unloaded, loaded = of_set if instrument is None else position_covariances(instrument, robot, plain)
    if points is not None:
        parts = points.covariances()
        refuse_no_covariance(parts[0], own, "unloaded_covariance")
        refuse_no_covariance(parts[1], own, "loaded_covariance")
        unloaded, loaded = (
            np.where(own[..., None, None], length**2 * part, other)
            for part, other in zip(parts, (unloaded, loaded), strict=True)
        )
    stated = DifferenceNoise.of(unloaded, loaded, plain.coordinates)
    return stated.sigma, stated.covariance


def _refuse_unclear(noise: Noise | None, own: BoolArray, plain: Measurements) -> None:
    """Refuse noise that is stated twice, or of some readings only.

    Args:
        noise: of the set; it belongs to the readings that state none.
        own: (N, T) readings that state their own.
        plain: the readings.
    """
    rest = plain.present & ~own
    kind = next((k for k in ("sigma", "instrument") if getattr(noise, k, None) is not None), None)
    if kind is not None and not rest.any():
        raise MeasurementError(
            f"both the readings and noise.{kind} give the noise",
            where=f"noise.{kind}",
            remedy="give only one: omit it here, or in every reading",
        )
    unclear = rest & (plain.coordinates == 1) if kind == "instrument" else rest & (kind is None and own.any())
    if unclear.any():
        i = int(np.argwhere(unclear)[0, 0])
        raise MeasurementError(
            "the noise of a reading is not given: that of the others does not apply to it",
            where=f"observations[{i}].readings",
            remedy="give the reading its `sigma`, or `noise.sigma` for all that state none",
        )


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
