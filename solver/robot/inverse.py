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
_LAST_STEP: Final = 1e-6
"""Step of Newton's method [rad] whose square, times an arm's reach, is rounding."""
_SMALL_TURN: Final = 1.0
"""Angle [rad] up to which the skew part of a rotation is enough to tell its vector."""
_SNAP: Final = 1e-2
"""Parts of an axis, and of a step between axes [m], that identification rather than design put there."""
_BLOCK: Final = 4096
"""Poses whose solutions are held as objects at a time."""
_DAMPING: Final = 1e-12
_ONE: Final = 1e-3
"""Difference of two solutions [rad] that are taken for one."""
_SINGULAR: Final = 2e-3
"""Least singular value up to which branches cannot be told apart."""
_LEAST_STEP: Final = 1.0 / 1024.0
"""Share of a straight line that is followed in one step at least."""


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
        return self.solutions(poses)[0]

    def solutions(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return all solutions of poses (m, 4, 4) of the flange in R0 [m], and where none may be missing.

        Newton's method, which begins at the branches of the nearest chain that decomposes, loses some near
        singularities: then a branch has no solution, or two have the same.

        Returns:
            (m, 8, 6) angles of the model in [−π, π] [rad], filled up with NaN, and (m,) whether they are all.
        """
        angles = np.full((len(poses), BRANCHES, _JOINTS), np.nan)
        complete = np.ones(len(poses), dtype=np.bool_)
        for start in range(0, len(poses), _BLOCK):
            block = slice(start, start + _BLOCK)
            angles[block], complete[block] = self._closed_form(poses[block])
        if not self._exact:
            case, branch = np.nonzero(np.isfinite(angles[:, :, 0]))
            polished, reached = self.polished(poses[case], angles[case, branch])
            polished[~reached] = np.nan
            complete[case[~reached]] = False
            angles[case, branch] = polished
            complete &= ~_twice(angles)
            sharp = self.least_singular(polished[reached]) < _SINGULAR
            complete[case[reached][sharp]] = False
        return angles, complete

    def _closed_form(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the solver's solutions (m, 8, 6) [rad], filled up with NaN, and whether all are exact."""
        angles = np.full((len(poses), BRANCHES, _JOINTS), np.nan)
        solutions = [self._solver.calculate_IK(pose) for pose in poses]
        branches = [solution.Q for solution in solutions]
        counts = np.array([len(each) for each in branches])
        if not counts.any():
            return angles, np.full(len(poses), self._exact)
        pose, rows = np.repeat(np.arange(len(poses)), counts), np.concatenate([q for q in branches if len(q)])
        least_squares = np.concatenate([solution.is_LS for solution in solutions]).astype(bool)
        complete = counts <= BRANCHES
        if self._exact:  # least squares where the pose is out of reach; near it, Newton's method decides
            pose, rows, complete = pose[~least_squares], rows[~least_squares], np.ones_like(complete)
        else:
            complete[pose[least_squares]] = False
        branch = np.arange(len(pose)) - np.searchsorted(pose, pose)
        few = branch < BRANCHES
        angles[pose[few], branch[few]] = rows[few]
        return angles, complete

    def nearest(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the solution nearest to given angles, full turns added to come near them.

        Where solutions may be missing, or another one is less than twice as far, it is the one that Newton's
        method finds from the given angles, if these are so near that no other solution lies as near.

        Args:
            poses: (m, 4, 4) of the flange in R0 [m].
            near: (m, 6) angles of the model [rad].

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether the pose is reached on the branch of `near`.
        """
        angles, complete = self.solutions(poses)
        angles += 2.0 * np.pi * np.round((near[:, None] - angles) / (2.0 * np.pi))
        far = np.nan_to_num(np.abs(angles - near[:, None]).max(axis=2), nan=np.inf)
        chosen = angles[np.arange(len(poses)), np.argmin(far, axis=1)]
        least, next_least = np.partition(far, 1, axis=1)[:, :2].T
        reached = np.isfinite(chosen).all(axis=1)
        rows = np.flatnonzero(~complete | (reached & (next_least <= 2.0 * least)))
        chosen[rows], reached[rows] = self.continued(poses[rows], near[rows])
        return np.where(reached[:, None], chosen, near), reached

    def continued(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Follow Newton's method from given angles (m, 6) [rad] to poses (m, 4, 4) [m] on the same branch.

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether they continue the branch for sure.
        """
        q, reached = self.polished(poses, near)
        return q, reached & self.continues(q, near)

    def continues(self, q: FloatArray, near: FloatArray) -> BoolArray:
        """Return whether postures (m, 6) continue the branch of others: no other solution is as near.

        The Jacobian changes by some σ where the angles change by σ, so that within half of the least singular
        value at a solution there is no other one.
        """
        step = np.abs(q - near).max(axis=1, initial=0.0)
        known = np.flatnonzero(np.isfinite(step))
        sure = np.zeros(len(q), dtype=np.bool_)
        least = self.least_singular(q[known])
        sure[known] = (step[known] <= 0.5 * least) & (least > _SINGULAR)
        return sure

    def least_singular(self, q: FloatArray) -> FloatArray:
        """Return the least singular value (m,) of the flange's Jacobian, in metres and radians."""
        if not len(q):
            return np.zeros(0)
        jacobian = _jacobian(Configurations(self.robot, q))
        return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])

    def followed(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Follow the branches of angles (m, 6) [rad] along straight lines to poses (m, 4, 4) [m].

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether each could be told from others all along.
        """
        begin, q = flange_poses(self.robot, near), near.copy()
        done, step = np.zeros(len(poses)), np.ones(len(poses))
        left = np.arange(len(poses))
        while len(left):
            share = np.minimum(done[left] + step[left], 1.0)
            angles, sure = self.continued(_between(begin[left], poses[left], share), q[left])
            q[left[sure]] = angles[sure]
            done[left[sure]] = share[sure]
            step[left] *= np.where(sure, 2.0, 0.5)
            left = left[(done[left] < 1.0) & (step[left] >= _LEAST_STEP)]
        return q, done >= 1.0

    def polished(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Follow Newton's method from given angles (m, 6) [rad] to poses (m, 4, 4) [m].

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether the pose is reached.
        """
        q, reached = near.copy(), np.zeros(len(near), dtype=np.bool_)
        for start in range(0, len(poses), _BLOCK):
            block = slice(start, start + _BLOCK)
            q[block], reached[block] = self.polished_from(
                poses[block], Configurations(self.robot, near[block])
            )
        return q, reached

    def polished_from(self, poses: FloatArray, here: Configurations) -> tuple[FloatArray, BoolArray]:
        """Do the same as `polished` where the kinematics of the given angles are known."""
        q, reached = here.q.copy(), np.zeros(len(here), dtype=np.bool_)
        left = np.arange(len(here))
        for step_number in range(_STEPS):
            here = Configurations(self.robot, q[left]) if step_number else here
            apart = _twist(here, poses[left])
            jacobian = _jacobian(here)
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            step = (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, apart[..., None]))[..., 0]
            rest = apart - (jacobian @ step[..., None])[..., 0]
            q[left] += step
            near_enough = np.abs(rest).max(axis=1, initial=0.0) <= 0.5 * _REACHED
            reached[left] = near_enough & (np.abs(step).max(axis=1, initial=0.0) <= _LAST_STEP)
            left = left[~reached[left]]
            if not len(left):
                break
        return q, reached


