"""Files of readings in 30 layouts, and tables in which nothing is right; kinematics of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointstiff.service.conversion.catalogue import catalogue

__all__ = ["LAYOUTS", "NOTHING_RIGHT", "Campaign", "Layout", "simulate"]

Array = NDArray[np.float64]
Tables = Mapping[str, Array]
Generator = np.random.Generator
_PLACE_ERROR = 0.7e-3  # of a link [m]
_ANGLE_ERROR = 0.5e-3  # of a link and of the zero of a joint [rad]
_NOISE = 2e-5  # of a coordinate [m]
_LIMIT = np.radians(110.0)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Readings of an arm with errors of its links."""

    arm: str
    joints: Array  # (N, 6) as the controller shows them [deg]
    unloaded: Array  # (N, K, 3) in R0 [m]
    loaded: Array  # (N, K, 3)
    commanded: Array  # (N, 6) place of the flange by the nominal arm [mm], and angles [deg]
    generator: Generator


@dataclass(frozen=True)
class Layout:
    """Tables, and what is right of them."""

    tables: Tables
    columns: tuple[int, ...] = (0, 1, 2, 3, 4, 5)  # joints from base to flange, in the first table
    unit: str = "deg"
    length: str = "mm"
    points: Mapping[str, tuple[tuple[int, int, int], ...]] = field(default_factory=dict)
    order: str = "rows"
    count: int = 1  # rows of a posture
    counting: Array | None = None  # own counting times this matrix
    twin: Layout | None = None  # another meaning, which is right by an arm that is its own mirror image


def _place(rows: Array, convention: str, q: Array) -> tuple[Array, Array]:
    """Return rotations and places of the flange by Denavit and Hartenberg's parameters [m, rad]."""
    whole = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for (a, alpha, d, theta), angle in zip(rows, q.T, strict=True):
        c, s = np.cos(theta + angle), np.sin(theta + angle)
        turn = np.zeros((len(q), 4, 4))
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = c, -s, s, c
        turn[:, 2, 2] = turn[:, 3, 3] = 1.0
        turn[:, 2, 3] = d
        ca, sa = np.cos(alpha), np.sin(alpha)
        link = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1.0]])
        whole = whole @ turn @ link if convention == "standard" else whole @ link @ turn
    return whole[:, :3, :3], whole[:, :3, 3]


def simulate(name: str, seed: int, postures: int = 16, targets: int = 3) -> Campaign:
    """Simulate readings of an arm of the catalogue, whose links differ from the published ones."""
    generator = np.random.default_rng([seed, sum(map(ord, name))])
    arm = next(each for each in catalogue().arms if each.name == name)
    rows = np.array([(row.a, row.alpha, row.d, row.theta) for row in arm.model.rows])
    matrix = np.eye(6) if arm.joint_map is None else np.array(arm.joint_map.matrix)
    error = generator.standard_normal(rows.shape) * [_PLACE_ERROR, _ANGLE_ERROR, _PLACE_ERROR, _ANGLE_ERROR]
    model = generator.uniform(-0.6, 0.6, (postures, 6)) * _LIMIT
    model[:, 4] += np.sign(model[:, 4]) * 0.2
    controller = np.linalg.solve(matrix, model.T).T
    R, d = _place(rows + error, arm.model.convention, model)
    R0, d0 = _place(rows, arm.model.convention, model)
    places = generator.uniform(-0.25, 0.25, (targets, 3)) + np.array([0.0, 0.0, 0.15])
    unloaded = np.einsum("nij,kj->nki", R, places) + d[:, None]
    twist = 4e-4 * generator.standard_normal((postures, 3)) + [0, 3e-4, 0]
    sag = np.cross(twist[:, None], unloaded) - [0.0, 0.0, 3e-4]
    noise = _NOISE * generator.standard_normal((2, *unloaded.shape))
    angles = np.degrees(
        np.stack(
            [
                np.arctan2(R0[:, 2, 1], R0[:, 2, 2]),
                -np.arcsin(np.clip(R0[:, 2, 0], -1, 1)),
                np.arctan2(R0[:, 1, 0], R0[:, 0, 0]),
            ],
            1,
        )
    )
    commanded = np.hstack([1e3 * d0, angles])
    return Campaign(
        name, np.degrees(controller), unloaded + noise[0], unloaded + sag + noise[1], commanded, generator
    )


