"""Outcome of a method before sigma is known, and its likelihood: a quadratic form, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, Support
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.observability.combination import Combination
from jointstiff.solver.observability.identifiability import Identifiability


@dataclass(frozen=True, eq=False)
class Likelihood:
    """``‖R (c − ĉ)‖²`` is −2 sigma² log L(c) but for a constant, over p of the compliances.

    An unconstrained estimate ĉ = H d is Gaussian with covariance sigma² C, C = H Σ Hᵀ, so RᵀR = C⁻¹ on what
    is determined. For weighting by covariance in one stage R is the compressed regressor itself.
    """

    joints: IndexArray  #: (p,) which compliances, ascending
    centre: FloatArray  #: (p,) the unconstrained estimate ĉ [rad/(N·m)]
    covariance: FloatArray  #: (p, p) C, in units of sigma²
    given_rows: FloatArray | None = None  #: (k, p) R if it is known; must be given where ĉ is not unique

    @cached_property
    def rows(self) -> FloatArray:
        """(k, p) R."""
        return rows_of(self.covariance) if self.given_rows is None else self.given_rows

    def inflated(self, factor: float) -> Likelihood:
        """The same centre, its variance greater by a factor."""
        rows = None if self.given_rows is None else self.given_rows / np.sqrt(factor)
        return Likelihood(self.joints, self.centre, factor * self.covariance, rows)

    def with_common(self, responses: FloatArray) -> Likelihood:
        """The same centre with covariance ``C + S Sᵀ``, which takes ``RᵀR`` to ``Rᵀ(I + (R S)(R S)ᵀ)⁻¹R``.

        Args:
            responses: S (p, k), in units of sigma.
        """
        rows = self.given_rows
        if rows is not None:
            U, s, _ = np.linalg.svd(rows @ responses, full_matrices=False)
            rows = rows + U @ ((1.0 / np.hypot(1.0, s) - 1.0)[:, None] * (U.T @ rows))
        return Likelihood(self.joints, self.centre, self.covariance + responses @ responses.T, rows)

    def interval(self, wanted: IndexArray, radii: FloatArray) -> FloatArray:
        """Ends (q, w, 2) of unconstrained intervals [rad/(N·m)].

        Args:
            wanted: (w,) which of the p.
            radii: (q,) half-widths in standard uncertainties, times sigma.
        """
        half = radii[:, None] * np.sqrt(np.diagonal(self.covariance)[wanted])
        ends: FloatArray = self.centre[wanted, None] + half[..., None] * np.array([-1.0, 1.0])
        return ends


def rows_of(covariance: FloatArray) -> FloatArray:
    """R (p, p) with RᵀR the inverse of a covariance (p, p).

    Eigenvalues of the correlations that are lost in rounding count as rounding: that information is
    understated, never overstated.
    """
    deviation = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    least = len(values) * np.finfo(float).eps * values[-1]
    rows: FloatArray = (vectors / np.sqrt(np.maximum(values, least))).T / deviation
    return rows


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a method before sigma is known."""

    compliance: FloatArray  #: (n,) optimum [rad/(N·m)]; zero for null columns
    active: Support  #: (n,) -1 or 1 at a lower or upper bound, else 0
    tied: BoolArray  #: (n,) joints whose compliance an order makes equal to another's
    covariance: FloatArray  #: (n, n) of the unconstrained estimate in units of sigma²; zero for null columns
    likelihood: Likelihood  #: likelihood of the compliances that the readings see, before any constraint
    parameters: float  #: how many the readings were asked for: the rank, less what a prior answered instead
    #: groups of joints that neither the readings nor a prior tell apart
    undetermined: tuple[Combination, ...]
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage, by the readings alone
    certificates: tuple[Certificate, ...]  #: certificates of each stage
    alone: Fit | None = None  #: where a prior takes part, the fit of the readings alone

    def inflated(self, factor: float) -> Fit:
        """The same estimate, its variance greater by a factor."""
        if factor == 1.0:
            return self
        return replace(self, covariance=factor * self.covariance, likelihood=self.likelihood.inflated(factor))

    def with_common(self, responses: FloatArray) -> Fit:
        """The same estimate with the variance of errors that all observations share.

        Args:
            responses: (n, k) what a standard uncertainty of each moves, in units of sigma.
        """
        return replace(
            self,
            covariance=self.covariance + responses @ responses.T,
            likelihood=self.likelihood.with_common(responses[self.likelihood.joints]),
        )
