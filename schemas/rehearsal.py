"""Messages of rehearsals: a campaign with simulated readings, identified before it is measured."""

from __future__ import annotations

from pydantic import Field, StrictBool

from jointstiff.schemas.fields import Dimensionless, Message, Metres, Name, Stiffness
from jointstiff.schemas.finding import Assessment
from jointstiff.schemas.joints import JointKind


class RehearsedJoint(Message):
    """Planted and identified stiffness of one joint."""

    name: Name
    kind: JointKind = Field(default="revolute", description="Kind; `prismatic`: stiffnesses in N/m.")
    planted: Stiffness[float] = Field(
        description="Planted stiffness, with which the readings were simulated."
    )
    found: Stiffness[float | None] = Field(
        description="Stiffness that the simulated readings give; null without a number."
    )
    interval: Stiffness[tuple[float | None, float | None] | None] = Field(
        description="Interval of the identified stiffness; an upper end of null means no upper limit."
    )
    contained: StrictBool | None = Field(
        description="True if the interval contains the stiffness with which the readings were simulated."
    )
    half_width: Dimensionless[float | None] = Field(
        description="Half-width of the interval of the compliance, divided by the compliance; null if "
        "unknown."
    )


class RehearsalResult(Message):
    """Comparison of the identified stiffnesses with the known stiffnesses of a simulation."""

    joints: list[RehearsedJoint]
    determined: int = Field(description="Number of joints whose interval has two ends.")
    confidence: float = Field(description="Confidence of the intervals.")
    postures: int = Field(description="Number of simulated postures.")
    sigma: Metres[float] = Field(
        description="Standard deviation of the simulated noise of a coordinate of a reading."
    )
    seed: int = Field(description="Random seed of the simulated noise and of the simulated stiffnesses.")
    planted_by: str = Field(description="Source of the simulated stiffnesses, in words.")
    assessment: Assessment | None = Field(
        description="Assessment of the run that identifies the simulated readings."
    )
    remarks: list[str] = Field(description="Assumptions of the simulation.")
