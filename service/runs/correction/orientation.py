"""Orientations of poses in columns: rotation vectors, Euler angles or quaternions."""

from __future__ import annotations

from collections.abc import Set
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.units import ANGLE
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError

ROTATION_VECTOR: Final = ("rx", "ry", "rz")
EULER_ANGLES: Final = ("a", "b", "c")  # about z, y', x''
QUATERNION: Final = ("q1", "q2", "q3", "q4")  # scalar first
ORIENTATIONS: Final = (ROTATION_VECTOR, EULER_ANGLES, QUATERNION)


def choose_orientation(names: Set[str]) -> tuple[str, ...]:
    """Return the columns that state the orientation.

    Raises:
        RequestError: columns of two forms are stated.
    """
    stated = [each for each in ORIENTATIONS if not names.isdisjoint(each)]
    if len(stated) > 1:
        raise RequestError(
            "the orientation is stated twice",
            where="columns",
            remedy="give either rx, ry, rz, or a, b, c, or q1 to q4",
        )
    return stated[0] if stated else ROTATION_VECTOR


def read_orientation(names: tuple[str, ...], numbers: FloatArray, units: Units) -> FloatArray:
    """Return rotations (N, 3, 3) from columns of numbers.

    Raises:
        RequestError: a quaternion is zero.
    """
    if names == QUATERNION:
        if not np.linalg.norm(numbers, axis=1).all():
            raise RequestError("a quaternion is zero", where="columns.q1", remedy="give unit quaternions")
        return np.asarray(Rotation.from_quat(numbers, scalar_first=True).as_matrix())
    radians = ANGLE[units.angle] * numbers
    if names == EULER_ANGLES:
        return np.asarray(Rotation.from_euler("ZYX", radians).as_matrix())
    return np.asarray(Rotation.from_rotvec(radians).as_matrix())


def write_orientation(names: tuple[str, ...], rotations: FloatArray, units: Units) -> FloatArray:
    """Return the numbers (N, 3 or 4) of rotations (N, 3, 3) for columns; NaN where a rotation is NaN."""
    known = np.isfinite(rotations[:, 0, 0])
    numbers = np.full((len(rotations), len(names)), np.nan)
    rotation = Rotation.from_matrix(rotations[known])
    if names == QUATERNION:
        numbers[known] = rotation.as_quat(canonical=True, scalar_first=True)
    elif names == EULER_ANGLES:
        numbers[known] = rotation.as_euler("ZYX") / ANGLE[units.angle]
    else:
        numbers[known] = rotation.as_rotvec() / ANGLE[units.angle]
    return numbers
