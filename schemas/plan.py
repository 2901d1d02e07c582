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
        description="Greatest half-width of a 95 % interval, relative to the compliance: 0.15 for ± 15 %."
    )


class DeflectionGoal(Message):
    """Goal for the uncertainty of the deflection in a box."""

    kind: Literal["deflection"]
    uncertainty: Metres[_Length] = Field(
        description="Greatest expanded uncertainty (95 %) of a coordinate, root mean square over places of "
        "the work area and forces along the axes of R0."
    )
    force: Newtons[Vector3 | None] = Field(
        default=None,
        description="Force in the work area, axes of R0; default: that of the load, down for a weight, "
        "else along each axis.",
    )


class DecisionGoal(Message):
    """Goal to decide whether the deflection in a box stays below a limit."""

    kind: Literal["decision"]
    limit: Metres[_Length] = Field(
        description="Greatest deflection in the work area, by a force along an axis of R0. Decided once the "
        "95 % interval of the greatest deflection does not contain this value."
    )
    force: Newtons[Vector3 | None] = Field(
        default=None,
        description="Force in the work area, axes of R0; default: that of the load, down for a weight, "
        "else along each axis.",
    )


class LoadPointGoal(Message):
    """Goal that a test of the readings detects a wrong load point."""

    kind: Literal["load_point"]
    mistake: Metres[_Length] = Field(
        description="Error of the load point that a test detects in 80 % of cases."
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
    "Box", Annotated[tuple[Vector3, Vector3], Field(description="Least and greatest corner, in R0.")]
)


class DeadWeight(Message):
    """A weight, which pulls along −z of R0."""

    kind: Literal["dead_weight"] = "dead_weight"
    force: Newtons[Force | None] = Field(default=None, description="Weight; or give `mass`.")
    mass: Kilograms[Force | None] = Field(
        default=None, description="Hung mass, instead of `force`; 1 kg weighs 9.80665 N."
    )

    _stated_once = require_exactly_one("force", "mass")

    @property
    def newtons(self) -> float:
        """Weight of the load [N], from its stated force or its stated mass."""
        return self.force if self.force is not None else 9.80665 * (self.mass or 0.0)


