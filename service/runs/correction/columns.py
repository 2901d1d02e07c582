"""Names and units of the columns of corrected poses: of requests, of files, and of answers."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from jointstiff.schemas.correction import MAX_COLUMNS, MAX_TABLE_ROWS
from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.runs.correction.orientation import EULER_ANGLES, QUATERNION, ROTATION_VECTOR
from jointstiff.service.runs.deflection import parse_unit_factor
from jointstiff.service.runs.verdicts import moment_factor
from jointstiff.service.tables.reading import LABEL, TableLimits
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot

POSITION: Final = ("x", "y", "z")
FORCES: Final = ("fx", "fy", "fz")
MOMENTS: Final = ("mx", "my", "mz")
DEFLECTION: Final = ("dx", "dy", "dz")
STATUS: Final = "status"
ANSWERED: Final = frozenset({STATUS, *DEFLECTION, "readings", "model_error", "residual", "joint_speed"})
"""Columns of an answer that a request does not have."""
TABLE_LIMITS: Final = TableLimits(MAX_TABLE_ROWS, MAX_COLUMNS)
"""Limits of a file that a service corrects."""
_LENGTHS: Final = frozenset({*POSITION, *DEFLECTION, "readings", "model_error", "residual"})
_ANGLES: Final = frozenset({*ROTATION_VECTOR, *EULER_ANGLES})
FACTORS: Final = MappingProxyType({"length": LENGTH, "angle": ANGLE, "force": FORCE, "moment": MOMENT})
"""Quantity → unit of its headers → factor to SI units."""


def convert_headers(columns: Mapping[str, Any], units: Units, robot: Robot) -> dict[str, FloatArray]:
    """Return columns by their names in the API and in `units`, from columns with units in their headers.

    Raises:
        RequestError: a header has no unit, or another quantity's.
    """
    converted = dict[str, FloatArray]()
    joint_columns = find_joint_columns([name_of_header(header) for header in columns], robot)
    own = {"length": LENGTH[units.length], "angle": ANGLE[units.angle], "force": FORCE[units.force]}
    for header, column in columns.items():
        name = joint_columns.get(name_of_header(header), name_of_header(header))
        numbers = np.asarray(column, dtype=np.float64)
        quantity = _find_quantity(name, robot)
        if quantity == "moment":
            own[quantity] = moment_factor(units, numbers)
        if quantity is not None:
            numbers = numbers * (parse_unit_factor(header, FACTORS[quantity]) / own[quantity])
        converted[name] = numbers
    return converted


def name_joint_columns(columns: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """Return columns in which the robot's own names of joints are replaced by j1 to jn.

    Raises:
        RequestError: a joint has two columns.
    """
    joint_columns = find_joint_columns(list(columns), robot)
    return {joint_columns.get(name.lower(), name): column for name, column in columns.items()}


def find_joint_columns(names: Sequence[str], robot: Robot) -> dict[str, str]:
    """Return the robot's own names of joints that are columns, in small letters → j1 to jn.

    For a robot with joints `shoulder` and `elbow`: ["x", "Shoulder"] → {"shoulder": "j1"}. An own name that
    may also be another column, such as `x`, is not translated. Own names `j0` to `j5` could mean other joints
    than the standard names `j1` to `j6`: they count only if all of them are columns.

    Raises:
        RequestError: a joint has two columns.
    """
    given = {name.lower() for name in names}
    numbered = [f"j{number}" for number in range(1, robot.n + 1)]
    own_names = [name.lower() for name in robot.joint_names]
    reserved = {*POSITION, *ROTATION_VECTOR, *EULER_ANGLES, *QUATERNION, *FORCES, *MOMENTS}
    if not given.issuperset(own_names):
        reserved.update(numbered)
    found = dict[str, str]()
    for name, column in zip(own_names, numbered, strict=True):
        if name in given and name not in reserved:
            found[name] = column
    _refuse_repeated_joint(found, given)
    return found


def _refuse_repeated_joint(column_of_name: Mapping[str, str], given: Collection[str]) -> None:
    """Refuse a joint that has a column by its own name and another column by its standard name, such as j1.

    Raises:
        RequestError: names both columns.
    """
    for name, column in column_of_name.items():
        if column in given and column not in column_of_name:
            raise RequestError(
                f"the columns {name!r} and {column!r} state the same joint",
                where="columns",
                remedy="give each joint once",
            )


def name_of_header(header: str) -> str:
    """Return the name in a header, without its unit, in small letters."""
    return header.partition("[")[0].strip().lower()


def _find_quantity(name: str, robot: Robot) -> str | None:
    """Return the quantity in a column; None if its numbers have no unit."""
    joint = re.fullmatch(r"j(\d+)", name)
    if joint is not None:
        number = int(joint[1])
        is_prismatic = 1 <= number <= robot.n and robot.prismatic[number - 1]
        return "length" if is_prismatic else "angle"
    if name in POSITION:
        return "length"
    if name in _ANGLES:
        return "angle"
    if name in FORCES:
        return "force"
    return "moment" if name in MOMENTS else None


def make_sheet(columns: Mapping[str, Any], units: Units, prismatic: Sequence[bool]) -> Sheet:
    """Return the columns of a request or of an answer as a sheet whose headers have units.

    `prismatic` tells for each joint whether it is prismatic.
    """
    headers = dict[str, Any]()
    for name, column in columns.items():
        is_joint = re.fullmatch(r"j\d+", name) is not None
        title = name.upper() if is_joint else name.replace("_", " ")
        unit = _find_unit(name, units, prismatic)
        headers[f"{title} [{unit}]" if unit else title] = column
    return Sheet(headers, texts=frozenset({STATUS, LABEL} & columns.keys()), digits=".10g")


def _find_unit(name: str, units: Units, prismatic: Sequence[bool]) -> str:
    """Return the unit of the numbers in a column; empty if they have no unit."""
    joint = re.fullmatch(r"j(\d+)", name)
    if joint is not None:
        return units.length if prismatic[int(joint[1]) - 1] else units.angle
    if name in _LENGTHS:
        return units.length
    if name in _ANGLES:
        return units.angle
    if name in FORCES:
        return units.force
    if name in MOMENTS:
        return units.moment or f"{units.force}.m"
    return f"{units.angle}/s" if name == "joint_speed" else ""
