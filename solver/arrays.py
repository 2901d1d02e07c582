"""Types of arrays, and symmetric matrices as vectors: the upper triangle, off-diagonal entries times √2.

A comment or docstring beside each use gives shape, unit and frame.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
IndexArray: TypeAlias = npt.NDArray[np.intp]
Support: TypeAlias = npt.NDArray[np.int8]
"""-1 where a lower bound holds a parameter, 1 where an upper bound does, 0 where it is free."""


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
