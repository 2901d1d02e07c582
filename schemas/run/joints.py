"""What the readings say of one joint, with its intervals."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Message, Name, Stiffness


class OneSidedBounds(Message):
    """Each holds by itself at the run's confidence; both together hold at less."""

    compliance_at_least: Compliance[float]
    compliance_at_most: Compliance[float]
    stiffness_at_least: Stiffness[float | None] = Field(
        description="Stiffer than this; null where the compliance may be negative."
    )
    stiffness_at_most: Stiffness[float | None] = Field(
        description="Null: no upper limit, the readings cannot tell the joint from rigid."
    )


class JointResult(Message):
    """What the readings say of one joint. A joint that is not observable has no numbers."""

    name: Name
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    compliance: Compliance[float | None]
    stiffness: Stiffness[float | None] = Field(
        description="1 / compliance; null where the compliance is zero."
    )
    standard_uncertainty: Compliance[float | None] = Field(
        description="Of the compliance, from the covariance of the estimate without constraints."
    )
    compliance_interval: Compliance[tuple[float, float] | None] = Field(
        description="Profile-likelihood interval under the constraints, at the run's confidence."
    )
    stiffness_interval: Stiffness[tuple[float, float | None] | None] = Field(
        description="The same in stiffness; an upper end of null means: no upper limit."
    )
    one_sided: OneSidedBounds | None = Field(default=None, description="One-sided bounds.")
    prior_to_data: float | None = Field(
        default=None,
        description="Information of the prior over that of the readings on this compliance, the others "
        "unknown; above 1 the prior speaks, not the readings. Null without a prior. Dimensionless.",
    )
    reason: str | None = Field(description="Why there is no number, or why the joint is at a bound.")