def _wide(*blocks: NDArray[Any]) -> Array:
    return np.hstack([block.reshape(len(block), -1) for block in blocks])


def _triples(start: int, count: int, step: int = 3) -> tuple[tuple[int, int, int], ...]:
    return tuple((start + step * i, start + step * i + 1, start + step * i + 2) for i in range(count))


def _turned(campaign: Campaign, points: Array) -> Array:
    """Return points in the frame of a tracker that stands elsewhere."""
    generator = np.random.default_rng(int(1e6 * abs(campaign.joints[0, 0])))
    turn, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    turn = turn * np.sign(np.linalg.det(turn))
    return np.asarray((points - [2.0, 3.0, 0.4]) @ turn.T)


def _states(c: Campaign) -> Array:
    return np.stack([c.unloaded, c.loaded], axis=2)  # (N, K, 2, 3)


def wide_mm(c: Campaign) -> Layout:
    return Layout({"a": _wide(c.joints, 1e3 * _states(c))}, points={"a": _triples(6, 6)})


def wide_rad_m(c: Campaign) -> Layout:
    return Layout(
        {"a": _wide(np.radians(c.joints), _states(c))}, unit="rad", length="m", points={"a": _triples(6, 6)}
    )


def tracker_frame(c: Campaign) -> Layout:
    return Layout({"a": _wide(c.joints, 1e3 * _turned(c, _states(c)))}, points={"a": _triples(6, 6)})


def inches(c: Campaign) -> Layout:
    return Layout({"a": _wide(c.joints, _states(c) / 0.0254)}, length="in", points={"a": _triples(6, 6)})


def centimetres(c: Campaign) -> Layout:
    return Layout(
        {"a": _wide(c.joints, 100 * _turned(c, _states(c)))}, length="cm", points={"a": _triples(6, 6)}
    )


def points_first(c: Campaign) -> Layout:
    return Layout(
        {"a": _wide(1e3 * _states(c), c.joints)}, columns=tuple(range(18, 24)), points={"a": _triples(0, 6)}
    )


def joints_reversed(c: Campaign) -> Layout:
    return Layout(
        {"a": _wide(c.joints[:, ::-1], 1e3 * c.unloaded)},
        columns=(5, 4, 3, 2, 1, 0),
        points={"a": _triples(6, 3)},
    )


def third_from_horizontal(c: Campaign) -> Layout:
    coupled = np.eye(6)
    coupled[2, 1] = -1.0
    joints = c.joints @ np.linalg.inv(coupled).T
    return Layout({"a": _wide(joints, 1e3 * c.unloaded)}, points={"a": _triples(6, 3)}, counting=coupled)


def with_commanded(c: Campaign) -> Layout:
    time = np.arange(len(c.joints))[:, None] * 61.5 + 1700.0
    warm = 21 + 0.1 * c.generator.standard_normal((len(c.joints), 1))
    return Layout(
        {"a": _wide(time, c.commanded, c.joints, warm, 1e3 * _turned(c, c.unloaded))},
        columns=tuple(range(7, 13)),
        points={"a": _triples(14, 3)},
    )


def with_deviations(c: Campaign) -> Layout:
    sd = np.abs(c.generator.normal(0.01, 0.003, (len(c.joints), 6)))
    u, v = 1e3 * c.unloaded[:, 0], 1e3 * c.loaded[:, 0]
    woven = np.stack([np.hstack([u, v]), sd], axis=2).reshape(len(u), -1)
    return Layout({"a": _wide(c.joints, woven)}, points={"a": ((6, 8, 10), (12, 14, 16))})


def two_files(c: Campaign) -> Layout:
    return Layout({"a": c.joints, "b": 1e3 * c.unloaded[:, 0]}, points={"b": ((0, 1, 2),)})


def three_files(c: Campaign) -> Layout:
    points = {f"p{k}": 1e3 * _turned(c, c.unloaded[:, k]) for k in range(3)}
    return Layout({"a": c.joints, **points}, points=dict.fromkeys(points, ((0, 1, 2),)))


