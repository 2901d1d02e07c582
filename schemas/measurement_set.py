"""A measurement set: loads applied to the robot and what the tracker read before and after."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import FailFast, Field, model_validator

from schemas.base import Identifier, Message, Name, Quantity, Timestamp, Vector3
from schemas.robot import MAX_JOINTS

__all__ = [
    "MAX_OBSERVATIONS",
    "MAX_TARGETS",
    "MeasurementSet",
    "MeasurementSetDocument",
    "MeasurementSetHeader",
    "MeasurementSetRequest",
    "MeasurementSetSummary",
    "Noise",
    "Observation",
    "QualityWarning",
    "Reading",
    "StoredMeasurementSet",
    "Units",
]

MAX_OBSERVATIONS = 10_000
MAX_TARGETS = 16

LengthUnit = Literal["m", "mm"]
AngleUnit = Literal["rad", "deg"]
ForceUnit = Literal["N", "kN", "kgf"]
MomentUnit = Literal["N.m", "N.mm", "kN.m", "kgf.m"]


class Units(Message):
    """Units of every number in the set. Mandatory: kg instead of N cannot be found out later."""

    length: LengthUnit = Field(description="Of positions, deflections, load points and sigma.")
    angle: AngleUnit = Field(description="Of joint angles.")
    force: ForceUnit = Field(description="Of forces; 1 kgf = 9.80665 N.")
    moment: MomentUnit | None = Field(
        default=None,
        description="Of moments. May be absent where no moment is given, or where lengths are in "
        "m: then it is the unit of force times m.",
    )


class Noise(Message):
    """What one tracker reading is worth."""

    sigma: Annotated[float, Field(strict=True, ge=1e-9, le=1e3)] = Field(
        description="Standard uncertainty of one coordinate of one position reading, in the set's "
        "unit of length. A deflection, being a difference of two, has √2 times that.",
        examples=[2e-5],
    )


class Reading(Message):
    """One target in one observation: two positions, or one deflection."""

    target: Name = Field(description="Name of the target (reflector).", examples=["P10"])
    unloaded: Vector3 | None = Field(
        default=None, description="Position in R0 before the load, in units.length."
    )
    loaded: Vector3 | None = Field(default=None, description="Position in R0 under load, in units.length.")
    deflection: Vector3 | None = Field(
        default=None,
        description="Loaded minus unloaded, axes of R0, in units.length. Needs the target's place "
        "in `flange_targets`.",
    )

    @model_validator(mode="after")
    def _either_positions_or_deflection(self) -> Reading:
        both = self.unloaded is not None and self.loaded is not None
        neither = self.unloaded is None and self.loaded is None
        if not (both if self.deflection is None else neither):
            raise ValueError("give either `unloaded` and `loaded`, or `deflection` alone")
        return self


class Observation(Message):
    """One configuration under one load."""

    label: Name = Field(description="Unique in the set.", examples=["c01"])
    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Angles as the controller shows them, in units.angle."
    )
    force: Vector3 = Field(description="Force on the robot, axes of R0, in units.force.")
    moment: Vector3 | None = Field(
        default=None,
        description="Moment on the robot about the load point, axes of R0, in units.moment.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Where the force acts, flange frame, in units.length; the set's if absent.",
    )
    readings: Annotated[list[Reading], Field(min_length=1, max_length=MAX_TARGETS), FailFast()] = Field(
        description="What was read of each target, at most once a target."
    )


class MeasurementSetHeader(Message):
    """What holds for all observations of a set."""

    name: Name = Field(examples=["cell 3, dead weight, 2026-11-20"])
    units: Units
    encoders: Literal["motor", "secondary"] = Field(
        description="Which encoders close the position loop: those of the motors, or secondary "
        "encoders behind the gearboxes."
    )
    noise: Noise | None = Field(default=None, description="If absent, sigma is estimated from the residuals.")
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Targets in the flange frame, in units.length; needed for deflections.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Where the force acts, flange frame, in units.length; an observation may give its own.",
    )


class MeasurementSetDocument(MeasurementSetHeader):
    """A measurement set as it stands in a campaign file."""

    observations: Annotated[
        list[Observation], Field(min_length=1, max_length=MAX_OBSERVATIONS), FailFast()
    ] = Field(description=f"One to {MAX_OBSERVATIONS} observations.")


class MeasurementSetRequest(MeasurementSetDocument):
    """A measurement set as it is posted."""

    robot_id: Identifier = Field(description="The robot that was measured.")


WarningCode = Literal[
    "targets_not_rigid",
    "target_off_model",
    "target_name_suspect",
    "deflection_against_force",
    "joint_outside_limits",
    "angle_unit_suspect",
    "deflection_implausibly_large",
    "deflection_implausibly_small",
    "deflection_below_noise",
    "sigma_suspect",
    "zero_load",
    "residuals_exceed_sigma",
    "low_compensation",
    "stiffness_implausible",
]


class QualityWarning(Message):
    """Something suspicious but not impossible, in a set or in a fit. Shown on every run."""

    code: WarningCode = Field(description="Kind of the suspicion.")
    where: str | None = Field(description="Which observation or reading; null for the whole set.")
    message: str = Field(description="What was seen, with its figure and unit.")
    remedy: str = Field(description="What to check.")


class MeasurementSetSummary(Message):
    """A measurement set in a listing."""

    id: Identifier
    robot_id: Identifier
    name: Name
    encoders: Literal["motor", "secondary"]
    observation_count: int
    warning_count: int
    created_at: Timestamp


class StoredMeasurementSet(MeasurementSetHeader):
    """A stored measurement set without its observations."""

    robot_id: Identifier = Field(description="The robot that was measured.")
    id: Identifier
    warnings: list[QualityWarning]
    content_hash: str = Field(description="SHA-256 of everything that was posted.")
    created_at: Timestamp


class MeasurementSet(StoredMeasurementSet, MeasurementSetDocument):
    """A stored measurement set: what was posted, and what was noticed."""
