"""Linearised rows of readings by own weight: bodies, balancing springs, their torques, and the readings.

A body of mass m whose centre of mass is at s + d, d unknown within a ball of radius R, twists joint j by
``τ_j = m T_j(s) + (m d) · ∇T_j``, T_j the torque of a kilogram. With m = m₀ + ζ and ν = m d the torque is
linear in (ζ, ν); the torque of a balancer of rate k and free length s₀ is linear in (k, k s₀). Each posture
therefore has a torque τ_j of the nominal parameters, and for each unknown k the torque Y_jk of the unknown at
its bound.

With θ the sag and φ the geometry, positions are ``p = f(q + θ; φ)`` with
``θ_j = c_j (τ_j + Σ_k Y_jk (π_k − π_k⁰))``. Both torques are computed in the posture with sag, so that at
convergence the balance is exact. Linearised about (φ, θ):

    p − f(q + θ; φ) + J_θ θ = J_φ δφ + Σ_j J_θj (τ_j c_j + Σ_k Y_jk η_jk),   η_jk = c_j (π_k − π_k⁰)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.fit.cone import Block, WithMasses
from jointstiff.solver.fit.problem import Problem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.geometry.poses import (
    Motion,
    PoseReadings,
    Poses,
    PoseState,
    build_arm,
    list_chain_axes,
    transform_points,
)
from jointstiff.solver.mechanics.block import STANDARD_GRAVITY, Term
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements, check_array
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Body, Robot
from jointstiff.solver.mechanics.terms import AXES, FORCE_SCALE, TARGET_PLACES, list_stated_terms

_GEOMETRY: Final = 0.01
"""Prior standard uncertainty of axes and targets [m and rad]: that of a nominal arm."""
_CONSTANT: Final = 5e-3
"""Variation of a joint's torque over the postures, relative to the torque with gravity perpendicular to the
joint's axis, below which the torque counts as constant: smaller variations may come from errors in the
directions of gravity and of a vertical axis."""
_BASE: Final = 1e-6
"""Prior standard uncertainty of the base's compliances [rad/(N·m)]: the compliance of a soft joint."""


@dataclass(frozen=True)
class Balancer:
    """A balancing spring between the base and a link, stretched beyond its free length.

    Raises:
        RequestError: bounds are negative, infinite or not in ascending order, or an upper bound is zero.
    """

    joint: int  #: index of the joint that carries the link with the spring's second point
    on_base: tuple[float, float, float]  #: point on the base, in R0 [m]
    on_link: tuple[float, float, float]  #: point on the link, in the frame that moves with the joint [m]
    rate: tuple[float, float]  #: bounds of the spring rate k [N/m]
    pull: tuple[float, float]  #: bounds of k s₀ [N], with s₀ the free length

    def __post_init__(self) -> None:
        for low, high in (self.rate, self.pull):
            if not (np.isfinite([low, high]).all() and 0.0 <= low <= high and high > 0.0):
                raise RequestError(
                    "the bounds of a balancer's spring must be finite, not negative and in ascending order, "
                    "and the upper bound must be greater than zero",
                    where="balancer",
                    remedy="give the least and then the greatest value of the rate in N/m, and of the rate "
                    "times the free length in N",
                )


class UnknownInertia(NamedTuple):
    """Unknown mass, or unknown component of the first moment, of a body."""

    body: int  #: index of the body
    #: (4,) mass and first moment [kg, kg·m] of the greatest deviation from the nominal body
    greatest: FloatArray


class UncertainCentre(NamedTuple):
    """Uncertain centre of mass: three unknown first moments in a ball, whose radius grows with the mass."""

    first_moment: int  #: index among the unknowns of the first of its three moments
    mass: int  #: index among the unknowns of the mass of the body; −1 if the mass is exact
    relative_increase: float  #: of the moments' bound at the greatest mass


