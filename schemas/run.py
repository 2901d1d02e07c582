"""A run: one identification of one measurement set, with its evidence and provenance."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator
from pydantic.config import JsonDict

from schemas.base import Identifier, Message, Name, Timestamp
from schemas.measurement_set import QualityWarning
from schemas.problem import Problem
from schemas.resampling import Resampling, ResamplingResult
from schemas.robot import MAX_JOINTS

__all__ = [
    "Certificate",
    "Goodness",
    "Identifiability",
    "JointResult",
    "Method",
    "Progress",
    "Provenance",
    "Residual",
    "Run",
    "RunOptions",
    "RunRequest",
    "RunResult",
    "RunState",
    "RunSummary",
    "StageIdentifiability",
    "Weighting",
]

Method = Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
RunState = Literal["queued", "running", "succeeded", "failed", "cancelled"]

_COMPLIANCE: JsonDict = {"unit": "rad/(N.m)"}
_STIFFNESS: JsonDict = {"unit": "N.m/rad"}
_LENGTH: JsonDict = {"unit": "m"}

PositiveStiffness = Annotated[float, Field(strict=True, ge=1.0, le=1e15)]
StiffnessBound = tuple[PositiveStiffness | None, PositiveStiffness | None]


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
    loss: Literal["squared"] = Field(default="squared", description="Loss of a whitened residual.")
    elasticity: Literal["joints"] = Field(default="joints", description="What bends.")
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
        description="Coverage interval from the covariance, cut at the constraints; null for a "
        "joint at its bound.",
        json_schema_extra=_COMPLIANCE,
    )
    stiffness_interval: tuple[float, float | None] | None = Field(
        description="The same in stiffness; an upper end of null means: no upper limit.",
        json_schema_extra=_STIFFNESS,
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


class Identifiability(Message):
    """What the readings can determine."""

    parameters: int = Field(description="Number of joints of the robot.")
    rank: int = Field(description="How many compliances, or combinations, are determined.")
    condition_number: float | None = Field(
        description="The greatest of the stages'; null where a rank is not full. Dimensionless."
    )
    combinations: list[list[Name]] = Field(
        description="Groups of joints whose compliances show in the readings only together."
    )
    stages: list[StageIdentifiability] = Field(
        description="One a stage of the method: two for the decoupled one, arm then wrist."
    )


SupportFinder = Literal["least_squares", "pivoting", "clarabel", "active_set"]


class Certificate(Message):
    """Proof of optimality, recomputed from the data. Dimensionless; zero is exact up to rounding."""

    primal: float = Field(description="Greatest violation of a bound.")
    dual: float = Field(description="Greatest gradient of the wrong sign.")
    complementarity: float = Field(description="Greatest min(slack, multiplier).")
    solved_by: list[SupportFinder] = Field(
        description="What found the joints at their bounds, for each stage of the method: least squares "
        "(none), principal pivoting, Clarabel, or the exact active-set method."
    )


class Goodness(Message):
    """Chi-square of the readings' residuals under sigma."""

    chi_square: float = Field(description="Sum of squared whitened residuals. Dimensionless.")
    degrees_of_freedom: float
    sigma_source: Literal["given", "residuals"] = Field(
        description="Whether sigma was stated with the set or estimated from these residuals."
    )


class Residual(Message):
    """One target in one observation."""

    observation: Name
    target: Name
    deflection: tuple[float, float, float] = Field(json_schema_extra=_LENGTH)
    predicted: tuple[float, float, float] = Field(json_schema_extra=_LENGTH)
    residual: tuple[float, float, float] = Field(
        description="Measured minus predicted, axes of R0.", json_schema_extra=_LENGTH
    )


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
    resampling: ResamplingResult | None = Field(default=None, description="If the run asked for it.")
    residuals: list[Residual]
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