def flange_poses(robot: Robot, q: FloatArray) -> FloatArray:
    """Return poses (m, 4, 4) [m] of the flange in R0 at angles (m, n) of the model [rad]."""
    return Configurations(robot, q).flange_pose


def _jacobian(here: Configurations) -> FloatArray:
    """Return Jacobians (m, 6, 6) of the flange, displacement first, axes of R0."""
    linear = here.jacobian_at(here.flange_translation[:, None])[:, 0]
    return np.concatenate([linear, here.angular_jacobian], axis=1)


def _between(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Return poses (m, 4, 4) at shares (m,) of straight lines, turned by the same shares."""
    from scipy.spatial.transform import Rotation  # costs start-up, and few commands need it

    poses = end.copy()
    part = share[:, None]
    poses[:, :3, 3] = (1.0 - part) * begin[:, :3, 3] + part * end[:, :3, 3]
    turn = Rotation.from_matrix(end[:, :3, :3] @ begin[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    poses[:, :3, :3] = Rotation.from_rotvec(part * turn).as_matrix() @ begin[:, :3, :3]
    return np.asarray(np.where(share[:, None, None] < 1.0, poses, end))


def _twice(angles: FloatArray) -> BoolArray:
    """Return where two of the solutions (m, 8, 6) [rad] are one."""
    twice = np.zeros(len(angles), dtype=np.bool_)
    for i in range(1, BRANCHES):
        apart = angles[:, i:] - angles[:, :-i]
        apart = np.abs(apart - 2.0 * np.pi * np.round(apart / (2.0 * np.pi))).max(axis=2)
        twice |= (np.nan_to_num(apart, nan=np.inf) < _ONE).any(axis=1)
    return twice


def _twist(here: Configurations, poses: FloatArray) -> FloatArray:
    """Return displacement [m] and rotation vector [rad] (m, 6), axes of R0, from the flange to the poses."""
    turn = poses[:, :3, :3] @ here.flange_rotation.transpose(0, 2, 1)
    apart = np.empty((len(poses), 6))
    apart[:, :3] = poses[:, :3, 3] - here.flange_translation
    if np.trace(turn, axis1=1, axis2=2).min(initial=3.0) > 1.0 + 2.0 * np.cos(_SMALL_TURN):
        skew = 0.5 * (turn - turn.transpose(0, 2, 1))
        apart[:, 3:] = skew[:, [2, 0, 1], [1, 2, 0]]
        sine = np.linalg.norm(apart[:, 3:], axis=1, keepdims=True)
        apart[:, 3:] *= np.where(
            sine > 0.0, np.arcsin(np.minimum(sine, 1.0)) / np.where(sine > 0.0, sine, 1.0), 1.0
        )
    else:
        from scipy.spatial.transform import Rotation  # costs start-up, and few commands need it

        apart[:, 3:] = Rotation.from_matrix(turn).as_rotvec()
    return apart


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
    """Import EAIK where inverse kinematics is needed first."""
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
