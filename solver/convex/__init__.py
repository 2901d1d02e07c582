"""Convex programs, their solution and their certificates."""

from __future__ import annotations

from jointstiff.solver.convex.batch import exactly_at_bounds, solve_batch
from jointstiff.solver.convex.certificate import Certificate, Proposer, certify
from jointstiff.solver.convex.constraints import Constraints, Order
from jointstiff.solver.convex.designs import best_for_worst_direction, best_for_worst_place
from jointstiff.solver.convex.problem import Bounds, IdentificationProblem, Inequalities
from jointstiff.solver.convex.semidefinite import (
    Cone,
    ConeSolution,
    LeastSquares,
    NormSum,
    RobustProgram,
    SemidefiniteProgram,
    certify_cone,
    certify_robust,
    diagonal,
    effective_freedom,
    entries,
    penalised_range,
    raised,
    solve_cone,
    solve_robust,
    to_matrix,
    weights,
)
from jointstiff.solver.convex.solution import Solution, huber_point, solve, solve_step

__all__ = [
    "Bounds",
    "Certificate",
    "Cone",
    "ConeSolution",
    "Constraints",
    "IdentificationProblem",
    "Inequalities",
    "LeastSquares",
    "NormSum",
    "Order",
    "Proposer",
    "RobustProgram",
    "SemidefiniteProgram",
    "Solution",
    "best_for_worst_direction",
    "best_for_worst_place",
    "certify",
    "certify_cone",
    "certify_robust",
    "diagonal",
    "effective_freedom",
    "entries",
    "exactly_at_bounds",
    "huber_point",
    "penalised_range",
    "raised",
    "solve",
    "solve_batch",
    "solve_cone",
    "solve_robust",
    "solve_step",
    "to_matrix",
    "weights",
]