@dataclass(frozen=True, eq=False)
class Burden:
    """Bodies that the joints carry, balancing springs, and gravity."""

    bodies: tuple[Body, ...]  #: links, tool, payloads
    balancers: tuple[Balancer, ...] = ()  #: springs between base and links
    gravity: FloatArray = field(default_factory=lambda: STANDARD_GRAVITY)  #: (3,) acceleration in R0 [m/s²]

    @cached_property
    def unknown(self) -> tuple[list[UnknownInertia], list[UncertainCentre]]:
        """Unknown masses and first moments, in the order of `Torques.of_unknowns`; and uncertain centres."""
        unknowns = list[UnknownInertia]()
        uncertain_centres = list[UncertainCentre]()
        for body_index, body in enumerate(self.bodies):
            mean, half_range = 0.5 * (body.most + body.least), 0.5 * (body.most - body.least)
            mass_index = -1
            if half_range > 0.0:
                mass_index = len(unknowns)
                unknowns.append(UnknownInertia(body_index, half_range * np.array([1.0, *body.centre])))
            if body.radius > 0.0:
                uncertain_centres.append(UncertainCentre(len(unknowns), mass_index, half_range / mean))
                for axis in np.eye(4)[1:]:  # the mass keeps its value
                    unknowns.append(UnknownInertia(body_index, body.radius * mean * axis))
        return unknowns, uncertain_centres

    def build_block(self, is_acting: BoolArray) -> tuple[Block, list[int]]:
        """Build the layout of the unknowns of one joint: masses and springs in boxes, moments in balls.

        Args:
            is_acting: (K,) mask of the unknowns that change the torque of the joint.

        Returns:
            The block; and the indices of the block's unknowns among all K: masses and springs, then moments.
        """
        _, uncertain_centres = self.unknown
        all_moments = set[int]()
        in_balls = list[int]()  # the three moments of each centre that acts
        acting_centres = list[UncertainCentre]()
        for centre in uncertain_centres:
            moments = range(centre.first_moment, centre.first_moment + 3)
            all_moments.update(moments)
            if is_acting[moments].any():
                acting_centres.append(centre)
                in_balls.extend(moments)
        in_boxes = [unknown for unknown in np.flatnonzero(is_acting).tolist() if unknown not in all_moments]
        balls = list[tuple[int, float]]()  # place of the mass in the block, and increase of the radius by it
        for centre in acting_centres:
            if centre.mass in in_boxes:
                balls.append((in_boxes.index(centre.mass), centre.relative_increase))
            else:
                balls.append((-1, 0.0))
        return Block(len(in_boxes), tuple(balls)), in_boxes + in_balls


@dataclass(frozen=True, eq=False)
class StatedLoads:
    """Statements on the loads under which the last of the positions were read."""

    rows: Rows  #: the observations under load, in the order of these positions
    terms: tuple[Term, ...]  #: errors of the loads, each zero within its standard uncertainty
    unloaded: int  #: number of observations of positions without load, which come first

    def move_positions(self, compliance: FloatArray) -> FloatArray:
        """Return the motion (N, T, 3, K) of all positions by one standard uncertainty of each error [m].

        Positions without load do not move.

        Args:
            compliance: (n,) compliances of the joints at which the motion is computed [rad/(N·m)].
        """
        common = self.rows.measurements.common_uncertainty
        statements = Statements(self.terms, common, compliance, sigma=1.0)
        moved = [each.targets[..., :-1] for each in statements.generate(self.rows, whitened=False)]
        under_load = np.concatenate(moved)
        unmoved = np.zeros((self.unloaded, *under_load.shape[1:]))
        return np.concatenate([unmoved, under_load])


