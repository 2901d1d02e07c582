"""Convex programs, their solution and their certificates."""

from __future__ import annotations

from jointstiff.solver.convex.batch import exactly_at_bounds, solve_batch
from jointstiff.solver.convex.certificate import Certificate, certify
from jointstiff.solver.convex.constraints import Constraints, Order
from jointstiff.solver.convex.problem import Bounds, IdentificationProblem, Inequalities
from jointstiff.solver.convex.semidefinite import (
    Cone,
    ConeSolution,
    LeastSquares,
    SemidefiniteProgram,
    certify_cone,
    diagonal,
    effective_freedom,
    entries,
    raised,
    solve_cone,
    to_matrix,
    weights,
)
from jointstiff.solver.convex.solve import Solution, solve

__all__ = [
    "Bounds",
    "Certificate",
    "Cone",
    "ConeSolution",
    "Constraints",
    "IdentificationProblem",
    "Inequalities",
    "LeastSquares",
    "Order",
    "SemidefiniteProgram",
    "Solution",
    "certify",
    "certify_cone",
    "diagonal",
    "effective_freedom",
    "entries",
    "exactly_at_bounds",
    "raised",
    "solve",
    "solve_batch",
    "solve_cone",
    "to_matrix",
    "weights",
]
