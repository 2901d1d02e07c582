"""Result of one joint, with its intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Message, Name, Stiffness
from jointstiff.schemas.finding import Verdict


class OneSidedBounds(Message):
    """One-sided bounds, each at the run's confidence level; both together have a lower level."""

    compliance_at_least: Compliance[float]
    compliance_at_most: Compliance[float]
    stiffness_at_least: Stiffness[float | None] = Field(
        description="Lower end; null if the compliance may be negative."
    )
    stiffness_at_most: Stiffness[float | None] = Field(
        description="Upper end; null: no upper limit, the readings cannot distinguish the joint from rigid."
    )


class UncertaintyBudget(Message, extra="allow"):
    """Contributions to a standard uncertainty by source; their squares add up to its square."""

    __pydantic_extra__: dict[str, float]
    readings: Compliance[float] = Field(description="Noise of tracker and encoders.")
    force_scale: Compliance[float] = Field(
        default=0.0, description="Scale of the force: fully correlated over all joints and observations."
    )
    force_direction: Compliance[float] = Field(
        default=0.0, description="Direction of the force: correlated as its scale."
    )
    load_point: Compliance[float] = Field(
        default=0.0, description="Load point: one error for all observations."
    )
    assumed_load_point: Compliance[float] = Field(
        default=0.0,
        description="Load point, with 10 mm in each direction if no uncertainty is stated.",
    )
    target_places: Compliance[float] = Field(
        default=0.0, description="Positions of the targets: one error per target for all observations."
    )
    axes: Compliance[float] = Field(
        default=0.0, description="Axes of the robot's model: one error per axis for all observations."
    )
    model_error: Compliance[float] = Field(
        default=0.0, description="Model error by fits without single postures, if joints alone do not fit."
    )


class JointResult(Message):
    """Result of one joint. A joint that is not observable has no numbers."""

    name: Name
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    verdict: Verdict = Field(
        description="Verdict on the use of the stiffness, limited by its status and by the reasons about it "
        "or the whole result."
    )
    compliance: Compliance[float | None]
    stiffness: Stiffness[float | None] = Field(
        description="Stiffness, 1 / compliance; null if the compliance is zero."
    )
    standard_uncertainty: Compliance[float | None] = Field(
        description="Standard uncertainty of the compliance, from the covariance of the "
        "unconstrained estimate."
    )
    compliance_interval: Compliance[tuple[float, float] | None] = Field(
        description="Profile-likelihood interval of the compliance under the constraints, at the run's "
        "confidence level."
    )
    stiffness_interval: Stiffness[tuple[float, float | None] | None] = Field(
        description="Interval of the stiffness; an upper end of null means no upper limit."
    )
    one_sided: OneSidedBounds | None = Field(default=None, description="One-sided bounds.")
    prior_to_data: float | None = Field(
        default=None,
        description="Ratio of information, prior to readings, on this compliance; above 1 the "
        "prior dominates. "
        "Null without a prior. Dimensionless.",
    )
    budget: UncertaintyBudget | None = Field(
        default=None,
        description="Budget of the standard uncertainty; null if it has only the readings. "
        "Correlations are in the `budget` of the result.",
    )
    reason: str | None = Field(description="Reason why there is no number, or why the joint is at a bound.")


def identified_in(joints: Sequence[JointResult]) -> int:
    """Count the joints that are identified."""
    return sum(joint.status == "identified" for joint in joints)
