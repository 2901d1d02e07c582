"""Priors of compliances, for example from a data sheet, as rows of a fit (method.md §5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent Gaussian priors of the compliances (method.md §5).

    Raises:
        RequestError: if a known joint's uncertainty is not positive and finite.
    """

    mean: FloatArray  #: (n,) c₀ [rad/(N·m)]; NaN for joints without a prior
    standard_uncertainty: FloatArray  #: (n,) s₀ [rad/(N·m)], positive; inf for joints without a prior

    def __post_init__(self) -> None:
        uncertainty = self.standard_uncertainty[self.known]
        is_valid = (uncertainty > 0) & np.isfinite(uncertainty)
        if not is_valid.all():
            raise RequestError(
                "a prior's standard uncertainty is not positive",
                where="priors",
                remedy="give a positive stiffness and a positive standard uncertainty",
            )

    @property
    def known(self) -> BoolArray:
        """Mask (n,) of the joints that have a prior."""
        return np.isfinite(self.mean)

    def in_units_of(self, sigma: float) -> Prior:
        """Return the prior with uncertainties divided by sigma, the uncertainty of a coordinate [m]."""
        return Prior(self.mean, self.standard_uncertainty / sigma)

    def rows(self, joints: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the prior as rows ``c_j / s₀ = c₀ / s₀`` of a least-squares problem in p compliances c_j.

        c₀ and s₀ are the mean and the standard uncertainty of the prior of joint j.

        Args:
            joints: (p,) joint of each compliance c_j; a joint without a prior has no row.

        Returns:
            The matrix (k, p) for the k joints with a prior, and the right-hand side (k,).
        """
        with_prior = np.flatnonzero(self.known[joints])  # places in `joints`
        mean = self.mean[joints[with_prior]]
        uncertainty = self.standard_uncertainty[joints[with_prior]]
        matrix = np.eye(len(joints))[with_prior] / uncertainty[:, None]
        return matrix, matrix[:, with_prior] @ mean
