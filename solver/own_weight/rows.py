"""Rows of readings by own weight: bodies that joints carry, springs that balance them, and the readings.

A body of mass m whose centre of mass is at s + d, d unknown within a ball of radius R, twists joint j by
``τ_j = m T_j(s) + (m d) · ∇T_j``, T_j the torque of a kilogram. With m = m₀ + ζ and ν = m d that is linear in
(ζ, ν); a balancer of rate k and free length s₀ is linear in (k, k s₀). So each posture has torques of the
nominal parameters, and of each unknown at its bound: Y.

With θ the sag, ``p = f(q + θ; φ)`` and ``θ_j = c_j (τ_j + Σ_k Y_jk (π_k − π_k⁰))``, both torques taken in the
posture that sags, so that at convergence the balance is exact. About (φ, θ):

    p − f(q + θ; φ) + J_θ θ = J_φ δφ + Σ_j J_θj (τ_j c_j + Σ_k Y_jk η_jk),   η_jk = c_j (π_k − π_k⁰)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import pinocchio as pin

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.estimation.cones import Block
from jointstiff.solver.estimation.conic import MassCones
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.geometry.poses import (
    Motion,
    PoseReadings,
    Poses,
    PoseState,
    build_arm,
    list_chain_axes,
    transform_points,
)
from jointstiff.solver.mechanics.block import STANDARD_GRAVITY
from jointstiff.solver.mechanics.measurements import check_array
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Body, Robot

_GEOMETRY: Final = 0.01
"""Standard uncertainty of axes and targets before any reading [m and rad]: a nominal arm is as good."""
_CONSTANT: Final = 5e-3
"""Variation of a joint's torque over the postures, relative to the torque by a weight across its axis, below
which it counts as constant: gravity's direction and that of a vertical axis are not known so well."""
_BASE: Final = 1e-6
"""Standard uncertainty of the base's compliances before any reading [rad/(N·m)]: as soft as a joint."""


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
    """Bodies that the joints carry, each in all or some observations, and balancing springs."""

    bodies: tuple[Body, ...]  #: links, tool, payloads
    balancers: tuple[Balancer, ...] = ()  #: springs between base and links
    gravity: FloatArray = field(default_factory=lambda: STANDARD_GRAVITY)  #: (3,) in R0 [m/s²]

    @cached_property
    def unknown(self) -> tuple[list[tuple[int, FloatArray]], list[tuple[int, int, float]]]:
        """List of the unknown masses and moments, in the order of `Torques`, and list of uncertain centres.

        An unknown is a body's index and the inertia (4,) [kg, kg·m] of its greatest deviation. A centre is
        the index of the first of its three moments among the unknowns, the index of the body's mass (−1 if
        the mass is exact), and the relative growth of the moments' bound with the mass.
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

    def build_block(self, acts: BoolArray) -> tuple[Block, list[int]]:
        """Build the cone of the unknowns that act on one joint.

        Args:
            acts: (K,) mask of the unknowns that change the torque of the joint.

        Returns:
            The cone, and the indices of its unknowns among all K: masses and springs, then moments.
        """
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
        check_array("carried", self.carried, (count, len(self.burden.bodies)))
        for name in ("force", "moment", "load_point"):
            check_array(name, getattr(self, name), (count, 3))
        joints = [body.joint for body in self.burden.bodies]
        joints += [balancer.joint for balancer in self.burden.balancers]
        if not joints or not 0 <= min(joints) <= max(joints) < self.poses.joint_map.n:
            raise MeasurementError(
                f"the robot has no bodies, or a body is on none of its {self.poses.joint_map.n} joints",
                where="masses",
                remedy="state mass and centre of mass of each link, by the joint that carries it",
            )


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques in B postures: of nominal weights and loads, and of each of K unknowns at its bound."""

    known: FloatArray  #: (B, n) of loads and of the nominal parameters, the middles of their bounds [N·m]
    unit: FloatArray  #: (B, n, K) of each deviation from them at its bound
    by_gravity: FloatArray  #: (B, n, 3) derivative of those known by the vector of gravity [kg·m]
    on_base: FloatArray  #: (B, 3) moment of nominal weights and loads about R0's origin [N·m]


@dataclass(frozen=True, eq=False)
class WeightRows:
    """The linearised readings of N observations.

    The terms of the stack are those of the equation above: `geometry` J_φ; `base`, its tilt about R0's origin
    by C_xx, C_yy, C_xy [rad/(N·m)]; `gravity`, its direction about two axes across it [rad]; `joints`,
    J_θj τ_j by c_j; `products`, J_θj Y_jk by η_jk, joint by joint.
    """

    stack: Stack  #: in units of sigma²
    torques: Torques  #: torques of the N observations
    across: FloatArray  #: (n,) greatest torque of the same weights and loads across each axis [N·m]

    @property
    def varies(self) -> BoolArray:
        """(n,) mask of the joints whose torque varies over the postures."""
        return np.asarray(np.ptp(self.torques.known, axis=0) > _CONSTANT * self.across)


