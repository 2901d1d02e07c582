"""Displaced axes: what a small motion of one joint's axis does to torques and deflections (method.md §8).

An axis that moves by ξ in its own frame moves all behind it by the spatial motion ``ζ = (P − M) ξ``: P is
Pinocchio's regressor of the joint's placement, M the motion of the frame that turns with the joint, in which
ξ is undone. Columns ``S_k`` of the spatial Jacobian follow as any motion u of their axis moves them:

    dS_k = u × S_k = (ω_u × v_k + v_u × ω_k, ω_u × ω_k),   u = 0 before the axis, P ξ of itself, ζ behind it
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.block import RegressorBlock, unloaded_postures, wrench_stiffness
from jointstiff.solver.mechanics.postures import Postures


@dataclass(frozen=True, eq=False)
class DisplacedAxis:
    """Derivative of the kinematics of B postures with respect to k small displacements of a joint's axis."""

    linear: FloatArray  #: (B, 3, n, k) derivative of the first three rows of the spatial Jacobian
    angular: FloatArray  #: (B, 3, n, k) derivative of the last three rows of the spatial Jacobian
    flange: FloatArray  #: (B, 6, k) spatial motion of the flange

    @classmethod
    def differentiate(
        cls, postures: Postures, joint: int, axis_displacements: FloatArray, joint_motion: FloatArray
    ) -> DisplacedAxis:
        """Differentiate the kinematics with respect to small displacements of a joint's axis.

        The column S = (v, ω) of the spatial Jacobian of an axis that moves by u = (u_v, u_ω) changes by
        ``(u_ω × v + u_v × ω, u_ω × ω)``.

        Args:
            postures: B postures of n joints.
            joint: index of the joint.
            axis_displacements: (6, k) displacements of the axis: translations along, then rotations about
                the axes of the joint's frame.
            joint_motion: (B, n, k) change of the joint positions that each displacement causes [rad or m].

        Returns:
            Derivatives of the Jacobian's linear and angular rows, and the motion of the flange.
        """
        S = postures.jacobian
        joint_part = S[..., None] * joint_motion[:, None]  # (B, 6, n, k) motion due to each joint
        carried_motion = np.cumsum(joint_part, axis=2)
        axis_motion = carried_motion - joint_part  # motion of each axis because of the joints before it
        # (B, 6, k) motion of everything that follows the axis in the chain
        motion_behind_axis = postures.axis_motions[:, joint] @ axis_displacements
        axis_motion[:, :, joint] += postures.placement_motions[:, joint] @ axis_displacements
        axis_motion[:, :, joint + 1 :] += motion_behind_axis[:, :, None]
        v, w = S[:, :3, :, None], S[:, 3:, :, None]  # (B, 3, n, 1)
        u_v, u_w = axis_motion[:, :3], axis_motion[:, 3:]  # (B, 3, n, k)
        return cls(
            linear=np.cross(u_w, v, axis=1) + np.cross(u_v, w, axis=1),
            angular=np.cross(u_w, w, axis=1),
            flange=carried_motion[:, :, -1] + motion_behind_axis,
        )

    def differentiate_points(self, points: FloatArray) -> FloatArray:
        """Return the derivative (B, T, 3, k) [m per unit] of points (B, T, 3) [m, R0] fixed to the flange."""
        v, w = self.flange[:, None, :3], self.flange[:, None, 3:]  # velocity at R0's origin, and rotation
        return np.asarray(v + np.cross(w, points[..., None], axis=2))


