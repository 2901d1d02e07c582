"""Semidefinite programs with a robust loss: Clarabel proposes a point and a dual, a certificate decides.

    minimise Σ_i ρ(‖A_i x − d_i‖) + pᵀx   subject to   x_j ≥ 0 for the first parameters, Mat(x_b) ⪰ 0

ρ(u) is u²/(2h) up to h and u − h/2 beyond; h = 0 leaves the sum of the norms. For any ν with ‖ν_i‖ ≤ 1 and
the slack ``s = p + Aᵀν`` in the dual cone, ``−Σ (ν_iᵀd_i + h‖ν_i‖²/2)`` is below the optimum. The objective
at x is above that by ``Σ [ρ(r_i) + h‖ν_i‖²/2 − ν_iᵀr_i] + sᵀx`` with r = A x − d (Fenchel and Young), a sum
of what is not negative, so that nothing cancels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.convex.semidefinite.cone import Cone, feasible_dual, trace_penalty
from jointstiff.solver.convex.semidefinite.solve import ConeSolution, refuse_gap

_LADDER: Final = (1e-7, 1e-8, 1e-9, 1e-10)
"""Tolerances of Clarabel, tried in this order."""
_SLACK_ROUNDING: Final = 1e-12
"""Largest negative slack of a free scalar that counts as zero."""


@dataclass(frozen=True, eq=False)
class NormSum:
    """The loss of some targets, shared by programs with other penalties."""

    A: FloatArray  #: (K, 3, p)
    d: FloatArray  #: (K, 3) with ``Σ ‖d_i‖ = 1``
    cone: Cone  #: cone of the parameters
    penalised: BoolArray  #: (nonnegative,) which of the scalars have a penalty

    @cached_property
    def program(self) -> programs.Program:
        """Return the program for all penalties and thresholds."""
        return programs.sum_of_norms(self.A, self.d, self.cone.nonnegative, self.cone.sizes)

    def residuals(self, x: FloatArray) -> FloatArray:
        """(K, 3) ``A x − d``."""
        residuals: FloatArray = self.A @ x - self.d
        return residuals


@dataclass(frozen=True, eq=False)
class RobustProgram:
    """The program as data."""

    loss: NormSum  #: loss of the targets
    weight: float  #: λ > 0 of the penalty on traces and penalised scalars
    threshold: float  #: h ≥ 0, in the unit of d

    @cached_property
    def penalty(self) -> FloatArray:
        """P (p,)."""
        return trace_penalty(self.loss.cone, self.loss.penalised, self.weight)


def solve_robust(program: RobustProgram, *, gap: float, accepted: float | None = None) -> ConeSolution:
    """Solve a program and prove it.

    Args:
        program: finite.
        gap: excess of the objective over the optimum that ends the search.
        accepted: greatest that is accepted where no answer reaches `gap`; the same if None.

    Raises:
        SolverError: no answer has such a certificate.
    """
    best: ConeSolution | None = None
    data = {"p": program.penalty, "root": np.array([np.sqrt(program.threshold)])}
    for tolerance in _LADDER:
        solution = program.loss.program.solve_with_duals(data, tolerance)
        if solution is None:
            continue
        x = program.loss.cone.project(solution[0])
        # Each cone's multipliers are (weight, −ν).
        dual = -solution[1].reshape(-1, 4)[:, 1:]
        certificate = certify_robust(program, x, dual)
        if certificate.primal == 0.0 and (best is None or certificate.gap < best.certificate.gap):
            best = ConeSolution(x, certificate, tolerance)
        if best is not None and best.certificate.gap <= gap:
            break
    return refuse_gap(best, gap if accepted is None else accepted)


def certify_robust(program: RobustProgram, x: FloatArray, dual: FloatArray) -> Certificate:
    """Evaluate primal and dual, whatever led to them.

    ν is moved so that the free scalars' slacks are not negative, then shrunk into its balls and until the
    blocks' slacks are not negative either, which a penalty λ > 0 allows.

    Args:
        program: the program.
        x: (p,) in the cone.
        dual: (K, 3) ν, near a feasible one.
    """
    loss, h = program.loss, program.threshold
    A = loss.A.reshape(-1, len(x))
    nu, pull, outside = feasible_dual(loss.cone, loss.penalised, A, dual.ravel(), program.penalty)
    free = np.flatnonzero(~loss.penalised)
    longest = float(np.linalg.norm(nu.reshape(-1, 3), axis=1).max(initial=0.0))
    shrink = min(program.weight / (program.weight + outside), 1.0 / max(longest, 1.0))
    nu, slack = shrink * nu.reshape(-1, 3), program.penalty + shrink * pull
    scalars = slack[free]
    feasible = bool((scalars >= -_SLACK_ROUNDING).all()) and np.isfinite(x).all()
    slack[free] = np.abs(scalars)
    gap = float(_young(loss.residuals(x), nu, h).sum() + max(0.0, slack @ x))
    return Certificate(
        primal=max(0.0, -loss.cone.least(x)),
        dual=float(outside / program.weight),
        gap=gap if feasible else float("inf"),
        multipliers=nu,
        solved_by="clarabel",
    )


def _young(r: FloatArray, nu: FloatArray, h: float) -> FloatArray:
    """(K,) ``ρ(r) + h‖ν‖²/2 − νᵀr`` as squares and products that are not negative."""
    u = np.linalg.norm(r, axis=1)
    beyond = u > h
    direction = r / np.where(beyond, u, 1.0)[:, None]
    along = np.maximum(0.0, 1.0 - (nu * direction).sum(axis=1))
    outer = 0.5 * h * np.square(nu - direction).sum(axis=1) + (u - h) * along
    inner = np.square(r - h * nu).sum(axis=1) / (2.0 * h) if h > 0.0 else np.zeros(len(r))
    return np.where(beyond, outer, inner)
