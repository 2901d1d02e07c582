"""Measurement sets: observations under load, their noise, frame and metadata."""

from __future__ import annotations

from math import hypot
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    FailFast,
    Field,
    StrictBool,
    model_validator,
)

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Metres,
    Moment,
    Name,
    Point,
    Quantity,
    Radians,
    ResourceChange,
    Square3,
    Timestamp,
    Vector3,
)
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.robot import MAX_JOINTS

LEAST_SIGMA = 1e-9


def _refuse_tiny_sigma(sigma: object) -> object:
    if isinstance(sigma, int | float) and not isinstance(sigma, bool) and sigma < LEAST_SIGMA:
        raise ValueError(
            f"must be positive, at least {LEAST_SIGMA:g}: omit `noise` to estimate sigma from the residuals"
        )
    return sigma


Sigma = Annotated[float, Field(strict=True, ge=LEAST_SIGMA, le=1e3), BeforeValidator(_refuse_tiny_sigma)]
"""Standard uncertainty of a length, in the set's unit of length."""
Place = Annotated[float, Field(strict=True, gt=0.0, le=1e3)]
"""Standard uncertainty of a place, in the set's unit of length."""
Matrix3 = Annotated[tuple[Vector3, Vector3, Vector3], Field(description="Row by row, symmetric.")]
_PerDistance = Annotated[float, Field(strict=True, ge=0.0, le=0.1)]


class _Uncertain(Message):
    """Standard uncertainties, at least one of them positive."""

    @model_validator(mode="after")
    def _require_positive_value(self) -> Self:
        names = list(type(self).model_fields)
        if not any(getattr(self, name) for name in names):
            raise ValueError(f"give a positive `{'` or `'.join(names)}`; omit this field if all are zero")
        return self


class Uncertainty(_Uncertain):
    """Standard uncertainty: `constant` plus `per_distance` times the distance to the instrument."""

    constant: Annotated[float, Field(strict=True, ge=0.0, le=1e3)] = Field(
        description="Constant part of the uncertainty, in the set's unit of length.", examples=[1e-5]
    )
    per_distance: Dimensionless[_PerDistance] = Field(
        description="Part of the uncertainty per distance: 5e-6 is 5 µm per metre, in any unit of length.",
        examples=[5e-6],
    )


class Instrument(Message):
    """A laser tracker, with different uncertainties along and across its line of sight.

    Standard uncertainties (coverage factor 1). Divide a maximum permissible error by the divisor in the
    data sheet, or by 2 without such a divisor.
    """

    station: Vector3 = Field(
        description="Position of the tracker in the frame of the positions, in units.length. In the "
        "tracker's own frame, state zeros."
    )
    range: Uncertainty = Field(description="Standard uncertainty along the line of sight.")
    transverse: Uncertainty = Field(
        description="Standard uncertainty across the line of sight, in each of two directions."
    )


class ForceUncertainty(_Uncertain):
    """Standard uncertainties of the load, each common to all observations of the set.

    More readings do not average these errors out. A load cell of class 0.5 has a `scale` of about 0.003
    (coverage factor 1).
    """

    scale: Dimensionless[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] | None = Field(
        default=None,
        description="Relative standard uncertainty of the scale of all forces and moments, and therefore "
        "of all stiffnesses; 0.01 if absent.",
        examples=[0.005],
    )
    direction: Radians[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.0,
        description="Standard uncertainty of a common rotation of all forces and moments about each axis "
        "of R0, in rad.",
        examples=[0.002],
    )


class AxisUncertainty(_Uncertain):
    """Standard uncertainties of the joint axes in the robot's model.

    Each axis has one error in all observations. Give the typical or the greatest uncertainty of the axes.
    """

    position: Annotated[float, Field(strict=True, ge=0.0, le=1e3)] = Field(
        default=0.0,
        description="Standard uncertainty of the position of a joint axis in each direction across it, in "
        "units.length.",
        examples=[1e-4],
    )
    direction: Radians[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.0,
        description="Standard uncertainty of the tilt of a joint axis about each of two directions across "
        "it, in rad.",
        examples=[1e-4],
    )


