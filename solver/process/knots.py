"""Knots of a path: the points at which turns are chosen, by length and corners, not by number of points."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.process.pace import REFERENCE_FEED, Pace
from jointstiff.solver.process.path import ProcessPath

_TIME: Final = 0.2
"""Time from a knot to the next [s]."""
_LEAST, _GREATEST = 0.005, 0.03
"""Bounds of the distance of knots [m]."""
_CORNER: Final = float(np.cos(np.radians(20.0)))
"""Cosine of the angle between two lines beyond which their common point is a corner."""
MOST_KNOTS: Final = 1_500
"""Number of knots by length along a path: on longer paths the knots are farther apart."""


def find_spacing(path: ProcessPath, pace: Pace, turn: float) -> float:
    """Return the greatest distance of knots [m]: the tool can turn by two steps of `turn` [rad] within it."""
    known = pace.feed[~np.isnan(pace.feed)]
    feed = float(np.median(known)) if len(known) else REFERENCE_FEED
    spacing = float(np.clip(max(_TIME * feed, 2.0 * turn / pace.rate), _LEAST, _GREATEST))
    return max(spacing, float(path.lengths[-1]) / MOST_KNOTS)


def find_knots(path: ProcessPath, spacing: float, first: IndexArray) -> IndexArray:
    """Return the indices (k,) of the knots of a path, in order.

    The ends of lines, corners, changes of the load, points with given joints and points that are the same
    target are knots, and others so that the distance is at most `spacing` [m], if the points permit this.

    Args:
        path: path of m points.
        spacing: greatest distance of knots [m].
        first: (m,) index of the first point that is the same target, for each point.
    """
    fixed = find_corners(path) | ~np.isnan(path.given[:, 0])
    changes = path.loaded[1:] != path.loaded[:-1]
    fixed[1:] |= changes
    fixed[:-1] |= changes
    fixed |= np.bincount(first, minlength=len(path))[first] > 1
    knots = set[int]()
    for part in path.stretches:
        inner = np.flatnonzero(fixed[part]) + part.start
        ends = np.unique(np.concatenate([[part.start], inner, [part.stop - 1]]))
        knots.update(ends.tolist())
        for begin, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            knots.update(_divide(path.lengths, begin, end, spacing))
    chosen = np.array(sorted(knots), dtype=np.intp)
    rests = np.append(False, path.lengths[chosen[1:]] <= path.lengths[chosen[:-1]])
    return chosen[~(rests & path.continuous[chosen] & ~fixed[chosen])]


def _divide(lengths: FloatArray, begin: int, end: int, spacing: float) -> list[int]:
    """Return points between two points whose distances along the path are at most `spacing`, if possible."""
    count = int(np.ceil((lengths[end] - lengths[begin]) / spacing - 1e-6))
    wanted = np.linspace(lengths[begin], lengths[end], count + 1)[1:-1] if count > 1 else np.zeros(0)
    after = np.clip(np.searchsorted(lengths[begin : end + 1], wanted), 1, max(end - begin, 1)) + begin
    is_nearer_before = wanted - lengths[after - 1] < lengths[after] - wanted
    found: list[int] = np.where(is_nearer_before, after - 1, after).tolist()
    return found


def find_corners(path: ProcessPath) -> BoolArray:
    """Return a mask (m,) of the points at which the direction of the path changes by more than 20°."""
    steps = np.diff(path.centres, axis=0)
    size = np.linalg.norm(steps, axis=1, keepdims=True)
    unit = np.divide(steps, size, out=np.zeros_like(steps), where=size > 1e-9)
    corners = np.zeros(len(path), dtype=np.bool_)
    corners[1:-1] = (unit[1:] * unit[:-1]).sum(axis=1) < _CORNER
    return corners & path.continuous
