"""Angle about the tool axis along a path: dynamic programming beside constant angle, greedy and evolution.

By name only: it takes some minutes.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from scipy.optimize import Bounds, differential_evolution

from benchmarks.campaigns import default_robot
from benchmarks.report import Figure, Section
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.deflection.paths import PathNodes, ToolAnglePath, best_constant_angle, best_path
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

__all__ = ["run"]

STEPS, ANGLES = 1_000, 72
GENERATIONS = 100
"""A tenth of SciPy's default."""
_TURN = np.radians([4.0, 4.0, 4.0, 12.0, 12.0, 12.0])
"""Greatest change of each joint from step to step [rad]."""
_TOOL = np.array([0.15, 0.0, 0.15])
_TILT = np.array([[1.0, 0.0, 1.0], [0.0, np.sqrt(2.0), 0.0], [-1.0, 0.0, 1.0]]) / np.sqrt(2.0)
"""Axes of a spindle mounted at 45° to the flange, tip at `_TOOL` [m]: its axis is not that of joint 6."""
_NORMAL, _CUT = 300.0, 150.0
"""Force along the tool's axis and across it [N]."""
_PENALTY = 1e-2
"""Cost of a step that no joint limit allows [m], for those who cannot forbid it."""


def run(*, quick: bool) -> list[Section]:
    """Find the angles in four ways."""
    steps, angles, generations = (40, 24, 2) if quick else (STEPS, ANGLES, GENERATIONS)
    start = perf_counter()
    nodes = _nodes(steps, angles)
    prepared = perf_counter() - start
    start = perf_counter()
    path = best_path(nodes)
    programmed = perf_counter() - start
    constant, greedy = best_constant_angle(nodes), _greedy(nodes)
    start = perf_counter()
    evolved = _evolved(nodes, generations)
    evolution = perf_counter() - start
    others = {"best constant angle": _mean(constant), "greedy": greedy, "differential evolution": evolved}
    least = min(others.values())
    return [
        Section(
            title=f"Angle about the tool axis, {steps:,} steps × {angles} angles × all branches",
            columns=("way", "mean deflection along the normal, µm"),
            rows=(
                ("dynamic programming", f"{1e6 * path.mean:.1f}"),
                *((name, f"{1e6 * value:.1f}") for name, value in others.items()),
                ("lower bound", f"{1e6 * path.lower_bound:.1f}"),
            ),
            figures=(
                Figure(
                    "dynamic programming over the best other way", path.mean / least, "at most", 1.0 + 1e-12
                ),
                Figure("its speed beside differential evolution", evolution / programmed, "at least", 20.0),
                Figure(
                    "the same with the inverse kinematics in both",
                    (prepared + evolution) / (prepared + programmed),
                    "at least",
                    20.0,
                ),
            ),
            notes=(
                f"differential evolution: SciPy's, population 1 × steps, {generations} generations, the same "
                "grid, each angle with its cheapest branch; a step beyond the limits costs 10 mm. Its "
                "test of convergence is off, as it takes the plateau of these costs for it at once",
            ),
            data={"mean": path.mean, **others},
        )
    ]


def _mean(path: ToolAnglePath | None) -> float:
    return float("inf") if path is None else path.mean


def _nodes(steps: int, angles: int) -> PathNodes:
    """Postures along a curved path, with the deflection along the tool's axis as their cost."""
    arm = default_arm()
    robot = default_robot(arm)
    poses = _poses(steps, angles)
    joints = _with_turns(InverseKinematics(robot).branches(poses.reshape(-1, 4, 4)))
    limits = robot.limits
    inside = ((limits[:, 0] <= joints) & (joints <= limits[:, 1])).all(axis=-1)
    cost = np.full(inside.shape, np.inf)
    normal = np.repeat((poses.reshape(-1, 4, 4)[:, :3, :3] @ _TILT[:, 2])[:, None], inside.shape[1], axis=1)[
        inside
    ]
    cost[inside] = _deflection(robot, arm.compliances, joints[inside], normal)
    shape = (steps, angles, -1)
    return PathNodes(joints.reshape(*shape, 6), cost.reshape(shape), _TURN * max(1.0, STEPS / steps))