def list_errors_of_loads(measurements: Measurements) -> tuple[Term, ...]:
    """Return the errors of loads with a stated uncertainty that positions under load can show.

    Next to the weight of the robot the size of a force shows, too. Places and axes are fitted in any case.
    """
    common = measurements.common_uncertainty
    fitted = {TARGET_PLACES.name, AXES.name}
    errors = [term for term in list_stated_terms(measurements) if term.name not in fitted]
    has_uncertain_scale = any(FORCE_SCALE.prior(common))
    return (*errors, FORCE_SCALE) if has_uncertain_scale else tuple(errors)


def list_errors_of_deflections(measurements: Measurements) -> tuple[Term, ...]:
    """Return the errors with a stated uncertainty that deflections under known loads can show.

    Next to the weight of the robot the size of a force shows, too.
    """
    errors = list_stated_terms(measurements)
    has_uncertain_scale = any(FORCE_SCALE.prior(measurements.common_uncertainty))
    return (*errors, FORCE_SCALE) if has_uncertain_scale else errors


@dataclass(frozen=True, eq=False)
class WeightReadings:
    """Rows of own weight: N observations of absolute positions of a robot with bodies, in read-only arrays.

    Deflections under known loads, which have no absolute position, may be fitted together with the positions.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, a body is on no joint of the robot, or the
            loads of positions and of deflections have different stated uncertainties.
    """

    robot: Robot  #: nominal robot, n joints; its axes and the places of the targets are fitted, too
    poses: Poses  #: joint angles, and positions of the targets in R0
    burden: Burden  #: bodies (links, tool, payloads), balancing springs, and gravity
    carried: FloatArray  #: (N, bodies) 1 where the robot carries a body, else 0
    force: FloatArray  #: (N, 3) known force on the robot [N]; zero without load
    moment: FloatArray  #: (N, 3) known moment about the load point [N·m]
    load_point: FloatArray  #: (N, 3) point where the force acts, in the flange frame [m]
    loaded: Measurements | None = None  #: deflections under known loads; None if none were read
    stated: StatedLoads | None = None  #: what is stated of the loads of positions; None for exact loads

    def __post_init__(self) -> None:
        count = len(self.poses.angles)
        check_array("carried", self.carried, (count, len(self.burden.bodies)))
        for name in ("force", "moment", "load_point"):
            check_array(name, getattr(self, name), (count, 3))
        joints = [body.joint for body in self.burden.bodies]
        joints += [balancer.joint for balancer in self.burden.balancers]
        if not joints or not 0 <= min(joints) <= max(joints) < self.poses.joint_map.n:
            raise MeasurementError(
                f"the robot has no bodies, or a body belongs to none of the {self.poses.joint_map.n} joints",
                where="masses",
                remedy="state for each link its mass, its centre of mass and the joint that carries it",
            )
        if len(set(self._list_common_uncertainties())) > 1:
            raise MeasurementError(
                "the loads of positions and the loads of deflections have different stated uncertainties",
                where="noise",
                remedy="state the same uncertainties for all loads of a campaign",
            )

    @property
    def unit(self) -> float:
        """Unit of the fit [m], of a whitened coordinate: the stated sigma, or 1 m if none is stated."""
        return self.poses.sigma or 1.0

    @property
    def whitened(self) -> PoseReadings:
        """Positions at the model's joint angles, with whiteners for the unit of the fit."""
        whitened = self.poses.whitened
        return replace(whitened, weight=whitened.weight / self.unit)

    @property
    def load_coordinates(self) -> int:
        """Number of coordinates and encoder readings of deflections under known loads."""
        if self.loaded is None:
            return 0
        encoders = self.loaded.encoders
        encoder_readings = 0 if encoders is None else int(encoders.present.sum())
        return int(self.loaded.coordinates.sum()) + encoder_readings

    @property
    def common_uncertainty(self) -> CommonUncertainty:
        """Standard uncertainties of the errors that all known loads share."""
        return next(iter(self._list_common_uncertainties()), CommonUncertainty())

    def list_stated_errors(self) -> tuple[Term, ...]:
        """Return the errors with a stated uncertainty that positions or deflections under load show."""
        errors = list[Term]()
        if self.stated is not None:
            errors.extend(self.stated.terms)
        if self.loaded is not None:
            errors.extend(list_errors_of_deflections(self.loaded))
        by_name = {term.name: term for term in errors}
        return tuple(by_name.values())

    def _list_common_uncertainties(self) -> list[CommonUncertainty]:
        """Return the uncertainties of the loads of positions and of deflections, as far as there are any."""
        uncertainties = list[CommonUncertainty]()
        if self.stated is not None:
            uncertainties.append(self.stated.rows.measurements.common_uncertainty)
        if self.loaded is not None:
            uncertainties.append(self.loaded.common_uncertainty)
        return uncertainties


