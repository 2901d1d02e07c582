"""Types of arrays, and algebra of many small vectors and of columns."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
IndexArray: TypeAlias = npt.NDArray[np.intp]
ActiveBounds: TypeAlias = npt.NDArray[np.int8]
"""Array that is -1 for a parameter at its lower bound, 1 at its upper bound, and 0 for a free parameter."""

_OF_INVERSE = 1e-6
"""Relative error of an inverse that is allowed for: far above the rounding errors if a bound is 1e-4."""


def fix_axis_signs(axes: FloatArray) -> FloatArray:
    """Return axes (..., 3), each multiplied by 1 or −1 such that its first large component is positive.

    The sign of an eigenvector depends on rounding alone. A component is large if its absolute value exceeds
    half of the greatest absolute value among the three components of the axis.
    """
    size = np.abs(axes)
    first_large = np.argmax(size > 0.5 * size.max(axis=-1, keepdims=True), axis=-1)[..., None]
    return np.asarray(np.where(np.take_along_axis(axes, first_large, axis=-1) < 0.0, -axes, axes))


def unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return columns (m, k) scaled to unit length, and their lengths (k,); a zero column has length 1."""
    lengths = np.linalg.norm(columns, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    return columns / lengths, lengths


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products a × b (3, ...) of vectors (3, ...); the first index is the component.

    For a single pair of vectors this is faster than `np.cross`, which takes 15 µs.
    """
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def greatest_eigenvalue(matrices: FloatArray) -> FloatArray:
    """Compute the greatest eigenvalue (...) of symmetric matrices (3, 3, ...) in closed form.

    ``λ = q + 2 r cos(arccos(det(B)/2)/3)`` with q = tr(A)/3, 6 r² = ‖A − q I‖² and B = (A − q I)/r
    (Smith, *Eigenvalues of a symmetric 3 × 3 matrix*, 1961).
    """
    mean = np.einsum("ii...->...", matrices) / 3.0
    B = matrices - np.multiply.outer(np.eye(3), mean)
    r = np.sqrt(np.einsum("ij...,ij...->...", B, B) / 6.0)
    B /= np.where(r > 0.0, r, 1.0)
    half_determinant = 0.5 * np.einsum("i...,i...->...", B[0], cross(B[1], B[2]))
    return np.asarray(mean + 2.0 * r * np.cos(np.arccos(np.clip(half_determinant, -1.0, 1.0)) / 3.0))


def are_regular(matrices: FloatArray, bound: FloatArray | float) -> BoolArray:
    """Return a mask (K,) of square matrices (K, p, p) whose least singular value is at least a bound.

    Most matrices are decided by the Frobenius norm of their inverse, ``1 ≤ σ ‖A⁻¹‖ ≤ √p`` for the least
    singular value σ: a third of the time of their singular values, which decide the others.

    Args:
        matrices: (K, p, p) matrices.
        bound: one bound, or (K,) bounds; all matrices reach the bound zero.
    """
    bounds = np.broadcast_to(bound, len(matrices))
    regular = np.asarray(bounds <= 0.0)
    invertible = np.flatnonzero(np.linalg.det(matrices) != 0.0)
    inverse = np.linalg.inv(matrices[invertible])
    least = 1.0 / np.sqrt(np.square(inverse).sum(axis=(1, 2)))  # of the singular value
    most = np.sqrt(matrices.shape[1]) * least
    wanted = bounds[invertible]
    is_sure = least * (1.0 - _OF_INVERSE) >= wanted
    is_near = ~is_sure & (most * (1.0 + _OF_INVERSE) >= wanted)
    near = invertible[is_near]
    regular[invertible[is_sure]] = True
    regular[near] = np.linalg.svd(matrices[near], compute_uv=False)[:, -1] >= bounds[near]
    return regular


def wrap(angles: FloatArray) -> FloatArray:
    """Return angles [rad] without whole turns, within half a turn."""
    return np.asarray(np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi)
