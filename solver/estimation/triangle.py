"""Triangle: whitened readings and columns of all terms, compressed (method.md §5, §13).

For rows M = [A d] the triangle T satisfies ``Tᵀ T = Mᵀ M``, so ``‖A x − d‖ = ‖T (x, −1)‖`` for every x: a
fit, an F test and an order of two campaigns need nothing else of the readings. Householder QR is backward
stable column by column: columns of very different scale do not disturb each other, as they would in normal
equations. This module alone compresses rows.
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
"""Least singular value of unit columns that is more than rounding."""
DISTINCT: Final = 1e-2
"""Least singular value of a load's unit columns, with the joints' columns projected out, at which the
readings can distinguish the load from the joints."""
_NULL: Final = 1e-9
"""Length of a column, relative to the longest column, up to which the column is rounding."""
RESOLUTION: Final = 1e-7
"""Residual [m] of a coordinate below which residuals count as rounding, with nothing to explain."""


def compute_triangular_factor(rows: FloatArray) -> FloatArray:
    """Return the triangular factor (k, k) of rows (m, k), k columns, computed by a tree of small QRs.

    Small QRs start no threads. A stack of s small matrices (s, m, k) gives s factors (s, k, k).
    """
    width = rows.shape[-1]
    leaf = max(_LEAF, 4 * width)
    while rows.ndim == 2 and len(rows) > 4 * leaf:
        whole = len(rows) // leaf * leaf
        leaves = np.asarray(np.linalg.qr(rows[:whole].reshape(-1, leaf, width), mode="r"))
        rows = np.concatenate([leaves.reshape(-1, width), rows[whole:]])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


class Triangle:
    """Triangular factor of all rows added so far; its columns belong to named terms.

    Attributes:
        R: (K + 1, K + 1) upper triangular; the last column holds the readings.
        rows: number of readings that were added.
        span: indices of each term's columns, by the term's name.
    """

    def __init__(self, **widths: int) -> None:
        """Start without rows.

        Args:
            widths: number of columns of each term, in the order of the columns.
        """
        ends = accumulate(widths.values(), initial=0)
        self.span = {name: np.arange(*part) for name, part in zip(widths, pairwise(ends), strict=True)}
        width = sum(widths.values()) + 1
        self.R: FloatArray = np.zeros((width, width))
        self.rows = 0

    def add(self, rows: FloatArray, *, count: int | None = None) -> None:
        """Add rows: update the triangular factor.

        Args:
            rows: (..., K + 1); leading dimensions are flattened.
            count: number of rows that are readings, if others are padding with zeros; all if None.
        """
        flat, width = rows.reshape(-1, self.R.shape[1]), self.R.shape[1]
        if not self.rows and len(flat) >= width:
            self.R = compute_triangular_factor(flat)
        else:
            self.R = compute_triangular_factor(np.concatenate([self.R, compute_triangular_factor(flat)]))
        self.rows += len(flat) if count is None else count

    @property
    def matrix(self) -> FloatArray:
        """Compressed regressor (K + 1, K): all columns except the column of readings."""
        return self.R[:, :-1]

    @property
    def rhs(self) -> FloatArray:
        """Compressed readings (K + 1,)."""
        return self.R[:, -1]

    def unit_columns(self, names: Sequence[str]) -> FloatArray:
        """Return the columns (K + 1, k) of the named terms, scaled to unit length; zero columns stay zero."""
        part = np.concatenate([np.zeros(0, np.intp), *(self.span[name] for name in names)])
        return unit_columns(self.R[:, part])[0]

    def residual_squares(self, names: Sequence[str]) -> float:
        """Return the sum of squared residuals of a fit of the named terms to the readings."""
        known = orthonormal_basis(self.unit_columns(names))
        return float(self.rhs @ self.rhs - np.square(known.T @ self.rhs).sum())

    def p_values(
        self,
        names: Sequence[str],
        fitted: Sequence[str] = ("joints",),
        *,
        most: int | None = None,
        least: float = DISTINCT,
    ) -> FloatArray:
        """Return the p-values (S,) of F tests of whether adding a term improves the fit of other terms.

        A p-value is 1 where the readings have too few degrees of freedom for the test.

        Args:
            names: the S terms that are tested, each one alone.
            fitted: terms that are fitted in any case.
            most: largest number of a term's leading singular directions that are tested; all if None.
            least: directions are tested if their singular value exceeds this number. Singular values are
                computed from the tested term's unit columns, after projecting the fitted terms out.
        """
        known, tested = orthonormal_basis(self.unit_columns(fitted)), self.unit_columns(names)
        d = self.rhs - known @ (known.T @ self.rhs)
        projected = tested - known @ (known.T @ tested)
        columns = stack_padded(
            np.split(projected, np.cumsum([len(self.span[name]) for name in names])[:-1], axis=1)
        )
        U, s, _ = np.linalg.svd(columns, full_matrices=False)
        counted = (s > least) & (np.arange(s.shape[1]) < (s.shape[1] if most is None else most))
        explained = np.where(counted, np.square(d @ U), 0.0).sum(axis=1)
        width = counted.sum(axis=1)
        freedom = self.rows - known.shape[1] - width
        testable = (width > 0) & (freedom > 0)
        noise = np.maximum(d @ d - explained, 0.0) / np.maximum(freedom, 1) + RESOLUTION**2
        ratio = explained / np.maximum(width, 1) / noise
        return np.where(testable, special.fdtrc(np.maximum(width, 1), np.maximum(freedom, 1), ratio), 1.0)

    def rank(self, names: Sequence[str], least: float) -> int:
        """Return the rank of the named terms' unit columns: the number of singular values above `least`."""
        return int(orthonormal_basis(self.unit_columns(names), least).shape[1])

    def project_out(self, names: Sequence[str], least: float) -> Triangle:
        """Return the triangle without the named terms, which are projected out of all other columns.

        A fit to the result equals a fit in which the named terms are free.

        Args:
            names: terms that are projected out.
            least: singular value of their unit columns above which a direction is projected out.
        """
        known = orthonormal_basis(self.unit_columns(names), least)
        others = {name: len(columns) for name, columns in self.span.items() if name not in names}
        remaining = self.R[:, np.concatenate([*(self.span[name] for name in others), [self.R.shape[1] - 1]])]
        triangle = Triangle(**others)
        triangle.add(remaining - known @ (known.T @ remaining), count=self.rows)
        return triangle

    def given(self, name: str, uncertainty: FloatArray, sigma: float) -> Triangle:
        """Return the triangle in which the unknowns of a term are fitted, each stated as zero.

        Args:
            name: term with statements, which is projected out of all other columns.
            uncertainty: (k,) standard uncertainties of the unknowns; 0 keeps an unknown at zero.
            sigma: standard uncertainty of a reading, in the unit of the rows.
        """
        return self.state(name, uncertainty, sigma).project_out([name], _NULL)

    def state(self, name: str, uncertainty: FloatArray, sigma: float) -> Triangle:
        """Return the triangle with statements that the unknowns of a term are zero.

        A statement is one more row: the unknown over its standard uncertainty is zero, as a reading is.

        Args:
            name: term with statements; its unknowns are in units of their standard uncertainties afterwards.
            uncertainty: (k,) standard uncertainties of the unknowns; 0 keeps an unknown at zero.
            sigma: standard uncertainty of a reading, in the unit of the rows.
        """
        columns = self.span[name]
        whole = Triangle(**{each: len(span) for each, span in self.span.items()})
        whole.R, whole.rows = self.R.copy(), self.rows
        whole.R[:, columns] *= uncertainty  # each unknown in units of its standard uncertainty
        rows = np.zeros((len(columns), self.R.shape[1]))
        rows[np.arange(len(columns)), columns] = sigma
        whole.add(rows, count=0)
        return whole

    def sigma(self, names: Sequence[str]) -> float:
        """Return the root mean square residual of a fit of the named terms, per degree of freedom."""
        freedom = self.rows - self.rank(names, INDEPENDENT)
        return float(np.sqrt(max(self.residual_squares(names), 0.0) / max(freedom, 1))) + RESOLUTION

    def statement_p_value(self, name: str, fitted: Sequence[str], uncertainty: FloatArray) -> float:
        """Return the p-value of the test that the unknowns of a term are zero, as stated.

        The estimate ê of the unknowns deviates from zero by its own uncertainty U and by that of the
        statement S: ``êᵀ (S + U)⁻¹ ê`` is compared with an F distribution.

        Args:
            name: term that is tested.
            fitted: terms that are fitted in any case.
            uncertainty: (k,) standard uncertainties of the unknowns as stated.
        """
        known = orthonormal_basis(self.unit_columns(fitted))
        columns = self.R[:, self.span[name]] * uncertainty
        left = columns - known @ (known.T @ columns)
        d = self.rhs - known @ (known.T @ self.rhs)
        U, s, _ = np.linalg.svd(left, full_matrices=False)
        seen = s > _NULL * max(float(np.linalg.norm(columns)), np.finfo(float).tiny)
        along, width = np.square(U[:, seen].T @ d), int(seen.sum())
        freedom = self.rows - known.shape[1] - width
        if not width or freedom < 1:
            return 1.0
        noise = max(float(d @ d - along.sum()), 0.0) / freedom + RESOLUTION**2
        distance = float((along / (np.square(s[seen]) + noise)).sum())
        return float(special.fdtrc(width, freedom, distance / width))

    def fit(self, names: Sequence[str], others: FloatArray, least: float) -> FloatArray:
        """Fit some terms by least squares, with given values of the unknowns of all other terms.

        Args:
            names: terms that are fitted, k unknowns together.
            others: (K,) known values of the unknowns of all other terms; zero for the fitted terms.
            least: singular value of the terms' unit columns above which a direction is fitted; the part of
                the unknowns in all other directions stays zero.

        Returns:
            (k,) fitted unknowns.
        """
        unit, length = unit_columns(self.R[:, np.concatenate([self.span[name] for name in names])])
        U, s, Vt = np.linalg.svd(unit, full_matrices=False)
        seen = s > least
        coefficients = U[:, seen].T @ (self.rhs - self.matrix @ others)
        return np.asarray(Vt[seen].T @ (coefficients / s[seen]) / length)

    def fit_with_prior(self, deviation: FloatArray, variance: float) -> PriorFit:
        """Fit all terms by least squares with a Gaussian prior of mean zero on every unknown.

        The prior enters as one more row for each unknown: the unknown over its standard uncertainty is zero.

        Args:
            deviation: (K,) prior standard uncertainty of each unknown; 0 keeps the unknown at zero.
            variance: variance of one reading, in the squared unit of the rows.

        Returns:
            The fitted unknowns, a root of their covariance, and the sum of squared residuals of the readings.
        """
        M = np.vstack([self.matrix * deviation, np.sqrt(variance) * np.eye(len(deviation))])
        x, *_ = np.linalg.lstsq(M, np.concatenate([self.rhs, np.zeros(len(deviation))]), rcond=None)
        inverse = np.linalg.solve(np.linalg.qr(M, mode="r"), np.eye(len(deviation)))
        squares = float(np.square(self.matrix @ (deviation * x) - self.rhs).sum())
        return PriorFit(deviation * x, np.sqrt(variance) * deviation[:, None] * inverse, squares)

    def fit_with(self, names: Sequence[str], known: str = "joints") -> TermsFit:
        """Fit the named terms together with the term `known`, by least squares without bounds.

        Directions of the named terms that the term `known` explains equally well stay zero.
        """
        columns, d = self.R[:, self.span[known]], self.R[:, -1]
        unit, length = unit_columns(self.R[:, np.concatenate([self.span[name] for name in names])])
        known_unit, scale = unit_columns(columns)
        basis = orthonormal_basis(known_unit)
        U, s, Vt = np.linalg.svd(unit - basis @ (basis.T @ unit), full_matrices=False)
        distinct = s > DISTINCT
        root = Vt[distinct].T / s[distinct]
        step = root @ (U[:, distinct].T @ d)
        fitted = np.linalg.lstsq(known_unit, d - unit @ step, rcond=INDEPENDENT)[0]
        hidden = Vt[~distinct].T / length[:, None]
        return TermsFit(fitted / scale, step / length, root / length[:, None], hidden)


