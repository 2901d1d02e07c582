"""Cartesian compliance in a loaded posture, never its inverse (method.md §9)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray

_SINGULAR: Final = 1e-12
"""Eigenvalue beside the greatest, in equilibrated compliances, that is rounding."""


@dataclass(frozen=True, eq=False)
class WorstDirection:
    """The direction in which a force moves the place most, in B load cases."""

    compliance: FloatArray  #: (B,) greatest eigenvalue of C_tt [m/N]
    direction: FloatArray  #: (B, 3) unit vector, axes of R0
    compliance_uncertainty: FloatArray  #: (B,) standard uncertainty of the eigenvalue [m/N]; NaN if unknown
    #: (B,) standard uncertainty of the direction's angle [rad], at most a quarter turn; NaN if unknown
    direction_uncertainty: FloatArray


@dataclass(frozen=True, eq=False)
class CartesianCompliance:
    """``C_x = J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹ diag(c) J_xᵀ`` in the loaded posture of B load cases.

    It maps a further small wrench at the place (N, then N·m) to the displacement of the place (m) and the
    rotation of the flange (rad), axes of R0.
    """

    matrix: FloatArray  #: (B, 6, 6) blocks [m/N, m/(N·m); rad/N, rad/(N·m)]
    #: (B,) whether the load has a potential: a dead moment has none, and leaves C asymmetric
    symmetric: BoolArray
    #: makes the factors L, M (B, 6, n) with ``∂C/∂c_j = L_j M_jᵀ``: maps do not ask for them
    by_joint: Callable[[], tuple[FloatArray, FloatArray]]
    covariance: FloatArray | None  #: (n, n) covariance of the compliances [(rad/(N·m))²]; None if unknown

    @property
    def translation(self) -> FloatArray:
        """(B, 3, 3) C_tt [m/N]."""
        return self.matrix[:, :3, :3]

    def along(self, direction: FloatArray) -> FloatArray:
        """(B,) ``uᵀ C_tt u``, compliance along unit vectors (B, 3) [m/N]."""
        return np.asarray(np.einsum("bi,bij,bj->b", direction, self.translation, direction))

    def stiffness_lateral_free(self, direction: FloatArray) -> FloatArray:
        """(B,) ``1/(uᵀ C_tt u)`` [N/m]: force per displacement along u, motion across u left free."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.along(direction)

    def stiffness_lateral_blocked(self, direction: FloatArray) -> FloatArray:
        """(B,) ``uᵀ C_tt⁻¹ u`` [N/m]: motion across u blocked; inf where C_tt is singular."""
        return _inverse_form(self.translation, direction)

    def stiffness_rotation_blocked(self, direction: FloatArray) -> FloatArray:
        """(B,) ``uᵀ K_tt u``, K = C_x⁻¹ [N/m]: all but motion along u blocked; inf where C_x is singular."""
        padded = np.concatenate([direction, np.zeros_like(direction)], axis=1)
        return _inverse_form(self.matrix, padded)

    @cached_property
    def worst(self) -> WorstDirection:
        """The worst direction, its uncertainty by the law of propagation (GUM, 5.1.2).

        ``∂λ/∂c_j = vᵀ (∂C/∂c_j) v`` and ``∂v/∂c_j = Σ_m v_m v_mᵀ(∂C/∂c_j)v / (λ − λ_m)``, the loaded posture
        being held.
        """
        symmetric = 0.5 * (self.translation + self.translation.transpose(0, 2, 1))
        values, vectors = np.linalg.eigh(symmetric)
        worst, v = values[:, -1], vectors[:, :, -1]
        unknown = np.full(len(v), np.nan)
        if self.covariance is None:
            return WorstDirection(worst, v, unknown, unknown)
        left, right = (factor[:, :3] for factor in self.by_joint())
        slopes = 0.5 * (
            np.einsum("bim,bij,bkj,bk->bmj", vectors, left, right, v)
            + np.einsum("bim,bij,bkj,bk->bmj", vectors, right, left, v)
        )  # (B, 3, n): v_mᵀ ∂C/∂c_j v
        variance = np.einsum("bmi,ij,bmj->bm", slopes, self.covariance, slopes)
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = (variance[:, :2] / np.square(worst[:, None] - values[:, :2])).sum(axis=1)
        angle = np.minimum(np.sqrt(np.where(np.isnan(turned), np.inf, turned)), 0.5 * np.pi)
        return WorstDirection(worst, v, np.sqrt(variance[:, -1]), angle)

    def deviation_along(self, direction: FloatArray) -> FloatArray:
        """(B,) standard uncertainty of ``uᵀ C_tt u`` [m/N]; NaN if unknown."""
        if self.covariance is None:
            return np.full(len(direction), np.nan)
        left, right = (np.einsum("bi,bij->bj", direction, factor[:, :3]) for factor in self.by_joint())
        slope = left * right
        variance: FloatArray = np.einsum("bi,ij,bj->b", slope, self.covariance, slope)
        return np.sqrt(variance)


def _inverse_form(matrices: FloatArray, direction: FloatArray) -> FloatArray:
    """(B,) ``uᵀ A⁻¹ u``; inf where the equilibrated A (B, k, k) is singular."""
    scale = np.sqrt(np.abs(np.diagonal(matrices, axis1=1, axis2=2)))
    scale = np.where(scale > 0.0, scale, 1.0)
    equilibrated = matrices / scale[:, :, None] / scale[:, None]
    singular = np.linalg.svd(equilibrated, compute_uv=False)
    regular = singular[:, -1] > _SINGULAR * singular[:, 0]
    out = np.full(len(matrices), np.inf)
    u = (direction / scale)[regular]
    out[regular] = (u * np.linalg.solve(equilibrated[regular], u[..., None])[..., 0]).sum(axis=1)
    return out
