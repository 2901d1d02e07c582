"""The loaded posture: the exact balance of springs, load and own weight (method.md §9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.own_weight import OwnWeight
from jointstiff.solver.errors import RequestError
from jointstiff.solver.regression.complementary_stiffness import wrench_stiffness
from jointstiff.solver.regression.regressor import joint_torque
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

_STEPS = 20
"""Newton's; four suffice for the loads of machining."""
_BALANCED = 64 * np.finfo(np.float64).eps
"""Residual, relative to the deflection by all forces at their full levers, that is rounding."""
LARGEST_DEFLECTION = 1.0
"""A balance further away [rad] may be on another branch."""


@dataclass(frozen=True, eq=False)
class LoadedPosture:
    """B load cases in balance: ``δθ = c ∘ (τ(q + δθ) + g(q + δθ) − g(q))``."""

    cases: LoadCases  #: whose balance it is
    deflection: FloatArray  #: (B, n) δθ of the joints [rad]
    #: (B, n) by which the load, with the change of the own weight's, twists the joints [N·m]
    torque: FloatArray
    stiffness: FloatArray  #: (B, n, n) K_c + ∂g/∂q of load and own weight, in the loaded posture [N·m/rad]
    softened: FloatArray  #: (B, n, n) ``(I − diag(c)(K_c + ∂g/∂q))⁻¹``, the answer of δθ to a change of c ∘ τ
    unloaded: Configurations  #: kinematics without the load
    loaded: Configurations  #: kinematics with it

    @classmethod
    def of(
        cls, robot: Robot, compliance: FloatArray, cases: LoadCases, weight: OwnWeight | None = None
    ) -> LoadedPosture:
        """Balance springs and loads by Newton's method.

        Args:
            robot: n joints.
            compliance: (n,) [rad/(N·m)].
            cases: B load cases.
            weight: of the links; None leaves it out.

        Raises:
            RequestError: a load finds no stable balance near the unloaded posture.
        """
        q = robot.joint_map.model_angles(cases.joints)
        unloaded = loaded = Configurations(robot, q)
        rest = _weight(robot, q, unloaded, weight)[0]
        deflection = np.zeros(q.shape)
        for _ in range(_STEPS):
            torque, stiffness = load_and_stiffness(cases, loaded)
            own, own_stiffness = _weight(robot, q + deflection, loaded, weight)
            torque, stiffness = torque + own - rest, stiffness + own_stiffness
            residual = deflection - compliance * torque
            slope = np.eye(robot.n) - compliance[:, None] * stiffness
            away = ~(np.abs(residual) <= _BALANCED * _scale(compliance, cases, loaded, own))
            if not away.any():
                require_stable(deflection, slope)
                softened = np.asarray(np.linalg.inv(slope), dtype=np.float64)
                return cls(cases, deflection, torque, stiffness, softened, unloaded, loaded)
            deflection = deflection - solved(slope, residual)
            refuse_unbalanced(np.asarray(~(np.abs(deflection) <= 2.0 * LARGEST_DEFLECTION).all(axis=1)))
            loaded = Configurations(robot, q + deflection)
        raise no_balance(int(np.argmax(away.any(axis=1))))

    @property
    def displacement(self) -> FloatArray:
        """(B, 3) by which the places move, axes of R0 [m]."""
        place = self.cases.place[:, None]
        moved: FloatArray = (self.loaded.to_base(place) - self.unloaded.to_base(place))[:, 0]
        return moved

    @property
    def rotation(self) -> FloatArray:
        """(B, 3) rotation vector of the flange, axes of R0 [rad]."""
        return rotation_vector(self.loaded.flange_rotation @ self.unloaded.flange_rotation.transpose(0, 2, 1))

    def jacobian(self, point: FloatArray) -> FloatArray:
        """(B, 6, n) of flange-fixed points (B, 3) [m], in the loaded posture: translation, then rotation."""
        linear = self.loaded.jacobian_at(self.loaded.to_base(point[:, None]))[:, 0]
        return np.concatenate([linear, self.loaded.angular_jacobian], axis=1)


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return rotation vectors (..., 3) [rad] of rotations (..., 3, 3) by less than a quarter turn."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))
    sine_axis = skew[..., [2, 0, 1], [1, 2, 0]]
    sine = np.linalg.norm(sine_axis, axis=-1, keepdims=True)
    angle: FloatArray = np.arcsin(np.minimum(sine, 1.0))
    return sine_axis * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)