LoadPointGround = Literal["tracker", "drawing", "hand"]
"""How the load point became known, from the most exact to the least."""


ForceGround = Literal["scales", "cell", "pulley", "catalogue"]
"""What the size of the force is known by."""


BetweenReadings = Literal["still", "payload_declared", "gravity_compensated"]
"""What happened between the readings of a posture without and under load."""


class Grounds(Message):
    """Ways in which the load was measured.

    For an absent field, the assumption of a campaign without `noise` remains.
    """

    load_point: LoadPointGround | None = Field(
        default=None,
        description="Way in which the load point was measured. The least standard uncertainty per "
        "coordinate is 1 mm by `tracker` at the hook, 3 mm from a `drawing`, 10 mm by "
        "`hand`. If absent, 10 mm.",
        examples=["tracker"],
    )
    force: ForceGround | None = Field(
        default=None,
        description="Way in which the force is known. `scales`, or `cell` at the hook: uncertainty "
        "`force.scale`. `pulley`: measured beyond a pulley, so that the force at the hook is "
        "smaller by 5 ± 3 %. `catalogue`: weight with an uncertainty of at least 3 %.",
        examples=["cell"],
    )
    tared: StrictBool | None = Field(
        default=None,
        description="True if the load `cell` was set to zero before each reading. The zero is then "
        "uncertain by 2 N along the rope, otherwise by 60 N. Loads of two sizes show the "
        "zero.",
    )
    between: BetweenReadings | None = Field(
        default=None,
        description="State of the arm between the unloaded and the loaded reading of a posture. Default: "
        "`still`. Readings are refused if the controller compensated the load by payload or "
        "by gravity compensation.",
    )

    @model_validator(mode="after")
    def _require_cell(self) -> Grounds:
        """Refuse a statement about the zero of a load cell without a load cell."""
        if self.tared is not None and self.force != "cell":
            raise ValueError("omit `tared`, or state `force` as `cell`, because only a load cell is tared")
        return self


class Noise(Message):
    """Uncertainties of tracker, secondary encoders, load and positions.

    State the tracker's noise as `sigma` or `instrument`. Omit `sigma` and `instrument` if every reading
    states its own noise.
    """

    sigma: Sigma | None = Field(
        default=None,
        description="Standard uncertainty of one coordinate of one position, in units.length; a deflection "
        "has √2 times this uncertainty.",
        examples=[2e-5],
    )
    encoder_sigma: Annotated[float, Field(strict=True, ge=1e-10, le=10.0)] | None = Field(
        default=None,
        description="Standard uncertainty of one reading of a secondary encoder (behind the gearbox), in "
        "units.angle.",
        examples=[5e-6],
    )
    repeatability: Annotated[float, Field(strict=True, ge=0.0, le=1.0)] | None = Field(
        default=None,
        description="Standard deviation of a joint's random angle from posture to posture, in units.angle; "
        "estimated if absent.",
        examples=[2e-5],
    )
    instrument: Instrument | None = Field(
        default=None, description="Uncertainty from the data sheet of the tracker, instead of `sigma`."
    )
    force: ForceUncertainty | None = Field(
        default=None,
        description="Uncertainty of the load; if absent, 1 % of the load is assumed, with a note.",
    )
    load_point: Place | None = Field(
        default=None,
        description="Standard uncertainty of each coordinate of the load point, in units.length; the "
        "error is common to all observations. The fit uses at least the uncertainty that "
        "`grounds.load_point` implies.",
        examples=[5e-4],
    )
    target_places: Place | None = Field(
        default=None,
        description="Standard uncertainty of each coordinate of each target in the flange frame, in "
        "units.length; the error is common to all observations. If absent, positions count "
        "as exact.",
        examples=[5e-4],
    )
    drift: Place | None = Field(
        default=None,
        description="Standard uncertainty of the drift between unloaded and loaded positions from one "
        "observation to the next, in units.length. If absent, no drift is assumed (in a live campaign, 1 "
        "µm).",
        examples=[2e-6],
    )

    axes: AxisUncertainty | None = Field(
        default=None,
        description="Uncertainty of the robot's geometry; if absent, the geometry counts as exact.",
    )
    grounds: Grounds | None = Field(
        default=None, description="Ways in which the data of the load were measured; absent if not stated."
    )
    refuted: StrictBool = Field(
        default=False,
        strict=True,
        description="True if the residuals contradict the stated noise of the tracker. Sigma is then "
        "estimated from the residuals, and the best verdict is *use with care*.",
    )

    @model_validator(mode="after")
    def _require_one_statement(self) -> Noise:
        """Refuse a noise that states nothing, or that states sigma and also an instrument."""
        if self.sigma is not None and self.instrument is not None:
            raise ValueError("give either `sigma` or `instrument`, not both")
        if not self.states_something:
            raise ValueError("give `sigma`, `instrument` or `force` in `noise`, or omit `noise`")
        return self

    @property
    def states_something(self) -> bool:
        """True if any field differs from its default."""
        return any(getattr(self, name) != field.default for name, field in type(self).model_fields.items())


