"""A geometry: where a robot's axes, base, wrist centre and targets are, from readings of a tracker."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import FailFast, Field, model_validator

from jointstiff.schemas.fields import Identifier, Message, Name, Quantity, Timestamp, Vector3
from jointstiff.schemas.geometry.result import GeometryResult
from jointstiff.schemas.job import Job, JobState
from jointstiff.schemas.measurement import AngleUnit, LengthUnit, Sigma, Uncertainty
from jointstiff.schemas.robot import MAX_JOINTS, JointMap, RobotDocument

MAX_GEOMETRY_TARGETS = 8
MAX_GEOMETRY_POSITIONS = 600
"""Of all sweeps together: each has an angle of its own, and the fit takes their number cubed."""
MAX_GEOMETRY_READINGS = 2_000

TargetPositions = Annotated[dict[Name, Vector3], Field(min_length=1, max_length=MAX_GEOMETRY_TARGETS)]
BasePositions = Annotated[dict[Name, Vector3], Field(min_length=3, max_length=16)]


class GeometryUnits(Message):
    """Units of every number of the readings."""

    length: LengthUnit = Field(description="Of positions, sigma and heights.")
    angle: AngleUnit = Field(description="Of joint angles.")


class TrackerSheet(Message):
    """What the tracker's sheet says: standard uncertainties along its line of sight and across it."""

    station: Vector3 = Field(
        default=(0.0, 0.0, 0.0),
        description="Where the tracker stands, in the frame of the positions, in units.length: its origin, "
        "as a rule.",
    )
    range: Uncertainty = Field(description="Along the line of sight.")
    transverse: Uncertainty = Field(description="Across it, in each of two directions.")


class GeometryNoise(Message):
    """What one reading is worth. Without it sigma comes from the residuals."""

    sigma: Sigma | None = Field(
        default=None, description="Standard uncertainty of one coordinate of one reading, in units.length."
    )
    instrument: TrackerSheet | None = Field(default=None, description="In place of `sigma`.")

    @model_validator(mode="after")
    def _one_kind(self) -> GeometryNoise:
        if (self.sigma is None) == (self.instrument is None):
            raise ValueError("give either `sigma` or `instrument`")
        return self


class TrackedPosition(Message):
    """One position of the robot, unloaded."""

    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Angles as the controller shows them, in units.angle."
    )
    targets: TargetPositions = Field(
        description="Positions of the targets that were read, in the tracker's frame, in units.length.",
        examples=[{"P10": [-1.7, 3.9, 1.4]}],
    )


class JointSweep(Message):
    """One joint of the controller turned alone."""

    joint: Name = Field(
        description="Its name: the robot's name of the joint that it turns, or joint_1, joint_2, … if no "
        "robot is given.",
        examples=["joint_1"],
    )
    observations: Annotated[
        list[TrackedPosition], Field(min_length=1, max_length=MAX_GEOMETRY_POSITIONS), FailFast()
    ] = Field(description="Four positions at least; 10 to 20 over 90° or more are good practice.")


class BaseRule(Message):
    """How R0 stands to axes 1 and 2, which determine all but a convention."""

    by: Literal["nominal", "axes"] = Field(
        description="`nominal`: as in the nominal model. `axes`: z along axis 1, x from axis 1 towards axis "
        "2 along their common perpendicular at model angle zero."
    )
    height: Quantity = Field(
        default=0.0,
        description="For `axes`: height of that perpendicular above R0, in units.length.",
    )


class FlangeRule(Message):
    """Where the flange frame is on the last link, which no axis shows."""

    by: Literal["nominal", "axes", "targets"] = Field(
        description="`nominal`: as in the nominal model. `axes`: z along the last axis, origin where the one "
        "before comes nearest to it: the centre of a spherical wrist. `targets`: origin at the first of "
        "three targets, x towards the second, y towards the third."
    )
    targets: tuple[Name, Name, Name] | None = Field(default=None, description="For `targets`, the three.")

    @model_validator(mode="after")
    def _three_targets(self) -> FlangeRule:
        if (self.by == "targets") != (self.targets is not None):
            raise ValueError("give `targets`, three different ones, where and only where `by` is `targets`")
        if self.targets is not None and len(set(self.targets)) != len(self.targets):
            raise ValueError("give three different targets")
        return self


