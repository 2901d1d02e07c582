"""Cone program of a gearbox's twist in motion, stated in cvxpy and solved by Clarabel (method.md §19)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cvxpy as cp
import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.triangle import compute_triangular_factor
from jointstiff.solver.gearboxes.motion import CENTRE

_LEAST_TOLERANCE: Final = 0.01
"""Relative half-width of bounds below which a factor is exact: such narrow cones are solved badly."""
_TWIST: Final = 1e3
_COMPLIANCE: Final = 1e9
"""Units of the program: mrad and nrad/(N·m), so that its numbers are near 1."""


@dataclass(frozen=True, eq=False)
class Carried:
    """Body or gas spring that the motor of a joint carries."""

    torque: FloatArray  # (S,) as stated [N·m]
    tolerance: float  # relative half-width of the bounds of the torque's factor
    radius: float = 0.0  # of the ball that contains the centre of mass [m]
    by_centre: FloatArray | None = None  # (S, 3) change of the torque with the centre [N·m/m]


class TwistProgram:
    """Cone program of one joint.

    ``minimise ‖T z + M w + N b − twist‖  subject to  c ≥ 0, |z_k − c| ≤ r_k c, ‖w_k‖ ≤ R_k z_k, |b| ≤ β``,
    where z_k is the compliance times the factor of body or spring k, and w_k is z_k times the shift of its
    centre of mass.
    """

    def __init__(
        self, carried: Sequence[Carried], others: FloatArray, bounds: FloatArray, twist: FloatArray
    ) -> None:
        """State the program.

        Args:
            carried: bodies and springs.
            others: (S, k) columns of what twists without a torque.
            bounds: (b,) greatest coefficients of the first b of these columns.
            twist: (S,) [rad].
        """
        self.others = others
        self.c = cp.Variable(nonneg=True)
        self.b = cp.Variable(others.shape[1])
        # Unknowns with bounds reach from −1 to 1; the others have columns of root mean square 1.
        self._scale = np.linalg.norm(others, axis=0) / np.sqrt(len(others))
        self._scale[: len(bounds)] = 1.0 / (_TWIST * bounds)
        columns, unknowns = list[FloatArray](), list[cp.Expression]()
        self._constraints = [cp.abs(self.b[: len(bounds)]) <= 1.0]
        for each in carried:
            z = self._state_factor(each.tolerance)
            columns.append(each.torque[:, None])
            unknowns.append(z)
            if each.by_centre is not None and each.radius > 0.0:
                shift = cp.Variable(CENTRE)  # in radii of the ball
                self._constraints.append(cp.norm(shift) <= z)
                columns.append(each.radius * each.by_centre)
                unknowns.append(shift)
        unit = _TWIST / _COMPLIANCE
        self._matrix = np.column_stack([unit * np.column_stack(columns), others / self._scale])
        self._rhs = _TWIST * twist
        self._unknowns = cp.hstack([*unknowns, self.b])
        triangle = compute_triangular_factor(np.column_stack([self._matrix, self._rhs]))
        self._rest = triangle[:, :-1] @ self._unknowns - triangle[:, -1]

    def _state_factor(self, tolerance: float) -> cp.Expression:
        """Return the compliance times a factor within 1 ± tolerance; without a factor if that is tiny."""
        if tolerance < _LEAST_TOLERANCE:
            return self.c
        z = cp.Variable()
        self._constraints += [z >= (1.0 - tolerance) * self.c, z <= (1.0 + tolerance) * self.c]
        return z

    def solve(self) -> None:
        """Fit all unknowns by least squares."""
        self._solve(cp.Minimize(cp.sum_squares(self._rest)))
        self.residuals = (self._rhs - self._matrix @ self._unknowns.value) / _TWIST
        self.compliance = float(self.c.value) / _COMPLIANCE
        self.other = self.b.value / self._scale / _TWIST

    def find_ends(self, bound: float) -> tuple[float, float]:
        """Return the ends of the compliances whose residuals have at most the norm `bound` [rad]."""
        within = cp.norm(self._rest / (_TWIST * bound)) <= 1.0
        ends = []
        for sense in (cp.Minimize, cp.Maximize):
            self._solve(sense(self.c), within)
            ends.append(max(float(self.c.value), 0.0) / _COMPLIANCE)
        return ends[0], ends[1]

    def _solve(self, objective: cp.Minimize | cp.Maximize, *further: cp.Constraint) -> None:
        """Solve a problem with the constraints by Clarabel.

        Raises:
            SolverError: Clarabel finds no optimum.
        """
        problem = cp.Problem(objective, [*self._constraints, *further])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the status is checked below
            try:
                problem.solve(solver=cp.CLARABEL)
            except cp.SolverError as error:
                raise SolverError(f"Clarabel found no optimum: {error}") from error
        if problem.status != cp.OPTIMAL:
            raise SolverError(f"Clarabel found no optimum, but '{problem.status}'")
