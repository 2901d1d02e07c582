"""Effective compliance about each joint's axis: the joint's and its link's rotation together (method.md §7).

A rotation of joint j and a rotation of its link about the same axis move every target alike, so that readings
determine at most their sum ``c_j + a_jᵀ C_j,rot a_j``, with a_j the axis in the joint's frame.

Its interval is the range over all compliances of the cone whose penalised squares exceed the least by no more
than ``(q σ)²``, q the quantile: a profile, as for joints alone. Without any penalty that range says little
(for 100 postures on exact beams its half-width is that of the value): the penalty says the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.conic import diagonal, entries, penalised_range, solve_cone, weights
from jointstiff.solver.links.model import Formulation
from jointstiff.solver.links.regressor import ElasticColumns
from jointstiff.solver.robot.model import Robot

_LIGHTER: Final = 0.3
"""Penalty of the intervals relative to the one that predicts best. That one trades bias for variance, so that
its bias is no smaller than its dispersion; under a lighter one dispersion outweighs bias (undersmoothing)."""
_NOTHING: Final = 1e-4
"""Least lower end relative to the upper: cone programs stop short of zero."""
_GAP: Final = 1e-4
"""Gap of the point in whose neighbourhood the intervals lie, relative to the readings."""


def effective_rows(robot: Robot, columns: ElasticColumns) -> FloatArray:
    """Return rows (n, P) that take the compliances to the effective ones [rad/(N·m)]."""
    rows = np.zeros((columns.n, columns.width))
    rows[np.arange(columns.n), columns.joints] = 1.0
    rows[np.arange(columns.n), columns.coupling[diagonal(columns.n)]] = 1.0
    i, j = entries(6)
    for joint in columns.links:
        axis = np.concatenate([np.zeros(3), robot.chain.revolute[joint].axis])
        rows[joint, columns.link(joint)] = axis[i] * axis[j] * weights(6)
    return rows


@dataclass(frozen=True, eq=False)
class EffectiveIntervals:
    """Intervals of the n effective compliances."""

    ends: FloatArray  #: (n, 2) ends of the intervals [rad/(N·m)]; NaN where an end was not found
    uncertainty: FloatArray  #: (n,) half of an interval over the quantile [rad/(N·m)]

    @classmethod
    def of(
        cls,
        formulation: Formulation,
        weight: float,
        rows: FloatArray,
        effective: FloatArray,
        *,
        sigma: float,
        quantile: float,
    ) -> EffectiveIntervals:
        """Find the range of each where the objective is near its least, under a lighter penalty.

        Args:
            formulation: of the whole set, under squares.
            weight: λ that predicts best.
            rows: (n, P) that take the compliances to the effective ones.
            effective: (n,) estimated, which the intervals contain in any case.
            sigma: of one coordinate of one reading [m].
            quantile: of the interval.

        Raises:
            SolverError: the program with the lighter penalty has no certified answer.
        """
        program = formulation.program(_LIGHTER * weight)
        x = solve_cone(program, gap=_GAP).x
        functions = rows[:, formulation.columns] * formulation.unit
        ends = penalised_range(program, x, (quantile * sigma / formulation.size) ** 2, functions)
        ends[:, 0] = np.minimum(np.maximum(ends[:, 0], 0.0), effective)
        ends[:, 1] = np.maximum(ends[:, 1], effective)
        ends[ends[:, 0] < _NOTHING * ends[:, 1], 0] = 0.0
        return cls(ends, 0.5 * (ends[:, 1] - ends[:, 0]) / quantile)

    def without_ends(self) -> EffectiveIntervals:
        """Return the uncertainties alone, for a penalty that was given, not chosen by prediction."""
        return EffectiveIntervals(np.full_like(self.ends, np.nan), self.uncertainty)
