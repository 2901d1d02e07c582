"""Trend of a robot's joints: points, charts, alarms, reference campaigns and acknowledgements."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, RootModel, StrictBool, Tag

from jointstiff.schemas.fields import Dimensionless, Identifier, Message, Name, Stiffness, Timestamp
from jointstiff.schemas.finding import Assessment, Verdict
from jointstiff.schemas.job import Requester
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.measurement import Notes
from jointstiff.schemas.options import Method, Weighting
from jointstiff.schemas.robot import TrendChange

LEAST_BASELINE = 3
MOST_BASELINE = 20

Encoders = Literal["motor", "secondary"]
JointState = Literal["alarm", "acknowledged", "in_control", "unjudged"]


class TrendQuery(Message):
    """Filters of the campaigns in a trend; default: the values of the newest run."""

    serial_number: Name | None = Field(default=None, description="Serial number of the robot.")
    method: Method | None = Field(default=None, description="Method of the runs.")
    weighting: Weighting | None = Field(default=None, description="Weighting of the runs.")
    positive: StrictBool | None = Field(
        default=None, description="True if compliances are constrained to be zero or more."
    )
    encoders: Encoders | None = Field(default=None, description="Encoders that closed the position loop.")


class TrendSelection(Message):
    """Common ground of the runs of a trend."""

    serial_number: str | None = Field(description="Serial number of the robot; null if the sets state none.")
    method: Method
    weighting: Weighting
    positive: StrictBool = Field(description="True if compliances are constrained to be zero or more.")
    encoders: Encoders
    complementary_stiffness: Literal["neglected", "included"]


class TrendCampaign(Message):
    """One campaign: a measurement set, by its newest run that is comparable."""

    run_id: Identifier
    measurement_set_id: Identifier
    name: Name = Field(description="Name of the measurement set.")
    at: Timestamp
    time_source: Literal["measured_at", "created_at"] = Field(
        description="Source of `at`: time of the measurement, or, if the set does not state it, of storing."
    )
    baseline: int = Field(description="Index in `baselines` of the reference campaigns of this campaign.")
    assessment: Assessment = Field(description="Assessment of the run.")


class TrendBaseline(Message):
    """Reference campaigns: those with which later campaigns are compared."""

    run_id: Identifier | None = Field(description="Run of the first campaign; null if that was deleted.")
    starts_at: Timestamp
    campaigns: int = Field(description="Number of reference campaigns of each joint.")
    reason: str | None = Field(
        default=None, description="Reason for new reference campaigns; null for the first campaigns."
    )
    set_by: Requester | None = Field(default=None, description="Key of the request; null without one.")
    set_at: Timestamp | None = Field(
        default=None, description="Time of the request; null for the first campaigns."
    )


class TrendPoint(Message):
    """One joint in one campaign."""

    stiffness: Stiffness[float | None] = Field(
        default=None, description="Stiffness of the run; null if it has none."
    )
    interval: Stiffness[tuple[float, float | None] | None] = Field(
        default=None,
        description="Interval of the stiffness at the run's confidence; null at its end: no upper limit.",
    )
    role: Literal["baseline", "monitored", "not_charted"] = Field(
        default="not_charted",
        description="`baseline`: a reference campaign; `monitored`: compared with the reference campaigns; "
        "`not_charted`: see `reason`.",
    )
    reason: str | None = Field(description="Reason why it is not charted.")
    smoothed: Stiffness[float | None] = Field(default=None, description="EWMA after this campaign.")
    lower_limit: Stiffness[float | None] = Field(default=None, description="Lower limit of the EWMA.")
    upper_limit: Stiffness[float | None] = Field(default=None, description="Upper limit of the EWMA.")
    exceeded: StrictBool = Field(default=False, description="True if the EWMA is beyond a limit.")
    change: TrendChange | None = Field(
        default=None, description="Change of this campaign against the reference campaigns."
    )


class TrendChart(Message):
    """Chart of one joint against its reference campaigns."""

    baseline: int = Field(description="Index of the chart's reference campaigns in `baselines`.")
    stiffness: Stiffness[float] = Field(description="Mean stiffness of the reference campaigns.")
    relative_uncertainty: Dimensionless[float] = Field(
        description="Standard uncertainty of their mean ln k, scatter between campaigns included."
    )
    between: Dimensionless[float] = Field(
        description="Scatter between campaigns beyond the readings' noise (τ, DerSimonian and Laird), in ln "
        "k; 0 if the reference campaigns agree."
    )


class Acknowledgement(Message):
    """Acknowledgement of an alarm."""

    note: str
    acknowledged_by: Requester | None = Field(description="Key that acknowledged it; null if there was none.")
    acknowledged_at: Timestamp


class TrendAlarm(Message):
    """Campaigns in a row whose EWMA is beyond a limit."""

    run_id: Identifier = Field(
        description="Id to send when you acknowledge the alarm: the run of its first campaign."
    )
    since: Timestamp
    until: Timestamp | None = Field(description="Last campaign of the alarm; null while it lasts.")
    change: TrendChange = Field(
        description="Change of the EWMA against the reference campaigns, at its last campaign."
    )
    message: str = Field(description="Alarm in words: joint, direction, size, limit and first campaign.")
    acknowledgement: Acknowledgement | None = Field(description="Latest acknowledgement.")


class TrendPair(Message):
    """Test of the latest campaign against the first, if there are too few for a chart."""

    change: TrendChange = Field(description="Change, with the uncertainty from the readings alone.")
    p_value: Dimensionless[float] = Field(
        description="Probability of a change at least as large if the stiffness is the same (two-sided)."
    )


class TrendJoint(Message):
    """One joint over the campaigns."""

    name: Name
    kind: StatedKind = "revolute"
    state: JointState = Field(
        description="State at the latest campaign; `unjudged`: no campaign after the reference campaigns yet."
    )
    points: list[TrendPoint] = Field(description="Points of the joint, one for each of `campaigns`.")
    charts: list[TrendChart] = Field(description="Charts of the joint, oldest first.")
    alarms: list[TrendAlarm] = Field(description="Oldest first.")
    latest: TrendChange | None = Field(
        description="Change of its latest campaign against the reference campaigns."
    )
    pair: TrendPair | None = Field(description="Test of two campaigns, if there is no chart.")


class LeftOut(Message):
    """A campaign that is not in the trend."""

    measurement_set_id: Identifier
    name: Name
    reason: str


class FalseAlarms(Message):
    """False-alarm rate of the limits."""

    probability: Dimensionless[float] = Field(
        description="Upper limit of the false-alarm rate: probability of any false alarm of the robot, over "
        "all counted joints."
    )
    campaigns: int = Field(
        description="Number of campaigns after the reference campaigns to which it applies."
    )
    joints: int = Field(
        description="Number of counted joints: those with a chart against the latest reference campaigns."
    )


class Trend(Message):
    """Trend of a robot's joints."""

    robot_id: Identifier
    selection: TrendSelection | None = Field(description="Options that the runs share; null without any run.")
    serial_numbers: list[str] = Field(description="Serial numbers that the robot's sets state.")
    campaigns: list[TrendCampaign] = Field(description="Oldest first.")
    baselines: list[TrendBaseline] = Field(
        description="Groups of reference campaigns, oldest first; the last one is in force."
    )
    joints: list[TrendJoint]
    false_alarms: FalseAlarms
    left_out: list[LeftOut] = Field(description="Campaigns that are not charted, with the reason.")
    note: str | None = Field(description="Remarks on missing campaigns or charts.")


