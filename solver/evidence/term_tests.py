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
from typing import Final, NamedTuple

import numpy as np
from scipy import special
from scipy.optimize import brentq

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.evidence.scatter import RestrictedLikelihood
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.triangle import DISTINCT, INDEPENDENT, RESOLUTION, Triangle, orthonormal_basis
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

    upper_limit = _find_upper_limit(compute_missing_power, float(tested_count))
    if upper_limit > _LARGEST_NONCENTRALITY:
        return np.inf
    return float(brentq(compute_missing_power, 0.0, upper_limit, xtol=1e-6))


def _find_upper_limit(decreasing: Callable[[float], float], start: float) -> float:
    """Return a number above the zero of a decreasing function: `start` times a power of 4.

    The search ends above `_LARGEST_NONCENTRALITY`.
    """
    limit = start
    while decreasing(limit) > 0.0:
        limit *= 4.0
        if limit > _LARGEST_NONCENTRALITY:
            break
    return limit


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
        joined = joined.project_out_stated(term.name, uncertainty, sigma)
    return joined


@dataclass(frozen=True)
class WrongPosture:
    """Posture whose readings disagree with those of all others."""

    label: str  #: label of the observation
    p_value: float  #: p-value of the F test, for all postures
    criterion: float  #: Bayesian information criterion of the fit without this posture


class _ScatteredFit(NamedTuple):
    """Terms that are fitted together, and the rows with the scatter of the joints that suits them best."""

    terms: list[Term]  # the terms of interest, then other terms about which something is stated
    stated_terms: list[Term]  # these other terms; their unknowns are zero within what is stated
    rows: Rows

    @property
    def names(self) -> list[str]:
        """Names of all fitted terms."""
        return [term.name for term in self.terms]


@dataclass(frozen=True, eq=False)
class _LeftOut:
    """Fits that leave out each of N postures in turn, compared with the fit to all postures."""

    squares_taken: FloatArray  # (N,) decrease of the sum of squared residuals
    total_squares: float  # sum of squared residuals of the fit to all postures
    coordinates: IndexArray  # (N,) number of coordinates that were read in each posture
    unknown_count: int  # unknowns of each fit

    @property
    def counts(self) -> IndexArray:
        """(N,) number of coordinates of each posture; 1 for a posture without readings, to divide by it."""
        return np.maximum(self.coordinates, 1)

    @property
    def mean_squares(self) -> FloatArray:
        """(N,) decrease of the sum of squared residuals for each coordinate of the posture."""
        return self.squares_taken / self.counts

    @cached_property
    def p_values(self) -> FloatArray:
        """(N,) p-values of the F tests that a posture's readings agree with all others.

        The p-value is 1 if the other postures leave no degree of freedom.
        """
        freedom = int(self.coordinates.sum()) - self.unknown_count - self.counts
        divisor = np.maximum(freedom, 1)
        remaining_squares = np.maximum(self.total_squares - self.squares_taken, 0.0)
        variance = remaining_squares / divisor + RESOLUTION**2
        p_values = special.fdtrc(self.counts, divisor, self.mean_squares / variance)
        return np.where(freedom > 0, p_values, 1.0)

    def stands_out(self, posture: int) -> bool:
        """Return whether a posture disagrees far more than the typical posture."""
        is_typical = self.mean_squares[posture] < _GROSS * np.median(self.mean_squares)
        return not is_typical


def _list_stated_uncertainties(fit: _ScatteredFit, stack: Stack) -> FloatArray:
    """Return the stated standard uncertainties (k,) of the unknowns of all stated terms of a fit, in turn."""
    common = fit.rows.measurements.common_uncertainty
    uncertainties = [np.resize(term.prior(common), len(stack.span[term.name])) for term in fit.stated_terms]
    return np.concatenate([np.zeros(0), *uncertainties])


