"""Map the controller's joint angles to the model's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import MAX_MOVING_JOINTS

LARGEST_MAP_ENTRY = 1e3
"""Largest entry of a joint map's matrix [rad/rad] or offset [rad]."""

WORST_CONDITION = 1e8
"""Condition number of a joint map's matrix above which it counts as singular."""


@dataclass(frozen=True, eq=False)
class JointMap:
    """Map controller angles q_c to model angles q = M q_c + o (method.md §1).

    Arrays are copied and read-only.

    Raises:
        RobotError: a matrix that is not square, not of the offset's size, not finite, absurdly
            large, or singular.
    """

    matrix: FloatArray  #: M (n, n), dimensionless
    offset: FloatArray  #: o (n,) [rad]

    def __post_init__(self) -> None:
        matrix = _frozen(self.matrix, 2, "joint_map.matrix")
        offset = _frozen(self.offset, 1, "joint_map.offset")
        n = len(offset)
        if not 1 <= n <= MAX_MOVING_JOINTS or matrix.shape != (n, n):
            raise RobotError(
                f"the matrix has shape {matrix.shape}, the offset {n} numbers",
                remedy="give an n × n matrix and n offsets; n is the number of moving joints, at most "
                f"{MAX_MOVING_JOINTS}",
                where="joint_map.matrix",
            )
        singular = np.linalg.svd(matrix, compute_uv=False)  # descending
        if singular[-1] * WORST_CONDITION < max(singular[0], 1.0):
            raise RobotError(
                "the matrix is singular: different controller angles give the same model angles",
                remedy="give an invertible matrix",
                where="joint_map.matrix",
            )
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "offset", offset)

    @classmethod
    def identity(cls, n: int) -> JointMap:
        """Return the map for n joints whose controller angles are the model's."""
        return cls(np.eye(n), np.zeros(n))

    @classmethod
    def from_rows(cls, matrix: Sequence[Sequence[float]], offset: Sequence[float]) -> JointMap:
        """Build the map from rows that a request gave.

        Raises:
            RobotError: rows of different lengths, or anything that the class refuses.
        """
        lengths = {len(row) for row in matrix}
        if lengths != {len(matrix)}:
            raise RobotError(
                f"the matrix has {len(matrix)} rows of {' or '.join(map(str, sorted(lengths))) or 'no'} "
                "numbers",
                remedy="give a square matrix",
                where="joint_map.matrix",
            )
        return cls(np.array(matrix, dtype=np.float64), np.array(offset, dtype=np.float64))

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.offset)

    def model_angles(self, controller: FloatArray) -> FloatArray:
        """Map controller angles (N, n) to model angles (N, n), both in rad."""
        angles: FloatArray = controller @ self.matrix.T + self.offset
        return angles

    def controller_angles(self, model: FloatArray) -> FloatArray:
        """Return the angles (..., n) that the controller shows [rad] of angles of the model [rad]."""
        wanted = (model - self.offset).reshape(-1, self.n)  # columns of one system: factorised once
        angles: FloatArray = np.asarray(np.linalg.solve(self.matrix, wanted.T)).T.reshape(model.shape)
        return angles


def _frozen(values: FloatArray, dimensions: int, where: str) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.ndim != dimensions or not (np.abs(array) <= LARGEST_MAP_ENTRY).all():
        raise RobotError(
            f"it has {array.ndim} dimensions, or a number that is not finite",
            remedy=f"give numbers within ±{LARGEST_MAP_ENTRY:g} in {dimensions} dimensions",
            where=where,
        )
    array.flags.writeable = False
    return array
