"""A problem in variables that neither units nor decades between the joints disturb (METHOD.md §5, step 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.least_distance import Inequality
from jointstiff.solver.convex.problem import IdentificationProblem, Inequalities

__all__ = ["Equilibrated"]


@dataclass(frozen=True, eq=False)
class Equilibrated:
    """minimise ‖A x − b‖² subject to lower ≤ x ≤ upper, with unit columns and a unit right-hand side.

    Attributes:
        A: (m, n) columns of unit norm.
        b: (m,) of unit norm, or zero.
        lower: (n,) least x; -inf where there is none.
        upper: (n,) greatest x; inf where there is none.
        unit: (n,) of the variables, ``c = unit · x`` [rad/(N·m)].
    """

    A: FloatArray
    b: FloatArray
    lower: FloatArray
    upper: FloatArray
    unit: FloatArray

    @classmethod
    def of(cls, problem: IdentificationProblem) -> Equilibrated:
        """The same problem."""
        column_norms = problem.column_norms
        size = float(np.linalg.norm(problem.z)) or 1.0
        unit = size / column_norms
        bounds = problem.bounds
        return cls(problem.R / column_norms, problem.z / size, bounds.lower / unit, bounds.upper / unit, unit)

    def rows(self, inequalities: Inequalities) -> Inequality:
        """Bounds and inequalities as rows of unit norm, the inequalities last."""
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        identity = np.eye(len(self.lower))
        matrix = inequalities.matrix * self.unit
        norms = np.linalg.norm(matrix, axis=1)
        return Inequality(
            self.A,
            self.b,
            np.vstack([identity[below], -identity[above], matrix / norms[:, None]]),
            np.concatenate([self.lower[below], -self.upper[above], inequalities.least / norms]),
        )
