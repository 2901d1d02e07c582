"""Robots: kinematics, limits, joint map and bodies; the catalogue of arms; positions of the joints."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool, model_validator

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    JointSpeeds,
    Kilograms,
    Message,
    Metres,
    Moment,
    Name,
    Payload,
    Point,
    Positions,
    Quantity,
    Radians,
    ResourceChange,
    Square3,
    Timestamp,
    Vector3,
    require_exactly_one,
)
from jointstiff.schemas.finding import Verdict
from jointstiff.schemas.joints import JointKind, StatedKind

MAX_JOINTS = 32
MAX_MARKS = 100
MAX_URDF_CHARACTERS = 2 * 1024 * 1024


class DhRow(Message):
    """One row of a Denavit-Hartenberg table."""

    a: Metres[Quantity] = Field(description="Link length a.")
    alpha: Radians[Quantity] = Field(description="Link twist alpha.")
    d: Metres[Quantity] = Field(
        description="Link offset d of the DH table; for a prismatic joint, the constant added to the "
        "joint's length."
    )
    theta: Radians[Quantity] = Field(description="Constant angle that is added to the angle of the joint.")
    lower: Positions[Quantity | None] = Field(default=None, description="Lower joint limit, if known.")
    upper: Positions[Quantity | None] = Field(default=None, description="Upper joint limit, if known.")
    speed: JointSpeeds[Quantity | None] = Field(default=None, description="Greatest speed, if known.")
    kind: StatedKind = "revolute"


class DhModel(Message):
    """Kinematics as a Denavit-Hartenberg table; joints are named joint_1, joint_2, ..."""

    format: Literal["dh"]
    convention: Literal["standard", "modified"] = Field(
        description="`standard`: rotate by theta, move d, move a, rotate alpha. "
        "`modified` (Craig): rotate alpha, move a, rotate theta, move d."
    )
    length_unit: Literal["m", "mm"] = "m"
    angle_unit: Literal["rad", "deg"] = "rad"
    rows: Annotated[list[DhRow], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Rows from base to flange, one per joint; stored in m and rad. The angle of a revolute "
        "joint is added to theta, the length of a prismatic joint to d. The last frame is the flange frame."
    )


class UrdfModel(Message):
    """Kinematics as a URDF document; only the chain from base to flange is used, meshes never."""

    format: Literal["urdf"]
    urdf: str = Field(
        min_length=1,
        max_length=MAX_URDF_CHARACTERS,
        description="URDF document with xacro already expanded, at most 2 MiB.",
        examples=['<robot name="arm">…</robot>'],
    )
    base: Name = Field(description="Link whose frame is the robot's base frame R0.")
    flange: Name = Field(description="Link whose frame is the flange frame.")


class GeometryModel(Message):
    """Kinematics of a stored geometry, with the joint map of its readings."""

    format: Literal["geometry"]
    geometry_id: Identifier


class CatalogueModel(Message):
    """Nominal kinematics of an arm of the catalogue, with the joint map of its controller."""

    format: Literal["catalogue"]
    arm: Name = Field(
        description="Name of the arm, or a part of the name that identifies the arm.",
        examples=["KUKA KR 210 R2700 extra"],
    )


Model = Annotated[UrdfModel | DhModel, Field(discriminator="format")]
PostedModel = Annotated[UrdfModel | DhModel | GeometryModel | CatalogueModel, Field(discriminator="format")]


class JointMap(Message):
    """Map from controller joints to model joints: multiply by `matrix`, then add `offset`."""

    matrix: Annotated[
        list[Annotated[list[Quantity], Field(max_length=MAX_JOINTS)]], Field(max_length=MAX_JOINTS)
    ] = Field(
        description="Invertible square matrix from the controller's joints to the model's joints, in SI "
        "units; dimensionless among revolute joints."
    )
    offset: Positions[Annotated[list[Quantity], Field(max_length=MAX_JOINTS)]] = Field(
        description="Offset, n numbers."
    )


class Body(Message):
    """A body that a joint carries (link, motor, tool), for stiffness without a load."""

    name: Name = Field(description="Name of the body.", examples=["upper arm"])
    joint: Name = Field(description="Name of the joint that carries the body.", examples=["joint_2"])
    mass: Kilograms[Annotated[float, Field(strict=True, gt=0.0, le=1e6)]] = Field(description="Mass.")
    mass_uncertainty: Dimensionless[Annotated[float, Field(strict=True, ge=0.0, lt=1.0)]] = Field(
        default=0.2,
        description="Relative half-width of the range of the mass: 0.1 is ± 10 %.",
    )
    centre: Metres[Vector3] = Field(
        description="Centre of mass in a frame that moves with the joint. A URDF uses the frame of the "
        "child link. In a DH table, z is the joint's axis, and the origin is where theta of "
        "the row applies."
    )
    centre_uncertainty: Metres[Annotated[float, Field(strict=True, ge=0.0, le=10.0)]] = Field(
        default=0.0, description="Radius of the ball that contains the centre of mass."
    )


class RobotDocument(Message):
    """A robot: a description, a stored geometry, or an arm of the catalogue."""

    name: Name = Field(examples=["KR 240 cell 3"])
    model: PostedModel
    joint_map: JointMap | None = Field(
        default=None,
        description="Joint map from the controller's joints to the model's joints; default: identity, or "
        "the map in the catalogue. A geometry contains its own map.",
    )
    bodies: Annotated[list[Body], Field(min_length=1, max_length=2 * MAX_JOINTS)] | None = Field(
        default=None,
        description="Bodies of the arm with their masses, for `weight`; default: the inertials of the URDF, "
        "each within ± 20 %.",
    )
    payload: Payload | None = Field(
        default=None,
        description="Payload that the maker states, used to check the unit of forces; default: the payload "
        "in the catalogue.",
    )

    @model_validator(mode="after")
    def _refuse_second_joint_map(self) -> RobotDocument:
        if isinstance(self.model, GeometryModel) and self.joint_map is not None:
            raise ValueError("omit `joint_map`: the geometry has a joint map already")
        return self


class Joint(Message):
    """One moving joint, in the order of the model."""

    name: Name
    kind: StatedKind = "revolute"
    lower: Positions[float | None] = Field(
        description="Lower limit of the joint of the model; null if unlimited."
    )
    upper: Positions[float | None] = Field(
        description="Upper limit of the joint of the model; null if unlimited."
    )
    speed: JointSpeeds[float | None] = Field(default=None, description="Greatest speed; null if unknown.")


class Estimate(Message):
    """A dimensionless number with its standard uncertainty."""

    value: Dimensionless[float]
    standard_uncertainty: Dimensionless[float | None] = Field(
        description="Standard uncertainty; null if unknown."
    )


class ChangedJoint(Message):
    """A joint whose stiffness differs from the stiffness in the first campaign."""

    joint: Name
    serial_number: str | None = Field(
        description="Serial number of the arm; null if no measurement set states a number."
    )
    change: Estimate = Field(
        description="Relative change of stiffness: -0.1 for a joint that became 10 % softer."
    )


class LastCampaign(Message):
    """The latest campaign of a robot, with any verdict and options, and changes that its trends show."""

    run_id: Identifier
    at: Timestamp = Field(
        description="Time of the measurement; time of storing if no time of measurement is stated."
    )
    serial_number: str | None = Field(
        description="Serial number of the robot that the measurement set of the campaign states."
    )
    verdict: Verdict = Field(description="Newest verdict.")
    changed: list[ChangedJoint] = Field(
        description="Joints whose stiffness changed, over all options and serial numbers. A joint is "
        "listed once for each serial number."
    )


class MeasuredArm(Message):
    """One arm of a robot, identified by the serial number in the measurement sets."""

    serial_number: str | None
    at: Timestamp = Field(description="Time of the latest campaign.")
    tested: list[Name] = Field(description="Joints that a trend compares.")
    rank: Dimensionless[float] = Field(
        description="Key for sorting by the surest change of a joint, in standard uncertainties. A "
        "softer joint adds 1e6; no change gives 0."
    )


class Mark(Message):
    """An event in a robot's history, such as a crash or a repair."""

    at: Moment
    note: Name
    serial_number: Name | None = Field(default=None, description="Arm; null: all.")


