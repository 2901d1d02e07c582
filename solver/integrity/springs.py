"""The deflections as any springs in the joints would make them: a robust fit without bounds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.view import median
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import whole_block

_ROUNDS: Final = 8
_NULL: Final = 1e-9
"""Norm of a column, relative to the largest, below which no load twists its joint."""
_RIDGE: Final = 1e-9
"""Regularisation, relative to unit columns: combinations that no load shows stay near zero."""
_SAMPLE: Final = 2000
"""Number of observations that determine a few compliances well enough to judge all by them."""


BETTER: Final = 0.5
"""Ratio of residuals, corrected to as posted, below which a row is taken for a mistake."""
LEAST_ROWS: Final = 3
"""Least number of rows that one shift must explain: one may match its neighbour by chance, two may be
exchanged."""
_ALL: Final = slice(None)


@dataclass(frozen=True, eq=False)
class Springs:
    """A fit of N observations of T targets."""

    predicted: FloatArray  #: (N, T, 3) deflections [m]; zero where not read
    residual: FloatArray  #: (N, T, 3) measured less predicted [m]
    work: float  #: work of the load, as predicted, summed over the observations [J]; springs make it positive
    parameters: int  #: joints that were fitted
    unexplained: float  #: median residual of an observation over its median deflection


@dataclass(frozen=True, eq=False)
class SpringModel:
    """The deflections that compliances make of N observations, linear in them (method.md §2)."""

    A: FloatArray  #: (N, T, 3, n) [m / (rad/(N·m))]; zero where not read
    torque: FloatArray  #: (N, n) torque of the loads [N·m]
    deflection: FloatArray  #: (N, T, 3) as measured [m]

    @classmethod
    def of(cls, robot: Robot, measurements: Measurements) -> SpringModel:
        """Compute the regressor."""
        block = whole_block(robot, measurements)
        return cls(block.A, block.torque, measurements.deflection)

    def fit(self, rows: slice = _ALL, shift: int = 0) -> Springs:
        """Fit compliances of either sign, by sums of distances rather than of squares.

        So some mistakes move them little.

        Args:
            rows: which deflections are fitted; all are predicted.
            shift: by how many rows the loads and postures that they belong to lie after them.
        """
        chosen = np.arange(len(self.A))[rows]
        chosen = chosen[(chosen + shift >= 0) & (chosen + shift < len(self.A))]
        chosen = chosen[:: max(1, -(-len(chosen) // _SAMPLE))]
        compliance = _least_distances(
            self.A[chosen + shift].reshape(len(chosen), -1, self.A.shape[-1]),
            self.deflection[chosen].reshape(len(chosen), -1),
        )
        predicted = self.A @ compliance
        residual = self.deflection - predicted
        left, moved = (median(norms(x)) for x in (residual, self.deflection))
        return Springs(
            predicted=predicted,
            residual=residual,
            work=float((self.torque**2).sum(axis=0) @ compliance),
            parameters=int(np.count_nonzero(compliance)),
            unexplained=left / moved if moved else 0.0,
        )


def _least_distances(A: FloatArray, d: FloatArray) -> FloatArray:
    """Compliances (n,) that minimise the sum of the observations' distances ‖d_i − A_i c‖, by reweighting."""
    norms = np.sqrt((A**2).sum(axis=(0, 1)))
    visible = np.flatnonzero(norms > _NULL * norms.max()) if norms.max() > 0.0 else np.empty(0, np.intp)
    compliance = np.zeros(A.shape[-1])
    if not len(visible):
        return compliance
    scaled = A[..., visible] / norms[visible]
    gram, moment = scaled.transpose(0, 2, 1) @ scaled, np.einsum("kij,ki->kj", scaled, d)
    weight, held = np.ones(len(d)), _RIDGE / len(d) * np.eye(len(visible))
    for _ in range(_ROUNDS):
        G = np.einsum("k,kij->ij", weight, gram) / weight.sum()
        x = np.linalg.solve(G + held, weight @ moment / weight.sum())
        distance = np.linalg.norm(d - scaled @ x, axis=1)
        weight = 1.0 / np.maximum(distance, max(1e-3 * median(distance), 1e-12))
    compliance[visible] = x / norms[visible]
    return compliance


@dataclass(frozen=True, eq=False)
class Shift:
    """Rows whose deflections belong to a neighbour."""

    rows: IndexArray  #: (K,) which
    by: int  #: -1 if they belong to the row before, 1 for the row after


def find_shift(deflection: FloatArray, springs: Springs) -> Shift | None:
    """Rows in a row whose deflections fit the neighbour's prediction better by far.

    Args:
        deflection: (N, T, 3) as posted [m].
        springs: fitted to most of the rows.

    Returns:
        The longest run, or None.
    """
    own = norms(springs.residual)
    best: Shift | None = None
    for by in (-1, 1):
        other = norms(deflection - np.roll(springs.predicted, -by, axis=0))
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


def _longest_run(marked: BoolArray) -> IndexArray:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    if not len(edges):
        return np.empty(0, dtype=np.intp)
    starts, ends = edges[::2], edges[1::2]
    k = int((ends - starts).argmax())
    return np.arange(starts[k], ends[k])


def norms(rows: FloatArray) -> FloatArray:
    """Return the lengths (N,) of all that belongs to each observation."""
    return np.asarray(np.linalg.norm(rows.reshape(len(rows), -1), axis=1))
