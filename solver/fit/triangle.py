"""Triangle: whitened readings and columns of all terms, compressed (method.md §5, §13).

For rows M = [A d] the triangle T satisfies ``Tᵀ T = Mᵀ M``, so ``‖A x − d‖ = ‖T (x, −1)‖`` for every x: a
fit, an F test and an order of two campaigns need nothing else of the readings. Householder QR is backward
stable column by column: columns of very different scale do not disturb each other, as they would in normal
equations. This module alone compresses rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy import optimize, special

from jointstiff.solver.arrays import FloatArray, IndexArray, unit_columns

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
    """Return the triangular factor R (k, k) of a QR decomposition of rows A (m, k): RᵀR = AᵀA.

    Rows are replaced by the factors of groups of rows until few rows are left: small QRs start no threads. A
    stack of s small matrices (s, m, k) gives s factors (s, k, k).
    """
    width = rows.shape[-1]
    is_stack = rows.ndim > 2
    group_size = max(_LEAF, 4 * width)  # number of rows
    while not is_stack and len(rows) > 4 * group_size:
        rows_in_groups = len(rows) // group_size * group_size
        groups = rows[:rows_in_groups].reshape(-1, group_size, width)
        factors = np.asarray(np.linalg.qr(groups, mode="r"))
        rows = np.concatenate([factors.reshape(-1, width), rows[rows_in_groups:]])
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
            widths: number of columns of each term, in the order of the columns; a term is a group of columns.
        """
        column_count = sum(widths.values()) + 1  # the last column has the readings
        ends = accumulate(widths.values(), initial=0)
        columns = [np.arange(start, stop) for start, stop in pairwise(ends)]
        self.span = dict(zip(widths, columns, strict=True))
        self.R: FloatArray = np.zeros((column_count, column_count))
        self.rows = 0

    def add(self, rows: FloatArray, *, count: int | None = None) -> None:
        """Add rows: update the triangular factor R of all rows.

        The factor of the earlier rows replaces these rows.

        Args:
            rows: (..., K + 1); leading dimensions are flattened.
            count: number of rows that are readings, if others are padding with zeros; all if None.
        """
        width = self.R.shape[1]
        flat = rows.reshape(-1, width)
        factor_of_added = compute_triangular_factor(flat)
        are_first_rows = not self.rows and len(flat) >= width
        if are_first_rows:
            self.R = factor_of_added
        else:
            self.R = compute_triangular_factor(np.concatenate([self.R, factor_of_added]))
        self.rows += len(flat) if count is None else count

    def _find_columns(self, names: Sequence[str]) -> IndexArray:
        """Return the indices of the columns of the named terms."""
        return np.concatenate([np.zeros(0, np.intp), *(self.span[name] for name in names)])

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
        columns = self.R[:, self._find_columns(names)]
        scaled, _ = unit_columns(columns)
        return scaled

    def residual_squares(self, names: Sequence[str]) -> float:
        """Return the sum of squared residuals of a least-squares fit of the named terms to the readings.

        A term is a group of columns of the triangular factor.
        """
        basis = orthonormal_basis(self.unit_columns(names))
        explained_squares = np.square(basis.T @ self.rhs).sum()
        return float(self.rhs @ self.rhs - explained_squares)

    def p_values(
        self,
        names: Sequence[str],
        fitted: Sequence[str] = ("joints",),
        *,
        most_directions: int | None = None,
        least_singular_value: float = DISTINCT,
    ) -> FloatArray:
        """Return the p-values (S,) of F tests of whether a further term improves a least-squares fit.

        A term is a group of columns of the triangular factor, whose last column has the readings. A p-value
        is 1 where the readings have too few degrees of freedom for the test.

        Args:
            names: the S terms that are tested, each one alone.
            fitted: terms that are fitted in any case.
            most_directions: largest number of leading singular directions of a term to test; None for all.
            least_singular_value: directions are tested if their singular value exceeds this number. Singular
                values are computed from the tested term's unit columns, after projecting the fitted terms
                out.
        """
        fitted_basis = orthonormal_basis(self.unit_columns(fitted))
        residual = _project_out(fitted_basis, self.rhs)
        tested_columns = _project_out(fitted_basis, self.unit_columns(names))
        stops = np.cumsum([len(self.span[name]) for name in names])
        stacked = stack_padded(np.split(tested_columns, stops[:-1], axis=1))  # (S, K + 1, k)
        U, singular_values, _ = np.linalg.svd(stacked, full_matrices=False)
        is_tested = singular_values > least_singular_value  # (S, k)
        if most_directions is not None:
            is_tested[:, most_directions:] = False
        explained = np.where(is_tested, np.square(residual @ U), 0.0).sum(axis=1)
        unexplained = np.maximum(residual @ residual - explained, 0.0)
        tested_count = is_tested.sum(axis=1)
        freedom = self.rows - fitted_basis.shape[1] - tested_count
        is_testable = (tested_count > 0) & (freedom > 0)
        tested_count, freedom = np.maximum(tested_count, 1), np.maximum(freedom, 1)  # no division by zero
        variance = unexplained / freedom + RESOLUTION**2  # of a reading, at least that of rounding
        f_ratio = explained / tested_count / variance
        return np.where(is_testable, special.fdtrc(tested_count, freedom, f_ratio), 1.0)

    def rank(self, names: Sequence[str], least: float) -> int:
        """Return the rank of the named terms' unit columns: the number of singular values above `least`."""
        return int(orthonormal_basis(self.unit_columns(names), least).shape[1])

    def project_out(self, names: Sequence[str], least_singular_value: float) -> Triangle:
        """Return the triangular factor without the named terms, which are projected out of all other columns.

        A term is a group of columns. A fit to the result equals a fit in which the named terms are free.

        Args:
            names: terms that are projected out.
            least_singular_value: singular value of their unit columns above which a direction is projected
                out.
        """
        basis = orthonormal_basis(self.unit_columns(names), least_singular_value)
        widths = {name: len(columns) for name, columns in self.span.items() if name not in names}
        remaining = self.R[:, [*self._find_columns(list(widths)), -1]]  # the last column has the readings
        triangle = Triangle(**widths)
        triangle.add(_project_out(basis, remaining), count=self.rows)
        return triangle

    def project_out_stated(self, name: str, uncertainty: FloatArray, sigma: float) -> Triangle:
        """Return the triangular factor in which a term is fitted, with a prior of mean zero on its unknowns.

        A term is a group of columns, one for each unknown. A fit of the other terms to the result equals a
        fit in which the unknowns of this term are free within their stated uncertainties.

        Args:
            name: term whose unknowns are stated as zero; it is projected out of all other columns.
            uncertainty: (k,) standard uncertainties of the unknowns; 0 keeps an unknown at zero.
            sigma: standard uncertainty of a reading, in the unit of the rows.
        """
        with_statements = self.state_as_zero(name, uncertainty, sigma)
        return with_statements.project_out([name], _NULL)

    def state_as_zero(self, name: str, uncertainty: FloatArray, sigma: float) -> Triangle:
        """Return the triangular factor with a further row for each unknown of a term: the unknown is zero.

        Such a row is like that of a reading: sigma times the unknown, in units of its standard uncertainty,
        is zero. The factor sigma gives the row the weight of a reading.

        Args:
            name: term; its unknowns are in units of their standard uncertainties afterwards.
            uncertainty: (k,) standard uncertainties of the unknowns; 0 keeps an unknown at zero.
            sigma: standard uncertainty of a reading, in the unit of the rows.
        """
        columns = self.span[name]
        scaled_R = self.R.copy()
        scaled_R[:, columns] *= uncertainty  # each unknown in units of its standard uncertainty
        further_rows = np.zeros((len(columns), self.R.shape[1]))
        further_rows[np.arange(len(columns)), columns] = sigma
        all_rows = np.concatenate([scaled_R, further_rows])
        with_statements = copy(self)
        with_statements.R = compute_triangular_factor(all_rows)
        return with_statements

    def sigma(self, names: Sequence[str]) -> float:
        """Return the standard deviation of a reading, from the residuals of a fit of the named terms.

        The resolution is added, so that exact readings do not have the standard deviation zero.
        """
        freedom = self.rows - self.rank(names, INDEPENDENT)
        squares = max(self.residual_squares(names), 0.0)
        return float(np.sqrt(squares / max(freedom, 1))) + RESOLUTION

    def statement_p_value(self, name: str, fitted: Sequence[str], uncertainty: FloatArray) -> float:
        """Return the p-value of the test that the unknowns of a term are zero, as stated.

        A term is a group of columns, one for each unknown. The estimate ê of the unknowns deviates from zero
        by its own covariance U and by that of the statement S: ``êᵀ (S + U)⁻¹ ê`` is compared with an F
        distribution. The p-value is 1 if the readings show no unknown, or leave no degree of freedom.

        Args:
            name: term that is tested.
            fitted: terms that are fitted in any case.
            uncertainty: (k,) standard uncertainties of the unknowns as stated.
        """
        fitted_basis = orthonormal_basis(self.unit_columns(fitted))
        columns = self.R[:, self.span[name]] * uncertainty  # unknowns in standard uncertainties: S = I
        residual = _project_out(fitted_basis, self.rhs)
        remaining = _project_out(fitted_basis, columns)
        left_vectors, singular_values, _ = np.linalg.svd(remaining, full_matrices=False)
        rounding = _NULL * max(float(np.linalg.norm(columns)), np.finfo(float).tiny)
        is_shown = singular_values > rounding
        count = int(is_shown.sum())
        freedom = self.rows - fitted_basis.shape[1] - count
        if not count or freedom < 1:
            return 1.0
        explained = np.square(left_vectors[:, is_shown].T @ residual)  # squares by singular direction
        unexplained = max(float(residual @ residual - explained.sum()), 0.0)
        variance = unexplained / freedom + RESOLUTION**2
        # In a direction of singular value s, ê² = explained / s² and U = variance / s², so that
        # ê² / (1 + U) = explained / (s² + variance).
        distance = float((explained / (np.square(singular_values[is_shown]) + variance)).sum())
        return float(special.fdtrc(count, freedom, distance / count))

    def fit(
        self, names: Sequence[str], other_unknowns: FloatArray, least_singular_value: float
    ) -> FloatArray:
        """Fit some terms by least squares, with given values of the unknowns of all other terms.

        A term is a group of columns, one for each of its unknowns.

        Args:
            names: terms that are fitted, k unknowns together.
            other_unknowns: (K,) known values of the unknowns of all other terms; zero for the fitted terms.
            least_singular_value: singular value of the terms' unit columns above which a direction is fitted;
                the part of the unknowns in all other directions stays zero.

        Returns:
            (k,) fitted unknowns.
        """
        readings = self.rhs - self.matrix @ other_unknowns
        columns, lengths = unit_columns(self.R[:, self._find_columns(names)])
        U, singular_values, Vt = np.linalg.svd(columns, full_matrices=False)
        is_fitted = singular_values > least_singular_value
        U, singular_values, Vt = U[:, is_fitted], singular_values[is_fitted], Vt[is_fitted]
        scaled_unknowns = Vt.T @ ((U.T @ readings) / singular_values)
        return np.asarray(scaled_unknowns / lengths)

    def fit_with_prior(self, deviation: FloatArray, variance: float) -> PriorFit:
        """Fit all terms by least squares with a Gaussian prior of mean zero on every unknown.

        The prior enters as one more row for each unknown: the unknown over its standard uncertainty is zero.

        Args:
            deviation: (K,) prior standard uncertainty of each unknown; 0 keeps the unknown at zero.
            variance: variance of one reading, in the squared unit of the rows.

        Returns:
            The fitted unknowns, a root of their covariance, and the sum of squared residuals of the readings.
        """
        sigma, K = np.sqrt(variance), len(deviation)
        # The unknowns are fitted in units of their prior standard uncertainties.
        rows = np.vstack([self.matrix * deviation, sigma * np.eye(K)])
        rhs = np.concatenate([self.rhs, np.zeros(K)])
        standardised, *_ = np.linalg.lstsq(rows, rhs, rcond=None)
        unknowns = deviation * standardised
        inverse_factor = np.linalg.solve(np.linalg.qr(rows, mode="r"), np.eye(K))
        root = sigma * deviation[:, None] * inverse_factor
        squares = float(np.square(self.matrix @ unknowns - self.rhs).sum())
        return PriorFit(unknowns, root, squares)

    def fit_with(self, names: Sequence[str], known_term: str = "joints") -> TermsFit:
        """Fit the named terms together with the term `known_term`, by least squares without bounds.

        A term is a group of columns, one for each of its unknowns. The columns of `known_term` are projected
        out of those of the named terms; directions without any length left, which `known_term` explains
        equally well, stay zero and are the result's `hidden`.
        """
        columns, lengths = unit_columns(self.R[:, self._find_columns(names)])
        known_columns, known_lengths = unit_columns(self.R[:, self.span[known_term]])
        remaining_columns = _project_out(orthonormal_basis(known_columns), columns)
        U, singular_values, Vt = np.linalg.svd(remaining_columns, full_matrices=False)
        is_distinct = singular_values > DISTINCT
        root = Vt[is_distinct].T / singular_values[is_distinct]  # of the covariance of the unknowns
        scaled_unknowns = root @ (U[:, is_distinct].T @ self.rhs)
        # Then fit `known_term` to what the named terms leave of the readings.
        remaining_readings = self.rhs - columns @ scaled_unknowns
        scaled_known = np.linalg.lstsq(known_columns, remaining_readings, rcond=INDEPENDENT)[0]
        # Divide by the lengths, as the columns were scaled to unit length.
        return TermsFit(
            known=scaled_known / known_lengths,
            unknowns=scaled_unknowns / lengths,
            root=root / lengths[:, None],
            hidden=Vt[~is_distinct].T / lengths[:, None],
        )


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