def linearise_readings(
    robot: Robot,
    readings: WeightReadings,
    whitened: PoseReadings,
    state: PoseState,
    sag: FloatArray,
    compliance: FloatArray,
) -> WeightRows:
    """Linearise readings of positions about a geometry and a sag.

    Args:
        robot: nominal robot.
        readings: N observations, with the assumed vector of gravity.
        whitened: the same positions with their weights.
        state: geometry to linearise about.
        sag: (N, n) θ [rad].
        compliance: (n,) compliances [rad/(N·m)], for the effect of the direction of gravity on the sag.
    """
    motion = state.motion(replace(whitened, angles=whitened.angles + sag))
    torques = compute_torques(robot, readings, motion)
    swings = motion.differentiate_by_angles()
    gap = whitened.points - motion.points + np.einsum("ktin,kn->kti", swings, sag)
    weighted = (whitened.weight @ swings).reshape(*swings.shape[:1], -1, swings.shape[-1])
    geometry = whitened.weight @ motion.jacobian()
    gravity, count = readings.burden.gravity, len(gap)
    size = np.linalg.norm(gravity)
    tilted = np.einsum(
        "kij,kjg,j->kig", weighted, torques.by_gravity @ (perpendicular_basis(gravity) * size), compliance
    )
    terms = {
        "geometry": geometry.reshape(count, weighted.shape[1], -1),
        "base": (whitened.weight @ differentiate_by_base_compliance(torques, motion.points)).reshape(
            count, -1, 3
        ),
        "gravity": tilted,
        "joints": weighted * torques.known[:, None],
        "products": (weighted[..., None] * torques.unit[:, None]).reshape(*weighted.shape[:2], -1),
    }
    left = (whitened.weight @ gap[..., None]).reshape(count, -1, 1)
    read = terms["geometry"].any(axis=2).sum(axis=1)
    rows = np.concatenate([*terms.values(), left], axis=-1)
    return WeightRows(
        stack=Stack(rows, read, {name: columns.shape[-1] for name, columns in terms.items()}),
        torques=torques,
        across=np.maximum(
            np.abs(torques.known).max(axis=0),
            size * np.linalg.norm(torques.by_gravity, axis=2).max(axis=0),
        ),
    )


def differentiate_by_base_compliance(torques: Torques, places: FloatArray) -> FloatArray:
    """Return the derivatives (B, T, 3, 3) of places (B, T, 3) with respect to the base's C_xx, C_yy, C_xy.

    The last axis of the result is the compliance. The base turns about R0's origin by ``φ = C M``; M is the
    moment of weights and loads about the axes x and y.
    """
    (x, y), zero = torques.on_base[:, :2].T, np.zeros(len(places))
    turns = np.array([[x, zero, zero], [zero, y, zero], [y, x, zero]])  # (unknowns, 3, B)
    return np.stack([np.cross(turn.T[:, None], places) for turn in turns], axis=-1)


def perpendicular_basis(vector: FloatArray) -> FloatArray:
    """Return two orthonormal vectors, columns of a (3, 2) matrix, that are perpendicular to a vector (3,)."""
    return np.asarray(np.linalg.svd(vector[None])[2][1:].T)


def compute_torques(robot: Robot, readings: WeightReadings, motion: Motion) -> Torques:
    """Compute the joint torques of loads, bodies and balancers in the B postures of a motion.

    Joint frames and the flange frame are those of the nominal robot, shifted onto the fitted axes.
    """
    burden, axes = readings.burden, motion.axes
    still = Postures(robot, np.zeros((1, robot.n)))
    frames, nominal = (part[0] for part in still.joint_frames)
    origins = [axis.nearest_point_to(origin) for axis, origin in zip(axes, nominal, strict=True)]
    places = [pin.SE3(R, origin) for R, origin in zip(frames, origins, strict=True)]
    to_flange = still.flange_translation[0] - nominal[-1]
    arm = build_arm(axes, places, pin.SE3(still.flange_rotation[0], origins[-1] + to_flange))
    at = Postures(arm, motion.angles)
    rotation, origin = at.joint_frames
    levers = at.weight_levers  # (B, n, n, 4, 3)

    by_gravity, hangs = np.zeros(origin.shape), readings.carried.T[:, :, None, None]
    on_base = readings.moment.copy()
    for number, body in enumerate(burden.bodies):
        centre = origin[:, body.joint] + rotation[:, body.joint] @ np.array(body.centre)
        pull = 0.5 * (body.most + body.least) * readings.carried[:, number, None] * burden.gravity
        on_base += np.cross(centre, pull)
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

    known += at.load(readings.load_point, readings.force, readings.moment)[1]
    loaded = at.to_base(readings.load_point[:, None])[:, 0]
    on_base += np.cross(loaded, readings.force)
    of_unknowns = np.stack(unit, axis=-1) if unit else np.zeros((*known.shape, 0))
    return Torques(known, of_unknowns, by_gravity, on_base)