class RobotEntry(Message):
    """Fields of a robot that a listing and the stored robot share."""

    id: Identifier
    name: Name
    joints: list[Joint]
    nominal_arm: Name | None = Field(
        default=None,
        description="Arm of the catalogue from which the model was made.",
    )
    content_hash: str = Field(description="SHA-256 of the kinematics, the joint limits and the joint map.")
    created_at: Timestamp
    last_campaign: LastCampaign | None = Field(
        default=None,
        description="Latest campaign, with any verdict and any options; null before the first run.",
    )


class RobotSummary(RobotEntry):
    """A robot in a listing."""

    arms: list[MeasuredArm] = Field(
        default_factory=list, description="Arms that have a run; the worst arm is first."
    )


class StoredRobot(RobotDocument, RobotEntry):
    """The document of a stored robot."""

    model: Model
    spherical_wrist: StrictBool = Field(
        description="True if the last three axes meet in one point, as the decoupled method requires."
    )
    wrist_miss_distance: Metres[float | None] = Field(
        description="Distance of the last three axes from their nearest common point; null without such "
        "a point."
    )
    geometry_id: Identifier | None = Field(
        default=None,
        description="Geometry from which the model was made; null if the model was posted in another form.",
    )


class Robot(StoredRobot, RobotSummary):
    """A stored robot. A URDF is returned reduced to the chain from base to flange."""

    marks: list[Mark] = Field(
        default_factory=list, description="Events in the history of the robot; the oldest event is first."
    )
    reference_set_ids: list[Identifier] = Field(
        default_factory=list,
        description="Measurement sets with which later campaigns are compared; without such a set, the "
        "first set.",
    )


