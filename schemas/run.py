"""A run: one identification of one measurement set, with its evidence and provenance."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator
from pydantic.config import JsonDict

from schemas.base import Identifier, Message, Name, Timestamp
from schemas.links import CrossValidation, Elasticity, LinksResult, ModelSelection
from schemas.measurement_set import QualityWarning
from schemas.problem import Problem
from schemas.resampling import Resampling, ResamplingResult
from schemas.robot import MAX_JOINTS

__all__ = [
    "Advice",
    "Certificate",
    "ComplementaryStiffness",
    "EncoderResidual",
    "Goodness",
    "Identifiability",
    "JointResult",
    "Method",
    "ObservabilityIndices",
    "OneSidedBounds",
    "Progress",
    "Provenance",
    "Residual",
    "RobustLoss",
    "Run",
    "RunOptions",
    "RunRequest",
    "RunResult",
    "RunState",
    "RunSummary",
    "SigmaTest",
    "StageIdentifiability",
    "StiffnessPrior",
    "SuspiciousReading",
    "Weighting",
]

Method = Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
RunState = Literal["queued", "running", "succeeded", "failed", "cancelled"]

_COMPLIANCE: JsonDict = {"unit": "rad/(N.m)"}
_STIFFNESS: JsonDict = {"unit": "N.m/rad"}
_LENGTH: JsonDict = {"unit": "m"}
_ANGLE: JsonDict = {"unit": "rad"}

PositiveStiffness = Annotated[float, Field(strict=True, ge=1.0, le=1e15)]
StiffnessBound = tuple[PositiveStiffness | None, PositiveStiffness | None]


class StiffnessPrior(Message):
    """What is known of a joint before anything is measured."""

    stiffness: PositiveStiffness = Field(json_schema_extra=_STIFFNESS)
    standard_uncertainty: PositiveStiffness = Field(
        description="Of the stiffness; at most half of it, as the prior is Gaussian in compliance.",
        json_schema_extra=_STIFFNESS,
    )

    @field_validator("standard_uncertainty", mode="after")
    @classmethod
    def _at_most_half(cls, uncertainty: float, info: ValidationInfo) -> float:
        stiffness = info.data.get("stiffness")
        if stiffness is not None and uncertainty > stiffness / 2:
            raise ValueError("must be at most half of the stiffness; leave the prior out if less is known")
        return uncertainty


class RunOptions(Message):
    """How to identify. Every field has a default that suits three targets and a tracker."""

    method: Method = Field(
        default="partial_pose",
        description="`complete_pose`: six rows a configuration, from at least three targets. "
        "`partial_pose`: three rows a target, positions only. `decoupled_partial_pose`: the arm "
        "from the wrist centre first, then the wrist; needs three targets and a spherical wrist.",
    )
    weighting: Weighting = Field(
        default="covariance",
        description="`covariance`: each row by what the readings are worth. "
        "`characteristic_length`: translation divided by a length (complete pose only). "
        "`uniform`: all rows alike in SI units.",
    )
    characteristic_length: Annotated[float, Field(strict=True, ge=1e-3, le=1e3)] | None = Field(
        default=None,
        description="For that weighting; if absent, the length of least condition number.",
        json_schema_extra=_LENGTH,
    )
    positive: Annotated[bool, Field(strict=True)] = Field(
        default=True, strict=True, description="Constrain every compliance to be zero or positive."
    )
    stiffness_bounds: Annotated[dict[Name, StiffnessBound], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=dict,
        description="Least and greatest stiffness of a joint by its name, null for none. "
        "A bounded joint is positive in any case.",
        examples=[{"joint_2": [1e6, None]}],
        json_schema_extra=_STIFFNESS,
    )
    loss: Literal["squared", "huber"] = Field(
        default="squared",
        description="Of the norm of each target's whitened residual. `huber` grows linearly beyond a "
        "threshold, so that a target that was bumped cannot spoil the fit.",
    )
    huber_threshold: Annotated[float, Field(strict=True, ge=0.1, le=100.0)] | None = Field(
        default=None,
        description="For that loss: norm in units of sigma beyond which a reading counts less; 2.8 if "
        "absent, which 95 % of good readings stay below. Dimensionless.",
    )
    complementary_stiffness: Literal["neglected", "included"] = Field(
        default="neglected",
        description="Whether the change of the load's torques with the deflection is part of the model "
        "(Chen & Kao's conservative congruence transformation); the paper neglects it.",
    )
    priors: Annotated[dict[Name, StiffnessPrior], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=dict,
        description="What is known of a joint beforehand, from its data sheet say, by the joint's name.",
        examples=[{"joint_5": {"stiffness": 4e5, "standard_uncertainty": 4e4}}],
    )
    stiffness_order: Annotated[
        list[Annotated[list[Name], Field(min_length=2, max_length=MAX_JOINTS)]], Field(max_length=MAX_JOINTS)
    ] = Field(
        default_factory=list,
        description="Chains of joints, each at least as stiff as the next; they are positive in any case.",
        examples=[[["joint_2", "joint_4"]]],
    )
    elasticity: Elasticity = Field(
        default="joints",
        description="What bends. `coupled_joints`: a full positive semidefinite joint compliance. "
        "`diagonal_links`: joints, and six compliances a link. `joints_and_links`: joints, and a full "
        "positive semidefinite 6 x 6 compliance a link. All but `joints` go with method `partial_pose`, "
        "weighting `covariance` and loss `squared`, without bounds, priors, order and resampling.",
    )
    links: Annotated[list[Name], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list,
        description="The links that may bend, each by the joint that carries it; all if empty.",
        examples=[["joint_2", "joint_3"]],
    )
    link_penalty: Annotated[float, Field(strict=True, ge=1e-9, le=1e3)] | None = Field(
        default=None,
        description="Weight of the penalty on links and coupling; chosen by cross-validation if absent, and "
        "the run may then take long. Dimensionless.",
    )
    cross_validation: CrossValidation = Field(
        default=CrossValidation(), description="For all elasticities but `joints`."
    )
    resampling: Resampling | None = Field(
        default=None,
        description="Repeat the fit on configurations drawn at random; a run may then take long.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] = Field(
        default=0.95, description="Level of the intervals."
    )

    @field_validator("characteristic_length", mode="after")
    @classmethod
    def _goes_with_its_weighting(cls, length: float | None, info: ValidationInfo) -> float | None:
        weighting = info.data.get("weighting")
        if length is not None and weighting != "characteristic_length":
            raise ValueError(f"goes with weighting `characteristic_length` only, not with `{weighting}`")
        return length

    @field_validator("huber_threshold", mode="after")
    @classmethod
    def _goes_with_its_loss(cls, threshold: float | None, info: ValidationInfo) -> float | None:
        if threshold is not None and info.data.get("loss") != "huber":
            raise ValueError("goes with loss `huber` only")
        return threshold

    @field_validator("links", "link_penalty", mode="after")
    @classmethod
    def _goes_with_more_than_joints(
        cls, chosen: list[str] | float | None, info: ValidationInfo
    ) -> list[str] | float | None:
        elasticity = info.data.get("elasticity")
        if chosen and elasticity == "joints":
            raise ValueError("goes with an elasticity beyond `joints` only")
        if isinstance(chosen, list) and chosen and elasticity == "coupled_joints":
            raise ValueError("goes with an elasticity that has links, not with `coupled_joints`")
        return chosen

    @field_validator("stiffness_bounds", mode="after")
    @classmethod
    def _least_below_greatest(cls, bounds: dict[str, StiffnessBound]) -> dict[str, StiffnessBound]:
        for name, (least, greatest) in bounds.items():
            if least is not None and greatest is not None and least >= greatest:
                raise ValueError(f"{name}: the least stiffness must lie below the greatest")
        return bounds


class RunRequest(RunOptions):
    """A run as it is posted."""

    measurement_set_id: Identifier


class OneSidedBounds(Message):
    """Each holds by itself at the run's confidence; both together hold at less."""

    compliance_at_least: float = Field(json_schema_extra=_COMPLIANCE)
    compliance_at_most: float = Field(json_schema_extra=_COMPLIANCE)
    stiffness_at_least: float | None = Field(
        description="Stiffer than this; null where the compliance may be negative.",
        json_schema_extra=_STIFFNESS,
    )
    stiffness_at_most: float | None = Field(
        description="Null: no upper limit, the readings cannot tell the joint from rigid.",
        json_schema_extra=_STIFFNESS,
    )


