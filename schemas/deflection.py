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
from jointstiff.schemas.measurement.measurement_set import Units
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.schemas.run.budget import BudgetSource, Evaluation

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
        description="Point where the force acts, flange frame, in units.length; that of all cases if absent.",
    )
    place: Vector3 | None = Field(
        default=None,
        description="Whose deflection is asked for, flange frame, in units.length; the load point if absent.",
    )
    direction: Vector3 | None = Field(
        default=None,
        description="Along which stiffness is asked for, axes of R0; along the force if absent.",
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
    """Choice of what a deflection starts from."""

    absolute: bool = Field(
        default=False,
        strict=True,
        description="True for positions beside those of an arm that does not bend: the sag under its own "
        "weight counts, with the load if there is one. Needs a run with `weight`.",
    )


class DeflectionOptions(SagOptions):
    """Which deflections are asked for."""

    units: Units
    load_point: Vector3 | None = Field(
        default=None,
        description="Point where forces act, flange frame, in units.length; a case may give its own.",
    )
    place: Vector3 | None = Field(
        default=None, description="Whose deflection is asked for; the load point if absent. Likewise."
    )
    masses: Annotated[list[LinkMass], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list,
        description="Own weight of the links, acting along -z of R0; left out where no masses are given.",
    )
    confidence: Annotated[float, Field(strict=True, ge=0.5, le=0.9999)] = Field(
        default=0.95, description="Level of the intervals."
    )
    cases: Annotated[list[LoadCase], Field(min_length=1, max_length=MAX_CASES), FailFast()]


class DeflectionRequest(DeflectionOptions):
    """Deflections as they are asked for."""

    run_id: Identifier = Field(description="The run whose model predicts.")


class ReadingsInterval(Message):
    """Intervals that hold the errors of the readings, and of the force where it is stated; no model error."""

    displacement: Metres[Interval3]
    rotation: Radians[Interval3]


class ModelErrorInterval(Message):
    """Intervals that are to hold the model error too, calibrated on postures left out of the fit."""

    displacement: Metres[Interval3]
    radius: Metres[float] = Field(
        description="Radius of the ball about the displacement that is to hold the truth at the confidence: "
        "empirical, from postures left out in turn, without a guarantee."
    )
    load_ratio: Dimensionless[float] = Field(
        description="Size of the load over the campaign's greatest; above 1 it is extrapolated."
    )
    leverage_ratio: Dimensionless[float] = Field(
        description="Standard uncertainty per load over that of the campaign's worst target; above 1 the "
        "posture or place is extrapolated."
    )


class DirectionalStiffness(Message):
    """Stiffness of the place along a direction, in the three meanings that are in use."""

    direction: Dimensionless[Point] = Field(description="Unit vector, axes of R0.")
    lateral_free: LinearStiffness[float | None] = Field(
        description="1 / (u' C_tt u): motion across the direction left free. Null if it is infinite."
    )
    lateral_blocked: LinearStiffness[float | None] = Field(
        description="u' inv(C_tt) u: motion across it blocked. Null if it is infinite."
    )
    rotation_blocked: LinearStiffness[float | None] = Field(
        description="u' K_tt u, K = inv(C): all but motion along it blocked. Null if it is infinite."
    )
    compliance: TranslationalCompliance[float] = Field(description="u' C_tt u.")
    standard_uncertainty: TranslationalCompliance[float | None] = Field(
        description="Standard uncertainty of that compliance, from the readings alone."
    )


class WorstDirection(Message):
    """The direction in which a force moves the place most."""

    direction: Dimensionless[Point]
    compliance: TranslationalCompliance[float]
    compliance_uncertainty: TranslationalCompliance[float | None] = Field(
        description="Standard uncertainty, from the readings alone."
    )
    direction_uncertainty: Radians[float | None] = Field(
        description="Standard uncertainty of its angle, at most a quarter turn."
    )


class CartesianCompliance(Message):
    """Answer of the place to a further small wrench at the place, in the loaded posture, axes of R0."""

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
        description="Components of the run's compliances, carried with their correlations; the model "
        "error is the radius of its ball over the coverage factor."
    )
    standard_uncertainty: Metres[float] = Field(
        description="Combined standard uncertainty of the included components."
    )
    coverage_factor: Dimensionless[float] = Field(description="Factor for the request's confidence.")
    expanded_uncertainty: Metres[float]
    expanded_with_model_error: Metres[float] = Field(description="Expanded uncertainty of all components.")


class CaseResult(Message):
    """One case. Where a reason is given, there are no numbers."""

    label: Name
    displacement: Metres[Point | None] = Field(
        description="Displacement of the place, loaded minus unloaded, axes of R0."
    )
    rotation: Radians[Point | None] = Field(description="Rotation vector of the flange, axes of R0.")
    readings_only: ReadingsInterval | None = Field(description="Null where no uncertainty is known.")
    with_model_error: ModelErrorInterval | None = Field(
        description="Null where there is no bound: see `remarks`."
    )
    compliance: CartesianCompliance | None
    budget: DeflectionBudget | None = Field(
        default=None,
        description="Null without a displacement, and where the run has no budget: elastic links, or no "
        "known uncertainty.",
    )
    remarks: list[str] = Field(description="Extrapolation, by name; or why there is no number or no bound.")


class DeflectionResult(FromRun):
    """Deflections of all cases, in SI units."""

    confidence: Dimensionless[float]
    model_error_postures: int = Field(description="Postures that the bound of the model error rests on.")
    postures_needed: int = Field(description="Number of postures that this confidence takes.")
    remarks: list[str] = Field(description="Remarks that apply to all cases: own weight, K_c in the fit.")
    cases: list[CaseResult]
