"""A comparison: several methods on one measurement set, free and constrained (the paper's Table II)."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from jointstiff.schemas.assessment import Assessment, ResultSummary
from jointstiff.schemas.fields import Identifier, Message, Metres, Name, Timestamp
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.job import Job, JobState, Result
from jointstiff.schemas.options import Method, Resampling, Weighting
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.run import MAX_LEFT_OUT, JointResult, ResamplingResult, identified_in
from jointstiff.schemas.terminal import Terminal, draws_of

MAX_METHODS = 8
MAX_FITS = 400_000
"""Maximum total of repetitions of one comparison: their numbers are kept in memory until it ends."""

Constraint = Literal["unconstrained", "positive"]


class ComparedMethod(Message):
    """One of the methods to compare."""

    method: Method
    weighting: Weighting = Field(default="covariance", description="Methods of identification, as for a run.")
    characteristic_length: Metres[Annotated[float, Field(strict=True, ge=1e-3, le=1e3)] | None] = Field(
        default=None,
        description="Length for weighting `characteristic_length`; default: the length of least condition "
        "number.",
    )

    @field_validator("characteristic_length", mode="after")
    @classmethod
    def _goes_with_its_weighting(cls, length: float | None, info: ValidationInfo) -> float | None:
        weighting = info.data.get("weighting")
        if length is not None and weighting != "characteristic_length":
            raise ValueError(f"needs weighting `characteristic_length`, not `{weighting}`")
        return length


PAPER_METHODS = (
    ComparedMethod(method="complete_pose", weighting="characteristic_length"),
    ComparedMethod(method="complete_pose"),
    ComparedMethod(method="partial_pose"),
    ComparedMethod(method="decoupled_partial_pose"),
)
"""Methods to compare. Default: the paper's three, and the complete pose with covariance weights (method.md
§3)."""


class ComparisonOptions(Message):
    """Options of a comparison. The default is the paper's Table II."""

    methods: Annotated[list[ComparedMethod], Field(min_length=1, max_length=MAX_METHODS)] = Field(
        default=list(PAPER_METHODS), description="Methods, each at most once."
    )
    constraints: Annotated[list[Constraint], Field(min_length=1, max_length=2)] = Field(
        default=["unconstrained", "positive"],
        description="Constraints to combine with each method: compliances free, or zero or positive.",
    )
    resampling: Annotated[
        Resampling | None, Terminal("--resample", "SIZE[:REPETITIONS[:SEED]]", draws_of)
    ] = Field(
        default=None,
        description="Resampling: repeat each fit on configurations drawn at random, the same draws for all. "
        "The comparison may then take long.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] = Field(
        default=0.95, description="Confidence level of the intervals."
    )

    @field_validator("resampling", mode="after")
    @classmethod
    def _not_too_many_fits(cls, resampling: Resampling | None, info: ValidationInfo) -> Resampling | None:
        entries = len(info.data.get("methods", ())) * len(info.data.get("constraints", ()))
        if resampling is not None and entries * resampling.repetitions > MAX_FITS:
            most = MAX_FITS // entries
            raise ValueError(f"{entries} fits of each draw: at most {most:,} repetitions")
        return resampling

    @field_validator("methods", "constraints", mode="after")
    @classmethod
    def _each_once(cls, items: list[object]) -> list[object]:
        if any(item in items[:i] for i, item in enumerate(items)):
            raise ValueError("must not contain duplicates")
        return items


class ComparisonRequest(ComparisonOptions):
    """A comparison as it is posted."""

    measurement_set_id: Identifier
    leave_out: Annotated[list[Name], Field(max_length=MAX_LEFT_OUT)] = Field(
        default_factory=list, description="Labels of observations to omit, as in a run."
    )


class ComparedFit(Message):
    """One method with one constraint; it has no numbers if the readings cannot support it."""

    method: Method
    weighting: Weighting
    characteristic_length: Metres[float | None] = Field(
        description="Length that was used, if the weighting needs one."
    )
    positive: bool = Field(description="True if every compliance was constrained to be zero or positive.")
    error: Problem | None = Field(description="Reason why there are no numbers.")
    joints: list[JointResult] = Field(
        description="Joints, fitted to all configurations; empty if there is an error."
    )
    assessment: Assessment | None = Field(description="Assessment; null if there is an error.")
    compensation: float | None = Field(
        description="Compensation: share of the mean deflection that the model predicts; null as in a run. "
        "Dimensionless."
    )
    rms_residual: Metres[float | None] = Field(
        description="Root mean square of the residual vectors' lengths."
    )
    condition_number: float | None = Field(
        description="Condition number of the weighted regressor with columns of unit norm, the "
        "largest of all "
        "stages; null if rank-deficient. Dimensionless."
    )
    resampling: ResamplingResult | None = Field(description="Results of the resampling, if it was requested.")


class ComparisonResult(Result):
    """The methods side by side."""

    assessment: Assessment = Field(
        description="Worst verdict of the fits with their reasons; equal kinds and places once"
    )
    entries: list[ComparedFit] = Field(
        description="Fits, one per method and constraint, in the requested order."
    )
    warnings: list[Finding] = Field(
        description="Warnings of the measurement set, then of the fits; duplicates are omitted."
    )

    @property
    def summary(self) -> ResultSummary:
        """Excerpt for listings."""
        fits = [entry for entry in self.entries if entry.joints]
        return ResultSummary(
            verdict=self.assessment.verdict,
            compensation=max(
                (fit.compensation for fit in fits if fit.compensation is not None), default=None
            ),
            joints_identified=max((identified_in(fit.joints) for fit in fits), default=0),
            joint_count=max((len(fit.joints) for fit in fits), default=None),
            warning_count=len(self.warnings),
        )


class ComparisonSummary(ResultSummary):
    """A comparison in a listing."""

    id: Identifier
    measurement_set_id: Identifier
    robot_id: Identifier
    state: JobState
    created_at: Timestamp


class Comparison(Job):
    """A stored comparison. It never changes once ended."""

    kind: ClassVar[str] = "comparison"
    collection: ClassVar[str] = "comparisons"

    request: ComparisonRequest
    result: ComparisonResult | None = Field(description="Result; present if the comparison has succeeded.")