class JointResult(Message):
    """What the readings say of one joint. A joint that is not observable has no numbers."""

    name: Name
    status: Literal["identified", "at_bound", "not_observable"]
    compliance: float | None = Field(json_schema_extra=_COMPLIANCE)
    stiffness: float | None = Field(
        description="1 / compliance; null where the compliance is zero.",
        json_schema_extra=_STIFFNESS,
    )
    standard_uncertainty: float | None = Field(
        description="Of the compliance, from the covariance of the estimate without constraints.",
        json_schema_extra=_COMPLIANCE,
    )
    compliance_interval: tuple[float, float] | None = Field(
        description="Profile-likelihood interval under the constraints, at the run's confidence.",
        json_schema_extra=_COMPLIANCE,
    )
    stiffness_interval: tuple[float, float | None] | None = Field(
        description="The same in stiffness; an upper end of null means: no upper limit.",
        json_schema_extra=_STIFFNESS,
    )
    one_sided: OneSidedBounds | None = Field(default=None, description="One-sided bounds.")
    prior_to_data: float | None = Field(
        default=None,
        description="Information of the prior over that of the readings on this compliance, the others "
        "unknown; above 1 the prior speaks, not the readings. Null without a prior. Dimensionless.",
    )
    reason: str | None = Field(description="Why there is no number, or why the joint is at a bound.")