@dataclass(frozen=True, eq=False)
class Torques:
    """Joint torques in B postures, for nominal masses and for each of K unknowns."""

    known: FloatArray  #: (B, n) torque of loads, nominal masses and springs (middles of their bounds) [N·m]
    of_unknowns: FloatArray  #: (B, n, K) torque of each unknown's deviation from nominal, at its bound [N·m]
    #: (B, n, 3) derivative of the torque of nominal masses with respect to the vector of gravity [kg·m]
    gravity_derivative: FloatArray
    base_moment: FloatArray  #: (B, 3) moment of nominal weights and loads about R0's origin [N·m]


@dataclass(frozen=True, eq=False)
class WeightRows:
    """Linearised readings of N observations.

    The columns of the stack are derivatives of the positions with respect to the unknowns of five terms:
    `geometry` φ; `base`, the compliances C_xx, C_yy, C_xy of a base that tilts about R0's origin [rad/(N·m)];
    `gravity`, two angles [rad] of its direction; `joints`, the compliances c_j; and `products`, the η_jk of
    compliances and deviations of the masses, joint by joint. Columns of `statements` on the loads, if there
    are any, come last.
    """

    stack: Stack  #: rows of the observations, weighted with 1/sigma
    torques: Torques  #: torques in the N observations
    #: (n,) greatest torque of loads and weights, also with gravity perpendicular to the joint's axis [N·m]
    crosswise_torque: FloatArray

    @property
    def varies(self) -> BoolArray:
        """(n,) mask of the joints whose torque varies over the postures."""
        return np.asarray(np.ptp(self.torques.known, axis=0) > _CONSTANT * self.crosswise_torque)


