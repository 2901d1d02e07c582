"""Own weight of the links: torques and stiffness of forces that act on links before the flange."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import Robot

STANDARD_GRAVITY: FloatArray = np.array([0.0, 0.0, -9.80665])
"""In R0, z upwards [m/s²]."""


@dataclass(frozen=True, eq=False)
class OwnWeight:
    """Masses of the n links, each carried by a joint; a tool and its payload belong to the last.

    Raises:
        RequestError: a mass is negative, or a number is not finite.
    """

    absolute: ClassVar[bool] = False
    """Whether deflections are from the arm that does not bend; else from where the weight alone takes it."""

    #: (n,) [kg], zero for a link whose weight is left out; or (n, n), row j as the torque of joint j has them
    mass: FloatArray
    #: (n, 3) centres of mass in the frames that move with the joints [m]; or (n, n, 3) likewise
    centre: FloatArray
    gravity: FloatArray = field(default_factory=lambda: STANDARD_GRAVITY)  #: (3,) in R0 [m/s²]

    def __post_init__(self) -> None:
        finite = all(np.isfinite(array).all() for array in (self.mass, self.centre, self.gravity))
        if not finite or (self.mass < 0.0).any() or self.centre.shape != (*self.mass.shape, 3):
            raise RequestError(
                "a mass is negative, or a number is not finite",
                where="own_weight",
                remedy="give each link a mass in kg and its centre in m",
            )

    def torque_and_stiffness(
        self, robot: Robot, configurations: Configurations
    ) -> tuple[FloatArray, FloatArray]:
        """Return the torques g(q) and ``∂g/∂q`` of the weights (method.md §9).

        Joint j carries the links behind it: ``g_j = a_j · (S_j × γ)``, a its axis, γ gravity, S their first
        moment about it. An angle behind j moves the moment of the links behind that angle, one before it
        turns all that j carries, which is to turn gravity back.

        Returns:
            (B, n) [N·m] and (B, n, n) [N·m/rad].
        """
        n = robot.n
        rotation, origin = joint_frames(robot, configurations.q)
        axes = configurations.angular_jacobian.transpose(0, 2, 1)
        mass = np.triu(np.broadcast_to(self.mass, (n, n)))
        centre = (mass[..., None] * self.centre).transpose(1, 2, 0)  # (l, 3, j)
        moments = mass[..., None] * origin[:, None] + (rotation @ centre).transpose(0, 3, 1, 2)
        behind = moments[:, :, ::-1].cumsum(axis=2)[:, :, ::-1]  # (B, j, k, 3), of the links from k on
        behind = behind - mass[:, ::-1].cumsum(axis=1)[:, ::-1, None] * origin[:, None]
        own = np.einsum("bjji->bji", behind)
        torque = np.einsum("bji,bji->bj", axes, np.cross(own, self.gravity))
        later = np.cross(np.cross(axes[:, None], behind), self.gravity)
        sooner = -np.cross(own[:, :, None], np.cross(axes, self.gravity)[:, None])
        moved = np.where(np.tri(n, k=-1, dtype=np.bool_)[..., None], sooner, later)
        return torque, np.einsum("bji,bjki->bjk", axes, moved)


def unit_levers(
    direction: FloatArray, point: FloatArray, rotation: FloatArray, origin: FloatArray
) -> FloatArray:
    """Return the levers by which forces on links twist the joints before them.

    Args:
        direction: (B, n, 3) of the axes.
        point: (B, n, 3) on them [m].
        rotation: (B, n, 3, 3) of the frames that move with the joints.
        origin: (B, n, 3) of them [m].

    Returns:
        (B, n, n, 4, 3): of joint j by link l, at the link's origin [m], then for a metre along each of its
        axes; zero where l < j.
    """
    n = point.shape[1]
    by_force = np.cross(direction[:, :, None], origin[:, None] - point[:, :, None])
    by_metre = np.cross(direction[:, :, None, None], rotation.transpose(0, 1, 3, 2)[:, None])
    levers = np.concatenate([by_force[..., None, :], by_metre], axis=3)
    return np.asarray(levers * np.triu(np.ones((n, n)))[..., None, None])


@dataclass(frozen=True, eq=False)
class IdentifiedWeight(OwnWeight):
    """Own weight as an identification found it with the compliances: deflections hold the sag."""

    absolute: ClassVar[bool] = True

    #: (n + 4 n², r) root of the covariance of all c_j, then of c_j m_jl and c_j m_jl s_jl, l the fastest but
    #: for these four [rad/(N·m), times kg, kg·m]
    root: FloatArray = field(kw_only=True)

    @property
    def determined(self) -> BoolArray:
        """(n,) joints of whose sag the readings tell something."""
        return np.asarray(self.root[: len(self.mass)].any(axis=1))

    def turn_root(self, robot: Robot, configurations: Configurations, torque: FloatArray) -> FloatArray:
        """Return a root (B, n, r) of the covariance of joints' turns [rad], by loads' torques (B, n)."""
        n = robot.n
        rotation, origin = joint_frames(robot, configurations.q)
        axes = configurations.angular_jacobian.transpose(0, 2, 1)
        units = unit_levers(axes, origin, rotation, origin) @ self.gravity
        own = np.einsum("bjlp,jlpr->bjr", units, self.root[n:].reshape(n, n, 4, -1))
        return np.asarray(torque[..., None] * self.root[:n] + own)
