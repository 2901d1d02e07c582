"""A pair: two measurement sets, or runs, of one robot beside each other."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from jointstiff.schemas.assessment import Assessment, ResultSummary
from jointstiff.schemas.fields import (
    Compliance,
    Dimensionless,
    Identifier,
    Message,
    Name,
    Stiffness,
    Timestamp,
)
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.job import Job, JobState, Result
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import MAX_LEFT_OUT, Certificate, JointResult


class PairSide(Message):
    """One side of a pair: a measurement set, or a run."""

    measurement_set_id: Identifier | None = Field(
        default=None, description="Id of a measurement set, identified with the pair's `options`."
    )
    run_id: Identifier | None = Field(
        default=None,
        description="Id of a run: its set, identified with that run's options, but without resampling.",
    )
    leave_out: Annotated[list[Name], Field(max_length=MAX_LEFT_OUT)] = Field(
        default_factory=list,
        description="Labels of observations to omit from a set; a run has its own.",
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> PairSide:
        if (self.measurement_set_id is None) == (self.run_id is None):
            raise ValueError("give either `measurement_set_id` or `run_id`")
        if self.run_id is not None and self.leave_out:
            raise ValueError("`leave_out` goes with `measurement_set_id`: a run states its own")
        return self


class PairOptions(Message):
    """Options of a comparison of two sides."""

    options: RunOptions = Field(
        default_factory=RunOptions,
        description="Options of the identification of sides given as sets, without priors (they would enter "
        "both sides) and resampling.",
    )
    ordered: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="Also identify both sides in one problem in which no joint is softer on the second side, "
        "as with secondary encoders switched on.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] | None = Field(
        default=None, description="Confidence level of the intervals; default: that of the options."
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
            raise ValueError("must have neither `priors` nor `resampling` here")
        return options


class PairRequest(PairOptions):
    """A pair as it is posted."""

    first: PairSide = Field(
        description="First side, such as the position loop on the motors' encoders, or before a change."
    )
    second: PairSide = Field(
        description="Second side, such as the position loop on secondary encoders, or after a change."
    )


class PairedJoint(Message):
    """One joint on both sides."""

    name: Name
    first: JointResult = Field(description="Compliance identified from the first side alone.")
    second: JointResult = Field(description="Compliance identified from the second side alone.")
    ratio: float | None = Field(
        description="Ratio of the stiffnesses, second side to first, of the estimates without constraints; "
        "null if one is not positive. Dimensionless."
    )
    ratio_interval: tuple[float | None, float | None] | None = Field(
        description="Fieller's interval of the ratio, cut at zero if compliances are constrained to be "
        "positive. A null end means no limit; null means unknown. Dimensionless."
    )
    ratio_excluded: tuple[float, float] | None = Field(
        description="Excluded ratios, if the readings exclude only those between two values. Dimensionless."
    )
    p_value: float | None = Field(
        description="p-value of the hypothesis that the compliance has not changed (two-sided). "
        "Small: it has "
        "changed."
    )
    reason: str | None = Field(description="Reason why there is no ratio.")


class DeflectionShare(Message):
    """1 - mean deflection on the second side / mean deflection on the first. Dimensionless."""

    value: float | None = Field(description="Value; null if unknown.")
    standard_uncertainty: float | None = Field(
        default=None, description="Standard uncertainty from sigma; null if sigma is unknown."
    )


class ConfigurationShare(Message):
    """The share of the deflection avoided in one observation, over its targets."""

    observation: Name
    side: Literal["first", "second", "both"] = Field(description="Sides that have this observation.")
    measured: DeflectionShare | None = Field(
        description="Measured share; only if both sides have the observation."
    )
    predicted: float | None = Field(
        description="Predicted share from both sides' compliances; null if a joint that deflects here is not "
        "observable on one side. Dimensionless."
    )


class AvoidedDeflection(Message):
    """Share of the deflection that the second side avoids."""

    matching: int = Field(
        description="Number of observations with the same label, posture (1 mrad) and load (0.5 %, 1 mm) on "
        "both sides."
    )
    measured: DeflectionShare | None = Field(
        description="Measured share of the mean deflection of the matching observations; null if there are "
        "none."
    )
    predicted: float | None = Field(
        description="Predicted share of the mean deflection of all observations, matching ones counted once."
    )
    configurations: list[ConfigurationShare]


class OrderedJoint(Message):
    """One joint in the problem of both sides; null for a side that does not determine the joint."""

    name: Name
    compliance_first: Compliance[float | None]
    compliance_second: Compliance[float | None] = Field(
        description="Compliance on the second side, never larger than `compliance_first`."
    )
    stiffness_first: Stiffness[float | None] = Field(
        description="1 / compliance; null if the compliance is zero."
    )
    stiffness_second: Stiffness[float | None]
    compliance_interval_first: Compliance[tuple[float, float] | None] = Field(
        description="Profile-likelihood interval under all constraints."
    )
    compliance_interval_second: Compliance[tuple[float, float] | None]
    equal: bool = Field(description="True if the order makes both equal: separate fits would violate it.")


class OrderedResult(Message):
    """Both sides in one convex problem: no joint is softer on the second side."""

    joints: list[OrderedJoint]
    chi_square_increase: float = Field(
        description="Increase of both sides' χ² due to the order. If far larger than the number of "
        "joints held "
        "equal, the readings contradict the order. Dimensionless."
    )
    certificate: Certificate = Field(description="Largest violations over the stages.")


class PairResult(Result):
    """Result of the job."""

    assessment: Assessment = Field(
        description="The worse verdict of the two sides, with the reasons of both."
    )
    compensation_first: Dimensionless[float | None] = Field(
        description="Share of the mean deflection of the first side that its model predicts; null if "
        "nothing moved."
    )
    compensation_second: Dimensionless[float | None] = Field(
        description="Share of the mean deflection of the second side that its model predicts."
    )
    joints: list[PairedJoint]
    avoided: AvoidedDeflection
    ordered: OrderedResult | None = Field(description="Both sides in one problem, if requested.")
    warnings: list[Finding] = Field(
        description="Warnings of both sides, then of the pair; `where` begins with the side."
    )

    @property
    def summary(self) -> ResultSummary:
        """Excerpt for listings."""
        shares = (self.compensation_first, self.compensation_second)
        return ResultSummary(
            verdict=self.assessment.verdict,
            compensation=min((share for share in shares if share is not None), default=None),
            joints_identified=sum(
                joint.first.status == joint.second.status == "identified" for joint in self.joints
            ),
            joint_count=len(self.joints),
            warning_count=len(self.warnings),
        )


class PairSummary(ResultSummary):
    """A pair in a listing."""

    id: Identifier
    first_set_id: Identifier
    second_set_id: Identifier
    robot_id: Identifier = Field(description="Robot of the first side.")
    state: JobState
    created_at: Timestamp


class Pair(Job):
    """A stored pair. It never changes."""

    kind: ClassVar[str] = "pair"
    collection: ClassVar[str] = "pairs"

    first_set_id: Identifier = Field(description="Measurement set of the first side.")
    second_set_id: Identifier = Field(description="Measurement set of the second side.")
    request: PairRequest
    result: PairResult | None = Field(description="Result; present if the comparison has succeeded.")
