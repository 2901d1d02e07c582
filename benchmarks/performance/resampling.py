"""1,000 resamples of 10 out of 19 configurations, beside loops over them: the paper's study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from benchmarks.campaigns import Campaign, small_campaign
from benchmarks.performance.peers import cvxpy_clarabel
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import Times, interleaved
from jointstiff.schemas.options import Method, Resampling
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.resampling import (
    MethodStacks,
    Resamples,
    build_method_stacks,
    draw_configurations,
    resample,
)
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows

__all__ = ["run"]


CONFIGURATIONS, DRAWN, REPETITIONS = 19, 10, 1000
SAMPLE = 30
"""Repetitions that cvxpy solves; its time is scaled to all of them."""
NOISE = 6e-4
"""Standard uncertainty of a reading [m] that holds a bound active in many resamples."""
OURS = "readings → blocks → estimates, compensations"
NNLS = "rows of each subset → scipy nnls → estimates"
NAIVE = f"rows of each subset → fresh cvxpy + Clarabel → estimates, {SAMPLE} scaled up"
METHODS: tuple[Method, ...] = ("complete_pose", "partial_pose", "decoupled_partial_pose")


@dataclass(frozen=True, eq=False)
class _Rows:
    """Ready-made rows of one stage on one subset, with columns and deflections of unit norm.

    Attributes:
        A: (r, p) weighted regressor.
        d: (r,) weighted deflections.
        earlier: (r, q) regressor of what the stage before has solved; None for the first.
    """

    A: FloatArray
    d: FloatArray
    earlier: FloatArray | None


def run(*, quick: bool) -> list[Section]:
    """Compare resample with its peers for each method."""
    campaign = small_campaign(sigma=NOISE, configurations=CONFIGURATIONS)
    plan = Resampling(size=DRAWN, repetitions=50 if quick else REPETITIONS)
    return [_section(method, campaign, plan, 2 if quick else 11) for method in METHODS]


def _section(method: Method, campaign: Campaign, plan: Resampling, rounds: int) -> Section:
    settings = Settings(method, "covariance", Bounds.positive(campaign.robot.n))
    blocks = _blocks(campaign, settings)
    times = _times(campaign, settings, plan, _subsets(blocks, plan), rounds)
    found: Resamples = times.results[OURS]
    columns, rows = times_table(times, OURS, [("from ours", _differences(times, blocks))])
    what = f"{plan.repetitions:,} × {DRAWN} of {CONFIGURATIONS}, {method}"
    at_bound = int((found.compliance == 0.0).any(axis=1).sum())
    return Section(
        title=f"Resampling: {what}, positive",
        columns=columns,
        rows=rows,
        figures=(
            Figure(
                f"{what}: loop of fresh cvxpy, time / ours", times.ratio(NAIVE, OURS), "at least", 50, "×"
            ),
            Figure(f"{what}: ours / loop of scipy nnls", 1 / times.ratio(NNLS, OURS), "at most", 0.95, "×"),
        ),
        notes=(
            f"{at_bound} of {plan.repetitions:,} resamples have an active bound",
            "ours includes kinematics, the full set's identification, rows, blocks, and compensation on all "
            "configurations; the others begin at ready-made rows of every subset and end at the estimates",
            "from ours: greatest difference of a compliance, relative to the joint's mean",
        ),
        data={"seconds": times.seconds},
    )


def _times(
    campaign: Campaign, settings: Settings, plan: Resampling, subsets: list[list[_Rows]], rounds: int
) -> Times:
    """All in turns; seconds of cvxpy are those of its sample, scaled to all repetitions."""
    times = interleaved(
        {
            OURS: lambda: _resampled(campaign, settings, plan),
            NNLS: lambda: _one_by_one(subsets, lambda A, d: nnls(A, d)[0]),
            NAIVE: lambda: _one_by_one(subsets[:SAMPLE], cvxpy_clarabel),
        },
        rounds=rounds,
    )
    scale = len(subsets) / len(subsets[:SAMPLE])
    scaled = {NAIVE: [scale * seconds for seconds in times.seconds[NAIVE]]}
    return Times(times.seconds | scaled, times.results)


def _resampled(campaign: Campaign, settings: Settings, plan: Resampling) -> Resamples:
    return resample(_blocks(campaign, settings), plan, settings.bounds)


def _blocks(campaign: Campaign, settings: Settings) -> MethodStacks:
    """Return the blocks for resampling, after the identification of the full set without bounds."""
    whole = replace(settings, bounds=Bounds.unconstrained(campaign.robot.n))
    rows = Rows(campaign.robot, campaign.measurements)
    return build_method_stacks(rows, whole, identify(rows, whole))


def _one_by_one(
    subsets: Sequence[list[_Rows]], solve: Callable[[FloatArray, FloatArray], FloatArray]
) -> list[list[FloatArray]]:
    """Scaled parameters of each subset and stage."""
    found = []
    for stages in subsets:
        solved: list[FloatArray] = []
        for rows in stages:
            d = rows.d if rows.earlier is None else rows.d - rows.earlier @ solved[-1]
            solved.append(solve(rows.A, d))
        found.append(solved)
    return found


def _subsets(blocks: MethodStacks, plan: Resampling) -> list[list[_Rows]]:
    """Ready-made rows of every subset, stage by stage: the solver's own, equilibrated, as peers like them."""
    found = []
    for drawn in draw_configurations(plan, len(blocks), 0, plan.repetitions):
        stages: list[_Rows] = []
        for stage in blocks.stages:
            rows, p = stage.stack[drawn].flat, len(stage.joints)
            earlier = None
            if len(stage.known):  # in the scaled parameters of the stage before
                earlier = rows[:, p:-1] * (blocks.stages[0].unit / stage.unit[p:])
            stages.append(_Rows(rows[:, :p].copy(), rows[:, -1].copy(), earlier))
        found.append(stages)
    return found


def _differences(times: Times, blocks: MethodStacks) -> dict[str, str]:
    ours: FloatArray = times.results[OURS].compliance[:, blocks.visible]
    unit = np.concatenate([stage.unit[: len(stage.joints)] for stage in blocks.stages])
    peers = {who: np.array([np.concatenate(x) for x in times.results[who]]) * unit for who in (NNLS, NAIVE)}
    size = ours.mean(axis=0)
    return {who: f"{(np.abs(c - ours[: len(c)]) / size).max():.1e}" for who, c in peers.items()}
