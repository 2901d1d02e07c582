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
        description="Number of random postures within the joint limits from which the next posture is "
        "chosen.",
    )
    plan_id: Identifier | None = Field(
        default=None, description="Id of a plan whose robot, loads, targets and surroundings are used."
    )


class LiveReading(Message):
    """A reading in the record of a live campaign."""

    label: Name
    state: Literal["counts", "doubtful", "withdrawn"]
    reason: str | None = Field(default=None, description="Reason why the reading was withdrawn.")
    p_value: Dimensionless[float | None] = Field(
        description="Probability that a good reading deviates as much from the prediction by other "
        "readings; null without a prediction."
    )
    distance: Metres[float | None] = Field(
        description="Greatest distance between the measured and predicted position of a target."
    )
    doubtful: StrictBool = Field(
        description="True if the reading should be repeated while the load still acts."
    )
    causes: list[str] = Field(
        description="Possible causes of the doubt in words; the likeliest cause is first."
    )
    message: str | None = Field(description="Comparison of the reading with the other readings, in words.")
    ball_ratio: Dimensionless[float | None] = Field(
        default=None,
        description="Distance from the prediction, divided by the radius for 90 % of good readings; null "
        "if the reading is part of the fit.",
    )


class LiveJoint(Message):
    """Result of the readings so far for a joint."""

    name: Name
    kind: StatedKind = "revolute"
    stiffness: Stiffness[float | None]
    interval: Stiffness[tuple[float, float | None] | None] = Field(
        description="95 % interval of the stiffness, including the model error if the postures show one."
    )
    relative: Dimensionless[float | None] = Field(
        description="Half-width of the compliance's interval, relative to the compliance, without assumed "
        "errors."
    )
    relative_with_assumed: Dimensionless[float | None] = Field(
        default=None,
        description="Half-width of the compliance's interval, relative to the compliance, with the "
        "assumed errors of load point and force.",
    )
    reason: str | None = Field(
        default=None, description="Reason why the campaign will not determine the joint."
    )
    prior: Literal["waits", "counts", "deviates"] | None = Field(
        default=None,
        description="State of the joint's prior. `waits`: the readings know the joint less well. "
        "`counts`: the prior is used. `deviates`: the prior contradicts the readings and is "
        "ignored. Null without a prior.",
    )


class LiveState(Message):
    """State of a live campaign: readings, results so far, and next reading."""

    revision: int = Field(
        description="Number of entries in the record of the campaign; every change adds an entry."
    )
    state: Literal["measuring", "reached", "cannot", "closed"] = Field(
        description="State of the goal. `reached`: the goal is met, and a reading omitted from the fit "
        "agrees with the prediction. `cannot`: the goal will not be met; see `message`. "
        "`closed`: the campaign has ended."
    )
    message: str = Field(description="State in words.")
    goal: str = Field(description="Declared goal in words.")
    share: Dimensionless[float | None] = Field(
        description="Present uncertainty divided by the uncertainty that the goal demands; null while "
        "unknown."
    )
    still_needed: int | None = Field(
        description="Number of readings still needed, including a reading held out from the fit; null if "
        "unknown."
    )
    readings: list[LiveReading] = Field(description="All readings, in the order in which they came.")
    joints: list[LiveJoint] = Field(
        description="Results of the joints so far; empty until the readings determine a joint."
    )
    residuals: list[Residual] = Field(
        default_factory=list, description="Residuals of the last reading in the fit of all readings."
    )
    deflection_uncertainty: Metres[float | None] = Field(
        default=None, description="Expanded uncertainty (95 %) of the predicted deflection in the work area."
    )
    greatest_deflection: Metres[float | None] = Field(
        default=None, description="Length of the greatest deflection in the work area."
    )
    assessment: Assessment | None = Field(
        description="Verdict on the readings so far; null without a verdict."
    )
    next: PlannedReading | None = Field(description="Reading to measure next; null if no reading remains.")
    following: list[PlannedReading] = Field(
        default_factory=list, description="Readings that will probably follow `next`, two at most."
    )
    warnings: list[Finding] = Field(default_factory=list, description="Findings in the readings.")
    measurement_set_id: Identifier | None = Field(
        default=None, description="Measurement set of the campaign; null until the campaign is closed."
    )
    run_id: Identifier | None = Field(
        default=None, description="Run of the closed measurement set; null until the campaign is closed."
    )

    def __str__(self) -> str:
        """Return the message, the doubtful readings, and what the verdict demands, each in a line."""
        lines = [self.message]
        for reading in self.readings:
            is_last = reading is self.readings[-1]
            is_shown = is_last or reading.state == "doubtful"
            if reading.message is not None and is_shown and reading.message not in self.message:
                lines.append(f"{reading.label} ({reading.state}): {reading.message}")
        is_doubtful = any(reading.state == "doubtful" for reading in self.readings)
        if self.assessment is not None and not is_doubtful:
            lines += [f"{each.message}; {each.remedy}" for each in self.assessment.reasons]
        return "\n".join(lines)

    def __repr__(self) -> str:
        """Return the same text, which a notebook shows after each reading."""
        return str(self)


class MeasurementSetPost(MeasurementSetRequest):
    """Request of a measurement set: complete, or open for readings to come."""

    observations: Annotated[list[Observation], Field(max_length=MAX_OBSERVATIONS), FailFast()] = Field(
        default_factory=list,
        description=f"At most {MAX_OBSERVATIONS} observations; one at least without `open`.",
    )
    open: LiveOptions | None = Field(
        default=None, description="Goal of a set that is measured live, observation by observation."
    )


class MeasurementSet(StoredMeasurementSet, MeasurementSetDocument):
    """A stored measurement set with the findings of its checks.

    A set that is still measured has `open` and `live`.
    """

    observations: list[Observation] = Field(
        description="Observations of the set; for an open set, the observations that count so far."
    )
    open: LiveOptions | None = Field(
        default=None, description="Goal of a set that is still measured; null once the set is closed."
    )
    live: LiveState | None = Field(
        default=None, description="State of a set that is still measured; null once the set is closed."
    )
