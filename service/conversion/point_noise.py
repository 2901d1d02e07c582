"""Noise that readings state of their own, as arrays: stored beside them, in the units of their set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement.measurement_set import Reading
from jointstiff.schemas.measurement.noise import Matrix3
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError

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
