"""Compute the kinematics of many configurations at once, and find the wrist (method.md §1, §4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.robot.model import Robot

WRIST_JOINTS: Final = 3
"""Number of joints of a wrist: the last ones of the robot."""
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
        kinematics = jacobian.transpose(2, 0, 1), rotation @ placement.rotation, translation
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
    """Return rotation vectors (N, 3) [rad] that turn axes (N, 3, 3) into others, in the frame of both."""
    return np.asarray(Rotation.from_matrix(to @ from_.transpose(0, 2, 1)).as_rotvec())
