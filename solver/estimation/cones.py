"""Cones of parameters: scalars that are zero or positive, and positive semidefinite matrices as vectors.

Symmetric matrices are vectors: the upper triangle column by column, off-diagonal entries times √2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.mechanics.springs import entries, weights


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
    return np.asarray(matrix[..., rows, columns] * weights(size))


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


@dataclass(frozen=True)
class Cone:
    """Layout of the parameters."""

    nonnegative: int  #: how many of the first are zero or positive
    sizes: tuple[int, ...] = ()  #: sizes of the blocks that follow, each a symmetric matrix as a vector
    penalised: int = 0  #: how many of the scalars, the last ones, have a penalty as the blocks' traces have

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return self.nonnegative + sum(size * (size + 1) // 2 for size in self.sizes)

    @property
    def free(self) -> int:
        """Number of the first scalars, those without a penalty."""
        return self.nonnegative - self.penalised

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

    def penalty(self, weight: float) -> FloatArray:
        """(p,) the weight λ for the penalised scalars and on the diagonals of the blocks."""
        out = np.zeros(self.dimension)
        out[self.free : self.nonnegative] = weight
        for size, place in self.blocks():
            out[place][diagonal(size)] = weight
        return out


@dataclass(frozen=True)
class Block:
    """Unknowns of one joint: c, then the boxes' ζ, then three ν for each ball."""

    boxes: int  #: number of ζ
    #: for each ball: index of the ζ by which its radius grows, −1 for none, and by how much in addition to c
    balls: tuple[tuple[int, float], ...] = ()

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return 1 + self.boxes + 3 * len(self.balls)
