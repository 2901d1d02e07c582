"""Inverse kinematics of arms with six joints: all branches in closed form (EAIK), made exact by Newton steps.

EAIK finds how a chain decomposes into subproblems of known solution (Ostermeier, Külz, Althoff, *Automatic
Geometric Decomposition for Analytical Inverse Kinematics*, 2024). A chain that was identified by measurement
decomposes no more, as no two of its axes are parallel or meet exactly: then the branches of the nearest chain
that does are where Newton's method begins.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import Robot

BRANCHES: Final = 8
"""Most solutions kept for a pose; more exist only where a joint is free to turn."""
_JOINTS: Final = 6
_STEPS: Final = 8
_REACHED: Final = 1e-10
"""Distance [m] and angle [rad] from the pose that is rounding."""
_SNAP: Final = 1e-2
"""Parts of an axis, and of a step between axes [m], that identification rather than design put there."""
_DAMPING: Final = 1e-12


class InverseKinematics:
    """Joint angles that bring the flange to poses.

    Attributes:
        robot: the robot, six joints.
    """

    def __init__(self, robot: Robot) -> None:
        """Find how the chain decomposes.

        Raises:
            RobotError: the robot has not six joints, or no chain near it decomposes.
        """
        if robot.n != _JOINTS:
            raise RobotError(
                f"the robot has {robot.n} joints",
                remedy="inverse kinematics needs an arm with six revolute joints",
                where="robot",
            )
        self.robot = robot
        self._solver, self._exact = _decomposed(robot)

    def branches(self, poses: FloatArray) -> FloatArray:
        """Return all solutions of poses (m, 4, 4) of the flange in R0 [m].

        Returns:
            (m, 8, 6) angles of the model in [−π, π] [rad], filled up with NaN.
        """
        angles = np.full((len(poses), BRANCHES, _JOINTS), np.nan)
        for pose, found in zip(poses, angles, strict=True):
            solution = self._solver.calculate_IK(pose)
            kept = np.asarray(solution.Q, dtype=np.float64).reshape(-1, _JOINTS)
            if self._exact:  # least squares where the pose is out of reach; near it, Newton's method decides
                kept = kept[~np.asarray(solution.is_LS, dtype=bool)]
            found[: len(kept)] = kept[:BRANCHES]
        if not self._exact:
            case, branch = np.nonzero(np.isfinite(angles[:, :, 0]))
            polished, reached = self.polished(poses[case], angles[case, branch])
            polished[~reached] = np.nan
            angles[case, branch] = polished
        return angles

    def nearest(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the solution nearest to given angles, full turns added to come near them.

        Args:
            poses: (m, 4, 4) of the flange in R0 [m].
            near: (m, 6) angles of the model [rad].

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether the pose is reached.
        """
        angles = self.branches(poses)
        angles += 2.0 * np.pi * np.round((near[:, None] - angles) / (2.0 * np.pi))
        far = np.nan_to_num(np.abs(angles - near[:, None]).max(axis=2), nan=np.inf)
        best = np.argmin(far, axis=1)
        chosen = angles[np.arange(len(poses)), best]
        reached = np.isfinite(chosen).all(axis=1)
        return np.where(reached[:, None], chosen, near), reached

    def polished(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Follow Newton's method from given angles (m, 6) [rad] to poses (m, 4, 4) [m].

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether the pose is reached.
        """
        q = near.copy()
        for _ in range(_STEPS):
            here = Configurations(self.robot, q)
            step = _twist(here, poses)
            if (np.abs(step) <= _REACHED).all():
                break
            jacobian = np.concatenate(
                [here.jacobian_at(here.flange_translation[:, None])[:, 0], here.angular_jacobian], axis=1
            )
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            q = q + (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, step[..., None]))[..., 0]
        near_enough = np.abs(_twist(Configurations(self.robot, q), poses)) <= _REACHED
        return q, np.asarray(near_enough.all(axis=1))


def flange_poses(robot: Robot, q: FloatArray) -> FloatArray:
    """Return poses (m, 4, 4) [m] of the flange in R0 at angles (m, n) of the model [rad]."""
    here = Configurations(robot, q)
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = here.flange_rotation, here.flange_translation
    return poses


def _twist(here: Configurations, poses: FloatArray) -> FloatArray:
    """Return displacement [m] and rotation vector [rad] (m, 6), axes of R0, from the flange to the poses."""
    from scipy.spatial.transform import Rotation  # costs start-up, and few commands need it

    turn = poses[:, :3, :3] @ here.flange_rotation.transpose(0, 2, 1)
    axis = Rotation.from_matrix(turn).as_rotvec()
    return np.concatenate([poses[:, :3, 3] - here.flange_translation, axis], axis=1)


def _decomposed(robot: Robot) -> tuple[Any, bool]:
    """Return EAIK's solver, and whether it is of this chain or of the nearest one that decomposes."""
    EAIK = _eaik()
    zero = np.zeros((1, robot.n))
    rotation, origin = joint_frames(robot, zero)
    flange = Configurations(robot, zero)
    axes = np.stack([R @ joint.axis for R, joint in zip(rotation[0], robot.chain.revolute, strict=True)])
    steps = np.diff(np.vstack([np.zeros(3), origin[0], flange.flange_translation]), axis=0)
    for exact in (True, False):
        H, P = (axes, steps) if exact else (_snapped_axes(axes), np.where(np.abs(steps) < _SNAP, 0.0, steps))
        solver = EAIK.Robot(H.T, P.T, flange.flange_rotation[0], [], True)
        if solver.has_known_decomposition():
            return solver, exact
    raise RobotError(
        "no closed-form inverse kinematics is known for this arrangement of axes",
        remedy="use an arm with three parallel axes, or with a wrist whose axes meet",
        where="robot",
    )


def _eaik() -> Any:  # noqa: ANN401  # it has no types
    """Import EAIK where inverse kinematics is needed first.

    Raises:
        RobotError: there is none for this version of Python.
    """
    try:
        from eaik.pybindings import EAIK
    except ImportError:
        raise RobotError(
            "inverse kinematics needs EAIK, which is not installed",
            remedy="use a version of Python that EAIK has wheels for, 3.11 to 3.13",
            where="robot",
        ) from None
    return EAIK


def _snapped_axes(axes: FloatArray) -> FloatArray:
    snapped = np.where(np.abs(axes) < _SNAP, 0.0, axes)
    unit: FloatArray = snapped / np.linalg.norm(snapped, axis=1, keepdims=True)
    return unit
