"""Columns of a request as poses, joints and loads in SI units."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.arrays import read_numbers
from jointstiff.service.conversion.poses import read_poses
from jointstiff.service.conversion.robots import joint_factors
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH
from jointstiff.service.runs.correction.columns import (
    FACTORS,
    FORCES,
    MOMENTS,
    POSITION,
    name_of_header,
)
from jointstiff.service.runs.correction.orientation import (
    ORIENTATIONS,
    ROTATION_VECTOR,
    choose_orientation,
    read_orientation,
)
from jointstiff.service.runs.deflection import parse_unit_factor
from jointstiff.service.runs.verdicts import moment_factor
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot

_MOST_NAMED: Final = 8
"""Most columns that a message names."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Columns of a table of N poses, in SI units."""

    poses: FloatArray  # (N, 4, 4) poses of the tool in the base [m]
    orientation: tuple[str, ...]  # names of the columns with the orientation
    joints: FloatArray | None  # (N, n) controller's joints [rad or m]; None if there are none
    loads: FloatArray | None  # (N, 6) force [N] and moment [N·m]; None if there are none

    @classmethod
    def from_columns(cls, columns: Mapping[str, Any], units: Units, robot: Robot) -> PoseTable:
        """Read the columns of a request: x, y, z, an orientation such as rx, ry, rz; maybe j1 …, fx …, mx ….

        Raises:
            RequestError: columns are missing, unknown, have different lengths, or a number is not finite.
        """
        joint_names = [f"j{number}" for number in range(1, robot.n + 1)]
        names = _fold_names(columns)
        _refuse_unknown_names(names, joint_names, robot)
        orientation = choose_orientation(names.keys())
        _refuse_incomplete_groups(names, orientation, joint_names)
        _refuse_bad_numbers(columns)
        table = _Columns({name: columns[original] for name, original in names.items()})
        poses = np.tile(np.eye(4), (len(table.columns["x"]), 1, 1))
        poses[:, :3, 3] = LENGTH[units.length] * table.stack(POSITION)
        poses[:, :3, :3] = read_orientation(orientation, table.stack(orientation), units)
        joints = None
        if "j1" in names:
            joints = joint_factors(robot, units) * table.stack(joint_names)
        return cls(poses, orientation, joints, table.read_loads(units, len(poses)))


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of a request by their names in small letters, each of N numbers."""

    columns: Mapping[str, Any]

    def stack(self, names: Sequence[str]) -> FloatArray:
        """Return k columns as an array (N, k)."""
        return np.array([self.columns[name] for name in names], dtype=np.float64).T

    def read_loads(self, units: Units, count: int) -> FloatArray | None:
        """Return force and moment (N, 6) [N, N·m]; zero where one has no columns; None if neither has."""
        if "fx" not in self.columns and "mx" not in self.columns:
            return None
        force = np.zeros((count, 3))
        if "fx" in self.columns:
            force = FORCE[units.force] * self.stack(FORCES)
        moment = np.zeros((count, 3))
        if "mx" in self.columns:
            moment = self.stack(MOMENTS)
        return np.concatenate([force, moment_factor(units, moment) * moment], axis=1)


def _refuse_incomplete_groups(
    names: Collection[str], orientation: Sequence[str], joint_names: Sequence[str]
) -> None:
    """Refuse columns without a whole pose, or with a part of a group: joints, fx to fz, or mx to mz.

    Raises:
        RequestError: names the first column that is missing.
    """
    required = [*POSITION, *orientation]
    for group in (joint_names, FORCES, MOMENTS):
        if any(name in names for name in group):
            required += group
    missing = [name for name in required if name not in names]
    if missing:
        raise RequestError(
            f"the column {missing[0]} is missing", where="columns", remedy="give all columns of a group"
        )


def name_poses(value: Any, name: str, units: Units) -> dict[str, FloatArray]:  # noqa: ANN401 - as of `read_poses`
    """Return the columns of poses by name, from arrays (N, 4, 4) or (N, 6), or from named columns.

    Args:
        value: the poses. The columns of a data frame, or of a mapping, are read by their names.
        name: name of the argument, for messages.
        units: units of the poses, unless names have units, such as `x [mm]`.

    Raises:
        MeasurementError: the value has elements that are not numbers.
        RequestError: the array has another shape, a matrix is no pose, or a name is not known.
    """
    headers = list(value if isinstance(value, Mapping) else getattr(value, "columns", ()))
    if headers and all(isinstance(header, str) for header in headers):
        return _read_named_columns(value, headers, name, units)
    return dict(zip((*POSITION, *ROTATION_VECTOR), read_poses(value, name, units.angle).T, strict=True))


def _read_named_columns(
    value: Any,  # noqa: ANN401 - a data frame, or a mapping
    headers: Sequence[str],
    name: str,
    units: Units,
) -> dict[str, FloatArray]:
    """Return the columns of poses by name, from columns with headers.

    Raises:
        MeasurementError: a column has elements that are not numbers.
        RequestError: the names are not those of poses.
    """
    names = [name_of_header(header) for header in headers]
    if not any(sorted(names) == sorted((*POSITION, *each)) for each in ORIENTATIONS):
        raise RequestError(
            f"the columns of `{name}` are {', '.join(headers[:_MOST_NAMED])}, not those of poses",
            where=name,
            remedy="give only columns x, y, z, and rx, ry, rz for a rotation vector or a, b, c for angles "
            "of KUKA; or an array (N, 6) of X, Y, Z and rotation vector, such as frame.to_numpy()",
        )
    columns = dict[str, FloatArray]()
    for column, header in zip(names, headers, strict=True):
        numbers = read_numbers(value[header], f"{name}[{header!r}]")
        if "[" in header:
            quantity = "length" if column in POSITION else "angle"
            own = LENGTH[units.length] if column in POSITION else ANGLE[units.angle]
            numbers = numbers * (parse_unit_factor(header, FACTORS[quantity]) / own)
        columns[column] = numbers
    return columns


def _fold_names(columns: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of columns by the same names in small letters.

    Raises:
        RequestError: two names differ only in capitals.
    """
    names = dict[str, str]()
    for name in columns:
        if name.lower() in names:
            raise RequestError(
                f"the column {name[:40]!r} occurs twice", where="columns", remedy="give each column once"
            )
        names[name.lower()] = name
    return names


def _refuse_unknown_names(names: Mapping[str, str], joint_names: Sequence[str], robot: Robot) -> None:
    """Refuse a column with another name than those of poses, joints and loads.

    Raises:
        RequestError: names the column.
    """
    known = {*POSITION, *FORCES, *MOMENTS, *joint_names}
    known.update(*ORIENTATIONS)
    for name in names:
        if name not in known:
            raise RequestError(
                f"the column {name[:40]!r} is not known",
                where="columns",
                remedy=f"use x, y, z, rx, ry, rz, j1 to j{robot.n} or the names of the joints, fx, fy, "
                "fz, mx, my, mz",
            )


def _refuse_bad_numbers(columns: Mapping[str, Any]) -> None:
    """Refuse columns of different lengths, and numbers that are not finite.

    Raises:
        RequestError: names the column.
    """
    if len({len(each) for each in columns.values()}) > 1:
        raise RequestError(
            "the columns have different lengths", where="columns", remedy="give each row in each column"
        )
    for name, column in columns.items():
        is_number = np.isfinite(np.asarray(column, dtype=np.float64))
        if not is_number.all():
            raise RequestError(
                f"row {int(np.argmin(is_number)) + 1} of column {name} contains a missing or infinite number",
                where="columns",
                remedy="give a number in each row, or leave the row out",
            )
