"""The linear model of METHOD.md §2: deflections of the targets as a linear function of compliance.

Everything is built for a block of configurations at once; a block is small enough that memory stays flat
however many observations there are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from solver.configuration import Configurations
from solver.exceptions import MeasurementError
from solver.measurements import Measurements
from solver.robot import Robot

__all__ = ["BLOCK_LENGTH", "RegressorBlock", "joint_torque", "regressor_blocks", "whitener"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

BLOCK_LENGTH = 2048
"""Configurations in a block: its arrays stay in the cache, and numpy's overhead is spread well."""


@dataclass(frozen=True, eq=False)
class RegressorBlock:
    """Regressors of B observations of T targets of a robot with n joints.

    Attributes:
        configurations: the kinematics.
        torque: (B, n) torque of the load about each joint [N·m].
        load_jacobian: (B, 3, n) J_v at the load point [m/rad].
        points: (B, T, 3) the targets in R0, unloaded [m].
        jacobian: (B, T, 3, n) J_v at the targets [m/rad].
        A: (B, T, 3, n) regressor of the deflections [m / (rad/(N·m))]; zero where not present.
        measurements: the observations themselves.
    """

    configurations: Configurations
    torque: FloatArray
    load_jacobian: FloatArray
    points: FloatArray
    jacobian: FloatArray
    A: FloatArray
    measurements: Measurements


def joint_torque(
    configurations: Configurations, load_jacobian: FloatArray, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """``τ = J_v(q, p_W)ᵀ F + J_ω(q)ᵀ M`` (METHOD.md §2; paper, eq. 12).

    Args:
        configurations: N configurations.
        load_jacobian: (N, 3, n) J_v at the load points [m/rad].
        force: (N, 3) on the robot, axes of R0 [N].
        moment: (N, 3) on the robot about the load point, axes of R0 [N·m].

    Returns:
        (N, n) torques [N·m].
    """
    by_force: FloatArray = np.einsum("nij,ni->nj", load_jacobian, force)
    by_moment: FloatArray = np.einsum("nij,ni->nj", configurations.angular_jacobian, moment)
    return by_force + by_moment


def regressor_blocks(robot: Robot, measurements: Measurements) -> Iterator[RegressorBlock]:
    """Yield the regressors block by block.

    Args:
        robot: n joints.
        measurements: N observations.

    Yields:
        Blocks of at most `BLOCK_LENGTH` observations, in order.
    """
    if len(measurements) <= BLOCK_LENGTH:
        yield _block(robot, measurements)
        return
    for start in range(0, len(measurements), BLOCK_LENGTH):
        yield _block(robot, measurements[start : start + BLOCK_LENGTH])


def _block(robot: Robot, part: Measurements) -> RegressorBlock:
    configurations = Configurations(robot, robot.joint_map.model_angles(part.joints))
    load_points = configurations.to_base(part.load_point[:, None])
    load_jacobian = configurations.jacobian_at(load_points)[:, 0]
    torque = joint_torque(configurations, load_jacobian, part.force, part.moment)
    points = part.position
    if part.in_flange.any():
        points = np.where(part.in_flange[..., None], configurations.to_base(points), points)
    jacobian = configurations.jacobian_at(points)
    A = jacobian * torque[:, None, None]
    if not part.present.all():
        A[~part.present] = 0.0
    return RegressorBlock(configurations, torque, load_jacobian, points, jacobian, A, part)


def whitener(covariance: FloatArray) -> FloatArray:
    """W with ``Wᵀ W = Σ⁻¹``, the inverse of the Cholesky factor of Σ (METHOD.md §5, step 1).

    Args:
        covariance: (..., m, m).

    Returns:
        (..., m, m) lower triangular.

    Raises:
        MeasurementError: if a covariance is not finite, symmetric and positive definite.
    """
    scale = np.abs(covariance).max()
    if not np.isfinite(scale) or (np.abs(covariance - np.swapaxes(covariance, -1, -2)) > 1e-9 * scale).any():
        raise _not_a_covariance()
    try:
        inverse: FloatArray = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise _not_a_covariance() from None
    return inverse


def _not_a_covariance() -> MeasurementError:
    return MeasurementError(
        "a covariance is not finite, symmetric and positive definite",
        where="noise",
        remedy="check the stated uncertainties",
    )
