"""Semidefinite programs with a least-squares term."""

from __future__ import annotations

from jointstiff.solver.convex.semidefinite.cone import Cone, LeastSquares, SemidefiniteProgram, raised
from jointstiff.solver.convex.semidefinite.face import effective_freedom
from jointstiff.solver.convex.semidefinite.solve import ConeSolution, certify_cone, solve_cone
from jointstiff.solver.convex.semidefinite.symmetric import diagonal, entries, to_matrix, weights

__all__ = [
    "Cone",
    "ConeSolution",
    "LeastSquares",
    "SemidefiniteProgram",
    "certify_cone",
    "diagonal",
    "effective_freedom",
    "entries",
    "raised",
    "solve_cone",
    "to_matrix",
    "weights",
]
