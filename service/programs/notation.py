"""Notation of a target: its numbers to a pose in SI units, and back (docs/method.md section 12)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray

MM: Final = 1e-3
DEGREE: Final = float(np.pi / 180)


class Orientation(Enum):
    """Convention by which a format writes the orientation of the tool's frame in the base's."""

    EULER_ZYX = "A, B, C about Z, Y', X''"
    FIXED_XYZ = "W, P, R about the fixed X, Y, Z"
    QUATERNION = "quaternion, scalar first"
    ROTATION_VECTOR = "rotation vector"
    TOOL_AXIS = "unit vector of the tool's axis, from the tip to the spindle"
    NONE = "position only"
    JOINTS = "the controller's joint angles"


_COUNT: Final = {Orientation.QUATERNION: 4, Orientation.NONE: 0}
_UNIT: Final = 1e-3
"""Length of a quaternion beside 1 that is rounding of what a program writes."""
_GIMBAL: Final = 1e-9
"""|cos| of the middle angle, under which the two others turn about the same axis."""


@dataclass(frozen=True, slots=True)
class Notation:
    """Meaning of the numbers of a target."""

    orientation: Orientation  # what follows the position; JOINTS where angles stand in place of a pose
    length: float = MM  # metres in the unit of position
    angle: float = DEGREE  # radians in the unit of angles (1 where there are none)
    length_decimals: int = 4  # digits behind the point that a changed position gets at least
    angle_decimals: int = 5  # the same of a changed angle or component of an orientation

    @property
    def count(self) -> int:
        """Numbers of an orientation."""
        return _COUNT.get(self.orientation, 3)

    def pose(self, values: Sequence[float] | FloatArray) -> FloatArray:
        """Return the pose (4, 4) [m] of one target's numbers."""
        return np.asarray(self.poses(np.array([values], dtype=float))[0], dtype=float)

    @property
    def has_pose(self) -> bool:
        """Return True if the numbers state position and full orientation."""
        return self.orientation not in {Orientation.JOINTS, Orientation.TOOL_AXIS, Orientation.NONE}

    @property
    def is_joints(self) -> bool:
        """Return True if the numbers are joint angles."""
        return self.orientation is Orientation.JOINTS

    def states(self, values: FloatArray) -> BoolArray:
        """Return where numbers (..., 3 + count) are an orientation.

        A quaternion has to be of unit length, a tool's axis of some length.
        """
        sizes = np.linalg.norm(values[..., 3 : 3 + self.count], axis=-1)
        if self.orientation is Orientation.TOOL_AXIS:
            return np.asarray(sizes > 0.0)
        return np.asarray((self.orientation is not Orientation.QUATERNION) | (np.abs(sizes - 1.0) <= _UNIT))

    @property
    def decimals(self) -> tuple[int, ...]:
        """Digits behind the point for each number of a target."""
        if self.is_joints:
            return (self.angle_decimals,) * 6
        return (self.length_decimals,) * 3 + (self.angle_decimals,) * self.count

    def poses(self, values: FloatArray) -> FloatArray:
        """Return poses (m, 4, 4) of targets' numbers (m, 3 + count), tool in base [m].

        Raises:
            ValueError: the notation states no full pose.
        """
        if not self.has_pose:
            raise ValueError(f"{self.orientation.value} is no full pose")
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        poses[:, :3, 3] = values[:, :3] * self.length
        numbers = values[:, 3:]
        if not len(values):
            return poses
        if self.orientation is Orientation.QUATERNION:
            poses[:, :3, :3] = Rotation.from_quat(numbers[:, [1, 2, 3, 0]]).as_matrix()
        elif self.orientation is Orientation.ROTATION_VECTOR:
            poses[:, :3, :3] = Rotation.from_rotvec(numbers * self.angle).as_matrix()
        else:
            poses[:, :3, :3] = _turned(self.angle * self._about_zyx(numbers))
        return poses

    def _about_zyx(self, angles: FloatArray) -> FloatArray:
        """Return angles in the order Z, Y', X'', or back: about the fixed X, Y, Z is the reverse order."""
        return angles if self.orientation is Orientation.EULER_ZYX else angles[:, ::-1]

    def values(self, poses: FloatArray, near: FloatArray) -> FloatArray:
        """Return the numbers (m, 3 + count) of poses (m, 4, 4) [m], the equivalent ones nearest to `near`."""
        if not len(poses):
            return near.copy()
        numbers = np.empty_like(near)
        numbers[:, :3] = poses[:, :3, 3] / self.length
        rotations, old = poses[:, :3, :3], near[:, 3:]
        if self.orientation is Orientation.QUATERNION:
            new = Rotation.from_matrix(rotations).as_quat()[:, [3, 0, 1, 2]]
            new *= np.linalg.norm(old, axis=1, keepdims=True)  # rounded as it was: an unchanged one stays
            numbers[:, 3:] = np.where(np.sum(new * old, axis=1, keepdims=True) < 0, -new, new)
        elif self.orientation is Orientation.ROTATION_VECTOR:
            numbers[:, 3:] = (
                _nearest_vector(Rotation.from_matrix(rotations).as_rotvec(), old * self.angle) / self.angle
            )
        else:
            angles = _nearest_angles(rotations, self.angle * self._about_zyx(old))
            numbers[:, 3:] = self._about_zyx(angles) / self.angle
        return numbers


