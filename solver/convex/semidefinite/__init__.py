"""Semidefinite programs with a least-squares term."""

from __future__ import annotations

from jointstiff.solver.convex.semidefinite.cone import Cone, LeastSquares, SemidefiniteProgram, raised
from jointstiff.solver.convex.semidefinite.ends import penalised_range
from jointstiff.solver.convex.semidefinite.face import effective_freedom
from jointstiff.solver.convex.semidefinite.robust import NormSum, RobustProgram, certify_robust, solve_robust
from jointstiff.solver.convex.semidefinite.solve import ConeSolution, certify_cone, solve_cone
from jointstiff.solver.convex.semidefinite.symmetric import diagonal, entries, to_matrix, weights

__all__ = [
    "Cone",
    "ConeSolution",
    "LeastSquares",
    "NormSum",
    "RobustProgram",
    "SemidefiniteProgram",
    "certify_cone",
    "certify_robust",
    "diagonal",
    "effective_freedom",
    "entries",
    "penalised_range",
    "raised",
    "solve_cone",
    "solve_robust",
    "to_matrix",
    "weights",
]
