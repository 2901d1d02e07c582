"""Deflections in the wrong row or under the wrong name, told by what the springs make of the others."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.springs import Springs

Rows = IndexArray

BETTER: Final = 0.5
"""Ratio of residuals, corrected to as posted, below which a row is taken for a mistake."""
LEAST_ROWS: Final = 3
"""Least number of rows that one shift must explain: one may match its neighbour by chance, two may be
exchanged."""


@dataclass(frozen=True, eq=False)
class Shift:
    """Rows whose deflections belong to a neighbour."""

    rows: Rows  #: (K,) which
    by: int  #: -1 if they belong to the row before, 1 for the row after


def find_shift(deflection: FloatArray, springs: Springs) -> Shift | None:
    """Rows in a row whose deflections fit the neighbour's prediction better by far.

    Args:
        deflection: (N, T, 3) as posted [m].
        springs: fitted to most of the rows.

    Returns:
        The longest run, or None.
    """
    own = _norms(springs.residual)
    best: Shift | None = None
    for by in (-1, 1):
        other = _norms(deflection - np.roll(springs.predicted, -by, axis=0))
        better = other < BETTER * own
        better[0 if by < 0 else -1] = False  # the neighbour of the end is not beside it
        run = _longest_run(better)
        if len(run) >= LEAST_ROWS and (best is None or len(run) > len(best.rows)):
            best = Shift(run, by)
    return best


def exchanged_pair(
    deflection: FloatArray, predicted: FloatArray, present: BoolArray
) -> tuple[int, int] | None:
    """Two targets of an observation whose deflections fit better by far under each other's name.

    Args:
        deflection: (T, 3) [m].
        predicted: (T, 3) [m].
        present: (T,) which were read.
    """
    read = np.flatnonzero(present)
    posted = float(np.linalg.norm(deflection[read] - predicted[read]))
    best, least = None, BETTER * posted
    for a, b in combinations(read.tolist(), 2):
        order = np.arange(len(present))
        order[[a, b]] = b, a
        left = float(np.linalg.norm(deflection[order][read] - predicted[read]))
        if left < least:
            best, least = (a, b), left
    return best


def _longest_run(marked: BoolArray) -> Rows:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    if not len(edges):
        return np.empty(0, dtype=np.intp)
    starts, ends = edges[::2], edges[1::2]
    k = int((ends - starts).argmax())
    return np.arange(starts[k], ends[k])


def _norms(rows: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(rows.reshape(len(rows), -1), axis=1))
