"""A pair: two measurement sets, or runs, of one robot beside each other."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from jointstiff.schemas.fields import Compliance, Identifier, Message, Name, Stiffness, Timestamp
from jointstiff.schemas.job import Job, JobState
from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.run import Certificate, JointResult, RunOptions


class PairSide(Message):
    """One side of a pair: a measurement set, or a run."""

    measurement_set_id: Identifier | None = Field(
        default=None, description="A set, identified as the pair's `options` say."
    )
    run_id: Identifier | None = Field(
        default=None, description="A run: its set, identified as that run says but for its resampling."
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> PairSide:
        if (self.measurement_set_id is None) == (self.run_id is None):
            raise ValueError("give either `measurement_set_id` or `run_id`")
        return self


class PairOptions(Message):
    """How to compare."""

    options: RunOptions = Field(
        default_factory=RunOptions,
        description="How to identify the sides that are sets. Without priors, which would speak on both "
        "sides, and without resampling.",
    )
    ordered: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="Also identify both in one problem in which no joint is softer on the second side, as "
        "where secondary encoders are switched on.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] | None = Field(
        default=None, description="Level of the intervals; that of the options if absent."
    )

    @property
    def options_of_sides(self) -> RunOptions:
        """The options for sides that are sets."""
        return self.options_at(self.options)

    def options_at(self, options: RunOptions) -> RunOptions:
        """Return the options of a side at the level of this pair's intervals."""
        return options.model_copy(update={"confidence": self.confidence or self.options.confidence})

    @field_validator("options", mode="after")
    @classmethod
    def _of_independent_readings(cls, options: RunOptions) -> RunOptions:
        if options.priors or options.resampling is not None:
            raise ValueError("takes neither `priors` nor `resampling` here")
        return options


class PairRequest(PairOptions):
    """A pair as it is posted."""

    first: PairSide = Field(description="Such as with the motors' encoders in the loop, or before.")
    second: PairSide = Field(description="Such as with secondary encoders in the loop, or after.")


class PairedJoint(Message):
    """One joint on both sides."""

    name: Name
    first: JointResult = Field(description="From the first side alone.")
    second: JointResult = Field(description="From the second side alone.")
    ratio: float | None = Field(
        description="Stiffness on the second side over that on the first, of the estimates without "
        "constraints; null where one of them is not positive. Dimensionless."
    )
    ratio_interval: tuple[float | None, float | None] | None = Field(
        description="Fieller's interval of that ratio, cut at zero where compliances are positive. An end of "
        "null means: no limit. Null where nothing can be said. Dimensionless."
    )
    ratio_excluded: tuple[float, float] | None = Field(
        description="Where the readings exclude only ratios between two values, these. Dimensionless."
    )
    p_value: float | None = Field(
        description="Of the hypothesis that the compliance has not changed (two-sided). Small: it has."
    )
    reason: str | None = Field(description="Why there is no ratio.")


class DeflectionShare(Message):
    """1 - mean deflection on the second side / mean deflection on the first. Dimensionless."""

    value: float | None = Field(description="Null where it is not known. Dimensionless.")
    standard_uncertainty: float | None = Field(
        default=None, description="From sigma; null where that is not known. Dimensionless."
    )


class ConfigurationShare(Message):
    """The share of the deflection avoided in one observation, over its targets."""

    observation: Name
    side: Literal["first", "second", "both"] = Field(description="Which sides have this observation.")
    measured: DeflectionShare | None = Field(description="If both sides have it.")
    predicted: float | None = Field(
        description="From both sides' compliances; null where a joint that bends here is not observable on "
        "one side. Dimensionless."
    )


class AvoidedDeflection(Message):
    """How much of the deflection the second side avoids."""

    matching: int = Field(
        description="Observations of the same label, posture (1 mrad) and load (0.5 %, 1 mm) on both sides."
    )
    measured: DeflectionShare | None = Field(
        description="Of the mean deflection of the matching observations; null if there are none."
    )
    predicted: float | None = Field(
        description="Of the mean predicted deflection of all observations, matching ones counted once. "
        "Dimensionless."
    )
    configurations: list[ConfigurationShare]


class OrderedJoint(Message):
    """One joint in the problem of both sides. Null for what a side does not show."""

    name: Name
    compliance_first: Compliance[float | None]
    compliance_second: Compliance[float | None] = Field(description="Never above `compliance_first`.")
    stiffness_first: Stiffness[float | None] = Field(description="1 / compliance; null where that is zero.")
    stiffness_second: Stiffness[float | None]
    compliance_interval_first: Compliance[tuple[float, float] | None] = Field(
        description="Profile-likelihood interval under all constraints."
    )
    compliance_interval_second: Compliance[tuple[float, float] | None]
    equal: bool = Field(description="Whether the order holds both together: alone they would cross.")


class OrderedResult(Message):
    """Both sides in one convex problem: no joint is softer on the second side."""

    joints: list[OrderedJoint]
    chi_square_increase: float = Field(
        description="Of both sides' residuals over their least without the order. Far above the number of "
        "joints held equal, the readings contradict the order. Dimensionless."
    )
    certificate: Certificate = Field(description="The greatest violations of the stages.")


class PairResult(Message):
    """The numbers."""

    joints: list[PairedJoint]
    avoided: AvoidedDeflection
    ordered: OrderedResult | None = Field(description="If it was asked for.")
    warnings: list[QualityWarning] = Field(
        description="Of both sides, then of the pair; `where` begins with the side."
    )


class PairSummary(Message):
    """A pair in a listing."""

    id: Identifier
    first_set_id: Identifier
    second_set_id: Identifier
    robot_id: Identifier = Field(description="The first side's.")
    state: JobState
    created_at: Timestamp


class Pair(Job):
    """A stored pair. It never changes."""

    kind: ClassVar[str] = "pair"
    collection: ClassVar[str] = "pairs"

    first_set_id: Identifier = Field(description="The set of the first side.")
    second_set_id: Identifier = Field(description="The set of the second side.")
    request: PairRequest
    result: PairResult | None = Field(description="Present if the comparison succeeded.")
