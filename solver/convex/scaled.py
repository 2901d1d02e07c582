"""Problems in equilibrated variables, independent of units and of decades between the joints (method §5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.problem import IdentificationProblem


@dataclass(frozen=True, eq=False)
class Scaled:
    """minimise ‖A x − b‖² subject to lower ≤ x ≤ upper and B x ≥ d, all rows and columns of unit norm."""

    A: FloatArray  #: (m, n) columns of unit norm
    b: FloatArray  #: (m,) unit norm, or zero
    lower: FloatArray  #: (n,) least x; -inf where there is none
    upper: FloatArray  #: (n,) greatest x; inf where there is none
    B: FloatArray  #: (k, n) rows of unit norm; k = 0 without inequalities
    d: FloatArray  #: (k,)
    unit: FloatArray  #: (n,) units of the variables, ``c = unit · x`` [rad/(N·m)]

    @classmethod
    def of(cls, problem: IdentificationProblem) -> Scaled:
        """Equilibrate a problem."""
        column_norms = problem.column_norms
        size = float(np.linalg.norm(problem.z)) or 1.0
        unit = size / column_norms
        B, d = np.zeros((0, len(unit))), np.zeros(0)
        if problem.inequalities is not None:
            B = problem.inequalities.matrix * unit
            norms = np.linalg.norm(B, axis=1)
            B, d = B / norms[:, None], problem.inequalities.least / norms
        bounds = problem.bounds
        return cls(
            A=problem.R / column_norms,
            b=problem.z / size,
            lower=bounds.lower / unit,
            upper=bounds.upper / unit,
            B=B,
            d=d,
            unit=unit,
        )

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return ``Aᵀ(A x − b)`` (n,), half the gradient of the objective."""
        gradient: FloatArray = self.A.T @ (self.A @ x - self.b)
        return gradient