def linearise_readings(
    readings: WeightReadings,
    state: PoseState,
    sag: FloatArray,
    compliance: FloatArray,
    motion_per_uncertainty: FloatArray | None = None,
) -> WeightRows:
    """Linearise readings of positions about a geometry and a sag: rows of a least-squares problem.

    Args:
        readings: N observations, with the assumed vector of gravity.
        state: geometry to linearise about.
        sag: (N, n) sag θ of the joints to linearise about [rad].
        compliance: (n,) compliances [rad/(N·m)], for the effect of the direction of gravity on the sag.
        motion_per_uncertainty: (N, T, 3, K) motion of the targets by one standard uncertainty of each error
            of the loads [m]; None for exact loads.
    """
    whitened = readings.whitened
    motion = state.motion(replace(whitened, angles=whitened.angles + sag))
    torques = compute_torques(readings, motion)
    angle_derivative = motion.differentiate_by_angles()  # (N, T, 3, n), J_θ of the module's equation
    differences = whitened.points - motion.points + np.einsum("ktin,kn->kti", angle_derivative, sag)
    N, coordinate_count = len(differences), differences[0].size

    def whiten(derivatives: FloatArray) -> FloatArray:
        """Return whitened columns (N, 3 T, k) for derivatives (N, T, 3, k) of the positions."""
        return np.asarray(whitened.weight @ derivatives).reshape(N, coordinate_count, -1)

    by_angles = whiten(angle_derivative)  # (N, 3 T, n)
    gravity = readings.burden.gravity
    gravity_size = np.linalg.norm(gravity)
    # Change of the torques when gravity turns by a radian about each of two perpendicular axes.
    torques_by_turn = torques.gravity_derivative @ (compute_perpendicular_basis(gravity) * gravity_size)
    by_unknown_torques = by_angles[..., None] * torques.of_unknowns[:, None]  # (N, 3 T, n, K)
    terms = {
        "geometry": whiten(motion.jacobian()),
        "base": whiten(differentiate_by_base_compliance(torques, motion.points)),
        "gravity": np.einsum("kij,kjg,j->kig", by_angles, torques_by_turn, compliance),
        "joints": by_angles * torques.known[:, None],
        "products": by_unknown_torques.reshape(N, coordinate_count, -1),
    }
    if motion_per_uncertainty is not None:
        terms["statements"] = whiten(motion_per_uncertainty)
    # A coordinate that was not read has weight zero, so that its columns of the geometry are zero.
    coordinates_read = terms["geometry"].any(axis=2).sum(axis=1)
    rows = np.concatenate([*terms.values(), whiten(differences[..., None])], axis=-1)
    widths = {name: columns.shape[-1] for name, columns in terms.items()}
    greatest_known_torque = np.abs(torques.known).max(axis=0)
    greatest_weight_torque = gravity_size * np.linalg.norm(torques.gravity_derivative, axis=2).max(axis=0)
    return WeightRows(
        stack=Stack(rows, coordinates_read, widths),
        torques=torques,
        crosswise_torque=np.maximum(greatest_known_torque, greatest_weight_torque),
    )


def differentiate_by_base_compliance(torques: Torques, places: FloatArray) -> FloatArray:
    """Return the derivatives (B, T, 3, 3) of places (B, T, 3) with respect to the base's C_xx, C_yy, C_xy.

    The last axis of the result is the compliance. The base turns about R0's origin by ``φ = C M``; M is the
    moment of weights and loads about the axes x and y.
    """
    M_x, M_y = torques.base_moment[:, :2].T
    zero = np.zeros(len(places))
    # Turns φ by a unit of C_xx, C_yy and C_xy, which is also C_yx.
    turns = np.array([[M_x, zero, zero], [zero, M_y, zero], [M_y, M_x, zero]])  # (unknowns, 3, B)
    return np.stack([np.cross(turn.T[:, None], places) for turn in turns], axis=-1)


def compute_perpendicular_basis(vector: FloatArray) -> FloatArray:
    """Return two orthonormal vectors, columns of a (3, 2) matrix, that are perpendicular to a vector (3,)."""
    return np.asarray(np.linalg.svd(vector[None])[2][1:].T)