def load_and_stiffness(cases: LoadCases, configurations: Configurations) -> tuple[FloatArray, FloatArray]:
    """Return torques (B, n) [N·m] and K_c (B, n, n) [N·m/rad] of the loads in given postures."""
    points = configurations.to_base(cases.load_point[:, None])
    jacobian = configurations.jacobian_at(points)[:, 0]
    torque = joint_torque(configurations, jacobian, cases.force, cases.moment)
    return torque, wrench_stiffness(configurations, jacobian, cases.force, cases.moment)


def _weight(
    robot: Robot, q: FloatArray, configurations: Configurations, weight: OwnWeight | None
) -> tuple[FloatArray, FloatArray]:
    if weight is None:
        return np.zeros(q.shape), np.zeros((*q.shape, robot.n))
    return weight.torque_and_stiffness(robot, q, configurations)


def _scale(
    compliance: FloatArray, cases: LoadCases, configurations: Configurations, own: FloatArray
) -> FloatArray:
    """(B, 1) deflection [rad] of the softest joint under all forces at their full levers."""
    arm = np.linalg.norm(configurations.flange_translation, axis=1)
    arm = arm + np.linalg.norm(cases.load_point, axis=1)
    force, moment = (np.linalg.norm(vector, axis=1) for vector in (cases.force, cases.moment))
    torque = force * arm + moment + np.abs(own).max(axis=1)
    return np.asarray(np.abs(compliance).max() * torque[:, None])


def require_stable(deflection: FloatArray, slope: FloatArray) -> None:
    """Refuse a balance that is not stable.

    It is where I − diag(c)(K_c + ∂g/∂q), similar to a scaled stiffness, is positive.

    Rows and columns that stay close to those of the identity show it without eigenvalues (Gershgorin).
    """
    refuse_unbalanced(np.asarray((np.abs(deflection) > LARGEST_DEFLECTION).any(axis=1)))
    off = np.abs(slope - np.eye(slope.shape[1]))
    if off.max() * slope.shape[1] < 1.0:
        return
    unstable = off.sum(axis=2).max(axis=1) >= 1.0
    if unstable.any():
        doubtful = slope[unstable]
        singular = np.linalg.slogdet(doubtful).sign == 0.0  # whose eigenvalue may be rounded to either side
        unstable[unstable] = singular | (np.linalg.eigvals(doubtful).real <= 0.0).any(axis=1)
    refuse_unbalanced(unstable)


def solved(slope: FloatArray, residual: FloatArray) -> FloatArray:
    """Return ``slope⁻¹ residual`` (B, n)."""
    try:
        return np.asarray(np.linalg.solve(slope, residual[..., None])[..., 0], dtype=np.float64)
    except np.linalg.LinAlgError:
        refuse_unbalanced(np.linalg.slogdet(slope).sign == 0.0)
        raise


def refuse_unbalanced(failed: BoolArray) -> None:
    """Raise for the first case (B,) that finds no stable balance."""
    if failed.any():
        raise no_balance(int(np.argmax(failed)))


def no_balance(case: int) -> RequestError:
    """Return the error of a load that finds no stable balance."""
    return RequestError(
        "the load finds no stable balance near the unloaded posture",
        where=f"cases[{case}]",
        remedy="check the units of force, moment and length, or lessen the load",
    )
