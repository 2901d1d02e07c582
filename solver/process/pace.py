"""Pace of a process: the feed, and how fast joints and tool may turn along the path.

For a feed v a joint of speed q̇_max may move by ``|dq/ds| ≤ η q̇_max / v`` for a length s of the path, and the
tool may turn by ``|dφ/ds| ≤ ρ``. Where feed or speed is unknown, no joint moves faster than ρ either.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray

RATE: Final = float(np.radians(1.0) * 1e3)
"""Greatest turn of the tool for a length of the path, unless the request states another [rad/m]."""
PART: Final = 0.5
"""Part of a joint's speed that turning may use: the rest is the controller's."""
ROOM: Final = 0.8
"""Part of the limits that turning may use near corners of the load: the rest is the correction's."""
REFERENCE_FEED: Final = 0.05
"""Feed for which needed speeds are stated if no feed is known [m/s]."""


@dataclass(frozen=True, eq=False)
class Pace:
    """Feed of the tool along a path of m points, and limits of the speeds there."""

    feed: FloatArray  #: (m,) speed of the tool's centre on the line to each point [m/s]; NaN if unknown
    speeds: FloatArray  #: (n,) greatest speeds of the model's joints [rad/s or m/s]; NaN if unknown
    rate: float = RATE  #: greatest turn about the spindle for a length of the path [rad/m]
    part: float | FloatArray = PART  #: part of the joints' speeds that may be used, or (m,) on each line

    def limits(self) -> FloatArray:
        """Return the greatest motion (m, n) of each joint for a length of the path [rad/m or m/m]."""
        limits = self._parts[:, None] * self.speeds / self.feed[:, None]
        return np.where(np.isnan(limits), self.rate, limits)

    @property
    def _parts(self) -> FloatArray:
        """(m,) part of the joints' speeds that may be used on the line to each point."""
        return np.broadcast_to(np.asarray(self.part, dtype=np.float64), self.feed.shape)

    def leave_room(self, lines: BoolArray) -> Pace:
        """Return a pace that leaves room for a correction that changes on some lines (m,)."""
        return replace(self, part=np.where(lines, ROOM, 1.0) * self._parts)

    def shares(self, motion: FloatArray) -> FloatArray:
        """Return the parts (m, n) of the joints' speeds that motions (m, n) for a length [rad/m] need.

        Without a feed, the shares are those at `REFERENCE_FEED`; NaN for joints of unknown speed.
        """
        feed = np.where(np.isnan(self.feed), REFERENCE_FEED, self.feed)
        return np.asarray(np.abs(motion) * feed[:, None] / self.speeds)

    def select(self, points: IndexArray) -> Pace:
        """Return the pace of some points (k,): longer lines, each with its greatest feed and least part."""
        feed = np.where(np.isnan(self.feed), -1.0, self.feed)
        starts = np.append(0, points[:-1] + 1) if len(points) else points
        starts = np.minimum(starts, points)
        greatest = np.maximum.reduceat(feed, starts)
        part = np.minimum.reduceat(self._parts, starts)
        return Pace(np.where(greatest < 0.0, np.nan, greatest), self.speeds, self.rate, part)
