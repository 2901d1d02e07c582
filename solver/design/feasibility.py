"""Feasible readings: equipment, limits, torques, boxes, self-collision, line of sight, reflectors and cable.

Links are capsules along the segments from one joint frame's origin to the next, to the flange, and to
the load point.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.readings.measurements import DifferenceNoise, Instrument, Measurements
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import Robot

LoadKind = Literal["dead_weight", "any_direction", "cable"]

_SAMPLES: Final = np.linspace(0.0, 1.0, 5)
"""Places along a link that are compared with boxes."""
_FIRST_MOVING: Final = 2
"""Origins of the base and of the first joint stand still, on the floor as a rule."""
_NEAR_FLANGE: Final = 3
"""Last segments, which carry the reflectors: they hide none."""
_RELATIVE_RADIUS: Final = 0.04
"""Radius of the links over the length of the stretched arm, where none is given."""
_SHORTEST_CABLE: Final = 0.1
"""Length of a cable [m] below which it cannot be fastened."""
_LARGEST_POSITION: Final = (np.pi, 1.0)
"""Range of a joint without limits [rad, m of a prismatic one]."""
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces that can be applied."""

    kind: LoadKind  #: a weight pulls along −z of R0, a cable towards one of the anchors, or in any direction
    force: float  #: magnitude [N]; for any direction the greatest
    torque_limit: FloatArray  #: (n,) greatest torque of the load about each joint [N·m]; inf for none
    anchors: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  #: (A, 3) of the cable, in R0 [m]


@dataclass(frozen=True, eq=False)
class Equipment:
    """Instrument, targets and loads."""

    targets: FloatArray  #: (T, 3) flange frame [m]
    load_point: FloatArray  #: (3,) where the force acts, flange frame [m]
    loads: Loads  #: loads that can be applied
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]
    instrument: Instrument | None = None  #: the tracker at its station; isotropic noise of sigma if None

    def measurements(
        self, robot: Robot, joints: FloatArray, force: FloatArray, along: FloatArray | None = None
    ) -> Measurements:
        """Return readings still to be taken, with deflections of zero and the covariance that they will have.

        Args:
            robot: n joints.
            joints: (N, n) positions as the controller shows them [rad or m].
            force: (N, 3) axes of R0 [N].
            along: (N, 3) unit vectors in R0 along which targets are read; None if all coordinates are.
        """
        count, shape = len(joints), (len(joints), *self.targets.shape)
        plain = Measurements(
            joints=joints,
            force=force,
            moment=np.zeros((count, 3)),
            load_point=np.broadcast_to(self.load_point, (count, 3)),
            position=np.broadcast_to(self.targets, shape),
            in_flange=np.ones(shape[:2], dtype=np.bool_),
            deflection=np.zeros(shape),
            present=np.ones(shape[:2], dtype=np.bool_),
            sigma=self.sigma,
            direction=None if along is None else np.broadcast_to(along[:, None], shape).copy(),
        )
        if self.instrument is None:
            return plain
        noise = DifferenceNoise.by(self.instrument, robot, plain)
        # The unit of the covariance is the sigma stated here, whatever that of these places is.
        return replace(plain, covariance=noise.covariance * (noise.sigma / self.sigma) ** 2)

    def direction(self, robot: Robot, joints: FloatArray, anchor: IndexArray) -> FloatArray | None:
        """Return unit vectors (N, 3) in R0 of a weight or towards anchors (N,); None for any direction."""
        if self.loads.kind == "any_direction":
            return None
        if self.loads.kind == "dead_weight":
            return np.broadcast_to([0.0, 0.0, -1.0], (len(joints), 3))
        towards = self.loads.anchors[anchor] - self.load_place(robot, joints)
        return np.asarray(towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9))

    def load_place(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return where the load acts (N, 3) in R0 [m]."""
        now = Configurations(robot, robot.joint_map.model_angles(joints))
        return np.asarray(now.to_base(np.broadcast_to(self.load_point, (len(joints), 1, 3)))[:, 0])

    def strength(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return the greatest force (N,) [N] whose torques stay within the limits in every direction."""
        now = Configurations(robot, robot.joint_map.model_angles(joints))
        jacobian = now.jacobian_at(self.load_place(robot, joints)[:, None])[:, 0]
        lever = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-9)
        return np.asarray(np.minimum(self.loads.force, (self.loads.torque_limit / lever).min(axis=1)))


