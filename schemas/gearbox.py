"""Stiffness of gearboxes from two encoders: a weight step, read at the motors and behind the gearboxes."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import FailFast, Field, model_validator

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Interval,
    Kilograms,
    Message,
    Metres,
    Name,
    Quantity,
    Radians,
    RotationalCompliance,
    Seconds,
    Stiffness,
    Terminal,
    Torque,
    Vector3,
    parse_numbers,
)
from jointstiff.schemas.finding import Assessment, Finding, ResultSummary
from jointstiff.schemas.job import Job, Result
from jointstiff.schemas.measurement import AngleUnit, LengthUnit
from jointstiff.schemas.motion import Motion
from jointstiff.schemas.robot import MAX_JOINTS, RobotDocument

LEAST_MASS, GREATEST_MASS = 0.01, 1e4
MAX_POSTURES = 200
MAX_READINGS_OF_POSTURE = 2 * MAX_JOINTS


class GearboxUnits(Message):
    """Units of all numbers except masses, which are in kg."""

    length: LengthUnit = Field(description="Unit of the position of the load.")
    angle: AngleUnit = Field(description="Unit of joint angles, of encoder angles and of `encoder_sigma`.")


class HungLoad(Message):
    """Load that is at the flange in the second state, and not in the first."""

    mass: Kilograms[Annotated[float, Field(strict=True, ge=LEAST_MASS, le=GREATEST_MASS)]] = Field(
        description="Mass of the load in kg, including a hook or tool that is added with the load."
    )
    mass_uncertainty: Kilograms[Annotated[float, Field(strict=True, ge=0.0, le=GREATEST_MASS)] | None] = (
        Field(
            default=None,
            description="Standard uncertainty of the mass in kg. If absent, 1 % is assumed, and the best "
            "possible verdict is `use_with_care`.",
        )
    )
    point: Vector3 = Field(
        description="Centre of mass of the load in the flange frame, in units.length. For a load on a "
        "hook, state the position of the hook."
    )
    point_uncertainty: Annotated[float, Field(strict=True, ge=0.0, le=1e4)] | None = Field(
        default=None,
        description="Standard uncertainty of each coordinate of `point`, in units.length; if absent, 10 mm "
        "is assumed.",
    )


class EncoderAngles(Message):
    """Angles of the motor encoder and the link encoder of one joint at rest."""

    motor: Quantity = Field(
        description="Angle of the motor's encoder divided by the gear ratio, in units.angle; a constant "
        "offset is allowed."
    )
    link: Quantity = Field(
        description="Angle of the encoder behind the gearbox, in units.angle; a constant offset is allowed."
    )


class TwistReading(Message):
    """Angles of both encoders of one joint in one posture, without and with the load."""

    joint: Name = Field(description="Name of the robot's joint.", examples=["joint_2"])
    unloaded: EncoderAngles
    loaded: EncoderAngles
    approach: Literal["+", "-"] | None = Field(
        default=None,
        description="Direction of the joint's last turn before the readings without and with the load; "
        "absent if unknown.",
    )


_TwistReadings = Annotated[
    list[TwistReading], Field(min_length=1, max_length=MAX_READINGS_OF_POSTURE), FailFast()
]


class StepPosture(Message):
    """Readings in one posture."""

    label: Name = Field(description="Label, unique in the step.", examples=["s01"])
    joints: Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="Joint positions as the controller shows them, in units.angle or units.length."
    )
    encoder_readings: _TwistReadings = Field(
        description="Readings of the two encoders of a joint, at most one per joint and direction of "
        "approach."
    )


class StepReadings(Message):
    """Table of encoder readings without and with a weight; the table does not state the weight."""

    units: GearboxUnits
    observations: list[StepPosture]


def parse_load(text: str) -> dict[str, Any]:
    """Parse `MASS[±UNCERTAINTY],X,Y,Z` in kg and units.length; return the fields of a hung load."""
    mass_text, _, point_text = text.partition(",")
    mass, sign, uncertainty = mass_text.replace("+-", "±").partition("±")
    try:
        load: dict[str, Any] = {"mass": float(mass), "point": parse_numbers(point_text)}
        return load | {"mass_uncertainty": float(uncertainty)} if sign else load
    except ValueError:
        raise ValueError(
            f"'{text}' must state a mass in kg and the place of its centre, such as 100.2±0.1,0,0,150"
        ) from None


class GearboxRequest(Message):
    """Angles of two encoders per joint, read at rest without and with a weight, or logged during a motion."""

    name: Name = Field(default="gearboxes", examples=["LBR cell 2, 10 kg"])
    units: GearboxUnits
    robot_id: Annotated[Identifier | None, Terminal(hidden=True)] = Field(
        default=None, description="Id of a stored robot; omit this field if `robot` is given."
    )
    robot: RobotDocument | None = Field(
        default=None, description="Description of a robot that is not stored, instead of `robot_id`."
    )
    load: Annotated[HungLoad | None, Terminal("--load", "KG[±KG],X,Y,Z", parse_load)] = Field(
        default=None, description="Load of the readings at rest."
    )
    gravity: Vector3 = Field(
        default=(0.0, 0.0, -9.80665),
        description="Acceleration of gravity in the robot's base frame R0, in m/s².",
    )
    encoder_sigma: Annotated[float, Field(strict=True, ge=0.0, le=10.0)] | None = Field(
        default=None,
        description="Standard uncertainty of an encoder's angle, in units.angle. The estimated noise of "
        "a step is at least twice the stated value.",
    )
    observations: Annotated[list[StepPosture], Field(max_length=MAX_POSTURES), FailFast()] = Field(
        default_factory=list,
        description="Postures, each read without and with the load; 12 postures are good practice.",
    )
    motion: Motion | None = Field(
        default=None,
        description="Logs of a motion, in place of `load` and `observations`. The masses of the arm then "
        "check the stiffness of a gearbox within a factor of 1.5.",
    )

    @property
    def instrument(self) -> HungLoad | Motion:
        """The load of a weight step, or the logs: one of them is stated."""
        instrument = self.load if self.motion is None else self.motion
        if instrument is None:
            raise AssertionError("the validator requires one of both")
        return instrument

    @model_validator(mode="after")
    def _require_one_robot(self) -> GearboxRequest:
        if (self.robot_id is None) == (self.robot is None):
            raise ValueError("give either `robot_id` or `robot`")
        return self

    @model_validator(mode="after")
    def _require_step_or_motion(self) -> GearboxRequest:
        has_step = self.load is not None and bool(self.observations)
        has_part = self.load is not None or bool(self.observations)
        if self.motion is None and not has_step:
            raise ValueError("give `load` and `observations` of a weight step, or give `motion` with logs")
        if self.motion is not None and has_part:
            raise ValueError("give either `motion`, or `load` with `observations` at rest")
        return self

    @model_validator(mode="after")
    def _require_plausible_gravity(self) -> GearboxRequest:
        if not 1.0 <= sum(part**2 for part in self.gravity) ** 0.5 <= 100.0:
            raise ValueError("gravity must be 1 to 100 m/s²; on the earth it is 9.80665 m/s²")
        return self

    @model_validator(mode="after")
    def _refuse_repeated_readings(self) -> GearboxRequest:
        """Refuse labels that repeat, and two readings of one joint from the same side in one posture."""
        labels = [posture.label for posture in self.observations]
        if len(set(labels)) != len(labels):
            repeated = next(label for label in labels if labels.count(label) > 1)
            raise ValueError(f"two postures have the label '{repeated}': give each posture a different label")
        for posture in self.observations:
            sides = [(reading.joint, reading.approach) for reading in posture.encoder_readings]
            if len(set(sides)) != len(sides):
                joint = next(side[0] for side in sides if sides.count(side) > 1)
                raise ValueError(
                    f"posture '{posture.label}' has two readings of {joint} with the same `approach`: state "
                    "'+' for one reading and '-' for the other, or omit one reading"
                )
        return self


class GearboxStiffness(Message):
    """The gearbox of one joint, between the motor's encoder and the encoder behind the gearbox."""

    joint: Name
    stiffness: Stiffness[float | None] = Field(
        description="Stiffness of the gearbox; null if unknown, with the reason in `reason`."
    )
    stiffness_interval: Stiffness[tuple[float, float | None] | None] = Field(
        description="95 % interval of the stiffness; the upper end is null if the gearbox may be rigid."
    )
    half_width: Dimensionless[float | None] = Field(
        description="Half of the interval's width, relative to the stiffness; null if the interval has no "
        "upper end."
    )
    compliance: RotationalCompliance[float | None]
    compliance_interval: RotationalCompliance[Interval | None]
    reason: str | None = Field(description="Reason why the gearbox has no stiffness.")
    least_torque: Torque[float] = Field(
        description="Least torque with which the motor carries the load, over all postures."
    )
    greatest_torque: Torque[float]
    offset: Radians[float | None] = Field(
        description="Change of the gearbox's twist that no torque explains, such as a drift of an encoder."
    )
    lost_motion: Radians[float | None] = Field(
        description="Mean difference of the twist between approaches from the positive and the negative "
        "side; null unless both approaches were measured."
    )
    lost_motion_interval: Radians[Interval | None] = Field(
        description="95 % interval of the mean difference of the twist between the two approaches."
    )
    noise: Radians[float | None] = Field(
        description="Standard deviation of the step of the twist in a single posture."
    )
    degrees_of_freedom: int = Field(
        description="Number of postures less number of unknowns; for logs, number of independent samples."
    )
    postures: int = Field(description="Number of postures in which the joint was read; 0 for logs.")
    delay: Seconds[float | None] = Field(
        default=None,
        description="Delay of the link encoder's readings in the logs; null without logs.",
    )


