"""Load points stated more exactly than anybody knew them: coverage, and doubts in clean campaigns.

The load point is stated to 0.1 or 1 mm, and the load hangs 8 to 30 mm off. Springs balance the true load
exactly; nothing here knows the solver's own terms. In some rows a target at the hook was read once without
load, in a posture in which the robot stands some millimetre off its model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff import identify
from jointstiff.schemas.measurement import Noise
from jointstiff.schemas.options import RunOptions
from jointstiff.service.conversion.measurements import to_common_uncertainty
from jointstiff.simulator import default_arm, deflections, simulate_campaign
from jointstiff.simulator.campaign import plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["run"]

_STREAM = 9203
_FRESH = 5000
"""First seed of the campaigns with a reading of the hook."""
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


@dataclass(frozen=True)
class _Tested:
    """Result of one campaign whose stated load point was tested by a reading of the hook."""

    refuted: bool  # whether the reading refutes the stated load point
    covered: int  # joints whose interval contains the true stiffness
    joints: int  # joints with an interval


def _read_hook(seed: int, row: _Row) -> dict[str, Any]:
    """Return a campaign whose load point is stated off the true one, with one reading of the hook.

    In the posture of this reading, all targets are off the model by a random motion of 0.5 mm and 0.5 mrad.
    """
    generator = np.random.default_rng([seed, _STREAM, 1])
    arm, count = default_arm(), int(generator.integers(12, 31))
    document: dict[str, Any] = simulate_campaign(
        arm, load="pull", configurations=count, force=1500.0, sigma=SIGMA, seed=seed
    )
    measured = document["measurement_set"]
    true_point = np.array(measured["load_point"])
    measured["load_point"] = (true_point + row.draw_error(generator)).tolist()
    measured["noise"] = {"sigma": SIGMA, "load_point": row.stated, "force": {"scale": 2e-3}}
    measured["load_point_target"] = "hook"
    observation = measured["observations"][int(generator.integers(count))]
    no_load = np.zeros((1, 3))
    hook, _ = deflections(arm, np.array([observation["joints"]]), no_load, no_load, no_load, true_point[None])
    x, y, z = 5e-4 * generator.standard_normal(3)
    turn = np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    shift = 5e-4 * generator.standard_normal(3)
    for reading in observation["readings"]:
        for state in ("unloaded", "loaded"):
            reading[state] = (turn @ reading[state] + shift).tolist()
    seen = turn @ hook.reshape(3) + shift + SIGMA * generator.standard_normal(3)
    observation["readings"].append({"target": "hook", "unloaded": seen.tolist()})
    return document


def _test_by_hook(seed: int, row: _Row) -> _Tested:
    """Identify a campaign with a reading of the hook, and compare its joints with the springs."""
    result = identify(_read_hook(seed, row)).result
    if result is None:
        return _Tested(refuted=False, covered=0, joints=0)
    refuted = any(reason.code == "load_point_refuted" for reason in result.assessment.reasons)
    covered = joints = 0
    for joint, compliance in zip(result.joints, default_arm().compliances, strict=True):
        interval = joint.compliance_interval
        if interval is not None:
            joints += 1
            low, high = interval[0], inf if interval[1] is None else interval[1]
            covered += bool(low <= compliance <= high)
    return _Tested(refuted, covered, joints)


def _build_section_on_hook(*, quick: bool) -> Section:
    """Return the section on stated load points that one reading of the hook tests."""
    rows = list[tuple[str, ...]]()
    figures = list[Figure]()
    data = dict[str, Any]()
    for row in (*_READ, *_CLEAN_READ):
        is_clean = row in _CLEAN_READ
        count = 3 if quick else (120 if is_clean else 60)
        tested = [_test_by_hook(_FRESH + seed, row) for seed in range(count)]
        refuted = sum(each.refuted for each in tested)
        covered, joints = (sum(getattr(each, name) for each in tested) for name in ("covered", "joints"))
        share = 100.0 * covered / max(joints, 1)
        rows.append((row.words, str(count), str(refuted), f"{covered} of {joints} ({share:.1f} %)"))
        data[row.words] = {"refuted": refuted, "joints": joints, "covered": covered}
        if is_clean:
            figures.append(Figure.none(f"{row.words}: refuted", refuted))
        else:
            figures.append(Figure(f"{row.words}: refuted", 100.0 * refuted / count, "at least", 95.0, "%"))
        figures.append(Figure(f"{row.words}: covered", share, "at least", 93.0, "%"))
    return Section(
        title="Load points that a reading of the hook tests",
        columns=("campaigns", "count", "refuted", "covered"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=("one unloaded reading of the hook, 0.5 mm and 0.5 mrad off the model with all targets",),
        data=data,
    )


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
        ),
        _build_section_on_hook(quick=quick),
    ]
