"""Concentric spheres: with the arm at rest, every target keeps its distance from the wrist centre.

With its distances from three targets, each position shows the centre by trilateration (paper, eqs 13-20),
too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.gauss_newton import minimise
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes
from jointstiff.solver.triangle import whitener


@dataclass(frozen=True, eq=False)
class SphereReadings:
    """Readings of T targets at P positions, with the arm at rest."""

    points: FloatArray  #: (P, T, 3) tracker's frame [m]
    factors: FloatArray  #: (P, T, 3, 3) Cholesky factors of their covariances in units of sigma²
    present: BoolArray  #: (P, T) True for readings
    columns: IndexArray  #: (P, T, 3) index of each among all whitened readings

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


@dataclass(frozen=True, eq=False)
class SphereFit:
    """Common centre of one sphere for each target."""

    centre: FloatArray  #: (3,) tracker's frame [m]
    radii: FloatArray  #: (T,) [m]; of no meaning for a target without reading
    influence: FloatArray  #: (3 + T, m) derivative of both by all whitened readings, in units of sigma
    readings: SphereReadings  #: readings that were fitted


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
    data = SphereReadings(
        np.concatenate([sweep.points for sweep in chosen]),
        np.concatenate(factors),
        np.concatenate([sweep.present for sweep in chosen]),
        np.concatenate(columns),
    )
    count = data.present.shape[1]
    member = np.eye(count)[data.rows[1]]
    # Linear fit of ``2 c·p + (r_t² − ‖c‖²) = ‖p‖²`` about the readings' mean
    rows = data.rows
    mean = data.points[rows].mean(axis=0)
    p = data.points[rows] - mean
    system = np.hstack([2.0 * p, np.eye(count)[rows[1]]])
    solution = np.linalg.lstsq(system, np.sum(p**2, axis=1), rcond=None)[0]
    centre = solution[:3]
    radii = np.sqrt(np.maximum(solution[3:] + centre @ centre, 1e-12))
    first = np.concatenate([centre + mean, radii])
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
    if not linear.determines(slice(0, 3)):
        return None
    by_reading = data.by_reading(data.along(state)[1]) / spread[:, None]
    influence = np.zeros((len(state), identified.influence.shape[1]))
    by_all = linear.pseudo_inverse[:, :, None] * by_reading
    influence[:, data.columns[data.rows].ravel()] = by_all.reshape(len(state), -1)
    return SphereFit(state[:3], state[3:], influence, data)


_COLLINEAR = 1e-3  # least height of the triangle over its base


@dataclass(frozen=True, eq=False)
class Trilateration:
    """The two points at given distances from three targets."""

    centre: FloatArray  #: (3,) the one nearer the nominal centre [m]
    other: FloatArray  #: (3,) its mirror image in the plane of the targets [m]
    by_distance: FloatArray  #: (3, 3) derivative of the centre by the distances
    by_target: FloatArray  #: (3, 3, 3) derivative of the centre by each target: component, target, coordinate

    def covariance(self, targets: FloatArray, distances: FloatArray) -> FloatArray:
        """Covariance (3, 3) of the centre [m²].

        Args:
            targets: (3, 3, 3) of each target [m²], independent of one another and of the distances.
            distances: (3, 3) of the distances [m²].
        """
        from_targets = np.einsum("itj,tjk,ltk->il", self.by_target, targets, self.by_target)
        return np.asarray(from_targets + self.by_distance @ distances @ self.by_distance.T)


def trilaterate(targets: FloatArray, distances: npt.ArrayLike, near: npt.ArrayLike) -> Trilateration:
    """Find the point at three distances from three targets.

    Args:
        targets: (3, 3) P10, P11, P12 [m].
        distances: (3,) r_0, r_1, r_2 [m].
        near: (3,) nominal centre, to choose between the two solutions [m].

    Raises:
        MeasurementError: the targets lie on a line, or no point has these distances.
    """
    r, P = np.asarray(distances, dtype=np.float64), targets
    e_x = P[1] - P[0]
    d = float(np.linalg.norm(e_x))
    e_x = e_x / max(d, 1e-300)
    i = float(e_x @ (P[2] - P[0]))
    e_y = P[2] - P[0] - i * e_x
    j = float(np.linalg.norm(e_y))
    if j <= _COLLINEAR * d or d == 0.0:
        raise MeasurementError(
            "the three targets lie on a line, so the distances do not determine a point",
            where="targets",
            remedy="place the targets so that they form a triangle",
        )
    e_y = e_y / j
    e_z = np.cross(e_x, e_y)
    x = (r[0] ** 2 - r[1] ** 2 + d**2) / (2 * d)
    y = (r[0] ** 2 - r[2] ** 2 + i**2 + j**2) / (2 * j) - i / j * x
    z2 = float(r[0] ** 2 - x**2 - y**2)
    if not z2 > 0.0:
        raise MeasurementError(
            "no point has these distances from the three targets, or it lies in the plane of the targets",
            where="targets",
            remedy="check the distances; a centre in the plane of the targets cannot be found by "
            "trilateration",
        )
    foot = P[0] + x * e_x + y * e_y
    sides = [foot + sign * np.sqrt(z2) * e_z for sign in (1.0, -1.0)]
    centre, other = sorted(sides, key=lambda side: float(np.linalg.norm(side - np.asarray(near))))
    # Differentiate ``‖centre − P_t‖² = r_t²``: ``(centre − P_t)·(δcentre − δP_t) = r_t δr_t``
    arms = centre - P
    inverse = np.linalg.inv(arms)
    return Trilateration(centre, other, inverse * r, np.einsum("it,tj->itj", inverse, arms))
