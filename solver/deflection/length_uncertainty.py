"""Uncertainty of the length of a predicted displacement, by source (method.md §8, §9)."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.deflection.prediction import Deflection, compliance_rows


def length_uncertainties(deflection: Deflection, covariances: FloatArray) -> FloatArray:
    """Return the standard uncertainty of each displacement's length by each source, ``√(uᵀ A C_k Aᵀ u)``.

    Args:
        deflection: B predictions by elastic joints; u is the direction of each displacement.
        covariances: (K, n, n) of the compliances, by source [(rad/(N·m))²].

    Returns:
        (B, K) [m]; zero where nothing moves.
    """
    d = deflection.displacement
    length = np.linalg.norm(d, axis=1, keepdims=True)
    u = np.divide(d, length, out=np.zeros_like(d), where=length > 0.0)
    row = np.einsum("bi,bin->bn", u, compliance_rows(deflection.posture)[:, :3])
    variance = np.einsum("bn,knm,bm->bk", row, covariances, row)
    uncertainty: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    return uncertainty
