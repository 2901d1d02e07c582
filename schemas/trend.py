"""Trend of a robot's joints: stiffness over the campaigns, and whether the latest differs from the first."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field, StrictBool

from jointstiff.schemas.fields import Dimensionless, Identifier, Message, Name, Stiffness, Timestamp
from jointstiff.schemas.finding import Assessment, Verdict
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.options import Method, Weighting
from jointstiff.schemas.robot import Estimate

MOST_ASSESSED: Final = 20
"""Greatest number of campaigns of a trend that have their assessments, which may be long."""
Encoders = Literal["motor", "secondary"]


class TrendQuery(Message):
    """Filters of the campaigns in a trend.

    Default: the serial number of the newest campaign, and the options that most of its campaigns share.
    """

    serial_number: Name | None = Field(default=None, description="Serial number of the robot.")
    method: Method | None = Field(default=None, description="Method of the runs.")
    weighting: Weighting | None = Field(default=None, description="Weighting of the runs.")
    positive: bool | None = Field(
        default=None, description="True if compliances are constrained to be zero or more."
    )
    encoders: Encoders | None = Field(default=None, description="Encoders that closed the position loop.")
    same_load: bool = Field(
        default=False,
        description="True if the load of all campaigns acted at the same point of the flange.",
    )
    same_cell: bool = Field(
        default=False,
        description="True if the same cell or weights gave the forces of all campaigns.",
    )
    campaigns: int = Field(
        default=100,
        ge=2,
        le=2000,
        description="Most campaigns in the answer.",
    )


class TrendSelection(Message):
    """Options that all runs of a trend share."""

    serial_number: str | None = Field(
        description="Serial number of the robot; null if no set states a number."
    )
    method: Method
    weighting: Weighting
    positive: StrictBool = Field(description="True if compliances are constrained to be zero or more.")
    encoders: Encoders
    complementary_stiffness: Literal["neglected", "included"]


class TrendCampaign(Message):
    """One campaign: a measurement set and its newest comparable run."""

    run_id: Identifier
    measurement_set_id: Identifier
    name: Name
    at: Timestamp
    time_source: Literal["measured_at", "created_at"] = Field(
        description="Source of `at`: time of the measurement, or time of storing."
    )
    verdict: Verdict = Field(description="Verdict on the run.")
    assessment: Assessment | None = Field(
        default=None,
        description=f"Assessment of the run; null beyond {MOST_ASSESSED} campaigns.",
    )


class TrendPoint(Message):
    """Stiffness of one joint in one campaign."""

    stiffness: Stiffness[float | None] = Field(
        default=None, description="Stiffness of the joint; null if the run has none."
    )
    interval: Stiffness[tuple[float, float | None] | None] = Field(
        default=None,
        description="Interval at the run's confidence; an end of null: no upper limit.",
    )
    reason: str | None = Field(description="Reason why the point is not compared; null if it is compared.")


class TrendJoint(Message):
    """Trend of one joint over the campaigns."""

    name: Name
    kind: StatedKind = "revolute"
    points: list[TrendPoint] = Field(description="Points of the joint, one for each of `campaigns`.")
    change: Estimate | None = Field(
        description="Relative change of stiffness from the first to the latest point without a `reason` "
        "(-0.1: 10 % softer); null without two."
    )
    p_value: Dimensionless[float | None] = Field(description="Two-sided p-value of an unchanged stiffness.")
    unchanged: Dimensionless[tuple[float, float] | None] = Field(
        default=None, description="Ratios of latest to first stiffness that are no change beyond chance."
    )
    changed: StrictBool = Field(
        description="True if `p_value` is below `level` divided by the number of tested joints."
    )


class LeftOut(Message):
    """A campaign that is not in the trend."""

    measurement_set_id: Identifier
    name: Name
    reason: str


class Trend(Message):
    """Trend of a robot's joints."""

    robot_id: Identifier
    selection: TrendSelection | None = Field(description="Options that the runs share; null without any run.")
    serial_numbers: list[str] = Field(description="Serial numbers that the robot's sets state.")
    campaigns: list[TrendCampaign] = Field(description="Campaigns, oldest first.")
    campaign_count: int = Field(default=0, description="Number of compared campaigns.")
    reference_set_id: Identifier | None = Field(
        default=None, description="Set of the campaign with which comparison begins; null: the first."
    )
    joints: list[TrendJoint]
    level: Dimensionless[float] = Field(
        description="Greatest probability of reporting a change if there is none."
    )
    left_out: list[LeftOut] = Field(description="Campaigns that are not compared, with the reason.")
    note: str | None = Field(description="Remarks on limits of the test, and on what to check first.")
