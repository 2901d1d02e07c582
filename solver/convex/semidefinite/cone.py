"""Semidefinite programs as data: a cone, a least-squares term, a penalty on traces (method.md §7).

minimise ‖R x − z‖² + λ Σ tr   subject to   x_j ≥ 0 for the first parameters, Mat(x_b) ⪰ 0 for the blocks

Symmetric matrices are vectors: the upper triangle column by column, off-diagonal entries times √2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray


@lru_cache(maxsize=64)
def entries(size: int) -> tuple[IndexArray, IndexArray]:
    """Rows and columns (size (size + 1) / 2,) of the entries: (0,0), (0,1), (1,1), (0,2), ...

    The order that Clarabel's triangle cone has.
    """
    lower_rows, lower_columns = np.tril_indices(size)
    for indices in (lower_rows, lower_columns):
        indices.setflags(write=False)
    return lower_columns, lower_rows


@lru_cache(maxsize=64)
def weights(size: int) -> FloatArray:
    """1 for diagonal entries and √2 for the others, so that vectors have the matrices' inner product."""
    rows, columns = entries(size)
    weights: FloatArray = np.where(rows == columns, 1.0, np.sqrt(2.0))
    weights.setflags(write=False)
    return weights


def diagonal(size: int) -> IndexArray:
    """(size,) places of the diagonal entries in the vector."""
    rows, columns = entries(size)
    return np.flatnonzero(rows == columns)


def to_matrix(vector: FloatArray, size: int) -> FloatArray:
    """(..., size, size) of vectors (..., size (size + 1) / 2)."""
    rows, columns = entries(size)
    out = np.empty((*vector.shape[:-1], size, size))
    out[..., rows, columns] = out[..., columns, rows] = vector / weights(size)
    return out


def to_vector(matrix: FloatArray) -> FloatArray:
    """(..., size (size + 1) / 2) of symmetric matrices (..., size, size)."""
    size = matrix.shape[-1]
    rows, columns = entries(size)
    vector: FloatArray = matrix[..., rows, columns] * weights(size)
    return vector


_NEAR_LEAST_SQUARES: Final = 1e-6
"""Singular values below this part of the first are left out of the point the program is stated around."""


@dataclass(frozen=True)
class Cone:
    """Layout of the parameters."""

    nonnegative: int  #: how many of the first are zero or positive
    sizes: tuple[int, ...] = ()  #: sizes of the blocks that follow, each a symmetric matrix as a vector

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return self.nonnegative + sum(size * (size + 1) // 2 for size in self.sizes)

    def blocks(self) -> Iterator[tuple[int, slice]]:
        """Size and place of each block."""
        start = self.nonnegative
        for size in self.sizes:
            stop = start + size * (size + 1) // 2
            yield size, slice(start, stop)
            start = stop

    def least(self, x: FloatArray) -> float:
        """Least of the scalars and of the blocks' eigenvalues; inf of nothing."""
        values = [
            x[: self.nonnegative],
            *(np.linalg.eigvalsh(to_matrix(x[place], size)) for size, place in self.blocks()),
        ]
        return float(min((value.min() for value in values if len(value)), default=np.inf))

    def project(self, x: FloatArray) -> FloatArray:
        """The nearest point of the cone, whose computed eigenvalues are not below zero either."""
        out = np.maximum(x, 0.0)
        for size, place in self.blocks():
            eigenvalues, vectors = np.linalg.eigh(to_matrix(x[place], size))
            kept = np.maximum(eigenvalues, 0.0)
            out[place] = raised(to_vector((vectors * kept) @ vectors.T), size)
        return out


def raised(vector: FloatArray, size: int) -> FloatArray:
    """A block with as much added to its diagonal as it takes for no computed eigenvalue to be negative.

    It is rounding, of a few parts in 10¹⁶ of the greatest eigenvalue.
    """
    lift = np.finfo(float).eps * float(np.abs(vector).max(initial=0.0))
    raised_vector = vector
    while np.linalg.eigvalsh(to_matrix(raised_vector, size)).min() < 0.0:
        raised_vector = vector.copy()
        raised_vector[diagonal(size)] += lift
        lift *= 2.0
    return raised_vector


def feasible_dual(
    cone: Cone, penalised: BoolArray, rows: FloatArray, dual: FloatArray, penalty: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Move multipliers ν of the residuals so that the slack ``p + Aᵀν`` is near the dual cone.

    The free scalars' slacks are not negative then; shrunk by ``λ / (λ + outside)`` those of the blocks are
    not either, which a penalty λ > 0 allows.

    Args:
        cone: of the parameters.
        penalised: (nonnegative,) which of the scalars have a penalty; the others are free.
        rows: A (m, p).
        dual: (m,) ν, near a feasible one.
        penalty: p (p,).

    Returns:
        ν (m,), ``Aᵀν`` (p,), and how far the least penalised slack is below zero.
    """
    free = rows[:, np.flatnonzero(~penalised)].T
    short = np.maximum(-(free @ dual), 0.0)
    if short.any():
        dual = dual + np.linalg.lstsq(free, short, rcond=None)[0]
    pull = rows.T @ dual
    slack = pull + penalty
    least = [float(np.linalg.eigvalsh(to_matrix(slack[place], size)).min()) for size, place in cone.blocks()]
    least += slack[: cone.nonnegative][penalised].tolist()
    return dual, pull, max(0.0, -min(least, default=0.0))


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """The quadratic part, shared by programs with other penalties."""

    R: FloatArray  #: (m, p) regressor; columns of parameters without a penalty have unit norm
    z: FloatArray  #: (m,) readings of unit norm

    @cached_property
    def near(self) -> FloatArray:
        """(p,) a point near the least-squares solution, of moderate size."""
        return np.asarray(np.linalg.lstsq(self.R, self.z, rcond=_NEAR_LEAST_SQUARES)[0])

    @cached_property
    def compressed(self) -> tuple[FloatArray, FloatArray]:
        """Upper triangle T (k, p) and y (k,) with ‖T x − y‖² = ‖R x − z‖² but for a constant."""
        p = self.R.shape[1]
        both = np.asarray(np.linalg.qr(np.column_stack([self.R, self.z]), mode="r"), dtype=np.float64)
        return both[:p, :p], both[:p, p]

    def gradient_at(self, x: FloatArray) -> FloatArray:
        """(p,) of ‖R x − z‖²."""
        gradient: FloatArray = 2.0 * self.R.T @ (self.R @ x - self.z)
        return gradient


@dataclass(frozen=True, eq=False)
class SemidefiniteProgram:
    """The program as data."""

    fit: LeastSquares  #: quadratic part
    cone: Cone  #: cone of the parameters
    weight: float  #: λ > 0; it penalises the traces of all blocks, and the scalars in `penalised`
    penalised: BoolArray  #: (nonnegative,) which of the scalars, the others' columns being independent

    @cached_property
    def penalty(self) -> FloatArray:
        """P (p,): λ for the penalised scalars and on the diagonals of the blocks."""
        return trace_penalty(self.cone, self.penalised, self.weight)

    def slack(self, x: FloatArray) -> FloatArray:
        """(p,) gradient of the objective: in the dual cone, and orthogonal to x, at the optimum."""
        return self.fit.gradient_at(x) + self.penalty


def trace_penalty(cone: Cone, penalised: BoolArray, weight: float) -> FloatArray:
    """(p,) λ for the penalised scalars and on the diagonals of the blocks."""
    out = np.zeros(cone.dimension)
    out[: cone.nonnegative][penalised] = weight
    for size, place in cone.blocks():
        out[place][diagonal(size)] = weight
    return out