class StageIdentifiability(Message):
    """Of one stage of a method, over the joints that it sees."""

    rank: int = Field(description="How many compliances, or combinations, are determined.")
    condition_number: float | None = Field(
        description="Of the weighted regressor, columns of unit norm; null where the rank is not full. "
        "Dimensionless."
    )
    singular_values: list[float] = Field(description="Of the same matrix, largest first. Dimensionless.")


class ObservabilityIndices(Message):
    """The field's indices of how well a set of postures shows the parameters (Sun & Hollerbach 2008).

    Of the singular values s of the regressor with each column divided by what it would have been had the
    force pulled across the joint's lever and the moment turned about its axis, in every observation: no
    unit, no frame, and sets of any size compare. They concern the readings of all targets, whatever the
    method made of them. Larger is better; none exceeds 1.
    """

    o1: float = Field(description="Geometric mean of s (Borm & Menq 1991). Dimensionless.")
    o2: float = Field(description="Least over greatest s (Driels & Pathre 1990). Dimensionless.")
    o3: float = Field(description="Least s (Nahvi, Hollerbach & Hayward 1994). Dimensionless.")
    o4: float = Field(
        description="Least s squared over the greatest (Nahvi & Hollerbach 1996). Dimensionless."
    )
    o5: float = Field(description="1 / sum of 1/s (Sun & Hollerbach 2008). Dimensionless.")


class Advice(Message):
    """A measurement that would tell more of a joint."""

    joint: Name
    message: str = Field(description="In words: which posture, which load, and what it would bring.")
    joints: list[float] = Field(
        description="Angles as the controller shows them.", json_schema_extra={"unit": "rad"}
    )
    observation: Name | None = Field(description="The observation that has this posture, if one has.")
    force: tuple[float, float, float] = Field(
        description="On the robot, axes of R0, as strong as the strongest of the set; at the load point of "
        "that observation, for a new posture at that of the strongest force.",
        json_schema_extra={"unit": "N"},
    )
    uncertainty_ratio: float | None = Field(
        description="Standard uncertainty of the compliance after one such reading of all targets over that "
        "before, as the partial pose has them, without constraints and priors; null where the readings so "
        "far do not determine the compliance. Dimensionless."
    )
    standard_uncertainty: float | None = Field(
        default=None,
        description="Of the compliance after that reading; null where sigma is unknown.",
        json_schema_extra=_COMPLIANCE,
    )


