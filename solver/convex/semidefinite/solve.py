"""The door to the solver for semidefinite programs: Clarabel proposes, a certificate from the data decides.

    minimise ‖R x − z‖² + pᵀx   subject to   x_j ≥ 0 for the first parameters, and Mat(x_b) ⪰ 0 for the blocks

It is stated around a point near the least-squares solution, so that the objective does not drown in ‖z‖²,
solved along a ladder of tolerances, and polished by Newton's method on the face where the answer lies.
Whatever led to an answer, it is made feasible exactly, and a feasible point of the dual is made from its
residual; the gap between the two is computed without cancellation, and only an answer whose gap is small
enough leaves this module.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.convex.semidefinite.cone import SemidefiniteProgram, feasible_dual
from jointstiff.solver.convex.semidefinite.face import polished
from jointstiff.solver.errors import SolverError

_LADDER: Final = (1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
"""Tolerances of Clarabel, tried in this order: not every problem can be solved to the tightest."""
_LEAST_UNIT: Final = 1e-9
"""Residual, beside the readings, in whose unit a program is stated at the least."""
_NEWTON_STEPS: Final = 4
"""Newton steps; each doubles the correct digits once the face is right."""
_SLACK_ROUNDING: Final = 1e-13
"""Largest negative slack that counts as zero, in units of the column's norm and the readings'."""


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """The optimum (p,) with its evidence."""

    x: FloatArray  #: the optimum
    certificate: Certificate  #: at x
    tolerance: float  #: tolerance of Clarabel, that sufficed


def solve_cone(program: SemidefiniteProgram, *, gap: float, accepted: float | None = None) -> ConeSolution:
    """Solve a program and prove it.

    Args:
        program: finite, readings of unit norm.
        gap: gap of a certificate that ends the search, with ‖z‖ = 1.
        accepted: greatest gap that is accepted where no answer reaches `gap`; the same if None.

    Raises:
        SolverError: no answer has such a certificate.
    """
    best: ConeSolution | None = None
    for proposed in _proposals(program):
        if best is None or proposed.certificate.gap < best.certificate.gap:
            best = proposed
        if best.certificate.gap <= gap:
            return best
    return refuse_gap(best, gap if accepted is None else accepted)


def refuse_gap(best: ConeSolution | None, limit: float) -> ConeSolution:
    """Return a solution whose certificate is good enough.

    Raises:
        SolverError: there is none.
    """
    if best is None or not best.certificate.gap <= limit:
        reason = "the solver did not converge"
        if best is not None:
            reason = f"its gap is {best.certificate.gap:.1e}, above {limit:.1e}"
        raise SolverError(
            f"the semidefinite program is not solved: {reason}",
            remedy="give a larger penalty, choose fewer links, or report this with the data",
        )
    return best


def _proposals(program: SemidefiniteProgram) -> Iterator[ConeSolution]:
    """Yield feasible points along the ladder, in the unit of the readings and in that of their residual."""
    T, z = program.fit.compressed
    left = max(float(np.linalg.norm(z - T @ program.fit.near)), _LEAST_UNIT)
    for tolerance in _LADDER:
        for unit in (1.0, left):
            proposed = _clarabel(program, tolerance, unit)
            for _ in range(1 + _NEWTON_STEPS):
                if proposed is None:
                    break
                x = program.cone.project(proposed)
                certificate = certify_cone(program, x)
                if certificate.primal == 0.0:
                    yield ConeSolution(x, certificate, tolerance)
                proposed = polished(program, x)


def certify_cone(program: SemidefiniteProgram, x: FloatArray) -> Certificate:
    """Evaluate primal and dual at x, whatever led to it.

    For any ν with slack ``s = p + Rᵀν`` in the dual cone, ``−‖ν‖²/4 − νᵀz`` is below the optimum, and the
    objective at x is above that by ``‖ν/2 − r‖² + sᵀx`` with r = R x − z: a sum of what is not negative.
    Here ν = 2 r, moved so that the free scalars' slacks are not negative, and shrunk until the blocks' are
    not either, which a penalty λ > 0 allows.
    """
    fit, cone, penalty = program.fit, program.cone, program.penalty
    residual = fit.R @ x - fit.z
    dual, pull, outside = feasible_dual(cone, program.penalised, fit.R, 2.0 * residual, penalty)
    free = np.flatnonzero(~program.penalised)
    shrink = program.weight / (program.weight + outside)
    slack = penalty + shrink * pull
    # A scalar's slack just below zero is rounding, whose share of the gap is its product with the scalar.
    scalars = slack[free]
    feasible = bool((scalars >= -_SLACK_ROUNDING).all()) and np.isfinite(x).all()
    slack[free] = np.abs(scalars)
    gap = float(np.square(0.5 * shrink * dual - residual).sum() + max(0.0, slack @ x))
    return Certificate(
        primal=max(0.0, -cone.least(x)),
        dual=float(outside / program.weight),
        gap=float(np.sqrt(gap)) if feasible else float("inf"),
        multipliers=shrink * dual,
        solved_by="clarabel",
    )


def _clarabel(program: SemidefiniteProgram, tolerance: float, unit: float) -> FloatArray | None:
    """Solve in y = (x − near) / unit, so that the objective does not drown in ‖z‖²; None if Clarabel fails.

    The program is homogeneous: in a unit of the residual's size Clarabel's absolute tolerances hold there.
    """
    near, cone = program.fit.near, program.cone
    T, readings = program.fit.compressed
    stated = programs.semidefinite(len(T), cone.nonnegative, cone.sizes)
    data = {"T": T, "z": (readings - T @ near) / unit, "p": program.penalty / unit, "near": near / unit}
    moved = stated.solve(data, tolerance)
    return None if moved is None else near + unit * moved


_END_LADDER: Final = (1e-8, 1e-7, 1e-6)
"""Tolerances of Clarabel, tried in this order: relative to the estimate, no end needs more than the last."""


def penalised_range(
    program: SemidefiniteProgram, x: FloatArray, rise: float, functions: FloatArray
) -> FloatArray:
    """Return the least and the greatest value of linear functions where the objective is near its optimum.

    ``min, max aᵀy subject to ‖R y − z‖² + pᵀy ≤ ‖R x − z‖² + pᵀx + rise``, y in the cone.

    Args:
        program: the program.
        x: (p,) its optimum.
        rise: of the objective, positive.
        functions: (K, p) a.

    Returns:
        (K, 2); NaN where an end is not found.
    """
    T, z = program.fit.compressed
    limit = float(np.square(T @ x - z).sum() + program.penalty @ x) + rise
    cone = program.cone
    stated = programs.penalised_end(T, z, program.penalty, limit, cone.nonnegative, cone.sizes)
    ends = np.full((len(functions), 2), np.nan)
    for number, a in enumerate(functions):
        size = float(np.linalg.norm(a))
        for side, sign in enumerate((1.0, -1.0)):
            for tolerance in _END_LADDER if size > 0.0 else ():
                point = stated.solve({"a": sign * a / size}, tolerance)
                if point is not None:
                    ends[number, side] = a @ point
                    break
    return ends
