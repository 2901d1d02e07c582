"""Deflections: how far the tool bends under given loads, by the model of a run."""

from __future__ import annotations

from typing import Annotated

from pydantic import FailFast, Field

from jointstiff.schemas.fields import (
    Compliance,
    Dimensionless,
    Identifier,
    LinearStiffness,
    Message,
    Metres,
    Name,
    Point,
    Quantity,
    Radians,
    RotationPerForce,
    Square3,
    TranslationalCompliance,
    TranslationPerMoment,
    Vector3,
)
from jointstiff.schemas.job import FromRun
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.schemas.run import BudgetSource, Evaluation

MAX_CASES = 2_000

Interval3 = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""Lower and upper end along x, y and z."""


class LoadCase(Message):
    """One posture under one load."""

    label: Name | None = Field(default=None, description="Name of the case; its number if absent.")
    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Angles without the load, as the controller shows them, in units.angle."
    )
    force: Vector3 = Field(description="Force on the robot, axes of R0, in units.force.")
    moment: Vector3 | None = Field(
        default=None, description="Moment on the robot about the load point, axes of R0, in units.moment."
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Point where the force acts, flange frame, in units.length; default: that of all cases.",
    )
    place: Vector3 | None = Field(
        default=None,
        description="Place whose deflection is predicted, flange frame, in units.length; default: the load "
        "point.",
    )
    direction: Vector3 | None = Field(
        default=None,
        description="Direction of the requested stiffness, axes of R0; default: that of the force.",
    )


class LinkMass(Message):
    """The mass that a joint carries; tool and payload belong to the last."""

    joint: Name
    mass: Annotated[float, Field(strict=True, ge=0.0, le=1e6)] = Field(
        description="Mass in kg.", json_schema_extra={"unit": "kg"}
    )
    centre: Vector3 = Field(
        description="Centre of mass in the frame that moves with the joint, in units.length."
    )


class SagOptions(Message):
    """Reference of a deflection."""

    absolute: bool = Field(
        default=False,
        strict=True,
        description="True for deflections relative to an arm that does not bend: they include the sag under "
        "its own weight, and that of the load if there is one. Needs a run with `weight`.",
    )


class DeflectionOptions(SagOptions):
    """Options of predicted deflections."""

    units: Units
    load_point: Vector3 | None = Field(
        default=None,
        description="Point where forces act, flange frame, in units.length; a case may give its own.",
    )
    place: Vector3 | None = Field(
        default=None,
        description="Place whose deflection is predicted, flange frame, in units.length; default: the load "
        "point.",
    )
    masses: Annotated[list[LinkMass], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list,
        description="Masses for own weight, which acts along −z of R0; own weight is not included if empty.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] = Field(
        default=0.95, description="Confidence level of the intervals."
    )
    cases: Annotated[list[LoadCase], Field(min_length=1, max_length=MAX_CASES), FailFast()]


class DeflectionRequest(DeflectionOptions):
    """A request of deflections."""

    run_id: Identifier = Field(description="Id of the run whose model is used.")


class ReadingsInterval(Message):
    """Intervals with the errors of the readings and the stated errors of the force, without model error."""

    displacement: Metres[Interval3]
    rotation: Radians[Interval3]


class ModelErrorInterval(Message):
    """Intervals that include the model error, calibrated on postures omitted from the fit."""

    displacement: Metres[Interval3]
    radius: Metres[float] = Field(
        description="Radius of the ball around the displacement that contains the true one at the "
        "confidence level; empirical, from postures omitted in turn, without a guarantee."
    )
    load_ratio: Dimensionless[float] = Field(
        description="Magnitude of the load relative to the campaign's greatest; above 1 the load is "
        "extrapolated."
    )
    leverage_ratio: Dimensionless[float] = Field(
        description="Standard uncertainty per load relative to the campaign's worst target; above 1 the "
        "posture or place is extrapolated."
    )


class DirectionalStiffness(Message):
    """Stiffness at the place along a direction, by three usual definitions."""

    direction: Dimensionless[Point] = Field(description="Unit vector, axes of R0.")
    lateral_free: LinearStiffness[float | None] = Field(
        description="1 / (u' C_tt u): motion across the direction is free. Null if infinite."
    )
    lateral_blocked: LinearStiffness[float | None] = Field(
        description="u' inv(C_tt) u: motion across the direction is blocked. Null if infinite."
    )
    rotation_blocked: LinearStiffness[float | None] = Field(
        description="u' K_tt u, K = inv(C): every motion except along the direction is blocked. Null if "
        "infinite."
    )
    compliance: TranslationalCompliance[float] = Field(description="u' C_tt u.")
    standard_uncertainty: TranslationalCompliance[float | None] = Field(
        description="Standard uncertainty of that compliance, from the readings alone."
    )


class WorstDirection(Message):
    """Direction of force that moves the place most."""

    direction: Dimensionless[Point]
    compliance: TranslationalCompliance[float]
    compliance_uncertainty: TranslationalCompliance[float | None] = Field(
        description="Standard uncertainty, from the readings alone."
    )
    direction_uncertainty: Radians[float | None] = Field(
        description="Standard uncertainty of the direction's angle, at most a quarter turn."
    )


class CartesianCompliance(Message):
    """Response of the place to a small additional wrench there, in the loaded posture, axes of R0."""

    translation_by_force: TranslationalCompliance[Square3]
    translation_by_moment: TranslationPerMoment[Square3]
    rotation_by_force: RotationPerForce[Square3]
    rotation_by_moment: Compliance[Square3]
    symmetric: bool = Field(description="True if the load has a potential: a dead moment has none.")
    along: DirectionalStiffness | None = Field(description="Null without a force and a direction.")
    worst: WorstDirection


class DeflectionComponent(Message):
    """One source of uncertainty of a predicted displacement."""

    source: BudgetSource
    evaluation: Evaluation
    included: bool = Field(description="True if the component is part of `readings_only`.")
    contribution: Metres[float] = Field(description="Contribution to the standard uncertainty.")


class DeflectionBudget(Message):
    """Uncertainty budget of the length of a predicted displacement. The load of the case counts as exact."""

    components: list[DeflectionComponent] = Field(
        description="Components from the run's compliances, with their correlations; the model "
        "error is the radius of its ball over the coverage factor."
    )
    standard_uncertainty: Metres[float] = Field(
        description="Combined standard uncertainty of the included components."
    )
    coverage_factor: Dimensionless[float] = Field(description="Factor for the request's confidence.")
    expanded_uncertainty: Metres[float]
    expanded_with_model_error: Metres[float] = Field(description="Expanded uncertainty of all components.")


class CaseResult(Message):
    """One case; with a `reason` it has no numbers."""

    label: Name
    displacement: Metres[Point | None] = Field(
        description="Displacement of the place, loaded minus unloaded, axes of R0."
    )
    rotation: Radians[Point | None] = Field(description="Rotation vector of the flange, axes of R0.")
    readings_only: ReadingsInterval | None = Field(
        description="Intervals by the readings; null if the uncertainty is unknown."
    )
    with_model_error: ModelErrorInterval | None = Field(
        description="Intervals with model error; null without a bound, see `remarks`."
    )
    compliance: CartesianCompliance | None
    budget: DeflectionBudget | None = Field(
        default=None,
        description="Uncertainty budget; null without a displacement, with elastic links or coupling, or if "
        "the uncertainty is unknown.",
    )
    remarks: list[str] = Field(
        description="Extrapolations by name, or reasons why there is no number or no bound."
    )


class DeflectionResult(FromRun):
    """Deflections of all cases, in SI units."""

    confidence: Dimensionless[float]
    model_error_postures: int = Field(
        description="Number of postures that the bound of the model error is based on."
    )
    postures_needed: int = Field(description="Number of postures that this confidence level needs.")
    remarks: list[str] = Field(description="Remarks that apply to all cases: own weight, K_c in the fit.")
    cases: list[CaseResult]
