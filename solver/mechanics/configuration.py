"""Kinematics of many configurations at once, the wrist, and inverse kinematics (method.md §1, §4).

Inverse kinematics is that of arms with six revolute joints; prismatic joints, such as a rail below the arm,
stand still, and the arm is the robot's other joints. All branches are found in closed form (EAIK) and made
exact by Newton steps. EAIK finds how a chain decomposes into subproblems of known solution (Ostermeier, Külz,
Althoff, *Automatic Geometric Decomposition for Analytical Inverse Kinematics*, 2024). A chain that was
identified by measurement decomposes no more, as no two of its axes are parallel or meet exactly: then the
branches of the nearest chain that does are where Newton's method begins. Which of the postures that reach a
path's poses are meant is chosen by what a program states, else by the posture before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError, RequestError, RobotError
from jointstiff.solver.mechanics.robot import Robot, standing_still

WRIST_JOINTS: Final = 3
"""Number of joints of a wrist: the last ones of the robot."""
_SMALL_SINE: Final = 0.5
"""Sine of a turn, below which it tells the angle as well as all of the rotation does."""
_BLOCK: Final = 1024
"""Postures worked on at a time: what a core keeps at hand."""
# A C library that has freed so much at once reuses what smaller arrays leave. Pages that were returned to the
# system and asked for again took half of the time.
np.empty(16 * 1024 * 1024, dtype=np.uint8)


class Configurations:
    """Kinematics of N configurations of one robot, computed once, when they are needed first.

    All arrays are read-only.
    """

    q: FloatArray  #: (N, n) positions of the model's joints [rad or m]

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        """Check the positions.

        Args:
            robot: the robot, n joints.
            q: (N, n) positions of the model's joints [rad or m].

        Raises:
            MeasurementError: if q has another shape or is not finite.
        """
        q = np.ascontiguousarray(q, dtype=np.float64)
        if q.ndim != 2 or q.shape[1] != robot.n or not np.isfinite(q).all():
            raise MeasurementError(
                f"the joint angles have shape {q.shape} instead of (N, {robot.n}), or are not finite",
                remedy=f"give {robot.n} angles for each configuration",
            )
        self._robot, self.q = robot, q.view()
        self.q.setflags(write=False)

    @cached_property
    def _kinematics(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Spatial Jacobians (N, 6, n) and the flange's placement (N, 3, 3), (N, 3) in R0; postures last."""
        robot, count = self._robot, len(self.q)
        jacobian = np.empty((6, robot.n, count))
        last, origin = np.empty((3, 3, count)), np.empty((3, count))
        for block in _blocks(count):
            placed = _placed(robot, self.q[block])
            x, y, z = placed[:, :, 3].transpose(1, 0, 2)  # origins
            axes = np.einsum("jikn,jk->ijn", placed[:, :, :3], robot.axes)
            ax, ay, az = axes
            J = jacobian[..., block]
            J[0], J[1], J[2], J[3:] = y * az - z * ay, z * ax - x * az, x * ay - y * ax, axes
            if robot.prismatic.any():
                J[:3, robot.prismatic], J[3:, robot.prismatic] = axes[:, robot.prismatic], 0.0
            last[..., block], origin[..., block] = placed[-1, :, :3], placed[-1, :, 3]
        placement, rotation = robot.flange_placement, last.transpose(2, 0, 1)
        translation = origin.T + rotation @ placement.translation
        turned = np.einsum("ikn,kj->ijn", last, placement.rotation).transpose(2, 0, 1)
        kinematics = jacobian.transpose(2, 0, 1), turned, translation
        for array in kinematics:
            array.setflags(write=False)
        return kinematics

    @property
    def jacobian(self) -> FloatArray:
        """(N, 6, n) spatial Jacobian, axes of R0.

        The first three rows are the velocity of the point of the flange that passes through the origin of R0
        [m/rad], the last three the flange's angular velocity [rad/rad]. The column of a prismatic joint is
        its axis above zeros [m/m, rad/m].
        """
        return self._kinematics[0]

    @property
    def angular_jacobian(self) -> FloatArray:
        """(N, 3, n) J_ω, the last three rows of the spatial Jacobian; zero for a prismatic joint."""
        return self._kinematics[0][:, 3:]

    @property
    def flange_rotation(self) -> FloatArray:
        """(N, 3, 3) axes of the flange in R0."""
        return self._kinematics[1]

    @property
    def flange_translation(self) -> FloatArray:
        """(N, 3) origin of the flange frame in R0 [m]."""
        return self._kinematics[2]

    @property
    def flange_pose(self) -> FloatArray:
        """(N, 4, 4) of the flange in R0 [m]."""
        poses = np.tile(np.eye(4), (len(self), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = self.flange_rotation, self.flange_translation
        return poses

    def __len__(self) -> int:
        return len(self.q)

    def jacobian_at(self, points: FloatArray) -> FloatArray:
        """Return J_v of the flange-fixed points now at the given places (method.md §1).

        Column j is ``a_j × (x - o_j)``, or a_j of a prismatic joint; the spatial Jacobian holds
        ``-a_j × o_j`` already.

        Args:
            points: (N, T, 3) places in R0 [m].

        Returns:
            (N, T, 3, n) linear velocities, axes of R0 [m/rad].
        """
        x = np.ascontiguousarray(points.transpose(1, 2, 0))[:, :, None]
        v, w = np.split(self.jacobian.transpose(1, 2, 0), 2)
        out = np.empty((len(x), 3, *v.shape[1:]))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            np.multiply(w[j], x[:, k], out=out[:, i])
            out[:, i] -= w[k] * x[:, j]
            out[:, i] += v[i]
        return out.transpose(3, 0, 1, 2)

    def load(self, point: FloatArray, force: FloatArray, moment: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what loads do to the joints.

        Args:
            point: (N, 3) where the forces act, flange frame [m].
            force: (N, 3) on the robot, axes of R0 [N].
            moment: (N, 3) on the robot about the load point, axes of R0 [N·m].

        Returns:
            (N, 3, n) J_v at the load points [m/rad], and (N, n) torques [N·m].
        """
        jacobian = self.jacobian_at(self.to_base(point[:, None]))[:, 0]
        return jacobian, self.joint_torque(jacobian, force, moment)

    def joint_torque(self, load_jacobian: FloatArray, force: FloatArray, moment: FloatArray) -> FloatArray:
        """``τ = J_v(q, p_W)ᵀ F + J_ω(q)ᵀ M`` (method.md §2; paper, eq. 12), with J_v as `load` returns it."""
        by_force = np.einsum("nij,ni->nj", load_jacobian, force)
        return np.asarray(by_force + np.einsum("nij,ni->nj", self.angular_jacobian, moment))

    def to_base(self, points: FloatArray) -> FloatArray:
        """Transform points (N, T, 3) from the flange frame to R0 [m]."""
        turned = points @ self.flange_rotation.transpose(0, 2, 1)
        return np.asarray(turned + self.flange_translation[:, None])

    def to_flange(self, points: FloatArray) -> FloatArray:
        """Transform points (N, T, 3) from R0 to the flange frame [m]."""
        return np.asarray((points - self.flange_translation[:, None]) @ self.flange_rotation)

    def pose_jacobian_at(self, points: FloatArray) -> FloatArray:
        """Return Jacobians (N, 6, n) of one point (N, 1, 3) of the flange and its rotation, axes of R0."""
        return np.concatenate([self.jacobian_at(points)[:, 0], self.angular_jacobian], axis=1)


def joint_frames(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return axes (N, n, 3, 3) and origins (N, n, 3) [m] in R0 of the frames that move with the joints.

    Args:
        robot: n joints.
        q: (N, n) finite positions of the model's joints [rad or m].
    """
    rotation, origin = np.empty((len(q), robot.n, 3, 3)), np.empty((len(q), robot.n, 3))
    for block in _blocks(len(q)):
        placed = _placed(robot, q[block])
        rotation[block] = placed[:, :, :3].transpose(3, 0, 1, 2)
        origin[block] = placed[:, :, 3].transpose(2, 0, 1)
    return rotation, origin


def _placed(robot: Robot, q: FloatArray) -> FloatArray:
    """Return the placements ``[R t]`` (n, 3, 4, N) in R0 of the frames that move with the joints.

    The postures come last, so that each product of two placements runs along all of them at once.
    """
    angles = np.ascontiguousarray(q.T)[:, None, None]
    still, sine, cosine = robot.joint_terms[..., None]
    placed: FloatArray = still + sine * np.sin(angles) + cosine * np.cos(angles)
    for joint in np.flatnonzero(robot.prismatic):
        placed[joint, :, 3] += robot.slides[joint, :, None] * q[:, joint]
    for before, after in pairwise(placed):
        after[:] = np.einsum("ikn,kjn->ijn", before[:, :3], after)
        after[:, 3] += before[:, 3]
    return placed


def _blocks(count: int) -> Iterator[slice]:
    for start in range(0, count, _BLOCK):
        yield slice(start, start + _BLOCK)


@dataclass(frozen=True, eq=False)
class Wrist:
    """The point nearest to the last three axes, about which their joints turn."""

    #: greatest miss distance of a spherical wrist [m]; under 10 mrad of deflection it moves the centre by 5
    #: µm
    TOLERANCE: ClassVar[float] = 0.5e-3

    centre: FloatArray  #: (3,) wrist centre in the flange frame [m]
    miss_distance: float  #: greatest distance of one of the axes from it [m]

    @property
    def spherical(self) -> bool:
        """Return whether the axes meet within `TOLERANCE`."""
        return self.miss_distance <= self.TOLERANCE


def find_wrist(robot: Robot) -> Wrist | None:
    """Find the point of least squared distance to the last three axes.

    If they meet in one configuration they meet in all: neighbouring axes keep their distance and the
    foot of their common perpendicular. One configuration therefore suffices.

    Returns:
        The wrist, or None if there are fewer than three joints, one of the last three slides, or the point
        is not unique, as for parallel axes.
    """
    if robot.n < WRIST_JOINTS or robot.prismatic[-WRIST_JOINTS:].any():
        return None
    configuration = Configurations(robot, np.zeros((1, robot.n)))
    moments, directions = np.split(configuration.jacobian[0, :, -WRIST_JOINTS:].T, 2, axis=1)
    feet = np.cross(directions, moments)
    normals = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    system = normals.sum(axis=0)
    if np.linalg.svd(system, compute_uv=False)[-1] < 1e-6:
        return None
    centre = np.linalg.solve(system, np.einsum("kij,kj->i", normals, feet))
    misses = np.linalg.norm(np.einsum("kij,kj->ki", normals, centre - feet), axis=1)
    in_flange = configuration.flange_rotation[0].T @ (centre - configuration.flange_translation[0])
    return Wrist(in_flange, float(misses.max()))


def skew(v: FloatArray) -> FloatArray:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def rotation_vectors(to: FloatArray, from_: FloatArray) -> FloatArray:
    """Return rotation vectors (N, 3) [rad] that turn axes (N, 3, 3) into others, in the frame of both.

    The antisymmetric part of a rotation is its axis times the sine of its angle, which tells a small angle to
    all digits.
    """
    t, f = to.transpose(1, 2, 0), from_.transpose(1, 2, 0)
    vectors = np.empty((3, len(to)))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        vectors[i] = np.einsum("in,in->n", t[k], f[j]) - np.einsum("in,in->n", t[j], f[k])
    sine = 0.5 * np.sqrt(np.einsum("in,in->n", vectors, vectors))
    small = (sine < _SMALL_SINE) & (np.einsum("ijn,ijn->n", t, f) > 1.0)
    angle = np.arcsin(np.where(small, sine, 0.0))
    vectors *= np.where(sine > 0.0, 0.5 * angle / np.where(sine > 0.0, sine, 1.0), 0.5)
    wide = np.flatnonzero(~small)
    if len(wide):
        vectors[:, wide] = Rotation.from_matrix(to[wide] @ from_[wide].transpose(0, 2, 1)).as_rotvec().T
    return vectors.T


BRANCHES: Final = 8
"""Most solutions kept for a pose; more exist only where a joint is free to turn."""
_JOINTS: Final = 6
_STEPS: Final = 8
_REACHED: Final = 1e-10
"""Distance [m] and angle [rad] from the pose that is rounding."""
_LAST_STEP: Final = 1e-6
"""Step of Newton's method [rad] whose square, times an arm's reach, is rounding."""
_SNAP: Final = 1e-2
"""Parts of an axis, and of a step between axes [m], that identification rather than design put there."""
_POLISHED_AT_ONCE: Final = 4096
"""Postures that are polished at a time: what a cache holds."""
_DAMPING: Final = 1e-12
_ONE: Final = 1e-3
"""Difference of two solutions [rad] that are taken for one."""
_SINGULAR: Final = 2e-3
"""Least singular value up to which branches cannot be told apart."""
_LEAST_STEP: Final = 1.0 / 1024.0
"""Share of a straight line that is followed in one step at least."""
_TURN: Final = 2.0 * np.pi
_TURNS: Final = np.arange(-2, 3) * _TURN
"""Full turns that are tried about an angle [rad]."""
_TOLERANCE: Final = 1e-4
"""Angle by which a stated range or a joint's limit may be missed [rad]: programs are rounded."""
_NEAR_SINGULAR: Final = 0.04
"""Least singular value up to which a solution may be taken for one that is missing."""
_AHEAD: Final = 4096
"""Poses of a path whose solutions are held at a time."""
_RUN: Final = 256
"""Poses along which a branch is followed at a time."""


class InverseKinematics:
    """Joint angles that bring the flange to poses, prismatic joints standing still.

    Attributes:
        arm: the robot without its prismatic joints, six revolute ones: all angles below are its.
        turning: (6,) indices of these among the robot's joints.
    """

    def __init__(self, robot: Robot, held: FloatArray | None = None) -> None:
        """Find how the chain, or else the nearest one that does, decomposes.

        Args:
            robot: n joints, six of them revolute.
            held: (n,) positions as the controller shows them, at which prismatic joints stand still [m];
                needed if there are such.

        Raises:
            RobotError: the robot has not six revolute joints, it is not known where a prismatic one stands,
                or no chain near it decomposes.
        """
        self.turning = np.flatnonzero(~robot.prismatic)
        if len(self.turning) != _JOINTS:
            remedy = "inverse kinematics needs an arm with six revolute joints"
            count = f"{len(self.turning)} revolute joints" if robot.prismatic.any() else f"{robot.n} joints"
            raise RobotError(f"the robot has {count}", remedy=remedy, where="robot")
        self.arm, self._held, self._held_in_model = robot, np.zeros(robot.n), np.zeros(robot.n)
        if robot.prismatic.any():
            if held is None:
                linear = ", ".join(np.array(robot.joint_names)[robot.prismatic])
                raise RobotError(
                    f"it is not stated where the linear axis {linear} stands",
                    remedy="give all joints as `near` or `start`: the linear axis stands still there",
                    where="robot",
                )
            self.arm = standing_still(robot, held)
            self._held, self._held_in_model = held, robot.joint_map.model_angles(held[None])[0]
        try:
            from eaik.pybindings import EAIK
        except ImportError:
            raise RobotError(
                "inverse kinematics needs EAIK, which is not installed",
                remedy="use a version of Python that EAIK has wheels for, 3.11 to 3.13",
                where="robot",
            ) from None
        robot = self.arm
        zero = np.zeros((1, robot.n))
        rotation, origin = joint_frames(robot, zero)
        flange = Configurations(robot, zero)
        axes = np.stack([R @ axis for R, axis in zip(rotation[0], robot.axes, strict=True)])
        steps = np.diff(np.vstack([np.zeros(3), origin[0], flange.flange_translation]), axis=0)
        for self._exact in (True, False):
            if not self._exact:
                axes, steps = (np.where(np.abs(each) < _SNAP, 0.0, each) for each in (axes, steps))
                axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
            self._solver = EAIK.Robot(axes.T, steps.T, flange.flange_rotation[0], [], True)
            if self._solver.has_known_decomposition():
                return
        raise RobotError(
            "no closed-form inverse kinematics is known for this arrangement of axes",
            remedy="use an arm with three parallel axes, or with a wrist whose axes meet",
            where="robot",
        )

    def of_arm(self, joints: FloatArray) -> FloatArray:
        """Return the arm's joints (..., 6) among the robot's (..., n)."""
        return joints if self.arm.n == len(self._held) else joints[..., self.turning]

    def whole(self, angles: FloatArray, *, of_model: bool = False) -> FloatArray:
        """Return the robot's joints (..., n) by the arm's (..., 6), of the controller or of the model."""
        if self.arm.n == len(self._held):
            return angles
        held = self._held_in_model if of_model else self._held
        joints = np.broadcast_to(held, (*angles.shape[:-1], len(held))).copy()
        joints[..., self.turning] = angles
        joints[np.isnan(angles[..., 0])] = np.nan
        return joints

    def standing(self, robot: Robot, commanded: FloatArray) -> FloatArray:
        """Return positions of the model (m, n) of the same flange poses as others, prismatic joints standing.

        Raises:
            RequestError: a pose is not reached from there.
        """
        if self.arm is robot:
            return commanded
        angles, reached = self.polished(flange_poses(robot, commanded), self.of_arm(commanded))
        if not reached.all():
            raise RequestError(
                "the corrected target is not reached while the linear axis stands still",
                remedy="move the part away from the singularity",
                where=f"cases[{int(np.argmin(reached))}]",
            )
        return self.whole(angles, of_model=True)

    def solutions(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return all solutions of poses (m, 4, 4) of the flange in R0 [m], and where none may be missing.

        Newton's method, which begins at the branches of the nearest chain that decomposes, loses some near
        singularities: then a branch has no solution, or two have the same.

        Returns:
            (m, 8, 6) angles of the model in [−π, π] [rad], filled up with NaN, and (m,) whether they are all.
        """
        angles, complete = self._closed_form(poses)
        if not self._exact:
            case, branch = np.nonzero(np.isfinite(angles[:, :, 0]))
            polished, reached = self.polished(poses[case], angles[case, branch])
            polished[~reached] = np.nan
            complete[case[~reached]] = False
            angles[case, branch] = polished
            for i in range(1, BRANCHES):  # two of the solutions are one
                gaps = apart(angles[:, i:], angles[:, :-i])
                complete &= ~(np.nan_to_num(gaps, nan=np.inf) < _ONE).any(axis=1)
            sharp = self.least_singular(polished[reached]) < _SINGULAR
            complete[case[reached][sharp]] = False
        return angles, complete

    def _closed_form(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the solver's solutions (m, 8, 6) [rad], filled up with NaN, and whether all are exact."""
        solutions = [self._solver.calculate_IK(pose) for pose in poses]
        branches = [solution.Q for solution in solutions]
        counts = np.array([len(each) for each in branches])
        if not counts.any():
            return np.full((len(poses), BRANCHES, _JOINTS), np.nan), np.full(len(poses), self._exact)
        rows = np.concatenate([each for each in branches if len(each)])
        least_squares = np.concatenate([solution.is_LS for solution in solutions]).astype(bool)
        complete: BoolArray = np.asarray((counts <= BRANCHES) | self._exact)
        pose = np.repeat(np.arange(len(poses)), counts)
        if self._exact:  # the pose is out of reach; near it, Newton's method decides
            rows, pose = rows[~least_squares], pose[~least_squares]
            counts = np.bincount(pose, minlength=len(poses))
        else:
            complete[pose[least_squares]] = False
        taken = np.arange(max(BRANCHES, counts.max())) < counts[:, None]
        angles = np.full((*taken.shape, _JOINTS), np.nan)
        angles[taken] = rows
        return angles[:, :BRANCHES], complete

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
        here = Configurations(self.arm, q)
        jacobian = here.pose_jacobian_at(here.flange_translation[:, None])
        return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])

    def followed(self, poses: FloatArray, near: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Follow the branches of angles (m, 6) [rad] along straight lines to poses (m, 4, 4) [m].

        Returns:
            Angles (m, 6) of the model [rad], and (m,) whether each could be told from others all along.
        """
        begin, q = flange_poses(self.arm, near), near.copy()
        done, step = np.zeros(len(poses)), np.ones(len(poses))
        left = np.arange(len(poses))
        while len(left):
            share = np.minimum(done[left] + step[left], 1.0)
            angles, sure = self.polished(_between(begin[left], poses[left], share), q[left])
            sure &= self.continues(angles, q[left])
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
        for start in range(0, len(poses), _POLISHED_AT_ONCE):
            block = slice(start, start + _POLISHED_AT_ONCE)
            q[block], reached[block] = self.polished_from(poses[block], Configurations(self.arm, near[block]))
        return q, reached

    def polished_from(self, poses: FloatArray, here: Configurations) -> tuple[FloatArray, BoolArray]:
        """Do the same as `polished` where the arm's kinematics of the given angles are known."""
        q, reached = here.q.copy(), np.zeros(len(here), dtype=np.bool_)
        left = np.arange(len(here))
        for step_number in range(_STEPS):
            here = Configurations(self.arm, q[left]) if step_number else here
            gaps = np.empty((len(left), 6))  # displacement and rotation vector to the poses
            gaps[:, :3] = poses[left, :3, 3] - here.flange_translation
            gaps[:, 3:] = rotation_vectors(poses[left, :3, :3], here.flange_rotation)
            jacobian = here.pose_jacobian_at(here.flange_translation[:, None])
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            step = (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, gaps[..., None]))[..., 0]
            rest = gaps - (jacobian @ step[..., None])[..., 0]
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


def _between(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Return poses (m, 4, 4) at shares (m,) of straight lines, turned by the same shares."""
    poses = end.copy()
    part = share[:, None]
    poses[:, :3, 3] = (1.0 - part) * begin[:, :3, 3] + part * end[:, :3, 3]
    turn = rotation_vectors(end[:, :3, :3], begin[:, :3, :3])
    poses[:, :3, :3] = Rotation.from_rotvec(part * turn).as_matrix() @ begin[:, :3, :3]
    return np.asarray(np.where(share[:, None, None] < 1.0, poses, end))


class Unreached(IntEnum):
    """Reasons why no posture was chosen for a pose."""

    NO = 0
    OUT_OF_REACH = 1
    OUT_OF_LIMITS = 2
    NOT_AS_STATED = 3
    AMBIGUOUS = 4
    NOT_FOLLOWED = 5


def choose_postures(
    inverse: InverseKinematics,
    poses: FloatArray,
    given: FloatArray,
    stated: FloatArray,
    tested: BoolArray,
    start: FloatArray | None = None,
) -> tuple[FloatArray, IndexArray]:
    """Return a posture for each pose of a path.

    A joint target is its own posture. A pose that is tested takes the solution whose angles are in the stated
    ranges, the nearest to the posture before if several are; any other pose takes the nearest solution.

    Args:
        inverse: kinematics of the robot.
        poses: (m, 4, 4) of the flange in R0 [m], ignored where angles are given.
        given: (m, 6) controller's angles of joint targets [rad]; NaN for poses.
        stated: (m, 6, 2) least and greatest controller's angles [rad]; ∓inf where nothing is stated.
        tested: (m,) whether what is stated decides; where no posture came before, it does in any case.
        start: (n,) joints of the robot, as the controller shows them, near the first pose [rad or m].

    Returns:
        (m, n) joints of the robot as the controller shows them [rad or m], and (m,) values of `Unreached`.

    Raises:
        RobotError: the joint map lets a controller's angle depend on those of joints further out.
    """
    robot = inverse.arm
    if np.triu(robot.joint_map.matrix, 1).any():
        raise RobotError(
            "a joint depends on the controller's angle of a joint further out",
            remedy="give a joint map without entries above the diagonal",
            where="joint_map.matrix",
        )
    joints, unreached = given.copy(), np.zeros(len(poses), dtype=np.intp)
    previous = None if start is None else inverse.of_arm(start)
    for begin in range(0, len(poses), _AHEAD):
        block = slice(begin, begin + _AHEAD)
        choice = _Choice(inverse, poses[block], given[block], stated[block], tested[block])
        previous = choice.follow(joints[block], unreached[block], previous)
    known: BoolArray = np.asarray(np.isfinite(joints).all(axis=1))
    angles = robot.joint_map.model_angles(np.where(known[:, None], joints, 0.0))
    low, high = robot.limits.T
    outside = np.maximum(low - angles, angles - high).max(axis=1) > _TOLERANCE
    unreached[known & outside & (unreached == Unreached.NO)] = Unreached.OUT_OF_LIMITS
    return inverse.whole(joints), unreached


class _Choice:
    """A stretch of m poses with what is given and stated, and their solutions [rad]."""

    def __init__(
        self,
        inverse: InverseKinematics,
        poses: FloatArray,
        given: FloatArray,
        stated: FloatArray,
        tested: BoolArray,
    ) -> None:
        """Find the solutions (m, 8, 6) in angles of the model, NaN where there is none."""
        self._inverse, self._robot, self._poses = inverse, inverse.arm, poses
        self._posed, self._stated, self._tested = np.isnan(given[:, 0]), stated, tested
        self._branches, self._complete = np.full((len(poses), 8, 6), np.nan), np.ones(len(poses), np.bool_)
        self._branches[self._posed], self._complete[self._posed] = inverse.solutions(poses[self._posed])

    def follow(
        self, joints: FloatArray, unreached: IndexArray, previous: FloatArray | None
    ) -> FloatArray | None:
        """Choose a posture for each pose, and note why there is none.

        Args:
            joints: (m, 6) controller's angles [rad] to be filled in.
            unreached: (m,) values of `Unreached` to be filled in.
            previous: (6,) the posture before, if there was one.

        Returns:
            The last posture.
        """
        lost = self._posed & np.isnan(self._branches[:, :, 0]).all(axis=1)
        unreached[lost] = Unreached.OUT_OF_REACH
        path, at = np.flatnonzero(~lost), 0
        while at < len(path):
            i = path[at]
            if not self._posed[i]:
                at += 1
            elif self._tested[i] or previous is None:
                joints[i], unreached[i] = self.as_stated(i, previous)
                at += 1
            else:
                run = path[at : at + _RUN]
                stop = np.flatnonzero(self._tested[run] | ~self._posed[run])
                run = run[: stop[0]] if len(stop) else run
                angles, unreached[i] = self.nearest(run, previous)
                if not unreached[i]:
                    joints[run[: len(angles)]] = angles
                    i = run[len(angles) - 1]
                at += len(angles)
            previous = joints[i] if np.isfinite(joints[i]).all() else previous
        return previous

    def as_stated(self, i: int, previous: FloatArray | None) -> tuple[FloatArray, Unreached]:
        """Return the controller's angles (6,) of one pose, and why there are none."""
        fits, angles = in_ranges(self._robot, self._branches[i], self._stated[i], previous)
        found = angles[fits]
        if not len(found):
            return np.full(6, np.nan), Unreached.NOT_AS_STATED
        if previous is None:
            spread = np.abs(found - found[0]).max()
            if spread > _TOLERANCE:
                return found[0], Unreached.AMBIGUOUS
        chosen = found[0 if previous is None else np.argmin(np.abs(found - previous).max(axis=1))]
        if not self._complete[i]:
            least = self._inverse.least_singular(self._robot.joint_map.model_angles(chosen[None]))
            return chosen, Unreached.NOT_FOLLOWED if least[0] < _NEAR_SINGULAR else Unreached.NO
        return chosen, Unreached.NO

    def nearest(self, run: IndexArray, previous: FloatArray) -> tuple[FloatArray, Unreached]:
        """Follow the nearest solutions along poses, as long as one solution keeps its place in the list.

        Returns:
            Controller's angles (k, 6) [rad] of the first poses, at least one, and why the first has none.
        """
        joint_map = self._robot.joint_map
        here = joint_map.model_angles(previous[None])[0]
        b = int(np.nanargmin(apart(self._branches[run[0]], here)))
        if not self._complete[run[0]] and not self._continues(self._branches[run[:1], b], here[None])[0]:
            # The branch may be missing among the solutions
            found, known = self._inverse.followed(self._poses[run[:1]], here[None])
            return joint_map.controller_angles(found), Unreached.NO if known[0] else Unreached.NOT_FOLLOWED
        kept = self._branches[run, b]  # (m, 6)
        step = apart(kept[1:], kept[:-1])
        others = apart(self._branches[run[1:]], kept[1:, None])
        others[:, b] = np.inf
        # By the triangle inequality nothing is nearer to the posture before than a solution that is this
        # far from all others.
        sure = 2.0 * step < np.where(np.isnan(others), np.inf, others).min(axis=1)
        few = np.flatnonzero(~self._complete[run[1:]])
        sure[few] &= self._continues(kept[1:][few], kept[:-1][few])
        breaks = np.flatnonzero(~sure)
        done = int(breaks[0]) + 1 if len(breaks) else len(run)
        angles = np.unwrap(np.vstack([here, kept[:done]]), axis=0)[1:]
        return joint_map.controller_angles(angles), Unreached.NO

    def _continues(self, angles: FloatArray, before: FloatArray) -> BoolArray:
        """Return whether solutions (k, 6) [rad], full turns aside, continue the branch of those before."""
        return self._inverse.continues(before + wrapped(angles - before), before)


def apart(angles: FloatArray, from_: FloatArray) -> FloatArray:
    """Return the greatest difference of an angle, full turns aside [rad]."""
    gaps = np.moveaxis(wrapped(angles - from_), -1, 0)
    return np.asarray(np.abs(gaps, order="C").max(axis=0))  # joints first: a tenth of the time


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles [rad] without full turns, at most half a turn."""
    return angle - _TURN * np.round(angle / _TURN)


def in_ranges(
    robot: Robot, solutions: FloatArray, stated: FloatArray, previous: FloatArray | None
) -> tuple[BoolArray, FloatArray]:
    """Add full turns to solutions (b, 6), so that the controller's angles are in their ranges.

    Joint by joint from the base on, as a controller's angle depends on those before it at most.

    Args:
        robot: six revolute joints.
        solutions: angles of the model [rad]; NaN where there is none.
        stated: (6, 2) least and greatest controller's angles [rad]; ∓inf where nothing is stated.
        previous: (6,) controller's angles to which the nearest are taken; None for zero.

    Returns:
        (b,) whether all are in them, and the controller's angles (b, 6) [rad].
    """
    matrix, offset, limits = robot.joint_map.matrix, robot.joint_map.offset, robot.limits
    shown = np.zeros_like(solutions)
    fits: BoolArray = np.asarray(np.isfinite(solutions).all(axis=1))
    near = np.zeros(len(offset)) if previous is None else previous
    for j in range(len(offset)):
        turned = solutions[:, j, None] + _TURNS  # (b, 5) of the model
        angle = (turned - offset[j] - (shown[:, :j] @ matrix[j, :j])[:, None]) / matrix[j, j]
        outside = (turned < limits[j, 0] - _TOLERANCE) | (turned > limits[j, 1] + _TOLERANCE)
        outside |= (angle < stated[j, 0] - _TOLERANCE) | (angle > stated[j, 1] + _TOLERANCE)
        cost = np.where(outside | np.isnan(angle), np.inf, np.abs(angle - near[j]))
        best = np.argmin(cost, axis=1)
        rows = np.arange(len(solutions))
        fits &= np.isfinite(cost[rows, best])
        shown[:, j] = angle[rows, best]
    return fits, shown
