"""Rotation matrices and roll, pitch, yaw, as URDF defines them."""

from __future__ import annotations

import math

import numpy as np

from jointstiff.solver.arrays import FloatArray

__all__ = ["rotation_from_rpy", "rpy_from_rotation"]


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rotation R = Rz(yaw) Ry(pitch) Rx(roll) about fixed axes, as URDF has it; angles in rad."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: FloatArray) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] with R = Rz(yaw) Ry(pitch) Rx(roll), to rounding at every R.

    Roll is read from Rz(yaw)ᵀ R, which stays well defined where pitch is ±90° and yaw is arbitrary.
    """
    R = rotation
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    cy, sy = math.cos(yaw), math.sin(yaw)
    roll = math.atan2(sy * R[0, 2] - cy * R[1, 2], cy * R[1, 1] - sy * R[0, 1])
    return roll, pitch, yaw
