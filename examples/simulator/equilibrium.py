"""The exact balance of joint springs and a dead wrench, and the deflections it causes.

Units are SI (m, rad, N, N·m); axes of R0 unless it says otherwise. In every function

* `arm` is the arm, with n joints;
* `q` are the joint positions without load [rad, of prismatic joints m], (..., n);
* `force` F on the robot acts at the load point [N], axes of R0, (..., 3);
* `moment` M on the robot is taken about the load point [N·m], axes of R0, (..., 3);
* `load_point` p_W is where the force acts, in the flange frame [m], (..., 3);
* `targets` are points in the flange frame [m], (T, 3).

Leading axes are broadcast as numpy does it. The wrench is dead: F and M stay fixed in R0 while the
load point moves with the flange.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, SpringArm

__all__ = [
    "EquilibriumError",
    "deflections",
    "equilibrium",
    "linear_deflections",
    "torque_derivative",
    "torques",
]

MAX_NEWTON_STEPS = 30
MAX_DEFLECTION = 1.0  # [rad]; a balance further away may be on another branch
EPSILON = float(np.finfo(float).eps)
ROUNDING_ERRORS = 64.0  # converged: the residual is so many rounding errors of its largest term


class EquilibriumError(RuntimeError):
    """The springs find no stable balance with the load near the unloaded posture."""


def torques(
    arm: SpringArm, q: ArrayLike, force: ArrayLike, moment: ArrayLike, load_point: ArrayLike
) -> FloatArray:
    """Torques of the wrench about the axes [N·m], (..., n), in the posture q.

    `τ_j = F · (a_j × (p_W − o_j)) + M · a_j`.
    """
    posture = arm.posture(q)
    velocities = posture.velocities(posture.point_to_base(load_point))
    of_force: FloatArray = np.einsum("...ji,...i->...j", velocities, np.asarray(force, float))
    of_moment: FloatArray = np.einsum("...ji,...i->...j", posture.turns, np.asarray(moment, float))
    return of_force + of_moment


def torque_derivative(
    arm: SpringArm, q: ArrayLike, force: ArrayLike, moment: ArrayLike, load_point: ArrayLike
) -> FloatArray:
    """Return the derivative of the torques, ∂τ_j/∂θ_k [N·m/rad], row j, column k, (..., n, n).

    With v_j = a_j × (p_W − o_j): a joint k before j turns a_j and v_j, a joint k after j moves p_W
    by v_k. So `∂τ_j/∂θ_k = F · (a_min(j,k) × v_max(j,k)) + [k < j] M · (a_k × a_j)`. Of a joint that
    slides along a_j, v_j = a_j, and zero stands for a_j in both products. The part of F
    is symmetric, because a dead force has a potential; the part of M is not.
    """
    posture = arm.posture(q)
    axes = posture.turns
    velocities = posture.velocities(posture.point_to_base(load_point))
    axis_by_velocity = np.cross(axes[..., :, None, :], velocities[..., None, :, :])
    axis_by_axis = np.cross(axes[..., None, :, :], axes[..., :, None, :])
    of_force = np.einsum("...jki,...i->...jk", axis_by_velocity, np.asarray(force, float))
    of_moment = np.einsum("...jki,...i->...jk", axis_by_axis, np.asarray(moment, float))
    below = np.swapaxes(np.triu(of_force, 1), -1, -2) + np.tril(of_moment, -1)
    derivative: FloatArray = np.triu(of_force) + below
    return derivative


def equilibrium(
    arm: SpringArm, q: ArrayLike, force: ArrayLike, moment: ArrayLike, load_point: ArrayLike
) -> FloatArray:
    """Joint deflections δθ [rad], (..., n), at which every spring balances the load exactly.

    Solves `k_j δθ_j = τ_j(q + δθ)`, with the torque in the *deflected* posture, in the form
    `r(δθ) = δθ − c ∘ τ(q + δθ) = 0`, so that a rigid joint (c = 0) keeps δθ = 0 exactly. Newton's
    method, from the unloaded posture, with `∂r/∂θ = I − diag(c) ∂τ/∂θ`, until r is down to
    rounding.

    Raises:
        ValueError: An angle, the wrench or the load point is not finite.
        EquilibriumError: No balance is found, or it is unstable (the load buckles the arm).
    """
    q, force, moment, load_point = _batched(arm, q, force, moment, load_point)
    deflection = np.zeros(q.shape)
    for _ in range(MAX_NEWTON_STEPS):
        wrench = (q + deflection, force, moment, load_point)
        residual = deflection - arm.compliances * torques(arm, *wrench)
        derivative = np.eye(q.shape[-1]) - arm.compliances[:, None] * torque_derivative(arm, *wrench)
        if np.all(np.abs(residual) <= _rounding(arm, *wrench)):
            _require_stable(deflection, derivative)
            return deflection
        deflection = deflection - _newton_step(derivative, residual)
    msg = f"no balance after {MAX_NEWTON_STEPS} Newton steps; reduce the load or stiffen the joints"
    raise EquilibriumError(msg)


def deflections(
    arm: SpringArm,
    q: ArrayLike,
    force: ArrayLike,
    moment: ArrayLike,
    load_point: ArrayLike,
    targets: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Exact positions of the targets in R0 [m], each (..., T, 3): without load, and with it.

    Loaded minus unloaded is the deflection; it carries the rounding of positions, about 1e-15 m.
    """
    deflection = equilibrium(arm, q, force, moment, load_point)
    unloaded = np.broadcast_to(np.asarray(q, float), deflection.shape)
    loaded = unloaded + deflection
    return (
        arm.posture(unloaded).targets_to_base(targets),
        arm.posture(loaded).targets_to_base(targets),
    )


