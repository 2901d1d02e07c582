"""Ways to identify, resampled on many arms: the paper's comparison of methods as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.campaigns import blocks_of_set, default_robot
from benchmarks.studies.replicas import Imperfections, read
from jointstiff.schemas.options import Method, Weighting
from jointstiff.schemas.run import ResamplingResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import Encoders
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.solution import Bounds
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.resampling import (
    GramBlocks,
    ResamplingPlan,
    resample,
    summarise,
)

__all__ = [
    "DRAWN",
    "FREE",
    "POSITIVE",
    "SEED",
    "WAYS",
    "Many",
    "Way",
    "blocks_of",
    "condition_of_raw_columns",
    "over_arms",
    "resampled",
]


DRAWN, SEED = 10, 0
_ROBOT = default_robot(default_arm())
FREE, POSITIVE = Bounds.unconstrained(_ROBOT.n), Bounds.positive(_ROBOT.n)


@dataclass(frozen=True)
class Way:
    """One way to identify.

    Attributes:
        name: in a table.
        method: see method.md §4.
        weighting: of the complete pose.
        length: the characteristic length [m]; None for that of least condition number.
    """

    name: str
    method: Method
    weighting: Weighting = "covariance"
    length: float | None = None


WAYS = (
    Way("CP, best L", "complete_pose", "characteristic_length"),
    Way("CP, L = 10 m", "complete_pose", "characteristic_length", 10.0),
    Way("CP, cov.", "complete_pose"),
    Way("PP", "partial_pose"),
    Way("DPP", "decoupled_partial_pose"),
)


@dataclass(frozen=True, eq=False)
class Many:
    """Results of resampling for each of several arms and ways to identify.

    Attributes:
        compensation: (arms, ways) mean compensation on all configurations, unconstrained.
        negative: (arms, ways) share of draws with a negative stiffness, unconstrained.
        deviation: (arms, ways, n) standard deviation of a compliance over the draws relative to its mean,
            unconstrained; NaN for joints that do not show.
        negative_if_positive: greatest share of draws with a negative stiffness under constraints.
    """

    compensation: FloatArray
    negative: FloatArray
    deviation: FloatArray
    negative_if_positive: float


def blocks_of(measurements: Measurements, way: Way) -> GramBlocks:
    """A campaign as resampling takes it."""
    settings = Settings(way.method, way.weighting, FREE, characteristic_length=way.length)
    return blocks_of_set(_ROBOT, measurements, settings)


def resampled(blocks: GramBlocks, bounds: Bounds, repetitions: int) -> ResamplingResult:
    """10 of 19, again and again."""
    draws = resample(blocks, ResamplingPlan(DRAWN, repetitions, SEED), bounds)
    return summarise(draws, _ROBOT.joint_names)


def _relative_deviation(found: ResamplingResult) -> FloatArray:
    means = np.array([joint.compliance_mean for joint in found.joints], dtype=np.float64)
    deviations = np.array([joint.compliance_deviation for joint in found.joints], dtype=np.float64)
    return np.asarray(deviations / means)


def over_arms(
    encoders: Encoders, wrong: Imperfections, ways: Sequence[Way], arms: int, repetitions: int
) -> Many:
    """Resample many arms, each wrong in directions of its own, in configurations of its own."""
    free, negative = [], []
    for seed in range(arms):
        measurements = read(encoders, wrong, seed=seed)
        blocks = [blocks_of(measurements, way) for way in ways]
        free.append([resampled(of_way, FREE, repetitions) for of_way in blocks])
        negative += [resampled(of_way, POSITIVE, repetitions).share_any_negative for of_way in blocks]
    return Many(
        compensation=np.array([[found.compensation.mean for found in row] for row in free], dtype=np.float64),
        negative=np.array([[found.share_any_negative for found in row] for row in free]),
        deviation=np.array([[_relative_deviation(found) for found in row] for row in free]),
        negative_if_positive=max(negative),
    )


def condition_of_raw_columns(measurements: Measurements, length: float) -> float:
    """Condition number of the complete pose's regressor, columns as they come, not brought to unit norm.

    Args:
        measurements: a campaign.
        length: characteristic length [m].
    """
    way = Way("", "complete_pose", "characteristic_length", length)
    (stage,) = blocks_of(measurements, way).stages
    raw = stage.rows[..., :-1].reshape(-1, len(stage.joints)) / stage.unit
    return float(np.linalg.cond(raw))
