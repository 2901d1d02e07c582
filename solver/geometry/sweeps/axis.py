"""A line in space with a sense, and the four numbers by which it can be wrong.

A joint's axis is a directed line: it has four degrees of freedom. `Axis` carries a frame (u, v, a) at one
of its points, a along the axis; displacements along u and v and rotations about u and v are the *chart*
in which fits step and covariances are stated. Sliding along the axis and turning about it change
nothing, so the chart is minimal and has no singularity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import FloatArray

CHART_SIZE = 4
"""Degrees of freedom of a line."""

_IDENTITY = np.eye(3)


@dataclass(frozen=True, eq=False)
class Axis:
    """A directed line. Arrays are read-only.

    The chart of an axis has the coordinates (x, y, α, β): displacement of the point along u and v [m],
    then rotation about u and v [rad].
    """

    point: FloatArray  #: (3,) a point on it [m]
    frame: FloatArray  #: (3, 3) rotation with columns u, v and the direction a

    def __post_init__(self) -> None:
        self.point.setflags(write=False)
        self.frame.setflags(write=False)

    @classmethod
    def through(cls, point: npt.ArrayLike, direction: npt.ArrayLike) -> Axis:
        """The axis through a point (3,) [m] along a direction (3,) of any length but zero."""
        a = np.array(direction, dtype=np.float64)
        a /= np.linalg.norm(a)
        helper = np.eye(3)[np.argmin(np.abs(a))]
        u = np.cross(helper, a)
        u /= np.linalg.norm(u)
        return cls(np.array(point, dtype=np.float64), np.column_stack([u, np.cross(a, u), a]))

    @property
    def direction(self) -> FloatArray:
        """Unit vector a (3,) along the axis, in the sense of positive rotation."""
        return np.asarray(self.frame[:, 2])

    def at(self, distance: float) -> FloatArray:
        """The point (3,) at this signed distance [m] from `point`, along the direction."""
        return np.asarray(self.point + distance * self.direction)

    def foot(self, point: FloatArray) -> float:
        """Signed distance [m] from `point` of the axis to the foot of the perpendicular from a point."""
        return float((point - self.point) @ self.direction)

    def slid_to(self, point: FloatArray) -> Axis:
        """The same line, stated at the foot of the perpendicular from a point (3,) [m]."""
        return Axis(self.at(self.foot(point)), self.frame)

    def displaced(self, chart: FloatArray) -> Axis:
        """The axis at these coordinates (4,) of this axis's chart."""
        angle = float(np.hypot(chart[2], chart[3]))
        about = np.array([chart[2], chart[3], 0.0]) / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        turn = _rotation(about, angle)
        return Axis(self.point + self.frame[:, :2] @ chart[:2], self.frame @ turn)

    def chart(self, other: Axis) -> FloatArray:
        """Coordinates (4,) of another axis, not perpendicular to this; inverse of `displaced`."""
        w = self.frame.T @ other.direction
        q = self.frame.T @ (other.point - self.point)
        x, y, _ = q - w * (q[2] / w[2])
        sine = float(np.hypot(w[0], w[1]))
        stretch = np.arctan2(sine, w[2]) / sine if sine > 0.0 else 1.0
        return np.array([x, y, -w[1] * stretch, w[0] * stretch])

    def sensitivity(self, distance: float) -> FloatArray:
        """Displacement (3, 4) of the point at a distance [m] with the chart, normal to the axis."""
        u, v = self.frame[:, 0], self.frame[:, 1]
        return np.column_stack([u, v, -distance * v, distance * u])

    def direction_covariance(self, covariance: FloatArray) -> FloatArray:
        """Covariance (3, 3) [rad²] of the unit vector, singular along it, from that of the chart (4, 4)."""
        u, v = self.frame[:, 0], self.frame[:, 1]
        S = np.column_stack([np.zeros((3, 2)), -v, u])
        return np.asarray(S @ covariance @ S.T)

    def moved(self, rotation: FloatArray, translation: FloatArray) -> Axis:
        """The axis after a rigid motion ``x → rotation x + translation``; charts go with it unchanged."""
        return Axis(rotation @ self.point + translation, rotation @ self.frame)

    def carried(self, by: Axis, angle: float) -> Axis:
        """The axis after a rotation by an angle [rad] about another axis."""
        return self.moved(*rotation_about(by, angle))

    def turns(self, angles: FloatArray) -> FloatArray:
        """Rotations (K, 3, 3) about the direction by angles (K,) [rad]."""
        return _rotation(self.direction, angles)

    def turned(self, turns: FloatArray, points: FloatArray) -> FloatArray:
        """Points (K, T, 3) or (T, 3) turned about the axis by rotations (K, 3, 3): (K, T, 3) [m]."""
        return np.asarray(self.point + (points - self.point) @ np.swapaxes(turns, -1, -2))

    def turned_by_chart(self, turns: FloatArray, points: FloatArray) -> FloatArray:
        """Derivative (K, T, 3, 4) of `turned` by the chart.

        A displacement δ of the axis moves the result by (1 − R) δ; a rotation ω of it, with arm r from
        its point, by ω × R r − R (ω × r).
        """
        arms = points - self.point
        first, second = self.frame[:, :2], np.cross(self.frame[:, :2].T[:, None, None], arms[None])
        by_place = np.broadcast_to((first - turns @ first)[:, None], (len(turns), points.shape[-2], 3, 2))
        after = np.cross(first.T[:, None, None], (arms @ np.swapaxes(turns, -1, -2))[None])
        before = second @ np.swapaxes(turns, -1, -2)
        return np.concatenate([by_place, np.moveaxis(after - before, 0, -1)], axis=-1)


def rotation_about(axis: Axis, angle: float) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) [m] of the rigid motion that turns about an axis.

    Args:
        axis: the axis.
        angle: in rad, positive by the right hand along the axis.
    """
    R = _rotation(axis.direction, angle)
    return R, axis.point - R @ axis.point


def _rotation(direction: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Rotation (..., 3, 3) about a unit vector by angles (...) [rad], by Rodrigues.

    SciPy's Rotation takes ten times as long for a single one, and derivatives need thousands.
    """
    x, y, z = direction.tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle), 2.0 * np.sin(0.5 * np.asarray(angle)) ** 2
    return np.asarray(_IDENTITY + (sine[..., None, None] * K + versine[..., None, None] * (K @ K)))
