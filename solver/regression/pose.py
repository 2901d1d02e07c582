"""Rigid displacement of the flange from the deflections of its targets (method.md §3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.regressor import RegressorBlock, whitener
from jointstiff.solver.robot.rotations import skew

MIN_TARGETS = 3
_COLLINEAR = 1e-3
"""Least ratio of the targets' triangle, height to length: below it, rotation about the line is noise."""


@dataclass(frozen=True, eq=False)
class RigidDisplacement:
    """Displacement ``x = (δp_b, δφ)`` of each of B configurations about its reference point b."""

    reference: FloatArray  #: (B, 3) reference point b in R0 [m]
    x: FloatArray  #: (B, 6) translation of b [m], then rotation [rad], axes of R0
    #: (B, 6, 6) upper triangular factor R of the whitened G, ``cov(x) = (Rᵀ R)⁻¹`` in units of sigma²
    factor: FloatArray
    basis: FloatArray  #: (B, 3 T, 6) orthonormal columns Q of the whitened G


def refuse_unless_posed(measurements: Measurements) -> None:
    """Refuse observations with fewer than three targets whose three coordinates were read.

    Raises:
        UnsupportedMethodError: naming the first such observation.
    """
    counts = (measurements.coordinates == 3).sum(axis=1)
    poor = np.flatnonzero(counts < MIN_TARGETS)
    if len(poor):
        first = int(poor[0])
        raise UnsupportedMethodError(
            f"the pose of the flange needs {MIN_TARGETS} targets, but this observation has "
            f"{counts[first]} ({len(poor)} of {len(counts)} observations have too few)",
            where=f"observations[{first}].readings",
            remedy="use method partial_pose, or read three targets in every observation",
        )


def fit_displacement(block: RegressorBlock, reference: FloatArray | None = None) -> RigidDisplacement:
    """Fit ``δp_X = δp_b + δφ × (P1X − b)`` by whitened least squares.

    Args:
        block: B observations with at least three targets each.
        reference: (B, 3) the points b in R0 [m]; the barycentres of the targets if None. Weighted by
            covariance, an estimate does not depend on them.

    Returns:
        The displacements with their covariance.

    Raises:
        UnsupportedMethodError: if the targets of an observation lie on a line.
    """
    present = block.measurements.present[..., None]
    weight = present / present.sum(axis=1, keepdims=True)
    barycentre = (block.points * weight).sum(axis=1)
    _refuse_collinear(np.where(present, block.points - barycentre[:, None], 0.0))
    if reference is None:
        reference = barycentre
    arm = np.where(present, block.points - reference[:, None], 0.0)
    W = np.where(present[..., None], whitener(block.measurements.covariance), 0.0)
    G = block.measurements.shown(np.concatenate([np.broadcast_to(np.eye(3), W.shape), -skew(arm)], axis=-1))
    Q, R = np.linalg.qr((W @ G).reshape(len(arm), -1, 6))
    d = (W @ block.measurements.deflection[..., None]).reshape(len(arm), -1, 1)
    x = np.linalg.solve(R, Q.transpose(0, 2, 1) @ d)[..., 0]
    return RigidDisplacement(reference, x, R, Q)


def _refuse_collinear(arm: FloatArray) -> None:
    singular = np.linalg.svd(arm, compute_uv=False)
    flat = np.flatnonzero(singular[:, 1] <= _COLLINEAR * singular[:, 0])
    if len(flat):
        raise UnsupportedMethodError(
            "the targets lie on a line, so the flange's rotation about it is not observable "
            f"({len(flat)} observations)",
            where="readings",
            remedy="use method partial_pose, or place the three targets so that they form a triangle",
        )