def _compute_squares_taken(basis: FloatArray, residual: FloatArray, *, posture_count: int) -> FloatArray:
    """Return by how much leaving out each of N postures decreases the sum of squared residuals: (N,).

    For posture i it is ``r_iᵀ (I − Q_i Q_iᵀ)⁻¹ r_i``, with the residuals r_i of its m rows in the fit to all
    postures, and its rows Q_i of the orthonormal basis of that fit.

    Args:
        basis: Q (N m, r).
        residual: r (N m,).
        posture_count: N.
    """
    r = residual.reshape(posture_count, -1)  # (N, m)
    Q = basis.reshape(posture_count, -1, basis.shape[1])  # (N, m, r)
    remaining = np.eye(Q.shape[1]) - Q @ Q.mT
    inverse = np.linalg.pinv(remaining, rcond=DISTINCT, hermitian=True)
    return np.asarray(np.einsum("ni,nij,nj->n", r, inverse, r))


class TermTests:
    """Compressed rows of joints, causes, links and base, with the stated and with equal weights.

    Attributes:
        rows: the observations.
        visible: (n,) whether the readings see each joint.
        triangle: compressed rows, with the weights stated with the readings.
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
        self.triangle = self._compress_rows(whitened=True)

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
        p_values = test(self.triangle, names)
        is_significant = p_values < level
        # Readings that share one covariance (3, 3) have equal weights already.
        have_equal_weights = self.rows.measurements.covariance.ndim == 2
        if is_significant.any() and not have_equal_weights:
            of_equal_weights = test(self._equally_weighted, names)
            p_values = np.where(is_significant, np.maximum(p_values, of_equal_weights), p_values)
        if self._scattered or self._stated_terms:
            for index in np.flatnonzero(p_values < level).tolist():
                given_statements = self._compute_p_value_given_statements(names[index], fitted, test)
                p_values[index] = max(p_values[index], given_statements)
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
        # The many unknowns of links would explain the scatter of few postures: the scatter is that without
        # links, as in a score test (C. R. Rao, 1948).
        explaining = fitted if name == DIAGONAL_LINKS.name else (*fitted, name)
        triangle = self.compress_given_statements((*fitted, name), explaining)
        own_statement = next((term for term in self._stated_terms if term.name == name), None)
        if own_statement is None:
            return float(test(triangle, [name])[0])
        common = self.rows.measurements.common_uncertainty
        uncertainty = np.resize(own_statement.prior(common), len(triangle.span[name]))
        p_value = triangle.statement_p_value(name, fitted, uncertainty)
        return float(test(triangle, [name])[0]) if p_value < STATEMENT_LEVEL else p_value

    def compress_given_statements(
        self, names: Sequence[str], explaining: Sequence[str] | None = None
    ) -> Triangle:
        """Return the triangle of some terms, in which statements about all other terms are fitted.

        If the residuals show a scatter of the joints, the rows have the scatter that is most likely with the
        terms.

        Args:
            names: terms of the triangle.
            explaining: those of them with which the scatter is most likely; None for all.
        """
        fit = self._account_for_scatter(names, names if explaining is None else explaining)
        triangle = fit.rows.stack(fit.terms, self.compliance).triangle()
        sigma = fit.rows.measurements.sigma or triangle.sigma(fit.names)
        triangle = join_statements(triangle, fit.stated_terms, fit.rows.measurements, sigma)
        triangle.span[JOINTS.name] = np.flatnonzero(self.visible)
        return triangle

    def _account_for_scatter(self, names: Sequence[str], explaining: Sequence[str]) -> _ScatteredFit:
        """Return the named terms with all other stated terms, and the rows with the scatter of the joints.

        If the residuals show scatter, the rows have the scatter that is most likely with the stated terms and
        those that are `explaining`.
        """
        stated_terms = [term for term in self._stated_terms if term.name not in names]
        terms = [*(term for term in self._terms if term.name in names), *stated_terms]
        rows = self.rows
        if self._scattered:
            of_scatter = [term for term in terms if term.name in explaining or term in stated_terms]
            likelihood = RestrictedLikelihood.from_rows(rows, of_scatter, self.compliance, self.visible)
            scatter, _ = likelihood.fit_shared_errors()
            rows = rows.with_scatter(scatter)
        return _ScatteredFit(terms, stated_terms, rows)

    def find_wrong_posture(self, unknowns: int) -> WrongPosture | None:
        """Return the posture whose readings disagree most with all others; None if chance may explain it.

        The F test is made for each posture (Bonferroni); the posture must also stand out from the typical
        posture, because causes that are not fitted move all of them.

        Args:
            unknowns: number of unknowns that are fitted in addition to the joints.
        """
        left_out = self._leave_out_each_posture()
        worst = int(np.argmin(left_out.p_values))
        p_value = float(left_out.p_values[worst] * len(left_out.p_values))
        if p_value >= MISTAKE_LEVEL or not left_out.stands_out(worst):
            return None
        ratio = max(1.0 - left_out.squares_taken[worst] / left_out.total_squares, 1e-300)
        unknowns_without_posture = unknowns + int(left_out.counts[worst]) + 1
        criterion = self.criterion(self.residual_squares() * ratio, unknowns_without_posture)
        return WrongPosture(self.rows.measurements.labels[worst], p_value, criterion)

    def _leave_out_each_posture(self) -> _LeftOut:
        """Fit the joints, and what is always fitted with them, without each posture in turn.

        Leaving out a posture equals a fit in which each of its coordinates is a free unknown.
        """
        fit = self._account_for_scatter(self.fitted, self.fitted)
        stack = fit.rows.stack(fit.terms, self.compliance)
        basis = self._build_basis(stack, fit)
        readings = stack.flat[:, -1]
        residual = readings - basis @ (basis.T @ readings)
        squares_taken = _compute_squares_taken(basis, residual, posture_count=len(stack))
        return _LeftOut(squares_taken, float(residual @ residual), stack.read, basis.shape[1])

    def _build_basis(self, stack: Stack, fit: _ScatteredFit) -> FloatArray:
        """Return an orthonormal basis (R, r) of the motions that a fit with statements explains, in R rows.

        Statements are further rows of the fit, below those of the readings: each unknown over its standard
        uncertainty is zero. They make the basis shorter than 1 in the rows of the readings.

        Args:
            stack: rows of the terms of the fit.
            fit: terms that are fitted, the stated ones last.
        """
        of_joints, *of_other_terms = stack.span.values()
        columns = np.concatenate([of_joints[self.visible], *of_other_terms])
        unit_vectors, lengths = unit_columns(stack.flat[:, columns])
        stated = _list_stated_uncertainties(fit, stack)
        sigma = fit.rows.measurements.sigma or stack.triangle().sigma(fit.names)
        weights = np.zeros(len(columns))
        first_stated = len(columns) - len(stated)
        weights[first_stated:] = sigma / np.maximum(stated, 1e-300) / lengths[first_stated:]
        statement_rows = np.diag(np.minimum(weights, 1e9))
        return orthonormal_basis(np.vstack([unit_vectors, statement_rows]))[: len(unit_vectors)]

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
        return max(0, min(_MOST_COMBINATIONS, (self.triangle.rows - len(self.visible)) // 3))

    def residual_squares(self) -> float:
        """Return the sum of squared residuals of the joints and the terms that are fitted in any case."""
        return max(self.triangle.residual_squares(self.fitted), 1e-300)

    def criterion(self, squares: float, unknowns: int) -> float:
        """Return the Bayesian information criterion of a fit.

        Args:
            squares: sum of squared residuals of the fit.
            unknowns: number of unknowns in addition to the joints.
        """
        return self.triangle.rows * float(np.log(squares)) + unknowns * float(np.log(self.triangle.rows))

    def links_criterion(self) -> float:
        """Return the Bayesian information criterion of joints with the leading combinations of links."""
        fitted_basis = orthonormal_basis(self.triangle.unit_columns(self.fitted))
        link_columns = self.triangle.unit_columns([DIAGONAL_LINKS.name])
        unexplained_columns = link_columns - fitted_basis @ (fitted_basis.T @ link_columns)
        leading_basis = orthonormal_basis(unexplained_columns, INDEPENDENT)[:, : self._leading_count]
        explained = float(np.square(leading_basis.T @ self.triangle.rhs).sum())
        return self.criterion(max(self.residual_squares() - explained, 1e-300), leading_basis.shape[1])

    def base_criterion(self) -> float:
        """Return the Bayesian information criterion of joints with a base that bends."""
        fitted = (*self.fitted, DIAGONAL_BASE.name)
        squares = max(self.triangle.residual_squares(fitted), 1e-300)
        return self.criterion(squares, len(self.triangle.span[DIAGONAL_BASE.name]))
