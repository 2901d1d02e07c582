"""Predicted deflections, and how much of what was measured they explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.readings import Measurements
from jointstiff.solver.regression import regressor_blocks
from jointstiff.solver.robot import Robot

__all__ = ["Prediction", "predict"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Deflections of N observations of T targets, axes of R0 [m].

    Attributes:
        predicted: (N, T, 3) by the joint compliances.
        residual: (N, T, 3) measured minus predicted; zero where a target was not read.
        compensation: ``1 − mean‖residual‖ / mean‖δp‖``; None where nothing moved.
        rms_residual: root mean square of ‖residual‖ [m].
    """

    predicted: FloatArray
    residual: FloatArray
    compensation: float | None
    rms_residual: float

    @classmethod
    def of(cls, measurements: Measurements, predicted: FloatArray) -> Prediction:
        """Judge predicted deflections (N, T, 3) [m]."""
        residual = np.where(measurements.present[..., None], measurements.deflection - predicted, 0.0)
        left = np.linalg.norm(residual[measurements.present], axis=-1)
        moved = np.linalg.norm(measurements.deflection[measurements.present], axis=-1).mean()
        return cls(
            predicted=predicted,
            residual=residual,
            compensation=float(1.0 - left.mean() / moved) if moved > 0 else None,
            rms_residual=float(np.sqrt(np.mean(left**2))),
        )


def predict(
    robot: Robot,
    measurements: Measurements,
    compliance: FloatArray,
    *,
    complementary_stiffness: bool = False,
) -> Prediction:
    """Predict the deflections of the targets, ``δp_X = A_X c`` (METHOD.md §2).

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) [rad/(N·m)].
        complementary_stiffness: whether the load follows the deflection, as in the fit that found the
            compliances: the deflections are then those of the exact balance, to third order.

    Returns:
        The prediction beside the measurements.

    Raises:
        SolverError: the load finds no balance with joints of that compliance.
    """
    blocks = regressor_blocks(robot, measurements, compliance if complementary_stiffness else None)
    predicted = np.concatenate([block.A @ compliance for block in blocks])
    return Prediction.of(measurements, predicted)
