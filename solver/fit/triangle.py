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
        """Add rows: update the triangular factor of all rows.

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
        """Compressed regressor (K + 1, K): all columns of the triangular factor but the readings."""
        return self.R[:, :-1]

    @property
    def rhs(self) -> FloatArray:
        """Compressed readings (K + 1,): the last column of the triangular factor."""
        return self.R[:, -1]

    def unit_columns(self, names: Sequence[str]) -> FloatArray:
        """Return the columns (K + 1, k) of the named terms, scaled to unit length; zero columns stay zero."""
        columns = np.concatenate([np.zeros(0, np.intp), *(self.span[name] for name in names)])
        return unit_columns(self.R[:, columns])[0]

    def residual_squares(self, names: Sequence[str]) -> float:
        """Return the sum of squared residuals when the named terms are fitted to the readings."""
        basis = orthonormal_basis(self.unit_columns(names))
        return float(self.rhs @ self.rhs - np.square(basis.T @ self.rhs).sum())

    def p_values(
        self,
        names: Sequence[str],
        fitted: Sequence[str] = ("joints",),
        *,
        most_directions: int | None = None,
        least_singular_value: float = DISTINCT,
    ) -> FloatArray:
        """Return the p-values (S,) of F tests of whether adding a term improves the fit of other terms.

        A p-value is 1 where the readings have too few degrees of freedom for the test.

        Args:
            names: the S terms that are tested, each one alone.
            fitted: terms that are fitted in any case.
            most_directions: largest number of leading singular directions of a term to test; None for all.
            least_singular_value: directions are tested if their singular value exceeds this number. Singular
                values are computed from the tested term's unit columns, after projecting the fitted terms
                out.
        """
        fitted_basis = orthonormal_basis(self.unit_columns(fitted))
        tested = self.unit_columns(names)
        residual = self.rhs - fitted_basis @ (fitted_basis.T @ self.rhs)
        projected = tested - fitted_basis @ (fitted_basis.T @ tested)
        columns = stack_padded(
            np.split(projected, np.cumsum([len(self.span[name]) for name in names])[:-1], axis=1)
        )
        U, singular_values, _ = np.linalg.svd(columns, full_matrices=False)
        is_tested = singular_values > least_singular_value
        if most_directions is not None:
            is_tested[:, most_directions:] = False
        explained = np.where(is_tested, np.square(residual @ U), 0.0).sum(axis=1)
        tested_count = is_tested.sum(axis=1)
        degrees_of_freedom = self.rows - fitted_basis.shape[1] - tested_count
        is_testable = (tested_count > 0) & (degrees_of_freedom > 0)
        variance = (
            np.maximum(residual @ residual - explained, 0.0) / np.maximum(degrees_of_freedom, 1)
            + RESOLUTION**2
        )
        f_ratio = explained / np.maximum(tested_count, 1) / variance
        p_values = special.fdtrc(np.maximum(tested_count, 1), np.maximum(degrees_of_freedom, 1), f_ratio)
        return np.where(is_testable, p_values, 1.0)

    def rank(self, names: Sequence[str], least: float) -> int:
        """Return the rank of the named terms' unit columns: the number of singular values above `least`."""
        return int(orthonormal_basis(self.unit_columns(names), least).shape[1])

    def project_out(self, names: Sequence[str], least_singular_value: float) -> Triangle:
        """Return the triangle without the named terms, which are projected out of all other columns.

        A fit to the result equals a fit in which the named terms are free.

        Args:
            names: terms that are projected out.
            least_singular_value: singular value of their unit columns above which a direction is projected
                out.
        """
        basis = orthonormal_basis(self.unit_columns(names), least_singular_value)
        remaining_widths = {name: len(columns) for name, columns in self.span.items() if name not in names}
        remaining_columns = self.R[
            :, np.concatenate([*(self.span[name] for name in remaining_widths), [self.R.shape[1] - 1]])
        ]
        triangle = Triangle(**remaining_widths)
        triangle.add(remaining_columns - basis @ (basis.T @ remaining_columns), count=self.rows)
        return triangle

    def given(self, name: str, uncertainty: FloatArray, sigma: float) -> Triangle:
        """Return the triangle in which the unknowns of a term are fitted, each stated as zero.

        A fit to the result equals a fit in which these unknowns are free within their stated uncertainties.

        Args:
            name: term with statements, which is projected out of all other columns.
            uncertainty: (k,) standard uncertainties of the unknowns; 0 keeps an unknown at zero.
            sigma: standard uncertainty of a reading, in the unit of the rows.
        """
        return self.state(name, uncertainty, sigma).project_out([name], _NULL)

    def state(self, name: str, uncertainty: FloatArray, sigma: float) -> Triangle:
        """Return the triangle with a further row for each unknown of a term: the statement that it is zero.

        A statement is a row like a reading: the unknown over its standard uncertainty is zero.

        Args:
            name: term with statements; its unknowns are in units of their standard uncertainties afterwards.
            uncertainty: (k,) standard uncertainties of the unknowns; 0 keeps an unknown at zero.
            sigma: standard uncertainty of a reading, in the unit of the rows.
        """
        columns = self.span[name]
        with_statements = Triangle(**{each: len(span) for each, span in self.span.items()})
        with_statements.R, with_statements.rows = self.R.copy(), self.rows
        with_statements.R[:, columns] *= uncertainty  # each unknown in units of its standard uncertainty
        statement_rows = np.zeros((len(columns), self.R.shape[1]))
        statement_rows[np.arange(len(columns)), columns] = sigma
        with_statements.add(statement_rows, count=0)
        return with_statements

    def sigma(self, names: Sequence[str]) -> float:
        """Return the standard deviation of a reading, from the residuals of a fit of the named terms."""
        degrees_of_freedom = self.rows - self.rank(names, INDEPENDENT)
        return (
            float(np.sqrt(max(self.residual_squares(names), 0.0) / max(degrees_of_freedom, 1))) + RESOLUTION
        )

    def statement_p_value(self, name: str, fitted: Sequence[str], uncertainty: FloatArray) -> float:
        """Return the p-value of the test that the unknowns of a term are zero, as stated.

        The estimate ê of the unknowns deviates from zero by its own uncertainty U and by that of the
        statement S: ``êᵀ (S + U)⁻¹ ê`` is compared with an F distribution.

        Args:
            name: term that is tested.
            fitted: terms that are fitted in any case.
            uncertainty: (k,) standard uncertainties of the unknowns as stated.
        """
        fitted_basis = orthonormal_basis(self.unit_columns(fitted))
        columns = self.R[:, self.span[name]] * uncertainty
        remaining_columns = columns - fitted_basis @ (fitted_basis.T @ columns)
        residual = self.rhs - fitted_basis @ (fitted_basis.T @ self.rhs)
        U, singular_values, _ = np.linalg.svd(remaining_columns, full_matrices=False)
        is_shown = singular_values > _NULL * max(float(np.linalg.norm(columns)), np.finfo(float).tiny)
        squared_components = np.square(U[:, is_shown].T @ residual)
        shown_count = int(is_shown.sum())
        degrees_of_freedom = self.rows - fitted_basis.shape[1] - shown_count
        if not shown_count or degrees_of_freedom < 1:
            return 1.0
        variance = (
            max(float(residual @ residual - squared_components.sum()), 0.0) / degrees_of_freedom
            + RESOLUTION**2
        )
        distance = float((squared_components / (np.square(singular_values[is_shown]) + variance)).sum())
        return float(special.fdtrc(shown_count, degrees_of_freedom, distance / shown_count))

    def fit(
        self, names: Sequence[str], other_unknowns: FloatArray, least_singular_value: float
    ) -> FloatArray:
        """Fit some terms by least squares, with given values of the unknowns of all other terms.

        Args:
            names: terms that are fitted, k unknowns together.
            other_unknowns: (K,) known values of the unknowns of all other terms; zero for the fitted terms.
            least_singular_value: singular value of the terms' unit columns above which a direction is fitted;
                the part of the unknowns in all other directions stays zero.

        Returns:
            (k,) fitted unknowns.
        """
        unit_vectors, length = unit_columns(self.R[:, np.concatenate([self.span[name] for name in names])])
        U, singular_values, Vt = np.linalg.svd(unit_vectors, full_matrices=False)
        is_shown = singular_values > least_singular_value
        coefficients = U[:, is_shown].T @ (self.rhs - self.matrix @ other_unknowns)
        return np.asarray(Vt[is_shown].T @ (coefficients / singular_values[is_shown]) / length)

    def fit_with_prior(self, deviation: FloatArray, variance: float) -> PriorFit:
        """Fit all terms by least squares with a Gaussian prior of mean zero on every unknown.

        The prior enters as one more row for each unknown: the unknown over its standard uncertainty is zero.

        Args:
            deviation: (K,) prior standard uncertainty of each unknown; 0 keeps the unknown at zero.
            variance: variance of one reading, in the squared unit of the rows.

        Returns:
            The fitted unknowns, a root of their covariance, and the sum of squared residuals of the readings.
        """
        rows = np.vstack([self.matrix * deviation, np.sqrt(variance) * np.eye(len(deviation))])
        standardised, *_ = np.linalg.lstsq(
            rows, np.concatenate([self.rhs, np.zeros(len(deviation))]), rcond=None
        )
        inverse = np.linalg.solve(np.linalg.qr(rows, mode="r"), np.eye(len(deviation)))
        residual_squares = float(np.square(self.matrix @ (deviation * standardised) - self.rhs).sum())
        return PriorFit(
            deviation * standardised, np.sqrt(variance) * deviation[:, None] * inverse, residual_squares
        )

    def fit_with(self, names: Sequence[str], known_term: str = "joints") -> TermsFit:
        """Fit the named terms together with the term `known_term`, by least squares without bounds.

        Directions of the named terms that the term `known_term` explains equally well stay zero.
        """
        columns, readings = self.R[:, self.span[known_term]], self.R[:, -1]
        unit_vectors, length = unit_columns(self.R[:, np.concatenate([self.span[name] for name in names])])
        known_unit_vectors, scale = unit_columns(columns)
        basis = orthonormal_basis(known_unit_vectors)
        U, singular_values, Vt = np.linalg.svd(
            unit_vectors - basis @ (basis.T @ unit_vectors), full_matrices=False
        )
        is_distinct = singular_values > DISTINCT
        root = Vt[is_distinct].T / singular_values[is_distinct]
        scaled_unknowns = root @ (U[:, is_distinct].T @ readings)
        fitted = np.linalg.lstsq(
            known_unit_vectors, readings - unit_vectors @ scaled_unknowns, rcond=INDEPENDENT
        )[0]
        undetermined = Vt[~is_distinct].T / length[:, None]
        return TermsFit(fitted / scale, scaled_unknowns / length, root / length[:, None], undetermined)


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


