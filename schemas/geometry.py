"""A geometry: axes, base, wrist centre and targets of a robot, from readings of a tracker. SI units."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import FailFast, Field, StrictBool, model_validator

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Metres,
    MixedSquares,
    Name,
    Point,
    Quantity,
    Radians,
    Square3,
    SquareMetres,
    StatedUnit,
    Terminal,
    Vector3,
    require_exactly_one,
)
from jointstiff.schemas.finding import Assessment, Finding, ResultSummary
from jointstiff.schemas.job import Job, Result
from jointstiff.schemas.measurement import AngleUnit, Instrument, LengthUnit, Rigid, Sigma
from jointstiff.schemas.robot import MAX_JOINTS, DhRow, JointMap, RobotDocument

Square6 = Annotated[
    list[Annotated[list[float], Field(min_length=6, max_length=6)]], Field(min_length=6, max_length=6)
]


class IdentifiedAxis(Message):
    """One joint axis in R0, with all joints at model angle zero."""

    name: Name = Field(description="Name of the model's joint.")
    point: Metres[Point] = Field(description="Point on the axis.")
    direction: Dimensionless[Point] = Field(
        description="Unit vector along the axis; positive rotation by the right-hand rule."
    )
    position_uncertainty: Metres[float | None] = Field(
        description="Largest standard uncertainty of the axis position at `point`; null if not "
        "determined. The uncertainty of the base frame R0 is not included."
    )
    direction_uncertainty: Radians[float | None] = Field(
        description="Largest standard uncertainty of the axis direction, without the uncertainty of the "
        "base frame R0; null if not determined."
    )


class SweepEvidence(Message):
    """One sweep, fitted separately."""

    joint: Name = Field(description="Name of the joint, as in the request.")
    turned: list[Name] = Field(description="Names of the joints of the model that turn in the sweep.")
    positions: int
    arc: Radians[float] = Field(description="Arc covered by the readings.")
    radial_rms: Metres[dict[Name, float | None]] = Field(
        description="Root mean square of the radial residuals of each target; null for a target without "
        "a reading. A sweep that turns two axes has residuals across the axis instead."
    )
    axial_rms: Metres[dict[Name, float | None]] = Field(
        description="Root mean square of the residuals of each target along the axis."
    )
    angle_scale: float = Field(
        description="Measured rotation of the joint divided by the rotation that the controller shows, "
        "after the joint map."
    )
    angle_deviation: Radians[float | None] = Field(
        description="Root mean square difference between measured and controller angles; null if the fit "
        "uses the controller's angles."
    )
    variance_factor: float = Field(
        description="Chi-square of the sweep per degree of freedom, about 1 if sigma is right."
    )


class PoseEvidence(Message):
    """Unknowns that the poses determine."""

    positions: int
    unknowns: int = Field(
        description="Number of unknowns of the geometry: four for each axis and three for each target."
    )
    determined: int = Field(
        description="Number of independent combinations of unknowns that the poses determine."
    )
    only_together: list[list[str]] = Field(
        description="Unknowns in each combination that the poses do not determine. The combination keeps "
        "the nominal value."
    )
    rms_residual: Metres[float] = Field(description="Root mean square of the residuals of the coordinates.")
    held_out_rms: Metres[float | None] = Field(
        description="Root mean square error of a coordinate of poses omitted from the fit; null if the "
        "other poses do not determine the geometry."
    )


class WristCentre(Message):
    """One estimate of the wrist centre, or all combined."""

    way: Literal["sphere", "axes", "trilateration", "combined"]
    weight: Dimensionless[float] = Field(
        description="Weight of the estimate in the combined centre, averaged over three coordinates; 1 "
        "for `combined`."
    )
    tracker: Metres[Point]
    tracker_covariance: SquareMetres[Square3]
    base: Metres[Point] = Field(description="Point in R0.")
    base_covariance: SquareMetres[Square3] = Field(
        description="Covariance of the centre, including the uncertainty of the base frame R0."
    )


class WristDistance(Message):
    """Distance between two estimates of the wrist centre."""

    first: Literal["sphere", "axes", "trilateration"]
    second: Literal["sphere", "axes", "trilateration"]
    distance: Metres[float]
    probability: float = Field(
        description="p-value of the hypothesis that two estimates of the wrist centre are equal."
    )


class WristTarget(Message):
    """A target by which the wrist centre is found (paper, Table I)."""

    name: Name
    offset: Metres[Point] = Field(
        description="Position of the target relative to the combined wrist centre, in the flange frame with "
        "the wrist joints at zero."
    )
    distance: Metres[float] = Field(
        description="Distance of the target from the wrist centre, by the fit of spheres."
    )
    standard_uncertainty: Metres[float] = Field(description="Standard uncertainty of the distance.")
    trilaterates: StrictBool = Field(
        description="True if the target is one of the three from which the centre is trilaterated."
    )


class WristResult(Message):
    """Wrist centre, and the test of the last three axes for intersection."""

    estimates: list[WristCentre]
    combined: WristCentre = Field(
        description="Mean of the estimates of the centre, weighted by their information matrices."
    )
    distances: list[WristDistance]
    targets: list[WristTarget] = Field(
        default_factory=list,
        description="Positions of the targets (reflectors) relative to the wrist centre; empty unless two "
        "wrist joints were swept.",
    )
    posture: Radians[list[float]] = Field(
        description="Angles of the model's joints for which the wrist centre is stated."
    )
    miss_distance: Metres[float] = Field(
        description="Largest distance of one of the last three axes from the point nearest to all three."
    )
    miss_uncertainty: Metres[float]
    miss_probability: float = Field(
        description="p-value of the hypothesis that the last three axes intersect."
    )
    decoupled_method: StrictBool = Field(
        description="True if the decoupled method can be used, because the axes miss each other by at most "
        "0.5 mm."
    )


class FlangeTarget(Message):
    """A target in the flange frame."""

    name: Name
    position: Metres[Point]
    covariance: SquareMetres[Square3 | None] = Field(
        description="Covariance of the position; null if not determined."
    )


class LinkComparison(Message):
    """A length or an angle of the robot, nominal and identified."""

    quantity: Literal["a", "alpha", "beta", "d", "theta"] = Field(
        description="Name of the Denavit-Hartenberg parameter; beta is the second angle between axes that "
        "are nominally parallel."
    )
    joint: Name = Field(
        description="Joint of the axis; for two neighbouring axes, the joint of the first axis."
    )
    unit: Literal["m", "rad"] = Field(description="Unit of the numbers.")
    nominal: StatedUnit[float]
    identified: StatedUnit[float]
    difference: StatedUnit[float] = Field(description="Identified minus nominal value.")
    standard_uncertainty: StatedUnit[float | None] = Field(
        description="Standard uncertainty of the identified value; null if not determined."
    )


class IdentifiedDh(Message):
    """The identified model as a table.

    The transform from flange to R0 is the product ``base · T1 … Tn · tool``.
    """

    convention: Literal["standard", "modified"]
    rows: list[DhRow]
    base: Rigid = Field(description="Transform from frame 0 of the table to the robot's base frame R0.")
    tool: Rigid = Field(description="Transform from the flange frame to the last frame of the table.")
    deviation: Metres[float] = Field(
        description="Largest distance between the flange by the table and the flange by the identified "
        "model, over 200 random postures."
    )


class Drift(Message):
    """Motion of tracker relative to robot between two readings of the base targets."""

    transform_after_to_before: Rigid = Field(
        description="Transform that corrects later readings for the drift."
    )
    displacement: Metres[Point] = Field(
        description="Translation of the centre of the flange targets by the drift, in the tracker's frame."
    )
    displacement_covariance: SquareMetres[Square3]
    rotation: Radians[Point] = Field(description="Rotation vector, tracker's frame.")
    probability: float = Field(description="p-value of the hypothesis that there was no drift.")
    deformation_probability: float = Field(description="p-value of the residuals.")
    significant: StrictBool
    moved_targets: list[Name] = Field(
        description="Base targets that moved relative to the other base targets."
    )


class GeometryResult(Result):
    """The identified robot."""

    assessment: Assessment = Field(description="Assessment of the geometry; notes do not change the verdict.")
    axes: list[IdentifiedAxis]
    sweeps: list[SweepEvidence] = Field(
        description="Fit of each sweep; empty if the geometry is identified from poses."
    )
    fit: Literal["one_by_one", "together"] | None = Field(
        description="Fit from which the axes were taken; null for poses. The value is `one_by_one` if "
        "the sweeps disagree (finding `sweeps_disagree`)."
    )
    poses: PoseEvidence | None = Field(description="Result of the calibration from poses; null for sweeps.")
    sigma: Metres[float] = Field(
        description="Standard uncertainty of one coordinate of a reading, the basis of all other "
        "uncertainties. For an instrument, the value is the root mean square over the "
        "readings."
    )
    sigma_source: Literal["stated", "residuals"]
    degrees_of_freedom: int
    variance_factor: float = Field(
        description="Chi-square per degree of freedom, about 1 if the stated sigma is right; exactly 1 "
        "if sigma is estimated."
    )
    agreement_probability: float | None = Field(
        description="p-value of the hypothesis that one model explains all sweeps. If the value is small, "
        "fit the sweeps one by one."
    )
    controller_probability: float | None = Field(
        description="p-value of the hypothesis that the controller's angles are exact. Set `angles` to "
        "`controller` unless the value is small."
    )
    base: Literal["nominal", "axes"] = Field(description="Definition of R0.")
    transform_tracker_to_base: Rigid
    transform_covariance: MixedSquares[Square6 | None] = Field(
        description="Covariance of a small displacement and then rotation of the frame, in the base "
        "frame R0; null if not determined."
    )
    wrist: WristResult | None = Field(
        description="Wrist centre; null if unknown, with the reason in `no_wrist`."
    )
    no_wrist: str | None = Field(description="Reason why no wrist centre was determined.")
    targets: list[FlangeTarget]
    flange: Literal["nominal", "axes", "targets"] = Field(description="Definition of the flange frame.")
    links: list[LinkComparison] = Field(
        description="Identified link parameters; empty without a nominal model."
    )
    robot: RobotDocument = Field(description="Identified model as a robot document, ready to be posted.")
    dh: list[IdentifiedDh]
    drift: Drift | None = Field(
        description="Change of the base targets' positions during the measurement; null unless base "
        "targets were read at start and end."
    )
    findings: list[Finding]

    @property
    def summary(self) -> ResultSummary:
        """Summary of the result for listings."""
        return ResultSummary(
            verdict=self.assessment.verdict,
            warning_count=sum(not finding.is_remark for finding in self.findings),
        )


MAX_GEOMETRY_TARGETS = 8
MAX_GEOMETRY_POSITIONS = 1_400
"""Maximum number of positions of all sweeps together: 1,000 circle points of the wrist in addition to other
axes."""
MAX_SWEEP_POSITIONS = 600
"""Maximum number of positions of one sweep: its fit takes the cube of their number."""
MAX_GEOMETRY_READINGS = 4_200
TargetPositions = Annotated[dict[Name, Vector3], Field(min_length=1, max_length=MAX_GEOMETRY_TARGETS)]
BasePositions = Annotated[dict[Name, Vector3], Field(min_length=3, max_length=16)]


class GeometryUnits(Message):
    """Units of every number of the readings."""

    length: LengthUnit = Field(description="Unit of positions, of sigma and of heights.")
    angle: AngleUnit = Field(description="Unit of joint angles.")


class GeometryNoise(Message):
    """Noise of one reading. If absent, sigma is estimated from the residuals."""

    sigma: Sigma | None = Field(
        default=None, description="Standard uncertainty of one coordinate of one reading, in units.length."
    )
    instrument: Instrument | None = Field(
        default=None, description="Uncertainty from the data sheet of the instrument, instead of `sigma`."
    )

    _one_kind = require_exactly_one("sigma", "instrument")


class TrackedPosition(Message):
    """One position of the robot, unloaded."""

    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Joint angles as displayed by the controller, in units.angle."
    )
    targets: TargetPositions = Field(
        description="Positions of the targets that were read, in the tracker's frame, in units.length.",
        examples=[{"P10": [-1.7, 3.9, 1.4]}],
    )


class JointSweep(Message):
    """Readings while one joint of the controller turns alone."""

    joint: Name = Field(
        description="Name of the joint that turns, as in the robot; joint_1, joint_2, … if the request has "
        "no robot.",
        examples=["joint_1"],
    )
    observations: Annotated[
        list[TrackedPosition], Field(min_length=1, max_length=MAX_SWEEP_POSITIONS), FailFast()
    ] = Field(
        description="Positions of the sweep, at least four; 10 to 20 positions over 90° or more are good "
        "practice."
    )


_Poses = Annotated[
    list[TrackedPosition], Field(min_length=1, max_length=MAX_GEOMETRY_READINGS, fail_fast=True)
]


class GeometryRequest(Message):
    """Sweeps or unloaded poses of one robot, read by a tracker."""

    name: Name = Field(default="geometry", examples=["KR 240 cell 3, sweeps"])
    units: GeometryUnits
    robot_id: Annotated[Identifier | None, Terminal(hidden=True)] = Field(
        default=None,
        description="Id of the stored robot whose model is the nominal model; omit this field if "
        "`robot` is given.",
    )
    robot: RobotDocument | None = Field(
        default=None, description="Nominal model as a document that the service does not store."
    )
    joint_map: JointMap | None = Field(
        default=None,
        description="Map from the controller's joints to the joints of the model, if no robot is given; "
        "default: identity.",
    )
    noise: GeometryNoise | None = Field(
        default=None,
        description="Noise of the readings; if absent, sigma is estimated from the residuals of the fit.",
    )
    sweeps: Annotated[list[JointSweep], Field(min_length=1, max_length=MAX_JOINTS)] | None = Field(
        default=None,
        description=f"Sweeps, one per joint, of at most {MAX_GEOMETRY_POSITIONS} positions in all.",
    )
    poses: _Poses | None = Field(
        default=None,
        description="Poses without load, instead of `sweeps`, to calibrate the nominal model of `robot_id` "
        "or `robot`.",
    )
    fit: Literal["one_by_one", "together"] = Field(
        default="together",
        description="Way to fit the sweeps. A fit one by one uses only the angle of the moving joint; a "
        "fit of all together uses the controller's angles of all joints.",
    )
    angles: Literal["free", "controller"] = Field(
        default="free",
        description="Source of the angles of the joint that turns: the readings, or the controller, whose "
        "angles are then tested.",
    )
    base: Literal["nominal", "axes"] | None = Field(
        default=None,
        description="Definition of the robot's base frame R0. `nominal`: as in the nominal model. `axes`: z "
        "along axis 1, x towards axis 2 along the common perpendicular at model angle zero. Default: "
        "`nominal`, or `axes` without a model.",
    )
    base_height: Quantity = Field(
        default=0.0,
        description="Height above the origin of R0 of the common perpendicular of axes 1 and 2, in "
        "units.length, if `base` is `axes`.",
    )
    flange: Literal["nominal", "axes", "targets"] | None = Field(
        default=None,
        description="Definition of the flange frame, which no axis determines. `nominal`: as in the model. "
        "`axes`: z along the last axis, origin at the point nearest to the axis before (the centre of a "
        "spherical wrist). `targets`: by `flange_targets`. Default: `nominal`, or `axes` without a model.",
    )
    flange_targets: tuple[Name, Name, Name] | None = Field(
        default=None,
        description="Names of three targets that define the flange frame if `flange` is `targets`. The "
        "origin is the first target; x points to the second and y towards the third.",
    )
    base_targets_before: BasePositions | None = Field(
        default=None,
        description="Targets on the robot's base, read before the other readings; in the tracker's frame, "
        "in units.length. They show whether tracker or robot moved.",
    )
    base_targets_after: BasePositions | None = Field(
        default=None,
        description="Same base targets, read after the other readings. If absent, later readings in this "
        "frame are compared with `base_targets_before`.",
    )

    @model_validator(mode="after")
    def _require_base_targets_before(self) -> GeometryRequest:
        if self.base_targets_after is not None and self.base_targets_before is None:
            raise ValueError(
                "give also `base_targets_before`, because `base_targets_after` are compared with "
                "`base_targets_before`"
            )
        return self

    @model_validator(mode="after")
    def _require_sweeps_or_poses(self) -> GeometryRequest:
        if (self.sweeps is None) == (self.poses is None):
            raise ValueError("give either `sweeps` or `poses`")
        return self

    @model_validator(mode="after")
    def _refuse_too_many_readings(self) -> GeometryRequest:
        """Refuse too many positions in all sweeps together, and too many readings of targets in all."""
        swept_positions = [position for sweep in self.sweeps or () for position in sweep.observations]
        if len(swept_positions) > MAX_GEOMETRY_POSITIONS:
            raise ValueError(
                f"give at most {MAX_GEOMETRY_POSITIONS} positions in all sweeps together, not "
                f"{len(swept_positions)}: omit every second position; 15 to 20 positions over each "
                "joint's arc are enough"
            )
        readings = sum(len(position.targets) for position in (*swept_positions, *(self.poses or ())))
        if readings > MAX_GEOMETRY_READINGS:
            raise ValueError(
                f"give at most {MAX_GEOMETRY_READINGS} readings of targets in all, not {readings}: omit "
                "every second position, or give only three targets"
            )
        return self

    @model_validator(mode="after")
    def _refuse_contradictory_robot(self) -> GeometryRequest:
        """Refuse two robots, two joint maps, and nominal frames without a robot."""
        if self.robot_id is not None and self.robot is not None:
            raise ValueError("give either `robot_id` or `robot`, not both")
        if self.has_robot and self.joint_map is not None:
            raise ValueError("omit `joint_map`: the robot has a joint map already")
        if not self.has_robot and "nominal" in (self.base, self.flange):
            raise ValueError(
                "the frames `nominal` need a robot model: give `robot_id` or `robot`, or choose other "
                "values of `base` and `flange`"
            )
        return self

    @model_validator(mode="after")
    def _require_different_flange_targets(self) -> GeometryRequest:
        """Require three different flange targets if targets place the flange frame, and none otherwise."""
        if (self.flange == "targets") != (self.flange_targets is not None):
            raise ValueError("give `flange_targets` if, and only if, `flange` is `targets`")
        if self.flange_targets is not None and len(set(self.flange_targets)) != len(self.flange_targets):
            raise ValueError("give three different `flange_targets`")
        return self

    @property
    def has_robot(self) -> bool:
        """True if the request names or contains a robot, whose geometry is the nominal geometry."""
        return self.robot_id is not None or self.robot is not None


class Geometry(Job):
    """A stored geometry."""

    collection: ClassVar[str] = "geometries"

    kind: Literal["geometry"] = "geometry"
    name: Name
    request: GeometryRequest
    result: GeometryResult | None = Field(description="Present if the job succeeded.")
