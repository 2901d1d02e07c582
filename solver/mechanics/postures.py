"""Kinematics of many postures of one robot, by Pinocchio, and the wrist (method.md §1, §4)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.robot import Robot, in_configuration_space

WRIST_JOINTS: Final = 3
"""Number of joints of a wrist: the last ones of the robot."""
_REACH_STEP: Final = float(np.radians(10.0))
"""Step of an angle [rad] where the reach is measured: half of it shortens a link by 0.4 %."""
_SMALL_SINE: Final = 0.5
"""Sine of an angle of rotation below which the arcsine gives the angle to all digits."""
# Allocating and freeing a large array once makes the C library keep the memory of smaller arrays for reuse.
# Returning pages to the system and requesting them again took half of the time.
np.empty(16 * 1024 * 1024, dtype=np.uint8)


class Postures:
    """Kinematics of N configurations of one robot; each array is computed when first needed, and kept.

    All arrays are read-only.
    """

    q: FloatArray  #: (N, n) positions of the model's joints [rad or m]

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        """Check the joint positions; kinematics are computed later, when needed.

        Args:
            robot: the robot, n joints.
            q: (N, n) positions of the model's joints [rad or m].

        Raises:
            MeasurementError: q has another shape, or a number that is not finite.
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
        """Spatial Jacobians (N, 6, n), and the flange's rotations (N, 3, 3) and places (N, 3) [m] in R0."""
        model, count, last = self._robot.model, len(self.q), self._robot.n
        data = model.createData()  # own results, so that threads do not share them
        place = data.oMi[last]
        J = _view_columns(data.J.reshape(6, last))  # Pinocchio's J of one joint has shape (6,)
        R, t = _view_columns(place.rotation), _view_columns(place.translation)
        jacobians, rotations, translations = bytearray(), bytearray(), bytearray()
        for q in in_configuration_space(model, self.q):
            pin.computeJointJacobians(model, data, q)
            jacobians += J
            rotations += R
            translations += t
        jacobian = np.ascontiguousarray(_read_columns(jacobians, (count, 6, last)))
        rotation = _read_columns(rotations, (count, 3, 3))
        translation = np.frombuffer(translations).reshape(count, 3)
        flange = self._robot.flange_placement
        translation += rotation @ flange.translation
        kinematics = jacobian, rotation @ flange.rotation, translation
        for array in kinematics:
            array.setflags(write=False)
        return kinematics

    @cached_property
    def joint_frames(self) -> tuple[FloatArray, FloatArray]:
        """Axes (N, n, 3, 3) and origins (N, n, 3) [m] in R0 of the frames that move with the joints."""
        model, shape = self._robot.model, self.q.shape
        rotation, origin = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        data = model.createData()
        frames = [
            (place.rotation, place.translation) for place in (data.oMi[j + 1] for j in range(self._robot.n))
        ]
        for i, q in enumerate(in_configuration_space(model, self.q)):
            pin.forwardKinematics(model, data, q)
            for j, (R, t) in enumerate(frames):
                rotation[i, j], origin[i, j] = R, t
        rotation.setflags(write=False)
        origin.setflags(write=False)
        return rotation, origin

    @cached_property
    def placement_motions(self) -> FloatArray:
        """Derivative (N, n, 6, 6) of the motion behind a joint with respect to the joint's placement.

        Entry [:, j] is the spatial motion of everything that joint j carries. Columns are translations along,
        then rotations about the axes of the joint's frame before it moves [m, rad]; rows are the velocity
        of the point in the origin of R0 [m], then the rotation [rad], axes of R0.
        """
        model, (count, n) = self._robot.model, self.q.shape
        motions = np.empty((count, 6, 6 * n))
        data = model.createData()
        for i, q in enumerate(in_configuration_space(model, self.q)):
            pin.forwardKinematics(model, data, q)
            motions[i] = pin.computeJointKinematicRegressor(model, data, n, pin.WORLD)
        return motions.reshape(count, 6, n, 6).transpose(0, 2, 1, 3)

    @property
    def axis_motions(self) -> FloatArray:
        """Derivative (N, n, 6, 6) of the motion behind a joint with respect to the joint's axis alone.

        The axis moves, but at position zero of the joint everything behind the joint stays in place. Entry
        [:, j] belongs to joint j. Columns are translations along, then rotations about the axes of the
        joint's frame [m, rad]; rows are the velocity of the point in the origin of R0 [m], then the rotation
        [rad], in R0.
        """
        return np.asarray(self.placement_motions - frame_motions(*self.joint_frames))

    @cached_property
    def weight_levers(self) -> FloatArray:
        """Torques (N, n, n, 4, 3) on joint j by the mass of link l, under gravity of 1 m/s² along axes of R0.

        Index 1 is the joint j, index 2 the link l; torques are zero where l < j. The four entries are torques
        of 1 kg at the origin of the link's frame, then of a first moment of 1 kg·m along each axis of the
        frame. The last index is the axis of R0 along which gravity acts.
        """
        (count, n), joints = self.q.shape, in_configuration_space(self._robot.model, self.q)
        levers = np.empty((count, n, n, 4, 3))
        for axis, gravity in enumerate(np.eye(3)):
            model = self._robot.model.copy()
            model.gravity.linear = gravity
            data, still = model.createData(), np.zeros(model.nv)
            for i, q in enumerate(joints):
                # Pinocchio returns torques that hold the masses: those of the masses are opposite.
                holding = pin.computeJointTorqueRegressor(model, data, q, still, still)
                # Each link has ten inertial parameters; the first four are mass and first moments.
                levers[i, ..., axis] = -holding.reshape(n, n, 10)[..., :4]
        return levers

    @property
    def jacobian(self) -> FloatArray:
        """(N, 6, n) spatial Jacobian, axes of R0.

        The first three rows are the velocity of the point of the flange that passes through the origin of R0
        [m/rad], the last three the flange's angular velocity [rad/rad]. The column of a prismatic joint is
        its axis, then zeros [m/m, rad/m].
        """
        return self._kinematics[0]

    @cached_property
    def _twists(self) -> FloatArray:
        """(6, n, N) columns of the Jacobian, with contiguous components."""
        return np.ascontiguousarray(self.jacobian.transpose(1, 2, 0))

    @property
    def angular_jacobian(self) -> FloatArray:
        """(N, 3, n) J_ω, the last three rows of the spatial Jacobian; zero for a prismatic joint."""
        return self._kinematics[0][:, 3:]

    @property
    def flange_rotation(self) -> FloatArray:
        """(N, 3, 3) rotations from the flange frame to R0."""
        return self._kinematics[1]

    @property
    def flange_translation(self) -> FloatArray:
        """(N, 3) origin of the flange frame in R0 [m]."""
        return self._kinematics[2]

    @cached_property
    def flange_jacobian(self) -> FloatArray:
        """(N, 6, n) Jacobian of the flange's origin [m], then of the flange's rotation; axes of R0."""
        jacobian = self.pose_jacobian_at(self.flange_translation[:, None])
        jacobian.setflags(write=False)
        return jacobian

    def flange_placement(self, posture: int) -> pin.SE3:
        """Return the transform from the flange frame to R0 in the posture of this index [m]."""
        return pin.SE3(self.flange_rotation[posture], self.flange_translation[posture])

    @property
    def flange_pose(self) -> FloatArray:
        """(N, 4, 4) homogeneous transforms from the flange frame to R0 [m]."""
        poses = np.tile(np.eye(4), (len(self), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = self.flange_rotation, self.flange_translation
        return poses

    def __len__(self) -> int:
        return len(self.q)

    def jacobian_at(self, points: FloatArray) -> FloatArray:
        """Return the velocity Jacobian J_v of points x that are fixed to the flange (method.md §1).

        Column j is ``a_j × (x − o_j)`` for a revolute joint with axis a_j and origin o_j, and a_j for a
        prismatic joint. The first rows of the spatial Jacobian already hold ``−a_j × o_j``.

        Args:
            points: (N, T, 3) places of the points in R0, in each posture [m].

        Returns:
            J_v (N, T, 3, n), axes of R0 [m/rad].
        """
        x = np.ascontiguousarray(points.transpose(1, 2, 0))[:, :, None]
        v, w = self._twists[:3], self._twists[3:]
        out = np.empty((len(x), 3, *v.shape[1:]))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # components of v + w × x
            np.multiply(w[j], x[:, k], out=out[:, i])
            out[:, i] -= w[k] * x[:, j]
            out[:, i] += v[i]
        return out.transpose(3, 0, 1, 2)

    def load(self, point: FloatArray, force: FloatArray, moment: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the velocity Jacobians at the load points, and the joint torques of loads.

        Args:
            point: (N, 3) load point where the force acts, flange frame [m].
            force: (N, 3) force on the robot, axes of R0 [N].
            moment: (N, 3) moment on the robot about the load point, axes of R0 [N·m].

        Returns:
            (N, 3, n) J_v at the load points [m/rad], and (N, n) torques [N·m].
        """
        jacobian = self.jacobian_at(self.to_base(point[:, None]))[:, 0]
        return jacobian, self.joint_torque(jacobian, force, moment)

    def joint_torque(self, load_jacobian: FloatArray, force: FloatArray, moment: FloatArray) -> FloatArray:
        """Return the joint torques (N, n) [N·m] of loads: ``τ = J_v(q, p_W)ᵀ F + J_ω(q)ᵀ M`` (method.md §2).

        J_v is the Jacobian at the load points as `load` returns it (paper, eq. 12).
        """
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
        """Return Jacobians (N, 6, n) of a flange point (N, 1, 3) [m], then of the rotation; all in R0."""
        return np.concatenate([self.jacobian_at(points)[:, 0], self.angular_jacobian], axis=1)


def flange_poses(robot: Robot, q: FloatArray) -> FloatArray:
    """Return the flange's poses (m, 4, 4) in R0 [m] at the model's joint positions q (m, n) [rad or m].

    Unlike `Postures`, the function computes no Jacobians.
    """
    model, flange, count = robot.model, robot.flange_placement, len(q)
    data = model.createData()
    place = data.oMi[robot.n]
    R, t = _view_columns(place.rotation), _view_columns(place.translation)
    rotations, translations = bytearray(), bytearray()
    for configuration in in_configuration_space(model, Postures(robot, q).q):
        pin.forwardKinematics(model, data, configuration)
        rotations += R
        translations += t
    rotation = _read_columns(rotations, (count, 3, 3))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = rotation @ flange.rotation
    poses[:, :3, 3] = np.frombuffer(translations).reshape(count, 3) + rotation @ flange.translation
    return poses


def _view_columns(matrix: FloatArray) -> memoryview:
    """Return a view of the bytes, column by column, of a matrix that each call of Pinocchio computes anew.

    Appending the bytes to those of the calls before takes a third of the time of assigning to an array.
    """
    return matrix.T.data.cast("B")


def _read_columns(columns: bytearray, shape: tuple[int, int, int]) -> FloatArray:
    """Return matrices of a shape (N, k, m) from their bytes, column by column."""
    count, rows, width = shape
    return np.frombuffer(columns).reshape(count, width, rows).transpose(0, 2, 1)


def frame_motions(rotation: FloatArray, origin: FloatArray) -> FloatArray:
    """Return matrices (..., 6, 6) that turn spatial motions in the axes of frames into spatial motions in R0.

    Motions are translation, then rotation; in R0 the translation is that of the point in the origin.

    Args:
        rotation: (..., 3, 3) axes of the frames in R0.
        origin: (..., 3) origins of the frames in R0 [m].
    """
    motions = np.zeros((*rotation.shape[:-2], 6, 6))
    motions[..., :3, :3] = motions[..., 3:, 3:] = rotation
    motions[..., :3, 3:] = skew(origin) @ rotation
    return motions


@dataclass(frozen=True, eq=False)
class Wrist:
    """Wrist of a robot: the point nearest to the last three joint axes."""

    #: greatest miss distance of a spherical wrist [m]; under 10 mrad of deflection it moves the centre by 5
    #: µm
    TOLERANCE: ClassVar[float] = 0.5e-3

    centre: FloatArray  #: (3,) wrist centre in the flange frame [m]
    miss_distance: float  #: greatest distance of an axis from the centre [m]

    @property
    def spherical(self) -> bool:
        """Return whether the axes meet within `TOLERANCE`."""
        return self.miss_distance <= self.TOLERANCE


def find_wrist(robot: Robot) -> Wrist | None:
    """Find the wrist centre: the point of least squared distance to the last three axes.

    One configuration suffices: axes that meet in one configuration meet in all, as neighbouring axes keep
    their common perpendicular.

    Returns:
        The wrist, or None if there are fewer than three joints, one of the last three slides, or the point
        is not unique, as for parallel axes.
    """
    if robot.n < WRIST_JOINTS or robot.prismatic[-WRIST_JOINTS:].any():
        return None
    configuration = Postures(robot, np.zeros((1, robot.n)))
    moments, directions = np.split(configuration.jacobian[0, :, -WRIST_JOINTS:].T, 2, axis=1)
    feet = np.cross(directions, moments)  # point of each axis that is nearest to the origin of R0
    normals = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    system = normals.sum(axis=0)
    if np.linalg.svd(system, compute_uv=False)[-1] < 1e-6:  # the axes are parallel
        return None
    centre = np.linalg.solve(system, np.einsum("kij,kj->i", normals, feet))
    misses = np.linalg.norm(np.einsum("kij,kj->ki", normals, centre - feet), axis=1)
    in_flange = configuration.flange_rotation[0].T @ (centre - configuration.flange_translation[0])
    return Wrist(in_flange, float(misses.max()))


def measure_reach(robot: Robot) -> float:
    """Return the greatest distance of the wrist from axis 1 [m], as makers state the reach.

    Joints 2 and 3 move through their limits in steps of 10°; the others stay in the middle of theirs. A robot
    whose last three axes have no nearest point is measured at its flange.

    Args:
        robot: at least three joints; the first three are revolute.
    """
    wrist = find_wrist(robot)
    lower, upper = np.clip(robot.limits, -np.pi, np.pi).T
    steps = [
        np.linspace(lower[j], upper[j], 1 + int(np.ceil((upper[j] - lower[j]) / _REACH_STEP))) for j in (1, 2)
    ]
    second, third = (angles.ravel() for angles in np.meshgrid(*steps))
    q = np.tile(0.5 * (lower + upper), (len(second), 1))
    q[:, 1], q[:, 2] = second, third
    at = Postures(robot, q)
    point = np.zeros(3) if wrist is None else wrist.centre
    frames, origins = Postures(robot, q[:1]).joint_frames  # axis 1 is the same in all postures
    axis = frames[0, 0] @ robot.axes[0]
    offset = at.to_base(np.broadcast_to(point, (len(q), 1, 3)))[:, 0] - origins[0, 0]
    return float(np.linalg.norm(np.cross(offset, axis), axis=1).max())


def skew(v: FloatArray) -> FloatArray:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def rotation_vectors(final: FloatArray, initial: FloatArray) -> FloatArray:
    """Return rotation vectors (N, 3) [rad] that turn the initial into the final rotations (N, 3, 3).

    If the rotations are from a body to R0, the vectors are in R0. A small angle is computed from the
    antisymmetric part of ``final initialᵀ``, which is axis times sine and keeps all digits.
    """
    t, f = final.transpose(1, 2, 0), initial.transpose(1, 2, 0)
    vectors = np.empty((3, len(final)))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        vectors[i] = np.einsum("in,in->n", t[k], f[j]) - np.einsum("in,in->n", t[j], f[k])
    sine = 0.5 * np.sqrt(np.einsum("in,in->n", vectors, vectors))
    # The trace of the rotation exceeds 1 for angles below 90°, whose sine determines the angle.
    small = (sine < _SMALL_SINE) & (np.einsum("ijn,ijn->n", t, f) > 1.0)
    angle = np.arcsin(np.where(small, sine, 0.0))
    vectors *= np.where(sine > 0.0, 0.5 * angle / np.where(sine > 0.0, sine, 1.0), 0.5)
    large = np.flatnonzero(~small)
    if len(large):
        turns = Rotation.from_matrix(final[large] @ initial[large].transpose(0, 2, 1))
        vectors[:, large] = turns.as_rotvec().T
    return vectors.T
