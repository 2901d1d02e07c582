"""The convex problem as data (method.md §5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError, SolverError


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds on the compliances [rad/(N·m)]; -inf and inf where there is none.

    Raises:
        RequestError: if a lower bound is not below its upper bound, or is NaN.
    """

    lower: FloatArray  #: (n,) least compliances
    upper: FloatArray  #: (n,) greatest compliances

    def __post_init__(self) -> None:
        if not (self.lower < self.upper).all():
            raise RequestError(
                "a lower bound is not less than its upper bound",
                where="stiffness_bounds",
                remedy="give the minimum stiffness first, then the maximum",
            )

    @classmethod
    def unconstrained(cls, n: int) -> Bounds:
        """No bounds at all."""
        return cls(np.full(n, -np.inf), np.full(n, np.inf))

    @classmethod
    def positive(cls, n: int) -> Bounds:
        """Compliance zero or positive: no joint bends against its load."""
        return cls(np.zeros(n), np.full(n, np.inf))

    def select(self, columns: IndexArray) -> Bounds:
        """The bounds of some of the parameters."""
        return Bounds(self.lower[columns], self.upper[columns])


@dataclass(frozen=True, eq=False)
class Inequalities:
    """Linear inequalities ``matrix @ c ≥ least`` besides the bounds.

    Raises:
        SolverError: if a number is not finite, or a row is zero.
    """

    matrix: FloatArray  #: (k, n), no row of zeros
    least: FloatArray  #: (k,)

    def __post_init__(self) -> None:
        rows_hold = np.isfinite(self.matrix).all() and np.isfinite(self.least).all()
        if not rows_hold or not self.matrix.any(axis=1).all():
            raise SolverError(
                "an inequality constraint has only zero coefficients",
                remedy="please report this problem, with the data",
            )


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """minimise ‖R c − z‖² subject to lower ≤ c ≤ upper, and to linear inequalities if there are any.

    Raises:
        SolverError: if a number is not finite, shapes disagree, or a column is zero.
    """

    R: FloatArray  #: (m, n) compressed, weighted regressor; every column has a positive norm
    z: FloatArray  #: (m,) compressed, weighted deflections
    bounds: Bounds  #: of the n compliances
    inequalities: Inequalities | None = None  #: that hold besides, or None

    def __post_init__(self) -> None:
        shapes = {self.bounds.lower.shape, self.bounds.upper.shape, self.R.shape[1:]}
        if len(shapes) != 1 or self.R.shape[:1] != self.z.shape:
            raise SolverError("shapes disagree", remedy="please report this problem, with the data")
        if not (np.isfinite(self.R).all() and np.isfinite(self.z).all()):
            raise SolverError(
                "the regressor contains numbers that are too large",
                remedy="check the units and the magnitudes of the readings",
            )
        if not (self.column_norms > 0).all():
            raise SolverError(
                "a parameter has no effect on the readings",
                remedy="please report this problem, with the data",
            )

    @property
    def column_norms(self) -> FloatArray:
        """(n,) norms of the columns of R, which equilibrate it."""
        largest = np.abs(self.R).max(axis=0, initial=0.0)
        # Scaled first: the squares of a column in other units may under- or overflow.
        safe = np.where(largest > 0, largest, 1.0)
        norms: FloatArray = np.linalg.norm(self.R / safe, axis=0) * largest
        return norms
