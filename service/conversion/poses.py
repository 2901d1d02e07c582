"""Conversion of poses of a tool, as matrices or in six numbers, to positions and rotation vectors."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.service.conversion.arrays import read_numbers
from jointstiff.service.conversion.units import ANGLE
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError

_ROTATION_TOLERANCE: Final = 3e-4
"""Greatest difference between RᵀR and the identity: numbers rounded to four decimals have up to 1.7e-4."""
_LAST_ROW: Final = np.array([0.0, 0.0, 0.0, 1.0])


def read_poses(value: Any, name: str, angle: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Return poses (N, 6), X, Y, Z and rotation vector, from poses (N, 6) or matrices (N, 4, 4).

    Args:
        value: the poses; lengths keep their unit.
        name: name of the argument, for messages.
        angle: unit of rotation vectors.

    Raises:
        MeasurementError: the value has elements that are not numbers.
        RequestError: the array has another shape, or a matrix is no pose.
    """
    array = read_numbers(value, name)
    if array.ndim == 2 and array.shape[1] == 6:
        return array
    if array.shape[1:] != (4, 4):
        raise RequestError(
            f"`{name}` has shape {array.shape}",
            where=name,
            remedy="give poses (N, 4, 4), or (N, 6) with X, Y, Z and rotation vector",
        )
    _refuse_bad_matrices(array, name)
    rotation = Rotation.from_matrix(array[:, :3, :3]).as_rotvec() / ANGLE[angle]
    return np.concatenate([array[:, :3, 3], rotation], axis=1)


def read_frame(value: Any, name: str, angle: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Return a frame (6,), X, Y, Z and rotation vector, from six numbers or a matrix (4, 4).

    Raises:
        MeasurementError: the value has elements that are not numbers.
        RequestError: the array has another shape, or the matrix is no pose.
    """
    array = read_numbers(value, name)
    if array.shape not in {(6,), (4, 4)}:
        raise RequestError(
            f"`{name}` has shape {array.shape}",
            where=name,
            remedy="give a matrix (4, 4), or six numbers: X, Y, Z and rotation vector",
        )
    return np.asarray(read_poses(array[None], name, angle)[0])


def _refuse_bad_matrices(matrices: FloatArray, name: str) -> None:
    """Refuse matrices (N, 4, 4) that are not those of a rotation and a shift.

    Raises:
        RequestError: names the first row with a fault; `name` is the argument with the matrices.
    """
    rotations = matrices[:, :3, :3]
    is_known = np.isfinite(rotations).all(axis=(1, 2))
    if not is_known.all():
        raise RequestError(
            f"the matrix of row {int(np.argmin(is_known)) + 1} has a missing or infinite number",
            where=name,
            remedy="give a number in each row, or leave the row out",
        )
    is_pose = (matrices[:, 3] == _LAST_ROW).all(axis=1)
    if not is_pose.all():
        raise RequestError(
            f"the matrix of row {int(np.argmin(is_pose)) + 1} has another last row than 0, 0, 0, 1",
            where=name,
            remedy="give matrices whose last row is 0, 0, 0, 1; others may be transposed",
        )
    error = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2))
    is_rotation = (error <= _ROTATION_TOLERANCE) & (np.linalg.det(rotations) > 0.0)
    if not is_rotation.all():
        row = int(np.argmin(is_rotation))
        raise RequestError(
            f"the matrix of row {row + 1} is not a rotation: RᵀR differs from the identity by "
            f"{error[row]:.2g}, or its determinant is -1",
            where=name,
            remedy="give rotations to four decimals or more, without a scale, whose columns are the axes of "
            "a right-handed frame",
        )
