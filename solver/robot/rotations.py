"""Cross products and small rotations, many at once."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray


def skew(v: FloatArray) -> FloatArray:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return rotation vectors (..., 3) [rad] of rotations (..., 3, 3) by less than a quarter turn."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))
    sine_axis = skew[..., [2, 0, 1], [1, 2, 0]]
    sine = np.linalg.norm(sine_axis, axis=-1, keepdims=True)
    angle: FloatArray = np.arcsin(np.minimum(sine, 1.0))
    return sine_axis * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)
