"""Self check of the numerical solver: a small program whose optimum is known."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.problem import LeastSquares, Problem, Witness
from jointstiff.solver.fit.solution import compare_answers

_REGRESSOR: FloatArray = np.array([[2.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
_READINGS: FloatArray = np.array([2.0, -1.0, 1.0])
_OPTIMUM: Final = (1.0, 0.0)
"""Optimum of ``minimise ‖A x − b‖², x ≥ 0`` for these numbers, exactly. At x the residual is r = (0, 1, 0),
so that ``Aᵀ r = (0, 1)``: no gradient along x_1, and x_2 is held at its bound."""


def check_solver() -> Witness:
    """Let Clarabel solve a program with a known optimum, and compare the two.

    The program passes through the code that solves the programs of all fits.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    positive = Scalars(Bounds.positive(len(_OPTIMUM)))
    scaled = Problem(LeastSquares(_REGRESSOR, _READINGS), positive).equilibrated
    clarabel_point = programs.solve_least_squares(scaled.problem)
    squares = scaled.problem.squares
    return compare_answers(squares.R, clarabel_point, np.array(_OPTIMUM) / scaled.unit, squares.z)
