"""A campaign that is measured live: its goal, one reading after the other, and what they say so far."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import FailFast, Field, StrictBool

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Metres,
    Name,
    Stiffness,
)
from jointstiff.schemas.finding import Assessment, Finding
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.measurement import (
    MAX_OBSERVATIONS,
    MeasurementSetDocument,
    MeasurementSetRequest,
    Observation,
    StoredMeasurementSet,
)
from jointstiff.schemas.plan import MAX_CANDIDATES, Goal, PlannedReading, ReadingOptions
from jointstiff.schemas.run import Residual


class LiveOptions(ReadingOptions):
    """Goal and equipment of a live campaign; readings are chosen as in a plan."""

    goal: Goal
    candidates: Annotated[int, Field(strict=True, ge=10, le=MAX_CANDIDATES)] = Field(
        default=1_000,
        description="Number of postures drawn within the joints' limits to choose from.",
    )
    plan_id: Identifier | None = Field(
        default=None, description="Plan whose robot, loads, targets and surroundings are used."
    )


class LiveReading(Message):
    """A reading in the record of a live campaign."""

    label: Name
    state: Literal["counts", "doubtful", "withdrawn"]
    reason: str | None = Field(default=None, description="Reason why the reading was withdrawn.")
    p_value: Dimensionless[float | None] = Field(
        description="Probability that a good reading deviates at least as far from the prediction by the "
        "other readings; null without a prediction."
    )
    distance: Metres[float | None] = Field(
        description="Greatest distance of a target from its predicted position."
    )
    doubtful: StrictBool = Field(
        description="True if the reading should be repeated before the load is removed."
    )
    causes: list[str] = Field(description="Causes of the doubt in words, the likeliest first.")
    message: str | None = Field(description="Comparison with the other readings in words.")
    ball_ratio: Dimensionless[float | None] = Field(
        default=None,
        description="Distance from the prediction, divided by the radius of 90 % of good readings; null if "
        "not held out.",
    )


class LiveJoint(Message):
    """Result of the readings so far for a joint."""

    name: Name
    kind: StatedKind = "revolute"
    stiffness: Stiffness[float | None]
    interval: Stiffness[tuple[float, float | None] | None] = Field(
        description="95 % interval of the stiffness, with the model error where the postures show it."
    )
    relative: Dimensionless[float | None] = Field(
        description="Relative half-width of the compliance's interval, without assumed errors."
    )
    relative_with_assumed: Dimensionless[float | None] = Field(
        default=None, description="Like `relative`, with the assumed errors of load point and force."
    )
    reason: str | None = Field(default=None, description="Reason why the joint will have no number.")
    prior: Literal["waits", "counts", "deviates"] | None = Field(
        default=None,
        description="Prior of the joint: `waits` until readings determine the joint as well, `counts`, or is "
        "ignored because it `deviates`. Null: none.",
    )


class LiveState(Message):
    """State of a live campaign: readings, results so far, and next reading."""

    revision: int = Field(description="Number of entries in the record; every change adds one.")
    state: Literal["measuring", "reached", "cannot", "closed"] = Field(
        description="`reached`: the goal is met, and a held-out reading agrees. `cannot`: the goal will "
        "not be met; see `message`. `closed`: the campaign has ended."
    )
    message: str = Field(description="State in words.")
    goal: str = Field(description="Declared goal in words.")
    share: Dimensionless[float | None] = Field(
        description="Present uncertainty / uncertainty of the goal; null while unknown."
    )
    still_needed: int | None = Field(
        description="Number of readings still needed, including the held-out reading; null if unknown."
    )
    readings: list[LiveReading] = Field(description="All readings, in the order in which they came.")
    joints: list[LiveJoint] = Field(description="Joints so far; empty until the readings determine a joint.")
    residuals: list[Residual] = Field(
        default_factory=list, description="Residuals of the last reading, in the fit of all."
    )
    deflection_uncertainty: Metres[float | None] = Field(
        default=None, description="Expanded uncertainty (95 %) of the deflection in the work area."
    )
    greatest_deflection: Metres[float | None] = Field(
        default=None, description="Length of the greatest deflection in the work area."
    )
    assessment: Assessment | None = Field(description="Verdict so far; null without a verdict.")
    next: PlannedReading | None = Field(description="Next reading; null if nothing is left to read.")
    following: list[PlannedReading] = Field(
        default_factory=list, description="Readings that will probably come after `next`, two at most."
    )
    warnings: list[Finding] = Field(default_factory=list, description="Findings in the readings.")
    measurement_set_id: Identifier | None = Field(
        default=None, description="Measurement set, once the campaign is closed."
    )
    run_id: Identifier | None = Field(default=None, description="Run of the closed measurement set.")


class MeasurementSetPost(MeasurementSetRequest):
    """Request of a measurement set: complete, or open for readings to come."""

    observations: Annotated[list[Observation], Field(max_length=MAX_OBSERVATIONS), FailFast()] = Field(
        default_factory=list,
        description=f"At most {MAX_OBSERVATIONS} observations; one at least without `open`.",
    )
    open: LiveOptions | None = Field(
        default=None, description="Goal of a set that is measured live, one observation after the other."
    )


class MeasurementSet(StoredMeasurementSet, MeasurementSetDocument):
    """A stored measurement set with its findings; one that is measured live has `open` and `live`."""

    observations: list[Observation] = Field(
        description="Observations; for an open set, those that count so far."
    )
    open: LiveOptions | None = Field(default=None, description="Goal of an open set; null once it is closed.")
    live: LiveState | None = Field(default=None, description="State of an open set; null once it is closed.")