def refuse_sigma_with_covariances(
    sigma: Quantity | None, unloaded: Matrix3 | None, loaded: Matrix3 | None
) -> None:
    """Refuse a reading with both sigma and covariances, or with the covariance of only one state.

    Raises:
        ValueError: the reading is refused; the message names the fields to give.
    """
    if (unloaded is None) != (loaded is None):
        raise ValueError("give both `unloaded_covariance` and `loaded_covariance`, or neither")
    if sigma is not None and unloaded is not None:
        raise ValueError("give either `sigma` or the two covariances, not both")


Rotation = tuple[Vector3, Vector3, Vector3]


class Frame(Message):
    """Frame of a tracker, stated by a geometry or by an explicit transform to R0."""

    geometry_id: Identifier | None = Field(
        default=None,
        description="Id of a geometry of the same robot that the same tracker measured from the same "
        "station.",
    )
    rotation: Dimensionless[Rotation | None] = Field(
        default=None,
        description="Rotation matrix from the tracker's frame to the robot's base frame R0, row by row.",
    )
    translation: Vector3 | None = Field(
        default=None,
        description="Origin of the tracker's frame in the robot's base frame R0, in units.length.",
    )
    base_targets: Annotated[dict[Name, Vector3], Field(min_length=3, max_length=16)] | None = Field(
        default=None,
        description="Targets on the robot's base, read together with this set, in units.length (needs "
        "`geometry_id`). They correct a motion of tracker or robot, with a warning.",
    )
    forces: Literal["base", "tracker"] = Field(
        default="base",
        description="Frame of forces and moments: the robot's base frame R0, or the tracker's frame.",
    )

    @model_validator(mode="after")
    def _require_geometry_or_transform(self) -> Frame:
        """Refuse a frame unless it gives either a geometry or a whole transform."""
        has_whole_transform = self.rotation is not None and self.translation is not None
        has_part_of_transform = self.rotation is not None or self.translation is not None
        has_geometry = self.geometry_id is not None
        if has_geometry == has_part_of_transform or has_part_of_transform != has_whole_transform:
            raise ValueError("give either `geometry_id`, or both `rotation` and `translation`")
        if self.base_targets is not None and self.geometry_id is None:
            raise ValueError(
                "give also `geometry_id`, because `base_targets` are compared with the base targets of the "
                "geometry"
            )
        return self


class Rigid(Message):
    """Transform of coordinates to another frame: rotation first, then translation."""

    rotation: Dimensionless[Square3] = Field(description="Rotation matrix, row by row.")
    translation: Metres[Point]


class ResolvedFrame(Message):
    """Frame as resolved when the set was stored, valid even if the geometry is deleted."""

    rotation: Dimensionless[Rotation] = Field(
        description="Rotation matrix from the tracker's frame to the robot's base frame R0, row by row."
    )
    translation: Metres[Vector3] = Field(description="The tracker's origin in R0.")
    flange_targets: Metres[dict[Name, Vector3]] = Field(
        description="Places of the geometry's targets in the flange frame, for targets whose place the "
        "set does not state. Empty if the geometry has another flange frame."
    )