class BaseTargetReadings(Message):
    """Targets fixed to the robot's base, read twice: they show whether tracker and robot moved."""

    before: BasePositions = Field(description="Before the readings, tracker's frame, in units.length.")
    after: BasePositions | None = Field(
        default=None,
        description="After them. If absent, what is read later, such as by a measurement set in this "
        "geometry's frame, is compared with `before`.",
    )


_Poses = Annotated[
    list[TrackedPosition], Field(min_length=1, max_length=MAX_GEOMETRY_READINGS, fail_fast=True)
]


class GeometryRequest(Message):
    """Sweeps or unloaded poses of one robot, read by a tracker that stands anywhere."""

    name: Name = Field(default="geometry", examples=["KR 240 cell 3, sweeps"])
    units: GeometryUnits
    robot_id: Identifier | None = Field(
        default=None, description="The robot, whose stored model counts as nominal; or give `robot`."
    )
    robot: RobotDocument | None = Field(default=None, description="The nominal model, not stored.")
    joint_map: JointMap | None = Field(
        default=None, description="If no robot is given, which has its own; the identity if absent."
    )
    noise: GeometryNoise | None = Field(
        default=None, description="If absent, sigma is estimated from the residuals."
    )
    sweeps: Annotated[list[JointSweep], Field(min_length=1, max_length=MAX_JOINTS)] | None = Field(
        default=None, description=f"One of each joint, of {MAX_GEOMETRY_POSITIONS} positions in all."
    )
    poses: _Poses | None = Field(
        default=None,
        description="In place of sweeps: unloaded poses, by which a nominal model is calibrated.",
    )
    fit: Literal["one_by_one", "together"] = Field(
        default="together",
        description="Of sweeps: each by itself, which trusts the controller least, or all in one fit, "
        "which trusts that joints at rest are where the controller says.",
    )
    angles: Literal["free", "controller"] = Field(
        default="free",
        description="Of the joint that is turned: from the readings, or the controller's. The result says "
        "whether the controller's are good enough.",
    )
    base: BaseRule | None = Field(
        default=None, description="By the nominal model if absent; by the axes if there is none."
    )
    flange: FlangeRule | None = Field(default=None, description="Likewise.")
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
            raise ValueError(f"give at most {MAX_GEOMETRY_POSITIONS} positions in all sweeps together")
        readings = sum(len(position.targets) for position in (*swept, *(self.poses or ())))
        if readings > MAX_GEOMETRY_READINGS:
            raise ValueError(f"give at most {MAX_GEOMETRY_READINGS} readings of targets in all")
        return self

    @model_validator(mode="after")
    def _one_robot(self) -> GeometryRequest:
        if self.robot_id is not None and self.robot is not None:
            raise ValueError("give either `robot_id` or `robot`, not both")
        if self.has_robot and self.joint_map is not None:
            raise ValueError("leave `joint_map` out: the robot has its own")
        if not self.has_robot and "nominal" in {rule.by for rule in (self.base, self.flange) if rule}:
            raise ValueError("give `robot_id` or `robot`, or place the frames by `axes` or `targets`")
        return self

    @property
    def has_robot(self) -> bool:
        """Whether there is a nominal model."""
        return self.robot_id is not None or self.robot is not None


class GeometrySummary(Message):
    """A geometry in a listing."""

    id: Identifier
    name: Name
    robot_id: Identifier | None = Field(description="Of the nominal model, if that is stored.")
    state: JobState
    created_at: Timestamp


class Geometry(Job):
    """A stored geometry. It never changes."""

    kind: ClassVar[str] = "geometry"
    collection: ClassVar[str] = "geometries"

    name: Name
    request: GeometryRequest
    result: GeometryResult | None = Field(description="Present if it succeeded.")
