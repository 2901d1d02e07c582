"""A geometry: where a robot's axes, base, wrist centre and targets are, from readings of a tracker."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import FailFast, Field, model_validator

from jointstiff.schemas.assessment import ResultSummary
from jointstiff.schemas.fields import Identifier, Message, Name, Quantity, Timestamp, Vector3
from jointstiff.schemas.geometry.result import GeometryResult
from jointstiff.schemas.job import Job, JobState
from jointstiff.schemas.measurement.measurement_set import AngleUnit, LengthUnit
from jointstiff.schemas.measurement.noise import Sigma, Uncertainty
from jointstiff.schemas.robot import MAX_JOINTS, JointMap, RobotDocument
from jointstiff.schemas.terminal import Terminal

MAX_GEOMETRY_TARGETS = 8
MAX_GEOMETRY_POSITIONS = 1_200
"""Maximum number of positions of all sweeps together."""
MAX_SWEEP_POSITIONS = 600
"""Maximum number of positions of one sweep: its fit takes the cube of their number."""
MAX_GEOMETRY_READINGS = 4_000

TargetPositions = Annotated[dict[Name, Vector3], Field(min_length=1, max_length=MAX_GEOMETRY_TARGETS)]
BasePositions = Annotated[dict[Name, Vector3], Field(min_length=3, max_length=16)]


class GeometryUnits(Message):
    """Units of every number of the readings."""

    length: LengthUnit = Field(description="Unit of positions, sigma and heights.")
    angle: AngleUnit = Field(description="Unit of joint angles.")


class TrackerSheet(Message):
    """Uncertainty from the tracker's data sheet: along its line of sight and across it."""

    station: Vector3 = Field(
        default=(0.0, 0.0, 0.0),
        description="Position of the tracker in the frame of the positions, in units.length: usually its "
        "origin.",
    )
    range: Uncertainty = Field(description="Uncertainty along the line of sight.")
    transverse: Uncertainty = Field(
        description="Uncertainty across the line of sight, in each of two directions."
    )


class GeometryNoise(Message):
    """Noise of one reading. Without it sigma is estimated from the residuals."""

    sigma: Sigma | None = Field(
        default=None, description="Standard uncertainty of one coordinate of one reading, in units.length."
    )
    instrument: TrackerSheet | None = Field(
        default=None, description="Uncertainty of the instrument, instead of `sigma`."
    )

    @model_validator(mode="after")
    def _one_kind(self) -> GeometryNoise:
        if (self.sigma is None) == (self.instrument is None):
            raise ValueError("give either `sigma` or `instrument`")
        return self


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
    """One joint of the controller turned alone."""

    joint: Name = Field(
        description="Name of the joint that turns: the robot's name of it, or joint_1, joint_2, … "
        "if no robot "
        "is given.",
        examples=["joint_1"],
    )
    observations: Annotated[
        list[TrackedPosition], Field(min_length=1, max_length=MAX_SWEEP_POSITIONS), FailFast()
    ] = Field(description="Positions; at least four, 10 to 20 over 90° or more are good practice.")


class BaseRule(Message):
    """Definition of R0 relative to axes 1 and 2, which determine it up to a convention."""

    by: Literal["nominal", "axes"] = Field(
        description="`nominal`: as in the nominal model. `axes`: z along axis 1, x from axis 1 towards axis "
        "2 along their common perpendicular at model angle zero."
    )
    height: Quantity = Field(
        default=0.0,
        description="Height, for `axes`, of that perpendicular above R0, in units.length.",
    )


class FlangeRule(Message):
    """Definition of the flange frame on the last link, which no axis determines."""

    by: Literal["nominal", "axes", "targets"] = Field(
        description="`nominal`: as in the nominal model. `axes`: z along the last axis, origin at its point "
        "nearest to the previous axis: the centre of a spherical wrist. `targets`: origin at the first of "
        "three targets, x towards the second, y towards the third."
    )
    targets: tuple[Name, Name, Name] | None = Field(
        default=None, description="The three targets, for `by` = `targets`."
    )

    @model_validator(mode="after")
    def _three_targets(self) -> FlangeRule:
        if (self.by == "targets") != (self.targets is not None):
            raise ValueError("give `targets` (three different ones) if, and only if, `by` is `targets`")
        if self.targets is not None and len(set(self.targets)) != len(self.targets):
            raise ValueError("give three different targets")
        return self