@dataclass(frozen=True, eq=False)
class Cell:
    """Surroundings of the robot, in R0."""

    floor: float | None = None  #: least height of links, load point and targets [m]; None for no floor
    inside: FloatArray | None = None  #: (2, 3) corners of the box in which they stay [m]; None for none
    #: (B, 2, 3) corners of boxes that they stay out of [m]
    obstacles: FloatArray = field(default_factory=lambda: np.empty((0, 2, 3)))
    link_radius: float | None = None  #: link radius of the capsules [m]; 4 % of the stretched arm if None
    #: (T, 3) direction in which each reflector looks, flange frame; None if they turn by themselves
    facing: FloatArray | None = None
    acceptance: float = np.pi  #: greatest angle between that and the line of sight [rad]


def feasible(
    robot: Robot, equipment: Equipment, cell: Cell, joints: FloatArray, direction: FloatArray | None
) -> tuple[BoolArray, dict[str, int]]:
    """Return which readings can be taken.

    Args:
        robot: n joints.
        equipment: targets, load and tracker.
        cell: surroundings.
        joints: (N, n) positions as the controller shows them [rad or m].
        direction: (N, 3) of the force, axes of R0; None where it is free.

    Returns:
        Mask (N,), and how many were struck out for which reason: the first one counts.
    """
    count, model = len(joints), robot.joint_map.model_angles(joints)
    now = Configurations(robot, model)
    targets = now.to_base(np.broadcast_to(equipment.targets, (count, *equipment.targets.shape)))
    load = equipment.load_place(robot, joints)
    # Links run from the base through the origins of the joint frames to the flange and the load point
    base, flange = np.zeros((count, 1, 3)), now.flange_translation[:, None]
    points = np.concatenate([base, joint_frames(robot, model)[1], flange, load[:, None]], axis=1)
    radius = cell.link_radius
    if radius is None:
        links = np.linalg.norm(np.diff(points[:, :-1], axis=1), axis=2)
        links[:, :-1][:, robot.prismatic] = 0.0  # a rail makes no link thicker
        radius = _RELATIVE_RADIUS * float(links.sum(axis=1).max())
    struck = {"joint_limits": ~within_limits(robot, joints)}
    if direction is not None:
        jacobian = now.jacobian_at(load[:, None])[:, 0]
        torque = equipment.loads.force * np.einsum("nij,ni->nj", jacobian, direction)
        struck["torque"] = (np.abs(torque) > equipment.loads.torque_limit).any(axis=1)
    struck["floor_or_box"] = _out_of_bounds(cell, points, targets, radius)
    # Links that are apart along the arm, by more than twice their thickness, and touch
    struck["self_collision"] = np.zeros(count, dtype=np.bool_)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    for i, j in combinations(range(len(lengths)), 2):
        if lengths[i + 1 : j].sum() > 4.0 * radius:
            apart = segment_distance(points[:, i], points[:, i + 1], points[:, j], points[:, j + 1])
            struck["self_collision"] |= apart < 2.0 * radius
    if equipment.instrument is not None:
        station = np.array(equipment.instrument.station)
        hidden = [_link_between(points, radius, station, targets[:, t]) for t in range(targets.shape[1])]
        struck["line_of_sight"] = np.any(hidden, axis=0)
        if cell.facing is not None:
            sight, look = station - targets, cell.facing @ now.flange_rotation.transpose(0, 2, 1)
            norms = np.linalg.norm(sight, axis=2) * np.linalg.norm(look, axis=2)
            away = (sight * look).sum(axis=2) / norms < np.cos(cell.acceptance)
            struck["reflector_acceptance"] = away.any(axis=1)
    if direction is not None and equipment.loads.kind == "cable":
        # The anchor of each reading is that towards which its force points
        towards = equipment.loads.anchors - load[:, None]
        length = np.linalg.norm(towards, axis=2)
        own = np.argmax(np.einsum("nai,ni->na", towards, direction) / np.maximum(length, 1e-9), axis=1)
        struck["cable"] = length[np.arange(count), own] < _SHORTEST_CABLE
        struck["cable"] |= _link_between(points, radius, load, equipment.loads.anchors[own])
    first = np.argmax(list(struck.values()), axis=0)
    kept = ~np.any(list(struck.values()), axis=0)
    counts = {reason: int(((first == i) & ~kept).sum()) for i, reason in enumerate(struck)}
    return kept, {reason: number for reason, number in counts.items() if number}