class AnyDirection(Message):
    """A force of limited size in any direction."""

    kind: Literal["any_direction"]
    force: Newtons[Force] = Field(
        description="Magnitude of the force; reduced where a torque would exceed its limit."
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
    """A weight step of two encoders: a mass at the load point, which pulls along −z of R0."""

    mass: Kilograms[Force] = Field(description="Mass of the load.")
    mass_uncertainty: Kilograms[Annotated[float, Field(strict=True, ge=0.0, le=1e6)] | None] = Field(
        default=None, description="Standard uncertainty of the mass; absent: 1 % is assumed."
    )
    point_uncertainty: Metres[Annotated[float, Field(strict=True, ge=0.0, le=1.0)]] = Field(
        default=0.01, description="Standard uncertainty of each coordinate of the load point."
    )
    noise: Radians[Annotated[float, Field(strict=True, ge=1e-9, le=0.1)]] = Field(
        default=1e-5, description="Standard deviation of the step of a twist in one posture."
    )


class Surroundings(Message):
    """Obstacles that links avoid; each link is a capsule from joint to joint."""

    floor: Metres[Quantity | None] = Field(
        default=None, description="Least height of links and targets, in R0."
    )
    inside: Metres[Box | None] = Field(default=None, description="Box that contains all links and targets.")
    obstacles: Metres[Annotated[list[Box], Field(max_length=MAX_BOXES)]] = Field(
        default_factory=list, description="Boxes that links and targets avoid."
    )
    link_radius: Metres[Annotated[float, Field(strict=True, ge=0.0, le=10.0)] | None] = Field(
        default=None, description="Radius of the capsules; default: 4 % of the stretched arm's length."
    )
    facing: Dimensionless[dict[Name, Vector3]] = Field(
        default_factory=dict, description="Direction in which each reflector looks, flange frame."
    )
    acceptance: Radians[_Angle] = Field(
        default=3.2, description="Greatest angle between `facing` and the line of sight."
    )


PlanCriterion = Literal["relative_a", "work_area", "d", "e", "worst_place"]


_AREA = "Work area: two corners of a box, in R0, in mm, in which deflections will be predicted."


class ReadingOptions(Message):
    """Equipment, surroundings and candidates, from which readings are chosen."""

    work_area: Annotated[Metres[Box | None], Terminal("--area", "X,Y,Z,X,Y,Z[mm]", parse_box, text=_AREA)] = (
        Field(default=None, description="Work area: box, in R0, in which deflections will be predicted.")
    )
    load: Annotated[PlannedLoad | None, Terminal("", "KIND:NEWTONS", parse_planned_load)] = Field(
        default=None,
        description="Load to apply; default: the campaign's strongest force, or the own weight.",
    )
    targets: Annotated[
        Metres[Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)]],
        Terminal("--target", "NAME=X,Y,Z[mm]", parse_target, "dict"),
    ] = Field(
        default_factory=dict, description="Targets in the flange frame; default: the targets of the campaign."
    )
    directions: Annotated[
        Dimensionless[Annotated[list[Vector3], Field(max_length=8)]],
        Terminal("--direction", "X,Y,Z", parse_numbers, "list"),
    ] = Field(
        default_factory=list,
        description="Directions in R0 that a dial gauge or 1-D laser can measure, one per reading; empty: "
        "all three coordinates are read.",
    )
    load_point: Metres[Vector3 | None] = Field(
        default=None,
        description="Load point in the flange frame; default: that of the campaign, or the origin.",
    )
    sigma: Metres[Annotated[float, Field(strict=True, ge=1e-9, le=1.0)] | None] = Field(
        default=None,
        description="Standard uncertainty of one coordinate of one reading; default: the campaign's, or 20 "
        "µm.",
    )
    repeatability: Radians[Annotated[float, Field(strict=True, ge=0.0, le=0.01)] | None] = Field(
        default=None,
        description="Standard deviation of each joint from posture to posture; default: the campaign's, or "
        "0.",
    )
    tracker: Instrument | None = Field(
        default=None, description="Tracker in R0, in SI units; its errors replace `sigma`."
    )
    torque_limits: Effort[dict[Name, Annotated[float, Field(strict=True, gt=0.0)]]] = Field(
        default_factory=dict,
        description="Greatest torque of the load about a joint [N.m], or force along a prismatic one [N].",
    )
    stiffness: Annotated[
        Stiffness[dict[Name, Annotated[float, Field(strict=True, gt=0.0, le=1e15)]]],
        Terminal("--stiffness", "JOINT=STIFFNESS", parse_stiffness, "dict"),
    ] = Field(
        default_factory=dict,
        description="Expected stiffnesses, to which relative uncertainties refer; default: the campaign's, "
        "or such that all joints move the targets equally.",
    )
    priors: Annotated[
        dict[Name, StiffnessPrior],
        Field(max_length=MAX_JOINTS),
        Terminal("--prior", "JOINT=STIFFNESS:UNCERTAINTY", parse_prior, "dict"),
    ] = Field(default_factory=dict, description="Prior knowledge of stiffnesses, which counts like readings.")
    joints: Annotated[list[Name], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list, description="Joints to determine; default: all joints that the loads twist."
    )
    candidates: Annotated[int, Field(strict=True, ge=10, le=MAX_CANDIDATES)] = Field(
        default=5_000,
        description="Number of postures drawn within the joints' limits, in whole degrees and millimetres.",
    )
    postures: Positions[
        Annotated[
            list[Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)]],
            Field(max_length=10_000),
        ]
    ] = Field(
        default_factory=list,
        description="Postures to choose from, with joints as the controller shows, instead of random "
        "postures.",
    )
    surroundings: Surroundings = Field(default_factory=Surroundings)
    distinct_angle: Radians[_Angle] = Field(
        default=0.17453292519943295,
        description="Least difference of two postures in one joint's angle (or position, in metres); 0 "
        "allows repeated postures.",
    )
    elastic_links: StrictBool | None = Field(
        default=None,
        description="True to allow for elastic links; default: true if the campaign shows lack of fit.",
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**32 - 1)] = Field(
        default=0, description="Random seed of the postures; the same seed gives the same plan."
    )


