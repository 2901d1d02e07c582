"""Statements about loads: how often clean campaigns are accused, what they cost, and ratios of two campaigns.

Loads hang where chance puts them, within what is stated or assumed; springs balance them exactly, and nothing
here knows the solver's own terms.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import RunResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import SpringArm, plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.comparison.campaigns import GaussianEstimate, compute_ratio_interval
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["run"]

_STREAM = 97
ASSUMED = CommonUncertainty(load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"}))
STATED = CommonUncertainty(load_point=3e-3, scale=3e-3)
ACCUSING = {"alternative_explains_better", "residuals_exceed_sigma", "links_bend_with_joints"}
PAIRS = {"same postures, load left hanging": (True, True), "other postures": (False, True)}
PAIRS["load hung anew"] = (True, False)
SHARED = "same postures, `same_load_point`"
PAIRS[SHARED] = (True, True)
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


def _get_estimates(result: RunResult) -> list[tuple[GaussianEstimate, FloatArray]]:
    """Return each joint's compliance as a comparison takes it: the scale of one load cell cancels.

    Beside each compliance are its changes (3,) by one standard uncertainty of the load point.
    """
    estimates = []
    for joint in result.joints:
        parts = [] if result.budget is None else result.budget.components
        squares = [
            part.contributions[result.budget.joints.index(joint.name)] ** 2
            for part in parts
            if part.included and part.source != "assumed_force_scale"
            if result.budget is not None and joint.name in result.budget.joints
        ]
        responses = [
            part.responses[result.budget.joints.index(joint.name)]
            for part in parts
            if result.budget is not None and joint.name in result.budget.joints and part.responses is not None
        ]
        estimate = GaussianEstimate(joint.compliance or nan, float(np.sqrt(sum(squares))), inf)
        estimates.append((estimate, np.array(responses).reshape(-1, 3).sum(axis=0)))
    return estimates


def _compare_ratios(kind: str, seed: int) -> list[tuple[bool, float]]:
    """Return for each joint whether the interval of the ratio of two campaigns holds the true ratio.

    Beside the answer is the width of the interval, relative to the true ratio.
    """
    same_postures, hangs_on = PAIRS[kind]
    generator, arm = np.random.default_rng([seed, _STREAM, 3]), default_arm()
    worn = replace(arm, stiffnesses=arm.stiffnesses * np.exp(0.2 * generator.uniform(-1.0, 0.0, 6)))
    place, scale = _draw_errors(2 * seed, ASSUMED)
    anew = place if hangs_on else _draw_errors(2 * seed + 1, ASSUMED)[0]
    others = seed if same_postures else 10_000 + seed
    first, second = (
        _get_estimates(_identify(_measured(each, postures, number, ASSUMED, (error, scale), sigma=True)))
        for each, postures, number, error in (
            (arm, seed, 2 * seed, place),
            (worn, others, 2 * seed + 1, anew),
        )
    )
    truth = worn.stiffnesses / arm.stiffnesses
    held = []
    for (one, response), (two, other_response), ratio in zip(first, second, truth, strict=True):
        if not (one.standard_uncertainty > 0.0 and two.standard_uncertainty > 0.0):
            continue
        shared = float(response @ other_response) if kind == SHARED else 0.0
        interval = compute_ratio_interval(one, two, 0.95, positive=True, covariance=shared)
        low, high = (nan, nan) if interval is None else (interval.lower or 0.0, interval.upper or inf)
        held.append((low <= ratio <= high, (high - low) / ratio))
    return held


def run(*, quick: bool) -> list[Section]:
    """Count accusations of clean campaigns, then ratios of two campaigns that hold the truth."""
    rows, figures = [], list[Figure]()
    for name, common, count in (("assumed", ASSUMED, 45), ("stated", STATED, 30)):
        seeds = range(4 if quick else count)
        accused = [_is_accused(common, seed, sigma=sigma) for seed in seeds for sigma in (True, False)]
        rows.append((f"load point and scale as {name}", f"{sum(accused)} of {len(accused)} accused"))
        what = f"load point and scale drawn as {name}: accused of {len(accused)}"
        figures.append(Figure(what, sum(accused), "at most", 2))
    for kind in PAIRS:
        compared = [each for seed in range(3 if quick else 150) for each in _compare_ratios(kind, seed)]
        held, widths = zip(*compared, strict=True)
        share = 100.0 * float(np.mean(held))
        width = 100.0 * float(np.median(widths))
        rows.append((f"ratios: {kind}", f"{share:.1f} % of {len(held)} hold, median width {width:.1f} %"))
        figures.append(Figure(f"ratios that hold: {kind}", share, "at least", 92.5, " %"))
        figures.append(Figure(f"ratios that hold: {kind}", share, "at most", 97.0, " %"))
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
