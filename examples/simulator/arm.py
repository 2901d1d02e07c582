"""A serial arm with springs in its joints: what it is, where its axes and flange are.

Units are SI (m, rad, N·m). Everything is expressed in R0, the robot's base frame, unless it says
otherwise. Postures take leading batch axes: angles `(..., n)` give rotations `(..., 3, 3)`.
Rotations are never linearised. The balance of springs and load is in `jointstiff.simulator.equilibrium`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Encoders", "FloatArray", "Posture", "SpringArm", "default_arm"]

FloatArray = NDArray[np.float64]
Encoders = Literal["motor", "secondary"]

# Stiffness [N·m/rad] as the encoders see it: secondary encoders on axes 1 to 3 take the gear out of
# the loop.
STIFFNESSES: dict[Encoders, tuple[float, ...]] = {
    "motor": (3.8e6, 3.1e6, 2.5e6, 0.45e6, 0.25e6, 0.09e6),
    "secondary": (6.6e6, 5.7e6, 6.1e6, 0.45e6, 0.25e6, 0.09e6),
}
PAYLOAD = 240.0  # of the default arm [kg]
LIMITS_DEGREES = ((-180, 180), (-40, 70), (-100, 60), (-200, 200), (-120, 120), (-350, 350))


@dataclass(frozen=True, eq=False)
class SpringArm:
    """A serial arm of revolute and prismatic joints, each a linear spring; the links are rigid.

    The kinematics are given at zero joint positions, in R0; there are no link frames. A prismatic joint
    slides along its axis: its position and limits are in m, its stiffness is in N/m, and [rad], [N·m] and
    [N·m/rad] below are [m], [N] and [N/m] of it.
    """

    axis_points: FloatArray  #: A point on each axis, in R0 [m], (n, 3)
    axis_directions: FloatArray  #: Unit vector along each axis, in R0, (n, 3)
    flange_rotation: FloatArray  #: Rotation from the flange frame to R0, (3, 3)
    flange_translation: FloatArray  #: Origin of the flange frame in R0 [m], (3,)
    stiffnesses: FloatArray  #: Torsional stiffness of each joint [N·m/rad], (n,); infinite for a rigid joint
    #: Lowest and highest angle of each joint [rad], (n, 2); ±π if not given
    limits: FloatArray = field(default_factory=lambda: np.array([-np.pi, np.pi]))
    prismatic: tuple[int, ...] = ()  #: Indices of the prismatic joints
    payload: float | None = None  #: Largest payload [kg], as a maker would state it; None if not stated

    def __post_init__(self) -> None:
        n = np.size(self.stiffnesses)
        object.__setattr__(self, "limits", np.broadcast_to(self.limits, (n, 2)))
        shapes = {
            "axis_points": (n, 3),
            "axis_directions": (n, 3),
            "flange_rotation": (3, 3),
            "flange_translation": (3,),
            "stiffnesses": (n,),
            "limits": (n, 2),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, _read_only(name, getattr(self, name), shape))
        _check_arm(self)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints from base to flange: joint_1, joint_2, ..."""
        return tuple(f"joint_{j + 1}" for j in range(len(self.stiffnesses)))

    @property
    def compliances(self) -> FloatArray:
        """Compliance of each joint [rad/(N·m)], (n,); zero for a rigid joint."""
        return 1.0 / self.stiffnesses

    def posture(self, q: ArrayLike) -> Posture:
        """Place axes and flange at the joint angles q, by the product of exponentials.

        `T(q) = exp(ξ_1 q_1) … exp(ξ_n q_n) T(0)`; axis j is carried by the joints before it.

        Args:
            q: Joint angles [rad], (..., n).
        """
        angles = np.asarray(q, dtype=float)
        rotation: FloatArray = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
        translation: FloatArray = np.zeros((*angles.shape[:-1], 3))
        points, directions = [], []
        for j, (point, direction) in enumerate(zip(self.axis_points, self.axis_directions, strict=True)):
            points.append(rotation @ point + translation)
            directions.append(rotation @ direction)
            if j in self.prismatic:
                translation = translation + angles[..., j, None] * directions[-1]
            else:
                rotation = rotation @ _rotation_about(direction, angles[..., j])
                translation = points[-1] - rotation @ point
        turning = np.array([[0.0 if j in self.prismatic else 1.0] for j in range(len(points))])
        return Posture(
            axis_points=np.stack(points, axis=-2),
            axis_directions=np.stack(directions, axis=-2),
            turning=turning,
            flange_rotation=rotation @ self.flange_rotation,
            flange_translation=rotation @ self.flange_translation + translation,
        )