MAX_NOTES_LENGTH = 2_000


def _refuse_unprintable_lines(text: str) -> str:
    if text != text.strip() or not all(line.isprintable() for line in text.split("\n")):
        raise ValueError("must be printable lines without leading or trailing blanks")
    return text


Notes = Annotated[
    str, Field(min_length=1, max_length=MAX_NOTES_LENGTH), AfterValidator(_refuse_unprintable_lines)
]
"""Plain text of several lines."""


class SetMetadata(Message):
    """Metadata of a measurement set; all fields are optional."""

    measured_at: Moment | None = Field(
        default=None,
        description="Time of the measurement in ISO 8601 with a time zone; stored in UTC.",
        examples=["2026-11-20T14:30:00+01:00"],
    )
    operator: Name | None = Field(default=None, description="Person or team that measured.")
    instrument: Name | None = Field(
        default=None,
        description="Name of the instrument for readers; `noise` states the instrument's uncertainty.",
        examples=["Leica AT960, 750123"],
    )
    serial_number: Name | None = Field(default=None, description="Serial number of the robot.")
    item_condition: Name | None = Field(
        default=None,
        description="Condition of the robot during the measurement.",
        examples=["as found, 12,000 h of operation"],
    )
    conditions: Name | None = Field(
        default=None,
        description="Conditions of the measurement.",
        examples=["21 °C, warmed up for 30 min"],
    )
    notes: Notes | None = Field(
        default=None, description=f"Further notes, at most {MAX_NOTES_LENGTH} characters in lines."
    )


MAX_OBSERVATIONS = 10_000
MAX_TARGETS = 16
LEAST_DIRECTION = 1e-6


class SetChange(ResourceChange, SetMetadata):
    """Changes of a measurement set, but not of its readings.

    In a live campaign, readings to withdraw, keep or skip. Omitted fields remain unchanged.
    """

    withdrawn: Annotated[dict[Name, Notes], Field(max_length=MAX_OBSERVATIONS)] = Field(
        default_factory=dict,
        description="Labels of withdrawn readings, each with the reason.",
        examples=[{"m04": "target P11 was blocked"}],
    )
    kept: Annotated[list[Name], Field(max_length=MAX_OBSERVATIONS)] = Field(
        default_factory=list, description="Labels of doubtful readings that the user accepted."
    )
    skipped: Name | None = Field(
        default=None,
        description="Label of the next reading, to skip a posture that the robot cannot reach.",
    )

    @property
    def is_live(self) -> bool:
        """True if the request changes a live campaign: it withdraws, keeps or skips observations."""
        return bool(self.withdrawn or self.kept or self.skipped)


LengthUnit = Literal["m", "mm"]
AngleUnit = Literal["rad", "deg"]
ConfusedForceUnit = Literal["N", "kN", "kgf", "lbf"]
ForceUnit = Literal[ConfusedForceUnit, "kg"]
MomentUnit = Literal["N.m", "N.mm", "kN.m", "kgf.m", "lbf.m", "lbf.ft", "lbf.in"]


class Units(Message):
    """Units of every number in the set.

    Units are mandatory, because a confusion of kg and N cannot be detected later.
    """

    length: LengthUnit = Field(
        description="Unit of positions, deflections, load points, sigma and prismatic joints."
    )
    angle: AngleUnit = Field(description="Unit of joint angles, encoder readings and encoder_sigma.")
    force: ForceUnit = Field(
        description="Unit of forces; 1 kgf = 9.80665 N, 1 lbf = 4.44822 N. With `kg`, forces are the "
        "weights of hung masses: 150 kg are `[0, 0, -150]`."
    )
    moment: MomentUnit | None = Field(
        default=None,
        description="Unit of moments; if lengths are in m, the default is the unit of force times m.",
    )


_KINDS_OF_READING = ("unloaded", "loaded", "deflection", "displacement")


