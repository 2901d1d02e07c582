"""Estimation of sigma from the residuals, and its test against the stated value (method.md §6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy import special

from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.regression.compression import Compression

SIGMA_TEST_LEVEL: Final = 0.01
"""Significance level: share of campaigns whose stated sigma is rejected although model and sigma are
right."""

_LEAST_FREEDOM = 0.5
"""Least degrees of freedom; they are integers, or nearly, for every method."""


def student_quantile(probability: float, degrees_of_freedom: float | None) -> float:
    """Return the quantile in standard uncertainties: Student's, or the normal one for None."""
    if degrees_of_freedom is None:
        return float(special.ndtri(probability))
    return float(special.stdtrit(degrees_of_freedom, probability))


@dataclass(frozen=True)
class Scale:
    """Sigma and the residuals under it."""

    #: standard uncertainty of one coordinate of one reading [m]; None where it was not given and there are
    #: no degrees of freedom to estimate it from
    sigma: float | None
    given: bool  #: whether it was stated with the readings
    chi_square: float  #: chi square of the targets' residuals, under sigma
    degrees_of_freedom: float  #: expectation of chi_square where model and sigma are right

    def quantile(self, probability: float) -> float:
        """Return the quantile in standard uncertainties: normal, or Student's where sigma is estimated."""
        return student_quantile(probability, None if self.given else self.degrees_of_freedom)


@dataclass(frozen=True)
class SigmaTest:
    """Two-sided chi-square test of a stated sigma against the residuals."""

    p_value: float  #: probability of residuals as unlikely as these, were model and sigma right
    verdict: Literal["consistent", "residuals_too_large", "residuals_too_small"]  #: at `SIGMA_TEST_LEVEL`


def scale_of(fit: Fit, readings: Compression, sigma: float | None) -> Scale:
    """Chi-square of the targets' residuals, its degrees of freedom, and sigma.

    For any linear unbiased ĉ of covariance C, ``E[χ²] = rows − 2 p + tr(AᵀΣ⁻¹A C)``; for weighted least
    squares that is rows − p. It lets the three methods be judged on the same readings. Where a prior takes
    part, p is the number of parameters that the readings were asked for, and the expectation is over it.

    Args:
        fit: outcome of a method.
        readings: compressed rows of all readings, whitened in units of sigma.
        sigma: as stated with the readings [m], or None.
    """
    R = readings.matrix
    squares = float(np.sum((R @ fit.compliance - readings.rhs) ** 2))
    information = float(np.sum((R @ fit.covariance) * R))
    freedom = readings.rows - 2 * fit.parameters + information
    freedom = 0.0 if freedom < _LEAST_FREEDOM else freedom
    if sigma is not None:
        with np.errstate(all="ignore"):  # an overflow is refused later, with its remedy
            chi_square = float(np.float64(squares) / np.float64(sigma) ** 2)
        return Scale(sigma, True, chi_square, freedom)
    if freedom < _LEAST_FREEDOM:
        return Scale(None, False, 0.0, freedom)
    return Scale(float(np.sqrt(squares / freedom)), False, freedom, freedom)


def sigma_test(chi_square: float, degrees_of_freedom: float) -> SigmaTest | None:
    """Test a stated sigma; None where there are no degrees of freedom."""
    if degrees_of_freedom < _LEAST_FREEDOM:
        return None
    tails = special.chdtr(degrees_of_freedom, chi_square), special.chdtrc(degrees_of_freedom, chi_square)
    p_value = min(1.0, 2.0 * float(min(tails)))
    if p_value >= SIGMA_TEST_LEVEL:
        return SigmaTest(p_value, "consistent")
    return SigmaTest(p_value, "residuals_too_large" if tails[1] < tails[0] else "residuals_too_small")
