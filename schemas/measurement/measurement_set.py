"""A measurement set: loads applied to the robot and what the tracker read before and after."""

from __future__ import annotations

from math import hypot
from typing import Annotated, Literal

from pydantic import FailFast, Field, model_validator

from jointstiff.schemas.fields import Identifier, Message, Name, Quantity, Timestamp, Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.measurement.frame import Frame, ResolvedFrame
from jointstiff.schemas.measurement.metadata import SetMetadata
from jointstiff.schemas.measurement.noise import Matrix3, Noise, Sigma, refuse_two_kinds
from jointstiff.schemas.robot import MAX_JOINTS

MAX_OBSERVATIONS = 10_000
MAX_TARGETS = 16
LEAST_DIRECTION = 1e-6

LengthUnit = Literal["m", "mm"]
AngleUnit = Literal["rad", "deg"]
ForceUnit = Literal["N", "kN", "kgf"]
MomentUnit = Literal["N.m", "N.mm", "kN.m", "kgf.m"]


class Units(Message):
    """Units of every number in the set; mandatory, because kg instead of N cannot be detected later."""

    length: LengthUnit = Field(description="Unit of positions, deflections, load points and sigma.")
    angle: AngleUnit = Field(description="Unit of joint angles, encoder readings and encoder_sigma.")
    force: ForceUnit = Field(description="Unit of forces; 1 kgf = 9.80665 N.")
    moment: MomentUnit | None = Field(
        default=None,
        description="Unit of moments. Optional if there is no moment, or if lengths are in m: then it is the "
        "unit of force times m.",
    )


_KINDS_OF_READING = ("unloaded", "loaded", "deflection", "displacement")


class Reading(Message):
    """One target in one observation: two positions, a deflection, its part along a direction, or a position.

    A dial gauge or a laser that measures one distance reads along a direction; a position alone is without a
    load.
    """

    target: Name = Field(description="Name of the target (reflector).", examples=["P10"])
    unloaded: Vector3 | None = Field(
        default=None,
        description="Position in R0 without load, in units.length. Alone, only for runs with `weight`, "
        "whose load is the robot's own weight.",
    )
    loaded: Vector3 | None = Field(default=None, description="Position in R0 under load, in units.length.")
    deflection: Vector3 | None = Field(
        default=None,
        description="Loaded minus unloaded, axes of R0, in units.length. Needs the target's position in "
        "`flange_targets`.",
    )
    displacement: Quantity | None = Field(
        default=None,
        description="Loaded minus unloaded reading of a dial gauge or 1-D laser, positive along `direction` "
        "or `flange_direction`, in units.length. Needs the target's position in `flange_targets`.",
    )
    direction: Vector3 | None = Field(
        default=None,
        description="Direction of `displacement`, of any length from 1e-6 on, axes of R0; of `frame`, if the "
        "set has one.",
        examples=[[0.0, 0.0, 1.0]],
    )
    flange_direction: Vector3 | None = Field(
        default=None, description="Direction of `displacement` in the flange frame, instead of `direction`."
    )
    sigma: Sigma | None = Field(
        default=None,
        description="Standard uncertainty of one coordinate of either position of this reading, or of the "
        "gauge before and under load, in units.length. All readings of the tracker state their own noise, "
        "or none and `noise` does; a reading along a direction may state its own beside them.",
    )
    unloaded_covariance: Matrix3 | None = Field(
        default=None,
        description="Covariance of the unloaded position, axes of R0, in units.length squared, instead of "
        "`sigma`. A deflection, the difference of two positions, needs both covariances.",
    )
    loaded_covariance: Matrix3 | None = Field(
        default=None, description="Covariance of the position under load."
    )

    @model_validator(mode="after")
    def _one_kind_of_noise(self) -> Reading:
        refuse_two_kinds(self.sigma, self.unloaded_covariance, self.loaded_covariance)
        return self

    @model_validator(mode="after")
    def _one_kind_of_reading(self) -> Reading:
        given = {name for name in _KINDS_OF_READING if getattr(self, name) is not None}
        if given not in ({"unloaded"}, {"unloaded", "loaded"}, {"deflection"}, {"displacement"}):
            raise ValueError(
                "give `unloaded` and `loaded`, or `deflection`, or `displacement` with its direction, or "
                "`unloaded` alone for runs with `weight`"
            )
        directions = [d for d in (self.direction, self.flange_direction) if d is not None]
        short = any(hypot(*direction) < LEAST_DIRECTION for direction in directions)
        if short or len(directions) != (self.displacement is not None):
            raise ValueError(
                "give a `displacement` exactly one of `direction` and `flange_direction`, of a length of at "
                f"least {LEAST_DIRECTION:g}"
            )
        if self.displacement is not None and self.unloaded_covariance is not None:
            raise ValueError("give `sigma` with a `displacement`: it has no covariance")
        return self


