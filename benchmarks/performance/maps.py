"""A map of many places beside a loop of Pinocchio calls, place by place, both after inverse kinematics.

By name only: the loop takes some minutes at full size, so a part of it is timed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter

import numpy as np
import pinocchio as pin

from benchmarks.campaigns import default_settings, small_campaign
from benchmarks.report import Figure, Section
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.answers import MapTask, compute_tool_rotations, map_places, map_postures
from jointstiff.solver.predict.models import JointModel

__all__ = ["run"]

PLACES = 100_000
LOOPED = 2_000
"""Places of the loops: their time is proportional to them."""
ROUNDS = 3
BLOCK = 2_000
"""Places mapped at a time, as a step of a map's work does."""
_TOOL = np.array([0.0, 0.0, 0.25])
_FORCE = np.array([0.0, 300.0, -500.0])


def run(*, quick: bool) -> list[Section]:
    """Time the six numbers of each place: displacement, compliance along and across, interval."""
    places, looped = (500, 50) if quick else (PLACES, LOOPED)
    campaign = small_campaign()
    robot, settings = campaign.robot, default_settings(campaign.robot)
    model = JointModel.from_estimate(
        robot, identify(Rows(robot, campaign.measurements), settings), settings.constraints
    )
    task, area = _task(), _area(places)
    inverse = InverseKinematics(robot)
    start = perf_counter()
    whole = [map_places(model, None, task, inverse, area[i : i + BLOCK]) for i in range(0, len(area), BLOCK)]
    with_inverse = (perf_counter() - start) / places
    joints = np.concatenate([part.joints[part.reached] for part in whole])
    ours = partial(_mapped, model, task)
    exact, linear = partial(_loop, model, _exact), partial(_loop, model, _linear)
    some = joints[np.linspace(0, len(joints) - 1, looped).astype(int)]
    near = float(np.abs(ours(some)[:, :5] / exact(some)[:, :5] - 1.0).max())
    times: dict[str, list[float]] = {"map": [], "exact": [], "linear": []}
    for _ in range(ROUNDS):  # in turns, so that a busy moment meets all
        for name, way, where in (("map", ours, joints), ("exact", exact, some), ("linear", linear, some)):
            times[name].append(_seconds(way, where) / len(where))
    map_time, exact_time, linear_time = (median(times[name]) for name in times)
    what = "map after inverse kinematics / Pinocchio place by place, the same exact balance: speed"
    rows = (
        ("map, exact balance, in blocks", 1e6 * map_time, ""),
        ("Pinocchio place by place, exact balance", 1e6 * exact_time, f"{exact_time / map_time:.1f}"),
        ("Pinocchio place by place, linear in the load", 1e6 * linear_time, f"{linear_time / map_time:.1f}"),
        ("map with inverse kinematics and choice of the branch", 1e6 * with_inverse, ""),
    )
    return [
        Section(
            title=f"Map of {places:,} places, {len(joints):,} reached, six numbers each",
            columns=("way", "µs a place", "times the map's"),
            rows=tuple((name, f"{time:.1f}", ratio) for name, time, ratio in rows),
            figures=(Figure(what, exact_time / map_time, "at least", 19.0, "×"),),
            notes=(
                f"numbers of both agree to {near:.1e}; times are medians of {ROUNDS} rounds, in turns",
                f"the loops are timed on {looped:,} of the places",
            ),
            data={"seconds": times},
        )
    ]


def _task() -> MapTask:
    rotation = compute_tool_rotations(np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, -1.0]]), 1)
    force = _FORCE[None]
    wrench = force, 0.0 * force, force / np.linalg.norm(force)
    return MapTask(rotation, *wrench, _TOOL, _TOOL, np.tile([-np.inf, np.inf], (6, 1)), None, 0.95)


def _area(count: int) -> FloatArray:
    generator = np.random.default_rng(5)
    return generator.uniform([0.9, -0.9, 0.2], [2.1, 0.9, 1.4], (count, 3))


def _mapped(model: JointModel, task: MapTask, joints: FloatArray) -> FloatArray:
    """Return the six numbers (P, 6) by blocks."""
    parts = []
    for start in range(0, len(joints), BLOCK):
        block = joints[start : start + BLOCK]
        found = map_postures(model, None, task, np.zeros(len(block), dtype=np.intp), block)
        half = 0.5 * np.ptp(found.readings, axis=1)
        parts.append(np.column_stack([found.displacement, found.along, found.across, half]))
    return np.concatenate(parts)


class _Arm:
    """Pinocchio's model at one posture, as one would write it."""

    def __init__(self, robot: Robot) -> None:
        self.model = robot.model
        self.data = self.model.createData()
        self.placement, self.last = robot.flange_placement, robot.n

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the tool (3,) [m], its Jacobian (3, n), and the axes (3, n), in R0."""
        spatial = pin.computeJointJacobians(self.model, self.data, q)
        tool = (self.data.oMi[self.last] * self.placement).act(_TOOL)
        return tool, spatial[:3] - pin.skew(tool) @ spatial[3:], spatial[3:]


def _loop(
    model: JointModel, way: Callable[[JointModel, _Arm, FloatArray], FloatArray], joints: FloatArray
) -> FloatArray:
    arm = _Arm(model.robot)
    return np.array([way(model, arm, q) for q in model.robot.joint_map.model_angles(joints)])


def _linear(model: JointModel, arm: _Arm, q: FloatArray) -> FloatArray:
    _, J, _ = arm.at(q)
    torque = J.T @ _FORCE
    return _six(model, J @ (model.compliance * torque), J * torque, (J * model.compliance) @ J.T)


def _exact(model: JointModel, arm: _Arm, q: FloatArray) -> FloatArray:
    before, _, _ = arm.at(q)
    turn, n = np.zeros(len(q)), len(q)
    while True:
        tool, J, axes = arm.at(q + turn)
        torque = J.T @ _FORCE
        by_force = (pin.skew(_FORCE) @ axes).T @ J
        stiffness = np.triu(by_force) + np.triu(by_force, 1).T
        slope = np.eye(n) - model.compliance[:, None] * stiffness
        residual = turn - model.compliance * torque
        if np.abs(residual).max() < 1e-15:
            break
        turn = turn - np.linalg.solve(slope, residual)
    softened = np.linalg.inv(slope)
    return _six(model, tool - before, J @ (softened * torque), (J @ softened * model.compliance) @ J.T)


def _six(model: JointModel, moved: FloatArray, rows: FloatArray, compliance: FloatArray) -> FloatArray:
    u = _FORCE / np.linalg.norm(_FORCE)
    across = np.eye(3) - np.outer(u, u)
    along = (moved / np.linalg.norm(moved)) @ rows
    half = model.quantile(0.95) * np.sqrt(along @ model.covariance @ along)
    symmetric = 0.5 * (compliance + compliance.T)
    greatest = np.linalg.eigvalsh(across @ symmetric @ across)[-1]
    return np.array([*moved, u @ compliance @ u, greatest, half])


def _seconds(way: Callable[[FloatArray], FloatArray], joints: FloatArray) -> float:
    start = perf_counter()
    way(joints)
    return perf_counter() - start