class BaselineRequest(Message):
    """New reference campaigns."""

    run_id: Identifier = Field(description="Run of the first campaign.")
    reason: Name = Field(description="Reason.", examples=["gearbox of joint 3 replaced"])
    campaigns: Annotated[int, Field(strict=True, ge=LEAST_BASELINE, le=MOST_BASELINE)] = Field(
        default=LEAST_BASELINE, description="Number of reference campaigns."
    )


class AcknowledgementRequest(Message):
    """Acknowledgement of an alarm."""

    run_id: Identifier = Field(
        description="Id to send when you acknowledge the alarm: the run of its first campaign."
    )
    joint: Name
    note: Notes = Field(description="Finding or decision in words.", examples=["belt checked, order 4711"])


def _kind_of_note(note: object) -> str:
    return "acknowledgement" if isinstance(note, dict) and "joint" in note else "baseline"


class TrendNoteRequest(
    RootModel[
        Annotated[
            Annotated[BaselineRequest, Tag("baseline")]
            | Annotated[AcknowledgementRequest, Tag("acknowledgement")],
            Discriminator(_kind_of_note),
        ]
    ]
):
    """New reference campaigns; or with `joint` and `note`, that an alarm was seen."""


class FleetRow(Message):
    """One robot, or one serial number of it."""

    robot_id: Identifier
    name: Name
    serial_number: str | None
    state: JointState = Field(description="State of the worst joint.")
    joint: str | None = Field(
        description="Joint with that state and the largest change relative to its uncertainty."
    )
    change: TrendChange | None = Field(
        description="Latest change against the reference campaigns, or in the pair."
    )
    alarm: str | None = Field(description="Message of its alarm.")
    measured_at: Timestamp | None = Field(description="Time of the latest campaign; null without any.")
    verdict: Verdict | None = Field(
        default=None, description="Verdict on the run of the latest campaign; null without any."
    )
    campaigns: int = Field(description="Number of campaigns in its trend.")
    missing: str | None = Field(description="Remarks on missing campaigns or charts.")


class Fleet(Message):
    """All robots, those in alarm first."""

    items: list[FleetRow]
    is_whole: StrictBool = Field(description="True if these are all robots: no more than 200 are shown.")
