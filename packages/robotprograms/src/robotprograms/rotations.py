"""Rotation matrices, quaternions (scalar first) and rotation vectors, m at a time.

Source: M. D. Shuster, *A survey of attitude representations*, 1993; S. W. Shepperd, *Quaternion from rotation
matrix*, 1978.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from robotprograms.arrays import FloatArray

_SMALL: Final = 1e-3
"""Angle [rad] below which series replace quotients of an angle and its sine."""


def normalise(quaternions: FloatArray) -> FloatArray:
    """Return quaternions (m, 4) divided by their lengths."""
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))


def matrices_from_quaternions(quaternions: FloatArray) -> FloatArray:
    """Return the rotation matrices (m, 3, 3) of quaternions (m, 4), scalar first, of any length but zero."""
    w, x, y, z = normalise(quaternions).T
    matrices = np.empty((len(quaternions), 3, 3))
    matrices[:, 0, 0] = w * w + x * x - y * y - z * z
    matrices[:, 0, 1] = 2 * (x * y - z * w)
    matrices[:, 0, 2] = 2 * (x * z + y * w)
    matrices[:, 1, 0] = 2 * (x * y + z * w)
    matrices[:, 1, 1] = w * w - x * x + y * y - z * z
    matrices[:, 1, 2] = 2 * (y * z - x * w)
    matrices[:, 2, 0] = 2 * (x * z - y * w)
    matrices[:, 2, 1] = 2 * (y * z + x * w)
    matrices[:, 2, 2] = w * w - x * x - y * y + z * z
    return matrices


def quaternions_from_matrices(matrices: FloatArray) -> FloatArray:
    """Return unit quaternions (m, 4), scalar first, of rotation matrices (m, 3, 3).

    The matrix 4 q qᵀ of a quaternion q follows from sums and differences of the rotation matrix' entries.
    Each of its rows is a multiple of q; the row of q's greatest component is the most exact one.
    """
    r = matrices
    products = np.empty((len(r), 4, 4))  # 4 q qᵀ
    trace = np.trace(r, axis1=1, axis2=2)
    products[:, 0, 0] = 1 + trace
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[:, i + 1, i + 1] = 1 - trace + 2 * r[:, i, i]
        products[:, 0, i + 1] = products[:, i + 1, 0] = r[:, k, j] - r[:, j, k]
        products[:, i + 1, j + 1] = products[:, j + 1, i + 1] = r[:, j, i] + r[:, i, j]
    sizes = np.stack([r[:, 0, 0], r[:, 1, 1], r[:, 2, 2], trace], axis=1)  # rise with those of x, y, z, w
    greatest = (np.argmax(sizes, axis=1) + 1) % 4
    return normalise(products[np.arange(len(r)), greatest])


def matrices_from_vectors(vectors: FloatArray) -> FloatArray:
    """Return the rotation matrices (m, 3, 3) of rotation vectors (m, 3) [rad]."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    # The quaternion has the vector part sin(angle / 2) / angle · vector; near zero by its Taylor series.
    is_small = angle <= _SMALL
    series = 0.5 - angle**2 / 48 + angle**4 / 3840
    scale = np.where(is_small, series, np.sin(angle / 2) / np.where(is_small, 1.0, angle))
    return matrices_from_quaternions(np.hstack([np.cos(angle / 2), scale * vectors]))


def vectors_from_matrices(matrices: FloatArray) -> FloatArray:
    """Return the rotation vectors (m, 3) [rad], of angles up to π, of rotation matrices (m, 3, 3)."""
    quaternions = quaternions_from_matrices(matrices)
    quaternions = np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)
    scalar, vector = quaternions[:, :1], quaternions[:, 1:]
    angle = 2 * np.arctan2(np.linalg.norm(vector, axis=1, keepdims=True), scalar)
    # The rotation vector is angle / sin(angle / 2) · vector part; near zero by its Taylor series.
    is_small = angle <= _SMALL
    series = 2 + angle**2 / 12 + 7 * angle**4 / 2880
    scale = np.where(is_small, series, angle / np.where(is_small, 1.0, np.sin(angle / 2)))
    return np.asarray(scale * vector)
