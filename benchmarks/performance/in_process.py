"""A run in process, from a campaign to its message, beside the bare call of the numerical core."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jointstiff
from benchmarks.campaigns import default_settings, small_campaign
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import interleaved
from jointstiff.schemas.run import Campaign
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows

__all__ = ["run"]

MESSAGE = "campaign → run, with checks, residuals and provenance"
BARE = "arrays → estimate"


def run(*, quick: bool) -> list[Section]:
    """Compare the library's `identify` with the solver's on the same readings."""
    simulated = small_campaign(configurations=40)
    campaign = Campaign.model_validate(simulated.document)
    robot, measurements = simulated.robot, simulated.measurements
    settings = default_settings(robot)
    times = interleaved(
        {
            MESSAGE: partial(jointstiff.identify, campaign, campaign.run),
            # A set keeps its regressors, so each fit has a set of its own.
            BARE: lambda: identify(Rows(robot, replace(measurements)), settings),
        },
        rounds=3 if quick else 200,
        warm_up=3,
    )
    columns, rows = times_table(times, MESSAGE)
    what = "a run of 40 configurations in process: time / the bare call of the solver"
    return [
        Section(
            title="A run of 40 configurations × 3 targets in process, without a store",
            columns=columns,
            rows=rows,
            figures=(Figure(what, times.ratio(MESSAGE, BARE), "at most", 5.0, "×"),),
            notes=("the robot is read once; the readings are checked for the usual mistakes in every call",),
            data={"seconds": times.seconds},
        )
    ]
