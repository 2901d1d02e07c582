"""Bodies that joints carry, springs that balance them, and the torques of both, linear in their parameters.

A body of mass m whose centre of mass is at s + d, d unknown within a ball of radius R, twists joint j by
``τ_j = m T_j(s) + (m d) · ∇T_j``, T_j the torque of a kilogram. With m = m₀ + ζ and ν = m d that is linear in
(ζ, ν); a balancer of rate k and free length s₀ is linear in (k, k s₀). So each posture has torques of the
nominal parameters, and of one unit of each unknown (`Torques`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.geometry.sweeps.pose_fit import Poses
from jointstiff.solver.robot.body import Body


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
    """Axes of the arm in B postures, with the motion of what each joint carries."""

    direction: FloatArray  #: (B, n, 3) of the axes
    point: FloatArray  #: (B, n, 3) on the axes [m]
    rotation: FloatArray  #: (B, n, 3, 3) of the bodies behind the joints, from their place at angle zero
    translation: FloatArray  #: (B, n, 3) likewise [m]
    base: tuple[
        FloatArray, FloatArray
    ]  #: from R0 to the frame of all this: rotation (3, 3), translation (3,)
    frame: tuple[FloatArray, FloatArray]  #: frames of the joints at angle zero: (n, 3, 3), (n, 3) [m]

    def of(self, joint: int, point: FloatArray) -> FloatArray:
        """(B, 3) place of a point (3,) of the frame that moves with a joint [m]."""
        at_zero = self.frame[0][joint] @ point + self.frame[1][joint]
        return np.asarray(self.rotation[:, joint] @ at_zero + self.translation[:, joint])

    def turned(self, joint: int) -> FloatArray:
        """(B, 3, 3) axes of the frame that moves with a joint."""
        return np.asarray(self.rotation[:, joint] @ self.frame[0][joint])

    def levers(self, joint: int, place: FloatArray) -> FloatArray:
        """(B, n, 3) torques [m] of unit forces along the axes, at a place (B, 3) on a joint's body."""
        levers = np.zeros(self.point.shape)
        arms = place[:, None] - self.point[:, : joint + 1]
        levers[:, : joint + 1] = np.cross(self.direction[:, : joint + 1], arms)
        return levers


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques of B postures: those known, and those of a unit of each of K unknowns."""

    known: FloatArray  #: (B, n) of loads and of the nominal parameters [N·m]
    unit: FloatArray  #: (B, n, K) of a unit of each deviation from them
    by_gravity: FloatArray  #: (B, n, 3) derivative of those known by the vector of gravity [kg·m]


@dataclass(frozen=True, eq=False)
class Burden:
    """Bodies that the joints carry, of which some hang on in some observations only, and balancers."""

    bodies: tuple[Body, ...]  #: links, tool, payloads
    balancers: tuple[Balancer, ...] = ()  #: springs between base and links
    #: (3,) in the frame of the positions [m/s²]
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.80665]))

    def deviations(self) -> Deviations:
        """Return the bounds of the K unknowns, in the order of `torques`."""
        half: list[float] = []
        balls: list[tuple[int, int, float, float]] = []
        for body in self.bodies:
            own = -1
            if body.most > body.least:
                own = len(half)
                half.append(0.5 * (body.most - body.least))
            if body.radius > 0.0:
                mean = 0.5 * (body.most + body.least)
                balls.append((len(half), own, body.radius * mean, body.radius))
                half += [np.inf] * 3
        for balancer in self.balancers:
            half += [0.5 * (high - low) for low, high in (balancer.rate, balancer.pull) if high > low]
        return Deviations(np.array(half), tuple(balls))

    def torques(self, placed: Placement, carried: FloatArray) -> Torques:
        """Return the torques of the burden.

        The nominal parameters are the middles of their bounds.

        Args:
            placed: B postures.
            carried: (B, bodies) 1 where a body hangs on, else 0.
        """
        by_gravity, unit = np.zeros(placed.point.shape), []
        for number, body in enumerate(self.bodies):
            hangs = carried[:, number, None, None]
            kilogram = hangs * placed.levers(body.joint, placed.of(body.joint, np.array(body.centre)))
            by_gravity += 0.5 * (body.most + body.least) * kilogram
            if body.most > body.least:
                unit.append(kilogram @ self.gravity)
            if body.radius > 0.0:
                turned, origin = placed.turned(body.joint), np.zeros((len(carried), 3))
                moments = [placed.levers(body.joint, turned[..., i]) for i in range(3)]
                at_origin = placed.levers(body.joint, origin)
                unit += [hangs[..., 0] * ((moment - at_origin) @ self.gravity) for moment in moments]
        known = by_gravity @ self.gravity
        for balancer in self.balancers:
            far = placed.of(balancer.joint, np.array(balancer.on_link))
            R, t = placed.base
            line = far - (R @ np.array(balancer.on_base) + t)
            length = np.linalg.norm(line, axis=1, keepdims=True)
            levers = placed.levers(balancer.joint, far)
            pulls = [np.einsum("bji,bi->bj", levers, pull) for pull in (-line, line / length)]
            for torque, (low, high) in zip(pulls, (balancer.rate, balancer.pull), strict=True):
                known += 0.5 * (low + high) * torque
                unit += [torque] if high > low else []
        units = np.stack(unit, axis=-1) if unit else np.zeros((*known.shape, 0))
        return Torques(known, units, by_gravity)


@dataclass(frozen=True, eq=False)
class Deviations:
    """Bounds of K unknowns about their nominal values."""

    half: FloatArray  #: (K,) half-widths; inf for the moments of a ball
    #: of each centre of mass: index of its first moment, index of its body's mass or −1 if that is exact,
    #: radius times nominal mass [kg·m], radius [m]
    balls: tuple[tuple[int, int, float, float], ...]


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
                f"no body is stated, or one on none of the {self.poses.joint_map.n} joints",
                where="masses",
                remedy="state mass and centre of mass of each link, by the joint that carries it",
            )

    @classmethod
    def unloaded(cls, poses: Poses, burden: Burden) -> WeightReadings:
        """Return the readings of a robot that carries all bodies in all observations, and nothing else."""
        nothing = np.zeros((len(poses.angles), 3))
        carried = np.ones((len(poses.angles), len(burden.bodies)))
        return cls(poses, burden, carried, nothing, nothing.copy(), nothing.copy())