def compute_torques(readings: WeightReadings, motion: Motion) -> Torques:
    """Compute the joint torques of loads, bodies and balancers in the B postures of a motion.

    The torques are of the fitted arm: the joint frames and the flange frame of the nominal robot are shifted
    onto the fitted axes.
    """
    robot, burden, axes = readings.robot, readings.burden, motion.axes
    home = Postures(robot, np.zeros((1, robot.n)))  # nominal robot with all angles zero
    rotations_of_postures, origins_of_postures = home.joint_frames
    rotations, nominal_origins = rotations_of_postures[0], origins_of_postures[0]  # of the only posture
    origins = [axis.nearest_point_to(origin) for axis, origin in zip(axes, nominal_origins, strict=True)]
    frames = [
        pin.SE3(axis_rotation, origin) for axis_rotation, origin in zip(rotations, origins, strict=True)
    ]
    to_flange = home.flange_translation[0] - nominal_origins[-1]
    arm = build_arm(axes, frames, pin.SE3(home.flange_rotation[0], origins[-1] + to_flange))
    postures = Postures(arm, motion.angles)
    rotation, origin = postures.joint_frames
    levers = postures.weight_levers  # (B, n, n, 4, 3)

    gravity_derivative = np.zeros(origin.shape)
    is_carried = readings.carried.T[:, :, None, None]
    base_moment = readings.moment.copy()
    for number, body in enumerate(burden.bodies):
        centre = origin[:, body.joint] + rotation[:, body.joint] @ np.array(body.centre)
        nominal_mass = 0.5 * (body.most + body.least)
        weight = nominal_mass * readings.carried[:, number, None] * burden.gravity
        base_moment += np.cross(centre, weight)
        of_one_kilogram = np.einsum("bjpi,p->bji", levers[:, :, body.joint], [1.0, *body.centre])
        gravity_derivative += nominal_mass * is_carried[number] * of_one_kilogram
    inertia_torques = levers @ burden.gravity
    unknown_inertias, _ = burden.unknown
    of_unknowns = []
    for number, inertia in unknown_inertias:
        torque_if_carried = inertia_torques[:, :, burden.bodies[number].joint] @ inertia
        of_unknowns.append(is_carried[number, ..., 0] * torque_if_carried)
    known_torques = gravity_derivative @ burden.gravity
    for balancer in burden.balancers:
        joint, on_link = balancer.joint, np.array(balancer.on_link)
        spring_line = origin[:, joint] + rotation[:, joint] @ on_link - np.array(balancer.on_base)
        length = np.linalg.norm(spring_line, axis=1, keepdims=True)
        lever = np.einsum("bjpi,p->bji", levers[:, :, joint], [1.0, *on_link])
        # The spring's force on the link, −k line + k s₀ line/length, is linear in k and k s₀.
        for force, (least, most) in ((-spring_line, balancer.rate), (spring_line / length, balancer.pull)):
            torque = np.einsum("bji,bi->bj", lever, force)
            known_torques += 0.5 * (least + most) * torque
            if most > least:
                of_unknowns.append(0.5 * (most - least) * torque)

    known_torques += postures.load(readings.load_point, readings.force, readings.moment)[1]
    load_position = postures.to_base(readings.load_point[:, None])[:, 0]
    base_moment += np.cross(load_position, readings.force)
    stacked = np.stack(of_unknowns, axis=-1) if of_unknowns else np.zeros((*known_torques.shape, 0))
    return Torques(known_torques, stacked, gravity_derivative, base_moment)