class Identifiability(Message):
    """What the readings can determine, by a model of joints alone."""

    parameters: int = Field(description="Number of joints of the robot.")
    rank: int = Field(description="How many compliances, or combinations, are determined.")
    condition_number: float | None = Field(
        description="The greatest of the stages'; null where a rank is not full. Dimensionless."
    )
    combinations: list[list[Name]] = Field(
        description="Groups of joints whose compliances show in the readings only together."
    )
    observability: ObservabilityIndices | None = Field(
        default=None, description="Over the joints that the readings see; null where the rank is not full."
    )
    advice: list[Advice] = Field(
        default_factory=list,
        description="What to measure next, for at most three joints: those without a number, at zero "
        "compliance, or with a standard uncertainty above a tenth of it. At most two pieces a joint, the "
        "better first: another load in a posture of the set, and a new posture.",
    )
    weakest: list[str] = Field(
        default_factory=list,
        description="In words, for each stage with a condition number above 100: which joints the readings "
        "hardly tell apart, and in which proportion.",
    )
    stages: list[StageIdentifiability] = Field(
        description="One a stage of the method: two for the decoupled one, arm then wrist."
    )


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
    deflection: tuple[float, float, float] = Field(json_schema_extra=_LENGTH)
    predicted: tuple[float, float, float] = Field(json_schema_extra=_LENGTH)
    residual: tuple[float, float, float] = Field(
        description="Measured minus predicted, axes of R0.", json_schema_extra=_LENGTH
    )


class EncoderResidual(Message):
    """One secondary encoder in one observation."""

    observation: Name
    joint: Name
    deflection: float = Field(description="Loaded minus unloaded.", json_schema_extra=_ANGLE)
    predicted: float = Field(json_schema_extra=_ANGLE)
    residual: float = Field(description="Measured minus predicted.", json_schema_extra=_ANGLE)


class RunResult(Message):
    """The numbers."""

    joints: list[JointResult]
    compensation: float | None = Field(
        description="Share of the mean deflection that the model predicts: "
        "1 - mean‖residual‖ / mean‖deflection‖; null where nothing moved. Dimensionless."
    )
    rms_residual: float = Field(
        description="Root mean square of the residual vectors' lengths.", json_schema_extra=_LENGTH
    )
    sigma: float | None = Field(
        description="Standard uncertainty of one coordinate of one reading; null where it was not "
        "given and there are no residual degrees of freedom.",
        json_schema_extra=_LENGTH,
    )
    goodness: Goodness
    identifiability: Identifiability
    certificate: Certificate = Field(description="The greatest violations of the stages.")
    characteristic_length: float | None = Field(
        description="The length that was used, if the weighting needs one.",
        json_schema_extra=_LENGTH,
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
    encoder_residuals: list[EncoderResidual] = Field(
        default_factory=list, description="If secondary encoders were read."
    )
    warnings: list[QualityWarning] = Field(
        description="What was noticed when the set was stored, then what the fit itself raises."
    )


class Provenance(Message):
    """What it takes to repeat a run and get the same numbers."""

    versions: dict[str, str] = Field(description="Of this software and of what it computes with.")
    input_hash: str = Field(description="SHA-256 of robot, readings and request.")
    created_at: Timestamp
    started_at: Timestamp | None
    ended_at: Timestamp | None


class RunSummary(Message):
    """A run in a listing."""

    id: Identifier
    measurement_set_id: Identifier
    robot_id: Identifier
    method: Method
    weighting: Weighting
    positive: bool
    state: RunState
    created_at: Timestamp


class Progress(Message):
    """How far a run came."""

    done: int
    total: int
    unit: str = Field(description="Of both numbers.", examples=["resamples"])
    activity: str = Field(description="What the run is doing.", examples=["resampling"])


class Run(Message):
    """A stored run. It never changes once ended."""

    id: Identifier
    state: RunState = Field(
        description="`queued` and `running` runs go on; look again, or follow /v1/runs/{id}/events."
    )
    progress: Progress | None = Field(default=None, description="Of a run that takes long.")
    request: RunRequest
    result: RunResult | None = Field(description="Present if the run succeeded.")
    error: Problem | None = Field(description="Present if the run failed.")
    provenance: Provenance
