"""Bodies that joints carry, springs that balance them, and the torques of both, linear in their parameters.

A body of mass m whose centre of mass is at s + d, d unknown within a ball of radius R, twists joint j by
``τ_j = m T_j(s) + (m d) · ∇T_j``, T_j the torque of a kilogram. With m = m₀ + ζ and ν = m d that is linear in
(ζ, ν); a balancer of rate k and free length s₀ is linear in (k, k s₀). So each posture has torques of the
nominal parameters, and of each unknown at its bound (`Torques`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.geometry.poses import Poses
from jointstiff.solver.predict.models import unit_levers
from jointstiff.solver.robot.model import Body


@dataclass(frozen=True)
class Balancer:
    """A spring between base and a link, pulled from its free length.

    Raises:
        RequestError: a pair of bounds is not in order.
    """

    joint: int  #: index of the joint that carries its further point
    on_base: tuple[float, float, float]  #: point on the base, in R0 [m]
    on_link: tuple[float, float, float]  #: point on the link, in the frame that moves with the joint [m]
    rate: tuple[float, float]  #: bounds of k [N/m]
    pull: tuple[float, float]  #: bounds of k s₀ [N], s₀ the free length

    def __post_init__(self) -> None:
        for low, high in (self.rate, self.pull):
            if not (np.isfinite([low, high]).all() and 0.0 <= low <= high and high > 0.0):
                raise RequestError(
                    "the bounds of a balancer's spring are not in order",
                    where="balancer",
                    remedy="give the least, then the greatest rate in N/m, and rate times free length in N",
                )


@dataclass(frozen=True, eq=False)
class Placement:
    """Axes of the arm in B postures, with the frames that move with the joints."""

    direction: FloatArray  #: (B, n, 3) direction of the axes
    point: FloatArray  #: (B, n, 3) on the axes [m]
    rotation: FloatArray  #: (B, n, 3, 3) rotation of the frames
    origin: FloatArray  #: (B, n, 3) origin of the frames [m]
    #: from R0 to the frame of all this: rotation (3, 3), translation (3,)
    base: tuple[FloatArray, FloatArray]

    @cached_property
    def unit(self) -> FloatArray:
        """(B, n, n, 4, 3) `unit_levers` [m]."""
        return unit_levers(self.direction, self.point, self.rotation, self.origin)


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques of B postures: those known, and those of each of K unknowns at its bound."""

    known: FloatArray  #: (B, n) of loads and of the nominal parameters [N·m]
    unit: FloatArray  #: (B, n, K) of each deviation from them at its bound
    by_gravity: FloatArray  #: (B, n, 3) derivative of those known by the vector of gravity [kg·m]


@dataclass(frozen=True, eq=False)
class Burden:
    """Bodies that the joints carry, of which some hang on in some observations only, and balancers."""

    bodies: tuple[Body, ...]  #: links, tool, payloads
    balancers: tuple[Balancer, ...] = ()  #: springs between base and links
    #: (3,) in the frame of the positions [m/s²]
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.80665]))

    @property
    def unknown(self) -> tuple[list[tuple[int, FloatArray]], list[tuple[int, int, float]]]:
        """Unknowns of the bodies, in the order of `torques`, and uncertain centres of mass among them.

        Each unknown is a body and an inertia (4,) [kg, kg·m] at its bound. Each centre is the index of the
        first of its three moments, that of its body's mass or −1 if that is exact, and the share by which the
        moments' bound grows with it.
        """
        unknown: list[tuple[int, FloatArray]] = []
        balls = []
        for number, body in enumerate(self.bodies):
            mean, half, own = 0.5 * (body.most + body.least), 0.5 * (body.most - body.least), -1
            if half > 0.0:
                own = len(unknown)
                unknown.append((number, half * np.array([1.0, *body.centre])))
            if body.radius > 0.0:
                balls.append((len(unknown), own, half / mean))
                unknown += [(number, body.radius * mean * axis) for axis in np.eye(4)[1:]]
        return unknown, balls

    def torques(self, placed: Placement, carried: FloatArray) -> Torques:
        """Return the torques of the burden.

        The nominal parameters are the middles of their bounds.

        Args:
            placed: B postures.
            carried: (B, bodies) 1 where a body hangs on, else 0.
        """
        joint = [body.joint for body in self.bodies]
        hangs = carried.T[:, :, None, None]
        by_gravity = np.zeros(placed.point.shape)
        for number, body in enumerate(self.bodies):
            kilogram = np.einsum("bjpi,p->bji", placed.unit[:, :, joint[number]], [1.0, *body.centre])
            by_gravity += 0.5 * (body.most + body.least) * hangs[number] * kilogram
        pulls = placed.unit @ self.gravity
        unit = [
            hangs[number, ..., 0] * (pulls[:, :, joint[number]] @ each) for number, each in self.unknown[0]
        ]
        known = by_gravity @ self.gravity
        for balancer in self.balancers:
            own, on_link = balancer.joint, np.array(balancer.on_link)
            R, t = placed.base
            far = placed.origin[:, own] + placed.rotation[:, own] @ on_link
            line = far - (R @ np.array(balancer.on_base) + t)
            length = np.linalg.norm(line, axis=1, keepdims=True)
            levers = np.einsum("bjpi,p->bji", placed.unit[:, :, own], [1.0, *on_link])
            springs = [np.einsum("bji,bi->bj", levers, pull) for pull in (-line, line / length)]
            for torque, (low, high) in zip(springs, (balancer.rate, balancer.pull), strict=True):
                known += 0.5 * (low + high) * torque
                unit += [0.5 * (high - low) * torque] if high > low else []
        units = np.stack(unit, axis=-1) if unit else np.zeros((*known.shape, 0))
        return Torques(known, units, by_gravity)


@dataclass(frozen=True, eq=False)
class WeightReadings:
    """N observations of absolute positions. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, or a number is not finite.
    """

    poses: Poses  #: angles and positions; their frame is that of forces and gravity, too
    burden: Burden  #: links, tool, payloads, balancers
    carried: FloatArray  #: (N, bodies) 1 where a body hangs on, else 0
    force: FloatArray  #: (N, 3) known force on the robot [N]; zero without load
    moment: FloatArray  #: (N, 3) known moment about the load point [N·m]
    load_point: FloatArray  #: (N, 3) where the force acts, flange frame [m]

    def __post_init__(self) -> None:
        count = len(self.poses.angles)
        shapes = {"carried": (count, len(self.burden.bodies))}
        shapes |= dict.fromkeys(("force", "moment", "load_point"), (count, 3))
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise MeasurementError(
                    f"the shape is {array.shape} instead of {shape}, or a number is not finite",
                    where=name,
                    remedy="give finite numbers for each observation",
                )
            array.setflags(write=False)
        joints = [body.joint for body in self.burden.bodies]
        joints += [balancer.joint for balancer in self.burden.balancers]
        if not joints or not 0 <= min(joints) <= max(joints) < self.poses.joint_map.n:
            raise MeasurementError(
                f"no body is stated, or one is on none of the {self.poses.joint_map.n} joints",
                where="masses",
                remedy="state mass and centre of mass of each link, by the joint that carries it",
            )

    @classmethod
    def unloaded(cls, poses: Poses, burden: Burden) -> WeightReadings:
        """Return the readings of a robot that carries all bodies in all observations, and nothing else."""
        nothing = np.zeros((len(poses.angles), 3))
        carried = np.ones((len(poses.angles), len(burden.bodies)))
        return cls(poses, burden, carried, nothing, nothing.copy(), nothing.copy())