def _out_of_bounds(cell: Cell, points: FloatArray, targets: FloatArray, radius: float) -> BoolArray:
    """Return where a link, a target or the load point is below the floor, outside, or in an obstacle (N,)."""
    start, end = points[:, _FIRST_MOVING:-1, None], points[:, _FIRST_MOVING + 1 :, None]
    along = start + _SAMPLES[:, None] * (end - start)
    places = np.concatenate([along.reshape(len(along), -1, 3), targets], axis=1)
    bad = np.zeros(len(places), dtype=np.bool_)
    if cell.floor is not None:
        bad |= (places[..., 2] < cell.floor).any(axis=1)
    if cell.inside is not None:
        bad |= ((places < cell.inside[0]) | (places > cell.inside[1])).any(axis=(1, 2))
    for low, high in cell.obstacles:
        bad |= ((places > low - radius) & (places < high + radius)).all(axis=2).any(axis=1)
    return bad


def _link_between(points: FloatArray, radius: float, start: FloatArray, end: FloatArray) -> BoolArray:
    """Return where a link stands between start and end, (3,) or (N, 3) each (N,)."""
    bad = np.zeros(len(points), dtype=np.bool_)
    for i in range(points.shape[1] - 1 - _NEAR_FLANGE):
        bad |= segment_distance(points[:, i], points[:, i + 1], start, end) < radius
    return bad


def segment_distance(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> FloatArray:
    """Return the least distances of segments p q and r s, as in Ericson 2005, 5.1.9.

    Args:
        p: (N, 3) starts of the first.
        q: (N, 3) their ends.
        r: (N, 3) starts of the second, or (3,).
        s: (N, 3) their ends.

    Returns:
        (N,).
    """
    u, v, w = q - p, s - r, p - r
    a, e, f = (u * u).sum(1), (v * v).sum(1), (v * w).sum(1)
    b, c = (u * v).sum(1), (u * w).sum(1)
    tiny = 1e-18
    denominator = a * e - b * b
    x = np.where(denominator > tiny, (b * f - c * e) / np.where(denominator > tiny, denominator, 1.0), 0.0)
    x = np.clip(x, 0.0, 1.0)
    y = np.where(e > tiny, (b * x + f) / np.where(e > tiny, e, 1.0), 0.0)
    clipped = np.clip(y, 0.0, 1.0)
    again = np.where(a > tiny, (b * clipped - c) / np.where(a > tiny, a, 1.0), 0.0)
    x = np.where((clipped == y) & (e > tiny), x, np.clip(again, 0.0, 1.0))
    return np.asarray(np.linalg.norm(w + x[:, None] * u - clipped[:, None] * v, axis=1))


def drawn_postures(robot: Robot, count: int, seed: int) -> FloatArray:
    """Draw postures evenly within the joints' limits, in whole degrees or mm as the controller shows them.

    Returns:
        (N, n) [rad or m], N at most `count`.

    Raises:
        RequestError: the limits leave no whole degree or millimetre.
    """
    largest = robot.by_kind(*_LARGEST_POSITION)[:, None]
    limits = np.clip(robot.limits, -largest, largest)
    random = np.random.default_rng(seed)
    model = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * random.random((count, robot.n))
    controller = np.linalg.solve(robot.joint_map.matrix, (model - robot.joint_map.offset).T).T
    joints = in_whole_units(robot, np.asarray(controller, dtype=np.float64))
    joints = joints[within_limits(robot, joints)]
    if not len(joints):
        raise RequestError(
            f"no posture in whole degrees{' and millimetres' if robot.prismatic.any() else ''} is within the "
            "joint limits",
            where="postures",
            remedy="give the postures, or correct the joint limits of the robot's model",
        )
    return joints


def in_whole_units(robot: Robot, joints: FloatArray) -> FloatArray:
    """Return positions (N, n) [rad or m] rounded to whole degrees, and to whole mm of prismatic joints."""
    degrees: FloatArray = np.radians(np.round(np.degrees(joints)))
    return np.where(robot.prismatic, np.round(joints * 1e3) / 1e3, degrees)


def within_limits(robot: Robot, joints: FloatArray) -> BoolArray:
    """Return which postures (N, n) of the controller lie within the limits of the model's joints (N,)."""
    model = robot.joint_map.model_angles(joints)
    inside = (model >= robot.limits[:, 0] - _ROUNDING) & (model <= robot.limits[:, 1] + _ROUNDING)
    return np.asarray(inside.all(axis=1), dtype=np.bool_)


def targets_in_flange(robot: Robot, measurements: Measurements) -> FloatArray:
    """Return the mean places (T, 3) of targets that were read, flange frame [m]."""
    now = Configurations(robot, robot.joint_map.model_angles(measurements.joints))
    measured = (measurements.position - now.flange_translation[:, None]) @ now.flange_rotation
    places = np.where(measurements.in_flange[..., None], measurements.position, measured)
    present = measurements.present[..., None]
    return np.asarray(np.where(present, places, 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1))
