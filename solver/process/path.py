"""A path of a process: poses of the tool, the spindle axis, and forces that belong to the workpiece."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import rotation_vectors

_REST: Final = 1e-9
"""Distance of two centres of the tool below which the tool rests [m]."""
_LEVER: Final = 0.1
"""Length of the path for a turn of 1 rad of a tool that rests [m]."""
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
    centre: FloatArray | None = None  #: (3,) `middle`, if the path is a part of another [m]; None otherwise

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

    @property
    def moves(self) -> BoolArray:
        """(m,) mask of the points to which a line leads along which the tool's centre moves."""
        distance = np.linalg.norm(np.diff(self.centres, axis=0), axis=1)
        return np.asarray(self.continuous & np.append(False, distance > _REST))

    @cached_property
    def steps(self) -> FloatArray:
        """(m,) length of the line that leads to each point [m]; zero without a line.

        A tool that turns at rest gets a length of its own, so that the motion takes time.
        """
        distance = np.linalg.norm(np.diff(self.centres, axis=0), axis=1)
        rotation = self.poses[:, :3, :3]
        turn = np.linalg.norm(rotation_vectors(rotation[1:], rotation[:-1]), axis=1)
        steps = np.append(0.0, np.where(distance > _REST, distance, _LEVER * turn))
        steps[~self.continuous] = 0.0
        steps[steps <= _REST] = 0.0
        return steps

    @cached_property
    def lengths(self) -> FloatArray:
        """(m,) length of the lines from the first point to each point [m]."""
        return np.cumsum(self.steps)

    @cached_property
    def stretches(self) -> list[slice]:
        """Parts of the path that the tool follows along lines, in order."""
        starts = np.flatnonzero(~self.continuous)
        starts = np.union1d(0, starts)
        ends = np.append(starts[1:], len(self))
        return [slice(first, last) for first, last in zip(starts.tolist(), ends.tolist(), strict=True)]

    @cached_property
    def weights(self) -> FloatArray:
        """(m,) weights of the points that count, with the sum 1: half of the lines to and from each point.

        Points with a load count, or all points if no point has a load. A point without a line has the mean
        weight of the others.
        """
        counted = self.loaded if self.loaded.any() else np.ones(len(self), dtype=np.bool_)
        weights = 0.5 * (self.steps + np.append(self.steps[1:], 0.0))
        weights = np.where(counted, weights, 0.0)
        has_length = weights > 0.0
        mean = weights[has_length].mean() if has_length.any() else 1.0
        weights[counted & ~has_length] = mean
        return np.asarray(weights / weights.sum())

    def select(self, points: IndexArray) -> ProcessPath:
        """Return the path of some points (k,) in their order.

        A kept point is reached along lines if all points since the kept point before are.
        """
        broken = np.cumsum(~self.continuous)
        lines = np.append(False, broken[points[1:]] == broken[points[:-1]])
        names = ["poses", "spindle", "place", "load_point", "force", "moment", "given"]
        names += [] if self.near is None else ["near"]
        return replace(self, continuous=lines, **{name: getattr(self, name)[points] for name in names})

    def interpolate(self, last: IndexArray, fraction: FloatArray) -> ProcessPath:
        """Return the path of k places on the lines between points; each place is a point without a line.

        Args:
            last: (k,) points to which the lines lead.
            fraction: (k,) part of the line before the place.
        """
        before, part = np.maximum(last - 1, 0), fraction[:, None]
        start, end = self.poses[before, :3, :3], self.poses[last, :3, :3]
        poses = np.tile(np.eye(4), (len(last), 1, 1))
        turn = Rotation.from_rotvec(part * rotation_vectors(end, start)).as_matrix()
        poses[:, :3, :3] = turn @ start
        place = self.place[last]
        centre = (1.0 - part) * self.centres[before] + part * self.centres[last]
        poses[:, :3, 3] = centre - (poses[:, :3, :3] @ place[..., None])[..., 0]
        loads = {
            name: (1.0 - part) * getattr(self, name)[before] + part * getattr(self, name)[last]
            for name in ("force", "moment")
        }
        tools = {name: getattr(self, name)[last] for name in ("spindle", "place", "load_point", "given")}
        no_line = np.zeros(len(last), dtype=np.bool_)
        near = None if self.near is None else self.near[last]
        return replace(self, poses=poses, continuous=no_line, near=near, **loads, **tools)

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
        centre = None if self.centre is None else self.centre + shift
        return replace(self, poses=poses, force=force, moment=moment, centre=centre)

    def displacement(self, shift: FloatArray, angle: float) -> FloatArray:
        """Return the displacement (4, 4) in R0 of a workpiece that `move` moves [m]."""
        transform = np.eye(4)
        transform[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
        transform[:3, 3] = self.middle + shift - transform[:3, :3] @ self.middle
        return transform

    @property
    def middle(self) -> FloatArray:
        """(3,) point about which the workpiece turns, in R0 [m].

        The point is `centre` if stated, or else the middle of the box around the points whose joints are not
        given; around all points if the joints of each point are given.
        """
        if self.centre is not None:
            return self.centre
        has_no_given_joints = np.isnan(self.given[:, 0])
        points = self.centres[has_no_given_joints if has_no_given_joints.any() else slice(None)]
        return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def find_feed_frames(
    centres: FloatArray, axes: FloatArray, continuous: BoolArray, middles: BoolArray | None = None
) -> FloatArray:
    """Return the frames of feed, normal and spindle axis along a path.

    The feed at a point is the mean of the directions in which the tool comes and goes, made perpendicular to
    the spindle axis. Where the tool rests, both are those before and after the rest. A motion of the joints
    has no feed. The normal is ``axis × feed``.

    Args:
        centres: (m, 3) centres of the tool [m].
        axes: (m, 3) unit vectors from spindle to tip.
        continuous: (m,) mask of points that are reached from the point before along a line or an arc.
        middles: (m,) mask of points between start and end of an arc; None for lines only.

    Returns:
        (m, 3, 3) matrices with feed, normal and axis as columns, axes of R0; the first two columns are NaN
        where the tool moves along its axis only, or not at all.
    """
    come, go = _find_directions(centres, continuous, middles)
    feed = come + go
    returns = np.linalg.norm(feed, axis=1) < _LEAST_SINE  # the tool goes back where it came from
    feed[returns] = go[returns]
    feed -= (feed * axes).sum(axis=1, keepdims=True) * axes
    size = np.linalg.norm(feed, axis=1, keepdims=True)
    feed = np.where(size > _LEAST_SINE, feed / np.where(size > 0.0, size, 1.0), np.nan)
    return np.stack([feed, np.cross(axes, feed), axes], axis=2)


def _find_directions(
    centres: FloatArray, continuous: BoolArray, middles: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the directions in which the tool comes to m points and goes from them; zero without a line.

    Arguments are those of `find_feed_frames`. Both results are (m, 3) unit vectors.
    """
    steps = np.diff(centres, axis=0)
    length = np.linalg.norm(steps, axis=1, keepdims=True)
    unit = np.divide(steps, length, out=np.zeros_like(steps), where=length > 0.0)
    first, last = unit, unit.copy()  # (m − 1, 3) directions at the start and at the end of each step
    if middles is not None and (at := np.flatnonzero(middles[1:-1]) + 1).size:
        tangents = _find_arc_tangents(centres[at - 1], centres[at], centres[at + 1])
        first = unit.copy()
        first[at - 1], last[at - 1] = tangents[0], tangents[1]
        first[at], last[at] = tangents[1], tangents[2]
    come, go = np.zeros_like(centres), np.zeros_like(centres)
    moves = (length[:, 0] > 0.0) & continuous[1:]
    if moves.any():
        run = np.cumsum(~continuous)  # number of the line of points without a motion of the joints
        number = np.arange(len(steps))
        before = np.maximum.accumulate(np.where(moves, number, -1))
        after = np.minimum.accumulate(np.where(moves, number, len(steps))[::-1])[::-1]
        known = (before >= 0) & (run[before] == run[1:])
        come[1:][known] = last[before[known]]
        known = after < len(steps)
        known[known] = run[after[known]] == run[:-1][known]
        go[:-1][known] = first[after[known]]
    return come, go


def _find_arc_tangents(start: FloatArray, middle: FloatArray, end: FloatArray) -> FloatArray:
    """Return unit tangents (3, k, 3) of arcs at their starts, middles and ends (k, 3); chords of lines."""
    to_middle, to_end = middle - start, end - start
    normal = np.cross(to_middle, to_end)
    square = np.square(normal).sum(axis=1, keepdims=True)
    flat = square[:, 0] <= 1e-18 * np.square((to_middle * to_end).sum(axis=1))
    radius = np.cross(
        np.square(to_middle).sum(axis=1, keepdims=True) * to_end
        - np.square(to_end).sum(axis=1, keepdims=True) * to_middle,
        normal,
    ) / np.where(flat[:, None], 1.0, 2.0 * square)  # from the start to the centre
    tangents = np.stack([np.cross(normal, at - start - radius) for at in (start, middle, end)])
    chords = np.stack([to_middle, to_end, end - middle])
    tangents = np.where(flat[None, :, None], chords, tangents)
    size = np.linalg.norm(tangents, axis=2, keepdims=True)
    return np.asarray(np.divide(tangents, size, out=np.zeros_like(tangents), where=size > 0.0))


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
            f"at point {int(np.argmax(missing)) + 1} no line or arc moves the tool across its axis, so the "
            "force has no direction of feed",
            where=where,
            remedy="state the lines of the cut, a force along the spindle only, or a force along other axes",
        )
    return np.asarray((np.nan_to_num(frames) @ vectors[..., None])[..., 0])
