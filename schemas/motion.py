"""Logs of a robot's motion: angles of both encoders over time, and what the motors carry."""

from __future__ import annotations

from typing import Annotated

from pydantic import FailFast, Field, model_validator

from jointstiff.schemas.fields import (
    CubicMetres,
    Dimensionless,
    Inertia,
    Kilograms,
    Message,
    Metres,
    Name,
    Pascals,
    Quantity,
    Seconds,
    SquareMetres,
    Vector3,
)
from jointstiff.schemas.robot import MAX_JOINTS, Body

MAX_LOGS = 10
MAX_SAMPLES = 100_000
"""Largest number of samples of one log."""
LEAST_SAMPLES = 100
LEAST_DURATION = 2.0
"""Least duration of a log [s]: shorter ones say less than their smoothing takes away."""
MAX_LINK_ENCODERS = 8
MAX_BODIES = 16

_Tolerance = Annotated[float, Field(strict=True, ge=0.0, lt=1.0)]
_Samples = Annotated[list[Quantity], Field(min_length=LEAST_SAMPLES, max_length=MAX_SAMPLES), FailFast()]


class MovingBody(Body):
    """A body that a joint carries in motion."""

    mass_uncertainty: Dimensionless[_Tolerance] = Field(
        default=0.1, description="Relative half-width of the range of the mass: 0.1 is ± 10 %."
    )
    inertia: Inertia[tuple[float, float, float, float, float, float]] = Field(
        default=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        description="Inertia Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass, in the frame of "
        "`centre`; default: a point mass.",
    )


class CarriedLoad(Message):
    """Load that is at the flange during the motion, with the tool."""

    mass: Kilograms[Annotated[float, Field(strict=True, ge=0.0, le=1e4)]]
    mass_uncertainty: Dimensionless[_Tolerance] = Field(
        default=0.05, description="Relative half-width of the range of the mass: 0.05 is ± 5 %."
    )
    point: Vector3 = Field(description="Centre of mass in the flange frame, in units.length.")
    point_uncertainty: Annotated[float, Field(strict=True, ge=0.0, le=1e4)] | None = Field(
        default=None,
        description="Radius of the ball that contains the centre, in units.length; if absent, 10 mm.",
    )


class GasSpring(Message):
    """Gas spring that balances a joint and pulls a point behind the joint towards a point before the joint.

    The gas has a constant temperature, and the greatest volume at the shortest length of the spring.
    """

    joint: Name = Field(examples=["joint_2"])
    radius_before: Metres[Annotated[float, Field(strict=True, gt=0.0, le=10.0)]] = Field(
        description="Distance from the joint's axis to the end of the spring that is mounted before the "
        "joint."
    )
    radius_behind: Metres[Annotated[float, Field(strict=True, gt=0.0, le=10.0)]] = Field(
        description="Distance from the joint's axis to the end of the spring that moves with the joint."
    )
    angle: Quantity = Field(
        description="Angle about the joint's axis from the fixed end to the moving end at joint position "
        "0 of the model, in units.angle."
    )
    area: SquareMetres[Annotated[float, Field(strict=True, gt=0.0, le=1.0)]] = Field(
        description="Area on which the gas acts: area of the piston less area of the rod."
    )
    pressure: Pascals[Annotated[float, Field(strict=True, gt=0.0, le=1e9)]] = Field(
        description="Pressure of the gas at the greatest volume."
    )
    volume: CubicMetres[Annotated[float, Field(strict=True, gt=0.0, le=1.0)]] = Field(
        description="Greatest volume of the gas."
    )
    pressure_uncertainty: Dimensionless[_Tolerance] = Field(
        default=0.1, description="Relative half-width of the range of the pressure: 0.1 is ± 10 %."
    )


class MotionLog(Message):
    """Angles of one motion at equal intervals of time."""

    label: Name = Field(description="Label, unique among the logs.", examples=["log A"])
    period: Seconds[Annotated[float, Field(strict=True, ge=1e-5, le=0.02)]] = Field(
        description="Interval between two samples."
    )
    motor: dict[Name, _Samples] = Field(
        min_length=1,
        max_length=MAX_JOINTS,
        description="Motor angles by joint name, divided by the gear ratio, as the controller shows the "
        "joint, in units.angle or units.length. All joints of the robot are needed.",
    )
    link: dict[Name, _Samples] = Field(
        min_length=1,
        max_length=MAX_LINK_ENCODERS,
        description="Angles of the encoder behind the gearbox of each joint, by joint name, in units.angle.",
    )

    @model_validator(mode="after")
    def _require_equal_lengths(self) -> MotionLog:
        encoders = {f"motor of {name}": samples for name, samples in self.motor.items()}
        encoders |= {f"link of {name}": samples for name, samples in self.link.items()}
        shortest = min(encoders, key=lambda name: len(encoders[name]))
        longest = max(map(len, encoders.values()))
        if len(encoders[shortest]) < longest:
            raise ValueError(
                f"the {shortest} has {len(encoders[shortest])} samples, but other encoders have {longest}: "
                "give one sample of each encoder at each time"
            )
        return self

    @model_validator(mode="after")
    def _require_duration(self) -> MotionLog:
        duration = self.period * len(next(iter(self.motor.values())))
        if duration < LEAST_DURATION:
            raise ValueError(
                f"the log takes {duration:.3g} s, which is too short: log at least {LEAST_DURATION:g} s, "
                "better 10 s"
            )
        return self


class Motion(Message):
    """Logs of a robot in motion, with the bodies that the motors carry."""

    logs: Annotated[list[MotionLog], Field(min_length=1, max_length=MAX_LOGS), FailFast()]
    payload: CarriedLoad
    bodies: Annotated[list[MovingBody], Field(min_length=1, max_length=MAX_BODIES)] | None = Field(
        default=None,
        description="Bodies of the arm without the load; default: the bodies of the robot as point masses.",
    )
    gas_springs: Annotated[list[GasSpring], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list, description="Gas springs that balance joints."
    )
    start: Annotated[list[Quantity], Field(max_length=MAX_JOINTS)] | None = Field(
        default=None,
        description="Joint positions shown by the controller when all logged angles are zero, in "
        "units.angle or units.length; default: zero.",
    )
    gear_periods: dict[
        Name, Annotated[list[Annotated[float, Field(strict=True, ge=1.0, le=1e5)]], Field(max_length=8)]
    ] = Field(
        default_factory=dict,
        description="Periods of each joint's gearbox error per turn of the joint, by joint name.",
    )

    @model_validator(mode="after")
    def _require_unique_labels(self) -> Motion:
        labels = [log.label for log in self.logs]
        repeated = [label for label in labels if labels.count(label) > 1]
        if repeated:
            raise ValueError(f"two logs have the label '{repeated[0]}': give each log a different label")
        for number, log in enumerate(self.logs):
            for other in self.logs[:number]:
                if (log.motor, log.link) == (other.motor, other.link):
                    raise ValueError(
                        f"'{other.label}' and '{log.label}' are the same log: give each log once"
                    )
        return self