class PlanOptions(AcceptingOptions, ReadingOptions):
    """Options of a plan."""

    readings: Annotated[int, Field(strict=True, ge=1, le=MAX_READINGS)] = Field(
        default=20, description="Number of readings, including those for validation."
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
        description="Goal, instead of `readings`: the plan has the fewest readings that meet the goal (95 "
        "%). A goal for joints is relative to `stiffness`.",
    )
    weight_step: Annotated[PlannedStep | None, Terminal("--weight-step", "KG[±KG]", parse_planned_step)] = (
        Field(
            default=None,
            description="Load of a weight step of two encoders, in place of `load`: plan postures that are "
            "read from both sides, without and with it; `joints` have two encoders. No reading is held out.",
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
        description="Causes to fit with the joints to the readings so far.",
    )
    leave_out: Annotated[list[Name], Field(max_length=MAX_LEFT_OUT)] = Field(
        default_factory=list,
        description="Labels of observations of the campaign to omit.",
    )
    validation: Dimensionless[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.2, description="Fraction of the readings that are held out from the fit."
    )


class PlanRequest(PlanOptions):
    """Request of a plan: for a robot, or to continue a measurement set."""

    robot_id: Identifier | None = Field(default=None, description="Robot of a new campaign.")
    measurement_set_id: Identifier | None = Field(default=None, description="Measurement set to continue.")

    _one_of_them = require_exactly_one("robot_id", "measurement_set_id")


class PlannedReading(Message):
    """A planned reading: posture and load."""

    label: Name = Field(
        description="Label to send with the reading; v1, v2, … for held-out readings of a plan."
    )
    joints: Positions[list[float]] = Field(description="Joints as the controller shows them.")
    force: Newtons[Point] = Field(description="Force on the robot, axes of R0.")
    anchor: int | None = Field(default=None, description="Index of the cable's anchor, from 0.")
    direction: Dimensionless[Point | None] = Field(
        default=None, description="Direction in R0 along which to read; null if all coordinates are read."
    )
    held_out: StrictBool = Field(
        description="True if the reading is held out from the fit; a live campaign first compares the "
        "reading with its prediction."
    )
    block: int = Field(
        default=1,
        description="Number of the block, from 1; you may stop after any block.",
    )
    reason: str | None = Field(default=None, description="Reason why a live campaign chose this reading.")


class PlannedJoint(Message):
    """Standard uncertainty of one joint's compliance."""

    name: Name
    kind: StatedKind = "revolute"
    standard_uncertainty: Compliance[float] = Field(
        description="Standard uncertainty of the compliance after the plan."
    )
    relative: Dimensionless[float | None] = Field(
        description="Standard uncertainty relative to the compliance; null if the compliance is unknown."
    )
    before: Compliance[float | None] = Field(
        description="Standard uncertainty before the plan; null if the joint is not determined."
    )
    random: Compliance[float | None] = Field(
        description="Standard uncertainty after random plans of equal length."
    )
    one_at_a_time: Compliance[float | None] = Field(
        description="Standard uncertainty if each reading is chosen as the best next reading."
    )


class PlanResult(Result):
    """List of readings with its predicted uncertainties."""

    assessment: Assessment | None = Field(
        description="Assessment of the plan, with the reasons of the campaign so far (joints alone)."
    )

    readings: list[PlannedReading] = Field(
        description="Readings in blocks of four, ordered for short travel; with several anchors for few "
        "load changes."
    )
    targets: Metres[dict[Name, Point]] = Field(description="Targets to measure, in the flange frame.")
    load_point: Metres[Point] = Field(description="Load point of the plan, in the flange frame.")
    joints: list[PlannedJoint]
    left_out: list[Name] = Field(
        description="Joints that the plan does not determine: neither twisted by a load nor requested."
    )
    criterion: PlanCriterion
    elastic_links: StrictBool = Field(description="True if elastic links were unknowns, too.")
    efficiency: Dimensionless[float] = Field(
        description="Certified: the list has at least this fraction of the information of the best list of "
        "its length from these candidates."
    )
    efficiencies: Dimensionless[dict[str, float]] = Field(description="Efficiency by other criteria.")
    goal_share: Dimensionless[float | None] = Field(
        default=None,
        description="Expanded uncertainty divided by the goal's; null without a goal.",
    )
    weights_gap: Dimensionless[float] = Field(description="1 − certified efficiency of the optimal weights.")
    random_efficiency: Dimensionless[float] = Field(
        description="Efficiency of random plans, relative to this plan."
    )
    one_at_a_time_efficiency: Dimensionless[float] = Field(
        description="Efficiency of a plan that always takes the best next reading, relative to this plan."
    )
    deflection_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of a deflection in the work area under this load, over all "
        "directions: root mean square."
    )
    worst_deflection_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of a deflection at the worst place."
    )
    considered: int = Field(description="Number of readings that were considered.")
    feasible: int = Field(description="Number of feasible readings.")
    struck_out: dict[str, int] = Field(description="Number of infeasible readings, by reason.")


class Plan(Job):
    """A stored plan. It never changes."""

    collection: ClassVar[str] = "plans"

    kind: Literal["plan"] = "plan"
    request: PlanRequest
    result: PlanResult | None = Field(description="Present if the job succeeded.")
