"""Prediction of deflections and encoder readings by the compliances, and what they explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import regressor_blocks


@dataclass(frozen=True, eq=False)
class Contributions:
    """Parts of n joints in the predicted deflection, each projected on that deflection.

    Joint j alone moves a target by ``A_X,j c_j``; its part is ``A_X,j c_j · δp̂ / ‖δp̂‖``, and the parts of all
    joints add up to ‖δp̂‖. A joint without an estimate counts as rigid.
    """

    by_observation: FloatArray  #: (n, N) mean over the targets of each observation [m]
    mean: FloatArray  #: (n,) mean over all readings [m]
    #: (n,) share of the mean length of the predicted deflections, dimensionless; zero if nothing moves
    share: FloatArray


@dataclass(frozen=True, eq=False)
class Prediction:
    """Deflections of N observations of T targets, axes of R0 [m]."""

    predicted: FloatArray  #: (N, T, 3) predicted by the joint compliances
    residual: FloatArray  #: (N, T, 3) measured minus predicted; zero where a target was not read
    compensation: float | None  #: ``1 − mean‖residual‖ / mean‖δp‖``; None where nothing moved
    rms_residual: float  #: root mean square of ‖residual‖ [m]
    contributions: Contributions | None = None  #: of the joints; None where more than joints bends

    @classmethod
    def of(
        cls, measurements: Measurements, predicted: FloatArray, contributions: Contributions | None = None
    ) -> Prediction:
        """Judge predicted deflections (N, T, 3) [m]."""
        residual = np.where(measurements.present[..., None], measurements.deflection - predicted, 0.0)
        left = np.linalg.norm(residual[measurements.present], axis=-1)
        moved = np.linalg.norm(measurements.deflection[measurements.present], axis=-1).mean()
        return cls(
            predicted=predicted,
            residual=residual,
            compensation=float(1.0 - left.mean() / moved) if moved > 0 else None,
            rms_residual=float(np.sqrt(np.mean(left**2))),
            contributions=contributions,
        )


def predict(
    robot: Robot,
    measurements: Measurements,
    compliance: FloatArray,
    *,
    complementary_stiffness: bool = False,
    estimated: BoolArray | None = None,
) -> Prediction:
    """Predict the deflections of the targets, ``δp_X = A_X c`` (method.md §2).

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) [rad/(N·m)].
        complementary_stiffness: whether the load follows the deflection, as in the fit that found the
            compliances: the deflections are then those of the exact balance, to third order.
        estimated: (n,) joints with an estimate; all if None. The others contribute nothing by name.

    Raises:
        SolverError: the load finds no balance with joints of that compliance.
    """
    named = compliance if estimated is None else np.where(estimated, compliance, 0.0)
    predicted, along = [], []
    for block in regressor_blocks(robot, measurements, compliance if complementary_stiffness else None):
        predicted.append(block.A @ compliance)
        moved = block.A * named
        whole = moved.sum(axis=-1)
        length = np.linalg.norm(whole, axis=-1)
        direction = whole / np.where(length > 0.0, length, 1.0)[..., None]
        along.append(np.einsum("btij,bti->btj", moved, direction))
    parts, present = np.concatenate(along), measurements.present  # parts are zero where nothing was read
    mean = parts.sum(axis=(0, 1)) / present.sum()
    total = float(mean.sum())
    contributions = Contributions(
        by_observation=(parts.sum(axis=1) / present.sum(axis=1)[:, None]).T,
        mean=mean,
        share=mean / total if total > 0.0 else np.zeros_like(mean),
    )
    return Prediction.of(measurements, np.concatenate(predicted), contributions)


def predict_encoders(
    robot: Robot,
    measurements: Measurements,
    compliance: FloatArray,
    *,
    complementary_stiffness: bool = False,
) -> FloatArray:
    """Predict the deflections of the joints behind their gearboxes, ``δθ = diag(τ) c`` (method.md §2).

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) [rad/(N·m)].
        complementary_stiffness: whether the load follows the deflection, as in the fit.

    Returns:
        (N, n) [rad].
    """
    blocks = regressor_blocks(robot, measurements, compliance if complementary_stiffness else None)
    return np.concatenate([block.torque * compliance for block in blocks])
