"""Rule that readings are taken in distinct postures, and what it lets any list reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray

_PARTITIONS: Final = 8
"""Partitions of the postures into cells that are tried; each gives a bound, and the sharpest counts."""
_LOOKED_AT: Final = 4_000
"""Candidates of the best prices whose cells are compared; the others are bounded by the last of them."""
_INSIDE: Final = 1.0 - 1e-9
"""Share of the angle that a cell is wide, so that rounding puts no two distinct postures into one."""


@dataclass(frozen=True, eq=False)
class Distinct:
    """Rule that no two readings are taken in nearly the same posture."""

    postures: FloatArray  #: (N, n) joint angles of the candidates [rad]
    #: two postures are distinct if the angle of a joint differs by at least this [rad]; zero lets a
    #: candidate be read again
    angle: float

    def near(self, posture: FloatArray, index: IndexArray | slice) -> BoolArray:
        """Return which of some candidates are not distinct from a posture (n,)."""
        if self.angle <= 0.0:
            return np.zeros(len(self.postures[index]), dtype=np.bool_)
        near: BoolArray = np.abs(self.postures[index] - posture).max(axis=1) < self.angle
        return near

    def best_mean(self, prices: FloatArray, count: int) -> float:
        """Bound the mean price of any list of distinct readings.

        Two postures in one cell of a grid narrower than the angle are not distinct, so a list has at most one
        reading of each cell: the mean of the greatest prices of as many cells bounds it, whatever the grid.

        Args:
            prices: (N,).
            count: readings in a list.
        """
        if self.angle <= 0.0:
            return float(prices.max())
        looked_at = min(max(_LOOKED_AT, 10 * count), len(prices))
        top = np.argpartition(prices, len(prices) - looked_at)[-looked_at:]
        top = top[np.argsort(-prices[top])]
        random = np.random.default_rng(0)
        shifts = self.angle * random.random((_PARTITIONS, self.postures.shape[1]))
        return min(self._mean_of_cells(top, prices[top], count, shift) for shift in shifts)

    def _mean_of_cells(self, top: IndexArray, prices: FloatArray, count: int, shift: FloatArray) -> float:
        """Return the mean of the greatest prices of cells; top are candidates by falling price."""
        cells = np.floor((self.postures[top] + shift) / (_INSIDE * self.angle)).astype(np.int64)
        seen: set[bytes] = set()
        total = 0.0
        for cell, price in zip(cells, prices.tolist(), strict=True):
            if (key := cell.tobytes()) not in seen:
                seen.add(key)
                total += price
                if len(seen) == count:
                    return float(total) / count
        rest = float(prices[-1]) if len(top) < len(self.postures) else 0.0
        return float(total + (count - len(seen)) * rest) / count
