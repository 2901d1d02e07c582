"""A run: one identification of one measurement set, with its evidence and provenance."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from jointstiff.schemas.assessment import Assessment, ResultSummary
from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Metres,
    Name,
    Point,
    Radians,
    Timestamp,
)
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.job import Job, JobState, Result
from jointstiff.schemas.run.budget import Budget
from jointstiff.schemas.run.identifiability import Identifiability
from jointstiff.schemas.run.joints import JointResult, identified_in
from jointstiff.schemas.run.links import Elasticity, ElasticModel, LinksResult, Loss, ModelSelection
from jointstiff.schemas.run.model import IdentifiedModel
from jointstiff.schemas.run.options import Method, RunOptions, Weighting
from jointstiff.schemas.run.resampling import ResamplingResult
from jointstiff.schemas.run.weight import WeightResult

MAX_LEFT_OUT = 1_000


class CampaignRun(RunOptions):
    """Options of the run in a campaign file."""

    leave_out: Annotated[list[Name], Field(max_length=MAX_LEFT_OUT)] = Field(
        default_factory=list,
        description="Labels of observations to omit; the others are checked again without them.",
        examples=[["c07"]],
    )


class RunRequest(CampaignRun):
    """A run as it is posted."""

    measurement_set_id: Identifier
    variant_of: Identifier | None = Field(
        default=None,
        description="Run that this one tries to improve by other options or corrected readings; listings "
        "can group both. It changes no number.",
    )


SupportFinder = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]


class Certificate(Message):
    """Proof of optimality, recomputed from the data. Dimensionless; zero is exact up to rounding."""

    primal: float = Field(description="Largest violation of a bound.")
    dual: float = Field(description="Largest gradient of the wrong sign.")
    complementarity: float = Field(description="Largest min(slack, multiplier).")
    solved_by: list[SupportFinder] = Field(
        description="Algorithms that found the active bounds, for the robust loss if there is one, then for "
        "each stage of the method: least squares (none), principal pivoting, Clarabel, the exact "
        "active-set method, or, with an order of the joints, the least-distance problem."
    )


class Goodness(Message):
    """Chi-square of the readings' residuals under sigma."""

    chi_square: float = Field(
        description="Sum of squared whitened residuals; with the robust loss each is cut at the threshold, "
        "and the sum scaled to the same expectation. Dimensionless."
    )
    degrees_of_freedom: float
    sigma_source: Literal["given", "residuals"] = Field(
        description="Source of sigma: stated with the set, or estimated from these residuals."
    )
    test: SigmaTest | None = Field(
        default=None, description="Test of the stated sigma; null without residual degrees of freedom."
    )


class SigmaTest(Message):
    """Chi-square test of the sigma that was stated, against the residuals (two-sided)."""

    p_value: float = Field(
        description="p-value: probability of residuals at least as extreme if model and sigma are right."
    )
    verdict: Literal["consistent", "residuals_too_large", "residuals_too_small"] = Field(
        description="Result of the test at a significance level of 1 %."
    )


class ComplementaryStiffness(Message):
    """Effect of the change of the load's joint torques with the deflection."""

    included: bool
    iterations: int = Field(description="Number of fits until the iteration converged; 0 if neglected.")
    largest_ratio: float = Field(description="Largest |K_c,ij| / k_i over the set. Dimensionless.")
    largest_shift: float | None = Field(
        description="Largest change of a compliance between neglecting and including it, in units of its "
        "standard uncertainty; null if that is unknown. Dimensionless."
    )


class SuspiciousReading(Message):
    """A reading that the robust loss gives less weight; one good reading in a thousand is like it."""

    observation: Name
    target: Name
    weight: float = Field(description="Weight of the reading, 1 for a good one. Dimensionless.")
    residual_norm: float = Field(
        description="Norm of the whitened residual, in units of sigma. Dimensionless."
    )


class RobustLoss(Message):
    """Weights and suspicious readings of the Huber loss."""

    threshold: float = Field(description="Threshold in units of sigma. Dimensionless.")
    suspicious: list[SuspiciousReading] = Field(description="Suspicious readings, worst first, at most 100.")
    suspicious_count: int


class Residual(Message):
    """One target in one observation."""

    observation: Name
    target: Name
    deflection: Metres[Point]
    predicted: Metres[Point]
    residual: Metres[Point] = Field(description="Measured minus predicted, axes of R0.")


class Contribution(Message):
    """Part of one joint in the predicted deflection, projected on that deflection."""

    joint: Name
    share: Dimensionless[float] = Field(
        description="Contribution to the mean length of the predicted deflections; those of all "
        "joints sum to "
        "1. Zero for a joint without a number."
    )
    mean: Metres[float] = Field(
        description="Contribution of the joint, mean over all readings of the targets."
    )
    by_observation: Metres[list[float]] = Field(
        description="Contributions in each observation, means over its targets, in the order of the set."
    )


class EncoderResidual(Message):
    """One secondary encoder in one observation."""

    observation: Name
    joint: Name
    deflection: Radians[float] = Field(description="Deflection of the joint, loaded minus unloaded.")
    predicted: Radians[float]
    residual: Radians[float] = Field(description="Residual, measured minus predicted.")


