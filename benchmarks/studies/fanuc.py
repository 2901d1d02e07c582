"""Ten of thirty real configurations, again and again: how often does a fit give a negative stiffness?

The readings are no part of this project; where they are not beside the checkout, a note says so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.campaigns import blocks_of_set
from benchmarks.report import Figure, Section
from jointstiff.schemas.robot import DhModel
from jointstiff.schemas.run import Campaign, ResamplingResult
from jointstiff.service.conversion.readings import ReadingArrays, to_measurements
from jointstiff.service.conversion.robots import dh_kinematics, robot_of_chain
from jointstiff.solver.convex.solution import Bounds
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.resampling import (
    GramBlocks,
    ResamplingPlan,
    resample,
    summarise,
)
from jointstiff.solver.robot.model import Robot

__all__ = ["CAMPAIGN", "prepared", "run"]

CAMPAIGN = Path(__file__).parents[3] / "shared" / "data" / "fanuc_r2000ic" / "campaign.json"
DRAWN = 10
PLANS = ((2_000, 2017), (100_000, 0))
"""Repetitions and seed: those that the figure is about, and many more."""
_TITLE = f"FANUC R-2000iC, real readings: {DRAWN} of 30 configurations, partial pose"


def run(*, quick: bool) -> list[Section]:
    """Resample without and with constraints."""
    if not CAMPAIGN.is_file():
        note = "nothing done: the shared data are not beside this checkout (../shared/data)"
        return [Section(_TITLE, ("absent",), (), notes=(note,))]
    robot, measurements = prepared(CAMPAIGN)
    settings = Settings("partial_pose", "covariance", Bounds.unconstrained(robot.n))
    blocks = blocks_of_set(robot, measurements, settings)
    plans = [ResamplingPlan(DRAWN, 100 if quick else count, seed) for count, seed in PLANS]
    found = [_summaries(blocks, plan, robot.joint_names) for plan in plans]
    return [
        Section(
            title=_TITLE,
            columns=("draws, seed", "any negative", "compensation", *(f"k{j + 1}" for j in range(robot.n))),
            rows=tuple(row for plan, both in zip(plans, found, strict=True) for row in _rows(plan, both)),
            figures=_figures(*found[0]),
            notes=(
                "compensation: mean & standard deviation over the draws, on all 30 configurations",
                "k: mean & standard deviation of the finite stiffnesses, 10⁶ N·m/rad",
            ),
        )
    ]


def prepared(path: Path) -> tuple[Robot, Measurements]:
    """A campaign file whose robot is a DH table, as the solver takes it.

    Raises:
        TypeError: the robot is a URDF.
    """
    campaign = Campaign.model_validate(json.loads(path.read_text(encoding="utf-8")))
    model = campaign.robot.model
    if not isinstance(model, DhModel):
        raise TypeError(f"{path.name}: the robot is no DH table")
    robot = robot_of_chain(dh_kinematics(model, campaign.robot.name), campaign.robot.joint_map)
    readings = ReadingArrays.from_observations(campaign.measurement_set.observations)
    return robot, to_measurements(campaign.measurement_set, readings, robot)


def _summaries(
    blocks: GramBlocks, plan: ResamplingPlan, names: Sequence[str]
) -> tuple[ResamplingResult, ResamplingResult]:
    """Compare fits without and with constraints."""
    free, positive = Bounds.unconstrained(len(names)), Bounds.positive(len(names))
    return summarise(resample(blocks, plan, free), names), summarise(resample(blocks, plan, positive), names)


def _rows(plan: ResamplingPlan, both: Sequence[ResamplingResult]) -> Iterator[tuple[str, ...]]:
    for name, summary in zip(("unconstrained", "positive"), both, strict=True):
        yield (
            f"{plan.repetitions:,}, {plan.seed}\n{name}",
            f"{100 * summary.share_any_negative:.2f} %",
            "{:.2f}\n& {:.2f} %".format(
                *100 * np.array([summary.compensation.mean, summary.compensation.deviation], dtype=np.float64)
            ),
            *(
                f"{mean / 1e6:.3g}\n& {deviation / 1e6:.2g}"
                for mean, deviation in np.array(
                    [(joint.stiffness_mean, joint.stiffness_deviation) for joint in summary.joints],
                    dtype=np.float64,
                )
            ),
        )


def _figures(free: ResamplingResult, positive: ResamplingResult) -> tuple[Figure, ...]:
    negative = 100 * free.share_any_negative
    gained = 100 * ((positive.compensation.mean or 0.0) - (free.compensation.mean or 0.0))
    return (
        Figure("FANUC, unconstrained: fits with a negative stiffness", negative, "at least", 10, " %"),
        Figure("FANUC, unconstrained: fits with a negative stiffness", negative, "at most", 14, " %"),
        Figure("FANUC, positive: fits with a negative stiffness", positive.share_any_negative, "at most", 0),
        Figure("FANUC, compensation on all 30: positive less unconstrained", gained, "at least", 0, " %"),
    )
