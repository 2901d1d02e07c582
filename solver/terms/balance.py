"""The exact balance of springs, load and own weight (method.md §2, §9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

_STEPS: Final = 20
"""Newton's; three suffice for the loads of machining."""
_LAST_STEP: Final = 1e-8
"""Step [rad] that is taken to first order: it leaves half of its square, 1e-16 m at an arm's reach."""
_LARGEST_DEFLECTION: Final = 1.0
"""A balance further away [rad] may be on another branch."""


class Loads(Protocol):
    """B dead wrenches: measured, or asked about."""

    @property
    def force(self) -> FloatArray:
        """(B, 3) on the robot, axes of R0 [N]."""

    @property
    def moment(self) -> FloatArray:
        """(B, 3) on the robot about the load point, axes of R0 [N·m]."""

    @property
    def load_point(self) -> FloatArray:
        """(B, 3) where the force acts, flange frame [m]."""


class Weight(Protocol):
    """Own weight of the links."""

    @property
    def absolute(self) -> bool:
        """Return true if deflections are from the arm that does not bend: the sag is part of them."""

    def torque_and_stiffness(
        self, robot: Robot, configurations: Configurations
    ) -> tuple[FloatArray, FloatArray]:
        """Return the torques g(q) (B, n) [N·m] and ``∂g/∂q`` (B, n, n) [N·m/rad]."""


@dataclass(frozen=True, eq=False)
class Balance:
    """B load cases in balance: ``δθ = c ∘ (τ(q + δθ) + g(q + δθ) − g(q))``; without g(q) for the sag, too.

    Torques and stiffness are of a posture one last step before the balance.
    """

    loaded: Configurations  #: kinematics there
    step: FloatArray  #: (B, n) the last step [rad]
    #: (B, n) torque by which the load, with the change of the own weight's, twists the joints [N·m]
    torque: FloatArray
    stiffness: FloatArray  #: (B, n, n) K_c + ∂g/∂q of load and own weight [N·m/rad]
    slope: FloatArray  #: (B, n, n) ``I − diag(c)(K_c + ∂g/∂q)``


def balance(
    robot: Robot,
    compliance: FloatArray,
    cases: Loads,
    weight: Weight | None,
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
    rest: FloatArray | float = 0.0
    if weight is not None and not weight.absolute:
        rest = weight.torque_and_stiffness(robot, unloaded)[0]
    loaded = near
    for _ in range(_STEPS):
        deflection = loaded.q - unloaded.q
        jacobian, torque = loaded.load(cases.load_point, cases.force, cases.moment)
        stiffness = wrench_stiffness(loaded.angular_jacobian, jacobian, cases.force, cases.moment)
        if weight is not None:
            own, own_stiffness = weight.torque_and_stiffness(robot, loaded)
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


def wrench_stiffness(
    axes: FloatArray, load_jacobian: FloatArray, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """Return ``K_c,jk = ∂τ_j/∂θ_k`` of wrenches, as `complementary_stiffness` states it.

    Args:
        axes: (B, 3, n) of the joints, R0.
        load_jacobian: (B, 3, n) J_v at the load points [m/rad].
        force: (B, 3) on the robot, axes of R0 [N].
        moment: (B, 3) on the robot about the load point, axes of R0 [N·m].

    Returns:
        (B, n, n) [N·m/rad].
    """
    axes, v = axes.transpose(1, 2, 0), load_jacobian.transpose(1, 2, 0)
    by_force = (np.cross(force.T[:, None], axes, axis=0)[:, :, None] * v[:, None]).sum(axis=0)
    below = np.tri(len(by_force), k=-1, dtype=np.bool_)[..., None]
    stiffness: FloatArray = np.where(below, by_force.transpose(1, 0, 2), by_force)
    if moment.any():
        turned = np.cross(moment.T[:, None], axes, axis=0)
        stiffness += below * (axes[:, :, None] * turned[:, None]).sum(axis=0)
    return stiffness.transpose(2, 0, 1)


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
        remedy="check the units of force, moment and length, or reduce the load",
    )
