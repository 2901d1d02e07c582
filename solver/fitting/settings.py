"""Settings of an identification, as data: method, weighting, loss, bounds, order and priors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.problem import Bounds, Constraints
from jointstiff.solver.errors import RequestError

Method = Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
Loss = Literal["squared", "huber"]


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent Gaussian priors of the compliances (method.md §5).

    Raises:
        RequestError: if a known joint's uncertainty is not positive and finite.
    """

    mean: FloatArray  #: (n,) c₀ [rad/(N·m)]; NaN for joints of which nothing is known
    standard_uncertainty: FloatArray  #: (n,) s₀ [rad/(N·m)], positive; inf for the same joints

    def __post_init__(self) -> None:
        known = self.known
        if (
            not (self.standard_uncertainty[known] > 0).all()
            or not np.isfinite(self.standard_uncertainty[known]).all()
        ):
            raise RequestError(
                "a prior's standard uncertainty is not positive",
                where="priors",
                remedy="give a positive stiffness and a positive standard uncertainty",
            )

    @property
    def known(self) -> BoolArray:
        """(n,) joints of which something is known."""
        return np.isfinite(self.mean)

    def rows(self, sigma: float) -> PriorRows:
        """The prior as readings of the compliances beside those of the targets.

        Args:
            sigma: standard uncertainty of one coordinate of one reading [m], the unit of weighted rows.
        """
        known = self.known
        weight = np.where(known, sigma / self.standard_uncertainty, 0.0)
        return PriorRows(weight, np.where(known, self.mean, 0.0))


@dataclass(frozen=True, eq=False)
class PriorRows:
    """One row ``(sigma/s₀) c_j = (sigma/s₀) c₀`` for each joint of which something is known."""

    weight: FloatArray  #: (n,) sigma/s₀ [m / (rad/(N·m))]; zero where nothing is known
    mean: FloatArray  #: (n,) c₀ [rad/(N·m)]

    def select(self, joints: IndexArray) -> tuple[FloatArray, FloatArray]:
        """The rows (k, p) that say something of p joints, and their right-hand side (k,)."""
        weight = self.weight[joints]
        known = np.flatnonzero(weight)
        rows = np.zeros((len(known), len(joints)))
        rows[np.arange(len(known)), known] = weight[known]
        return rows, weight[known] * self.mean[joints][known]


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of an identification."""

    method: Method  #: see method.md §4
    weighting: Weighting  #: see method.md §3; `characteristic_length` goes with the complete pose only
    bounds: Bounds  #: on the compliances
    characteristic_length: float | None = None  #: [m]; None for the length of least condition number
    confidence: float = 0.95  #: level of the intervals, between 0 and 1
    #: pairs (i, j) of joints with c_i ≤ c_j: joint i at least as stiff as joint j
    order: tuple[tuple[int, int], ...] = ()
    #: what is known of the compliances beforehand; with weighting by covariance only
    prior: Prior | None = None
    loss: Loss = "squared"  #: loss of the norm of each target's whitened residual
    huber_threshold: float = 2.8  #: for the loss `huber`, in units of sigma
    complementary_stiffness: bool = False  #: whether K_c is part of the model (method.md §2)

    @cached_property
    def constraints(self) -> Constraints:
        """Return what is known of the compliances for certain.

        Raises:
            RequestError: if order and bounds contradict each other.
        """
        return Constraints(self.bounds, self.order)
