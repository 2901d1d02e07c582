"""Where the joints of a robot are in given configurations, for those who draw it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.config import JsonDict

from jointstiff.schemas.fields import Identifier, Message, Name, Quantity
from jointstiff.schemas.robot import MAX_JOINTS, RobotDocument

__all__ = ["Kinematics", "KinematicsRequest", "Posture"]

MAX_POSTURES = 1_000

_LENGTH: JsonDict = {"unit": "m"}
_DIRECTION: JsonDict = {"unit": "1"}

Point = tuple[float, float, float]


class KinematicsRequest(Message):
    """A robot, stored or not, and configurations of it."""

    robot_id: Identifier | None = Field(default=None, description="A stored robot; or give `robot`.")
    robot: RobotDocument | None = Field(
        default=None, description="A robot that is not stored: to see it before it is."
    )
    joints: Annotated[
        list[Annotated[list[Quantity], Field(max_length=MAX_JOINTS)]], Field(max_length=MAX_POSTURES)
    ] = Field(
        default_factory=list,
        description="Angles as the controller shows them, a list a configuration; all zeros if empty.",
        json_schema_extra={"unit": "rad"},
    )

    @model_validator(mode="after")
    def _one_robot(self) -> KinematicsRequest:
        if (self.robot_id is None) == (self.robot is None):
            raise ValueError("give either `robot_id` or `robot`")
        return self


class Posture(Message):
    """One configuration, axes of R0."""

    joint_origins: list[Point] = Field(
        description="Origins of the joints' frames, from base to flange.", json_schema_extra=_LENGTH
    )
    joint_axes: list[Point] = Field(
        description="Unit vectors along the joints' axes. Dimensionless.", json_schema_extra=_DIRECTION
    )
    flange_origin: Point = Field(json_schema_extra=_LENGTH)
    flange_axes: tuple[Point, Point, Point] = Field(
        description="Unit vectors of the flange's x, y and z axes. Dimensionless.",
        json_schema_extra=_DIRECTION,
    )


class Kinematics(Message):
    """A robot in some configurations."""

    joints: list[Name] = Field(description="Names of the joints.")
    postures: list[Posture]
