"""Bodies that joints carry, springs that balance them, and the rows of readings, linear in their parameters.

A body of mass m whose centre of mass is at s + d, d unknown within a ball of radius R, twists joint j by
``τ_j = m T_j(s) + (m d) · ∇T_j``, T_j the torque of a kilogram. With m = m₀ + ζ and ν = m d that is linear in
(ζ, ν); a balancer of rate k and free length s₀ is linear in (k, k s₀). So each posture has torques of the
nominal parameters, and of each unknown at its bound: Y.

With θ the sag, ``p = f(q + θ; φ)`` and ``θ_j = c_j (τ_j + Σ_k Y_jk (π_k − π_k⁰))``, both torques taken in the
posture that sags, so that at convergence the balance is exact. About (φ, θ):

    p − f(q + θ; φ) + J_θ θ = J_φ δφ + Σ_j J_θj (τ_j c_j + Σ_k Y_jk η_jk),   η_jk = c_j (π_k − π_k⁰)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex.conic import Block
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.geometry.poses import Motion, PoseReadings, Poses, PoseState, chain_axes
from jointstiff.solver.predict.models import STANDARD_GRAVITY, unit_levers
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import Body, Robot

_GEOMETRY: Final = 0.01
"""Standard uncertainty of axes and targets before any reading [m and rad]: a nominal arm is as good."""


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
class Burden:
    """Bodies that the joints carry, of which some hang on in some observations only, and balancers."""

    bodies: tuple[Body, ...]  #: links, tool, payloads
    balancers: tuple[Balancer, ...] = ()  #: springs between base and links
    gravity: FloatArray = field(default_factory=lambda: STANDARD_GRAVITY)  #: (3,) in R0 [m/s²]

    @cached_property
    def unknown(self) -> tuple[list[tuple[int, FloatArray]], list[tuple[int, int, float]]]:
        """Unknowns of the bodies, in the order of `Torques`, and uncertain centres of mass among them.

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

    def block(self, acts: BoolArray) -> tuple[Block, list[int]]:
        """Return the unknowns of a joint that some (K,) act on, and which of all they are."""
        balls = [
            (first, own, ratio) for first, own, ratio in self.unknown[1] if acts[first : first + 3].any()
        ]
        moments = [first + i for first, _, _ in self.unknown[1] for i in range(3)]
        boxes = [k for k in np.flatnonzero(acts).tolist() if k not in moments]
        places = tuple((boxes.index(own), ratio) if own in boxes else (-1, 0.0) for _, own, ratio in balls)
        return Block(len(boxes), places), boxes + [first + i for first, _, _ in balls for i in range(3)]


