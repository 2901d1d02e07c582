"""Convex problem of every fit, and its optimum, as data (method.md §5, §7, §14).

    minimise ‖R x − z‖² + pᵀx   subject to   x in a cone

Joints, elastic links and own weight differ in the shape of the cone: scalars within bounds, positive
semidefinite matrices, products of compliances with masses. `solver.fit.solution.solve` finds the optimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Generic, NamedTuple, TypeVar

import numpy as np

from jointstiff.schemas.run import SupportFinder
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Matrices, Scalars, WithMasses
from jointstiff.solver.fit.constraints import TOLERANCE
from jointstiff.solver.fit.triangle import compute_triangular_factor

_ORIGIN_RCOND: Final = 1e-6
"""Singular values below this part of the first are ignored in the origin of a program."""

Shape_co = TypeVar("Shape_co", bound=Scalars | Matrices | WithMasses, covariant=True)
"""Shape of a problem's cone, which decides how the problem is solved."""


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Quadratic part ‖R x − z‖² of the objective, shared by problems with different penalties."""

    R: FloatArray  #: (m, p) regressor
    z: FloatArray  #: (m,) readings

    @cached_property
    def column_norms(self) -> FloatArray:
        """Norms (p,) of the columns of R."""
        largest = np.abs(self.R).max(axis=0, initial=0.0)
        # Divide by the largest entry first: the squares of very small or large entries under- or overflow.
        divisor = np.where(largest > 0, largest, 1.0)
        return np.asarray(np.linalg.norm(self.R / divisor, axis=0) * largest)

    @cached_property
    def origin(self) -> FloatArray:
        """Origin (p,) of the variables of cone programs: an approximate least-squares solution.

        Small singular values are ignored, so that the origin is not huge.
        """
        return np.asarray(np.linalg.lstsq(self.R, self.z, rcond=_ORIGIN_RCOND)[0])

    @cached_property
    def compressed(self) -> tuple[FloatArray, FloatArray]:
        """Triangular matrix T (k, p) and readings y (k,): ‖T x − y‖² equals ‖R x − z‖² up to a constant."""
        p = self.R.shape[1]
        factor = compute_triangular_factor(np.column_stack([self.R, self.z]))
        T, y = factor[:p, :p], factor[:p, p]
        return T, y

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return ``Rᵀ(R x − z)`` (p,), half the gradient of ‖R x − z‖²."""
        return np.asarray(self.R.T @ (self.R @ x - self.z))

    def loss(self, x: FloatArray) -> float:
        """Return ‖R x − z‖² at x (p,)."""
        residual = self.R @ x - self.z
        return float(residual @ residual)


@dataclass(frozen=True, eq=False)
class Problem(Generic[Shape_co]):
    """minimise ‖R x − z‖² + pᵀx subject to x in a cone; p penalises the parameters that the cone names.

    Problems over matrices have readings of unit norm, and columns of unit norm for scalars without a
    penalty, which are independent. Problems over scalars may have any units: `equilibrated`.
    """

    squares: LeastSquares  #: quadratic part
    cone: Shape_co  #: cone of the parameters
    weight: float = 0.0  #: λ of the penalty, positive for a cone of matrices; other cones have no penalty

    @cached_property
    def penalty(self: Problem[Matrices]) -> FloatArray:
        """Gradient p (p,) of the penalty."""
        return self.cone.penalty(self.weight)

    def slack(self: Problem[Matrices], x: FloatArray) -> FloatArray:
        """Return the gradient ``2 Rᵀ(R x − z) + p`` (p,) of the objective at x (p,).

        The gradient is also the slack of the constraints of the dual program. At the optimum it is in the
        dual cone and orthogonal to x: a scalar or eigenvalue of x that is not zero has no slack.
        """
        R, z = self.squares.R, self.squares.z
        return np.asarray(2.0 * R.T @ (R @ x - z) + self.penalty)

    @cached_property
    def equilibrated(self: Problem[Scalars]) -> Equilibrated:
        """The problem in variables that give columns, rows of inequalities and readings unit norm.

        Raises:
            SolverError: a number is not finite, or a column is zero.
        """
        R, z = self.squares.R, self.squares.z
        if not (np.isfinite(R).all() and np.isfinite(z).all()):
            raise SolverError(
                "the regressor contains numbers that are too large",
                remedy="check the units and the magnitudes of the readings",
            )
        column_norms = self.squares.column_norms
        if not (column_norms > 0).all():
            raise SolverError("a parameter has no effect on the readings")
        reading_norm = float(np.linalg.norm(z)) or 1.0
        unit = reading_norm / column_norms
        squares = LeastSquares(R / column_norms, z / reading_norm)
        return Equilibrated(Problem(squares, self.cone.in_units(unit)), unit)


class Equilibrated(NamedTuple):
    """Problem over scalars whose columns, rows and readings have unit norm."""

    problem: Problem[Scalars]  #: the problem in the scaled variables x
    unit: FloatArray  #: (n,) units of the variables, ``c = unit · x`` [rad/(N·m)]


@dataclass(frozen=True)
class Witness:
    """Agreement of Clarabel's own answer, before any refinement, with the certified optimum."""

    #: distance of the fitted readings of the two answers, relative to the readings; inf without an answer
    distance: float
    limit: float = 2e-5  #: greatest distance that Clarabel's tolerance explains, near the root of 1e-10

    @property
    def agrees(self) -> bool:
        """Return whether Clarabel found the optimum to its tolerance."""
        return self.distance <= self.limit


@dataclass(frozen=True, eq=False)
class Certificate:
    """Evidence that an answer is the optimum of a convex program, computed from the data at the answer.

    Violations are dimensionless, and beyond rounding. For least squares in equilibrated variables a gradient
    is the cosine between a column and the residual, times ‖residual‖/‖z‖.
    """

    primal: float  #: greatest violation of a constraint; for a cone, the most negative scalar or eigenvalue
    #: greatest part of the gradient that the multipliers do not balance. For a cone, distance of the slack
    #: from the dual cone before the multipliers were changed, over the weight of the penalty
    dual: float
    #: greatest min(multiplier, slack). For a cone, root of the objective's excess over the lower bound that
    #: the multipliers prove, with ‖z‖ = 1: the fitted readings differ from those of the optimum by no more.
    #: For a robust loss, the excess
    gap: float
    #: (n + k,) multipliers of the bounds, positive at a lower and negative at an upper bound, then of the
    #: inequalities. For a cone, (m,) or (K, 3) multipliers of the equations that define the residuals
    multipliers: FloatArray
    solved_by: SupportFinder  #: algorithm that found the active bounds
    #: comparison with Clarabel's own answer; None where Clarabel was not asked. The violations above prove
    #: the optimum, whichever algorithm found it
    witness: Witness | None = None

    def is_optimal(self) -> bool:
        """Return whether no violation exceeds `TOLERANCE`, so that the point is the optimum."""
        return max(self.primal, self.dual, self.gap) <= TOLERANCE


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum of a problem, with its certificate."""

    x: FloatArray  #: (p,) the optimum, in the units of the problem
    certificate: Certificate  #: evidence of optimality
