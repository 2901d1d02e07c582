"""Shapes of arms: what the axes of two robots' joints have in common, in whatever frames they are described.

Stiffnesses of two robots can be compared joint by joint only if both are of one model. Two descriptions of a
model may differ in R0, in the flange, in the zero positions of joints and in the signs of axes; calibrated
descriptions also differ by a few mm. The distances and angles between successive axes do not change with any
of these: they are the lengths a, d and the angles α of Denavit and Hartenberg.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

LENGTH_TOLERANCE: Final = 0.01
"""Greatest difference of a length [m] between two arms of one model; calibrations find a few mm."""
ANGLE_TOLERANCE: Final = np.radians(1.0)
"""Greatest difference of an angle between successive axes [rad] between two arms of one model."""
_PARALLEL: Final = np.radians(5.0)
"""Angle between two axes [rad] below which they count as parallel."""


@dataclass(frozen=True)
class Dimension:
    """A length or an angle of an arm."""

    name: str  #: what it is, in words
    size: float  #: [m], or [rad] for an angle
    is_angle: bool = False  #: whether it is an angle


@dataclass(frozen=True)
class OtherDimension:
    """A dimension that differs between two arms by more than arms of one model do."""

    name: str  #: what it is, in words
    first: float  #: of the first arm [m or rad]
    second: float  #: of the second arm [m or rad]
    is_angle: bool  #: whether it is an angle

    @property
    def excess(self) -> float:
        """Difference, relative to the greatest of arms of one model."""
        tolerance = ANGLE_TOLERANCE if self.is_angle else LENGTH_TOLERANCE
        return abs(self.second - self.first) / tolerance


def list_other_dimensions(first: Robot, second: Robot) -> list[OtherDimension]:
    """Return the dimensions that show that two robots are not of one model; those that differ most are first.

    Both robots have the same joints. The list is empty for robots of one model; one of them may be
    calibrated, or described in other frames, or carry another tool.
    """
    differing = list[OtherDimension]()
    sizes_of_second = {each.name: each.size for each in measure_arm(second)}
    for dimension in measure_arm(first):
        # A length without a counterpart is of axes that are parallel in one arm only: their angle differs.
        if dimension.name in sizes_of_second:
            size = sizes_of_second[dimension.name]
            compared = OtherDimension(dimension.name, dimension.size, size, dimension.is_angle)
            if compared.excess > 1.0:
                differing.append(compared)
    return sorted(differing, key=lambda each: each.excess, reverse=True)


def measure_arm(robot: Robot) -> list[Dimension]:
    """Return the dimensions of an arm that depend neither on frames nor on zero positions nor on signs.

    These are the angle and the distance of each two successive axes, and the length along each axis between
    the feet of its two common normals. A sliding joint has a direction, but no place: it has angles alone.
    """
    directions, points = _find_axes(robot)
    names = robot.joint_names
    dimensions = list[Dimension]()
    foot_before: FloatArray | None = None  # on the axis, of the common normal with the axis before
    for i in range(robot.n - 1):
        pair = f"of the axes of {names[i]} and {names[i + 1]}"
        angle = _measure_angle(directions[i], directions[i + 1])
        dimensions.append(Dimension(f"angle {pair}", angle, is_angle=True))
        if robot.prismatic[i] or robot.prismatic[i + 1]:
            foot_before = None
            continue
        foot, next_foot = _find_common_normal(directions[i : i + 2], points[i : i + 2], foot_before)
        dimensions.append(Dimension(f"distance {pair}", float(np.linalg.norm(next_foot - foot))))
        if foot_before is not None:
            along = float(np.linalg.norm(foot - foot_before))
            dimensions.append(Dimension(f"length along the axis of {names[i]}", along))
        # Without a normal before, the foot on parallel axes is any point.
        is_any_point = foot_before is None and angle < _PARALLEL
        foot_before = None if is_any_point else next_foot
    return dimensions


def _find_axes(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Return directions (n, 3) and points (n, 3) of the joints' axes in R0 [m], in some posture."""
    posture = Postures(robot, np.zeros((1, robot.n)))
    rotations, origins = posture.joint_frames
    directions = np.einsum("nij,nj->ni", rotations[0], robot.axes)
    return directions, origins[0]


def _measure_angle(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two lines [rad], from 0 to π/2."""
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), abs(first @ second)))


def _find_common_normal(
    directions: FloatArray, points: FloatArray, foot_before: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the feet (3,) of the common normal of two axes [m], on the first and on the second axis.

    Parallel axes have many common normals: that through the foot of the normal before is returned, so that
    small angles between such axes change the lengths only little.

    Args:
        directions: (2, 3) unit vectors of the axes.
        points: (2, 3) a point of each axis [m].
        foot_before: (3,) foot of the common normal with the axis before, on the first axis; None without one.
    """
    first, second = directions
    normal = np.cross(first, second)
    if _measure_angle(first, second) < _PARALLEL:
        foot = points[0] if foot_before is None else foot_before
        return foot, points[1] + ((foot - points[1]) @ second) * second
    # The feet p₁ + s z₁ and p₂ + t z₂ differ by a multiple of the normal: solve for s, t and the multiple.
    system = np.column_stack([first, -second, normal])
    along_first, along_second, _ = np.linalg.solve(system, points[1] - points[0])
    return points[0] + along_first * first, points[1] + along_second * second
