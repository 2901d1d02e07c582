"""The convex problem as data, in equilibrated variables, and its supports: which parameters a bound holds.

See method.md §5. Functions of supports work on one problem (n,) and on many at once (K, n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray, Support
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
            raise SolverError("an inequality constraint has only zero coefficients")


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """minimise ‖R c − z‖² subject to lower ≤ c ≤ upper, and to linear inequalities if there are any.

    Raises:
        SolverError: if a number is not finite, shapes disagree, or a column is zero.
    """

    R: FloatArray  #: (m, n) compressed, weighted regressor; every column has a positive norm
    z: FloatArray  #: (m,) compressed, weighted deflections
    bounds: Bounds  #: bounds of the n compliances
    inequalities: Inequalities | None = None  #: inequalities that hold besides, or None

    def __post_init__(self) -> None:
        shapes = {self.bounds.lower.shape, self.bounds.upper.shape, self.R.shape[1:]}
        if len(shapes) != 1 or self.R.shape[:1] != self.z.shape:
            raise SolverError("shapes disagree")
        if not (np.isfinite(self.R).all() and np.isfinite(self.z).all()):
            raise SolverError(
                "the regressor contains numbers that are too large",
                remedy="check the units and the magnitudes of the readings",
            )
        if not (self.column_norms > 0).all():
            raise SolverError("a parameter has no effect on the readings")

    @property
    def column_norms(self) -> FloatArray:
        """(n,) norms of the columns of R, which equilibrate it."""
        largest = np.abs(self.R).max(axis=0, initial=0.0)
        # Scaled first: the squares of a column in other units may under- or overflow.
        safe = np.where(largest > 0, largest, 1.0)
        norms: FloatArray = np.linalg.norm(self.R / safe, axis=0) * largest
        return norms


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


FREE, LOWER, UPPER = 0, -1, 1

TOLERANCE = 1e-12
"""Largest violation of an optimality condition, in equilibrated variables, that counts as rounding."""


def support_at(x: FloatArray, lower: FloatArray, upper: FloatArray) -> Support:
    """Return the support of a point whose parameters lie exactly on their bounds or within them."""
    return np.where(x == lower, LOWER, np.where(x == upper, UPPER, FREE)).astype(np.int8)


def held(active: Support, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the bound of each parameter that one holds, and zero for those that are free."""
    return np.where(active == LOWER, lower, np.where(active == UPPER, upper, 0.0))


def snap(x: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Clip to the bounds and snap values within rounding of one; the certificate is computed afterwards."""
    x = np.where(x - lower <= TOLERANCE, lower, x)
    return np.where(upper - x <= TOLERANCE, upper, x)


def pivot(
    active: Support, x: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> Support:
    """Move all parameters that violate their condition: one round of block principal pivoting.

    A free parameter outside its bounds goes to the bound, one at a bound with a multiplier of the wrong sign
    is freed. Rounds may cycle, which the certificate detects (Portugal, Júdice & Vicente 1994).
    """
    pull = np.where(active == LOWER, gradient, np.where(active == UPPER, -gradient, 1.0))
    moved = np.where(pull < 0, FREE, active)
    return np.where(x < lower, LOWER, np.where(x > upper, UPPER, moved)).astype(np.int8)


def gradient_violation(
    x: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return the gradient's part of the wrong sign at a bound, and all of it off the bounds."""
    return np.asarray(
        np.where(x <= lower, -gradient, np.where(x >= upper, gradient, np.abs(gradient))), dtype=np.float64
    )
