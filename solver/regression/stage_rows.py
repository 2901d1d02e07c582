"""Rows of each method: linear functions of the readings, with their covariance (method.md §4).

A robust loss needs the rows of all targets one by one: nothing of them is compressed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.regression.compression import Compression
from jointstiff.solver.regression.pose import RigidDisplacement
from jointstiff.solver.regression.regressor import RegressorBlock, whitener
from jointstiff.solver.robot.rotations import skew


@dataclass(frozen=True, eq=False)
class DerivedReadings:
    """K groups of m rows ``y = A c + noise`` derived linearly from the readings."""

    A: FloatArray  #: (K, m, n) regressor
    y: FloatArray  #: (K, m) derived reading
    whitener: FloatArray  #: (m, m) or (K, m, m) matrix W with ``cov(y) = (Wᵀ W)⁻¹`` in units of sigma²
    count: int  #: how many of the K m rows are readings, the others being padding of zeros
    #: (K, 1, 1) of each group where it is not weighted by covariance, from a robust loss; None for ones.
    #: The covariance holds it already.
    weight: FloatArray | None = None

    def select(self, columns: IndexArray) -> DerivedReadings:
        """The same rows for some of the parameters, in the given order."""
        return replace(self, A=self.A[..., columns])

    def whitened(self) -> FloatArray:
        """(K, m, n + 1) rows W [A y], of unit covariance where the model holds."""
        augmented = np.concatenate([self.A, self.y[..., None]], axis=-1)
        W = self.whitener
        if W.ndim == 3:
            rows: FloatArray = W @ augmented
        elif np.array_equal(W, W[0, 0] * np.eye(len(W))):  # isotropic: one product instead of three
            rows = W[0, 0] * augmented
        else:
            rows = np.einsum("ij,kjn->kin", W, augmented)
        return rows

    def weighted(self, root_weight: FloatArray) -> FloatArray:
        """(K, m, n + 1) rows diag(s) [A y] for the root weights s (m,)."""
        augmented = np.concatenate([self.A, self.y[..., None]], axis=-1)
        rows: FloatArray = augmented * root_weight[:, None]
        return rows if self.weight is None else rows * np.sqrt(self.weight)

    @property
    def influence(self) -> FloatArray:
        """(K, m, n) A, weighted by a robust loss if there is one."""
        return self.A if self.weight is None else self.A * self.weight

    def spread(self, root_weight: FloatArray) -> FloatArray:
        """(K, m, n) rows W⁻ᵀ Ω A, whose Gram matrix is AᵀΩ cov(y) Ω A with Ω = weight · diag(s²)."""
        scaled: FloatArray = self.influence * (root_weight**2)[:, None]
        inverse_transposed = np.swapaxes(np.linalg.inv(self.whitener), -1, -2)
        return inverse_transposed @ scaled


class Stage:
    """One least-squares problem over n parameters, compressed as its rows come in.

    With `root_weight` None the rows are weighted by their covariance (method.md §3); otherwise by the
    given (m,) factors, and the covariance of the estimate is the sandwich that such weights leave.
    """

    def __init__(self, parameters: int, root_weight: FloatArray | None) -> None:
        self._root_weight = root_weight
        self.rows = Compression(parameters + 1)
        self._spread = Compression(parameters)

    @property
    def by_covariance(self) -> bool:
        """Return True if the rows are weighted by their covariance, as in the likelihood."""
        return self._root_weight is None

    def add(self, readings: DerivedReadings) -> None:
        """Take in rows."""
        if self._root_weight is None:
            self.rows.add(readings.whitened(), count=readings.count)
        else:
            self.rows.add(readings.weighted(self._root_weight), count=readings.count)
            self._spread.add(readings.spread(self._root_weight))

    def add_encoders(self, block: RegressorBlock, joints: IndexArray, columns: IndexArray) -> None:
        """Take in what secondary encoders read, if they were read.

        Args:
            block: B observations.
            joints: the joints whose encoders take part.
            columns: the joint of each of the stage's parameters.
        """
        readings = encoder_readings(block, joints)
        if readings is not None:
            self.add(readings.select(columns))

    def moment(self, readings: DerivedReadings | None) -> FloatArray:
        """(n,) AᵀΩ y of rows that are not taken in, weighted as those that are; zero for None."""
        if readings is None:
            return np.zeros(self.rows.matrix.shape[1])
        rows = readings.whitened() if self._root_weight is None else readings.weighted(self._root_weight)
        flat = rows.reshape(-1, rows.shape[-1])
        moment: FloatArray = flat[:, :-1].T @ flat[:, -1]
        return moment

    def covariance(self, columns: IndexArray, inverse: FloatArray) -> FloatArray:
        """Covariance of the unconstrained estimate of some columns, the others being known.

        Args:
            columns: (p,) which parameters are estimated.
            inverse: (p, m) pseudo-inverse of those columns of the rows.

        Returns:
            (p, p) in units of sigma²: (AᵀΣ⁻¹A)⁻¹, or the sandwich for other weights.
        """
        if self._root_weight is None:
            return inverse @ inverse.T
        half = inverse @ inverse.T @ self._spread.triangle[:, columns].T
        return half @ half.T


def target_readings(block: RegressorBlock) -> DerivedReadings:
    """Partial pose: three rows a target, positions only."""
    part = block.measurements
    _, _, _, n = block.A.shape
    weights = whitener(part.covariance)
    return DerivedReadings(
        A=block.A.reshape(-1, 3, n),
        y=part.deflection.reshape(-1, 3),
        whitener=weights if weights.ndim == 2 else weights.reshape(-1, 3, 3),
        count=int(part.coordinates.sum()),
        weight=None if part.weight is None else part.weight.reshape(-1, 1, 1),
    )


def pose_readings(block: RegressorBlock, displacement: RigidDisplacement) -> DerivedReadings:
    """Complete pose: translation of the reference point and rotation, six rows a configuration."""
    linear = block.configurations.jacobian_at(displacement.reference[:, None])[:, 0]
    jacobian = np.concatenate([linear, block.configurations.angular_jacobian], axis=1)
    return DerivedReadings(
        A=jacobian * block.torque[:, None],
        y=displacement.x,
        whitener=displacement.factor,
        count=displacement.x.size,
        weight=_poorest(block),
    )


def wrist_centre_readings(
    block: RegressorBlock, displacement: RigidDisplacement, centre: FloatArray
) -> tuple[DerivedReadings, FloatArray, FloatArray]:
    """Decoupled, stage 1: the rigid displacement carried to P_wrist, three rows a configuration.

    Args:
        block: B observations.
        displacement: of the same observations.
        centre: (3,) P_wrist in the flange frame [m].

    Returns:
        The derived readings for all n joints; (B, 3, 3T) the matrix that makes them of the whitened
        readings, its columns following `RigidDisplacement.basis`; and (B, 1, 3, n) J_v at P_wrist [m/rad].
    """
    points = block.configurations.to_base(np.broadcast_to(centre, (len(block.torque), 1, 3)))
    arm = points[:, 0] - displacement.reference
    extrapolation = np.concatenate([np.broadcast_to(np.eye(3), (len(arm), 3, 3)), -skew(arm)], 2)
    # y = E x, cov(x) = (RᵀR)⁻¹, hence cov(y) = (E R⁻¹)(E R⁻¹)ᵀ.
    half = np.linalg.solve(displacement.factor.transpose(0, 2, 1), extrapolation.transpose(0, 2, 1))
    half = half.transpose(0, 2, 1)
    jacobian = block.configurations.jacobian_at(points)
    readings = DerivedReadings(
        A=jacobian[:, 0] * block.torque[:, None],
        y=np.einsum("bij,bj->bi", extrapolation, displacement.x),
        whitener=np.linalg.inv(np.linalg.qr(half.transpose(0, 2, 1), mode="r")).transpose(0, 2, 1),
        count=3 * len(arm),
        weight=_poorest(block),
    )
    return readings, half @ displacement.basis.transpose(0, 2, 1), jacobian


def encoder_readings(block: RegressorBlock, joints: IndexArray) -> DerivedReadings | None:
    """Secondary encoders: one row ``δθ_j = τ_j c_j`` for each joint that was read, of variance 2 σ_e².

    They take part in every method: what they say of a joint does not pass through the targets.

    Args:
        block: B observations.
        joints: (p,) the joints whose encoders take part.

    Returns:
        B groups of p rows for all n joints [rad], weighted in units of the tracker's sigma²; None where no
        encoder was read.
    """
    part = block.measurements
    if part.encoders is None:
        return None
    present = part.encoders.present[:, joints]
    A = np.zeros((*present.shape, block.torque.shape[1]))
    A[:, np.arange(len(joints)), joints] = np.where(present, block.torque[:, joints], 0.0)
    return DerivedReadings(
        A=A,
        y=np.where(present, part.encoders.deflection[:, joints], 0.0),
        whitener=part.encoder_lever / np.sqrt(2.0) * np.eye(len(joints)),
        count=int(present.sum()),
    )


def _poorest(block: RegressorBlock) -> FloatArray | None:
    """(B, 1, 1) least robust weight of an observation's targets: its pose is as good as they are."""
    part = block.measurements
    if part.weight is None:
        return None
    poorest: FloatArray = np.where(part.present, part.weight, 1.0).min(axis=1)
    return poorest[:, None, None]


