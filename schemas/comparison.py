"""A comparison: several methods on one measurement set, free and constrained (the paper's Table II)."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from jointstiff.schemas.fields import Identifier, Message, Metres, Timestamp
from jointstiff.schemas.job import Job, JobState
from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.run import JointResult, Method, Resampling, ResamplingResult, Weighting

MAX_METHODS = 8
MAX_FITS = 400_000
"""Of one comparison: their numbers are kept until it ends, and put together in memory."""

Constraint = Literal["unconstrained", "positive"]


class ComparedMethod(Message):
    """One of the methods to compare."""

    method: Method
    weighting: Weighting = Field(default="covariance", description="As of a run.")
    characteristic_length: Metres[Annotated[float, Field(strict=True, ge=1e-3, le=1e3)] | None] = Field(
        default=None, description="For that weighting; if absent, the length of least condition number."
    )

    @field_validator("characteristic_length", mode="after")
    @classmethod
    def _goes_with_its_weighting(cls, length: float | None, info: ValidationInfo) -> float | None:
        weighting = info.data.get("weighting")
        if length is not None and weighting != "characteristic_length":
            raise ValueError(f"goes with weighting `characteristic_length` only, not with `{weighting}`")
        return length


PAPER_METHODS = (
    ComparedMethod(method="complete_pose", weighting="characteristic_length"),
    ComparedMethod(method="complete_pose"),
    ComparedMethod(method="partial_pose"),
    ComparedMethod(method="decoupled_partial_pose"),
)
"""The paper's three, and the complete pose weighted by what its rows are worth (method.md §3)."""


class ComparisonOptions(Message):
    """What to compare. The default is the paper's Table II."""

    methods: Annotated[list[ComparedMethod], Field(min_length=1, max_length=MAX_METHODS)] = Field(
        default=list(PAPER_METHODS), description="Each once."
    )
    constraints: Annotated[list[Constraint], Field(min_length=1, max_length=2)] = Field(
        default=["unconstrained", "positive"],
        description="Each method is carried out with each of these: compliances free, or zero or positive.",
    )
    resampling: Resampling | None = Field(
        default=None,
        description="Repeat each fit on configurations drawn at random, the same draws for all; a comparison "
        "may then take long.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] = Field(
        default=0.95, description="Level of the intervals."
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
            raise ValueError("must not name one twice")
        return items


class ComparisonRequest(ComparisonOptions):
    """A comparison as it is posted."""

    measurement_set_id: Identifier


class ComparedFit(Message):
    """One method with one constraint. Where the readings cannot support it there are no numbers."""

    method: Method
    weighting: Weighting
    characteristic_length: Metres[float | None] = Field(
        description="The length that was used, if the weighting needs one."
    )
    positive: bool = Field(description="Whether every compliance was constrained to be zero or positive.")
    error: Problem | None = Field(description="Why there are no numbers.")
    joints: list[JointResult] = Field(description="From all configurations; none where there is an error.")
    compensation: float | None = Field(
        description="Share of the mean deflection that the model predicts; null as in a run. Dimensionless."
    )
    rms_residual: Metres[float | None] = Field(
        description="Root mean square of the residual vectors' lengths."
    )
    condition_number: float | None = Field(
        description="Of the weighted regressor, columns of unit norm, the greatest of the stages'; null "
        "where a rank is not full. Dimensionless."
    )
    resampling: ResamplingResult | None = Field(description="If it was asked for.")


class ComparisonResult(Message):
    """The methods side by side."""

    entries: list[ComparedFit] = Field(description="Each method with each constraint, in their order.")
    warnings: list[QualityWarning] = Field(
        description="What was noticed when the set was stored, then what the fits raise: of the "
        "same kind and place, the first."
    )


class ComparisonSummary(Message):
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
    result: ComparisonResult | None = Field(description="Present if the comparison succeeded.")
