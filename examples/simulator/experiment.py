"""Simulated experiment: configurations, wrenches, targets, and noise of the tracker.

Units are SI (m, rad, N, N·m); axes of R0 unless it says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, SpringArm
from jointstiff.simulator.equilibrium import deflections

__all__ = [
    "LOAD_POINT",
    "TARGETS",
    "Experiment",
    "Load",
    "Targets",
    "default_targets",
    "plan_experiment",
    "random_configurations",
    "simulate_positions",
]

Load = Literal["dead_weight", "pull"]
Targets = Mapping[str, Sequence[float]]  # positions in the flange frame [m] by name

LOAD_POINT = (-0.06, 0.02, 0.18)  # in the flange frame [m]

# Each kind of draw has a stream of its own, so that a seed keeps its configurations when the noise
# changes.
CONFIGURATION_STREAM, FORCE_STREAM, MOMENT_STREAM, NOISE_STREAM = range(4)
SHARE_OF_LIMITS = 0.5
ANGLE_DECIMALS = 4  # angles without load are whole multiples of 1e-4 rad, so that files stay short
DIRECTION_DECIMALS = 6  # random directions are rounded: their length is 1 to about 1e-6


@dataclass(frozen=True, eq=False)
class Experiment:
    """Configurations and loads of N observations."""

    joints: FloatArray  #: Joint positions without load [rad, of joints that slide m], (N, n)
    forces: FloatArray  #: Force on the robot [N], axes of R0, (N, 3)
    moments: FloatArray  #: Moment on the robot about the load point [N·m], axes of R0, (N, 3)
    load_points: FloatArray  #: Where the force acts, in the flange frame [m], (N, 3)
    slides: ArrayLike = False  #: Which joints slide, (n,)

    @property
    def wrenches(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces, moments and load points, in the order `jointstiff.simulator.equilibrium` takes them."""
        return self.forces, self.moments, self.load_points


def default_targets(count: int = 3) -> dict[str, tuple[float, float, float]]:
    """Targets P10, P11, ... on a ring in front of the flange, at different heights: never in line.

    Args:
        count: How many.

    Returns:
        Positions in the flange frame [m] by name.
    """
    angles = 0.4 + 2.0 * np.pi * np.arange(count) / max(count, 3)
    ring = np.round([0.16 * np.cos(angles), 0.14 * np.sin(angles)], 3)
    return {
        f"P{10 + i}": (float(ring[0, i]), float(ring[1, i]), (50 + 35 * (i % 3)) / 1000.0)
        for i in range(count)
    }


TARGETS: Targets = MappingProxyType(default_targets())


def random_configurations(arm: SpringArm, count: int, seed: int = 0) -> FloatArray:
    """Draw joint angles evenly from the middle half of each joint's range.

    Args:
        arm: The arm.
        count: How many configurations, N.
        seed: Seed; more configurations from the same seed begin with the same ones.

    Returns:
        Joint angles [rad], (N, n).
    """
    middle, half_range = arm.limits.mean(axis=1), np.ptp(arm.limits, axis=1) / 2.0
    draws = np.random.default_rng([seed, CONFIGURATION_STREAM]).uniform(
        -SHARE_OF_LIMITS, SHARE_OF_LIMITS, (count, len(middle))
    )
    joints: FloatArray = np.round(middle + half_range * draws, ANGLE_DECIMALS)
    return joints


def plan_experiment(
    arm: SpringArm,
    *,
    configurations: int = 19,
    load: Load = "dead_weight",
    force: float = 1500.0,
    moment: float = 0.0,
    load_point: ArrayLike = LOAD_POINT,
    seed: int = 0,
) -> Experiment:
    """Draw the configurations and wrenches of a campaign.

    Args:
        arm: The arm.
        configurations: How many configurations, N.
        load: A dead weight pulls along −z of R0, a pull in a random direction for each
            configuration.
        force: Size of the force [N].
        moment: Size of the moment about the load point [N·m]; its direction is random in either
            case.
        load_point: Where the force acts, in the flange frame [m]: (3,), or (N, 3) one by one.
        seed: Seed.
    """
    if load == "dead_weight":
        directions = np.tile([0.0, 0.0, -1.0], (configurations, 1))
    else:
        directions = _random_directions(configurations, [seed, FORCE_STREAM])
    return Experiment(
        joints=random_configurations(arm, configurations, seed),
        forces=force * directions,
        moments=moment * _random_directions(configurations, [seed, MOMENT_STREAM]),
        load_points=np.broadcast_to(np.asarray(load_point, dtype=float), (configurations, 3)),
        slides=np.isin(np.arange(len(arm.stiffnesses)), arm.prismatic),
    )


def simulate_positions(
    arm: SpringArm, experiment: Experiment, targets: Targets, *, sigma: float = 0.0, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Positions of the targets as the tracker reads them, without load and with it.

    With noise, readings are rounded to a power of ten not above sigma/100 (0.1 µm for 20 µm), which
    adds a millionth to the variance.

    Args:
        arm: The arm.
        experiment: Its configurations and loads, N of them.
        targets: T targets in the flange frame [m].
        sigma: Standard deviation of each coordinate of each position [m]; 0 for exact positions.
        seed: Seed of the noise; the same draws are scaled by sigma.

    Returns:
        Unloaded and loaded positions in R0 [m], each (N, T, 3).

    Raises:
        EquilibriumError: The load is too large for the arm.
    """
    points = np.array(list(targets.values()), dtype=float)
    unloaded, loaded = deflections(arm, experiment.joints, *experiment.wrenches, points)
    if sigma == 0.0:
        return unloaded, loaded
    draws = np.random.default_rng([seed, NOISE_STREAM]).standard_normal((2, *unloaded.shape))
    decimals = -int(np.floor(np.log10(sigma / 100.0)))
    read = np.round(np.stack([unloaded, loaded]) + sigma * draws, decimals)
    return read[0], read[1]


def _random_directions(count: int, seed: list[int]) -> FloatArray:
    """Directions drawn evenly from the sphere, (N, 3)."""
    draws = np.random.default_rng(seed).standard_normal((count, 3))
    directions: FloatArray = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    return directions.round(DIRECTION_DECIMALS)