class RobotChange(ResourceChange):
    """Changes of a robot, except of the kinematics. Omitted fields remain unchanged."""

    add_mark: Mark | None = None
    remove_mark: Mark | None = Field(
        default=None, description="Mark in the history of the robot, with all its fields."
    )
    reference_set_ids: Annotated[list[Identifier], Field(max_length=MAX_MARKS)] | None = Field(
        default=None, description="All references; null: unchanged."
    )
    payload: Payload | None = Field(default=None, description="Largest payload by the maker.")


class JointMapPreset(Message):
    """Joint map of many controllers of a maker.

    In the DH table, axes 2, 3 and 5 must point the same way, and axes 4 and 6 to the flange.
    """

    id: Identifier
    name: Name = Field(examples=["FANUC: J3 from the horizontal"])
    note: str = Field(description="Joint angles as the controller shows them.")
    joint_map: JointMap


class Arm(Message):
    """Nominal arm by published values; a real arm differs by some tenths of a millimetre."""

    name: Name = Field(description="Maker and model.", examples=["KUKA KR 210 R2700 extra"])
    maker: Name
    model: DhModel
    joint_map: JointMap | None = Field(
        description="Map from the controller's angles to the model's angles; null if the angles are equal."
    )
    joint_map_preset: Identifier | None = Field(
        description="Name of a preset for the joint map; null if both kinds of angles are equal."
    )
    base: str = Field(
        description="Origin of the robot's base frame R0, which is the frame of the controller."
    )
    reach: Metres[float] = Field(description="Reach by the maker.")
    reach_of: Literal["wrist_centre", "flange", "stated"] = Field(
        description="Point whose largest distance from axis 1 is the reach; `stated` if the maker does not "
        "name this point."
    )
    payload: Kilograms[float | None] = Field(default=None, description="Payload by the maker.")
    sources: list[str] = Field(description="Source of the values.")


class Catalogue(Message):
    """Nominal arms and presets of joint maps."""

    arms: list[Arm] = Field(description="Arms by maker.")
    joint_maps: list[JointMapPreset]


MAX_POSTURES = 1_000


class KinematicsRequest(Message):
    """A robot, stored or not, with configurations of the robot."""

    robot_id: Identifier | None = Field(
        default=None, description="Id of a stored robot; omit this field if `robot` is given."
    )
    robot: RobotDocument | None = Field(default=None, description="Robot to preview; nothing is stored.")
    joints: Positions[
        Annotated[
            list[Annotated[list[Quantity], Field(max_length=MAX_JOINTS)]], Field(max_length=MAX_POSTURES)
        ]
    ] = Field(
        default_factory=list,
        description="Joint positions as the controller shows them, one list per configuration; default: all "
        "zeros.",
    )

    _one_robot = require_exactly_one("robot_id", "robot")


class Posture(Message):
    """A robot in one configuration, axes of R0."""

    joint_names: list[Name]
    joint_origins: Metres[list[Point]] = Field(
        description="Origins of the joints' frames, from base to flange."
    )
    joint_axes: Dimensionless[list[Point]] = Field(description="Unit vectors along the joints' axes.")
    joint_kinds: list[JointKind] = Field(
        description="Kinds of the joints: rotation about their axis, or motion along their axis."
    )
    flange_origin: Metres[Point]
    flange_axes: Dimensionless[Square3] = Field(
        description="Unit vectors along the x, y and z axes of the flange frame."
    )
