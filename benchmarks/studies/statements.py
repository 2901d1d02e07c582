"""Statements about loads: how often clean campaigns are accused, what they cost, and ratios of two campaigns.

Loads hang where chance puts them, within what is stated or assumed; springs balance them exactly, and nothing
here knows the solver's own terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan, sqrt

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import RunResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import SpringArm, plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.comparison.campaigns import (
    Change,
    GaussianEstimate,
    SharedErrors,
    compute_ratio_interval,
    log_stiffness,
)
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["run"]

_STREAM = 97
ASSUMED = CommonUncertainty(load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"}))
STATED = CommonUncertainty(load_point=3e-3, scale=3e-3)
ACCUSING = {"alternative_explains_better", "residuals_exceed_sigma", "links_bend_with_joints"}


@dataclass(frozen=True)
class Pair:
    """Two campaigns and what is the same in both, in truth; a study states it, or states nothing."""

    name: str
    same_postures: bool
    shared: SharedErrors  # errors that are the same
    is_stated: bool = False  # whether the user says so


PAIRS = (
    Pair("nothing stated, another cell and load", same_postures=True, shared=SharedErrors()),
    Pair("the same, in other postures", same_postures=False, shared=SharedErrors()),
    Pair("nothing stated, the same cell and load", True, SharedErrors(load=True, cell=True)),
    Pair("`same_cell`, load hung anew", True, SharedErrors(cell=True), is_stated=True),
    Pair("`same_load` and `same_cell`", True, SharedErrors(load=True, cell=True), is_stated=True),
)
UNCHANGED = 70
"""Pairs of campaigns of one arm, each with six unchanged joints."""
Errors = tuple[FloatArray, float]
"""Error of the load point (3,) [m], and relative error of all forces."""


def _measured(
    arm: SpringArm, postures: int, seed: int, common: CommonUncertainty, errors: Errors, *, sigma: bool
) -> Measurements:
    """Return readings of 14 to 30 pulls whose load hangs off its stated place, and is scaled.

    Args:
        arm: the springs.
        postures: seed of the postures.
        seed: seed of the noise.
        common: standard uncertainties that are stated with the readings.
        errors: errors of the load.
        sigma: whether the noise of the tracker is stated.
    """
    generator = np.random.default_rng([postures, _STREAM])
    count = int(generator.integers(14, 31))
    plan = plan_experiment(arm, configurations=count, load="pull", force=1500.0, seed=postures)
    place, scale = errors
    true = replace(plan, load_points=plan.load_points + place, forces=plan.forces * (1.0 + scale))
    campaign = SpringCampaign.by(arm, true)
    noise = SIGMA * np.random.default_rng([seed, _STREAM, 1]).standard_normal((2, *campaign.loaded.shape))
    read = replace(campaign, experiment=plan).measurements(
        campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=SIGMA if sigma else None
    )
    return replace(read, common_uncertainty=common)


def _draw_errors(seed: int, common: CommonUncertainty) -> Errors:
    """Return errors of the load as chance puts them within what is stated or assumed."""
    generator = np.random.default_rng([seed, _STREAM, 2])
    return common.load_point * generator.standard_normal(3), common.scale * float(generator.standard_normal())


def _identify(measurements: Measurements) -> RunResult:
    return identify_and_judge(robot_of(default_arm()), measurements, RunOptions())


def _is_accused(common: CommonUncertainty, seed: int, *, sigma: bool) -> bool:
    """Return whether a run of clean springs under a load within its statement gives a reason against it."""
    read = _measured(default_arm(), seed, seed, common, _draw_errors(seed, common), sigma=sigma)
    return any(reason.code in ACCUSING for reason in _identify(read).assessment.reasons)


@dataclass(frozen=True)
class _Estimate:
    """Compliance of a joint as a comparison takes it."""

    gaussian: GaussianEstimate
    response: FloatArray  # (3,) change by one standard uncertainty of the load point


def _get_estimates(result: RunResult, shared: SharedErrors) -> list[_Estimate]:
    """Return the estimate of each joint without the errors that cancel."""
    budget = result.budget
    if budget is None:
        raise RuntimeError("the run has no budget")
    estimates = []
    for joint in result.joints:
        place = budget.joints.index(joint.name)
        squares, response = 0.0, np.zeros(3)
        for part in budget.components:
            cancels = shared.cell and part.source == "assumed_force_scale"
            if part.included and not cancels:
                squares += part.contributions[place] ** 2
            if part.responses is not None and shared.load:
                response = np.array(part.responses[place])
        estimates.append(_Estimate(GaussianEstimate(joint.compliance or nan, sqrt(squares), inf), response))
    return estimates


def _identify_pair(pair: Pair, seed: int, arms: Sequence[SpringArm]) -> list[list[_Estimate]]:
    """Return the estimates of both campaigns, whose loads err as chance puts them."""
    postures = (seed, seed if pair.same_postures else 10_000 + seed)
    (place, scale), (other_place, other_scale) = (_draw_errors(2 * seed + i, ASSUMED) for i in range(2))
    place_of_second = place if pair.shared.load else other_place
    scale_of_second = scale if pair.shared.cell else other_scale
    errors = ((place, scale), (place_of_second, scale_of_second))
    stated = pair.shared if pair.is_stated else SharedErrors()
    estimates = []
    for i, arm in enumerate(arms):
        read = _measured(arm, postures[i], 2 * seed + i, ASSUMED, errors[i], sigma=True)
        estimates.append(_get_estimates(_identify(read), stated))
    return estimates


def _compare_ratios(pair: Pair, seed: int) -> list[tuple[bool, float]]:
    """Return for each joint whether the interval of the ratio of two campaigns holds the true ratio.

    Beside the answer is the width of the interval, relative to the true ratio.
    """
    generator, arm = np.random.default_rng([seed, _STREAM, 3]), default_arm()
    worn = replace(arm, stiffnesses=arm.stiffnesses * np.exp(0.2 * generator.uniform(-1.0, 0.0, 6)))
    truth = worn.stiffnesses / arm.stiffnesses
    held = []
    for first, second, ratio in zip(*_identify_pair(pair, seed, (arm, worn)), truth, strict=True):
        one, two = first.gaussian, second.gaussian
        if not (one.standard_uncertainty > 0.0 and two.standard_uncertainty > 0.0):
            continue
        covariance = float(first.response @ second.response)
        interval = compute_ratio_interval(one, two, 0.95, positive=True, covariance=covariance)
        low, high = (nan, nan) if interval is None else (interval.lower or 0.0, interval.upper or inf)
        held.append((low <= ratio <= high, (high - low) / ratio))
    return held


def _list_changed(seed: int) -> list[bool]:
    """Return for each unchanged joint whether a trend says that it changed, with another cell and load."""
    arm = default_arm()
    pair = PAIRS[seed % 2]
    changes = []
    for first, second in zip(*_identify_pair(pair, 20_000 + seed, (arm, arm)), strict=True):
        ends = [
            log_stiffness(each.value, each.standard_uncertainty) for each in (first.gaussian, second.gaussian)
        ]
        if ends[0] is not None and ends[1] is not None:
            changes.append(Change.between(ends[0], ends[1]))
    return [change.is_significant(len(changes)) for change in changes]


def run(*, quick: bool) -> list[Section]:
    """Count accusations of clean campaigns, then ratios of two campaigns that hold the truth."""
    rows, figures = [], list[Figure]()
    for name, common, count in (("assumed", ASSUMED, 45), ("stated", STATED, 30)):
        seeds = range(4 if quick else count)
        accused = [_is_accused(common, seed, sigma=sigma) for seed in seeds for sigma in (True, False)]
        rows.append((f"load point and scale as {name}", f"{sum(accused)} of {len(accused)} accused"))
        what = f"load point and scale drawn as {name}: accused of {len(accused)}"
        figures.append(Figure(what, sum(accused), "at most", 2))
    for pair in PAIRS:
        compared = [each for seed in range(3 if quick else 50) for each in _compare_ratios(pair, seed)]
        held, widths = zip(*compared, strict=True)
        share = 100.0 * float(np.mean(held))
        width = 100.0 * float(np.median(widths))
        rows.append(
            (f"ratios: {pair.name}", f"{share:.1f} % of {len(held)} hold, median width {width:.1f} %")
        )
        figures.append(Figure(f"ratios that hold: {pair.name}", share, "at least", 92.5, " %"))
        if pair.is_stated or pair.shared == SharedErrors():  # what is shared and not stated covers more
            figures.append(Figure(f"ratios that hold: {pair.name}", share, "at most", 97.5, " %"))
    changed = [each for seed in range(3 if quick else UNCHANGED) for each in _list_changed(seed)]
    rows.append(
        ("unchanged joints, another cell and load", f"{sum(changed)} of {len(changed)} called changed")
    )
    share = 100.0 * float(np.mean(changed))
    figures.append(Figure("unchanged joints called changed", share, "at most", 2.0, " %"))
    return [
        Section(
            title="Statements about the load: clean campaigns, and ratios of two",
            columns=("campaigns", "outcome"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                f"14 to 30 pulls of 1500 N, three targets, {1e6 * SIGMA:g} µm; assumed 10 mm and 1 %, stated "
                "3 mm and 0.3 %",
            ),
        )
    ]
