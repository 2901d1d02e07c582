"""Convex programs of the project, stated in cvxpy and solved by Clarabel; docs/method.md has the formulas.

    least_squares    minimise ‖A x − b‖²                             identification (§5)
    huber            minimise Σ_i ρ(‖d_i − A_i x‖) + ½ ‖S x − t‖²    identification with Huber's loss (§5)
    interval_end     minimise aᵀx subject to ‖A x‖ ≤ 1               end of a profile-likelihood interval (§6)
    semidefinite     minimise ‖T y − z‖² + pᵀy                       elastic links (§7)

The first three are subject to lower ≤ x ≤ upper and B x ≥ d, the last one to x_j ≥ 0 and Mat(x_b) ⪰ 0 with
x = near + y. Variables are equilibrated. A program is compiled once for a shape, its data being parameters.
Huber's loss has a cone for each reading; it is stated with its data, as that compiles faster.

The points returned are near an optimum, to Clarabel's tolerance: callers polish them, and certify the outcome
from the data.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.scaled import Scaled
from jointstiff.solver.convex.semidefinite.symmetric import to_matrix

if TYPE_CHECKING:
    import cvxpy as cp  # takes a second to import: done where a program is stated


TOLERANCE: Final = 1e-10
"""Clarabel's default absolute gap of 1e-8 bounds the residual only by its square root."""

_CONE_TOLERANCE: Final = 1e-8
"""Near the tip of a second-order cone Clarabel does not always reach more."""

_SETTINGS: Final[Mapping[str, Any]] = {
    "max_iter": 200,
    "max_threads": 1,
    "iterative_refinement_abstol": 1e-14,
    "iterative_refinement_reltol": 1e-14,
    "iterative_refinement_max_iter": 30,
}


@dataclass(frozen=True, eq=False)
class Program:
    """A stated program with its variable and named parameters.

    Attributes:
        problem: as cvxpy has it, compiled at its first solution.
        x: the variable that is asked for.
        lock: held while parameters are set and solved for, as a cvxpy problem is mutable.
    """

    problem: cp.Problem
    x: cp.Variable
    lock: threading.Lock = field(default_factory=threading.Lock)

    def solve(self, data: Mapping[str, FloatArray], tolerance: float = TOLERANCE) -> FloatArray | None:
        """Solve by Clarabel.

        Args:
            data: values of the parameters, by name.
            tolerance: on gaps and feasibility.

        Returns:
            The point, or None for any status but `optimal`, whatever values it left behind.
        """
        import cvxpy as cp

        tolerances = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
        with self.lock, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate answer is recognised by its status below
            for name, value in data.items():
                self.problem.param_dict[name].value = value
            try:
                self.problem.solve(solver=cp.CLARABEL, **_SETTINGS, **tolerances)
            except cp.SolverError:
                return None
            status, value = self.problem.status, self.x.value
        if status != cp.OPTIMAL or value is None or not np.isfinite(value).all():
            return None
        return np.asarray(value, dtype=np.float64)


def least_squares(scaled: Scaled) -> FloatArray | None:
    """Solve ``minimise ‖A x − b‖² subject to lower ≤ x ≤ upper, B x ≥ d``; (n,) x, or None."""
    program = _least_squares(*_shape(scaled))
    return program.solve({"A": scaled.A, "b": scaled.b, **_constraint_data(scaled)})


@lru_cache(maxsize=128)
def _least_squares(rows: int, columns: int, below: _Places, above: _Places, inequalities: int) -> Program:
    import cvxpy as cp

    x, r = cp.Variable(columns), cp.Variable(rows)
    A, b = cp.Parameter((rows, columns), name="A"), cp.Parameter(rows, name="b")
    constraints = [r == A @ x - b, *_constraints(x, below, above, inequalities)]
    return Program(cp.Problem(cp.Minimize(cp.sum_squares(r)), constraints), x)


def huber(A: FloatArray, d: FloatArray, S: FloatArray, t: FloatArray, scaled: Scaled) -> FloatArray | None:
    """Solve ``minimise Σ_i ρ(‖d_i − A_i x‖) + ½ ‖S x − t‖²`` under the constraints.

    ρ(u) is u²/2 up to 1, and u − ½ beyond (Huber 1964, on norms, so that no frame is preferred).

    Args:
        A: (K, 3, n) of K targets.
        d: (K, 3).
        S: (q, n) rows whose loss stays squared.
        t: (q,).
        scaled: bounds and inequalities on x; its A and b are not used.

    Returns:
        (n,) x, or None.
    """
    import cvxpy as cp

    x = cp.Variable(A.shape[2])
    residuals = d.ravel() - A.reshape(-1, A.shape[2]) @ x
    norms = cp.norm(cp.reshape(residuals, d.shape, order="C"), axis=1)
    loss = 0.5 * cp.sum(cp.huber(norms, 1.0)) + 0.5 * cp.sum_squares(S @ x - t)
    _, _, below, above, inequalities = _shape(scaled)
    program = Program(cp.Problem(cp.Minimize(loss), _constraints(x, below, above, inequalities)), x)
    return program.solve(_constraint_data(scaled))