def in_turn(c: Campaign) -> Layout:
    return Layout(
        {"a": c.joints, "b": 1e3 * _turned(c, c.unloaded).reshape(-1, 3)},
        points={"b": ((0, 1, 2),)},
        order="in turn",
        count=3,
    )


def in_blocks(c: Campaign) -> Layout:
    rows = 1e3 * _turned(c, c.unloaded).transpose(1, 0, 2).reshape(-1, 3)
    return Layout({"a": c.joints, "b": rows}, points={"b": ((0, 1, 2),)}, order="in blocks", count=3)


def states_in_blocks(c: Campaign) -> Layout:
    rows = 1e3 * np.vstack([c.unloaded[:, 0], c.loaded[:, 0]])
    return Layout({"a": c.joints, "b": rows}, points={"b": ((0, 1, 2),)}, order="in blocks", count=2)


def row_each_target(c: Campaign) -> Layout:
    joints = np.repeat(c.joints, 3, axis=0)
    return Layout(
        {"a": _wide(joints, 1e3 * c.unloaded.reshape(-1, 3))},
        points={"a": ((6, 7, 8),)},
        order="in turn",
        count=3,
    )


def row_each_state(c: Campaign) -> Layout:
    joints = np.repeat(c.joints, 2, axis=0)
    return Layout(
        {"a": _wide(joints, 1e3 * _states(c)[:, 0].reshape(-1, 3))},
        points={"a": ((6, 7, 8),)},
        order="in turn",
        count=2,
    )


def blocks_of_states(c: Campaign) -> Layout:
    rows = np.vstack([_wide(c.joints, 1e3 * c.unloaded), _wide(c.joints, 1e3 * c.loaded)])
    return Layout({"a": rows}, points={"a": _triples(6, 3)}, order="in blocks", count=2)


def sentinels(c: Campaign) -> Layout:
    points = 1e3 * _states(c)[:, :2].reshape(len(c.joints), -1)
    points[c.generator.choice(len(points), 2, replace=False)] = -9999.0
    return Layout({"a": _wide(c.joints, points)}, points={"a": _triples(6, 4)})


def mistyped_angle(c: Campaign) -> Layout:
    joints = c.joints.copy()
    joints[c.generator.integers(len(joints)), 1] += 10.0
    return Layout({"a": _wide(joints, 1e3 * c.unloaded)}, points={"a": _triples(6, 3)})


def empty_cells(c: Campaign) -> Layout:
    points = 1e3 * c.unloaded.reshape(len(c.joints), -1)
    points[c.generator.choice(len(points), 3, replace=False)] = np.nan
    return Layout({"a": _wide(c.joints, points)}, points={"a": _triples(6, 3)})


def rounded(c: Campaign) -> Layout:
    return Layout(
        {"a": _wide(np.round(c.joints, 2), np.round(1e3 * _states(c), 1))}, points={"a": _triples(6, 6)}
    )


def one_target(c: Campaign) -> Layout:
    return Layout(
        {"a": _wide(np.arange(len(c.joints))[:, None] + 1.0, c.joints, 1e3 * _states(c)[:, 0])},
        columns=(1, 2, 3, 4, 5, 6),
        points={"a": _triples(7, 2)},
    )


def with_torques(c: Campaign) -> Layout:
    torque = 400 * c.generator.standard_normal((len(c.joints), 6))
    speed = 1e-3 * c.generator.standard_normal((len(c.joints), 6))
    return Layout({"a": _wide(c.joints, speed, torque, 1e3 * c.unloaded)}, points={"a": _triples(18, 3)})


