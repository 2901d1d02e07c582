"""Symmetric matrices as vectors: the upper triangle column by column, off-diagonal entries times √2."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray


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
    found: FloatArray = np.where(rows == columns, 1.0, np.sqrt(2.0))
    found.setflags(write=False)
    return found


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