class PlainModel(Message):
    """Result for joints alone under squared residuals, with K_c as in the run."""

    joints: list[JointResult]
    compensation: Dimensionless[float | None]
    rms_residual: Metres[float]


class ModelChoice(Message):
    """Elastic elements and loss of this run, with the evidence for both."""

    elasticity: ElasticModel
    loss: Loss
    source: Literal["given", "screening", "cross_validation", "options"] = Field(
        description="`given`: named in the request. `screening`: joints alone, because no test shows that "
        "something besides them bends. `cross_validation`: compared on held-out postures. `options`: joints "
        "alone, because other options exclude more."
    )
    links_p_value: Dimensionless[float | None] = Field(
        description="p-value of the F test of links beside joints; null if it was not made."
    )
    message: str = Field(description="Choice in a sentence, with its figures.")
    plain: PlainModel | None = Field(
        default=None, description="Joints alone under squared residuals; null if the run has only joints."
    )


class RunResult(Result):
    """Result of the job."""

    assessment: Assessment
    joints: list[JointResult]
    compensation: float | None = Field(
        description="Compensation: share of the mean deflection that the model predicts, 1 - "
        "mean‖residual‖ / mean‖deflection‖; null if nothing moved, or if there are as many parameters as "
        "readings. Dimensionless."
    )
    rms_residual: Metres[float] = Field(description="Root mean square of the residual vectors' lengths.")
    sigma: Metres[float | None] = Field(
        description="Standard uncertainty of one coordinate of one reading; null if not given and "
        "there are no "
        "residual degrees of freedom."
    )
    goodness: Goodness
    identifiability: Identifiability
    certificate: Certificate = Field(description="Largest violations over the stages.")
    characteristic_length: Metres[float | None] = Field(
        description="Length that was used, if the weighting needs one."
    )
    complementary_stiffness: ComplementaryStiffness | None = Field(
        description="Effect of K_c; null with elastic links or coupling, whose model neglects it."
    )
    robust: RobustLoss | None = Field(
        default=None, description="Suspicious readings and weights, if the loss is `huber`."
    )
    resampling: ResamplingResult | None = Field(
        default=None, description="Results of the resampling, if requested."
    )
    links: LinksResult | None = Field(
        default=None,
        description="Elastic links or coupling, if requested. The joints' numbers are then effective: of "
        "the joint and its link's rotation about its axis together. Their intervals are ranges of what fits "
        "the readings under 0.3 times the penalty, which predicts best; they are null if `link_penalty` is "
        "given.",
    )
    selection: ModelSelection | None = Field(
        default=None, description="Held-out compensation of each model, if links or coupling are elastic."
    )
    choice: ModelChoice | None = Field(
        default=None, description="Elastic elements and loss of this run, with the reason."
    )
    residuals: list[Residual]
    contributions: list[Contribution] = Field(
        default_factory=list,
        description="Contribution of each joint to the predicted deflection; empty if links or coupling are "
        "elastic, or if no joint is identified.",
    )
    encoder_residuals: list[EncoderResidual] = Field(
        default_factory=list, description="Fit of the secondary encoders, if they were read."
    )
    model: IdentifiedModel | None = Field(
        default=None,
        description="Model for predictions; null if no joint is determined by own weight.",
    )
    budget: Budget | None = Field(
        default=None,
        description="Uncertainty budget of the compliances; null with elastic links or coupling, or if the "
        "uncertainty of the readings is unknown.",
    )
    weight: WeightResult | None = Field(
        default=None,
        description="Result of a run with `weight`: deflections are relative to the geometry without sag, "
        "and intervals are outer bounds over all masses within their bounds; null for other runs.",
    )
    warnings: list[Finding] = Field(description="Warnings of the measurement set, then of the fit.")

    @property
    def summary(self) -> ResultSummary:
        """Excerpt for listings."""
        return ResultSummary(
            verdict=self.assessment.verdict,
            compensation=self.compensation,
            joints_identified=identified_in(self.joints),
            joint_count=len(self.joints),
            warning_count=len(self.warnings),
        )


class RunSummary(ResultSummary):
    """A run in a listing."""

    id: Identifier
    measurement_set_id: Identifier
    robot_id: Identifier
    method: Method
    weighting: Weighting
    positive: bool
    elasticity: Elasticity = Field(description="Parts that bend.")
    leave_out: list[Name] = Field(default_factory=list, description="Omitted observations.")
    variant_of: Identifier | None = Field(default=None, description="Run that this one tries to improve.")
    state: JobState
    created_at: Timestamp


class Run(Job):
    """A stored run. It never changes once ended."""

    kind: ClassVar[str] = "run"
    collection: ClassVar[str] = "runs"

    request: RunRequest
    result: RunResult | None = Field(description="Result; present if the run has succeeded.")

    @property
    def elasticity(self) -> Elasticity:
        """Elements that bend in the numbers; while there are none, those of the request."""
        choice = None if self.result is None else self.result.choice
        if self.request.weight is not None:
            return "joints"
        return self.request.elasticity if choice is None else choice.elasticity
