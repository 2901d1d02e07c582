"""QR compression: a least-squares problem of any length becomes a small triangle (method.md §5, step 3)."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray

_LEAF = 256
"""Rows of the smallest QR, so small that BLAS starts no threads for up to 32 joints."""


class Compression:
    """The triangular factor of all rows added so far.

    For rows M = [A d] the triangle T satisfies ``Tᵀ T = Mᵀ M``, so ``‖A c − d‖ = ‖T (c, −1)‖`` for
    every c. Householder QR is backward stable column by column: columns of very different scale do
    not disturb each other, which the normal equations would let them.
    """

    def __init__(self, width: int) -> None:
        """Start without rows.

        Args:
            width: number of columns of the rows to come.
        """
        self._triangle: FloatArray = np.zeros((width, width))
        self.rows = 0

    def add(self, rows: FloatArray, *, count: int | None = None) -> None:
        """Take in rows.

        Args:
            rows: (..., width); leading dimensions are flattened.
            count: how many of them are readings, if some are padding of zeros; all if None.
        """
        flat = rows.reshape(-1, self._triangle.shape[1])
        self._triangle = _triangle(np.concatenate([self._triangle, _triangle(flat)]))
        self.rows += len(flat) if count is None else count

    @property
    def triangle(self) -> FloatArray:
        """(width, width) upper triangular factor."""
        return self._triangle

    @property
    def matrix(self) -> FloatArray:
        """R (width, width − 1): the compressed regressor."""
        return self._triangle[:, :-1]

    @property
    def rhs(self) -> FloatArray:
        """The compressed deflections z (width,)."""
        return self._triangle[:, -1]


def _triangle(rows: FloatArray) -> FloatArray:
    """Triangular factor by a tree of small QRs, which stay in the cache and start no threads."""
    width = rows.shape[1]
    leaf = max(_LEAF, 4 * width)
    while len(rows) > 4 * leaf:
        whole = len(rows) // leaf * leaf
        leaves = np.asarray(np.linalg.qr(rows[:whole].reshape(-1, leaf, width), mode="r"))
        rows = np.concatenate([leaves.reshape(-1, width), rows[whole:]])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)
