"""Readings along a direction as arrays: stored beside the others, in the units of their set."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jointstiff.schemas.measurement import Reading
from jointstiff.service.conversion.array_group import ArrayGroup
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot


@dataclass(frozen=True, eq=False)
class Directions(ArrayGroup):
    """Readings along a direction of N observations of T targets; zero where a reading is of another kind."""

    prefix = "direction_"

    displacement: FloatArray  # (N, T) loaded minus unloaded, along the direction
    vector: FloatArray  # (N, T, 3) direction as posted, of any length
    in_flange: BoolArray  # (N, T) whether it was posted in the flange frame

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], place: tuple[list[int], list[int]], readings: list[Reading]
    ) -> Directions | None:
        """Arrange the readings of shape (N, T) at their observation and target; None if there are none."""
        if all(reading.displacement is None for reading in readings):
            return None
        displacement, vector, in_flange = np.zeros(shape), np.zeros((*shape, 3)), np.zeros(shape, np.bool_)
        displacement[place] = [r.displacement or 0.0 for r in readings]
        vector[place] = [r.direction or r.flange_direction or (0, 0, 0) for r in readings]
        in_flange[place] = [r.flange_direction is not None for r in readings]
        return cls(displacement, vector, in_flange)

    @property
    def present(self) -> BoolArray:
        """(N, T) which readings are along a direction."""
        return np.asarray(self.vector.any(axis=-1))

    def turned(self, R: FloatArray) -> Directions:
        """Return the same with directions that were posted outside the flange frame turned by R (3, 3)."""
        vector = np.where(self.in_flange[..., None], self.vector, self.vector @ R.T)
        return replace(self, vector=vector)

    def fields(self, i: int, t: int) -> dict[str, Any]:
        """Return what a reading posted, by the names of its fields."""
        name = "flange_direction" if self.in_flange[i, t] else "direction"
        return {"displacement": float(self.displacement[i, t]), name: tuple(self.vector[i, t].tolist())}

    def unit_vectors(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """(N, T, 3) directions of length one in R0; zero for readings of another kind.

        Args:
            robot: n joints.
            joints: (N, n) controller angles [rad].
        """
        rotation = Configurations(robot, robot.joint_map.model_angles(joints)).flange_rotation
        vector = np.where(self.in_flange[..., None], self.vector @ rotation.transpose(0, 2, 1), self.vector)
        length = np.linalg.norm(vector, axis=-1, keepdims=True)
        return np.asarray(vector / np.where(length > 0.0, length, 1.0))