def interval_end(objective: FloatArray, ball: Scaled) -> FloatArray | None:
    """Solve ``minimise aᵀx subject to ‖A x − b‖ ≤ 1, lower ≤ x ≤ upper, B x ≥ d``; (n,) x, or None."""
    program = _interval_end(*_shape(ball))
    return program.solve(
        {"a": objective, "A": ball.A, "b": ball.b, **_constraint_data(ball)}, _CONE_TOLERANCE
    )


@lru_cache(maxsize=128)
def _interval_end(rows: int, columns: int, below: _Places, above: _Places, inequalities: int) -> Program:
    import cvxpy as cp

    x, a = cp.Variable(columns), cp.Parameter(columns, name="a")
    A, b = cp.Parameter((rows, columns), name="A"), cp.Parameter(rows, name="b")
    constraints = [cp.norm(A @ x - b) <= 1, *_constraints(x, below, above, inequalities)]
    return Program(cp.Problem(cp.Minimize(a @ x), constraints), x)


@lru_cache(maxsize=64)
def semidefinite(rows: int, scalars: int, sizes: tuple[int, ...]) -> Program:
    """State ``minimise ‖T y − z‖² + pᵀy subject to near_j + y_j ≥ 0, Mat(near_b + y_b) ⪰ 0``.

    With the residual as a variable of its own the Gram matrix, whose condition is the square of the
    regressor's, is never formed.

    Args:
        rows: of T.
        scalars: how many of the first parameters are zero or positive.
        sizes: of the blocks that follow, each a symmetric matrix as in `symmetric`.

    Returns:
        The program; its parameters are T (rows, m), z (rows,), p (m,) and near (m,).
    """
    import cvxpy as cp

    dimension = scalars + sum(size * (size + 1) // 2 for size in sizes)
    y, r = cp.Variable(dimension), cp.Variable(rows)
    T, z = cp.Parameter((rows, dimension), name="T"), cp.Parameter(rows, name="z")
    p, near = cp.Parameter(dimension, name="p"), cp.Parameter(dimension, name="near")
    x = near + y
    constraints = [r == T @ y - z]
    if scalars:
        constraints.append(x[:scalars] >= 0)
    start = scalars
    for size in sizes:
        stop = start + size * (size + 1) // 2
        basis = to_matrix(np.eye(stop - start), size).reshape(stop - start, -1).T
        block = cp.reshape(basis @ x[start:stop], (size, size), order="C")
        constraints.append(x[start:stop] >= 0 if size == 1 else block >> 0)
        start = stop
    return Program(cp.Problem(cp.Minimize(cp.sum_squares(r) + p @ y), constraints), y)


_Places = tuple[int, ...]
"""Indices of the parameters that have a bound."""


def _shape(scaled: Scaled) -> tuple[int, int, _Places, _Places, int]:
    """Return all that a program is compiled for: sizes, and which parameters have bounds."""
    below, above = (np.flatnonzero(np.isfinite(bound)).tolist() for bound in (scaled.lower, scaled.upper))
    return *scaled.A.shape, tuple(below), tuple(above), len(scaled.d)


def _constraints(x: cp.Variable, below: _Places, above: _Places, inequalities: int) -> list[cp.Constraint]:
    import cvxpy as cp

    constraints = []
    if below:
        constraints.append(x[list(below)] >= cp.Parameter(len(below), name="lower"))
    if above:
        constraints.append(x[list(above)] <= cp.Parameter(len(above), name="upper"))
    if inequalities:
        B, d = cp.Parameter((inequalities, x.size), name="B"), cp.Parameter(inequalities, name="d")
        constraints.append(B @ x >= d)
    return constraints


def _constraint_data(scaled: Scaled) -> dict[str, FloatArray]:
    lower, upper = (bound[np.isfinite(bound)] for bound in (scaled.lower, scaled.upper))
    data = {"lower": lower, "upper": upper, "B": scaled.B, "d": scaled.d}
    return {name: value for name, value in data.items() if value.size}
