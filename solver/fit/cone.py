"""Cones of parameters: scalars that are zero or positive, and positive semidefinite matrices as vectors.

The vector of a symmetric matrix has the upper triangle column by column, with off-diagonal entries times √2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.mechanics.springs import triangle_indices, triangle_weights


def find_diagonal_entries(size: int) -> IndexArray:
    """Return the indices (size,) of a matrix's diagonal entries in the vector of its upper triangle."""
    rows, columns = triangle_indices(size)
    return np.flatnonzero(rows == columns)


def to_matrix(vector: FloatArray, size: int) -> FloatArray:
    """Return the symmetric matrices (..., size, size) of vectors (..., size (size + 1) / 2).

    A vector has the upper triangle column by column, with off-diagonal entries times √2.
    """
    rows, columns = triangle_indices(size)
    upper_triangle = vector / triangle_weights(size)
    matrix = np.empty((*vector.shape[:-1], size, size))
    matrix[..., rows, columns] = upper_triangle
    matrix[..., columns, rows] = upper_triangle
    return matrix


def to_vector(matrix: FloatArray) -> FloatArray:
    """Return symmetric matrices (..., size, size) as vectors (..., size (size + 1) / 2).

    A vector has the upper triangle column by column, with off-diagonal entries times √2, so that the vector
    has the length of the matrix.
    """
    size = matrix.shape[-1]
    rows, columns = triangle_indices(size)
    upper_triangle = matrix[..., rows, columns]
    return np.asarray(upper_triangle * triangle_weights(size))


def lift_diagonal(vector: FloatArray, size: int) -> FloatArray:
    """Return a symmetric matrix with its diagonal increased until no computed eigenvalue is negative.

    The increase only removes rounding: a few parts in 10¹⁶ of the greatest eigenvalue.

    Args:
        vector: (size (size + 1) / 2,) the matrix, as the vector of its upper triangle.
        size: number of rows of the matrix.
    """
    diagonal = find_diagonal_entries(size)
    increase = np.finfo(float).eps * float(np.abs(vector).max(initial=0.0))
    lifted = vector
    while np.linalg.eigvalsh(to_matrix(lifted, size)).min() < 0.0:
        lifted = vector.copy()
        lifted[diagonal] += increase
        increase *= 2.0
    return lifted


@dataclass(frozen=True)
class Cone:
    """Layout of a vector of parameters: first scalars ≥ 0, then blocks, positive semidefinite matrices."""

    nonnegative: int  #: number of scalars, which come first and are zero or positive
    sizes: tuple[int, ...] = ()  #: number of rows of each block; blocks are stored as vectors (`to_vector`)
    penalised: int = 0  #: number of scalars at the end that are penalised, like the traces of the blocks

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return self.nonnegative + sum(size * (size + 1) // 2 for size in self.sizes)

    @property
    def free(self) -> int:
        """Number of scalars without a penalty; they come first."""
        return self.nonnegative - self.penalised

    def blocks(self) -> Iterator[tuple[int, slice]]:
        """Yield each block's number of rows and the slice of the parameters that contains the block."""
        start = self.nonnegative
        for size in self.sizes:
            stop = start + size * (size + 1) // 2
            yield size, slice(start, stop)
            start = stop

    def least_value(self, x: FloatArray) -> float:
        """Return the least number among the scalars and the blocks' eigenvalues of x (p,); inf if p = 0.

        The number is negative if x lies outside the cone.
        """
        values = [x[: self.nonnegative]]
        for size, place in self.blocks():
            eigenvalues = np.linalg.eigvalsh(to_matrix(x[place], size))
            values.append(np.asarray(eigenvalues))
        return float(np.concatenate(values).min(initial=np.inf))

    def project(self, x: FloatArray) -> FloatArray:
        """Return the point (p,) of the cone nearest to x (p,); no computed eigenvalue is negative."""
        projected = np.maximum(x, 0.0)  # correct for the scalars; the blocks are replaced below
        for size, place in self.blocks():
            eigenvalues, vectors = np.linalg.eigh(to_matrix(x[place], size))
            matrix = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
            projected[place] = lift_diagonal(to_vector(matrix), size)
        return projected

    def penalty(self, weight: float) -> FloatArray:
        """Return the gradient (p,) of the penalty on penalised scalars and on the traces of blocks.

        The gradient is `weight` at penalised scalars and diagonal entries of blocks, and zero elsewhere.
        """
        gradient = np.zeros(self.dimension)
        penalised_scalars = slice(self.free, self.nonnegative)
        gradient[penalised_scalars] = weight
        for size, place in self.blocks():
            gradient[place.start + find_diagonal_entries(size)] = weight
        return gradient


class BlockEntries(NamedTuple):
    """Entries of one joint's unknowns in a vector, as views of the vector."""

    c: FloatArray  #: (1,) compliance c
    zeta: FloatArray  #: (boxes,) ζ
    nu: FloatArray  #: (balls, 3) ν


@dataclass(frozen=True)
class Block:
    """Layout of one joint's unknowns: compliance c, then ζ limited by a box, then ν (3,) in each ball.

    The limits are |ζ_k| ≤ c, and ‖ν‖ ≤ radius for each ball.
    """

    boxes: int  #: number of ζ
    #: for each ball: index k of a ζ, or −1, and ratio: the radius is c + ratio ζ_k, or c for the index −1
    balls: tuple[tuple[int, float], ...] = ()

    @property
    def size(self) -> int:
        """Number of unknowns of the joint."""
        return 1 + self.boxes + 3 * len(self.balls)

    def split(self, vector: FloatArray) -> BlockEntries:
        """Return the entries c, ζ and ν of a vector (size,)."""
        first_of_nu = 1 + self.boxes
        c, zeta, nu = vector[:1], vector[1:first_of_nu], vector[first_of_nu:]
        return BlockEntries(c, zeta, nu.reshape(-1, 3))
