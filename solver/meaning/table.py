"""Tables of numbers, and the meaning that a reading gives to their columns and rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray

AngleUnit = Literal["deg", "rad"]
LengthUnit = Literal["m", "mm", "cm", "in"]
RowOrder = Literal["rows", "in turn", "in blocks"]
"""Order of the rows of a table that has several rows for each posture.

*rows*: one row for each posture. *in turn*: the rows of a posture follow each other. *in blocks*: the table
has a block of all postures, then the next block.
"""

_MOST_DECIMALS = 5
"""Decimals up to which rounding moves a position by more than a tracker's noise."""
_ARITHMETIC = 1e-4
"""Error of a number of rounding steps by binary arithmetic."""
METRES: dict[LengthUnit, float] = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254}
"""Unit of length → its size [m]."""


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers of a file, as they are written there."""

    name: str  #: name of the file
    numbers: FloatArray  #: (N, m) in the unknown units of the file; NaN for a cell without a number

    @property
    def size(self) -> tuple[int, int]:
        """Number of rows and columns."""
        rows, columns = self.numbers.shape
        return rows, columns


@dataclass(frozen=True)
class RowGroups:
    """Rows of a table for postures: `count` rows for each posture, in an order."""

    order: RowOrder = "rows"
    count: int = 1  #: rows for each posture

    def split(self, numbers: FloatArray) -> FloatArray:
        """Return rows (N · count, m) of a table by posture, as an array (N, count, m)."""
        rows, columns = numbers.shape
        postures = rows // self.count
        if self.order == "in blocks":
            blocks = numbers.reshape(self.count, postures, columns)
            return blocks.swapaxes(0, 1)
        return numbers.reshape(postures, self.count, columns)


@dataclass(frozen=True, eq=False)
class JointCounting:
    """Way in which a controller counts its joints: q = M q_c + o."""

    name: str  #: words for people, such as `as the maker counts`
    matrix: FloatArray  #: M (n, n)
    offset: FloatArray  #: o (n,) [rad or m]
    is_own: bool = False  #: whether the robot's document states this way


@dataclass(frozen=True, eq=False)
class JointColumns:
    """Columns of a table that are the joints."""

    table: str  #: name of the table
    columns: tuple[int, ...]  #: from base to flange
    unit: AngleUnit  #: of revolute joints; prismatic joints have the unit of the positions
    counting: JointCounting
    groups: RowGroups = RowGroups()


@dataclass(frozen=True)
class PointColumns:
    """Columns of a table that are x, y and z of targets."""

    table: str  #: name of the table
    columns: tuple[int, int, int]
    groups: RowGroups = RowGroups()

    @property
    def step(self) -> int:
        """Distance of the columns of x and y: 1 for neighbours."""
        return abs(self.columns[1] - self.columns[0])

    def overlaps(self, other: PointColumns) -> bool:
        """Return whether two triples share a column."""
        return self.table == other.table and bool(set(self.columns) & set(other.columns))


def find_rounding(numbers: FloatArray, most_decimals: int = _MOST_DECIMALS) -> float:
    """Return the step to which all numbers were rounded, such as 0.01; 0 if they have more decimals.

    Numbers that are not finite do not count.
    """
    known = numbers[np.isfinite(numbers)]
    for decimals in range(most_decimals + 1):
        step = 10.0**-decimals
        steps = known / step
        if np.abs(steps - np.round(steps)).max(initial=0.0) < _ARITHMETIC:
            return step
    return 0.0


def find_moving_columns(numbers: FloatArray) -> list[bool]:
    """Return for each column (N, m) whether its numbers differ."""
    is_number = np.isfinite(numbers)
    with np.errstate(invalid="ignore"):
        least = np.where(is_number, numbers, np.inf).min(axis=0)
        greatest = np.where(is_number, numbers, -np.inf).max(axis=0)
        rounding = 1e-9 * (1.0 + np.maximum(np.abs(least), np.abs(greatest)))
        is_moving = (greatest - least > rounding) & is_number.any(axis=0)
    return [bool(column_is_moving) for column_is_moving in is_moving]