def stack_padded(columns_of_terms: Sequence[FloatArray]) -> FloatArray:
    """Stack the columns (m, k_s) of each of S terms into an array (S, m, k), padded with zero columns.

    k is the greatest k_s.
    """
    row_count = len(columns_of_terms[0])
    width = max(columns.shape[1] for columns in columns_of_terms)
    stacked = np.zeros((len(columns_of_terms), row_count, width))
    for index, columns in enumerate(columns_of_terms):
        stacked[index, :, : columns.shape[1]] = columns
    return stacked


def solve_nonnegative(columns: FloatArray, rhs: FloatArray) -> tuple[FloatArray, float]:
    """Solve least squares of rhs (m,) on columns (m, k) with unknowns ≥ 0.

    Unknowns of columns that are rounding, relative to the longest column, stay zero.

    Returns:
        The unknowns (k,), and the length of the residual.
    """
    lengths = np.linalg.norm(columns, axis=0)
    is_significant = lengths > _NULL * lengths.max(initial=0.0)
    lengths = np.where(is_significant, lengths, 1.0)
    scaled_columns = np.where(is_significant, columns / lengths, 0.0)
    scaled_unknowns, residual_length = optimize.nnls(scaled_columns, rhs)
    return scaled_unknowns / lengths, float(residual_length)


def orthonormal_basis(columns: FloatArray, least: float = INDEPENDENT) -> FloatArray:
    """Return an orthonormal basis (m, r) of the span of columns (m, k).

    The basis has the left singular vectors whose singular values exceed `least`.
    """
    U, singular_values, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, singular_values > least])


def _project_out(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns (m, k), or one (m,), less their projections on an orthonormal basis (m, r)."""
    return np.asarray(columns - basis @ (basis.T @ columns))
