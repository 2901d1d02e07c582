"""Load points stated more exactly than anybody knew them: coverage, and doubts in clean campaigns.

The load point is stated to 0.1 or 1 mm, and the load hangs 8 to 30 mm off. Springs balance the true load
exactly; nothing here knows the solver's own terms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff.schemas.measurement import Noise
from jointstiff.schemas.options import RunOptions
from jointstiff.service.conversion.readings import to_common_uncertainty
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["run"]

_STREAM = 9203
BEYOND = 3.0
"""Standard uncertainties beyond which a joint is wrong."""
_DOUBT = "raise a doubt that the load point is known"


@dataclass(frozen=True)
class _Row:
    """Campaigns of one kind."""

    words: str  # for people
    stated: float  # standard uncertainty of a coordinate of the load point [m]
    least: float  # least distance of the load from its stated point [m]
    greatest: float  # greatest distance [m]
    ground: str | None = None  # how the load point is known
    is_read: bool = False  # whether a target at the hook was read once without load, too

    def draw_error(self, generator: np.random.Generator) -> FloatArray:
        """Return an error (3,) of the load point in a random direction [m]."""
        if self.greatest == 0.0:
            return self.stated * generator.standard_normal(3)
        direction = generator.standard_normal(3)
        length = generator.uniform(self.least, self.greatest)
        return np.asarray(length * direction / np.linalg.norm(direction))


_WRONG = (
    _Row("stated to 0.1 mm, no ground, 8 to 30 mm off", 1e-4, 8e-3, 3e-2),
    _Row("stated to 1 mm, no ground, 8 to 30 mm off", 1e-3, 8e-3, 3e-2),
)
_READ = (
    _Row("hook read, stated to 0.1 mm, 8 to 30 mm off", 1e-4, 8e-3, 3e-2, is_read=True),
    _Row("hook read, stated to 1 mm, 8 to 30 mm off", 1e-3, 8e-3, 3e-2, is_read=True),
)
_CLEAN_READ = (_Row("clean, hook read, stated to 1 mm", 1e-3, 0.0, 0.0, is_read=True),)
_CLEAN = (
    _Row("clean, stated to 0.1 mm, no ground", 1e-4, 0.0, 0.0),
    _Row("clean, stated to 1 mm, by tracker", 1e-3, 0.0, 0.0, "tracker"),
)


@dataclass(frozen=True)
class _Outcome:
    """Result of one campaign, compared with the springs."""

    covered: int  # joints whose interval contains the true stiffness
    joints: int  # joints with an interval
    worst: float  # largest error of a joint in standard uncertainties
    verdict: str
    doubts: bool  # whether the run has a sentence of doubt

    @property
    def is_wrong_use(self) -> bool:
        """Return whether the verdict is *use* although a joint is wrong."""
        return self.verdict == "use" and self.worst > BEYOND


def _measure(seed: int, row: _Row) -> Measurements:
    """Return readings of 12 to 30 pulls, whose load hangs off its stated place."""
    generator = np.random.default_rng([seed, _STREAM])
    arm, count = default_arm(), int(generator.integers(12, 31))
    plan = plan_experiment(arm, configurations=count, load="pull", force=1500.0, seed=seed)
    error = row.draw_error(generator)
    campaign = SpringCampaign.by(arm, replace(plan, load_points=plan.load_points + error))
    noise = SIGMA * generator.standard_normal((2, *campaign.loaded.shape))
    measured = replace(campaign, experiment=plan).measurements(
        campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=SIGMA
    )
    stated: dict[str, Any] = {"load_point": row.stated, "force": {"scale": 2e-3}}
    if row.ground is not None:
        stated["grounds"] = {"load_point": row.ground}
    common = to_common_uncertainty(Noise.model_validate(stated), 1.0)
    return replace(measured, common_uncertainty=common)


def _identify(seed: int, row: _Row) -> _Outcome:
    """Identify a campaign, and compare its joints with the springs."""
    arm = default_arm()
    result = identify_and_judge(robot_of(arm), _measure(seed, row), RunOptions())
    covered = joints = 0
    worst = 0.0
    for joint, compliance in zip(result.joints, arm.compliances, strict=True):
        interval = joint.compliance_interval
        if interval is not None:
            low, high = interval[0], inf if interval[1] is None else interval[1]
            joints += 1
            covered += low <= compliance <= high
        if joint.compliance is not None and joint.standard_uncertainty:
            worst = max(worst, abs(joint.compliance - compliance) / joint.standard_uncertainty)
    doubts = any(_DOUBT in note for note in result.assessment.notes)
    return _Outcome(covered, joints, worst, result.assessment.verdict, doubts)


def run(*, quick: bool) -> list[Section]:
    """Identify campaigns with wrong load points, then clean campaigns."""
    rows = list[tuple[str, ...]]()
    figures = list[Figure]()
    data = dict[str, Any]()
    for row in (*_WRONG, *_CLEAN):
        is_clean = row in _CLEAN
        count = 3 if quick else (120 if is_clean else 60)
        outcomes = [_identify(seed, row) for seed in range(count)]
        joints = sum(each.joints for each in outcomes)
        covered = sum(each.covered for each in outcomes)
        doubts = sum(each.doubts for each in outcomes)
        wrong = sum(each.is_wrong_use for each in outcomes)
        share = 100.0 * covered / max(joints, 1)
        rows.append(
            (row.words, str(count), f"{covered} of {joints} ({share:.1f} %)", str(wrong), str(doubts))
        )
        data[row.words] = {"joints": joints, "covered": covered, "wrong uses": wrong, "doubts": doubts}
        if not is_clean:
            figures.append(Figure(f"{row.words}: covered", share, "at least", 93.0, "%"))
        elif row.ground == "tracker":
            figures.append(Figure.none(f"{row.words}: sentences of doubt", doubts))
        else:
            most = max(1, count // 10)
            figures.append(Figure(f"{row.words}: sentences of doubt", doubts, "at most", most))
    return [
        Section(
            title="Load points with and without a ground",
            columns=("campaigns", "count", "covered", "use beyond 3 u", "doubts"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(f"12 to 30 pulls of 1500 N, three targets, {1e6 * SIGMA:g} µm, six joints a campaign",),
            data=data,
        )
    ]