class StepResidual(Message):
    """Step of the twist of one joint in one posture."""

    label: Name
    joint: Name
    torque: Torque[float] = Field(description="Torque of the motor that carries the load about the joint.")
    step: Radians[float] = Field(
        description="Twist of the gearbox with the load less twist without the load; mean over the "
        "approaches."
    )
    residual: Radians[float | None] = Field(
        description="Measured step of the twist less predicted step; null without a stiffness."
    )


class LogEstimate(Message):
    """The gearbox of one joint by one log alone."""

    label: Name
    joint: Name
    stiffness: Stiffness[float | None] = Field(
        description="Upper end of the interval; null if the log determines no upper end."
    )
    stiffness_interval: Stiffness[tuple[float, float | None]] = Field(description="95 % interval.")


class GearboxResult(Result):
    """Stiffness of gearboxes. The result says nothing about the structure behind the encoders."""

    assessment: Assessment
    gearboxes: list[GearboxStiffness]
    not_observed: list[Name] = Field(description="Joints that were not read by two encoders.")
    mass_uncertainty: Kilograms[float | None] = Field(
        description="Standard uncertainty of the mass, as used in the fit; null for logs."
    )
    point_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of each coordinate of the load's position in the fit; null for "
        "logs."
    )
    residuals: list[StepResidual]
    by_log: list[LogEstimate] = Field(
        default_factory=list, description="Result of each log alone; empty if there is only one log."
    )
    findings: list[Finding]

    @property
    def summary(self) -> ResultSummary:
        """Summary of the result for listings."""
        return ResultSummary(
            verdict=self.assessment.verdict,
            warning_count=sum(not finding.is_remark for finding in self.findings),
        )


class Gearbox(Job):
    """A stored identification of gearboxes."""

    collection: ClassVar[str] = "gearboxes"

    kind: Literal["gearbox"] = "gearbox"
    name: Name
    request: GearboxRequest
    result: GearboxResult | None = Field(description="Present if the job succeeded.")
