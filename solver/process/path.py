"""A path of a process: poses of the tool, the spindle axis, and forces that belong to the workpiece."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.cases import LoadCases

_LEAST_SINE: Final = 1e-3
"""Sine of the angle between feed and spindle axis, below which the feed has no direction across the axis."""


@dataclass(frozen=True, eq=False)
class ProcessPath:
    """Path of m points: poses of the flange at turn zero, and the load of the process at each point.

    The loads belong to the workpiece: a turn about the spindle leaves them as they are.
    """

    poses: FloatArray  #: (m, 4, 4) poses of the flange in R0 [m]
    spindle: FloatArray  #: (m, 3) unit vectors from spindle to tip, flange frame
    place: FloatArray  #: (m, 3) centre of the tool, on the spindle axis, flange frame [m]
    load_point: FloatArray  #: (m, 3) point where the force acts, flange frame [m]
    force: FloatArray  #: (m, 3) force on the tool, axes of R0 [N]
    moment: FloatArray  #: (m, 3) moment on the tool about the load point, axes of R0 [N·m]
    #: (m,) mask of points that the tool reaches from the point before along a line or an arc; between other
    #: points the joints move freely
    continuous: BoolArray
    #: (m, n) controller's joints of points with a given posture [rad or m]; NaN where the turn is free
    given: FloatArray
    #: (m, n) controller's joints of postures whose branch the path keeps, and whose full turns it keeps where
    #: the joints move freely [rad or m]; None for any branch
    near: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def loaded(self) -> BoolArray:
        """(m,) mask of the points with a load."""
        return np.asarray(self.force.any(axis=1) | self.moment.any(axis=1))

    @property
    def centres(self) -> FloatArray:
        """(m, 3) centres of the tool in R0 [m]."""
        rotation, origin = self.poses[:, :3, :3], self.poses[:, :3, 3]
        return np.asarray((rotation @ self.place[..., None])[..., 0] + origin)

    @property
    def axes(self) -> FloatArray:
        """(m, 3) unit vectors from spindle to tip, axes of R0."""
        return np.asarray((self.poses[:, :3, :3] @ self.spindle[..., None])[..., 0])

    def turn(self, points: IndexArray, angles: FloatArray) -> FloatArray:
        """Return poses (k, 4, 4) of the flange [m] at k points, turned about the spindle axis.

        Args:
            points: (k,) indices of points.
            angles: (k,) turns about the spindle axis, right-handed from spindle to tip [rad].
        """
        axis, centre = self.axes[points], self.centres[points]
        rotation = Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
        turned = self.poses[points].copy()
        turned[:, :3, :3] = rotation @ turned[:, :3, :3]
        turned[:, :3, 3] = (rotation @ (turned[:, :3, 3] - centre)[..., None])[..., 0] + centre
        return turned

    def cases(self, points: IndexArray, joints: FloatArray) -> LoadCases:
        """Build the load cases of k points in given postures.

        Args:
            points: (k,) indices of points.
            joints: (k, n) controller's joints [rad or m].
        """
        return LoadCases(
            joints.copy(), *(each[points] for each in (self.force, self.moment, self.load_point, self.place))
        )

    def move(self, shift: FloatArray, angle: float) -> ProcessPath:
        """Return the path of the workpiece in another place, together with its forces.

        Args:
            shift: (3,) displacement of the path's centre, the middle of its box [m].
            angle: turn about the z axis of R0 through the path's centre [rad].
        """
        transform = self.displacement(shift, angle)
        poses = transform @ self.poses
        force, moment = self.force @ transform[:3, :3].T, self.moment @ transform[:3, :3].T
        return replace(self, poses=poses, force=force, moment=moment)

    def displacement(self, shift: FloatArray, angle: float) -> FloatArray:
        """Return the displacement (4, 4) in R0 of a workpiece that `move` moves [m]."""
        transform = np.eye(4)
        transform[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
        transform[:3, 3] = self.middle + shift - transform[:3, :3] @ self.middle
        return transform

    @property
    def middle(self) -> FloatArray:
        """(3,) middle of the box that contains the free points of the path, in R0 [m]."""
        free = np.isnan(self.given[:, 0])
        centres = self.centres[free if free.any() else slice(None)]
        return np.asarray(0.5 * (centres.min(axis=0) + centres.max(axis=0)))


def find_feed_frames(centres: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the frames of feed, normal and spindle axis along a path.

    The feed at a point is the mean of the directions in which the tool comes and goes, made perpendicular to
    the spindle axis. The normal is ``axis × feed``.

    Args:
        centres: (m, 3) centres of the tool [m].
        axes: (m, 3) unit vectors from spindle to tip.

    Returns:
        (m, 3, 3) matrices with feed, normal and axis as columns, axes of R0; the first two columns are NaN
        where the tool moves along its axis only, or not at all.
    """
    steps = np.diff(centres, axis=0)
    length = np.linalg.norm(steps, axis=1, keepdims=True)
    unit = np.divide(steps, length, out=np.zeros_like(steps), where=length > 0.0)
    feed = np.zeros_like(centres)
    feed[1:] += unit
    feed[:-1] += unit
    returns = np.linalg.norm(feed, axis=1) < _LEAST_SINE  # the tool goes back where it came from
    feed[:-1][returns[:-1]] = unit[returns[:-1]]
    feed -= (feed * axes).sum(axis=1, keepdims=True) * axes
    size = np.linalg.norm(feed, axis=1, keepdims=True)
    feed = np.where(size > _LEAST_SINE, feed / np.where(size > 0.0, size, 1.0), np.nan)
    return np.stack([feed, np.cross(axes, feed), axes], axis=2)


def apply_feed_frames(frames: FloatArray, vectors: FloatArray, where: str) -> FloatArray:
    """Return vectors (m, 3) along the axes of R0, given along feed, normal and spindle axis.

    Args:
        frames: (m, 3, 3) frames of `find_feed_frames`.
        vectors: (m, 3) components along feed, normal and axis.
        where: field of the request that states the vectors, for the error.

    Raises:
        RequestError: a point needs a feed direction that it does not have.
    """
    needs_feed = vectors[:, :2].any(axis=1)
    missing = needs_feed & np.isnan(frames[:, 0, 0])
    if missing.any():
        raise RequestError(
            f"at point {int(np.argmax(missing)) + 1} the tool does not move across its axis, so the force "
            "has no direction of feed",
            where=where,
            remedy="state a force along the spindle only, or along other axes",
        )
    return np.asarray((np.nan_to_num(frames) @ vectors[..., None])[..., 0])
