"""Concentric spheres: with the arm at rest, every target keeps its distance from the wrist centre."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.gauss_newton import LinearFit, minimise
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes
from jointstiff.solver.regression.regressor import whitener


@dataclass(frozen=True, eq=False)
class SpherePosition:
    """Three targets at one position."""

    points: FloatArray  #: (3, 3) readings [m]
    factors: FloatArray  #: (3, 3, 3) Cholesky factors of their covariances in units of sigma²
    columns: IndexArray  #: (9,) of the whitened readings in the order of all

    @property
    def covariances(self) -> FloatArray:
        """Covariances (3, 3, 3) in units of sigma²."""
        return np.asarray(self.factors @ np.swapaxes(self.factors, -1, -2))


@dataclass(frozen=True, eq=False)
class SphereFit:
    """Common centre of one sphere for each target."""

    centre: FloatArray  #: (3,) tracker's frame [m]
    radii: FloatArray  #: (T,) [m]; NaN for a target without reading
    influence: FloatArray  #: (3 + T, m) derivative of both by all whitened readings, in units of sigma
    rss: float  #: sum of squares of the residuals, whitened in units of sigma² [m²]
    dof: int  #: degrees of freedom
    points: FloatArray  #: (P, T, 3) the readings used [m]
    factors: FloatArray  #: (P, T, 3, 3) Cholesky factors of their covariances in units of sigma²
    present: BoolArray  #: (P, T) which were read
    columns: IndexArray  #: (P, T, 3) index of each among all whitened readings

    @property
    def seen(self) -> BoolArray:
        """Which targets (T,) were read at all."""
        return np.asarray(self.present.any(axis=0))

    def positions(self, targets: Sequence[int]) -> Iterator[SpherePosition]:
        """The positions at which three targets were all read."""
        chosen = list(targets)
        for k in np.flatnonzero(self.present[:, chosen].all(axis=1)):
            yield SpherePosition(
                self.points[k, chosen], self.factors[k, chosen], self.columns[k, chosen].ravel()
            )


@dataclass(frozen=True, eq=False)
class _Readings:
    points: FloatArray
    factors: FloatArray
    present: BoolArray
    columns: IndexArray

    @property
    def rows(self) -> tuple[IndexArray, ...]:
        """Position and target of each of the m readings."""
        return np.nonzero(self.present)

    def along(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances (m,) from the centre, and unit vectors (m, 3) from it."""
        arms = self.points[self.rows] - state[:3]
        length = np.linalg.norm(arms, axis=1)
        return length, arms / length[:, None]

    def by_reading(self, along: FloatArray) -> FloatArray:
        """Derivative (m, 3) of a distance by its whitened reading; its norm is the distance's sigma."""
        return np.asarray(np.einsum("mji,mj->mi", self.factors[self.rows], along))


def fit_spheres(identified: SweptAxes, sweeps: Sequence[int]) -> SphereFit | None:
    """Fit the spheres by maximum likelihood.

    Args:
        identified: for sweeps and targets.
        sweeps: indices of those in which the arm is at rest in one posture.

    Returns:
        The fit, or None if the readings do not determine a centre: a single sweep shows only a circle.
    """
    if len(sweeps) < 2:
        return None
    data = _gathered(identified, sweeps)
    count = data.present.shape[1]
    member = np.eye(count)[data.rows[1]]
    first = _start(data, count)
    # Weights are those of the start values: they hardly change, and the fit stays an ordinary one.
    spread = np.linalg.norm(data.by_reading(data.along(first)[1]), axis=1)

    def jacobian(state: FloatArray) -> FloatArray:
        return np.asarray(np.hstack([data.along(state)[1], member]) / spread[:, None])

    try:
        state, linear = minimise(
            first,
            lambda s: np.asarray((data.along(s)[0] - member @ s[3:]) / spread),
            jacobian,
            lambda s, step: np.asarray(s + step),
            where="wrist",
        )
    except MeasurementError:
        return None
    return _evidence(state, linear, data, spread, identified.influence.shape[1])


def _evidence(
    state: FloatArray, linear: LinearFit, data: _Readings, spread: FloatArray, readings: int
) -> SphereFit | None:
    if not linear.determines(slice(0, 3)):
        return None
    by_reading = data.by_reading(data.along(state)[1]) / spread[:, None]
    influence = np.zeros((len(state), readings))
    by_all = linear.pseudo_inverse[:, :, None] * by_reading
    influence[:, data.columns[data.rows].ravel()] = by_all.reshape(len(state), -1)
    return SphereFit(
        centre=state[:3],
        radii=np.where(data.present.any(axis=0), state[3:], np.nan),
        influence=influence,
        rss=float(linear.residual @ linear.residual),
        dof=len(spread) - linear.rank,
        points=data.points,
        factors=data.factors,
        present=data.present,
        columns=data.columns,
    )


def _gathered(identified: SweptAxes, sweeps: Sequence[int]) -> _Readings:
    all_sweeps = identified.sweeps.sweeps
    starts = np.cumsum([0, *(sweep.points.size for sweep in all_sweeps)])
    chosen = [all_sweeps[index] for index in sweeps]
    factors = [
        np.linalg.inv(np.broadcast_to(whitener(sweep.covariance), (*sweep.present.shape, 3, 3)))
        for sweep in chosen
    ]
    columns = [
        starts[index] + np.arange(all_sweeps[index].points.size).reshape(all_sweeps[index].points.shape)
        for index in sweeps
    ]
    return _Readings(
        np.concatenate([sweep.points for sweep in chosen]),
        np.concatenate(factors),
        np.concatenate([sweep.present for sweep in chosen]),
        np.concatenate(columns),
    )


def _start(data: _Readings, targets: int) -> FloatArray:
    """Linear fit of ``2 c·p + (r_t² − ‖c‖²) = ‖p‖²`` about the readings' mean."""
    rows = data.rows
    mean = data.points[rows].mean(axis=0)
    p = data.points[rows] - mean
    system = np.hstack([2.0 * p, np.eye(targets)[rows[1]]])
    solution = np.linalg.lstsq(system, np.sum(p**2, axis=1), rcond=None)[0]
    centre = solution[:3]
    radii = np.sqrt(np.maximum(solution[3:] + centre @ centre, 1e-12))
    return np.concatenate([centre + mean, radii])
