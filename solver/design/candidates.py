"""Candidate readings of a plan: what each adds to the information on the parameters (method.md §10).

postures → feasible readings → rows → parameters → information, known and of each candidate

Feasible readings: equipment, limits, torques, boxes, self-collision, line of sight, reflectors and cable.

Links are capsules along the segments from one joint frame's origin to the next, to the flange, and to
the load point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final, Literal, Protocol

import numpy as np

from jointstiff.schemas.plan import (
    DeflectionGoal,
    JointsGoal,
    LoadPointGoal,
    PlanCriterion,
    Surroundings,
)
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.optimum import Candidates
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.mechanics.block import fitted_errors
from jointstiff.solver.mechanics.measurements import (
    NO_SCATTER,
    DifferenceNoise,
    Instrument,
    Measurements,
    Scatter,
)
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS, build_links_term
from jointstiff.solver.mechanics.terms import LOAD_POINT, TERMS
from jointstiff.solver.text import length_text

LoadKind = Literal["dead_weight", "any_direction", "cable"]

_SAMPLES: Final = np.linspace(0.0, 1.0, 5)
"""Fractions of a link's length at which points of the link are compared with boxes and planes."""
_FIRST_MOVING: Final = 2
"""Number of origins that do not move, those of the base and the first joint; they are usually on the
floor."""
_NEAR_FLANGE: Final = 3
"""Number of last segments that are taken to hide no reflector, as they carry the reflectors."""
_RELATIVE_RADIUS: Final = 0.04
"""Radius of the links, relative to the length of the stretched arm, if the request states no radius."""
_SHORTEST_CABLE: Final = 0.1
"""Length of a cable [m] below which it cannot be fastened."""
_LARGEST_POSITION: Final = (np.pi, 1.0)
"""Greatest position of a joint without limits [rad; m for a prismatic joint]."""


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces that can be applied."""

    kind: LoadKind  #: a weight along −z of R0, a cable towards one of the anchors, or forces of any direction
    force: float  #: magnitude [N]; for loads of any direction, the greatest magnitude
    torque_limit: FloatArray  #: (n,) greatest torque of the load about each joint [N·m]; inf for no limit
    anchors: FloatArray = field(
        default_factory=lambda: np.empty((0, 3))
    )  #: (A, 3) where the cable can be fastened, in R0 [m]


@dataclass(frozen=True, eq=False)
class Equipment:
    """Instrument, targets and loads."""

    targets: FloatArray  #: (T, 3) flange frame [m]
    load_point: FloatArray  #: (3,) where the force acts, flange frame [m]
    loads: Loads  #: loads that can be applied
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]
    instrument: Instrument | None = None  #: the tracker at its station; isotropic noise of sigma if None
    scatter: Scatter = NO_SCATTER  #: errors that the targets of a posture share, in units of sigma

    def build_measurements(
        self, robot: Robot, joints: FloatArray, force: FloatArray, directions: FloatArray | None = None
    ) -> Measurements:
        """Build the measurements of N planned readings, with zero deflections and the expected covariance.

        Args:
            robot: n joints.
            joints: (N, n) positions as the controller shows them [rad or m].
            force: (N, 3) forces on the robot, axes of R0 [N].
            directions: (N, 3) unit vectors in R0 along which targets are read; None if all three coordinates
                are read.
        """
        reading_count, table_shape = len(joints), (len(joints), *self.targets.shape)
        measurements = Measurements(
            joints=joints,
            force=force,
            moment=np.zeros((reading_count, 3)),
            load_point=np.broadcast_to(self.load_point, (reading_count, 3)),
            position=np.broadcast_to(self.targets, table_shape),
            in_flange=np.ones(table_shape[:2], dtype=np.bool_),
            deflection=np.zeros(table_shape),
            present=np.ones(table_shape[:2], dtype=np.bool_),
            sigma=self.sigma,
            scatter=self.scatter,
            direction=None
            if directions is None
            else np.broadcast_to(directions[:, None], table_shape).copy(),
        )
        if self.instrument is None:
            return measurements
        noise = DifferenceNoise.from_instrument(self.instrument, robot, measurements)
        # The instrument's covariance is in units of `noise.sigma`²: convert it to units of `self.sigma`².
        return replace(measurements, covariance=noise.covariance * (noise.sigma / self.sigma) ** 2)

    def force_directions(self, robot: Robot, joints: FloatArray, anchor: IndexArray) -> FloatArray | None:
        """Return the directions (N, 3) of the forces in R0; None if a force may have any direction.

        Args:
            robot: n joints.
            joints: (N, n) positions as the controller shows them [rad or m].
            anchor: (N,) index of the anchor to which a cable pulls.
        """
        if self.loads.kind == "any_direction":
            return None
        if self.loads.kind == "dead_weight":
            return np.broadcast_to([0.0, 0.0, -1.0], (len(joints), 3))
        towards = self.loads.anchors[anchor] - self.load_positions(robot, joints)
        return np.asarray(towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9))

    def load_positions(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return the positions (N, 3) of the load point in R0 [m].

        Args:
            robot: n joints.
            joints: (N, n) positions as the controller shows them [rad or m].
        """
        at = Postures(robot, robot.joint_map.model_angles(joints))
        return np.asarray(at.to_base(np.broadcast_to(self.load_point, (len(joints), 1, 3)))[:, 0])

    def greatest_forces(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return the magnitude (N,) [N] of the greatest force that obeys all torque limits in any direction.

        Args:
            robot: n joints.
            joints: (N, n) positions as the controller shows them [rad or m].
        """
        at = Postures(robot, robot.joint_map.model_angles(joints))
        jacobian = at.jacobian_at(self.load_positions(robot, joints)[:, None])[:, 0]
        # The longest lever of each joint, at least 1e-9 m so that no division is by zero.
        lever = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-9)
        return np.asarray(np.minimum(self.loads.force, (self.loads.torque_limit / lever).min(axis=1)))


def find_feasible_readings(
    robot: Robot, equipment: Equipment, cell: Surroundings, joints: FloatArray, direction: FloatArray | None
) -> tuple[BoolArray, dict[str, int]]:
    """Find the readings that can be taken with the equipment in the surroundings.

    Args:
        robot: n joints.
        equipment: targets, load and tracker.
        cell: surroundings; its directions `facing` of the reflectors are in the order of the targets.
        joints: (N, n) positions as the controller shows them [rad or m].
        direction: (N, 3) unit vectors along the forces, axes of R0; None if the direction is free.

    Returns:
        Mask (N,) of feasible readings; and reason → number of readings. A reading that several reasons
        exclude counts for the first of them.
    """
    reading_count, model_angles = len(joints), robot.joint_map.model_angles(joints)
    postures = Postures(robot, model_angles)
    targets = postures.to_base(np.broadcast_to(equipment.targets, (reading_count, *equipment.targets.shape)))
    load_points = equipment.load_positions(robot, joints)
    # Links run from the base through the origins of the joint frames to the flange and the load point
    base, flange = np.zeros((reading_count, 1, 3)), postures.flange_translation[:, None]
    points = np.concatenate([base, postures.joint_frames[1], flange, load_points[:, None]], axis=1)
    radius = cell.link_radius
    if radius is None:
        link_lengths = np.linalg.norm(np.diff(points[:, :-1], axis=1), axis=2)
        link_lengths[:, :-1][:, robot.prismatic] = 0.0  # a rail makes no link thicker
        radius = _RELATIVE_RADIUS * float(link_lengths.sum(axis=1).max())
    excluded = {"joint_limits": ~robot.within_limits(joints)}
    if direction is not None:
        jacobian = postures.jacobian_at(load_points[:, None])[:, 0]
        torque = equipment.loads.force * np.einsum("nij,ni->nj", jacobian, direction)
        excluded["torque"] = (np.abs(torque) > equipment.loads.torque_limit).any(axis=1)
    excluded["floor_or_box"] = _find_out_of_bounds(cell, points, targets, radius)
    # Only links that are apart along the arm by more than twice their thickness can collide.
    excluded["self_collision"] = np.zeros(reading_count, dtype=np.bool_)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    for first, second in combinations(range(len(lengths)), 2):
        if lengths[first + 1 : second].sum() > 4.0 * radius:
            distances = compute_segment_distances(
                points[:, first], points[:, first + 1], points[:, second], points[:, second + 1]
            )
            excluded["self_collision"] |= distances < 2.0 * radius
    if equipment.instrument is not None:
        excluded |= _find_hidden_targets(equipment.instrument, cell, postures, points, targets, radius)
    if direction is not None and equipment.loads.kind == "cable":
        # Each reading's cable leads to the anchor whose direction is nearest to the force.
        to_anchors = equipment.loads.anchors - load_points[:, None]
        cable_lengths = np.linalg.norm(to_anchors, axis=2)
        nearest_anchor = np.argmax(
            np.einsum("nai,ni->na", to_anchors, direction) / np.maximum(cable_lengths, 1e-9), axis=1
        )
        excluded["cable"] = cable_lengths[np.arange(reading_count), nearest_anchor] < _SHORTEST_CABLE
        excluded["cable"] |= _is_crossed_by_link(
            points, radius, load_points, equipment.loads.anchors[nearest_anchor]
        )
    first_reason = np.argmax(list(excluded.values()), axis=0)
    feasible = ~np.any(list(excluded.values()), axis=0)
    counts = {
        reason: int(((first_reason == first) & ~feasible).sum()) for first, reason in enumerate(excluded)
    }
    return feasible, {reason: number for reason, number in counts.items() if number}


def _find_hidden_targets(
    instrument: Instrument,
    cell: Surroundings,
    postures: Postures,
    points: FloatArray,
    targets: FloatArray,
    radius: float,
) -> dict[str, BoolArray]:
    """Find the postures in which the instrument does not see every target.

    Args:
        instrument: instrument at its station.
        cell: surroundings, with the directions and the acceptance angle of the reflectors.
        postures: N postures.
        points: (N, P, 3) ends of the links in R0 [m].
        targets: (N, T, 3) in R0 [m].
        radius: radius of the links [m].

    Returns:
        Reason → mask (N,) of the postures that the reason excludes.
    """
    station = np.array(instrument.station)
    hidden_by_link = [
        _is_crossed_by_link(points, radius, station, targets[:, t]) for t in range(targets.shape[1])
    ]
    excluded = {"line_of_sight": np.any(hidden_by_link, axis=0)}
    if cell.facing:
        facing = np.array(list(cell.facing.values()))
        lines_of_sight = station - targets
        reflector_axes = facing @ postures.flange_rotation.transpose(0, 2, 1)
        norms = np.linalg.norm(lines_of_sight, axis=2) * np.linalg.norm(reflector_axes, axis=2)
        turned_away = (lines_of_sight * reflector_axes).sum(axis=2) / norms < np.cos(cell.acceptance)
        excluded["reflector_acceptance"] = turned_away.any(axis=1)
    return excluded


def _find_out_of_bounds(
    cell: Surroundings, points: FloatArray, targets: FloatArray, radius: float
) -> BoolArray:
    """Return a mask (N,) of postures in which a link or a target hits the floor, a wall or an obstacle.

    Args:
        cell: floor, walls and obstacles.
        points: (N, P, 3) origins of the joint frames, flange and load point in R0 [m].
        targets: (N, T, 3) in R0 [m].
        radius: radius of the links [m].
    """
    # Points along the links are tested in place of whole links; the first links never move.
    start, end = points[:, _FIRST_MOVING:-1, None], points[:, _FIRST_MOVING + 1 :, None]
    points_of_links = start + _SAMPLES[:, None] * (end - start)
    tested_points = np.concatenate([points_of_links.reshape(len(points_of_links), -1, 3), targets], axis=1)
    collides = np.zeros(len(tested_points), dtype=np.bool_)
    if cell.floor is not None:
        collides |= (tested_points[..., 2] < cell.floor).any(axis=1)
    if cell.inside is not None:
        collides |= ((tested_points < cell.inside[0]) | (tested_points > cell.inside[1])).any(axis=(1, 2))
    for low, high in np.array(cell.obstacles):
        collides |= ((tested_points > low - radius) & (tested_points < high + radius)).all(axis=2).any(axis=1)
    return collides


def _is_crossed_by_link(points: FloatArray, radius: float, start: FloatArray, end: FloatArray) -> BoolArray:
    """Return a mask (N,) of postures in which a link crosses the line from start to end.

    Args:
        points: (N, P, 3) ends of the links in R0 [m].
        radius: radius of the links [m].
        start: (3,) or (N, 3) in R0 [m].
        end: (3,) or (N, 3) in R0 [m].
    """
    # The last segments carry the reflectors and the load, so they are left out.
    crossed = np.zeros(len(points), dtype=np.bool_)
    for i in range(points.shape[1] - 1 - _NEAR_FLANGE):
        crossed |= compute_segment_distances(points[:, i], points[:, i + 1], start, end) < radius
    return crossed


def compute_segment_distances(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> FloatArray:
    """Return the least distances (N,) [m] between segments p–q and segments r–s (Ericson 2005, 5.1.9).

    Args:
        p: (N, 3) starts of the first segments [m].
        q: (N, 3) ends of the first segments.
        r: (N, 3) starts of the second segments, or (3,).
        s: (N, 3) ends of the second segments, or (3,).
    """
    u, v, w = q - p, s - r, p - r
    a, e, f = (u * u).sum(1), (v * v).sum(1), (v * w).sum(1)
    b, c = (u * v).sum(1), (u * w).sum(1)
    tiny = 1e-18
    denominator = a * e - b * b
    first_fraction = np.where(
        denominator > tiny, (b * f - c * e) / np.where(denominator > tiny, denominator, 1.0), 0.0
    )
    # x and y are the fractions of the way along the two segments at which these are nearest.
    first_fraction = np.clip(first_fraction, 0.0, 1.0)
    second_fraction = np.where(e > tiny, (b * first_fraction + f) / np.where(e > tiny, e, 1.0), 0.0)
    clipped = np.clip(second_fraction, 0.0, 1.0)
    # Where y had to be clipped, or the second segment is a point, x is computed again for this y.
    first_fraction_again = np.where(a > tiny, (b * clipped - c) / np.where(a > tiny, a, 1.0), 0.0)
    first_fraction = np.where(
        (clipped == second_fraction) & (e > tiny), first_fraction, np.clip(first_fraction_again, 0.0, 1.0)
    )
    return np.asarray(np.linalg.norm(w + first_fraction[:, None] * u - clipped[:, None] * v, axis=1))


def draw_postures(robot: Robot, count: int, seed: int) -> FloatArray:
    """Draw random postures within the joints' limits, in whole degrees or mm as the controller shows them.

    Args:
        robot: n joints.
        count: number of draws; draws that rounding moves beyond the limits are dropped.
        seed: seed of the draw.

    Returns:
        Controller's positions (N, n) [rad or m], with N at most `count`.

    Raises:
        RequestError: the limits leave no whole degree or millimetre.
    """
    largest = robot.select_by_kind(*_LARGEST_POSITION)[:, None]
    limits = np.clip(robot.limits, -largest, largest)
    random = np.random.default_rng(seed)
    model = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * random.random((count, robot.n))
    controller = np.linalg.solve(robot.joint_map.matrix, (model - robot.joint_map.offset).T).T
    joints = robot.round_to_whole_units(np.asarray(controller, dtype=np.float64))
    joints = joints[robot.within_limits(joints)]
    if not len(joints):
        raise RequestError(
            f"no posture in whole degrees{' and millimetres' if robot.prismatic.any() else ''} is within the "
            "joint limits",
            where="postures",
            remedy="give the postures, or correct the joint limits of the robot's model",
        )
    return joints


LEFT_OUT_SHARE: Final = 0.01
"""Greatest share of the prior variance of the predictions that is due to combinations of link compliances
that a plan leaves out; a plan treats their effect on readings as noise."""
_NOT_EXCITED: Final = 1e-9
"""Root mean square of a joint's rows, relative to the greatest of all joints, below which no load twists
it."""
_MOST_WITH_NUISANCE: Final = 600
"""Greatest number of candidates if elastic links or the geometry are a nuisance, as each candidate then costs
fifty times as much; candidates in the work area come first."""
_MOST_PLACES: Final = 60
"""Greatest number of postures in the work area at which predictions are evaluated."""
_FEWEST_PLACES: Final = 3
"""Least number of candidates in a work area."""
_BLOCK: Final = 2_048
"""Number of candidates whose rows are computed at a time."""
_SAMPLED: Final = 500
"""Greatest number of candidates from whose rows the parameters are chosen."""


class StepRows(Protocol):
    """Rows of the J joints with two encoders."""

    def __len__(self) -> int:
        """Return J."""
        ...

    def __call__(self, joints: FloatArray, /) -> FloatArray:
        """Return the rows (N, J, P) of the steps of twists in postures (N, n) [rad]."""
        ...


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """Request of a plan: robot's equipment, what is known beforehand, and the rules of the choice."""

    equipment: Equipment  #: instrument, targets and loads
    readings: int  #: number of readings, with those for validation; used if there is no goal
    nominal: FloatArray  #: (n,) compliance [rad/(N·m)]; nan where it is not known
    #: (n,) standard uncertainty of the compliance known beforehand [rad/(N·m)]; inf if nothing is known
    prior: FloatArray
    cell: Surroundings = field(default_factory=Surroundings)  #: surroundings of the robot
    criterion: PlanCriterion = "relative_a"  #: criterion of the choice
    postures: FloatArray | None = None  #: (N, n) to choose from, controller's angles [rad]; drawn if None
    candidates: int = 5_000  #: number of postures to draw
    joints: IndexArray | None = None  #: indices of the joints to be determined; all if None
    #: (2, 3) corners of the box in which predictions matter, in R0 [m]; None without a work area
    work_area: FloatArray | None = None
    #: (D, 3) unit vectors in R0 along which readings may be taken; None if all coordinates are read
    directions: FloatArray | None = None
    links: bool = False  #: whether elastic links are a nuisance
    link_share: float = 0.3  #: deflection by links, relative to that by joints, before any reading
    angle: float = float(np.radians(10.0))  #: two postures differ by at least this in a joint [rad or m]
    validation: float = 0.2  #: share of the readings that are held out
    so_far: Measurements | None = None  #: readings already taken in this campaign; None if it begins
    #: function from postures (N, n) to rows (N, 3 T, P) of unloaded positions [m], if the own weight bends
    #: the arm: columns of the joints, then of a nuisance in units of its prior uncertainty; None for applied
    #: loads
    own_weight_rows: Callable[[FloatArray], FloatArray] | None = None
    #: rows of the twists of joints [rad], if a weight step of two encoders is planned: columns as above;
    #: sigma is then that of a step
    step_rows: StepRows | None = None
    seed: int = 0  #: seed of drawn postures, validation and random plans
    #: uncertainty or mistake to reach, in place of a number of readings
    goal: JointsGoal | DeflectionGoal | LoadPointGoal | None = None

    @property
    def rows_of_reading(self) -> int:
        """Number of rows of one reading: twists of a weight step, or coordinates of targets."""
        if self.step_rows is not None:
            return len(self.step_rows)
        return (3 if self.directions is None else 1) * len(self.equipment.targets)


def build_reading_stack(robot: Robot, request: PlanRequest, measurements: Measurements) -> Stack:
    """Build the whitened rows of readings: columns of the joints, then of the nuisance parameters.

    The nuisance parameters are compliances of links, or other terms in units of their prior uncertainty. The
    columns of systematic errors that were fitted to the readings are projected out.

    Args:
        robot: n joints.
        request: request that states the nuisance parameters.
        measurements: N readings of T targets.

    Returns:
        Stack of rows with P columns of parameters, and a last column with the reading.
    """
    # A hedged term has a prior uncertainty, by which its columns are scaled below.
    hedged = {} if request.links else {name: term.hedged for name, term in TERMS.items() if term.hedged}
    if isinstance(request.goal, LoadPointGoal) and not request.links:
        hedged[LOAD_POINT.name] = request.goal.mistake
    links = [build_links_term(tuple(range(robot.n)))] if request.links else []
    terms = [JOINTS, *links, *(TERMS[name] for name in hedged)]
    fitted = fitted_errors(measurements).terms
    compliance = np.nan_to_num(request.nominal)
    stack = Rows(robot, measurements).stack([*terms, *fitted], compliance)
    stack = stack.in_units(hedged)
    return stack.project_out([term.name for term in fitted]) if fitted else stack


def build_known_rows(robot: Robot, request: PlanRequest, measured: Measurements) -> FloatArray:
    """Build the rows (3 N T, P) of N observations that were already made of T targets, in units of sigma."""
    if request.own_weight_rows is None:
        return build_reading_stack(robot, request, measured).flat[:, :-1]
    # With own weight only targets read in R0 count; rows of targets that were not read are set to zero.
    is_read = np.repeat(measured.present & ~measured.in_flange, 3, axis=1)[..., None]
    rows = request.own_weight_rows(measured.joints) * is_read
    return rows.reshape(-1, rows.shape[-1])


@dataclass(frozen=True, eq=False)
class Readings:
    """N readings that could be taken: postures with the loads under which each could be read."""

    joints: FloatArray  #: (N, n) controller's angles [rad]
    anchor: IndexArray  #: (N,) anchor of the cable; -1 without one
    #: (N, 1, 3) load [N]; if the direction is free, (N, 3, 3) greatest forces along x, y and z of R0
    forces: FloatArray
    along: FloatArray | None = None  #: (N, 3) directions along which to read; None if all coordinates are

    def __getitem__(self, part: IndexArray | BoolArray | slice) -> Readings:
        """Return some of the readings, in the given order."""
        along = None if self.along is None else self.along[part]
        return Readings(self.joints[part], self.anchor[part], self.forces[part], along)

    def build_rows(self, robot: Robot, request: PlanRequest, equipment: Equipment) -> FloatArray:
        """Build the rows (N, L, 3 T, P) of N readings of T targets under L loads, in units of sigma.

        P is the number of parameters. L is 1, or 3 if the direction of the force is free: a load along each
        axis.
        """
        compute_rows = request.own_weight_rows or request.step_rows
        if compute_rows is not None:
            return compute_rows(self.joints)[:, None]
        measurements_by_load = [
            equipment.build_measurements(robot, self.joints, self.forces[:, load], self.along)
            for load in range(self.forces.shape[1])
        ]
        return np.stack(
            [
                build_reading_stack(robot, request, measurements).rows[..., :-1]
                for measurements in measurements_by_load
            ],
            axis=1,
        )


@dataclass(frozen=True, eq=False)
class Parameters:
    """Linear map from the columns of rows to the p parameters of a plan."""

    joints: IndexArray  #: (s,) joints to be determined: their relative compliances are the first parameters
    nominal: FloatArray  #: (n,) compliance to which a relative compliance refers [rad/(N·m)]
    #: (n,) whether the nominal compliance is known. Where it is not, it is assumed so large that the joint
    #: moves the targets as much as a typical joint
    known: BoolArray
    basis: FloatArray  #: (P, p) columns of the parameters
    prior: FloatArray  #: (p, p) prior information on the parameters: inverse of their covariance


def choose_parameters(
    rows: FloatArray,
    predicted: FloatArray,
    names: Sequence[str],
    requested_joints: IndexArray | None,
    nominal: FloatArray,
    link_share: float | None,
    *,
    of_weight_step: bool,
) -> Parameters:
    """Choose the parameters of a plan: relative compliances of joints, then the nuisance.

    Link compliances are a nuisance. Before any reading, the links together are assumed to cause a deflection
    of `link_share` times that of the joints, to which each matrix entry contributes equally. The combinations
    of link compliances that cause all but a share `LEFT_OUT_SHARE` of the prior variance of predictions are
    kept.

    Args:
        rows: (K, n) or (K, P) whitened rows of candidates; the first n columns belong to the joints.
        predicted: (L, n) or (L, P) rows of the deflections to predict; without a work area, the same as
            `rows`.
        names: names of the n joints.
        requested_joints: indices of the joints to be determined; None for all joints that the loads twist.
            Other joints that the loads twist are a nuisance.
        nominal: (n,) compliance [rad/(N·m)]; nan where it is not known.
        link_share: root mean square deflection due to links over that due to joints; None if the nuisance is
            not links: then the columns are already in units of their prior uncertainty.
        of_weight_step: whether two encoders read the joints, without targets.

    Raises:
        RequestError: no candidate load twists a wanted joint.
    """
    n = len(names)
    typical_rows = np.sqrt(np.square(rows[:, :n]).mean(axis=0))
    is_excited = typical_rows > _NOT_EXCITED * typical_rows.max()
    chosen_joints = (
        np.flatnonzero(is_excited) if requested_joints is None and is_excited.any() else requested_joints
    )
    chosen_joints = np.arange(n) if chosen_joints is None else chosen_joints
    not_excited = chosen_joints[~is_excited[chosen_joints]]
    if len(not_excited):
        joints = ", ".join(names[j] for j in not_excited)
        raise (
            _refuse_weight_without_torque(joints) if of_weight_step else _refuse_loads_without_motion(joints)
        )
    is_known = np.isfinite(nominal) & (np.nan_to_num(nominal) > 0.0)
    # A joint of unknown compliance is assumed to move the targets as much as a typical joint (the median).
    typical_motion = float(np.median(typical_rows[is_known] * nominal[is_known])) if is_known.any() else 1.0
    compliance_units = np.where(
        is_known, np.nan_to_num(nominal), typical_motion / np.where(is_excited, typical_rows, 1.0)
    )
    columns = np.concatenate([chosen_joints, np.setdiff1d(np.flatnonzero(is_excited), chosen_joints)])
    compliance_columns = np.zeros((rows.shape[1], len(columns)))
    compliance_columns[columns, np.arange(len(columns))] = compliance_units[columns]
    nuisance = np.eye(rows.shape[1])[:, n:]
    if link_share is not None and nuisance.size:
        joint_deflection = np.sqrt(
            np.square(predicted[:, :n] * compliance_units * is_excited).sum(axis=1).mean()
        )
        nuisance = nuisance @ _combine_link_compliances(predicted[:, n:], link_share * joint_deflection)
    prior = np.diag(np.r_[np.zeros(len(columns)), np.ones(nuisance.shape[1])])
    return Parameters(
        chosen_joints, compliance_units, is_known, np.hstack([compliance_columns, nuisance]), prior
    )


def _refuse_loads_without_motion(joints: str) -> RequestError:
    """Return the refusal of joints that no load twists, or that move no target."""
    return RequestError(
        f"no candidate load twists {joints}, or no target moves when these joints turn",
        where="joints",
        remedy="allow loads in other directions, or omit these joints from `joints`",
    )


def _refuse_weight_without_torque(joints: str) -> RequestError:
    """Return the refusal of joints that the weight of a step twists in no posture."""
    return RequestError(
        f"the weight twists {joints} in no candidate posture, so both encoders of a joint show the same with "
        "and without it: a weight twists neither a vertical axis nor an axis through its centre of mass",
        where="joints",
        remedy="name in `joints` only joints with two encoders whose axes can be level; for an axis through "
        "the centre of mass, hang the weight away from the axis and state `load_point`",
    )


def _combine_link_compliances(links: FloatArray, deflection: float) -> FloatArray:
    """Return the combinations of link compliances that matter to predictions, with unit prior variance.

    Each entry of the compliance matrices is assumed to contribute equally to the deflection by links. The
    combinations with the least prior variance of predictions, together a share `LEFT_OUT_SHARE`, are left
    out.

    Args:
        links: (L, P) rows of the deflections to predict, columns of the link compliances.
        deflection: root mean square deflection by all links together [unit of the rows].

    Returns:
        (P, m) combinations as columns.
    """
    typical_rows = np.sqrt(np.square(links).mean(axis=0))
    is_effective = typical_rows > _NOT_EXCITED * typical_rows.max()
    entry_deflection = deflection / np.sqrt(is_effective.sum())
    deviation = np.where(is_effective, entry_deflection / np.where(is_effective, typical_rows, 1.0), 0.0)
    variances, directions = np.linalg.eigh((links.T @ links) * np.outer(deviation, deviation))
    # The variances ascend: leave out the first, as long as their sum is at most the share left out.
    is_kept = np.cumsum(np.maximum(variances, 0.0)) > LEFT_OUT_SHARE * variances.sum()
    return np.asarray(deviation[:, None] * directions[:, is_kept])


@dataclass(frozen=True, eq=False)
class Pool:
    """Feasible readings among which a plan chooses, with the information that each adds."""

    readings: Readings  #: N candidates
    candidates: Candidates  #: information of each of the N candidates
    parameters: Parameters  #: parameters to be determined, and the nuisance
    base: FloatArray  #: (p, p) information of the readings already taken and of priors
    #: (R, p, p) AᵀA of the deflection at R places of the work area [m²], mean over axes; None without a work
    #: area
    places: FloatArray | None
    #: (R, 9, P) rows A of the deflection at these places under forces along the axes of R0 [m]; None without
    #: a work area
    predicted: FloatArray | None
    feasible: int  #: number of feasible readings; the candidates may be a part of them
    struck_out: dict[str, int]  #: reason → number of infeasible readings

    @classmethod
    def from_request(cls, robot: Robot, request: PlanRequest) -> Pool:
        """Collect the feasible readings of drawn or given postures, and compute the information of each.

        Raises:
            RequestError: no reading is feasible, or no load twists a joint.
        """
        equipment, sigma = request.equipment, request.equipment.sigma
        readings, in_work_area, struck_out = _select_feasible_readings(robot, request)
        feasible_count = len(readings.joints)
        if request.links or request.own_weight_rows is not None:
            kept_readings = _thin_out_readings(in_work_area)
            readings, in_work_area = readings[kept_readings], in_work_area[kept_readings]
        predicted = (
            None
            if request.work_area is None
            else _build_predicted_rows(robot, request, readings.joints[in_work_area])
        )
        if request.directions is not None:  # each reading becomes one candidate for each direction
            along = np.tile(request.directions, (len(readings.joints), 1))
            repeated = readings[np.repeat(np.arange(len(readings.joints)), len(request.directions))]
            readings = Readings(repeated.joints, repeated.anchor, repeated.forces, along)
        reading_count = len(readings.joints)
        sample_indices = np.linspace(0, reading_count - 1, min(reading_count, _SAMPLED)).astype(np.intp)
        sampled = readings[sample_indices].build_rows(robot, request, equipment)
        sampled = sampled.reshape(-1, sampled.shape[-1])
        measured = request.so_far
        known_rows = sampled[:0] if measured is None else build_known_rows(robot, request, measured)
        typical_rows = np.concatenate([sampled, known_rows]) / sigma
        parameters = choose_parameters(
            typical_rows,
            typical_rows if predicted is None else predicted.reshape(-1, typical_rows.shape[1]),
            robot.joint_names,
            request.joints,
            request.nominal,
            request.link_share if request.links else None,
            of_weight_step=request.step_rows is not None,
        )
        basis, chosen_count = parameters.basis, len(parameters.joints)
        known_rows = known_rows @ basis / ((measured and measured.sigma) or sigma)
        base_information = parameters.prior + known_rows.T @ known_rows
        # Prior uncertainty of each joint's relative compliance; inf adds no information.
        relative_prior = request.prior[parameters.joints] / parameters.nominal[parameters.joints]
        base_information[np.arange(chosen_count), np.arange(chosen_count)] += 1.0 / np.square(relative_prior)
        row_blocks = [
            readings[start : start + _BLOCK].build_rows(robot, request, equipment) @ basis / sigma
            for start in range(0, reading_count, _BLOCK)
        ]
        rows, places = np.concatenate(row_blocks), None
        if predicted is not None:
            predicted_columns = predicted @ basis
            places = predicted_columns.transpose(0, 2, 1) @ predicted_columns / 3.0
        candidates = Candidates.from_rows(rows if rows.shape[1] > 1 else rows[:, 0])
        return cls(
            readings, candidates, parameters, base_information, places, predicted, feasible_count, struck_out
        )

    def candidate_forces(self, unit: FloatArray, index: IndexArray) -> FloatArray:
        """Return the forces (k, 3) [N] of candidates.

        Args:
            unit: (k, 3) directions of the forces, used only where directions are free.
            index: (k,) indices of the candidates.
        """
        forces = self.readings.forces[index]
        return (unit[:, None] @ forces)[:, 0] if self.candidates.free else forces[:, 0]


def _thin_out_readings(in_work_area: BoolArray) -> BoolArray:
    """Return a mask (N,) of at most `_MOST_WITH_NUISANCE` readings, those in the work area first.

    Args:
        in_work_area: (N,) mask of the readings in the work area.
    """
    is_kept = np.zeros(len(in_work_area), dtype=np.bool_)
    for indices in (np.flatnonzero(in_work_area), np.flatnonzero(~in_work_area)):
        free_places = _MOST_WITH_NUISANCE - int(is_kept.sum())
        if free_places > 0:
            is_kept[indices[:: max(1, -(-len(indices) // free_places))]] = True  # evenly spread
    return is_kept


def _select_feasible_readings(
    robot: Robot, request: PlanRequest
) -> tuple[Readings, BoolArray, dict[str, int]]:
    """Select the feasible readings among all postures and loads.

    Returns:
        The N feasible readings; a mask (N,) of those whose load point is in the work area; and reason →
        number of infeasible readings.

    Raises:
        RequestError: no reading is feasible, or too few are in the work area.
    """
    equipment, loads = request.equipment, request.equipment.loads
    postures = request.postures
    if postures is None:
        postures = draw_postures(robot, request.candidates, request.seed)
    anchor_count = len(loads.anchors) if loads.kind == "cable" else 1
    joints = np.repeat(postures, anchor_count, axis=0)
    anchor = np.tile(np.arange(anchor_count), len(postures))
    direction = equipment.force_directions(robot, joints, anchor)
    is_feasible, excluded_counts = find_feasible_readings(robot, equipment, request.cell, joints, direction)
    if not is_feasible.any():
        counts = ", ".join(f"{name} {count}" for name, count in excluded_counts.items())
        raise RequestError(
            f"none of {len(joints)} candidate readings is feasible: {counts}",
            where="candidates",
            remedy="relax the condition that excludes most readings, or give other postures or loads",
        )
    joints = joints[is_feasible]
    anchor = anchor[is_feasible] if loads.kind == "cable" else np.full(len(joints), -1)
    if direction is None:
        forces = equipment.greatest_forces(robot, joints)[:, None, None] * np.eye(3)
    else:
        forces = loads.force * direction[is_feasible][:, None]
    in_work_area = np.zeros(len(joints), dtype=np.bool_)
    if request.work_area is not None:
        load_points = equipment.load_positions(robot, joints)
        low, high = request.work_area
        in_work_area = ((load_points >= low) & (load_points <= high)).all(axis=1)
        if in_work_area.sum() < _FEWEST_PLACES:
            raise _describe_missed_area(robot, request.work_area, load_points, int(in_work_area.sum()))
    return Readings(joints, anchor, forces), in_work_area, excluded_counts


def _describe_missed_area(
    robot: Robot, work_area: FloatArray, load_points: FloatArray, count: int
) -> RequestError:
    """Return the error that too few candidates have their load point in the work area, with its cause.

    Args:
        robot: n joints.
        work_area: (2, 3) lowest and highest corner of the work area in R0 [m].
        load_points: (M, 3) load points of the candidate postures in R0 [m].
        count: number of the candidates with the load point in the work area.
    """
    low, high = np.asarray(work_area)
    reach = max(robot.reach_bound, float(np.linalg.norm(load_points, axis=1).max()))
    distance = float(np.linalg.norm(np.clip(0.0, low, high)))
    size = " × ".join(length_text(side) for side in (high - low).tolist())
    reason = f"only {count} of {len(load_points)} candidate postures have their load point in the work area"
    if distance > reach:
        return RequestError(
            f"{reason}: its nearest place is {length_text(distance)} from the origin of R0, and the arm "
            f"reaches at most {length_text(reach)}",
            where="work_area",
            remedy="check the unit and the digits of the work area's corners in R0, and move it within reach",
        )
    flat = [axis for axis, side in zip("xyz", high - low, strict=True) if side == 0.0]
    if flat:
        return RequestError(
            f"{reason}: its two corners have the same {' and '.join(flat)}, so that it has no volume",
            where="work_area",
            remedy="give two opposite corners of the box in R0; the second one is no size",
        )
    return RequestError(
        f"{reason}, of {size}",
        where="work_area",
        remedy="check the unit of the work area's corners in R0, and give a larger work area, or more "
        "candidates",
    )


def _build_predicted_rows(robot: Robot, request: PlanRequest, postures_in_area: FloatArray) -> FloatArray:
    """Build the rows (R, 9, P) of the deflection [m] at R places of the work area.

    The 9 rows of a place are three coordinates under a force along each of the three axes of R0.

    Args:
        robot: n joints.
        request: request with the load.
        postures_in_area: (M, n) postures of candidates in the work area; at most `_MOST_PLACES` are used.
    """
    joints = postures_in_area[:: max(1, len(postures_in_area) // _MOST_PLACES)][:_MOST_PLACES]
    point = request.equipment.load_point
    # The load point itself is the only target, and sigma is 1.
    equipment = Equipment(point[None], point, request.equipment.loads, 1.0)
    forces = np.broadcast_to(request.equipment.loads.force * np.eye(3), (len(joints), 3, 3))
    rows = Readings(joints, np.full(len(joints), -1), forces).build_rows(robot, request, equipment)
    # Rows are whitened for differences of two readings of sigma 1, whose variance is 2: undo this.
    return np.asarray(np.sqrt(2.0) * rows.reshape(len(joints), 9, -1))
