"""Positions of a robot's joints in given configurations, for drawing."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Metres,
    Name,
    Point,
    Quantity,
    Radians,
    Square3,
)
from jointstiff.schemas.robot import MAX_JOINTS, RobotDocument

MAX_POSTURES = 1_000


class KinematicsRequest(Message):
    """A robot, stored or not, and configurations of it."""

    robot_id: Identifier | None = Field(default=None, description="Id of a stored robot; or give `robot`.")
    robot: RobotDocument | None = Field(
        default=None, description="Robot document that is not stored, to preview it."
    )
    joints: Radians[
        Annotated[
            list[Annotated[list[Quantity], Field(max_length=MAX_JOINTS)]], Field(max_length=MAX_POSTURES)
        ]
    ] = Field(
        default_factory=list,
        description="Joint angles as displayed by the controller, one list per configuration; default: all "
        "zeros.",
    )

    @model_validator(mode="after")
    def _one_robot(self) -> KinematicsRequest:
        if (self.robot_id is None) == (self.robot is None):
            raise ValueError("give either `robot_id` or `robot`")
        return self


class Posture(Message):
    """One configuration, axes of R0."""

    joint_origins: Metres[list[Point]] = Field(
        description="Origins of the joints' frames, from base to flange."
    )
    joint_axes: Dimensionless[list[Point]] = Field(
        description="Unit vectors along the joints' axes. Dimensionless."
    )
    flange_origin: Metres[Point]
    flange_axes: Dimensionless[Square3] = Field(
        description="Unit vectors of the flange's x, y and z axes. Dimensionless."
    )


class Kinematics(Message):
    """A robot in some configurations."""

    joints: list[Name] = Field(description="Names of the joints.")
    postures: list[Posture]
