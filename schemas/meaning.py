"""The meaning of the columns of files that a robot proposed and a person accepted, as a template keeps it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import Message
from jointstiff.schemas.imports import ImportRequest, State
from jointstiff.schemas.measurement import AngleUnit

RowOrder = Literal["rows", "in turn", "in blocks"]


class JointsMeaning(Message):
    """Columns of the joints."""

    file: int = Field(description="Number of the table among all tables of the files, from 1.")
    columns: list[int] = Field(
        description="Numbers of the columns of the joints from base to flange; the first column is 1."
    )
    unit: AngleUnit = Field(description="Unit of revolute joints.")
    counting: str = Field(description="Way in which the controller counts its joints.")
    order: RowOrder = Field(description="Order in which the table lists the rows of a posture.")
    count: int = Field(description="Rows of a posture.")


class PointsMeaning(Message):
    """Columns of the positions of a target in a state."""

    file: int = Field(description="Number of the table among all tables of the files, from 1.")
    columns: list[int] = Field(description="Numbers of the columns of x, y and z; the first column is 1.")
    order: RowOrder = Field(description="Order in which the table lists the rows of a posture.")
    count: int = Field(description="Rows of a posture.")
    row: int = Field(description="Number of the row among the rows of a posture, from 1.")
    target: str = Field(description="Name of the target.")
    state: State = Field(description="State of the target.")


class TableMeaning(Message):
    """Meaning of the columns of files, with the residual of the robot."""

    robot: str = Field(description="Name of the robot whose kinematics fits the columns.")
    joints: JointsMeaning = Field(description="Columns of the joints.")
    points: list[PointsMeaning] = Field(description="Columns of the positions.")
    unit: Literal["m", "mm", "cm", "in"] = Field(description="Unit of the positions.")
    residual: float = Field(
        description="Median distance between the positions in the table and the positions by the robot's "
        "kinematics, in m."
    )


class ImportTemplate(ImportRequest):
    """Options of an import, and the meaning of columns that names do not explain."""

    meaning: TableMeaning | None = Field(
        default=None,
        description="Meaning that the robot's kinematics proposes; null if names explain all columns.",
    )
