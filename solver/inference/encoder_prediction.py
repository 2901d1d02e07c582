"""Predicted readings of secondary encoders, and encoders that contradict the load."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.finding import Finding
from jointstiff.solver.readings.encoders import EncoderReadings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.regressor import regressor_blocks
from jointstiff.solver.robot.model import Robot

AGAINST_SIGMAS: Final = 5.0
"""Deflection opposite to the torque, in standard deviations, above which it is not noise."""
LARGEST_ENCODER_DEFLECTION: Final = 0.02
"""Largest plausible deflection of a joint [rad]: more is a mistake in a unit, or a robot that moved."""


def predict_encoders(
    robot: Robot,
    measurements: Measurements,
    compliance: FloatArray,
    *,
    complementary_stiffness: bool = False,
) -> FloatArray:
    """Deflections of the joints behind their gearboxes, ``δθ = diag(τ) c`` (method.md §2).

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) [rad/(N·m)].
        complementary_stiffness: whether the load follows the deflection, as in the fit.

    Returns:
        (N, n) [rad].
    """
    return _torques(robot, measurements, compliance if complementary_stiffness else None) * compliance


def inspect_encoders(robot: Robot, measurements: Measurements) -> list[Finding]:
    """Look for encoders that cannot be right: against the load's torque, or further than joints bend.

    A spring gives way to its torque, so ``τ_j δθ_j`` is work done on it, and not negative but by noise.

    Args:
        robot: n joints.
        measurements: N observations.

    Returns:
        At most one finding of each kind a joint.
    """
    encoders = measurements.encoders
    if encoders is None:
        return []
    torque = _torques(robot, measurements)
    against = encoders.present & (
        -encoders.deflection * np.sign(torque) > AGAINST_SIGMAS * np.sqrt(2.0) * encoders.sigma
    )
    return [*_against(robot, encoders, against, torque), *_large(robot, encoders)]


def _torques(robot: Robot, measurements: Measurements, compliance: FloatArray | None = None) -> FloatArray:
    return np.concatenate([block.torque for block in regressor_blocks(robot, measurements, compliance)])


def _against(
    robot: Robot, encoders: EncoderReadings, against: BoolArray, torque: FloatArray
) -> Iterator[Finding]:
    for j in np.flatnonzero(against.any(axis=0)):
        rows = np.flatnonzero(against[:, j])
        worst = int(rows[np.abs(encoders.deflection[rows, j]).argmax()])
        yield Finding(
            "encoder_against_torque",
            worst if len(rows) == 1 else None,
            f"the encoder of {robot.joint_names[j]} shows {1e6 * encoders.deflection[worst, j]:.3g} "
            f"µrad, opposite to the torque of {torque[worst, j]:.4g} N.m, in {len(rows)} of "
            f"{int(encoders.present[:, j].sum())} readings",
            "check the encoder's sign, which is that of the model's joint, not the controller's; that "
            "unloaded and loaded are not exchanged; and the signs of the force",
        )


def _large(robot: Robot, encoders: EncoderReadings) -> Iterator[Finding]:
    size = np.abs(encoders.deflection)
    for j in np.flatnonzero(size.max(axis=0) > LARGEST_ENCODER_DEFLECTION):
        worst = int(size[:, j].argmax())
        yield Finding(
            "encoder_deflection_implausibly_large",
            worst,
            f"the encoder of {robot.joint_names[j]} shows a deflection of {1e3 * size[worst, j]:.3g} mrad",
            "check `units.angle`, and that unloaded and loaded readings are of the same posture",
        )
