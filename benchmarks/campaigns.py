"""Campaigns of our own simulator as arrays in SI units, small ones and large ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import (
    TARGETS,
    Document,
    SpringArm,
    experiment_of,
    linear_deflections,
    plan_experiment,
)
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from tests.support.springs import readings_of, robot_of

__all__ = ["LARGE_NOISE", "SIGMA", "Campaign", "default_settings", "large_campaign", "small_campaign"]


SIGMA = 2e-5
"""Standard uncertainty of one coordinate of one reading [m], of a laser tracker."""
LARGE_NOISE = 6e-4
"""Standard uncertainty of a reading [m] that drives least squares below zero in every other campaign."""
FORCE = 1500.0
"""Size of the pull on the flange [N]; its direction is random, so that every joint is twisted."""
_BLOCK = 1_000


@dataclass(frozen=True, eq=False)
class Campaign:
    """A robot of six joints and what was measured on it."""

    robot: Robot
    measurements: Measurements  # of three targets
    document: Document  # the same as the service takes it; empty for large campaigns


def default_settings(robot: Robot) -> Settings:
    """Partial pose, weighted by covariance, positive."""
    return Settings("partial_pose", "covariance", Bounds.positive(robot.n))


def small_campaign(*, sigma: float = SIGMA, seed: int = 0, configurations: int = 19) -> Campaign:
    """A campaign made by springs that balance the load exactly.

    Args:
        sigma: of a coordinate of a reading [m]; large enough, it drives compliances below zero.
        seed: of configurations, loads and noise.
        configurations: how many.
    """
    arm = default_arm()
    document = simulate_campaign(
        arm, configurations=configurations, load="pull", force=FORCE, sigma=sigma, seed=seed
    )
    return Campaign(robot_of(arm), _measurements_of(document), document)


def large_campaign(count: int, *, sigma: float = SIGMA, seed: int = 0) -> Campaign:
    """A campaign of the linear model plus noise, made block by block, so that making it takes no memory.

    Args:
        count: how many configurations.
        sigma: of a coordinate of a reading [m].
        seed: of configurations, loads and noise.
    """
    arm = default_arm()
    shapes = {
        "joints": (count, len(arm.stiffnesses)),
        "force": (count, 3),
        "moment": (count, 3),
        "load_point": (count, 3),
        "position": (count, len(TARGETS), 3),
        "deflection": (count, len(TARGETS), 3),
    }
    arrays = {name: np.empty(shape) for name, shape in shapes.items()}
    for block, start in enumerate(range(0, count, _BLOCK)):
        rows = slice(start, min(start + _BLOCK, count))
        for name, values in _block(arm, rows.stop - start, sigma, seed + block).items():
            arrays[name][rows] = values
    return Campaign(robot_of(arm), readings_of(**arrays, sigma=sigma), {})


def _block(arm: SpringArm, count: int, sigma: float, seed: int) -> dict[str, FloatArray]:
    """Arrays of some configurations, as `Measurements` names them."""
    experiment = plan_experiment(arm, configurations=count, load="pull", force=FORCE, seed=seed)
    points = np.array(list(TARGETS.values()))
    exact = linear_deflections(arm, experiment.joints, *experiment.wrenches, points)
    noise = np.random.default_rng([seed, 10]).standard_normal((2, *exact.shape))
    return {
        "joints": experiment.joints,
        "force": experiment.forces,
        "moment": experiment.moments,
        "load_point": experiment.load_points,
        "position": arm.posture(experiment.joints).targets_to_base(points) + sigma * noise[0],
        "deflection": exact + sigma * (noise[1] - noise[0]),
    }


def _measurements_of(document: Document) -> Measurements:
    """A campaign document in SI units, with its readings as positions, as arrays."""
    experiment = experiment_of(document)
    stored = document["measurement_set"]
    observations: list[dict[str, Any]] = stored["observations"]
    unloaded, loaded = (
        np.array([[reading[which] for reading in o["readings"]] for o in observations])
        for which in ("unloaded", "loaded")
    )
    loads = (experiment.joints, experiment.forces, experiment.load_points)
    sigma = stored["noise"]["sigma"]
    return readings_of(*loads, unloaded, loaded - unloaded, moment=experiment.moments, sigma=sigma)