class PriorFit(NamedTuple):
    """Result of least squares for K unknowns that have a prior."""

    unknowns: FloatArray  #: (K,) fitted values
    root: FloatArray  #: (K, K) L; L Lᵀ is the covariance of the unknowns
    squares: float  #: sum of the squared residuals of the readings


class TermsFit(NamedTuple):
    """Result of least squares for p unknowns of one known term and K unknowns of other terms."""

    known: FloatArray  #: (p,) unknowns of the known term, which is the joints unless another one was named
    unknowns: FloatArray  #: (K,) unknowns of the other terms
    root: FloatArray  #: (K, r) L; L Lᵀ is the covariance of the unknowns, in units of sigma²
    hidden: FloatArray  #: (K, K - r) directions of these unknowns that the known term explains equally well


def unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return columns (m, k) scaled to unit length, and their lengths (k,); a zero column has length 1."""
    length = np.linalg.norm(columns, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return columns / length, length


def stack_padded(parts: Sequence[FloatArray]) -> FloatArray:
    """Return the columns (m, k_s) of S terms as one array (S, m, k), padded with zero columns."""
    width = max(part.shape[-1] for part in parts)
    out = np.zeros((len(parts), len(parts[0]), width))
    for padded, part in zip(out, parts, strict=True):
        padded[:, : part.shape[-1]] = part
    return out


def solve_nonnegative(columns: FloatArray, rhs: FloatArray) -> tuple[FloatArray, float]:
    """Solve least squares of rhs (m,) on columns (m, k) with unknowns ≥ 0.

    Returns the unknowns (k,) and the length of the residual. Unknowns of columns that are rounding, relative
    to the longest column, stay zero.
    """
    length = np.linalg.norm(columns, axis=0)
    seen = length > _NULL * length.max(initial=0.0)
    unit = np.where(seen, length, 1.0)
    x, residual_length = optimize.nnls(np.where(seen, columns / unit, 0.0), rhs)
    return x / unit, float(residual_length)


def orthonormal_basis(columns: FloatArray, least: float = INDEPENDENT) -> FloatArray:
    """Return an orthonormal basis (m, r) of the span of columns (m, k): singular vectors above `least`."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, s > least])