def _nearest_vector(vectors: FloatArray, near: FloatArray) -> FloatArray:
    """Return rotation vectors (m, 3) [rad] of the same rotations, full turns added towards `near`."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    still = angle < 1e-12
    usual = np.linalg.norm(near, axis=1, keepdims=True)
    fallback = near / np.where(usual > 0, usual, 1)
    axis = np.where(still, fallback, vectors / np.where(still, 1, angle))
    along = np.sum(axis * near, axis=1, keepdims=True)
    turns = np.round((along - angle) / (2 * np.pi))
    moved = axis * (angle + 2 * np.pi * turns)
    return np.where(turns == 0, vectors, moved)


def _turned(angles: FloatArray) -> FloatArray:
    """Return rotations (m, 3, 3) by angles (m, 3) [rad] about Z, Y', X''."""
    (sa, sb, sc), (ca, cb, cc) = np.sin(angles).T, np.cos(angles).T
    rotations = np.empty((len(angles), 3, 3))
    rotations[:, 0] = np.stack([ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc], axis=1)
    rotations[:, 1] = np.stack([sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc], axis=1)
    rotations[:, 2] = np.stack([-sb, cb * sc, cb * cc], axis=1)
    return rotations


def _nearest_angles(rotations: FloatArray, near: FloatArray) -> FloatArray:
    """Return angles (m, 3) [rad] about Z, Y', X'' nearest to `near`: two solutions, full turns, a lock."""
    r = rotations
    cosine = np.hypot(r[:, 0, 0], r[:, 1, 0])
    sines = np.stack([r[:, 1, 0], -r[:, 2, 0], r[:, 2, 1]], axis=1)
    first = np.arctan2(sines, np.stack([r[:, 0, 0], cosine, r[:, 2, 2]], axis=1))
    other = np.column_stack([first[:, 0] + np.pi, np.pi - first[:, 1], first[:, 2] + np.pi])
    locked = cosine < _GIMBAL
    if locked.any():  # only a sum or a difference of the outer angles is told: keep the last as it is written
        free = first[locked]
        sign = np.where(free[:, 1] > 0, 1.0, -1.0)
        free[:, 0] = np.arctan2(-r[locked, 0, 1], r[locked, 1, 1]) + sign * near[locked, 2]
        free[:, 2] = near[locked, 2]
        first[locked] = other[locked] = free
    candidates = [choice + 2 * np.pi * np.round((near - choice) / (2 * np.pi)) for choice in (first, other)]
    far = [np.sum((choice - near) ** 2, axis=1) for choice in candidates]
    nearest: FloatArray = np.where((far[0] <= far[1])[:, None], candidates[0], candidates[1])
    return nearest
