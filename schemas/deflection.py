"""Deflections of the tool by the model of a run: under given loads, and over a work area."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import FailFast, Field, StrictBool

from jointstiff.schemas.fields import (
    Confidence,
    Dimensionless,
    Identifier,
    Interval,
    Kilograms,
    LinearStiffness,
    Message,
    Metres,
    Name,
    Newtons,
    Point,
    Positions,
    Quantity,
    Radians,
    RotationalCompliance,
    RotationPerForce,
    Square3,
    Torque,
    TranslationalCompliance,
    TranslationPerMoment,
    Vector3,
)
from jointstiff.schemas.finding import AcceptingOptions
from jointstiff.schemas.job import FromRun, Job
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.plan import Box
from jointstiff.schemas.robot import MAX_JOINTS

MAX_CASES = 2_000

Interval3 = tuple[Interval, Interval, Interval]
"""Lower and upper end along x, y and z."""


class LoadCase(Message):
    """One posture under one load."""

    label: Name | None = Field(default=None, description="Name of the case; default: the number of the case.")
    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Joint positions without the load, as the controller shows them, in units.angle or "
        "units.length."
    )
    force: Vector3 = Field(
        description="Force on the robot along the axes of the base frame R0, in units.force."
    )
    moment: Vector3 | None = Field(
        default=None,
        description="Moment on the robot about the load point, along the axes of the base frame R0, in "
        "units.moment.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Point where the force acts, in the flange frame, in units.length; default: the load "
        "point that all cases share.",
    )
    place: Vector3 | None = Field(
        default=None,
        description="Point whose deflection is predicted, in the flange frame, in units.length; default: "
        "the load point.",
    )
    direction: Vector3 | None = Field(
        default=None,
        description="Direction along which the stiffness is computed; default: the direction of the force.",
    )


class LinkMass(Message):
    """Mass that a joint carries; the last joint also carries tool and payload."""

    joint: Name
    mass: Kilograms[Annotated[float, Field(strict=True, ge=0.0, le=1e6)]] = Field(description="Mass in kg.")
    centre: Vector3 = Field(
        description="Centre of mass of the body, in the frame that moves with the joint, in units.length."
    )


class SagOptions(Message):
    """Reference of deflections."""

    absolute: StrictBool = Field(
        default=False,
        description="True to include the sag by own weight, which requires a run with `weight`. "
        "Deflections are then relative to a rigid arm.",
    )


class PredictionOptions(SagOptions):
    """Own weight and intervals of a prediction."""

    masses: Annotated[list[LinkMass], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list,
        description="Masses of the links, whose weight acts along −z of the robot's base frame R0; empty if "
        "the own weight is neglected.",
    )
    confidence: Confidence = 0.95


class DeflectionOptions(PredictionOptions):
    """Options of predicted deflections."""

    units: Units
    load_point: Vector3 | None = Field(
        default=None,
        description="Point where the forces act, in the flange frame, in units.length; a case may state "
        "another point.",
    )
    place: Vector3 | None = Field(
        default=None,
        description="Point whose deflection is predicted, in the flange frame, in units.length; default: "
        "the load point.",
    )
    cases: Annotated[list[LoadCase], Field(min_length=1, max_length=MAX_CASES), FailFast()]


class DeflectionRequest(DeflectionOptions):
    """A request of deflections."""

    run_id: Identifier = Field(description="Id of the run whose identified model is used.")


class ModelErrorInterval(Message):
    """Intervals that include the model error, calibrated on postures omitted from the fit."""

    displacement: Metres[Interval3]
    radius: Metres[float] = Field(
        description="Greatest distance between true and predicted displacement at the requested "
        "confidence. The distance comes from postures omitted from the fit."
    )
    load_ratio: Dimensionless[float] = Field(
        description="Load divided by the greatest load of the campaign; above 1.01 the case is an "
        "extrapolation."
    )
    leverage_ratio: Dimensionless[float] = Field(
        description="Standard uncertainty per load, divided by the greatest standard uncertainty per "
        "load in the campaign. Above 1.01 the case is an extrapolation."
    )


class DirectionalStiffness(Message):
    """Stiffness of the point along a direction, by three usual definitions."""

    direction: Dimensionless[Point] = Field(description="Unit vector, axes of R0.")
    lateral_free: LinearStiffness[float | None] = Field(
        description="Stiffness if all other motion is free; null if infinite."
    )
    lateral_blocked: LinearStiffness[float | None] = Field(
        description="Stiffness if translations across the direction are blocked; null if infinite."
    )
    rotation_blocked: LinearStiffness[float | None] = Field(
        description="Stiffness if all other motion is blocked; null if infinite."
    )
    compliance: TranslationalCompliance[float] = Field(description="Compliance along the direction.")
    standard_uncertainty: TranslationalCompliance[float | None] = Field(
        description="Standard uncertainty of the compliance, from the readings alone."
    )


class WorstDirection(Message):
    """Direction in which a force moves the point most."""

    direction: Dimensionless[Point]
    compliance: TranslationalCompliance[float]
    compliance_uncertainty: TranslationalCompliance[float | None] = Field(
        description="Standard uncertainty, from the noise of the readings alone."
    )
    direction_uncertainty: Radians[float | None] = Field(
        description="Standard uncertainty of the direction, as an angle of at most 90°."
    )


class CartesianCompliance(Message):
    """Response of a point to a small additional force and moment at the point, in the loaded posture."""

    translation_by_force: TranslationalCompliance[Square3]
    translation_by_moment: TranslationPerMoment[Square3]
    rotation_by_force: RotationPerForce[Square3]
    rotation_by_moment: RotationalCompliance[Square3]
    symmetric: StrictBool = Field(
        description="True if the matrices are symmetric; they are asymmetric if a moment acts."
    )
    along: DirectionalStiffness | None = Field(
        description="Stiffness along the direction; null if the case has neither a force nor a direction."
    )
    worst: WorstDirection


class DeflectionBudget(Message):
    """Uncertainty budget of the length of a predicted displacement. The load of the case counts as exact."""

    contributions: Metres[dict[str, float]] = Field(
        description="Contribution of each source in the run's `budget` to the standard uncertainty."
    )
    included: list[str] = Field(description="Sources that `standard_uncertainty` combines.")
    standard_uncertainty: Metres[float]
    coverage_factor: Dimensionless[float] = Field(
        description="Factor from standard uncertainty to expanded uncertainty at the requested confidence."
    )
    expanded_uncertainty: Metres[float]
    expanded_with_model_error: Metres[float] = Field(description="Expanded uncertainty of all sources.")


class CaseResult(Message):
    """Result of one case; a case with a `reason` has no numbers."""

    label: Name
    displacement: Metres[Point | None] = Field(
        description="Displacement of the point, loaded minus unloaded position, along the axes of the base "
        "frame R0."
    )
    rotation: Radians[Point | None] = Field(
        description="Rotation of the flange by the load, as a rotation vector along the axes of the base "
        "frame R0."
    )
    readings_only: Metres[Interval3 | None] = Field(
        description="Interval that includes the errors of the readings and the stated errors of the force; "
        "null if unknown."
    )
    rotation_interval: Radians[Interval3 | None] = Field(description="Interval of the rotation.")
    with_model_error: ModelErrorInterval | None = Field(
        description="Intervals that also include the error of the model; null if unknown, with the reason "
        "in `remarks`."
    )
    compliance: CartesianCompliance | None
    budget: DeflectionBudget | None = Field(
        default=None,
        description="Uncertainty budget of the displacement's length for an exact load; null if unknown, "
        "and with elastic links or coupling.",
    )
    remarks: list[str] = Field(
        description="Warnings of extrapolation, and reasons why a number or an interval is missing."
    )


class DeflectionResult(FromRun):
    """Deflections of all cases, in SI units."""

    confidence: Dimensionless[float]
    model_error_postures: int = Field(
        description="Number of measured postures from which the bound of the model error was determined."
    )
    remarks: list[str] = Field(description="Remarks that concern all cases.")
    cases: list[CaseResult]


MAX_ALONG_AXIS = 1_000
MAX_PLACES = 100_000
MAX_POSES = 200_000
"""Greatest number of poses (places times orientations) of a map. The inverse kinematics of each pose takes
10 µs, and is computed again for each download."""

_Count = Annotated[int, Field(strict=True, ge=1, le=MAX_ALONG_AXIS)]


class MapOptions(AcceptingOptions, SagOptions):
    """A work area, a tool and a process."""

    name: Name | None = None
    area: Metres[Box]
    grid: tuple[_Count, _Count, _Count] = Field(
        description="Number of places along x, y and z. The first and last place lie on the faces of the "
        "box; a single place lies in the middle."
    )
    place: Metres[Vector3] = Field(
        description="Position of the tool in the flange frame; the robot moves this point to each place of "
        "the map."
    )
    load_point: Metres[Vector3 | None] = Field(
        default=None,
        description="Point where the force acts, in the flange frame; default: the position of the tool.",
    )
    tool_axis: Dimensionless[Vector3] = Field(
        default=(0.0, 0.0, 1.0), description="Axis of the tool, in the flange frame."
    )
    directions: Dimensionless[Annotated[list[Vector3], Field(min_length=1, max_length=64)]] = Field(
        default=[(0.0, 0.0, -1.0)],
        description="Directions in which the axis of the tool may point, along the axes of the base "
        "frame R0.",
    )
    turns: Annotated[int, Field(strict=True, ge=1, le=360)] = Field(
        default=1,
        description="Number of rotation angles of the tool about its axis, spread evenly over 360°. At "
        "the first angle, the flange's x axis points along x of the base frame. If the tool "
        "points along x, y is used.",
    )
    force: Newtons[Vector3] = Field(description="Force of the process on the robot, along `axes`.")
    moment: Torque[Vector3 | None] = Field(
        default=None, description="Moment of the process on the robot, about the load point."
    )
    axes: Literal["base", "flange"] = Field(
        default="base", description="Frame in which force, moment and `direction` are given."
    )
    direction: Dimensionless[Vector3 | None] = Field(
        default=None,
        description="Direction for the compliances along and across; default: the direction of the force.",
    )
    limits: Positions[dict[Name, tuple[Quantity, Quantity]]] = Field(
        default_factory=dict,
        description="Joint limits by joint name, in addition to the limits of the robot.",
    )
    near: Positions[Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] | None] = Field(
        default=None,
        description="Joint positions as the controller shows them. At each place of the map, the posture "
        "nearest to these positions is used. Default: the stiffest posture at each place. "
        "Required with prismatic joints, which keep their position.",
    )
    confidence: Dimensionless[Confidence] = 0.95


class MapRequest(MapOptions):
    """Request of a map."""

    run_id: Identifier = Field(description="Id of the run whose identified model is used.")


PlaceStatus = Literal["reached", "out_of_reach", "joint_limits", "unseen_joint", "overloaded", "not_followed"]


class MapPlace(Message):
    """One place of a map."""

    position: Metres[Point] = Field(description="Position in R0.")
    joints: Positions[list[float]] = Field(
        description="Joint positions without the load, as the controller shows them."
    )
    tool_direction: Dimensionless[Point] = Field(
        description="Direction in which the axis of the tool points."
    )
    displacement: Metres[Point] = Field(
        description="Displacement by the load, loaded minus unloaded position, along the axes of the base "
        "frame R0."
    )
    deflection: Metres[float] = Field(description="Length of the displacement.")
    readings_only: Metres[Interval | None] = Field(
        description="Interval of `deflection` from the noise of the readings alone; null if unknown."
    )
    with_model_error: Metres[Interval | None] = Field(
        description="Interval of `deflection` that includes the model error; null without a bound of the "
        "model error."
    )
    compliance_along: TranslationalCompliance[float | None] = Field(
        description="Compliance along the direction; null if a joint's stiffness is not determined."
    )
    compliance_across: TranslationalCompliance[float | None] = Field(
        description="Greatest compliance across the direction; null if `compliance_along` is null."
    )
    extrapolation: Dimensionless[float | None] = Field(
        description="Load, or uncertainty per load, divided by the campaign's greatest value; null "
        "without model error. Above 1.01 the place is an extrapolation."
    )


class MapResult(FromRun):
    """Summary of a map; all places are in its files (CSV, npz)."""

    places: int
    counts: dict[PlaceStatus, int] = Field(
        description="Number of places by status. `reached`: with values. `out_of_reach`: no posture "
        "reaches the place. `joint_limits`: all postures are beyond the limits. "
        "`unseen_joint`: the load twists a joint that the readings do not determine. "
        "`overloaded`: the load halves a joint's stiffness, or turns a joint by 0.25 rad. "
        "`not_followed`: too near a singularity to follow `near`."
    )
    percentiles: Metres[dict[str, float]] = Field(
        description="Percentiles of the deflection over all reached places: `0`, `5`, `25`, `50`, `75`, "
        "`95`, `100`."
    )
    worst: MapPlace | None = Field(
        description="Place with the largest deflection; null if no place is reached."
    )
    stiffest: MapPlace | None = Field(
        description="Place with the smallest deflection; null if no place is reached."
    )
    extrapolated: int = Field(
        description="Number of reached places at which the prediction is an extrapolation."
    )
    model_error_postures: int = Field(
        description="Number of measured postures from which the bound of the model error was determined."
    )
    remarks: list[str] = Field(description="Remarks that apply to all places.")


class Map(Job):
    """A stored map."""

    collection: ClassVar[str] = "maps"

    kind: Literal["map"] = "map"
    request: MapRequest
    result: MapResult | None = Field(description="Present if the job succeeded.")