@dataclass(frozen=True, eq=False)
class WeightReadings:
    """N observations of absolute positions. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, or a number is not finite.
    """

    poses: Poses  #: angles, and positions in R0
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


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques of B postures: those known, and those of each of K unknowns at its bound."""

    known: FloatArray  #: (B, n) of loads and of the nominal parameters, the middles of their bounds [N·m]
    unit: FloatArray  #: (B, n, K) of each deviation from them at its bound
    by_gravity: FloatArray  #: (B, n, 3) derivative of those known by the vector of gravity [kg·m]


@dataclass(frozen=True, eq=False)
class Rows:
    """The linearised readings, whitened, in units of sigma²."""

    residual: FloatArray  #: (m,) left side of the equation above [m]
    geometry: FloatArray  #: (m, g) J_φ
    joints: FloatArray  #: (m, n) J_θj τ_j, factors of c_j
    products: FloatArray  #: (m, n, K) J_θj Y_jk, factors of η_jk
    torques: Torques  #: torques of the N observations
    gravity: FloatArray  #: (m, 2) derivative by gravity's direction, about two axes across it [m/rad]
    across: FloatArray  #: (n,) greatest torque of the same weights and loads across each axis [N·m]


def rows_at(
    robot: Robot,
    readings: WeightReadings,
    whitened: PoseReadings,
    state: PoseState,
    sag: FloatArray,
    compliance: FloatArray,
) -> Rows:
    """Linearise the readings.

    Args:
        robot: nominal.
        readings: N observations, gravity as it is taken to be.
        whitened: the same positions with their weights.
        state: geometry to linearise about.
        sag: (N, n) θ [rad].
        compliance: (n,) by which gravity's direction shows [rad/(N·m)].
    """
    motion = Motion(state, replace(whitened, angles=whitened.angles + sag))
    torques = torques_of(robot, readings, motion)
    swings = motion.swings()
    gap = whitened.points - motion.stages[0] + np.einsum("ktin,kn->kti", swings, sag)
    weighted = (whitened.weight @ swings).reshape(*swings.shape[:1], -1, swings.shape[-1])
    geometry = whitened.weight @ motion.jacobian()
    m, gravity = gap.size, readings.burden.gravity
    size = np.linalg.norm(gravity)
    tilted = np.einsum("kij,kjg,j->kig", weighted, torques.by_gravity @ (across(gravity) * size), compliance)
    return Rows(
        residual=(whitened.weight @ gap[..., None]).reshape(m),
        geometry=geometry.reshape(m, -1),
        joints=(weighted * torques.known[:, None]).reshape(m, -1),
        products=(weighted[..., None] * torques.unit[:, None]).reshape(m, *torques.unit.shape[1:]),
        torques=torques,
        gravity=tilted.reshape(m, 2),
        across=np.maximum(
            np.abs(torques.known).max(axis=0),
            size * np.linalg.norm(torques.by_gravity, axis=2).max(axis=0),
        ),
    )


def across(vector: FloatArray) -> FloatArray:
    """Return two unit vectors (3, 2) across a vector (3,)."""
    return np.asarray(np.linalg.svd(vector[None])[2][1:].T)


def torques_of(robot: Robot, readings: WeightReadings, motion: Motion) -> Torques:
    """Return the torques of loads, bodies and balancers in the postures of a motion.

    Frames that move with the joints, and the flange's, are the nominal robot's, laid on the fitted axes.
    """
    burden, axes = readings.burden, motion.state.axes
    still = Configurations(robot, np.zeros((1, robot.n)))
    frames, nominal = (part[0] for part in joint_frames(robot, still.q))
    shift, points, origins = np.zeros((len(readings.force), 3)), [], []
    for axis, origin, before, turn in zip(axes, nominal, motion.before[:-1], motion.turns, strict=True):
        points.append(before @ axis.point + shift)
        shift = points[-1] - before @ turn @ axis.point
        origins.append(before @ turn @ axis.nearest(origin) + shift)
    directions = [before @ axis.direction for before, axis in zip(motion.before[:-1], axes, strict=True)]
    point, origin, direction = (np.stack(part, axis=1) for part in (points, origins, directions))
    rotation = np.stack(motion.before[1:], axis=1) @ frames
    levers = unit_levers(robot.prismatic, direction, point, rotation, origin)  # (B, n, n, 4, 3)

    by_gravity, hangs = np.zeros(point.shape), readings.carried.T[:, :, None, None]
    for number, body in enumerate(burden.bodies):
        kilogram = np.einsum("bjpi,p->bji", levers[:, :, body.joint], [1.0, *body.centre])
        by_gravity += 0.5 * (body.most + body.least) * hangs[number] * kilogram
    pulls = levers @ burden.gravity
    unit = [
        hangs[number, ..., 0] * (pulls[:, :, burden.bodies[number].joint] @ inertia)
        for number, inertia in burden.unknown[0]
    ]
    known = by_gravity @ burden.gravity
    for balancer in burden.balancers:
        own, on_link = balancer.joint, np.array(balancer.on_link)
        line = origin[:, own] + rotation[:, own] @ on_link - np.array(balancer.on_base)
        length = np.linalg.norm(line, axis=1, keepdims=True)
        lever = np.einsum("bjpi,p->bji", levers[:, :, own], [1.0, *on_link])
        for pull, (low, high) in ((-line, balancer.rate), (line / length, balancer.pull)):
            torque = np.einsum("bji,bi->bj", lever, pull)
            known += 0.5 * (low + high) * torque
            unit += [0.5 * (high - low) * torque] if high > low else []

    arm = readings.load_point @ still.flange_rotation[0].T + still.flange_translation[0] - nominal[-1]
    loaded = origin[:, -1] + (motion.before[-1] @ arm[..., None])[..., 0]
    known += np.einsum("kji,ki->kj", np.cross(direction, loaded[:, None] - point), readings.force)
    known += np.einsum("kji,ki->kj", direction, readings.moment)
    return Torques(known, np.stack(unit, axis=-1) if unit else np.zeros((*known.shape, 0)), by_gravity)


def planned_rows(
    robot: Robot, burden: Burden, targets: FloatArray, compliance: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Return a function from postures (N, n) to rows (N, 3 T, P) of a reading of targets (T, 3) [m].

    The columns are those of the joints' compliances, then those of the geometry and of the masses, in units
    of what is known of each beforehand (method.md §10, §14). Errors of masses show by compliances (n,)
    [rad/(N·m)].
    """
    axes, flange = chain_axes(robot.chain)
    names = tuple(map(str, range(len(targets))))

    def rows(joints: FloatArray) -> FloatArray:
        angles = robot.joint_map.model_angles(joints)
        count, shape = len(joints), (len(joints), *targets.shape)
        places = Configurations(robot, angles).to_base(np.broadcast_to(targets, shape))
        poses = Poses(joints, places, np.ones(shape[:2], dtype=np.bool_), names, robot.joint_map)
        nothing, carried = np.zeros((count, 3)), np.ones((count, len(burden.bodies)))
        readings = WeightReadings(poses, burden, carried, nothing, nothing, nothing)
        state = PoseState(axes, flange.apply(targets), np.zeros(count))
        found = rows_at(robot, readings, poses.whitened, state, np.zeros(angles.shape), compliance)
        masses = np.einsum("mjk,j->mk", found.products, compliance)
        stacked = np.hstack([found.joints, _GEOMETRY * found.geometry, masses])
        return stacked.reshape(count, 3 * len(targets), -1)

    return rows
