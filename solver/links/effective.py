"""Effective compliance about each joint's axis: the joint's and its link's rotation together (method.md §7).

A rotation of joint j and a rotation of its link about the same axis move every target alike, so that readings
determine at most their sum ``c_j + a_jᵀ C_j,rot a_j``, with a_j the axis in the joint's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import stdtrit

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import diagonal, entries, weights
from jointstiff.solver.links.regressor import ElasticColumns
from jointstiff.solver.robot import Robot

_NEIGHBOURS: Final = 3
"""Penalties on either side; the grid has one a decade. Two leave intervals of soft beams too short."""


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
class EffectiveSpread:
    """Dispersion of the n effective compliances over the folds of a cross-validation.

    Attributes:
        uncertainty: (n,) standard uncertainty by the jackknife, a fold left out at a time [rad/(N·m)].
        bias: (n,) greatest change between the penalty and the three on either side of it, an
            allowance for the penalty's bias [rad/(N·m)]; NaN where only one penalty was tried.
        folds: K.
    """

    uncertainty: FloatArray
    bias: FloatArray
    folds: int

    @classmethod
    def of(cls, compliances: FloatArray, place: int) -> EffectiveSpread:
        """Build it from fits of all folds.

        Args:
            compliances: (K, W, n) effective, for ascending weights; NaN where there is no answer.
            place: of the weight that was chosen.
        """
        count = len(compliances)
        chosen = compliances[:, place]
        squares = np.square(chosen - chosen.mean(axis=0)).sum(axis=0)
        near = compliances[:, max(0, place - _NEIGHBOURS) : place + _NEIGHBOURS + 1]
        near = np.delete(near, min(place, _NEIGHBOURS), axis=1).mean(axis=0)
        moved = np.abs(near - chosen.mean(axis=0))
        unknown = np.isnan(moved).all(axis=0)
        bias = np.where(unknown, np.nan, np.nan_to_num(moved).max(axis=0, initial=0.0))
        return cls(np.sqrt((count - 1) / count * squares), bias, count)

    def half_width(self, confidence: float) -> FloatArray:
        """Return half-widths (n,) of intervals: Student's t of the jackknife, and the bias on top."""
        quantile = float(stdtrit(self.folds - 1, 0.5 + 0.5 * confidence))
        return np.asarray(quantile * self.uncertainty + self.bias)
