"""The door to the solver for semidefinite programs: Clarabel proposes, a certificate from the data decides.

    minimise ‖R x − z‖² + pᵀx   subject to   x_j ≥ 0 for the first parameters, and Mat(x_b) ⪰ 0 for the blocks

It is stated around a point near the least-squares solution, so that the objective does not drown in ‖z‖²,
solved along a ladder of tolerances, and polished by Newton's method on the face where the answer lies.
Whatever led to an answer, it is made feasible exactly, and a feasible point of the dual is made from its
residual; the gap between the two is computed without cancellation, and only an answer whose gap is small
enough leaves this module.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.semidefinite.cone import SemidefiniteProgram
from jointstiff.solver.convex.semidefinite.face import polished
from jointstiff.solver.convex.semidefinite.symmetric import to_matrix
from jointstiff.solver.errors import SolverError

_LADDER: Final = (1e-8, 1e-10, 1e-11, 1e-12)
"""Tolerances of Clarabel, tried in this order: not every problem can be solved to the last."""
_NEWTON_STEPS: Final = 4
"""Each doubles the digits, once the face is the right one."""
_SLACK_ROUNDING: Final = 1e-13
"""A slack that should be zero and is this far below is, in units of the column's norm and the readings'."""


@dataclass(frozen=True)
class ConeCertificate:
    """Evidence of optimality, computed from the data at the answer itself; lengths with ‖z‖ = 1.

    Attributes:
        primal: least scalar or eigenvalue; zero or positive.
        dual: how far the slack is outside of its cone, over λ; the dual point is moved by as much.
        gap: root of the difference between the objective at the answer and its value at a point that is
            feasible in the dual. The fitted readings differ from those of the optimum by no more.
        tolerance: of Clarabel, that sufficed.
    """

    primal: float
    dual: float
    gap: float
    tolerance: float


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """The optimum (p,) with its evidence."""

    x: FloatArray
    certificate: ConeCertificate


def solve_cone(program: SemidefiniteProgram, *, gap: float) -> ConeSolution:
    """Solve a program and prove it.

    Args:
        program: finite, readings of unit norm.
        gap: greatest gap of a certificate that is accepted, with ‖z‖ = 1.

    Raises:
        SolverError: no answer has such a certificate.
    """
    best = np.inf
    for tolerance in _LADDER:
        proposed = _clarabel(program, tolerance)
        for _ in range(1 + _NEWTON_STEPS):
            if proposed is None:
                break
            x = program.cone.project(proposed)
            certificate = certify_cone(program, x, tolerance)
            if certificate.primal >= 0.0 and certificate.gap <= gap:
                return ConeSolution(x, certificate)
            best = min(best, certificate.gap)
            proposed = polished(program, x)
    raise SolverError(
        f"the semidefinite program is not solved: its gap is {best:.1e}, and {gap:.1e} was to be reached",
        remedy="give a larger penalty, choose fewer links, or report this with the data",
    )


def certify_cone(program: SemidefiniteProgram, x: FloatArray, tolerance: float) -> ConeCertificate:
    """Evaluate primal and dual at x, whatever led to it.

    For any ν with slack ``s = p + Rᵀν`` in the dual cone, ``−‖ν‖²/4 − νᵀz`` is below the optimum, and the
    objective at x is above that by ``‖ν/2 − r‖² + sᵀx`` with r = R x − z: a sum of what is not negative.
    Here ν = 2 r, moved so that the free scalars' slacks are not negative, and shrunk until the blocks' are
    not either, which a penalty λ > 0 allows.
    """
    fit, cone, penalty = program.fit, program.cone, program.penalty
    residual = fit.R @ x - fit.z
    dual = 2.0 * residual
    free = np.flatnonzero(~program.penalised)
    short = np.maximum(-(fit.R[:, free].T @ dual), 0.0)
    if short.any():
        dual = dual + np.linalg.lstsq(fit.R[:, free].T, short, rcond=None)[0]
    pull = fit.R.T @ dual
    outside = _outside(program, pull + penalty)
    shrink = program.weight / (program.weight + outside)
    slack = penalty + shrink * pull
    # A scalar's slack just below zero is rounding, whose share of the gap is its product with the scalar.
    scalars = slack[free]
    feasible = bool((scalars >= -_SLACK_ROUNDING).all()) and np.isfinite(x).all()
    slack[free] = np.abs(scalars)
    gap = float(np.square(0.5 * shrink * dual - residual).sum() + max(0.0, slack @ x))
    return ConeCertificate(
        primal=cone.least(x),
        dual=float(outside / program.weight),
        gap=float(np.sqrt(gap)) if feasible else float("inf"),
        tolerance=tolerance,
    )


def _outside(program: SemidefiniteProgram, slack: FloatArray) -> float:
    """How far below zero the least penalised slack is; 0 if none is."""
    scalars = slack[: program.cone.nonnegative][program.penalised]
    least = [float(_eigenvalues(slack[place], size).min()) for size, place in program.cone.blocks()]
    return max(0.0, -min([*least, *scalars.tolist()], default=0.0))


def _eigenvalues(vector: FloatArray, size: int) -> FloatArray:
    return np.asarray(np.linalg.eigvalsh(to_matrix(vector, size)))


def _clarabel(program: SemidefiniteProgram, tolerance: float) -> FloatArray | None:
    """Solve in y = x − near, so that the objective does not drown in ‖z‖²; None if Clarabel fails."""
    near, cone = program.fit.near, program.cone
    T, readings = program.fit.compressed
    stated = programs.semidefinite(len(T), cone.nonnegative, cone.sizes)
    data = {"T": T, "z": readings - T @ near, "p": program.penalty, "near": near}
    moved = stated.solve(data, tolerance)
    return None if moved is None else near + moved