def make_planned_rows_function(
    robot: Robot, burden: Burden, targets: FloatArray, compliance: FloatArray, *, free_base: bool = False
) -> Callable[[FloatArray], FloatArray]:
    """Return a function that maps postures (N, n) to rows (N, 3 T, P) of readings of unloaded targets.

    The columns are those of the joints' compliances, the geometry, a tilting base and the masses. All but the
    columns of the joints are in units of the unknown's prior uncertainty (method.md §10, §14).

    Args:
        robot: n joints.
        burden: bodies and springs.
        targets: (T, 3) positions of the targets in the flange frame [m].
        compliance: (n,) nominal compliances, which convert errors of masses to sag [rad/(N·m)].
        free_base: whether the rows have columns of a tilting base.
    """
    axes, flange = list_chain_axes(robot.chain)
    names = tuple(map(str, range(len(targets))))

    def compute_rows(joints: FloatArray) -> FloatArray:
        """Return the rows (N, 3 T, P) of unloaded readings in postures (N, n)."""
        angles = robot.joint_map.model_angles(joints)
        posture_count, table_shape = len(joints), (len(joints), *targets.shape)
        positions = Postures(robot, angles).to_base(np.broadcast_to(targets, table_shape))
        poses = Poses(joints, positions, np.ones(table_shape[:2], dtype=np.bool_), names, robot.joint_map)
        no_load, carried = np.zeros((posture_count, 3)), np.ones((posture_count, len(burden.bodies)))
        readings = WeightReadings(robot, poses, burden, carried, no_load, no_load, no_load)
        state = PoseState(axes, transform_points(flange, targets), np.zeros(posture_count))
        rows = linearise_readings(readings, state, np.zeros(angles.shape), compliance)
        stack = rows.stack.in_units({"geometry": _GEOMETRY, "base": _BASE})
        columns_of = {name: stack.rows[..., columns] for name, columns in stack.span.items()}
        products = columns_of["products"].reshape(*stack.rows.shape[:2], *rows.torques.of_unknowns.shape[1:])
        # With known compliances, all joints share the deviation of each mass: add their columns.
        mass_columns = np.einsum("kmjp,j->kmp", products, compliance)
        base_columns = columns_of["base"][..., : 3 * free_base]  # no columns for a rigid base
        return np.concatenate(
            [columns_of["joints"], columns_of["geometry"], base_columns, mass_columns], axis=-1
        )

    return compute_rows


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """Convex problem of one step: minimise ``‖A x − b‖² + residual_squares`` over x in the cones.

    The vector x has a block for each observed joint: the compliance, then its products with deviations of
    masses.
    """

    #: (p, p) compressed rows A and readings b, over the cone; the columns of a joint are in the unit of the
    #: joint's compliance
    convex: Problem[WithMasses]
    residual_squares: float  #: sum of the squared residuals that no x explains
    rank: int  #: number of compliances and weights that the readings determine
    unit: FloatArray  #: (m,) unit of the compliance of each of the m observed joints [rad/(N·m)]
    observed_joints: IndexArray  #: (m,) joints whose weight torque varies, or that a known load twists
    unknowns: tuple[list[int], ...]  #: indices of the unknown masses in the block of each observed joint
    #: number of coordinates of positions minus the number of geometry unknowns that they determine
    remaining_coordinates: int

    @property
    def blocks(self) -> Iterator[tuple[int, float, slice, list[int]]]:
        """The blocks of the parameters x of the problem, one for each joint.

        A block is (joint, unit of its compliance [rad/(N·m)], slice in x, indices of its unknowns).
        """
        for j, unit, start, unknown_indices in zip(
            self.observed_joints.tolist(),
            self.unit.tolist(),
            self.convex.cone.first.tolist(),
            self.unknowns,
            strict=True,
        ):
            yield j, unit, slice(start, start + 1 + len(unknown_indices)), unknown_indices

    def expand_solution(self, rows: WeightRows, solution: FloatArray) -> FloatArray:
        """Return the unknowns (P,) of all columns but statements, in SI units, for a solution x.

        Each block of x has the compliance of a joint first, then the products of this compliance with the
        deviations of masses and moments. Unknowns outside this problem, such as the geometry, are zero.
        """
        widths = rows.stack.widths
        unknowns = np.zeros(sum(widths.values()) - widths.get("statements", 0))
        # (n, K) position among all unknowns of the product of each joint's compliance with each deviation
        product_positions = rows.stack.span["products"].reshape(rows.torques.of_unknowns.shape[1:])
        for j, unit, span, unknown_indices in self.blocks:
            compliance, *products = unit * solution[span]
            # Sag under a constant torque is part of the geometry, so it must not be counted here again.
            unknowns[rows.stack.span["joints"][j]] = compliance * rows.varies[j]
            unknowns[product_positions[j, unknown_indices]] = products
        return unknowns

    def compute_sag(self, torques: Torques, solution: FloatArray) -> FloatArray:
        """Return the sag (N, n) [rad] of the n joints in N postures, for a solution of this problem.

        Args:
            torques: torques in the N postures.
            solution: parameters of the problem: compliances, and their products with unknown masses.
        """
        sag = np.zeros(torques.known.shape)
        for j, unit, span, unknown_indices in self.blocks:
            compliance, products = solution[span.start], solution[span][1:]
            from_unknowns = torques.of_unknowns[:, j][:, unknown_indices] @ products
            sag[:, j] = unit * (torques.known[:, j] * compliance + from_unknowns)
        return sag
