"""Settings of an identification, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.fitting.prior import Prior

Method = Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
Loss = Literal["squared", "huber"]


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of an identification.

    Attributes:
        method: see method.md §4.
        weighting: see method.md §3; `characteristic_length` goes with the complete pose only.
        characteristic_length: [m]; None for the length of least condition number.
        bounds: on the compliances.
        confidence: level of the intervals, between 0 and 1.
        order: pairs (i, j) of joints with c_i ≤ c_j: joint i at least as stiff as joint j.
        prior: what is known of the compliances beforehand; with weighting by covariance only.
        loss: of the norm of each target's whitened residual.
        huber_threshold: for the loss `huber`, in units of sigma.
        complementary_stiffness: whether K_c is part of the model (method.md §2).
    """

    method: Method
    weighting: Weighting
    bounds: Bounds
    characteristic_length: float | None = None
    confidence: float = 0.95
    order: tuple[tuple[int, int], ...] = ()
    prior: Prior | None = None
    loss: Loss = "squared"
    huber_threshold: float = 2.8
    complementary_stiffness: bool = False

    @property
    def constraints(self) -> Constraints:
        """Return what is known of the compliances for certain.

        Raises:
            RequestError: if order and bounds contradict each other.
        """
        return Constraints(self.bounds, self.order)
