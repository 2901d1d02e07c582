"""A plan: which postures and loads to measure, its goal, and a certificate. SI units throughout."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import Field, StrictBool
from typing_extensions import TypeAliasType

from jointstiff.schemas.fields import (
    Compliance,
    Dimensionless,
    Effort,
    Identifier,
    Kilograms,
    Message,
    Metres,
    Name,
    Newtons,
    Point,
    Positions,
    Quantity,
    Radians,
    Stiffness,
    Terminal,
    Vector3,
    parse_box,
    parse_numbers,
    parse_planned_load,
    parse_planned_step,
    parse_prior,
    parse_stiffness,
    parse_target,
    require_exactly_one,
)
from jointstiff.schemas.finding import AcceptingOptions, Assessment
from jointstiff.schemas.job import Job, Result
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.measurement import MAX_TARGETS, Instrument
from jointstiff.schemas.options import MAX_LEFT_OUT, Causes, OwnWeight, StiffnessPrior
from jointstiff.schemas.robot import MAX_JOINTS

_Share = Annotated[float, Field(strict=True, ge=0.001, le=1.0)]
_Length = Annotated[float, Field(strict=True, ge=1e-9, le=1.0)]


class JointsGoal(Message):
    """Goal for the relative uncertainty of every joint that a load can twist."""

    kind: Literal["joints"]
    relative: Dimensionless[_Share] = Field(
        description="Greatest half-width of a 95 % interval of a compliance, relative to the compliance: "
        "0.15 for ± 15 %."
    )


class DeflectionGoal(Message):
    """Goal for the uncertainty of the deflection in a box."""

    kind: Literal["deflection"]
    uncertainty: Metres[_Length] = Field(
        description="Greatest expanded uncertainty (95 %) of one coordinate of the deflection, as root "
        "mean square over the work area. Forces along all axes of R0 are included."
    )
    force: Newtons[Vector3 | None] = Field(
        default=None,
        description="Force in the work area, along the axes of the base frame R0. Default: the force of the "
        "load; downwards for a weight, else along each axis.",
    )


class DecisionGoal(Message):
    """Goal to decide whether the deflection in a box stays below a limit."""

    kind: Literal["decision"]
    limit: Metres[_Length] = Field(
        description="Limit of the greatest deflection in the work area by a force along an axis of the "
        "base frame R0. The question is decided once the 95 % interval of the deflection "
        "excludes the limit."
    )
    force: Newtons[Vector3 | None] = Field(
        default=None,
        description="Force in the work area, along the axes of the base frame R0. Default: the force of the "
        "load; downwards for a weight, else along each axis.",
    )


class LoadPointGoal(Message):
    """Goal that a test of the readings detects a wrong load point."""

    kind: Literal["load_point"]
    mistake: Metres[_Length] = Field(
        description="Error of the load point that the test detects in 80 % of all cases."
    )


Goal = Annotated[JointsGoal | DeflectionGoal | DecisionGoal, Field(discriminator="kind")]
PlanGoal = Annotated[JointsGoal | DeflectionGoal | DecisionGoal | LoadPointGoal, Field(discriminator="kind")]

_WORDS: Final = re.compile(
    r"(?:(?P<below>below|<)|(?P<place>load point))?\s*±?\s*(?P<number>[0-9]*\.?[0-9]+(?:e-?[0-9]+)?)\s*"
    r"(?P<unit>%|um|µm|μm|mm|m)",
    re.IGNORECASE,
)
_METRES: Final = {"um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "m": 1.0}


def parse_goal(text: str) -> dict[str, Any]:
    """Parse the text of a goal; return the fields of the goal.

    Goals are `15 %` (uncertainty of every joint's stiffness), `6 um` (uncertainty of the deflection in the
    work area), `below 0.5 mm` (decision whether the deflection stays below a limit), and `load point 10 mm`
    (a mistake of the load point shows).

    Raises:
        ValueError: the text is not a goal.
    """
    match = _WORDS.fullmatch(text.strip())
    is_relative = match is not None and match["unit"] == "%"
    is_length = match is not None and (match["below"] or match["place"])
    if match is None or float(match["number"]) <= 0.0 or (is_relative and is_length):
        raise ValueError(
            f'\'{text}\' is not a goal: write "15 %" for every joint, "6 um" for the deflection in the '
            'work area, or "below 0.5 mm" to decide whether this deflection stays below a limit'
        )
    number = float(match["number"])
    if is_relative:
        return {"kind": "joints", "relative": 0.01 * number}
    length = number * _METRES[match["unit"].lower()]
    if match["below"]:
        return {"kind": "decision", "limit": length}
    if match["place"]:
        return {"kind": "load_point", "mistake": length}
    return {"kind": "deflection", "uncertainty": length}


MAX_CANDIDATES = 50_000
MAX_READINGS = 200
MAX_BOXES = 32

Force = Annotated[float, Field(strict=True, gt=0.0, le=1e6)]
_Angle = Annotated[float, Field(strict=True, ge=0.0, le=3.2)]
Box = TypeAliasType(
    "Box",
    Annotated[
        tuple[Vector3, Vector3],
        Field(
            description="Corners of the box with the least and the greatest coordinates, in the "
            "robot's base frame R0."
        ),
    ],
)


class DeadWeight(Message):
    """A weight, which pulls along −z of R0."""

    kind: Literal["dead_weight"] = "dead_weight"
    force: Newtons[Force | None] = Field(default=None, description="Weight; or give `mass`.")
    mass: Kilograms[Force | None] = Field(
        default=None, description="Mass of a hung weight, instead of `force`; 1 kg weighs 9.80665 N."
    )

    _stated_once = require_exactly_one("force", "mass")

    @property
    def newtons(self) -> float:
        """Weight of the load [N], from its stated force or its stated mass."""
        return self.force if self.force is not None else 9.80665 * (self.mass or 0.0)

    @property
    def kilograms(self) -> float:
        """Mass of the load [kg], from its stated mass or its stated force."""
        return self.mass if self.mass is not None else (self.force or 0.0) / 9.80665


class AnyDirection(Message):
    """A force of limited size in any direction."""

    kind: Literal["any_direction"]
    force: Newtons[Force] = Field(
        description="Magnitude of the force, reduced where a joint torque would exceed the joint's limit."
    )


class Cable(Message):
    """A cable from the load point to one of several anchors."""

    kind: Literal["cable"]
    force: Newtons[Force]
    anchors: Metres[Annotated[list[Vector3], Field(min_length=1, max_length=8)]] = Field(
        description="Anchors in R0."
    )


PlannedLoad = Annotated[DeadWeight | AnyDirection | Cable | OwnWeight, Field(discriminator="kind")]


class PlannedStep(Message):
    """Mass at the load point, for readings of two encoders without and with the mass.

    The weight acts along −z of R0.
    """

    mass: Kilograms[Force] = Field(description="Mass of the load.")
    mass_uncertainty: Kilograms[Annotated[float, Field(strict=True, ge=0.0, le=1e6)] | None] = Field(
        default=None, description="Standard uncertainty of the mass; if absent, 1 % is assumed."
    )
    point_uncertainty: Metres[Annotated[float, Field(strict=True, ge=0.0, le=1.0)]] = Field(
        default=0.01, description="Standard uncertainty of each coordinate of the load point."
    )
    noise: Radians[Annotated[float, Field(strict=True, ge=1e-9, le=0.1)]] = Field(
        default=1e-5, description="Standard deviation of the step of a gearbox's twist in a single posture."
    )


class Surroundings(Message):
    """Obstacles that links avoid; each link is a capsule from joint to joint."""

    floor: Metres[Quantity | None] = Field(
        default=None, description="Least height of links and targets, in the robot's base frame R0."
    )
    inside: Metres[Box | None] = Field(
        default=None, description="Box in which all links and targets must remain."
    )
    obstacles: Metres[Annotated[list[Box], Field(max_length=MAX_BOXES)]] = Field(
        default_factory=list, description="Boxes that links and targets must avoid."
    )
    link_radius: Metres[Annotated[float, Field(strict=True, ge=0.0, le=10.0)] | None] = Field(
        default=None,
        description="Radius of the capsules that stand for the links; default: 4 % of the length of the "
        "stretched arm.",
    )
    facing: Dimensionless[dict[Name, Vector3]] = Field(
        default_factory=dict, description="Direction in which each reflector looks, in the flange frame."
    )
    acceptance: Radians[_Angle] = Field(
        default=3.2,
        description="Greatest angle between the direction of a reflector (`facing`) and the line of sight.",
    )


PlanCriterion = Literal["relative_a", "work_area", "d", "e", "worst_place"]


_AREA = "Work area: two corners of a box, in R0, in mm, in which deflections will be predicted."


class ReadingOptions(Message):
    """Equipment, surroundings and candidates, from which readings are chosen."""

    work_area: Annotated[Metres[Box | None], Terminal("--area", "X,Y,Z,X,Y,Z[mm]", parse_box, text=_AREA)] = (
        Field(
            default=None,
            description="Work area: box in the robot's base frame R0 in which deflections will be predicted.",
        )
    )
    load: Annotated[PlannedLoad | None, Terminal("", "KIND:NEWTONS", parse_planned_load)] = Field(
        default=None,
        description="Load to apply; default: the strongest force of the campaign, or the own weight.",
    )
    targets: Annotated[
        Metres[Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)]],
        Terminal("--target", "NAME=X,Y,Z[mm]", parse_target, "dict"),
    ] = Field(
        default_factory=dict,
        description="Places of the targets in the flange frame; default: the targets of the campaign.",
    )
    directions: Annotated[
        Dimensionless[Annotated[list[Vector3], Field(max_length=8)]],
        Terminal("--direction", "X,Y,Z", parse_numbers, "list"),
    ] = Field(
        default_factory=list,
        description="Directions in R0 along which a dial gauge or 1-D laser can measure, one per "
        "reading; empty if three coordinates are read.",
    )
    load_point: Metres[Vector3 | None] = Field(
        default=None,
        description="Load point in the flange frame; default: the load point of the campaign, or the origin.",
    )
    sigma: Metres[Annotated[float, Field(strict=True, ge=1e-9, le=1.0)] | None] = Field(
        default=None,
        description="Standard uncertainty of one coordinate of one reading; default: the campaign's "
        "value, or 20 µm.",
    )
    repeatability: Radians[Annotated[float, Field(strict=True, ge=0.0, le=0.01)] | None] = Field(
        default=None,
        description="Standard deviation of the random position of each joint from posture to posture; "
        "default: the campaign's value, or 0.",
    )
    tracker: Instrument | None = Field(
        default=None,
        description="Tracker with the position in the base frame R0, in SI units; the tracker's errors "
        "replace `sigma`.",
    )
    torque_limits: Effort[dict[Name, Annotated[float, Field(strict=True, gt=0.0)]]] = Field(
        default_factory=dict,
        description="Greatest torque of the load about a joint [N.m], or greatest force along a prismatic "
        "joint [N].",
    )
    stiffness: Annotated[
        Stiffness[dict[Name, Annotated[float, Field(strict=True, gt=0.0, le=1e15)]]],
        Terminal("--stiffness", "JOINT=STIFFNESS", parse_stiffness, "dict"),
    ] = Field(
        default_factory=dict,
        description="Expected stiffnesses, to which relative uncertainties refer. Default: the "
        "stiffnesses of the campaign, or stiffnesses with which all joints move the targets "
        "equally.",
    )
    priors: Annotated[
        dict[Name, StiffnessPrior],
        Field(max_length=MAX_JOINTS),
        Terminal("--prior", "JOINT=STIFFNESS:UNCERTAINTY", parse_prior, "dict"),
    ] = Field(
        default_factory=dict,
        description="Prior knowledge of stiffnesses, which counts like additional readings.",
    )
    joints: Annotated[list[Name], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list,
        description="Joints whose stiffness is to be determined; default: all joints that the loads twist.",
    )
    candidates: Annotated[int, Field(strict=True, ge=10, le=MAX_CANDIDATES)] = Field(
        default=5_000,
        description="Number of random postures within the joint limits, in whole degrees and millimetres.",
    )
    postures: Positions[
        Annotated[
            list[Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)]],
            Field(max_length=10_000),
        ]
    ] = Field(
        default_factory=list,
        description="Postures from which the plan is chosen, with joints as the controller shows them, "
        "instead of random postures.",
    )
    surroundings: Surroundings = Field(default_factory=Surroundings)
    distinct_angle: Radians[_Angle] = Field(
        default=0.17453292519943295,
        description="Least difference between two postures in one joint angle, or in metres for a "
        "prismatic joint; 0 allows repeated postures.",
    )
    elastic_links: StrictBool | None = Field(
        default=None,
        description="True to plan for a model with elastic links. Default: true if joints alone do not "
        "explain the campaign's readings.",
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**32 - 1)] = Field(
        default=0, description="Random seed of the postures; the same seed gives the same plan."
    )


class PlanOptions(AcceptingOptions, ReadingOptions):
    """Options of a plan."""

    readings: Annotated[int, Field(strict=True, ge=1, le=MAX_READINGS)] = Field(
        default=20, description="Number of readings in the plan, including the readings for validation."
    )
    goal: Annotated[
        PlanGoal | None,
        Terminal(
            "--goal",
            "GOAL",
            parse_goal,
            text='Goal in place of a number of readings: "15 %" of every joint, "6 um" of the deflection '
            'in the work area (95 %), or "load point 10 mm": such a mistake shows.',
        ),
    ] = Field(
        default=None,
        description="Goal of the plan, instead of `readings`. The plan has the fewest readings that meet "
        "the goal (95 %). A goal for joints is relative to `stiffness`.",
    )
    weight_step: Annotated[PlannedStep | None, Terminal("--weight-step", "KG[±KG]", parse_planned_step)] = (
        Field(
            default=None,
            description="Weight for readings of two encoders, in place of `load`. Each of the `joints` "
            "is read without and with the weight, after approaches from both sides. No "
            "reading is held out.",
        )
    )
    criterion: PlanCriterion | None = Field(
        default=None,
        description="Criterion. `work_area`: least mean variance of deflections in the work area, the "
        "default with a work area. `relative_a`: least mean variance of the relative compliances, the "
        "default without. `d`, `e`: volume or longest axis of the compliances' ellipsoid. `worst_place`: "
        "greatest variance in the work area.",
    )
    causes: Causes = Field(
        default_factory=list,
        description="Systematic errors that are fitted together with the joints to the readings so far.",
    )
    leave_out: Annotated[list[Name], Field(max_length=MAX_LEFT_OUT)] = Field(
        default_factory=list,
        description="Labels of observations of the campaign that are omitted.",
    )
    validation: Dimensionless[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.2, description="Fraction of the readings that are held out from the fit to validate it."
    )


class PlanRequest(PlanOptions):
    """Request of a plan for a robot, or of a continuation of a measurement set."""

    robot_id: Identifier | None = Field(default=None, description="Robot of a new campaign.")
    measurement_set_id: Identifier | None = Field(default=None, description="Measurement set to continue.")

    _one_of_them = require_exactly_one("robot_id", "measurement_set_id")


class PlannedReading(Message):
    """A planned reading with its posture and load."""

    label: Name = Field(
        description="Label that is sent with the reading; the held-out readings of a plan have the labels "
        "v1, v2, …."
    )
    joints: Positions[list[float]] = Field(description="Joint positions as the controller shows them.")
    force: Newtons[Point] = Field(description="Force on the robot, along the axes of the base frame R0.")
    anchor: int | None = Field(default=None, description="Index of the anchor of the cable, from 0.")
    direction: Dimensionless[Point | None] = Field(
        default=None,
        description="Direction in the base frame R0 along which to read; null if all coordinates are read.",
    )
    held_out: StrictBool = Field(
        description="True if the reading is omitted from the fit. A live campaign first compares such a "
        "reading with the prediction."
    )
    block: int = Field(
        default=1,
        description="Number of the block of readings, from 1; the measurement may end after any block.",
    )
    reason: str | None = Field(default=None, description="Reason why a live campaign chose this reading.")


class PlannedJoint(Message):
    """Standard uncertainty of one joint's compliance."""

    name: Name
    kind: StatedKind = "revolute"
    standard_uncertainty: Compliance[float] = Field(
        description="Standard uncertainty of the compliance after the readings of the plan."
    )
    relative: Dimensionless[float | None] = Field(
        description="Standard uncertainty divided by the compliance; null if the compliance is unknown."
    )
    before: Compliance[float | None] = Field(
        description="Standard uncertainty before the readings of the plan; null if the joint is not "
        "determined."
    )
    random: Compliance[float | None] = Field(
        description="Standard uncertainty after random plans with the same number of readings."
    )
    one_at_a_time: Compliance[float | None] = Field(
        description="Standard uncertainty after a plan that always adds the best next reading."
    )


