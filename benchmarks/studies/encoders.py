"""Encoders behind gearboxes in campaigns of a tracker: intervals where gears have play or encoders err."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.designs import planned_design
from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.run import run as identify_run
from tests.support.encoder_campaigns import READ, Errors, simulate
from tests.support.springs import robot_of

__all__ = ["run"]

CAMPAIGNS: Final = 80
ERRORS: Final = {
    "none": Errors(),
    "play of 20 µrad": Errors(play=20e-6),
    "play of 40 µrad": Errors(play=40e-6),
    "play of 60 µrad": Errors(play=60e-6),
    "joints that repeat to 20 µrad": Errors(repeatability=20e-6),
    "joints that repeat to 40 µrad": Errors(repeatability=40e-6),
    "encoders off by 20 µrad": Errors(encoder=20e-6),
    "play and encoders off": Errors(play=20e-6, encoder=20e-6),
    "play, 40 % of the compliance behind": Errors(play=20e-6, structure=0.4),
}


@dataclass(frozen=True)
class _Outcome:
    """Outcome of one campaign."""

    verdict: str
    held: tuple[bool, ...]  # whether each joint's interval contains the truth; those with an encoder first
    half_width: tuple[float, ...]  # of each joint with an encoder, relative to its compliance


def _identify(errors: Errors, seed: int, *, with_encoders: bool = True) -> _Outcome:
    """Identify a campaign; return the outcome."""
    campaign = simulate(planned_design(default_arm(), seed=seed % 20), errors, seed)
    measurements = campaign.measurements
    if not with_encoders:
        measurements = replace(measurements, encoders=None)
    result = identify_run(robot_of(campaign.arm), measurements, RunOptions())
    ends = np.array([joint.compliance_interval or (np.nan, np.nan) for joint in result.joints])
    truth = campaign.arm.compliances
    held = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
    half_width = 0.5 * np.ptp(ends, axis=1) / truth
    return _Outcome(result.assessment.verdict, tuple(held.tolist()), tuple(half_width[list(READ)].tolist()))


def _section(name: str, errors: Errors, seeds: Sequence[int]) -> Section:
    """Count intervals that contain the truth, and verdicts."""
    outcomes = [_identify(errors, seed) for seed in seeds]
    without = [_identify(errors, seed, with_encoders=False) for seed in seeds]
    held = [each for outcome in outcomes for each in outcome.held[: len(READ)]]
    others = [each for outcome in outcomes for each in outcome.held[len(READ) :]]
    width = float(np.median([outcome.half_width for outcome in outcomes]))
    width_without = float(np.median([outcome.half_width for outcome in without]))
    verdicts = Counter(outcome.verdict for outcome in outcomes)
    share = 100.0 * float(np.mean(held))
    counts = [f"{count}" for each in (held, others) for count in (sum(each), len(each))]
    of = f"tracker and encoders, errors: {name}"
    return Section(
        title=f"{of}; {len(seeds)} campaigns",
        columns=("held", "of", "other joints", "of", "half-width [%]", "without encoders [%]", "plain use"),
        rows=((*counts, f"{100 * width:.2f}", f"{100 * width_without:.2f}", f"{verdicts['use']}"),),
        figures=(
            Figure(f"{of}: intervals with the truth", share, "at least", 92.5, " %"),
            Figure(f"{of}: intervals with the truth", share, "at most", 97.0, " %"),
        ),
    )


def run(*, quick: bool, part: Part) -> list[Section]:
    """Simulate campaigns with each kind of error."""
    seeds = part.of(3 if quick else CAMPAIGNS)
    return [_section(name, errors, seeds) for name, errors in ERRORS.items()]