class Reading(Message):
    """Readings of one target in one observation.

    The readings are positions, a deflection, or a displacement along a direction (dial gauge).
    """

    target: Name = Field(description="Name of the target (reflector).", examples=["P10"])
    unloaded: Vector3 | None = Field(
        default=None,
        description="Position in the base frame R0 without load, in units.length. `loaded` may be absent "
        "only for runs with `weight`.",
    )
    loaded: Vector3 | None = Field(
        default=None, description="Position in the base frame R0 under load, in units.length."
    )
    unloaded_after: Vector3 | None = Field(
        default=None,
        description="Position in the base frame R0 after the load was removed, in units.length; "
        "requires `unloaded` and `loaded`.",
    )
    deflection: Vector3 | None = Field(
        default=None,
        description="Deflection: loaded minus unloaded position, along the axes of the base frame R0, in "
        "units.length. Requires the place of the target in `flange_targets`.",
    )
    displacement: Quantity | None = Field(
        default=None,
        description="Loaded minus unloaded reading of a dial gauge or 1-D laser along `direction` or "
        "`flange_direction`, in units.length. Requires `flange_targets`.",
    )
    direction: Vector3 | None = Field(
        default=None,
        description="Direction of `displacement` in the base frame R0, or in `frame` if stated. The "
        "vector has a length of 1e-6 or more.",
        examples=[[0.0, 0.0, 1.0]],
    )
    flange_direction: Vector3 | None = Field(
        default=None, description="Direction of `displacement` in the flange frame, instead of `direction`."
    )
    sigma: Sigma | None = Field(
        default=None,
        description="Standard uncertainty of one coordinate of either position, or of the gauge, in "
        "units.length. All tracker readings state `sigma`, or `noise` states one sigma for "
        "all. A reading along a direction may always state `sigma`.",
    )
    unloaded_covariance: Matrix3 | None = Field(
        default=None,
        description="Covariance of the unloaded position along the axes of the base frame R0, in "
        "units.length squared, instead of `sigma`.",
    )
    loaded_covariance: Matrix3 | None = Field(
        default=None,
        description="Covariance of the position under load, with the axes and unit of `unloaded_covariance`.",
    )

    @model_validator(mode="after")
    def _refuse_two_kinds_of_noise(self) -> Reading:
        refuse_sigma_with_covariances(self.sigma, self.unloaded_covariance, self.loaded_covariance)
        return self

    @model_validator(mode="after")
    def _require_one_kind_of_reading(self) -> Reading:
        """Refuse a reading unless its fields belong to exactly one of the kinds of readings."""
        stated = {name for name in _KINDS_OF_READING if getattr(self, name) is not None}
        if stated not in ({"unloaded"}, {"unloaded", "loaded"}, {"deflection"}, {"displacement"}):
            raise ValueError(
                "a reading needs `unloaded` and `loaded`, or `deflection`, or `displacement` with its "
                "direction, or (for runs with `weight`) `unloaded` alone"
            )
        if self.unloaded_after is not None and stated != {"unloaded", "loaded"}:
            raise ValueError("give `unloaded` and `loaded` with `unloaded_after`")
        directions = [d for d in (self.direction, self.flange_direction) if d is not None]
        is_short = any(hypot(*direction) < LEAST_DIRECTION for direction in directions)
        # A displacement needs exactly one direction, any other reading none.
        if is_short or len(directions) != (self.displacement is not None):
            raise ValueError(
                "with a `displacement`, give either `direction` or `flange_direction`, at least "
                f"{LEAST_DIRECTION:g} long; with any other reading, omit both"
            )
        if self.displacement is not None and self.unloaded_covariance is not None:
            raise ValueError(
                "with a `displacement`, give `sigma` instead of covariances, because a `displacement` has a "
                "single component"
            )
        return self


class EncoderReading(Message):
    """Angle of a joint behind the gearbox, without and under load.

    The motor's encoder closes the position loop.
    """

    joint: Name = Field(description="Name of the robot's joint.", examples=["joint_2"])
    unloaded: Quantity = Field(
        description="Angle of the model's joint (after the joint map) without load, in units.angle; a "
        "constant offset is allowed."
    )
    loaded: Quantity = Field(description="Angle under load, in units.angle.")