def external_axis(c: Campaign) -> Layout:
    rail = np.full((len(c.joints), 1), 1200.0)
    quaternion = c.generator.standard_normal((len(c.joints), 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return Layout(
        {"a": _wide(c.joints, rail, 1e3 * c.unloaded[:, :1], quaternion)}, points={"a": _triples(7, 1)}
    )


def with_forces(c: Campaign) -> Layout:
    force = np.array([0, 0, -1500.0]) + 40 * c.generator.standard_normal((len(c.joints), 3))
    return Layout({"a": _wide(c.joints, force, 1e3 * _states(c))}, points={"a": _triples(9, 6)})


def deflections_beside(c: Campaign) -> Layout:
    moved = 1e3 * (c.loaded - c.unloaded)
    return Layout(
        {"a": _wide(c.joints, 1e3 * c.unloaded[:, 0], moved[:, 0], 1e3 * c.unloaded[:, 1], moved[:, 1])},
        points={"a": ((6, 7, 8), (12, 13, 14))},
    )


def kuka_signs(c: Campaign) -> Layout:
    signs = np.diag([-1.0, 1, 1, -1, 1, -1])
    return Layout(
        {"a": _wide(c.joints @ signs, 1e3 * c.unloaded)}, points={"a": _triples(6, 3)}, counting=signs
    )


def exchanged_axes(c: Campaign) -> Layout:
    tables = {"a": _wide(c.joints, 1e3 * c.unloaded[..., ::-1])}
    signs = np.diag([-1.0, 1, 1, -1, 1, -1])
    twin = Layout(tables, points={"a": _triples(6, 3)}, counting=signs)
    return Layout(tables, points={"a": ((8, 7, 6), (11, 10, 9), (14, 13, 12))}, twin=twin)


def two_damaged(c: Campaign) -> Layout:
    points = 1e3 * c.unloaded.reshape(len(c.joints), -1)
    rows = c.generator.choice(len(points), 2, replace=False)
    points[rows] = 1e3 * c.generator.uniform(-2, 2, (2, points.shape[1]))
    return Layout({"a": _wide(c.joints, points)}, points={"a": _triples(6, 3)})


LAYOUTS: tuple[Callable[[Campaign], Layout], ...] = (
    wide_mm,
    wide_rad_m,
    tracker_frame,
    inches,
    centimetres,
    points_first,
    joints_reversed,
    third_from_horizontal,
    with_commanded,
    with_deviations,
    two_files,
    three_files,
    in_turn,
    in_blocks,
    states_in_blocks,
    row_each_target,
    row_each_state,
    blocks_of_states,
    sentinels,
    mistyped_angle,
    empty_cells,
    rounded,
    one_target,
    with_torques,
    external_axis,
    with_forces,
    deflections_beside,
    kuka_signs,
    exchanged_axes,
    two_damaged,
)


def _shuffled(c: Campaign) -> Tables:
    return _pair(c.joints, _points(c)[c.generator.permutation(len(c.joints))])


def _rolled(c: Campaign) -> Tables:
    return _pair(c.joints, np.roll(_points(c), 1, axis=0))


def _random_points(c: Campaign) -> Tables:
    return _pair(c.joints, c.generator.uniform(-1500, 1500, _points(c).shape))


def _random_joints(c: Campaign) -> Tables:
    return _pair(c.generator.uniform(-90, 90, c.joints.shape), _points(c))


def _exchanged(c: Campaign) -> Tables:
    return _pair(c.joints[:, [0, 1, 2, 4, 3, 5]], _points(c))


def _reversed_third(c: Campaign) -> Tables:
    return _pair(c.joints * [1, 1, -1, 1, 1, 1], _points(c))


def _longer(c: Campaign) -> Tables:
    return _pair(c.joints, 1.1 * _points(c))


def _computed(c: Campaign) -> Tables:
    return _pair(c.joints, c.commanded[:, :3])


def _points(c: Campaign) -> Array:
    return 1e3 * c.unloaded.reshape(len(c.joints), -1)


def _pair(joints: Array, points: Array) -> Tables:
    return {"a": _wide(joints, points)}


NOTHING_RIGHT: Mapping[str, Callable[[Campaign], Tables]] = {
    "rows shuffled": _shuffled,
    "rows rolled": _rolled,
    "random points": _random_points,
    "random joints": _random_joints,
    "J4 and J5 exchanged": _exchanged,
    "sign of J3": _reversed_third,
    "points times 1.1": _longer,
    "positions by the controller": _computed,
}
"""Kind of table in which no columns are right → function that makes it of a campaign."""
