"""The circle-point model: targets on one body that turns about one axis.

    p_kt = o + U Rz(φ_k) x_t,      φ_k = θ_k + (N ψ)_k

with U = (u, v, a) the axis's frame at its point o, x_t the target in that frame at joint angle zero, θ_k the
angle that the controller shows, and ψ its correction. Cartesian x_t instead of radius, phase and offset
keep the model regular for a target that lies on the axis: it then adds to the axis's position, not to
its trouble. N (K × K-1) spans the corrections of mean zero; a constant one is the same as a turn of x_t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import helmert

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis
from jointstiff.solver.geometry.sweeps.sweep import Sweep
from jointstiff.solver.regression.pose import skew
from jointstiff.solver.regression.regressor import whitener


@dataclass(frozen=True, eq=False)
class SweepState:
    """Unknowns of the fit of one sweep."""

    axis: Axis  #: the common axis in the tracker's frame
    targets: FloatArray  #: (T, 3) in the axis's frame, at joint angle zero [m]
    angles: FloatArray  #: (K,) of the joint [rad]

    @property
    def arms(self) -> FloatArray:
        """Targets in the axis's frame (K, T, 3) at each position [m]."""
        return np.asarray(np.einsum("kij,tj->kti", _about_z(self.angles), self.targets))

    def points(self) -> FloatArray:
        """Predicted readings (K, T, 3) in the tracker's frame [m]."""
        return np.asarray(self.axis.point + self.arms @ self.axis.frame.T)

    def stepped(self, step: FloatArray, correction: FloatArray) -> SweepState:
        """The state after a step of the axis's chart and the targets (4 + 3 T), and of the angles (K,)."""
        moved = step[CHART_SIZE:].reshape(-1, 3)
        return SweepState(
            self.axis.displaced(step[:CHART_SIZE]), self.targets + moved, self.angles + correction
        )


@dataclass(frozen=True, eq=False)
class WhitenedSweep:
    """The readings of a sweep, whitened, and the residuals and Jacobian of the model there."""

    points: FloatArray  #: (K, T, 3) readings [m]
    weight: FloatArray  #: (K, T, 3, 3) whiteners in units of 1/sigma; zero where there is no reading
    controller: FloatArray  #: (K,) angle of the turning model joint as the controller has it [rad]
    basis: FloatArray  #: (K, F) the corrections of the angles that are free, F = K - 1 or 0

    @classmethod
    def of(cls, sweep: Sweep, controller: FloatArray, *, free_angles: bool) -> WhitenedSweep:
        """Whiten a sweep.

        Args:
            sweep: the readings.
            controller: (K,) angle of the turning model joint [rad].
            free_angles: whether each position's angle is estimated, too.
        """
        weight = np.where(sweep.present[..., None, None], whitener(sweep.covariance), 0.0)
        count = len(sweep)
        basis = helmert(count).T if free_angles else np.zeros((count, 0))
        return cls(np.where(sweep.present[..., None], sweep.points, 0.0), weight, controller, basis)

    def whiten(self, vectors: FloatArray) -> FloatArray:
        """Apply the weights to vectors (K, T, 3): (3 K T,)."""
        return np.asarray((self.weight @ vectors[..., None]).ravel())

    def residual(self, state: SweepState) -> FloatArray:
        """Whitened readings minus prediction (3 K T,) [m]."""
        return self.whiten(self.points - state.points())

    def jacobian(self, state: SweepState) -> FloatArray:
        """Derivative of the whitened prediction (3 K T, 4 + 3 T + F): chart, targets, corrections."""
        arms = state.arms
        count, targets, _ = arms.shape
        WU = self.weight @ state.axis.frame
        tangent = -skew(arms)  # column i: e_i × arm
        J = np.zeros((count, targets, 3, CHART_SIZE + 3 * targets + self.basis.shape[1]))
        J[..., :2] = WU[..., :2]
        J[..., 2:CHART_SIZE] = (WU @ tangent)[..., :2]
        turned = WU @ _about_z(state.angles)[:, None]
        for t in range(targets):
            first = CHART_SIZE + 3 * t
            J[:, t, :, first : first + 3] = turned[:, t]
        along = (WU @ tangent[..., 2:])[..., 0]
        J[..., CHART_SIZE + 3 * targets :] = along[..., None] * self.basis[:, None, None, :]
        return J.reshape(count * targets * 3, -1)


def start(sweep: Sweep, controller: FloatArray) -> SweepState:
    """Start values without iteration, from ``p_kt ≈ A_t + B_t cos θ_k + C_t sin θ_k``, linear in A, B, C.

    ``B_t × C_t`` points along the axis, by the square of the target's radius, so that targets count by
    what they know of it; the centres A_t lie on it.

    Raises:
        MeasurementError: no target was read often enough, or none shows a plane in which it turns.
    """
    columns = np.column_stack([np.ones(len(sweep)), np.cos(controller), np.sin(controller)])
    normal, centres, radii = np.zeros(3), [], []
    for t in np.flatnonzero(sweep.present.sum(axis=0) >= columns.shape[1]):
        rows = sweep.present[:, t]
        A, B, C = np.linalg.lstsq(columns[rows], sweep.points[rows, t], rcond=None)[0]
        normal += np.cross(B, C)
        centres.append(A)
        radii.append(float(np.linalg.norm(np.cross(B, C))))
    if not np.linalg.norm(normal) > 0.0:
        raise MeasurementError(
            "no target moved on a circle",
            where=sweep.where,
            remedy="read at least one target in three or more positions, at a distance from the axis",
        )
    centre = np.average(centres, axis=0, weights=np.array(radii) + 1e-12)
    axis = Axis.through(centre, normal).slid_to(sweep.points[sweep.present].mean(axis=0))
    local = (np.where(sweep.present[..., None], sweep.points, 0.0) - axis.point) @ axis.frame
    back = np.einsum("kji,ktj->kti", _about_z(controller), local)
    shown = sweep.present[..., None]
    targets = (back * shown).sum(axis=0) / np.maximum(shown.sum(axis=0), 1)
    return SweepState(axis, targets, np.array(controller))


def _about_z(angles: FloatArray) -> FloatArray:
    """Rotations (K, 3, 3) about z by angles (K,) [rad]."""
    out = np.zeros((len(angles), 3, 3))
    cosine, sine = np.cos(angles), np.sin(angles)
    out[:, 0, 0] = out[:, 1, 1] = cosine
    out[:, 1, 0], out[:, 0, 1] = sine, -sine
    out[:, 2, 2] = 1.0
    return out