@dataclass(frozen=True, eq=False)
class Posture:
    """Positions of the axes and the flange of an arm, in R0."""

    axis_points: FloatArray  #: Point o_j on each axis [m], (..., n, 3)
    axis_directions: FloatArray  #: Unit vector a_j along each axis, (..., n, 3)
    turning: FloatArray  #: 1 of a joint that turns about its axis, 0 of one that slides along it, (n, 1)
    flange_rotation: FloatArray  #: Rotation from the flange frame to R0, (..., 3, 3)
    flange_translation: FloatArray  #: Origin of the flange frame [m], (..., 3)

    @property
    def turns(self) -> FloatArray:
        """Angular velocity of the flange per unit speed of each joint: a_j or zero, (..., n, 3)."""
        return self.turning * self.axis_directions

    @property
    def slides(self) -> FloatArray:
        """Velocity of the flange per unit speed of each joint that slides: a_j or zero, (..., n, 3)."""
        return (1.0 - self.turning) * self.axis_directions

    def point_to_base(self, point: ArrayLike) -> FloatArray:
        """Express one point per posture, given in the flange frame [m] (..., 3), in R0."""
        local = np.asarray(point, dtype=float)
        rotated: FloatArray = np.einsum("...ij,...j->...i", self.flange_rotation, local)
        return rotated + self.flange_translation

    def targets_to_base(self, targets: ArrayLike) -> FloatArray:
        """Express every target, given in the flange frame [m] (T, 3), in R0: (..., T, 3)."""
        local = np.asarray(targets, dtype=float)
        rotated: FloatArray = local @ np.swapaxes(self.flange_rotation, -1, -2)
        return rotated + self.flange_translation[..., None, :]

    def velocities(self, point: FloatArray) -> FloatArray:
        """Velocity of a flange-fixed point x per unit speed of each joint.

        It is a_j × (x − o_j) of a revolute joint, a_j of a prismatic one.

        Args:
            point: The point x in R0 [m], (..., 3).

        Returns:
            Rows of the transposed Jacobian J_v(q, x)ᵀ [m/rad], axes of R0, (..., n, 3).
        """
        turned: FloatArray = np.cross(self.turns, point[..., None, :] - self.axis_points)
        return turned + self.slides


def default_arm(encoders: Encoders = "motor", *, wrist_offset: float = 0.0) -> SpringArm:
    """A 240 kg class arm with six axes and about 3 m of reach, our own dimensions.

    At zero the upper arm is vertical and the forearm horizontal along x of R0; z of the flange
    points out of it. Axes 4 and 6 turn about −x, as many makers have it.

    Args:
        encoders: Which encoders close the position loop. Secondary ones make axes 1 to 3 stiffer.
        wrist_offset: How far axis 6 passes axis 5 at its nearest [m]; 0 for a spherical wrist.
    """
    wrist_height = 0.78 + 1.12 + 0.06  # shoulder, upper arm, forearm above the elbow [m]
    wrist_reach = 0.33 + 1.31  # shoulder from axis 1, forearm [m]
    tool_height = wrist_height + wrist_offset
    points = [
        [0.0, 0.0, 0.0],
        [0.33, 0.0, 0.78],
        [0.33, 0.0, 0.78 + 1.12],
        [0.33, 0.0, wrist_height],
        [wrist_reach, 0.0, wrist_height],
        [wrist_reach, 0.0, tool_height],
    ]
    x, y, z = np.eye(3)
    return SpringArm(
        axis_points=np.array(points),
        axis_directions=np.array([z, y, y, -x, y, -x]),
        flange_rotation=np.column_stack([-z, y, x]),
        flange_translation=np.array([wrist_reach + 0.24, 0.0, tool_height]),
        stiffnesses=np.array(STIFFNESSES[encoders]),
        limits=np.radians(LIMITS_DEGREES),
        payload=PAYLOAD,
    )


def _rotation_about(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation by angle [rad] (...) about a unit vector (3,), by Rodrigues: (..., 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[..., None, None], (1.0 - np.cos(angle))[..., None, None]
    rotation: FloatArray = np.eye(3) + sine * K + versine * (K @ K)
    return rotation


def _read_only(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = np.array(value, dtype=float) + 0.0  # no negative zeros
    if array.shape != shape:
        msg = f"{name} has shape {array.shape}; expected {shape}"
        raise ValueError(msg)
    array.setflags(write=False)
    return array


def _check_arm(arm: SpringArm) -> None:
    placement = (arm.axis_points, arm.axis_directions, arm.flange_rotation, arm.flange_translation)
    R = arm.flange_rotation
    requirements = {
        "an arm needs at least one joint": arm.stiffnesses.size > 0,
        "axes and flange must be finite": all(np.all(np.isfinite(array)) for array in placement),
        "axis_directions must be unit vectors": np.allclose(
            np.linalg.norm(arm.axis_directions, axis=-1), 1.0, rtol=0.0, atol=1e-12
        ),
        "flange_rotation must be a rotation matrix": np.allclose(R.T @ R, np.eye(3), rtol=0.0, atol=1e-12)
        and np.linalg.det(R) > 0.0,
        "stiffnesses must be positive": np.all(arm.stiffnesses > 0.0),
        "limits must be finite and in ascending order": np.all(np.isfinite(arm.limits))
        and np.all(arm.limits[:, 0] < arm.limits[:, 1]),
    }
    for requirement, is_met in requirements.items():
        if not is_met:
            raise ValueError(requirement)
