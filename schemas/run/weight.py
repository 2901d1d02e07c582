"""Stiffness without a load: the options and the numbers of a run that takes the own weight for the load."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from jointstiff.schemas.fields import (
    Dimensionless,
    Message,
    Metres,
    Name,
    Point,
    Radians,
    Torque,
    Vector3,
)
from jointstiff.schemas.robot import MAX_JOINTS

_Bounds = tuple[Annotated[float, Field(strict=True, ge=0.0, le=1e9)], Annotated[float, Field(gt=0.0, le=1e9)]]


class Balancer(Message):
    """A spring between the base and a link, pulled from its free length."""

    joint: Name = Field(description="Name of the joint that carries the spring's further end.")
    on_base: Metres[Vector3] = Field(description="End on the base, in R0.")
    on_link: Metres[Vector3] = Field(
        description="Further end in the frame that moves with the joint (as of a body's centre of mass)."
    )
    rate: _Bounds = Field(description="Least and greatest rate of the spring, in N/m.")
    pull: _Bounds = Field(description="Least and greatest rate times free length, in N.")

    @model_validator(mode="after")
    def _in_order(self) -> Balancer:
        if self.rate[0] > self.rate[1] or self.pull[0] > self.pull[1]:
            raise ValueError("give the least, then the greatest value of `rate` and of `pull`")
        return self


class Weight(Message):
    """Own weight as the load. Geometry of the robot and places of the targets are estimated, too."""

    gravity: Vector3 = Field(
        default=(0.0, 0.0, -9.80665),
        description="Acceleration of gravity in R0, in m/s²; default: along −z of R0.",
    )
    estimate_gravity: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="True to estimate the direction of gravity, as for a tracker that is not levelled.",
    )
    balancers: Annotated[list[Balancer], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list, description="Spring balancers, whose bounds are stated."
    )

    @model_validator(mode="after")
    def _pulls(self) -> Weight:
        if not 1.0 <= sum(part**2 for part in self.gravity) ** 0.5 <= 100.0:
            raise ValueError("gravity must be 1 to 100 m/s²: 9.80665 on the ground")
        return self


class WeightShare(Message):
    """Causes of the width of a joint's interval."""

    joint: Name
    torque: Torque[tuple[float, float]] = Field(
        description="Least and greatest torque of weights and loads about the joint over the observations."
    )
    largest_sag: Radians[float | None] = Field(
        description="Greatest sag of the joint; null without a number."
    )
    readings: Dimensionless[float | None] = Field(
        description="Share of the width of the compliance's interval that exact masses would leave; null "
        "without a number."
    )
    masses: Dimensionless[float | None] = Field(
        description="Share of the interval's width due to the uncertain masses; null without a number."
    )


class WeightResult(Message):
    """Additional results of a run with `weight`."""

    joints: list[WeightShare]
    gravity: Point = Field(description="Acceleration of gravity in R0, in m/s², stated or estimated.")
    rms_without_sag: Metres[float] = Field(
        description="Root mean square of a coordinate's residual for the best geometry without sag."
    )
    rms_residual: Metres[float] = Field(description="Root mean square of a coordinate's residual with sag.")
    steps: int = Field(description="Number of Gauss-Newton steps.")
