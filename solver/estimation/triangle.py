"""Triangle: whitened readings and columns of all terms, compressed (method.md §5, §13).

For rows M = [A d] the triangle T satisfies ``Tᵀ T = Mᵀ M``, so ``‖A x − d‖ = ‖T (x, −1)‖`` for every x: a
fit, an F test and an order of two campaigns need nothing else of the readings. Householder QR is backward
stable column by column: columns of very different scale do not disturb each other, which the normal equations
would let them. This module alone compresses rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy import optimize, special

from jointstiff.solver.arrays import FloatArray

_LEAF = 256
"""Rows of the smallest QR, so small that BLAS starts no threads for up to 32 joints."""
INDEPENDENT: Final = 1e-6
"""Least singular value of unit columns that counts for more than rounding."""
DISTINCT: Final = 1e-2
"""Least singular value of a load's unit columns, the joints' projected out: below, the size is the load's
own."""
_NULL: Final = 1e-9
"""Length of a column, relative to the longest, that is rounding."""
_RESOLUTION: Final = 1e-7
"""Residual [m] of a coordinate below which nothing is left to explain."""


def triangle_of(rows: FloatArray) -> FloatArray:
    """Return the triangular factor of rows (m, k) by a tree of small QRs, which start no threads.

    Of a stack of rows (s, m, k), each as small as a leaf, it is (s, k, k).
    """
    width = rows.shape[-1]
    leaf = max(_LEAF, 4 * width)
    while rows.ndim == 2 and len(rows) > 4 * leaf:
        whole = len(rows) // leaf * leaf
        leaves = np.asarray(np.linalg.qr(rows[:whole].reshape(-1, leaf, width), mode="r"))
        rows = np.concatenate([leaves.reshape(-1, width), rows[whole:]])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


class Triangle:
    """Triangular factor of all rows added so far, its columns by the names of their terms.

    Attributes:
        R: (K + 1, K + 1) upper triangular, the readings' own column last.
        rows: number of readings behind it.
        span: columns of each term.
    """

    def __init__(self, **widths: int) -> None:
        """Start without rows.

        Args:
            widths: number of columns of each term, in their order.
        """
        ends = accumulate(widths.values(), initial=0)
        self.span = {name: np.arange(*part) for name, part in zip(widths, pairwise(ends), strict=True)}
        width = sum(widths.values()) + 1
        self.R: FloatArray = np.zeros((width, width))
        self.rows = 0

    def add(self, rows: FloatArray, *, count: int | None = None) -> None:
        """Take in rows.

        Args:
            rows: (..., K + 1); leading dimensions are flattened.
            count: number of readings among them, if some are padding of zeros; all if None.
        """
        flat, width = rows.reshape(-1, self.R.shape[1]), self.R.shape[1]
        if not self.rows and len(flat) >= width:
            self.R = triangle_of(flat)
        else:
            self.R = triangle_of(np.concatenate([self.R, triangle_of(flat)]))
        self.rows += len(flat) if count is None else count

    @property
    def matrix(self) -> FloatArray:
        """(K + 1, K) compressed regressor."""
        return self.R[:, :-1]

    @property
    def rhs(self) -> FloatArray:
        """(K + 1,) compressed readings."""
        return self.R[:, -1]

    def unit_columns(self, names: Sequence[str]) -> FloatArray:
        """Return the columns of some terms, each of unit length; zero columns stay zero."""
        part = np.concatenate([np.zeros(0, np.intp), *(self.span[name] for name in names)])
        return unit_columns(self.R[:, part])[0]

    def residual_squares(self, names: Sequence[str]) -> float:
        """Return the sum of squared residuals of some terms fitted together."""
        known = basis(self.unit_columns(names))
        return float(self.rhs @ self.rhs - np.square(known.T @ self.rhs).sum())

    def p_values(
        self,
        names: Sequence[str],
        fitted: Sequence[str] = ("joints",),
        *,
        most: int | None = None,
        least: float = DISTINCT,
    ) -> FloatArray:
        """Return p-values (S,) of F tests of terms added to others; 1 where the readings cannot decide.

        Args:
            names: terms that are tested, each by itself.
            fitted: terms that are fitted in any case.
            most: largest number of a term's leading combinations that are tested; all if None.
            least: singular value of its unit columns, the others projected out, above which a combination
                counts.
        """
        known, tested = basis(self.unit_columns(fitted)), self.unit_columns(names)
        d = self.rhs - known @ (known.T @ self.rhs)
        left = tested - known @ (known.T @ tested)
        columns = side_by_side(
            np.split(left, np.cumsum([len(self.span[name]) for name in names])[:-1], axis=1)
        )
        U, s, _ = np.linalg.svd(columns, full_matrices=False)
        counted = (s > least) & (np.arange(s.shape[1]) < (s.shape[1] if most is None else most))
        explained = np.where(counted, np.square(d @ U), 0.0).sum(axis=1)
        width = counted.sum(axis=1)
        freedom = self.rows - known.shape[1] - width
        testable = (width > 0) & (freedom > 0)
        noise = np.maximum(d @ d - explained, 0.0) / np.maximum(freedom, 1) + _RESOLUTION**2
        ratio = explained / np.maximum(width, 1) / noise
        return np.where(testable, special.fdtrc(np.maximum(width, 1), np.maximum(freedom, 1), ratio), 1.0)

    def rank(self, names: Sequence[str], least: float) -> int:
        """Return how many combinations of terms the readings show by more than a singular value."""
        return int(basis(self.unit_columns(names), least).shape[1])

    def left_by(self, names: Sequence[str], least: float) -> Triangle:
        """Project some terms out of the others and of the readings; the columns of these terms go.

        Args:
            names: terms that are projected out.
            least: singular value of their unit columns above which a combination counts.
        """
        known = basis(self.unit_columns(names), least)
        others = {name: len(columns) for name, columns in self.span.items() if name not in names}
        left = self.R[:, np.concatenate([*(self.span[name] for name in others), [self.R.shape[1] - 1]])]
        triangle = Triangle(**others)
        triangle.add(left - known @ (known.T @ left), count=self.rows)
        return triangle

    def fit(self, names: Sequence[str], others: FloatArray, least: float) -> FloatArray:
        """Fit terms by least squares while the unknowns of the others are known.

        Args:
            names: terms that are fitted, k unknowns together.
            others: (K,) unknowns of all terms; those of the fitted ones are zero.
            least: singular value of unit columns above which a combination counts; the others stay zero.

        Returns:
            (k,) unknowns.
        """
        unit, length = unit_columns(self.R[:, np.concatenate([self.span[name] for name in names])])
        U, s, Vt = np.linalg.svd(unit, full_matrices=False)
        seen = s > least
        along = U[:, seen].T @ (self.rhs - self.matrix @ others)
        return np.asarray(Vt[seen].T @ (along / s[seen]) / length)

    def given(self, deviation: FloatArray, variance: float) -> Given:
        """Fit all terms together with what is known of their unknowns before any reading.

        What is known is a row of its own: unknown k, in units of its standard uncertainty, was read as zero.

        Args:
            deviation: (K,) standard uncertainty of each unknown; one of 0 stays zero.
            variance: of a reading, in the unit of the rows.
        """
        M = np.vstack([self.matrix * deviation, np.sqrt(variance) * np.eye(len(deviation))])
        x, *_ = np.linalg.lstsq(M, np.concatenate([self.rhs, np.zeros(len(deviation))]), rcond=None)
        inverse = np.linalg.solve(np.linalg.qr(M, mode="r"), np.eye(len(deviation)))
        left = float(np.square(self.matrix @ (deviation * x) - self.rhs).sum())
        return Given(deviation * x, np.sqrt(variance) * deviation[:, None] * inverse, left)

    def fit_with(self, names: Sequence[str], known: str = "joints") -> FittedWith:
        """Fit terms together with one that is certain to act, by least squares without bounds.

        Combinations of the terms' unknowns that the known one explains as well are zero.
        """
        columns, d = self.R[:, self.span[known]], self.R[:, -1]
        unit, length = unit_columns(self.R[:, np.concatenate([self.span[name] for name in names])])
        known_unit, scale = unit_columns(columns)
        there = basis(known_unit)
        U, s, Vt = np.linalg.svd(unit - there @ (there.T @ unit), full_matrices=False)
        distinct = s > DISTINCT
        root = Vt[distinct].T / s[distinct]
        step = root @ (U[:, distinct].T @ d)
        fitted = np.linalg.lstsq(known_unit, d - unit @ step, rcond=INDEPENDENT)[0]
        hidden = Vt[~distinct].T / length[:, None]
        return FittedWith(fitted / scale, step / length, root / length[:, None], hidden)


class Given(NamedTuple):
    """Least squares of K unknowns of stated uncertainty."""

    unknowns: FloatArray  #: (K,)
    root: FloatArray  #: (K, K); its product with the transpose is their covariance
    squares: float  #: sum of the squared residuals of the readings


class FittedWith(NamedTuple):
    """Least squares of p unknowns of a term and K of others, fitted together, in units of sigma."""

    known: FloatArray  #: (p,) of the joints, if no other term was named
    unknowns: FloatArray  #: (K,)
    root: FloatArray  #: (K, r); its product with the transpose is the covariance of the unknowns
    hidden: FloatArray  #: (K, K - r) combinations of them that the known term explains as well


def unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return columns (m, k) of unit length, and their lengths (k,); zero columns stay, with a length of 1."""
    length = np.linalg.norm(columns, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return columns / length, length


def side_by_side(parts: Sequence[FloatArray]) -> FloatArray:
    """Return columns (m, k_s) of S terms as (S, m, k), those of narrower ones filled up by zeros."""
    width = max(part.shape[-1] for part in parts)
    out = np.zeros((len(parts), len(parts[0]), width))
    for each, part in zip(out, parts, strict=True):
        each[:, : part.shape[-1]] = part
    return out


def nonnegative(columns: FloatArray, rhs: FloatArray) -> tuple[FloatArray, float]:
    """Return the least squares of columns (m, k) with unknowns (k,) ≥ 0, and the residual's length.

    The unknowns of columns that are rounding relative to the longest stay zero.
    """
    length = np.linalg.norm(columns, axis=0)
    seen = length > _NULL * length.max(initial=0.0)
    unit = np.where(seen, length, 1.0)
    x, left = optimize.nnls(np.where(seen, columns / unit, 0.0), rhs)
    return x / unit, float(left)


def basis(columns: FloatArray, least: float = INDEPENDENT) -> FloatArray:
    """Return an orthonormal basis of what columns tell by more than a singular value, largest first."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, s > least])
