"""Frames of feed, normal and spindle axis along the path of a tool."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError

_LEAST_SINE: Final = 1e-3
"""Sine of the angle between feed and spindle axis, below which the feed has no direction across the axis."""


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
