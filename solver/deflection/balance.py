"""The exact balance of springs, load and own weight (method.md §9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.own_weight import OwnWeight
from jointstiff.solver.errors import RequestError
from jointstiff.solver.regression.complementary_stiffness import wrench_stiffness
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

_STEPS: Final = 20
"""Newton's; three suffice for the loads of machining."""
_LAST_STEP: Final = 1e-9
"""Step [rad] that is taken to first order: what it leaves is its square."""
_LARGEST_DEFLECTION: Final = 1.0
"""A balance further away [rad] may be on another branch."""


@dataclass(frozen=True, eq=False)
class Balance:
    """B load cases in balance: ``δθ = c ∘ (τ(q + δθ) + g(q + δθ) − g(q))``.

    Torques and stiffness are of a posture one last step before the balance.
    """

    loaded: Configurations  #: kinematics there
    step: FloatArray  #: (B, n) the last step [rad]
    #: (B, n) by which the load, with the change of the own weight's, twists the joints [N·m]
    torque: FloatArray
    stiffness: FloatArray  #: (B, n, n) K_c + ∂g/∂q of load and own weight [N·m/rad]
    slope: FloatArray  #: (B, n, n) ``I − diag(c)(K_c + ∂g/∂q)``


def balance(
    robot: Robot,
    compliance: FloatArray,
    cases: LoadCases,
    weight: OwnWeight | None,
    unloaded: Configurations,
    near: Configurations,
) -> Balance:
    """Find the balance by Newton's method.

    Args:
        robot: n joints.
        compliance: (n,) [rad/(N·m)].
        cases: B load cases.
        weight: of the links; None leaves it out.
        unloaded: kinematics without the load.
        near: kinematics to start from.

    Raises:
        RequestError: a load finds no stable balance near the unloaded posture.
    """
    rest = 0.0 if weight is None else weight.torque_and_stiffness(robot, unloaded.q, unloaded)[0]
    loaded = near
    for _ in range(_STEPS):
        deflection = loaded.q - unloaded.q
        jacobian, torque = loaded.load(cases.load_point, cases.force, cases.moment)
        stiffness = wrench_stiffness(loaded, jacobian, cases.force, cases.moment)
        if weight is not None:
            own, own_stiffness = weight.torque_and_stiffness(robot, loaded.q, loaded)
            torque, stiffness = torque + own - rest, stiffness + own_stiffness
        slope = np.eye(robot.n) - compliance[:, None] * stiffness
        residual = compliance * torque - deflection
        try:
            step = np.asarray(np.linalg.solve(slope, residual[..., None])[..., 0], dtype=np.float64)
        except np.linalg.LinAlgError:
            _refuse(np.linalg.slogdet(slope).sign == 0.0)
            raise
        deflection = deflection + step
        if (np.abs(step) <= _LAST_STEP).all():
            _refuse(np.asarray((np.abs(deflection) > _LARGEST_DEFLECTION).any(axis=1)))
            _refuse(_unstable(slope))
            return Balance(loaded, step, torque, stiffness, slope)
        _refuse(np.asarray(~(np.abs(deflection) <= 2.0 * _LARGEST_DEFLECTION).all(axis=1)))
        loaded = Configurations(robot, unloaded.q + deflection)
    raise _no_balance(int(np.argmax(np.abs(step).max(axis=1))))


def _unstable(slope: FloatArray) -> BoolArray:
    """Return whether balances (B,) are not stable: slopes, similar to scaled stiffnesses, not positive.

    Rows and columns that stay close to those of the identity show it without eigenvalues (Gershgorin).
    """
    off = np.abs(slope - np.eye(slope.shape[1]))
    unstable: BoolArray = off.sum(axis=2).max(axis=1) >= 1.0
    if unstable.any():
        doubtful = slope[unstable]
        singular = np.linalg.slogdet(doubtful).sign == 0.0  # whose eigenvalue may be rounded to either side
        unstable[unstable] = singular | (np.linalg.eigvals(doubtful).real <= 0.0).any(axis=1)
    return unstable


def _refuse(failed: BoolArray) -> None:
    """Raise for the first case (B,) that finds no stable balance."""
    if failed.any():
        raise _no_balance(int(np.argmax(failed)))


def _no_balance(case: int) -> RequestError:
    return RequestError(
        "the load finds no stable balance near the unloaded posture",
        where=f"cases[{case}]",
        remedy="check the units of force, moment and length, or lessen the load",
    )


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return rotation vectors (..., 3) [rad] of rotations (..., 3, 3) by less than a quarter turn."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))
    sine_axis = skew[..., [2, 0, 1], [1, 2, 0]]
    sine = np.linalg.norm(sine_axis, axis=-1, keepdims=True)
    angle: FloatArray = np.arcsin(np.minimum(sine, 1.0))
    return sine_axis * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)
