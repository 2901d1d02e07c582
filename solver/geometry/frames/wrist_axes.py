"""Point nearest to the last three axes, and the distance by which they miss it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes, posed
from jointstiff.solver.robot.wrist import WRIST_JOINTS, Wrist


@dataclass(frozen=True)
class WristMiss:
    """By how much the last three axes miss a common point."""

    distance: float  #: greatest distance of one of the axes from the point nearest to them [m]
    #: of that [m]; where the distance is not beyond it, it says how large the miss may be
    standard_uncertainty: float
    probability: float  #: that axes which do meet are found so far apart

    @property
    def spherical(self) -> bool:
        """Return whether the axes meet within `Wrist.TOLERANCE`, which the decoupled method needs."""
        return self.distance <= Wrist.TOLERANCE


def nearest_to_axes(
    identified: IdentifiedAxes, posture: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], WristMiss]:
    """Find the point nearest to the last three axes, by generalised least squares.

    Args:
        identified: at least three axes.
        posture: (n,) model angles in which to look [rad]; of a spherical wrist its own do not matter.

    Returns:
        The point (3,) in the tracker's frame [m] with its derivative (3, m) by the whitened readings in units
        of sigma, and by how much the axes miss it.

    Raises:
        MeasurementError: the axes are nearly parallel.
    """
    reference = _wrist(identified.axes, posture)
    rough = _nearest(reference, np.eye(2 * WRIST_JOINTS))

    def offsets(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return _offsets(_wrist(axes, posture), rough, reference)

    V = identified.covariance_of(offsets)
    weight = np.asarray(np.linalg.inv(V), dtype=np.float64)
    centre = _nearest(reference, weight)

    def nearest(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return _nearest(_wrist(axes, posture), weight)

    def distances(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        wrist = _wrist(axes, posture)
        middle = _nearest(wrist, np.eye(2 * WRIST_JOINTS))
        return np.array([np.linalg.norm(axis.at(axis.foot(middle)) - middle) for axis in wrist])

    found = distances(identified.axes, identified.targets)
    farthest = int(np.argmax(found))
    left = _offsets(reference, centre, reference)
    miss = WristMiss(
        float(found[farthest]),
        float(np.sqrt(np.trace(V) / len(V))),
        float(stats.chi2.sf(left @ weight @ left, 2 * WRIST_JOINTS - 3)),
    )
    return (centre, identified.jacobian_of(nearest) @ identified.influence), miss


def _wrist(axes: Sequence[Axis], posture: FloatArray) -> tuple[Axis, ...]:
    return posed(axes, posture)[0][-WRIST_JOINTS:]


def _normals(axes: Sequence[Axis]) -> FloatArray:
    return np.vstack([axis.frame[:, :2].T for axis in axes])


def _offsets(axes: Sequence[Axis], point: FloatArray, reference: Sequence[Axis]) -> FloatArray:
    """Return the offsets of axes from a point, (6,) along the normals of reference axes nearby [m]."""
    gaps = [axis.at(axis.foot(point)) - point for axis in axes]
    return np.concatenate([r.frame[:, :2].T @ gap for r, gap in zip(reference, gaps, strict=True)])


def _nearest(axes: Sequence[Axis], weight: FloatArray) -> FloatArray:
    """Point of least weighted squares of its distances along two normals of each axis."""
    N = _normals(axes)
    points = np.concatenate([axis.frame[:, :2].T @ axis.point for axis in axes])
    system = N.T @ weight @ N
    scaled = system / np.trace(system)
    if np.linalg.svd(scaled, compute_uv=False)[-1] < 1e-9:
        raise MeasurementError(
            "the last three axes are nearly parallel, so there is no wrist centre",
            where="sweeps",
            remedy="use a method that needs no wrist centre",
        )
    return np.asarray(np.linalg.solve(system, N.T @ weight @ points))