def differentiate_torque(
    block: RegressorBlock, postures: Postures, joint: int, axis_displacements: FloatArray
) -> FloatArray:
    """Return the derivative (B, n, k) of the load's joint torques with respect to displacements of an axis.

    The joint angles of the B postures stay the same. `axis_displacements` (6, k) holds the displacements of
    the axis of `joint`: translations along, then rotations about the axes of the joint's frame.
    """
    measurements = block.measurements
    no_motion = np.zeros((*postures.q.shape, axis_displacements.shape[1]))
    load_point = postures.to_base(measurements.load_point[:, None])
    moved_axes = DisplacedAxis.differentiate(postures, joint, axis_displacements, no_motion)
    force = measurements.force
    moment = measurements.moment + np.cross(load_point[:, 0], force)  # about R0's origin
    lever_torque = np.cross(moved_axes.differentiate_points(load_point)[:, 0], force[..., None], axis=1)
    torque = np.einsum("binm,bi->bnm", moved_axes.linear, force) + np.einsum(
        "binm,bi->bnm", moved_axes.angular, moment
    )
    return np.asarray(torque + np.einsum("bin,bim->bnm", postures.angular_jacobian, lever_torque))


def differentiate_deflection(
    block: RegressorBlock, compliance: FloatArray, joint: int, axis_displacements: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Differentiate predicted deflections and torques with respect to small displacements of one axis.

    With the complementary stiffness K_c, torques change by ``dτ = (I − K_c diag(c))⁻¹ ∂τ`` in the loaded
    posture, and the posture half-way between unloaded and loaded turns by ``c ∘ dτ / 2``. A target whose
    position was read in R0 stays there; a target whose position on the flange is known moves with the flange.

    Args:
        block: B observations of T targets.
        compliance: (n,) compliances c of the joints [rad/(N·m)].
        joint: index of the joint.
        axis_displacements: (6, k) displacements of the axis: translations along, then rotations about the
            axes of the joint's frame.

    Returns:
        The derivatives with respect to k displacements: of the targets' deflections (B, T, 3, k) [m per
        unit], and of the joint torques (B, n, k) [N·m per unit].
    """
    measurements = block.measurements
    postures = block.postures
    equilibrium_compliance = block.compliance
    on_flange = measurements.in_flange[..., None, None]
    if equilibrium_compliance is None:  # the block neglects the complementary stiffness
        torque = differentiate_torque(block, postures, joint, axis_displacements)
        moved_axes = DisplacedAxis.differentiate(postures, joint, axis_displacements, 0.0 * torque)
        points = np.where(on_flange, moved_axes.differentiate_points(block.points), 0.0)
    else:
        unloaded = unloaded_postures(block.robot, measurements)
        loaded = Postures(block.robot, unloaded.q + equilibrium_compliance * block.torque)
        force, moment = measurements.force, measurements.moment
        load_jacobian, _ = loaded.load(measurements.load_point, force, moment)
        stiffness = wrench_stiffness(loaded.angular_jacobian, load_jacobian, force, moment)
        # ∂τ: change of the torque without the joint motion that the change of the torque causes
        direct = differentiate_torque(block, loaded, joint, axis_displacements)
        feedback = np.eye(len(equilibrium_compliance)) - stiffness * equilibrium_compliance
        torque = np.asarray(np.linalg.solve(feedback, direct))
        moved_axes = DisplacedAxis.differentiate(
            postures, joint, axis_displacements, 0.5 * equilibrium_compliance[:, None] * torque
        )
        unloaded_axes = DisplacedAxis.differentiate(unloaded, joint, axis_displacements, 0.0 * torque)
        # A target read in R0 does not move with the unloaded flange: subtract the motion of the flange,
        # turned into the half-loaded posture.
        flange_turn = postures.flange_rotation @ unloaded.flange_rotation.mT
        with_flange = flange_turn[:, None] @ unloaded_axes.differentiate_points(measurements.position)
        points = moved_axes.differentiate_points(block.points) - np.where(on_flange, 0.0, with_flange)
    turns = compliance * block.torque  # (B, n) elastic turns of the joints [rad]
    linear, angular = (
        np.einsum("binm,bn->bim", each, turns) for each in (moved_axes.linear, moved_axes.angular)
    )
    rotation = np.einsum("bin,bn->bi", postures.angular_jacobian, turns)
    change = linear[:, None] + np.cross(angular[:, None], block.points[..., None], axis=2)
    change += np.cross(rotation[:, None, :, None], points, axis=2)
    return change + block.jacobian @ (compliance[:, None] * torque)[:, None], torque
