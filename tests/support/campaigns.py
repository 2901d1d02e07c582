"""Campaigns for tests: the shared data, our simulator, and what the numerical core makes of them."""

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from support.shared_data import shared as shared

from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.robot import DhModel
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.conversion.robots import build_chain_robot, build_dh_chain
from jointstiff.simulator import TARGETS, SpringArm, default_arm, simulate_campaign
from jointstiff.simulator.equilibrium import deflections, linear_deflections
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.evidence.resampling import MethodStacks, build_method_stacks, refuse_nonlinear
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.chain import KinematicChain
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.urdf import read_urdf

METHODS = ("complete_pose", "partial_pose", "decoupled_partial_pose")
METHODS_AND_WEIGHTS = [
    *((method, weighting) for method in METHODS for weighting in ("covariance", "uniform")),
    ("complete_pose", "characteristic_length"),
]
ARM = default_arm()
POINTS = np.array(list(TARGETS.values()))
SIGMA = 2e-5
"""Standard uncertainty of one coordinate of one reading [m]."""


def prepare(document: dict[str, Any]) -> tuple[Robot, Measurements]:
    """A campaign document as the numerical core takes it; its load point is where it says."""
    campaign = Campaign.model_validate_json(json.dumps(document))
    model = campaign.robot.model
    if isinstance(model, DhModel):
        chain = build_dh_chain(model, campaign.robot.name)
    else:
        chain = read_urdf(model.urdf, model.base, model.flange)
    robot = build_chain_robot(chain, campaign.robot.joint_map, payload=campaign.robot.payload)
    readings = ReadingArrays.from_observations(campaign.measurement_set.observations)
    measurements = to_measurements(campaign.measurement_set, readings, robot)
    stated = measurements.common_uncertainty.stated
    return robot, replace(measurements, common_uncertainty=stated)


def simulated(arm: SpringArm = ARM, **options: Any) -> tuple[Robot, Measurements]:
    """Simulate a campaign on an arm of exact springs."""
    return prepare(simulate_campaign(arm, **options))


def estimate(robot: Robot, measurements: Measurements, **options: Any) -> Estimate:
    """Identify with the options of a run, K_c neglected as in the paper unless they say otherwise."""
    return identify(Rows(robot, measurements), settings_of(robot, **options))


def settings_of(robot: Robot, **options: Any) -> Settings:
    """Settings by the options of a run, K_c neglected as in the paper unless they say otherwise."""
    return Settings.from_options(RunOptions(**{"complementary_stiffness": "neglected"} | options), robot)


def only_deflections(measurements: Measurements) -> Measurements:
    """The same readings without positions: the targets' nominal places on the flange are given."""
    places = np.broadcast_to(np.array(list(TARGETS.values())), measurements.position.shape)
    return replace(measurements, position=places, in_flange=measurements.present)


def first_target(measurements: Measurements) -> Measurements:
    """The readings of the first target alone."""
    names = ("position", "deflection", "in_flange", "present")
    first = {name: getattr(measurements, name)[:, :1] for name in names}
    return replace(measurements, targets=measurements.targets[:1], **first)


def with_targets(measurements: Measurements, present: BoolArray) -> Measurements:
    """The same readings where present (N, T) only; elsewhere they are padding of zeros."""
    holes: dict[str, Any] = {
        name: np.where(present[..., None], getattr(measurements, name), 0.0) for name in _COORDINATES
    }
    return replace(measurements, present=present, **holes)


_COORDINATES = ("position", "deflection")


def straight_wrist(angle: float) -> tuple[Robot, Measurements]:
    """Pulls with joint 5 at ± this angle [rad], by exact springs, without noise."""
    robot, campaign = simulated(load="pull", seed=2)
    q = campaign.joints.copy()
    q[:, 4] = angle * np.where(np.arange(len(q)) % 2, 1, -1)
    unloaded, loaded = deflections(ARM, q, *wrench_of(campaign), POINTS)
    return robot, replace(campaign, joints=q, position=unloaded, deflection=loaded - unloaded)


def twins(robot: Robot, measurements: Measurements, offset: float = 0.0) -> tuple[Robot, Measurements]:
    """The same readings of a robot whose joint 1 has a twin on its axis, or so far beside it [m]."""
    first, *others = robot.chain.joints
    aside = np.array([offset, 0.0, 0.0])
    twin = replace(first, name="twin", child="twin_link", rotation=np.eye(3), translation=aside)
    chain = KinematicChain("twins", robot.chain.base, robot.chain.flange, (first, twin, *others))
    return Robot(chain.model()), replace(measurements, joints=np.insert(measurements.joints, 1, 0.0, axis=1))


def wrench_of(measurements: Measurements) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forces, moments and load points, as the simulator takes them."""
    return measurements.force, measurements.moment, measurements.load_point


def spring_columns(measurements: Measurements) -> FloatArray:
    """(N, T, 3, 6) deflections of the targets by one soft joint each, by the simulator [m / (rad/(N·m))]."""
    soft = (replace(ARM, stiffnesses=np.where(np.arange(6) == j, 1.0, np.inf)) for j in range(6))
    load = (measurements.joints, *wrench_of(measurements), POINTS)
    return np.stack([linear_deflections(arm, *load) for arm in soft], axis=-1)


def covariance_by_moving(
    compliance: Callable[..., FloatArray], **numbers: tuple[FloatArray, float | FloatArray]
) -> FloatArray:
    """Covariance of a linear estimator, ``H Σ Hᵀ``: H by moving one number at a time.

    Args:
        compliance: estimate (n,); arguments take the place of numbers.
        numbers: by the name of the argument, and the standard uncertainty of each.
    """
    moved = []
    for name, (values, uncertainty) in numbers.items():
        step = np.broadcast_to(uncertainty, values.shape)
        for place in np.ndindex(values.shape):
            other = values.copy()
            other[place] += step[place]
            moved.append(compliance(**{name: other}))
    change = np.array(moved) - compliance()
    return np.asarray(change.T @ change)


def assert_covariance(found: FloatArray, expected: FloatArray, *, atol: float) -> None:
    """Compare two covariances as correlations."""
    size = np.sqrt(np.diag(expected)) + 1e-30
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=atol)


def held(joints: Iterable[Any], truth: Iterable[float]) -> list[bool]:
    """Whether the interval of each joint holds its true compliance."""
    pairs = zip(joints, truth, strict=True)
    return [j.compliance_interval[0] <= c <= j.compliance_interval[1] for j, c in pairs]


def blocks_of_set(robot: Robot, measurements: Measurements, settings: Settings) -> MethodStacks:
    """Return the blocks of a method for resampling, after the identification of the full set."""
    refuse_nonlinear(settings)
    if not settings.complementary_stiffness:
        settings = replace(settings, bounds=Bounds.unconstrained(robot.n))
    rows = Rows(robot, measurements)
    return build_method_stacks(rows, settings, identify(rows, settings))
