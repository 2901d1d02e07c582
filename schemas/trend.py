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

    Default: the serial number of the newest campaign, and the options of most campaigns with this number.
    """

    serial_number: Name | None = Field(default=None, description="Serial number of the robot.")
    method: Method | None = Field(default=None, description="Method of the runs.")
    weighting: Weighting | None = Field(default=None, description="Weighting of the runs.")
    positive: bool | None = Field(
        default=None, description="True if compliances are constrained to be zero or more."
    )
    encoders: Encoders | None = Field(
        default=None, description="Encoders with which the controller closed the position loop."
    )
    same_load: bool = Field(
        default=False,
        description="True if the load acted at the same point of the flange in all campaigns. All "
        "campaigns then share one error of the load point.",
    )
    same_cell: bool = Field(
        default=False,
        description="True if one load cell, or one set of weights, gave the forces of all campaigns. All "
        "campaigns then share one error of scale.",
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
        description="Serial number of the robot; null if no measurement set states a number."
    )
    method: Method
    weighting: Weighting
    positive: StrictBool = Field(description="True if compliances are constrained to be zero or more.")
    encoders: Encoders
    complementary_stiffness: Literal["neglected", "included"]


class TrendCampaign(Message):
    """One campaign, with a measurement set and the newest comparable run of the set."""

    run_id: Identifier
    measurement_set_id: Identifier
    name: Name
    at: Timestamp
    time_source: Literal["measured_at", "created_at"] = Field(
        description="Source of `at`: the time of the measurement, or the time of storing."
    )
    verdict: Verdict = Field(description="Verdict on the run.")
    assessment: Assessment | None = Field(
        default=None,
        description=f"Assessment of the run; null beyond {MOST_ASSESSED} campaigns.",
    )


class TrendPoint(Message):
    """Stiffness of one joint in one campaign."""

    stiffness: Stiffness[float | None] = Field(
        default=None, description="Stiffness of the joint; null if the run determines none."
    )
    interval: Stiffness[tuple[float, float | None] | None] = Field(
        default=None,
        description="Interval of the stiffness at the run's confidence; an end of null means no upper limit.",
    )
    reason: str | None = Field(description="Reason why the point is not compared; null for a compared point.")


class TrendJoint(Message):
    """Trend of one joint over the campaigns."""

    name: Name
    kind: StatedKind = "revolute"
    points: list[TrendPoint] = Field(description="Points of the joint, one for each campaign in `campaigns`.")
    change: Estimate | None = Field(
        description="Relative change of stiffness from the first to the latest point without a `reason`; "
        "null without two such points. A value of -0.1 means 10 % softer."
    )
    p_value: Dimensionless[float | None] = Field(
        description="Two-sided p-value of the hypothesis that the stiffness is unchanged."
    )
    unchanged: Dimensionless[tuple[float, float] | None] = Field(
        default=None,
        description="Range of ratios of the latest to the first stiffness that chance alone explains.",
    )
    changed: StrictBool = Field(
        description="True if the stiffness changed. `p_value` is then below `level` divided by the "
        "number of tested joints."
    )


class LeftOut(Message):
    """A campaign that is not in the trend."""

    measurement_set_id: Identifier
    name: Name
    reason: str


class Trend(Message):
    """Trend of a robot's joints."""

    robot_id: Identifier
    selection: TrendSelection | None = Field(
        description="Options that all compared runs share; null without a run."
    )
    serial_numbers: list[str] = Field(
        description="Serial numbers of the robot that its measurement sets state."
    )
    campaigns: list[TrendCampaign] = Field(description="Campaigns, oldest first.")
    campaign_count: int = Field(default=0, description="Number of compared campaigns.")
    reference_set_id: Identifier | None = Field(
        default=None,
        description="Measurement set of the campaign with which the comparison begins; null for the "
        "first campaign.",
    )
    joints: list[TrendJoint]
    level: Dimensionless[float] = Field(
        description="Greatest probability that a change is reported although no joint changed."
    )
    left_out: list[LeftOut] = Field(description="Campaigns that are not compared, each with the reason.")
    note: str | None = Field(
        description="Remarks on limits of the test, and on what should be checked first."
    )
