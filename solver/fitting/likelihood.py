"""The log-likelihood of an estimate that is linear in the readings: a quadratic form, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray


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
