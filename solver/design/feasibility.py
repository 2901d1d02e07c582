"""Feasible readings: limits, torques, boxes, self-collision, line of sight, reflectors and cable.

Links are capsules along the segments from one joint frame's origin to the next, to the flange, and to
the load point.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.design.experiment import Equipment, within_limits
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import Robot

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


@dataclass(frozen=True)
class Strikes:
    """Readings that cannot be taken, and why."""

    considered: int  #: how many
    reasons: dict[str, int]  #: number struck out for each reason; the first one counts


def feasible(
    robot: Robot, equipment: Equipment, cell: Cell, joints: FloatArray, direction: FloatArray | None
) -> tuple[BoolArray, Strikes]:
    """Return which readings can be taken.

    Args:
        robot: n joints.
        equipment: targets, load and tracker.
        cell: surroundings.
        joints: (N, n) angles as the controller shows them [rad].
        direction: (N, 3) of the force, axes of R0; None where it is free.

    Returns:
        Mask (N,), and how many were struck out for which reason.
    """
    bodies = _Bodies(robot, equipment, cell, joints)
    kept = np.ones(len(joints), dtype=np.bool_)
    reasons: dict[str, int] = {}
    for reason, bad in {
        "joint_limits": ~within_limits(robot, joints),
        "torque": bodies.over_torque(direction),
        "floor_or_box": bodies.out_of_bounds(),
        "self_collision": bodies.self_collision(),
        "line_of_sight": bodies.hidden(),
        "reflector_acceptance": bodies.turned_away(),
        "cable": bodies.cable_blocked(direction),
    }.items():
        struck = kept & bad
        if struck.any():
            reasons[reason] = int(struck.sum())
        kept &= ~bad
    return kept, Strikes(len(joints), reasons)


class _Bodies:
    """Segments, targets and load point of N postures in R0."""

    def __init__(self, robot: Robot, equipment: Equipment, cell: Cell, joints: FloatArray) -> None:
        model = robot.joint_map.model_angles(joints)
        self._now = Configurations(robot, model)
        count = len(joints)
        places = np.broadcast_to(equipment.targets, (count, *equipment.targets.shape))
        self._targets = self._now.to_base(places)
        self._load = equipment.load_place(robot, joints)
        origins = joint_frames(robot, model)[1]
        base = np.zeros((count, 1, 3))
        flange = self._now.flange_translation[:, None]
        self._points = np.concatenate([base, origins, flange, self._load[:, None]], axis=1)
        self._none = np.zeros(count, dtype=np.bool_)
        self._equipment, self._cell = equipment, cell
        lengths = np.linalg.norm(np.diff(self._points[:, :-1], axis=1), axis=2)
        reach = float(lengths.sum(axis=1).max()) if count else 0.0
        self._radius = _RELATIVE_RADIUS * reach if cell.link_radius is None else cell.link_radius

    def over_torque(self, direction: FloatArray | None) -> BoolArray:
        """Return where a load of given direction twists a joint beyond its limit."""
        if direction is None:
            return self._none
        jacobian = self._now.jacobian_at(self._load[:, None])[:, 0]
        torque = self._equipment.loads.force * np.einsum("nij,ni->nj", jacobian, direction)
        over: BoolArray = (np.abs(torque) > self._equipment.loads.torque_limit).any(axis=1)
        return over

    def out_of_bounds(self) -> BoolArray:
        """Return where a link, a target or the load point is below the floor, outside, or in an obstacle."""
        start, end = self._points[:, _FIRST_MOVING:-1, None], self._points[:, _FIRST_MOVING + 1 :, None]
        along = start + _SAMPLES[:, None] * (end - start)
        points = np.concatenate([along.reshape(len(along), -1, 3), self._targets], axis=1)
        cell, bad = self._cell, self._none.copy()
        if cell.floor is not None:
            bad |= (points[..., 2] < cell.floor).any(axis=1)
        if cell.inside is not None:
            bad |= ((points < cell.inside[0]) | (points > cell.inside[1])).any(axis=(1, 2))
        for low, high in cell.obstacles:
            within = (points > low - self._radius) & (points < high + self._radius)
            bad |= within.all(axis=2).any(axis=1)
        return bad

    def self_collision(self) -> BoolArray:
        """Return where two links touch that are apart along the arm, by more than twice their thickness."""
        bad = self._none.copy()
        lengths = np.linalg.norm(np.diff(self._points, axis=1), axis=2).max(axis=0, initial=0.0)
        last = len(lengths)
        for i in range(last):
            for j in range(i + 2, last):
                if lengths[i + 1 : j].sum() > 4.0 * self._radius:
                    near = self._between(i, self._points[:, j], self._points[:, j + 1])
                    bad |= near < 2.0 * self._radius
        return bad

    def hidden(self) -> BoolArray:
        """Return where a link stands between the tracker and a target."""
        bad = self._none.copy()
        if self._equipment.instrument is None:
            return bad
        station = np.broadcast_to(self._equipment.instrument.station, self._load.shape)
        for t in range(self._targets.shape[1]):
            for i in range(self._points.shape[1] - 1 - _NEAR_FLANGE):
                bad |= self._between(i, station, self._targets[:, t]) < self._radius
        return bad

    def turned_away(self) -> BoolArray:
        """Return where a reflector does not look towards the tracker."""
        instrument, facing = self._equipment.instrument, self._cell.facing
        if instrument is None or facing is None:
            return self._none
        sight = np.array(instrument.station) - self._targets
        look = facing @ self._now.flange_rotation.transpose(0, 2, 1)
        cosine = (sight * look).sum(axis=2) / (np.linalg.norm(sight, axis=2) * np.linalg.norm(look, axis=2))
        away: BoolArray = (cosine < np.cos(self._cell.acceptance)).any(axis=1)
        return away

    def cable_blocked(self, direction: FloatArray | None) -> BoolArray:
        """Return where the cable is too short, or runs through a link."""
        bad = self._none.copy()
        if direction is None or self._equipment.loads.kind != "cable":
            return bad
        anchors = self._equipment.loads.anchors
        towards = anchors - self._load[:, None]
        length = np.linalg.norm(towards, axis=2)
        own = np.argmax(np.einsum("nai,ni->na", towards, direction) / np.maximum(length, 1e-9), axis=1)
        bad |= length[np.arange(len(own)), own] < _SHORTEST_CABLE
        for i in range(self._points.shape[1] - 1 - _NEAR_FLANGE):
            bad |= self._between(i, self._load, anchors[own]) < self._radius
        return bad

    def _between(self, i: int, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the distances (N,) of link i from segments [m]."""
        return segment_distance(self._points[:, i], self._points[:, i + 1], start, end)


def segment_distance(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> FloatArray:
    """Return the least distances of segments p q and r s, as in Ericson 2005, 5.1.9.

    Args:
        p: (N, 3) starts of the first.
        q: (N, 3) their ends.
        r: (N, 3) starts of the second.
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
    distance: FloatArray = np.linalg.norm(w + x[:, None] * u - clipped[:, None] * v, axis=1)
    return distance
