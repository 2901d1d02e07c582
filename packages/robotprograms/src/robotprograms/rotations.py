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
    """Return unit quaternions q = (w, x, y, z), as (m, 4), of rotation matrices R (m, 3, 3).

    Shepperd: the entries of R give the matrix 4 q qᵀ, whose rows are multiples of q:

        4 w² = 1 + trace R,    4 w x = R₂₁ - R₁₂ (and so on in turn),
        4 x² = 1 - trace R + 2 R₀₀,    4 x y = R₁₀ + R₀₁.

    The row of q's greatest component is the most exact one, and is normalised.
    """
    r = matrices
    products = np.empty((len(r), 4, 4))  # 4 q qᵀ
    trace = np.trace(r, axis1=1, axis2=2)
    products[:, 0, 0] = 1 + trace
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # x, y, z in turn
        products[:, i + 1, i + 1] = 1 - trace + 2 * r[:, i, i]
        products[:, 0, i + 1] = products[:, i + 1, 0] = r[:, k, j] - r[:, j, k]
        products[:, i + 1, j + 1] = products[:, j + 1, i + 1] = r[:, j, i] + r[:, i, j]
    sizes = np.stack([r[:, 0, 0], r[:, 1, 1], r[:, 2, 2], trace], axis=1)  # rise with those of x, y, z, w
    greatest = (np.argmax(sizes, axis=1) + 1) % 4  # in the order w, x, y, z
    return normalise(products[np.arange(len(r)), greatest])


def matrices_from_vectors(vectors: FloatArray) -> FloatArray:
    """Return the rotation matrices (m, 3, 3) of rotation vectors (m, 3) [rad].

    A rotation by the angle α about the unit axis u, with the vector α u, has the quaternion
    (cos(α/2), sin(α/2) u). Near zero, sin(α/2) / α is calculated by its Taylor series.
    """
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    is_small = angle <= _SMALL
    series = 0.5 - angle**2 / 48 + angle**4 / 3840
    sine_by_angle = np.where(is_small, series, np.sin(angle / 2) / np.where(is_small, 1.0, angle))
    return matrices_from_quaternions(np.hstack([np.cos(angle / 2), sine_by_angle * vectors]))


def vectors_from_matrices(matrices: FloatArray) -> FloatArray:
    """Return the rotation vectors (m, 3) [rad], of angles up to π, of rotation matrices (m, 3, 3).

    The quaternion (cos(α/2), sin(α/2) u) belongs to the rotation by the angle α about the unit axis u, whose
    vector is α u. Near zero, α / sin(α/2) is calculated by its Taylor series.
    """
    quaternions = quaternions_from_matrices(matrices)
    # A quaternion and its negative state the same rotation; that with cos(α/2) ≥ 0 has the smaller angle.
    quaternions = np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)
    cosine, axis_part = quaternions[:, :1], quaternions[:, 1:]
    angle = 2 * np.arctan2(np.linalg.norm(axis_part, axis=1, keepdims=True), cosine)
    is_small = angle <= _SMALL
    series = 2 + angle**2 / 12 + 7 * angle**4 / 2880
    angle_by_sine = np.where(is_small, series, angle / np.where(is_small, 1.0, np.sin(angle / 2)))
    return np.asarray(angle_by_sine * axis_part)