class TargetRows:
    """The whitened rows of all targets: 24 (n + 1) bytes a reading."""

    def __init__(self, parameters: int) -> None:
        self._joints = np.arange(parameters)
        self._rows: list[FloatArray] = []
        self._present: list[BoolArray] = []
        self._squared = Stage(parameters, None)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations, with their encoders, whose loss stays squared."""
        present = block.measurements.present
        self._rows.append(target_readings(block).whitened()[present.ravel()])
        self._present.append(present)
        self._squared.add_encoders(block, self._joints, self._joints)

    @property
    def rows(self) -> FloatArray:
        """(K, 3, n + 1) [A d] of the K readings, in units of sigma."""
        return np.concatenate(self._rows)

    @property
    def present(self) -> BoolArray:
        """(N, T) which targets were read: where the K readings belong."""
        return np.concatenate(self._present)

    @property
    def squared(self) -> Compression:
        """Compressed rows [A d] of squared loss."""
        return self._squared.rows

    def chi_square(self, compliance: FloatArray, *, sigma: float, threshold: float) -> float:
        """Chi-square of an estimate, each target's residual cut at the threshold so that none decides it.

        ``Σ min(‖r‖/σ, k)² / b``, with ``3 b = E[min(t, k)²]`` and t the norm of three standard normal
        coordinates, so that its expectation for good readings is that of the plain chi-square.

        Args:
            compliance: (n,) [rad/(N·m)].
            sigma: [m].
            threshold: k, in units of sigma.
        """
        norm = np.linalg.norm(self.rows[..., -1] - self.rows[..., :-1] @ compliance, axis=1) / sigma
        half = 0.5 * threshold**2
        share = special.gammainc(2.5, half) + threshold**2 / 3.0 * special.gammaincc(1.5, half)
        squared = (self.squared.matrix @ compliance - self.squared.rhs) / sigma
        return float(np.sum(np.minimum(norm, threshold) ** 2) / share + squared @ squared)
