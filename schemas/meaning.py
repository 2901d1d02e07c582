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
    columns: list[int] = Field(description="Numbers of the columns, from 1, from base to flange.")
    unit: AngleUnit = Field(description="Unit of revolute joints.")
    counting: str = Field(description="Way in which the controller counts its joints.")
    order: RowOrder = Field(description="Order of the rows of a posture.")
    count: int = Field(description="Rows of a posture.")


class PointsMeaning(Message):
    """Columns of the positions of a target in a state."""

    file: int = Field(description="Number of the table among all tables of the files, from 1.")
    columns: list[int] = Field(description="Numbers of the columns of x, y and z, from 1.")
    order: RowOrder = Field(description="Order of the rows of a posture.")
    count: int = Field(description="Rows of a posture.")
    row: int = Field(description="Number of the row of a posture, from 1.")
    target: str = Field(description="Name of the target.")
    state: State = Field(description="State of the target.")


class TableMeaning(Message):
    """Meaning of the columns of files, with the residual of the robot."""

    robot: str = Field(description="Name of the robot that fitted.")
    joints: JointsMeaning = Field(description="Columns of the joints.")
    points: list[PointsMeaning] = Field(description="Columns of the positions.")
    unit: Literal["m", "mm", "cm", "in"] = Field(description="Unit of the positions.")
    residual: float = Field(
        description="Median distance of the positions from their places by the robot, in m."
    )


class ImportTemplate(ImportRequest):
    """Options of an import, and the meaning of columns that names do not explain."""

    meaning: TableMeaning | None = Field(
        default=None, description="Meaning that a robot proposed; null if names explain all columns."
    )
