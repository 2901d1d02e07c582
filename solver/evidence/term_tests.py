"""F tests of terms added to the joints: causes, links and base (method.md §13).

One triangle of all terms answers every test. Each test is made with the weights stated and with equal
weights, and the larger p-value counts: a noise of the wrong shape would accuse clean springs. Where something
is stated, or where residuals show scatter from posture to posture, a third test accounts for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import special
from scipy.optimize import brentq

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.evidence.scatter import RestrictedLikelihood
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import (
    DISTINCT,
    INDEPENDENT,
    RESOLUTION,
    Triangle,
    orthonormal_basis,
    unit_columns,
)
from jointstiff.solver.mechanics.block import Term
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE, DIAGONAL_LINKS, JOINTS
from jointstiff.solver.mechanics.terms import list_stated_terms

MISTAKE_LEVEL: Final = 1e-5
"""Probability that noise alone makes the test of any cause, or of a bending base, significant."""
STATEMENT_LEVEL: Final = 3e-3
"""p-value of a statement below which the readings refute the statement: a load point some 4 of its standard
uncertainties off."""
LINKS_LEVEL: Final = 3e-3
"""p-value of links below which models with links are compared by cross-validation."""
POWER: Final = 0.8
"""Probability with which a test finds the least mistake that it claims to find."""
_LARGEST_NONCENTRALITY: Final = 1e8
_GROSS: Final = 10.0
"""Mean square that leaving out a posture takes away, relative to the typical posture's, above which its
readings are wrong."""
_MOST_COMBINATIONS: Final = 12
"""Number of combinations of link compliances that are tested: those with the largest deflections."""


def compute_noncentrality(tested_count: int, degrees_of_freedom: int, level: float) -> float:
    """Return the non-centrality at which an F test has the power `POWER`; inf if there can be no test.

    Args:
        tested_count: degrees of freedom of the tested term.
        degrees_of_freedom: degrees of freedom of the residuals.
        level: significance level of the test.
    """
    if tested_count < 1 or degrees_of_freedom < 1:
        return np.inf
    critical_f = float(special.fdtri(tested_count, degrees_of_freedom, 1.0 - level))

    def compute_missing_power(noncentrality: float) -> float:
        """Return `POWER` minus the probability that the test finds a mistake of this non-centrality."""
        miss_probability = float(special.ncfdtr(tested_count, degrees_of_freedom, noncentrality, critical_f))
        return miss_probability - (1.0 - POWER)

    upper_limit = float(tested_count)
    while compute_missing_power(upper_limit) > 0.0:
        upper_limit *= 4.0
        if upper_limit > _LARGEST_NONCENTRALITY:
            return np.inf
    return float(brentq(compute_missing_power, 0.0, upper_limit, xtol=1e-6))


def join_statements(
    triangle: Triangle, stated: Iterable[Term], measurements: Measurements, sigma: float
) -> Triangle:
    """Return a triangle in which the unknowns of stated terms are fitted with their stated uncertainties.

    The columns of these terms are projected out of all other columns.

    Args:
        triangle: rows with the columns of these terms and of others.
        stated: terms about which the measurements state something.
        measurements: the observations, with what is stated.
        sigma: standard uncertainty of a coordinate of a reading [m].
    """
    joined = copy(triangle)
    joined.span = dict(triangle.span)
    for term in stated:
        uncertainty = np.resize(term.prior(measurements.common_uncertainty), len(triangle.span[term.name]))
        joined = joined.given(term.name, uncertainty, sigma)
    return joined


@dataclass(frozen=True)
class WrongPosture:
    """Posture whose readings disagree with those of all others."""

    label: str  #: label of the observation
    p_value: float  #: p-value of the F test, for all postures
    criterion: float  #: Bayesian information criterion of the fit without this posture


class TermTests:
    """Compressed rows of joints, causes, links and base, with the stated and with equal weights.

    Attributes:
        rows: the observations.
        visible: (n,) whether the readings see each joint.
        stated: triangle with the weights stated with the readings.
    """

    def __init__(
        self,
        rows: Rows,
        compliance: FloatArray,
        visible: BoolArray,
        always_fitted: Sequence[Term],
        terms: Sequence[Term],
        *,
        scattered: bool = False,
    ) -> None:
        """Compress the rows of some observations.

        Args:
            rows: the observations.
            compliance: (n,) of the joints [rad/(N·m)].
            visible: (n,) whether the readings see each joint; other joints are left out.
            always_fitted: terms that are fitted with the joints in any case.
            terms: terms to be tested.
            scattered: whether the residuals show a scatter of the joints, which tests must account for.
        """
        self.fitted = (JOINTS.name, *(term.name for term in always_fitted))
        self.compliance = compliance
        self.rows, self.visible = rows, visible
        self._scattered = scattered
        self._stated_terms = list_stated_terms(rows.measurements)
        self._terms = [JOINTS, *always_fitted, *terms, DIAGONAL_LINKS, DIAGONAL_BASE]
        self.stated = self._compress_rows(whitened=True)

    @cached_property
    def _equally_weighted(self) -> Triangle:
        """Triangle with equal weights of all readings."""
        return self._compress_rows(whitened=False)

    def _compress_rows(self, *, whitened: bool) -> Triangle:
        """Return the triangle of all terms."""
        triangle = self.rows.stack(self._terms, self.compliance, whitened=whitened).triangle()
        triangle.span[JOINTS.name] = np.flatnonzero(self.visible)
        return triangle

    def _largest_p_values(
        self, level: float, names: Sequence[str], fitted: Sequence[str], test: Callable[..., FloatArray]
    ) -> FloatArray:
        """Return for each tested term the largest p-value of up to three tests.

        The weights are those stated, then equal weights, then those that account for statements and for
        scatter from posture to posture. Where the p-value with stated weights is above `level`, no other
        weights are tried.

        Args:
            level: significance level.
            names: tested terms.
            fitted: terms that are fitted in any case.
            test: function of a triangle, and of the names of tested terms, that returns their p-values.
        """
        p_values = test(self.stated, names)
        # Readings that share one covariance (3, 3) have equal weights already.
        if (p_values < level).any() and self.rows.measurements.covariance.ndim > 2:
            p_values = np.where(
                p_values < level, np.maximum(p_values, test(self._equally_weighted, names)), p_values
            )
        if self._scattered or self._stated_terms:
            for index in np.flatnonzero(p_values < level).tolist():
                p_values[index] = max(
                    p_values[index], self._compute_p_value_given_statements(names[index], fitted, test)
                )
        return p_values

    def _compute_p_value_given_statements(
        self, name: str, fitted: Sequence[str], test: Callable[..., FloatArray]
    ) -> float:
        """Return the p-value of a term, given statements and the scatter that is most likely with the term.

        The scatter that residuals of joints alone show also contains the motion by the tested cause. A term
        about which something is stated is tested against its statement.

        Args:
            name: tested term.
            fitted: terms that are fitted in any case.
            test: function of a triangle, and of the names of tested terms, that returns their p-values.
        """
        triangle = self.compress_given_statements((*fitted, name))
        own_statement = next((term for term in self._stated_terms if term.name == name), None)
        if own_statement is None:
            return float(test(triangle, [name])[0])
        common = self.rows.measurements.common_uncertainty
        uncertainty = np.resize(own_statement.prior(common), len(triangle.span[name]))
        p_value = triangle.statement_p_value(name, fitted, uncertainty)
        return float(test(triangle, [name])[0]) if p_value < STATEMENT_LEVEL else p_value

    def compress_given_statements(self, names: Sequence[str]) -> Triangle:
        """Return the triangle of some terms, in which statements about all other terms are fitted.

        If the residuals show a scatter of the joints, the rows have the scatter that is most likely with the
        terms.
        """
        other_stated_terms, terms, rows = self._account_for_scatter(names)
        triangle = rows.stack(terms, self.compliance).triangle()
        sigma = rows.measurements.sigma or triangle.sigma([term.name for term in terms])
        triangle = join_statements(triangle, other_stated_terms, rows.measurements, sigma)
        triangle.span[JOINTS.name] = np.flatnonzero(self.visible)
        return triangle

    def _account_for_scatter(self, names: Sequence[str]) -> tuple[list[Term], list[Term], Rows]:
        """Return the terms of a fit of the named terms, and the rows with the scatter of the joints.

        If the residuals show scatter, the rows have the scatter that is most likely with the named terms.

        Returns:
            The other terms with statements; the named terms, then these other terms; and the rows.
        """
        other_stated_terms = [term for term in self._stated_terms if term.name not in names]
        terms = [*(term for term in self._terms if term.name in names), *other_stated_terms]
        rows = self.rows
        if self._scattered:
            likelihood = RestrictedLikelihood.from_rows(rows, terms, self.compliance, self.visible)
            scatter, _ = likelihood.fit_shared_errors()
            rows = rows.with_scatter(scatter)
        return other_stated_terms, terms, rows

    def find_wrong_posture(self, unknowns: int) -> WrongPosture | None:
        """Return the posture whose readings disagree most with all others; None if chance may explain it.

        Leaving out a posture equals a fit in which each of its coordinates is a free unknown. The F test is
        made for each posture (Bonferroni); the posture must also stand out from the typical posture, because
        causes that are not fitted move all of them.

        Args:
            unknowns: number of unknowns that are fitted in addition to the joints.
        """
        other_stated_terms, terms, scattered = self._account_for_scatter(self.fitted)
        stack, measurements = scattered.stack(terms, self.compliance), scattered.measurements
        columns = np.concatenate([self.visible.nonzero()[0], *list(stack.span.values())[1:]])
        rows, posture_count = stack.flat, len(stack)
        unit_vectors, length = unit_columns(rows[:, columns])
        sigma = measurements.sigma or stack.triangle().sigma([term.name for term in terms])
        # Statements are rows: each unknown over its standard uncertainty is zero. The stated terms come last.
        statement_weights = np.zeros(len(columns))
        end = len(columns)
        for term in reversed(other_stated_terms):
            start = end - len(stack.span[term.name])
            uncertainty = np.resize(term.prior(measurements.common_uncertainty), end - start)
            statement_weights[start:end] = sigma / np.maximum(uncertainty, 1e-300) / length[start:end]
            end = start
        statement_rows = np.diag(np.minimum(statement_weights, 1e9))
        basis = orthonormal_basis(np.vstack([unit_vectors, statement_rows]))[: len(rows)]
        residual = rows[:, -1] - basis @ (basis.T @ rows[:, -1])
        residual_of_posture = residual.reshape(posture_count, -1)
        basis_of_posture = basis.reshape(posture_count, -1, basis.shape[1])
        # Sum of squares that leaving out a posture takes away: rᵀ (I − Q Qᵀ)⁻¹ r.
        remaining = np.eye(basis_of_posture.shape[1]) - basis_of_posture @ basis_of_posture.mT
        squares_taken = np.einsum(
            "ni,nij,nj->n",
            residual_of_posture,
            np.linalg.pinv(remaining, rcond=DISTINCT, hermitian=True),
            residual_of_posture,
        )
        read_counts, total_squares = np.maximum(stack.read, 1), float(residual @ residual)
        degrees_of_freedom = int(stack.read.sum()) - basis.shape[1] - read_counts
        variance = (
            np.maximum(total_squares - squares_taken, 0.0) / np.maximum(degrees_of_freedom, 1) + RESOLUTION**2
        )
        f_ratio = squares_taken / read_counts / variance
        p_values = special.fdtrc(read_counts, np.maximum(degrees_of_freedom, 1), f_ratio)
        p_values = np.where(degrees_of_freedom > 0, p_values, 1.0)
        worst = int(np.argmin(p_values))
        mean_squares = squares_taken / read_counts
        is_typical = mean_squares[worst] < _GROSS * np.median(mean_squares)
        if p_values[worst] * posture_count >= MISTAKE_LEVEL or is_typical:
            return None
        ratio = max(1.0 - squares_taken[worst] / total_squares, 1e-300)
        criterion = self.criterion(self.residual_squares() * ratio, unknowns + int(read_counts[worst]) + 1)
        return WrongPosture(measurements.labels[worst], float(p_values[worst] * posture_count), criterion)

    def p_values(self, names: Sequence[str], *others: str) -> list[float]:
        """Return the p-value of each named term, tested as an addition to the joints and to other terms."""
        fitted = (*self.fitted, *others)
        p_values = self._largest_p_values(
            MISTAKE_LEVEL, names, fitted, lambda triangle, tested: triangle.p_values(tested, fitted)
        )
        return [*p_values.tolist()]

    def links_p_value(self, *others: str) -> float:
        """Return the p-value of elastic links, tested as an addition to the joints and to other terms."""
        fitted = (*self.fitted, *others)
        p_values = self._largest_p_values(
            LINKS_LEVEL,
            [DIAGONAL_LINKS.name],
            fitted,
            lambda triangle, tested: triangle.p_values(
                tested, fitted, most_directions=self._leading_count, least_singular_value=INDEPENDENT
            ),
        )
        return float(p_values[0])

    @property
    def _leading_count(self) -> int:
        """Number of leading combinations of link compliances to test; lower if there are few readings."""
        return max(0, min(_MOST_COMBINATIONS, (self.stated.rows - len(self.visible)) // 3))

    def residual_squares(self) -> float:
        """Return the sum of squared residuals of the joints and the terms that are fitted in any case."""
        return max(self.stated.residual_squares(self.fitted), 1e-300)

    def criterion(self, squares: float, unknowns: int) -> float:
        """Return the Bayesian information criterion of a fit.

        Args:
            squares: sum of squared residuals of the fit.
            unknowns: number of unknowns in addition to the joints.
        """
        return self.stated.rows * float(np.log(squares)) + unknowns * float(np.log(self.stated.rows))

    def links_criterion(self) -> float:
        """Return the Bayesian information criterion of joints with the leading combinations of links."""
        fitted_basis = orthonormal_basis(self.stated.unit_columns(self.fitted))
        link_columns = self.stated.unit_columns([DIAGONAL_LINKS.name])
        leading_basis = orthonormal_basis(
            link_columns - fitted_basis @ (fitted_basis.T @ link_columns), INDEPENDENT
        )[:, : self._leading_count]
        explained = float(np.square(leading_basis.T @ self.stated.rhs).sum())
        return self.criterion(max(self.residual_squares() - explained, 1e-300), leading_basis.shape[1])

    def base_criterion(self) -> float:
        """Return the Bayesian information criterion of joints with a base that bends."""
        fitted = (*self.fitted, DIAGONAL_BASE.name)
        squares = max(self.stated.residual_squares(fitted), 1e-300)
        return self.criterion(squares, len(self.stated.span[DIAGONAL_BASE.name]))
