"""Result for one joint, as compliance and as stiffness."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal, NamedTuple


def stiffness_of(compliance: float | None) -> float | None:
    """Return 1 / c; None for a rigid joint and where the inverse overflows."""
    if not compliance:
        return None
    stiffness = 1.0 / compliance
    return stiffness if isfinite(stiffness) else None


def stiffness_interval(interval: tuple[float, float] | None) -> tuple[float, float | None] | None:
    """Return [1/c_hi, 1/c_lo], open above (None) where the compliance reaches zero.

    An interval of compliances that are all negative, or that spans zero downwards, is no interval of
    stiffness: it has no least stiffness.
    """
    if interval is None or interval[0] < 0 or interval[1] <= 0:
        return None
    least = stiffness_of(interval[1])
    return None if least is None else (least, stiffness_of(interval[0]))


class OneSidedBounds(NamedTuple):
    """Bounds on a compliance from below and above, each at the full confidence [rad/(N·m)]."""

    compliance_at_least: float
    compliance_at_most: float

    @property
    def stiffness_at_least(self) -> float | None:
        """Lower bound of the stiffness [N·m/rad]; None where the compliance may be negative."""
        return (stiffness_interval(self) or (None, None))[0]

    @property
    def stiffness_at_most(self) -> float | None:
        """Upper bound of the stiffness [N·m/rad]; None where there is none."""
        return (stiffness_interval(self) or (None, None))[1]


@dataclass(frozen=True)
class JointCompliance:
    """Result for one joint; numbers are None if the joint is not observable."""

    name: str
    #: "uncertain" where the standard uncertainty reaches the compliance and the interval contains zero, so
    #: that there is no greatest stiffness
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    compliance: float | None = None  #: [rad/(N·m)]
    standard_uncertainty: float | None = None  #: of the compliance, without constraints [rad/(N·m)]
    #: profile-likelihood interval under the constraints [rad/(N·m)]
    compliance_interval: tuple[float, float] | None = None
    one_sided: OneSidedBounds | None = None  #: bounds from below and above [rad/(N·m)]
    #: information of its prior over that of the readings; inf where the prior alone tells it from other
    #: joints, None without a prior
    prior_to_data: float | None = None
    reason: str | None = None  #: why there is no number, or what holds it

    stiffness: float | None = field(init=False)  #: [N·m/rad]; None for a rigid joint and where it overflows
    #: interval of the stiffness [N·m/rad], open above (None) where the joint may be rigid
    stiffness_interval: tuple[float, float | None] | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", stiffness_of(self.compliance))
        object.__setattr__(self, "stiffness_interval", stiffness_interval(self.compliance_interval))