_EncoderReadings = Annotated[list[EncoderReading], Field(min_length=1, max_length=MAX_JOINTS)]


class Observation(Message):
    """Readings of one configuration under one load."""

    label: Name = Field(description="Label, unique in the set.", examples=["c01"])
    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Joint positions as the controller shows them, in units.angle or units.length."
    )
    force: Vector3 = Field(
        description="Force on the robot, along the axes of the base frame R0, in units.force."
    )
    moment: Vector3 | None = Field(
        default=None,
        description="Moment on the robot about the load point, along the axes of the base frame R0, in "
        "units.moment.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Load point in the flange frame, in units.length; default: the load point of the set.",
    )
    readings: Annotated[list[Reading], Field(min_length=1, max_length=MAX_TARGETS), FailFast()] = Field(
        description="Readings of the targets, at most one per target."
    )
    encoder_readings: _EncoderReadings | None = Field(
        default=None,
        description="Readings of secondary encoders, at most one per joint; empty if these encoders close "
        "the position loop.",
    )


class MeasurementSetHeader(SetMetadata):
    """Fields common to all observations of a set."""

    name: Name = Field(examples=["cell 3, dead weight, 2026-11-20"])
    units: Units
    encoders: Literal["motor", "secondary"] = Field(
        description="Encoders with which the controller closes the position loop: `motor` at the motors, "
        "`secondary` behind the gearboxes."
    )
    noise: Noise | None = Field(
        default=None,
        description="Noise of the readings; sigma is estimated if neither the set nor the readings state "
        "their noise.",
    )
    frame: Frame | None = Field(
        default=None,
        description="Frame of positions, deflections, covariances and of a tracker's station; default: the "
        "robot's base frame R0.",
    )
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Places of the targets in the flange frame, in units.length; needed for deflections.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Load point in the flange frame, in units.length; an observation may state another load "
        "point.",
    )
    load_point_target: Name | None = Field(
        default=None,
        description="Name of the target at the hook. A reading of the target without load gives the load "
        "point. The reading also tests a stated load point.",
        examples=["hook"],
    )
    joint_kinds: Annotated[list[JointKind], Field(max_length=MAX_JOINTS)] | None = Field(
        default=None,
        description="Kinds of the joints in the readings, equal to the kinds of the robot's joints.",
    )


class MeasurementSetDocument(MeasurementSetHeader):
    """A measurement set in a campaign file."""

    observations: Annotated[
        list[Observation], Field(min_length=1, max_length=MAX_OBSERVATIONS), FailFast()
    ] = Field(description=f"One to {MAX_OBSERVATIONS} observations.")


class MeasurementSetRequest(MeasurementSetDocument):
    """Request of a measurement set."""

    robot_id: Identifier


class StoredSet(SetMetadata):
    """Fields of a stored measurement set that lists also show."""

    id: Identifier
    robot_id: Identifier
    content_hash: str | None = Field(
        description="SHA-256 of the readings with their units, noise and frame; null while the set is still "
        "measured."
    )
    created_at: Timestamp


class MeasurementSetSummary(StoredSet):
    """A measurement set in a listing."""

    name: Name
    encoders: Literal["motor", "secondary"]
    observation_count: int
    warning_count: int
    open: StrictBool = Field(default=False, description="True while the set is still measured.")


class StoredMeasurementSet(MeasurementSetHeader, StoredSet):
    """A stored measurement set without observations."""

    resolved_frame: Rigid | None = Field(
        default=None,
        description="Transform from the tracker's frame to the base frame R0, as stored with the set.",
    )
    geometry_targets: Metres[dict[Name, Vector3]] = Field(
        default_factory=dict,
        description="Places of the geometry's targets in the flange frame, if the set does not state them.",
    )
    warnings: list[Finding]

    @property
    def resolved(self) -> ResolvedFrame | None:
        """Transform from the set's frame to R0, with the targets of the geometry; None for a set in R0."""
        frame = self.resolved_frame
        if frame is None:
            return None
        return ResolvedFrame(
            rotation=frame.rotation, translation=frame.translation, flange_targets=self.geometry_targets
        )