class BaseTargetReadings(Message):
    """Targets fixed to the robot's base, read twice: they show whether tracker and robot moved."""

    before: BasePositions = Field(
        description="Positions before the readings, tracker's frame, in units.length."
    )
    after: BasePositions | None = Field(
        default=None,
        description="Positions after the readings. If absent, later readings, such as those of a measurement "
        "set in this geometry's frame, are compared with `before`.",
    )


_Poses = Annotated[
    list[TrackedPosition], Field(min_length=1, max_length=MAX_GEOMETRY_READINGS, fail_fast=True)
]


class GeometryRequest(Message):
    """Sweeps or unloaded poses of one robot, read by a tracker that stands anywhere."""

    name: Name = Field(default="geometry", examples=["KR 240 cell 3, sweeps"])
    units: GeometryUnits
    robot_id: Annotated[Identifier | None, Terminal()] = Field(
        default=None, description="Robot whose stored model is the nominal one; or give `robot`."
    )
    robot: RobotDocument | None = Field(default=None, description="Nominal model; it is not stored.")
    joint_map: JointMap | None = Field(
        default=None, description="Joint map, if no robot is given; default: identity."
    )
    noise: GeometryNoise | None = Field(
        default=None, description="Noise of the readings; if absent, sigma is estimated from the residuals."
    )
    sweeps: Annotated[list[JointSweep], Field(min_length=1, max_length=MAX_JOINTS)] | None = Field(
        default=None,
        description=f"Sweeps, one per joint, of at most {MAX_GEOMETRY_POSITIONS} positions in all.",
    )
    poses: _Poses | None = Field(
        default=None,
        description="Unloaded poses to calibrate a nominal model, instead of `sweeps`.",
    )
    fit: Literal["one_by_one", "together"] = Field(
        default="together",
        description="Fit of the sweeps: one by one, which trusts the controller least, or all "
        "together, which assumes that resting joints are at the controller's angles.",
    )
    angles: Literal["free", "controller"] = Field(
        default="free",
        description="Angles of the joint that turns: from the readings, or from the controller. The result "
        "tests if the controller's are accurate enough.",
    )
    base: BaseRule | None = Field(
        default=None,
        description="Definition of the frame; default: the nominal model, or the axes without one.",
    )
    flange: FlangeRule | None = Field(
        default=None,
        description="Definition of the flange; default: the nominal model, or the axes without one.",
    )
    base_targets: BaseTargetReadings | None = None

    @model_validator(mode="after")
    def _one_source(self) -> GeometryRequest:
        if (self.sweeps is None) == (self.poses is None):
            raise ValueError("give either `sweeps` or `poses`")
        if self.poses is not None and not self.has_robot:
            raise ValueError("give `robot_id` or `robot` with `poses`, which calibrate a nominal model")
        return self

    @model_validator(mode="after")
    def _few_enough(self) -> GeometryRequest:
        swept = [position for sweep in self.sweeps or () for position in sweep.observations]
        if len(swept) > MAX_GEOMETRY_POSITIONS:
            raise ValueError(
                f"give at most {MAX_GEOMETRY_POSITIONS} positions in all sweeps together, not {len(swept)}: "
                "leave out every other one, 15 to 20 spread over each joint's arc are enough"
            )
        readings = sum(len(position.targets) for position in (*swept, *(self.poses or ())))
        if readings > MAX_GEOMETRY_READINGS:
            raise ValueError(
                f"give at most {MAX_GEOMETRY_READINGS} readings of targets in all, not {readings}: leave out "
                "every other position, or targets beyond three"
            )
        return self

    @model_validator(mode="after")
    def _one_robot(self) -> GeometryRequest:
        if self.robot_id is not None and self.robot is not None:
            raise ValueError("give either `robot_id` or `robot`, not both")
        if self.has_robot and self.joint_map is not None:
            raise ValueError("omit `joint_map`: the robot has its own")
        if not self.has_robot and "nominal" in {rule.by for rule in (self.base, self.flange) if rule}:
            raise ValueError("give `robot_id` or `robot`, or place the frames by `axes` or `targets`")
        return self

    @property
    def has_robot(self) -> bool:
        """Return True if there is a nominal model."""
        return self.robot_id is not None or self.robot is not None


class GeometrySummary(ResultSummary):
    """A geometry in a listing."""

    id: Identifier
    name: Name
    robot_id: Identifier | None = Field(description="Robot of the nominal model, if it is stored.")
    state: JobState
    created_at: Timestamp


class Geometry(Job):
    """A stored geometry. It never changes."""

    kind: ClassVar[str] = "geometry"
    collection: ClassVar[str] = "geometries"

    name: Name
    request: GeometryRequest
    result: GeometryResult | None = Field(description="Result; present if the job has succeeded.")