def stack_padded(columns_of_terms: Sequence[FloatArray]) -> FloatArray:
    """Stack the columns (m, k_s) of each of S terms into an array (S, m, k), padded with zero columns.

    k is the greatest k_s.
    """
    width = max(columns.shape[-1] for columns in columns_of_terms)
    stacked = np.zeros((len(columns_of_terms), len(columns_of_terms[0]), width))
    for padded, columns in zip(stacked, columns_of_terms, strict=True):
        padded[:, : columns.shape[-1]] = columns
    return stacked


def solve_nonnegative(columns: FloatArray, rhs: FloatArray) -> tuple[FloatArray, float]:
    """Solve least squares of rhs (m,) on columns (m, k) with unknowns ≥ 0.

    Unknowns of columns that are rounding, relative to the longest column, stay zero.

    Returns:
        The unknowns (k,), and the length of the residual.
    """
    length = np.linalg.norm(columns, axis=0)
    is_significant = length > _NULL * length.max(initial=0.0)
    lengths_or_one = np.where(is_significant, length, 1.0)
    scaled, residual_length = optimize.nnls(np.where(is_significant, columns / lengths_or_one, 0.0), rhs)
    return scaled / lengths_or_one, float(residual_length)


def orthonormal_basis(columns: FloatArray, least: float = INDEPENDENT) -> FloatArray:
    """Return an orthonormal basis (m, r) of the span of columns (m, k).

    The basis has the left singular vectors whose singular values exceed `least`.
    """
    U, singular_values, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, singular_values > least])