def make_planned_rows_function(
    robot: Robot, burden: Burden, targets: FloatArray, compliance: FloatArray, *, free_base: bool = False
) -> Callable[[FloatArray], FloatArray]:
    """Return a function that maps postures (N, n) to rows (N, 3 T, P) of readings of unloaded targets.

    The columns are those of the joints' compliances, the geometry, a tilting base and the masses. All but the
    columns of the joints are in units of the unknown's prior uncertainty (method.md §10, §14).

    Args:
        robot: n joints.
        burden: bodies and springs.
        targets: (T, 3) places of the targets in the flange frame [m].
        compliance: (n,) nominal compliances, for the effect of errors of masses [rad/(N·m)].
        free_base: whether the rows have columns of a tilting base.
    """
    axes, flange = list_chain_axes(robot.chain)
    names = tuple(map(str, range(len(targets))))

    def compute_rows(joints: FloatArray) -> FloatArray:
        """Return the rows (N, 3 T, P) of unloaded readings in postures (N, n)."""
        angles = robot.joint_map.model_angles(joints)
        count, shape = len(joints), (len(joints), *targets.shape)
        places = Postures(robot, angles).to_base(np.broadcast_to(targets, shape))
        poses = Poses(joints, places, np.ones(shape[:2], dtype=np.bool_), names, robot.joint_map)
        nothing, carried = np.zeros((count, 3)), np.ones((count, len(burden.bodies)))
        readings = WeightReadings(poses, burden, carried, nothing, nothing, nothing)
        state = PoseState(axes, transform_points(flange, targets), np.zeros(count))
        found = linearise_readings(robot, readings, poses.whitened, state, np.zeros(angles.shape), compliance)
        stack = found.stack.in_units({"geometry": _GEOMETRY, "base": _BASE})
        part = {name: stack.rows[..., columns] for name, columns in stack.span.items()}
        products = part["products"].reshape(*stack.rows.shape[:2], *found.torques.unit.shape[1:])
        masses = np.einsum("kmjp,j->kmp", products, compliance)
        base = part["base"][..., : 3 * free_base]
        return np.concatenate([part["joints"], part["geometry"], base, masses], axis=-1)

    return compute_rows


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """The convex problem of one step: ``‖A x − b‖² + outside``, x in the cones."""

    A: FloatArray  #: (p, p) compressed, columns in the blocks' units
    b: FloatArray  #: (p,)
    outside: float  #: squares of the residuals that no x explains
    rank: int  #: number of compliances and weights that the readings determine
    cones: MassCones  #: blocks of the joints seen
    unit: FloatArray  #: (n_seen,) unit of the blocks' c [rad/(N·m)]
    seen: IndexArray  #: (n_seen,) joints whose torque varies
    unknowns: tuple[list[int], ...]  #: for each of them, which of all unknowns its block has
    freedom: int  #: number of coordinates of positions less the geometry that they determine

    @property
    def blocks(self) -> Iterator[tuple[int, float, slice, list[int]]]:
        """Joint, unit of its compliance [rad/(N·m)], slice in x, and indices of unknowns, for each block."""
        for j, unit, start, own in zip(
            self.seen.tolist(), self.unit.tolist(), self.cones.first.tolist(), self.unknowns, strict=True
        ):
            yield j, unit, slice(start, start + 1 + len(own)), own

    def expand_solution(self, rows: WeightRows, x: FloatArray) -> FloatArray:
        """Return the unknowns (K,) of all terms of the rows, in SI units, for a solution x of this problem.

        Unknowns that are not in the reduced problem are zero.
        """
        unknowns = np.zeros(sum(rows.stack.widths.values()))
        products = rows.stack.span["products"].reshape(rows.torques.unit.shape[1:])
        for j, unit, place, own in self.blocks:
            unknowns[rows.stack.span["joints"][j]] = unit * x[place.start] * rows.varies[j]
            unknowns[products[j, own]] = unit * x[place][1:]
        return unknowns

    def compute_sag(self, torques: Torques, x: FloatArray) -> FloatArray:
        """Return the sag (N, n) [rad] of the joints in N postures, for a solution x of the problem."""
        sag = np.zeros(torques.known.shape)
        for j, unit, place, own in self.blocks:
            from_unknowns = torques.unit[:, j][:, own] @ x[place][1:]
            sag[:, j] = unit * (torques.known[:, j] * x[place.start] + from_unknowns)
        return sag