def _with_turns(joints: FloatArray) -> FloatArray:
    """(K, 4 B, 6) the branches, and those with joints 4 and 6 a full turn away, where limits allow it."""
    turned = []
    for fourth in (False, True):
        for sixth in (False, True):
            other = joints.copy()
            for joint, whether in ((3, fourth), (5, sixth)):
                if whether:
                    other[..., joint] -= 2.0 * np.pi * np.sign(other[..., joint])
            turned.append(other)
    return np.concatenate(turned, axis=1)


def _poses(steps: int, angles: int) -> FloatArray:
    """(S, A, 4, 4) poses of the flange whose tool tip follows a wave over a tilted plate."""
    s = np.linspace(0.0, 1.0, steps)
    psi = np.linspace(0.0, 2.0 * np.pi, angles, endpoint=False)
    wave = [1.75 + 0.2 * np.sin(4.0 * np.pi * s), -0.6 + 1.2 * s, 0.7 + 0.1 * np.cos(6.0 * s)]
    tip = np.stack(wave, axis=1)
    tilt = 0.35 * np.stack([np.sin(5.0 * s), np.cos(3.0 * s)], axis=1)
    axis = np.concatenate([tilt, -np.ones((steps, 1))], axis=1)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    across = np.cross(axis, side)
    x = np.cos(psi)[:, None] * side[:, None] + np.sin(psi)[:, None] * across[:, None]
    poses = np.tile(np.eye(4), (steps, angles, 1, 1))
    poses[..., :3, 0], poses[..., :3, 2] = x, axis[:, None]
    poses[..., :3, 1] = np.cross(poses[..., :3, 2], x)
    poses[..., :3, :3] = poses[..., :3, :3] @ _TILT.T
    poses[..., :3, 3] = tip[:, None] - poses[..., :3, :3] @ _TOOL
    return poses


def _deflection(robot: Robot, compliance: FloatArray, q: FloatArray, normal: FloatArray) -> FloatArray:
    """(K,) magnitude of the tip's deflection along the tool's axis (K, 3) under the cut [m]."""
    here = Configurations(robot, q)
    points = here.to_base(np.broadcast_to(_TOOL, (len(q), 1, 3)))
    jacobian = here.jacobian_at(points)[:, 0]
    force = -_NORMAL * normal + _CUT * np.array([0.0, 1.0, 0.0])
    torque = np.einsum("kij,ki->kj", jacobian, force)
    moved = np.einsum("kij,kj->ki", jacobian, compliance * torque)
    along: FloatArray = np.abs((moved * normal).sum(axis=1))
    return along


def _greedy(nodes: PathNodes) -> float:
    """Mean cost of the path that takes the cheapest reachable node at each step; inf if it gets stuck."""
    cost = nodes.cost.reshape(len(nodes.cost), -1)
    joints = nodes.joints.reshape(len(nodes.cost), -1, nodes.joints.shape[3])
    at, total = int(np.argmin(cost[0])), float(cost[0].min())
    for step in range(1, len(cost)):
        near = (np.abs(joints[step] - joints[step - 1, at]) <= nodes.largest_turn).all(axis=1)
        reachable = np.where(near, cost[step], np.inf)
        at = int(np.argmin(reachable))
        total += float(reachable[at])
    return float(total / len(cost))


def _evolved(nodes: PathNodes, generations: int) -> float:
    """Mean cost found by differential evolution over an angle a step, each with its cheapest branch."""
    steps, angles = len(nodes.cost), nodes.cost.shape[1]
    branch = np.argmin(nodes.cost, axis=2)
    cost = np.minimum(np.take_along_axis(nodes.cost, branch[..., None], axis=2)[..., 0], _PENALTY)
    joints = np.take_along_axis(nodes.joints, branch[..., None, None], axis=2)[:, :, 0]
    place = np.arange(steps)

    def mean(x: FloatArray) -> float:
        k = np.minimum(x.astype(np.intp), angles - 1)
        chosen = joints[place, k]
        with np.errstate(invalid="ignore"):
            allowed = (np.abs(np.diff(chosen, axis=0)) <= nodes.largest_turn).all(axis=1)
        return float(cost[place, k].sum() + _PENALTY * np.count_nonzero(~allowed)) / steps

    found = differential_evolution(
        mean,
        Bounds(np.zeros(steps), np.full(steps, float(angles))),
        popsize=1,
        maxiter=generations,
        polish=False,
        tol=0.0,
        seed=0,
        init="random",
    )
    least: float = found.fun
    return least
