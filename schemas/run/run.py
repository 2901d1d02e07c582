"""A run: one identification of one measurement set, with its evidence and provenance."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

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
from jointstiff.schemas.job import Job, JobState
from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.run.identifiability import Identifiability
from jointstiff.schemas.run.joints import JointResult
from jointstiff.schemas.run.links import Elasticity, LinksResult, ModelSelection
from jointstiff.schemas.run.options import Method, RunOptions, Weighting
from jointstiff.schemas.run.resampling import ResamplingResult


class RunRequest(RunOptions):
    """A run as it is posted."""

    measurement_set_id: Identifier


SupportFinder = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]


class Certificate(Message):
    """Proof of optimality, recomputed from the data. Dimensionless; zero is exact up to rounding."""

    primal: float = Field(description="Greatest violation of a bound.")
    dual: float = Field(description="Greatest gradient of the wrong sign.")
    complementarity: float = Field(description="Greatest min(slack, multiplier).")
    solved_by: list[SupportFinder] = Field(
        description="What found the joints at their bounds, for the robust loss if there is one, then for "
        "each stage of the method: least squares "
        "(none), principal pivoting, Clarabel, the exact active-set method, or, with an order of the "
        "joints, the least-distance problem."
    )


class Goodness(Message):
    """Chi-square of the readings' residuals under sigma."""

    chi_square: float = Field(
        description="Sum of squared whitened residuals; with the robust loss each is cut at the threshold, "
        "and the sum scaled to the same expectation. Dimensionless."
    )
    degrees_of_freedom: float
    sigma_source: Literal["given", "residuals"] = Field(
        description="Whether sigma was stated with the set or estimated from these residuals."
    )
    test: SigmaTest | None = Field(
        default=None, description="Of a sigma that was stated; null without residual degrees of freedom."
    )


class SigmaTest(Message):
    """Chi-square test of the sigma that was stated, against the residuals (two-sided)."""

    p_value: float = Field(description="Probability of residuals as unlikely, if model and sigma are right.")
    verdict: Literal["consistent", "residuals_too_large", "residuals_too_small"] = Field(
        description="At a level of 1 %."
    )


class ComplementaryStiffness(Message):
    """How much the change of the load's torques with the deflection matters."""

    included: bool
    iterations: int = Field(
        description="Fits until the deflected configurations stood still; 0 if neglected."
    )
    largest_ratio: float = Field(description="Largest |K_c,ij| / k_i over the set. Dimensionless.")
    largest_shift: float | None = Field(
        description="Largest change of a compliance between neglecting and including it, in units of its "
        "standard uncertainty; null where that is unknown. Dimensionless."
    )


class SuspiciousReading(Message):
    """A reading that the robust loss gives less weight, and that one good reading in a thousand resembles."""

    observation: Name
    target: Name
    weight: float = Field(description="1 for a good reading. Dimensionless.")
    residual_norm: float = Field(description="Of the whitened residual: in units of sigma. Dimensionless.")


class RobustLoss(Message):
    """What the Huber loss made of the readings."""

    threshold: float = Field(description="In units of sigma. Dimensionless.")
    suspicious: list[SuspiciousReading] = Field(description="Worst first, at most 100.")
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
        description="Share in the mean length of the predicted deflections; those of all joints add up to 1. "
        "Zero for a joint without a number."
    )
    mean: Metres[float] = Field(description="Mean over all readings of the targets.")
    by_observation: Metres[list[float]] = Field(
        description="Mean over the targets of each observation, in the order of the set."
    )


class EncoderResidual(Message):
    """One secondary encoder in one observation."""

    observation: Name
    joint: Name
    deflection: Radians[float] = Field(description="Loaded minus unloaded.")
    predicted: Radians[float]
    residual: Radians[float] = Field(description="Measured minus predicted.")


class RunResult(Message):
    """The numbers."""

    joints: list[JointResult]
    compensation: float | None = Field(
        description="Share of the mean deflection that the model predicts: "
        "1 - mean‖residual‖ / mean‖deflection‖; null where nothing moved. Dimensionless."
    )
    rms_residual: Metres[float] = Field(description="Root mean square of the residual vectors' lengths.")
    sigma: Metres[float | None] = Field(
        description="Standard uncertainty of one coordinate of one reading; null where it was not "
        "given and there are no residual degrees of freedom."
    )
    goodness: Goodness
    identifiability: Identifiability
    certificate: Certificate = Field(description="The greatest violations of the stages.")
    characteristic_length: Metres[float | None] = Field(
        description="The length that was used, if the weighting needs one."
    )
    complementary_stiffness: ComplementaryStiffness | None = Field(
        default=None, description="Null only in runs of earlier versions."
    )
    robust: RobustLoss | None = Field(default=None, description="If the loss is `huber`.")
    resampling: ResamplingResult | None = Field(default=None, description="If the run asked for it.")
    links: LinksResult | None = Field(
        default=None,
        description="If more than joints may bend. The joints' standard uncertainties are then those of a "
        "jackknife over the folds, and intervals are null.",
    )
    selection: ModelSelection | None = Field(
        default=None, description="Held-out compensation of each model, if more than joints may bend."
    )
    residuals: list[Residual]
    contributions: list[Contribution] = Field(
        default_factory=list,
        description="Part of each joint in the predicted deflection; empty if more than joints may bend.",
    )
    encoder_residuals: list[EncoderResidual] = Field(
        default_factory=list, description="If secondary encoders were read."
    )
    warnings: list[QualityWarning] = Field(
        description="What was noticed when the set was stored, then what the fit itself raises."
    )


class RunSummary(Message):
    """A run in a listing."""

    id: Identifier
    measurement_set_id: Identifier
    robot_id: Identifier
    method: Method
    weighting: Weighting
    positive: bool
    elasticity: Elasticity = Field(description="What bends.")
    state: JobState
    created_at: Timestamp


class Run(Job):
    """A stored run. It never changes once ended."""

    kind: ClassVar[str] = "run"
    collection: ClassVar[str] = "runs"

    request: RunRequest
    result: RunResult | None = Field(description="Present if the run succeeded.")