class PlanResult(Result):
    """List of planned readings with predicted uncertainties."""

    assessment: Assessment | None = Field(
        description="Assessment of the plan, with the reasons from the campaign so far (for a model of "
        "joints alone)."
    )

    readings: list[PlannedReading] = Field(
        description="Readings in blocks of four, ordered for short travel. With several anchors, the "
        "order has few changes of the load."
    )
    targets: Metres[dict[Name, Point]] = Field(
        description="Places of the targets to measure, in the flange frame."
    )
    load_point: Metres[Point] = Field(description="Load point of the plan, in the flange frame.")
    joints: list[PlannedJoint]
    left_out: list[Name] = Field(
        description="Joints that the plan does not determine, because no load twists them or they were not "
        "requested."
    )
    criterion: PlanCriterion
    elastic_links: StrictBool = Field(description="True if elastic links were also unknowns of the plan.")
    efficiency: Dimensionless[float] = Field(
        description="Lower bound of the plan's information, as a fraction of the best plan of equal "
        "length from the same candidates."
    )
    efficiencies: Dimensionless[dict[str, float]] = Field(description="Efficiency by other criteria.")
    goal_share: Dimensionless[float | None] = Field(
        default=None,
        description="Expanded uncertainty divided by the uncertainty that the goal demands; null without a "
        "goal.",
    )
    weights_gap: Dimensionless[float] = Field(
        description="Certified bound of the loss of information of the optimal weights (1 − efficiency)."
    )
    random_efficiency: Dimensionless[float] = Field(
        description="Efficiency of random plans relative to this plan."
    )
    one_at_a_time_efficiency: Dimensionless[float] = Field(
        description="Efficiency relative to this plan of a plan that always adds the best next reading."
    )
    deflection_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of a deflection in the work area under this load, root mean "
        "square over all directions."
    )
    worst_deflection_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of a deflection at the worst place of the work area."
    )
    considered: int = Field(description="Number of candidate readings that were considered.")
    feasible: int = Field(description="Number of feasible readings.")
    struck_out: dict[str, int] = Field(description="Number of infeasible candidate readings for each reason.")


class Plan(Job):
    """A stored plan."""

    collection: ClassVar[str] = "plans"

    kind: Literal["plan"] = "plan"
    request: PlanRequest
    result: PlanResult | None = Field(description="Present if the job succeeded.")
