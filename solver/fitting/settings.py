"""Settings of an identification, as data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.fitting.prior import Prior

Method = Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
Loss = Literal["squared", "huber"]


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