def linear_deflections(
    arm: SpringArm,
    q: ArrayLike,
    force: ArrayLike,
    moment: ArrayLike,
    load_point: ArrayLike,
    targets: ArrayLike,
) -> FloatArray:
    """First-order deflections of the targets in R0 [m], (..., T, 3).

    `δp_X = J_v(q, P1X) diag(c) τ(q)`, method.md §2. Its relative difference from the exact
    deflection falls in proportion to the load.
    """
    twist = arm.compliances * torques(arm, q, force, moment, load_point)  # δθ [rad], (..., n)
    posture = arm.posture(q)
    positions = posture.targets_to_base(targets)
    levers = positions[..., :, None, :] - posture.axis_points[..., None, :, :]
    velocities = np.cross(posture.turns[..., None, :, :], levers)  # (..., T, n, 3)
    velocities = velocities + posture.slides[..., None, :, :]
    linear: FloatArray = np.einsum("...tji,...j->...ti", velocities, twist)
    return linear


def _batched(
    arm: SpringArm, q: ArrayLike, force: ArrayLike, moment: ArrayLike, load_point: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Check the inputs and repeat the angles over the leading axes of all of them."""
    arrays = [np.asarray(value, dtype=float) for value in (q, force, moment, load_point)]
    if not all(np.all(np.isfinite(array)) for array in arrays):
        msg = "joint angles, force, moment and load point must be finite"
        raise ValueError(msg)
    leading = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    angles = np.broadcast_to(arrays[0], (*leading, len(arm.stiffnesses)))
    return angles, arrays[1], arrays[2], arrays[3]


def _rounding(
    arm: SpringArm, q: FloatArray, force: FloatArray, moment: FloatArray, load_point: FloatArray
) -> FloatArray:
    """Rounding of the residual [rad], (..., 1): eps · max_j c_j (|F| |p_W − o_j| + |M|)."""
    posture = arm.posture(q)
    levers = posture.point_to_base(load_point)[..., None, :] - posture.axis_points
    of_force = np.linalg.norm(force, axis=-1)[..., None] * np.linalg.norm(levers, axis=-1)
    largest_torques = of_force + np.linalg.norm(moment, axis=-1)[..., None]
    scale = np.max(arm.compliances * largest_torques, axis=-1, keepdims=True)
    return np.asarray(ROUNDING_ERRORS * EPSILON * scale, dtype=np.float64)


def _newton_step(derivative: FloatArray, residual: FloatArray) -> FloatArray:
    try:
        step = np.linalg.solve(derivative, residual[..., None])[..., 0]
    except np.linalg.LinAlgError as singular:
        msg = "the load makes the arm lose all stiffness; reduce the load or stiffen the joints"
        raise EquilibriumError(msg) from singular
    return np.asarray(step, dtype=np.float64)


def _require_stable(deflection: FloatArray, derivative: FloatArray) -> None:
    """A balance is stable where I − diag(c) ∂τ/∂θ, similar to a scaled stiffness, is positive."""
    if np.any(np.abs(deflection) > MAX_DEFLECTION):
        msg = f"a joint deflects by more than {MAX_DEFLECTION:.2f} rad; reduce the load"
        raise EquilibriumError(msg)
    if np.any(np.linalg.eigvals(derivative).real <= 0.0):
        msg = "the load buckles the arm: the balance is unstable; reduce the load"
        raise EquilibriumError(msg)
