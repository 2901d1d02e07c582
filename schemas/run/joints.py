"""What the readings say of one joint, with its intervals."""

from __future__ import annotations

from typing import Literal

from pydantic import Field
from pydantic.config import JsonDict

from jointstiff.schemas.fields import Message, Name

__all__ = ["JointResult", "OneSidedBounds"]

_COMPLIANCE: JsonDict = {"unit": "rad/(N.m)"}
_STIFFNESS: JsonDict = {"unit": "N.m/rad"}


class OneSidedBounds(Message):
    """Each holds by itself at the run's confidence; both together hold at less."""

    compliance_at_least: float = Field(json_schema_extra=_COMPLIANCE)
    compliance_at_most: float = Field(json_schema_extra=_COMPLIANCE)
    stiffness_at_least: float | None = Field(
        description="Stiffer than this; null where the compliance may be negative.",
        json_schema_extra=_STIFFNESS,
    )
    stiffness_at_most: float | None = Field(
        description="Null: no upper limit, the readings cannot tell the joint from rigid.",
        json_schema_extra=_STIFFNESS,
    )


class JointResult(Message):
    """What the readings say of one joint. A joint that is not observable has no numbers."""

    name: Name
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    compliance: float | None = Field(json_schema_extra=_COMPLIANCE)
    stiffness: float | None = Field(
        description="1 / compliance; null where the compliance is zero.",
        json_schema_extra=_STIFFNESS,
    )
    standard_uncertainty: float | None = Field(
        description="Of the compliance, from the covariance of the estimate without constraints.",
        json_schema_extra=_COMPLIANCE,
    )
    compliance_interval: tuple[float, float] | None = Field(
        description="Profile-likelihood interval under the constraints, at the run's confidence.",
        json_schema_extra=_COMPLIANCE,
    )
    stiffness_interval: tuple[float, float | None] | None = Field(
        description="The same in stiffness; an upper end of null means: no upper limit.",
        json_schema_extra=_STIFFNESS,
    )
    one_sided: OneSidedBounds | None = Field(default=None, description="One-sided bounds.")
    prior_to_data: float | None = Field(
        default=None,
        description="Information of the prior over that of the readings on this compliance, the others "
        "unknown; above 1 the prior speaks, not the readings. Null without a prior. Dimensionless.",
    )
    reason: str | None = Field(description="Why there is no number, or why the joint is at a bound.")