class EncoderReading(Message):
    """A joint's angle behind its gearbox, read by a secondary encoder before and under load.

    The motor's encoder closes the loop meanwhile, so the difference is how far the joint itself bent.
    """

    joint: Name = Field(description="Name of the robot's joint.", examples=["joint_2"])
    unloaded: Quantity = Field(
        description="Unloaded angle of the model's joint, in units.angle: with the sign of its "
        "axis, after the "
        "joint map. A constant offset does not matter."
    )
    loaded: Quantity = Field(description="Angle under load, in units.angle.")


_EncoderReadings = Annotated[list[EncoderReading], Field(min_length=1, max_length=MAX_JOINTS)]


class Observation(Message):
    """One configuration under one load."""

    label: Name = Field(description="Label, unique in the set.", examples=["c01"])
    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Joint angles as displayed by the controller, in units.angle."
    )
    force: Vector3 = Field(description="Force on the robot, axes of R0, in units.force.")
    moment: Vector3 | None = Field(
        default=None,
        description="Moment on the robot about the load point, axes of R0, in units.moment.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Load point in the flange frame, in units.length; default: that of the set.",
    )
    readings: Annotated[list[Reading], Field(min_length=1, max_length=MAX_TARGETS), FailFast()] = Field(
        description="Readings of the targets, at most one per target."
    )
    encoder_readings: _EncoderReadings | None = Field(
        default=None,
        description="Readings of secondary encoders, at most one per joint. Omit them if these encoders "
        "close the loop, because they then show no deflection.",
    )


class MeasurementSetHeader(SetMetadata):
    """Fields common to all observations of a set."""

    name: Name = Field(examples=["cell 3, dead weight, 2026-11-20"])
    units: Units
    encoders: Literal["motor", "secondary"] = Field(
        description="Encoders that close the position loop: those of the motors, or secondary "
        "encoders behind "
        "the gearboxes."
    )
    noise: Noise | None = Field(
        default=None,
        description="Noise of the readings; if absent, and no reading states its own, sigma is "
        "estimated from "
        "the residuals.",
    )
    frame: Frame | None = Field(
        default=None,
        description="Frame of positions, deflections, covariances and the tracker's station, if it is a "
        "tracker's; default: R0.",
    )
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Targets in the flange frame, in units.length; needed for deflections.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Load point in the flange frame, in units.length; an observation may have its own.",
    )


class MeasurementSetDocument(MeasurementSetHeader):
    """A measurement set in a campaign file."""

    observations: Annotated[
        list[Observation], Field(min_length=1, max_length=MAX_OBSERVATIONS), FailFast()
    ] = Field(description=f"One to {MAX_OBSERVATIONS} observations.")


class MeasurementSetRequest(MeasurementSetDocument):
    """A measurement set as it is posted."""

    robot_id: Identifier = Field(description="Id of the robot that was measured.")


class MeasurementSetSummary(SetMetadata):
    """A measurement set in a listing."""

    id: Identifier
    robot_id: Identifier
    name: Name
    encoders: Literal["motor", "secondary"]
    observation_count: int
    warning_count: int
    archived: bool = Field(description="True if archived: listings omit the set.")
    content_hash: str = Field(description="SHA-256 of the readings, as in the set.")
    created_at: Timestamp


class StoredMeasurementSet(MeasurementSetHeader):
    """A stored measurement set without its observations."""

    robot_id: Identifier = Field(description="Id of the robot that was measured.")
    id: Identifier
    resolved_frame: ResolvedFrame | None = Field(default=None, description="Resolved `frame`.")
    warnings: list[Finding]
    archived: bool = Field(default=False, description="True if archived: listings omit the set.")
    content_hash: str = Field(
        description="SHA-256 of the readings with their units, noise and frame; not of name and metadata."
    )
    created_at: Timestamp


class MeasurementSet(StoredMeasurementSet, MeasurementSetDocument):
    """A stored measurement set with its findings."""
