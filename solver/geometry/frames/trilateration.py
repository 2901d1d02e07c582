"""A point from its distances to three targets (paper, eqs 13-20), with its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError

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
    return _with_derivatives(P, r, centre, other)


def _with_derivatives(P: FloatArray, r: FloatArray, centre: FloatArray, other: FloatArray) -> Trilateration:
    """Differentiate ``‖centre − P_t‖² = r_t²``: ``(centre − P_t)·(δcentre − δP_t) = r_t δr_t``."""
    arms = centre - P
    inverse = np.linalg.inv(arms)
    return Trilateration(centre, other, inverse * r, np.einsum("it,tj->itj", inverse, arms))


@dataclass(frozen=True, eq=False)
class CentreSpread:
    """Distances of several centres of one wrist from their barycentre (paper, Table I)."""

    barycentre: FloatArray  #: (3,) [m]
    offsets: tuple[float, ...]  #: distance of each from it [m]


def spread_of(centres: Sequence[npt.ArrayLike]) -> CentreSpread:
    """Barycentre of centres (3,) each, in any unit, and their distances from it in the same."""
    points = np.array(centres, dtype=np.float64)
    barycentre = points.mean(axis=0)
    distances = np.linalg.norm(points - barycentre, axis=1)
    return CentreSpread(barycentre, tuple(float(distance) for distance in distances))
