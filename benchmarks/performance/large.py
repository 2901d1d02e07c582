"""100,000 configurations of three targets, from joint angles to estimate."""

from __future__ import annotations

import numpy as np

from benchmarks.campaigns import Campaign, default_settings, large_campaign
from benchmarks.performance.peers import (
    bare_pinocchio_loop,
    cvxpy_clarabel,
    numpy_qr_nnls,
    stacked_rows,
)
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import Times, interleaved
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows

__all__ = ["run"]


CONFIGURATIONS = 100_000
OURS = "identify: angles → estimate"
NAIVE = "angles → rows → fresh cvxpy + Clarabel"
TRIANGLE = "rows → numpy QR + scipy nnls"
LOOP = "bare Pinocchio loop"


def run(*, quick: bool) -> list[Section]:
    """Compare identify with cvxpy on all rows, and with the least work that there is."""
    campaign = large_campaign(500 if quick else CONFIGURATIONS)
    return [_against_least_work(campaign, 2 if quick else 9), _against_cvxpy(campaign)]


def _against_least_work(campaign: Campaign, rounds: int) -> Section:
    robot, measurements = campaign.robot, campaign.measurements
    A, d = stacked_rows(robot, measurements)
    times = interleaved(
        {
            OURS: lambda: _identified(campaign),
            TRIANGLE: lambda: numpy_qr_nnls(A, d),
            LOOP: lambda: bare_pinocchio_loop(robot, measurements.joints),
        },
        rounds=rounds,
    )
    columns, rows = times_table(times, OURS, [("from ours", _differences(times, TRIANGLE))])
    overhead = 1.0 / (times.ratio(TRIANGLE, OURS) + times.ratio(LOOP, OURS))
    what = f"{len(measurements):,} configurations: ours / (numpy QR + nnls on rows + bare Pinocchio loop)"
    return Section(
        title=f"{len(measurements):,} configurations × 3 targets: ours beside the least work there is",
        columns=columns,
        rows=rows,
        figures=(Figure(what, overhead, "at most", 1.6, "×"),),
        notes=("from ours: greatest relative difference of a compliance",),
        data={"seconds": times.seconds},
    )


def _against_cvxpy(campaign: Campaign) -> Section:
    """The peer once, as it takes its time and the ratio is far from its figure; ours before and after."""
    measurements = campaign.measurements
    ours = {OURS: lambda: _identified(campaign)}
    peer = {NAIVE: lambda: cvxpy_clarabel(*stacked_rows(campaign.robot, measurements))}
    before = interleaved(ours, rounds=2)
    alone = interleaved(peer, rounds=1, warm_up=0)
    after = interleaved(ours, rounds=2, warm_up=0)
    seconds = {OURS: before.seconds[OURS] + after.seconds[OURS], NAIVE: alone.seconds[NAIVE]}
    times = Times(seconds, after.results | alone.results)
    columns, rows = times_table(times, OURS, [("from ours", _differences(times, NAIVE))])
    what = f"{len(measurements):,} configurations: cvxpy on the stacked rows, time / ours"
    return Section(
        title=f"{len(measurements):,} configurations × 3 targets: ours beside cvxpy on all rows",
        columns=columns,
        rows=rows,
        figures=(Figure(what, times.ratio(NAIVE, OURS), "at least", 30.0, "×"),),
        notes=("one round of cvxpy; its rows by a loop over Pinocchio, and numpy for the rest",),
        data={"seconds": times.seconds},
    )


def _identified(campaign: Campaign) -> Estimate:
    return identify(Rows(campaign.robot, campaign.measurements), default_settings(campaign.robot))


def _differences(times: Times, peer: str) -> dict[str, str]:
    ours: FloatArray = times.results[OURS].compliance
    return {peer: f"{np.abs(times.results[peer] / ours - 1.0).max():.1e}"}
