"""Campaigns with several mistakes: runs whose advice is followed until none is left, and how they end.

Everything is as a user does it: readings are inspected and identified, and the first action that the reasons
offer is carried out. Nothing here knows what was planted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from benchmarks.studies.planted import CAUSES, Plant, Planted, design_campaign, plant_bump, read
from jointstiff.schemas.finding import AdvisedAction
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import RunResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import SpringArm, plan_experiment
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["study_pairs", "study_single_readings"]

_STREAM = 113
_MOST_ACTIONS = 6
BEYOND = 3.0
"""Standard uncertainties beyond which a joint is wrong."""
_BUMP = "bump"
PAIRS = (
    ("load_point", "shift"),
    ("load_point", _BUMP),
    ("constant_force", "load_scale"),
    ("constant_force", _BUMP),
    ("load_zero", "turn"),
    ("play", "shift"),
    ("play", _BUMP),
    ("load_scale", "load_point"),
)
_PLANTS: dict[str, Plant] = CAUSES | {_BUMP: plant_bump}


@dataclass(frozen=True)
class Ending:
    """Result of a campaign when no reason offers an action any more."""

    verdict: str
    worst: float  #: largest error of a joint, in standard uncertainties
    error: float  #: median relative error of the joints
    actions: tuple[str, ...]  #: actions that were carried out, in words


def _judge(arm: SpringArm, measured: Measurements, options: RunOptions) -> RunResult:
    robot = robot_of(arm)
    findings = inspect_measurements(robot, measured, degrees=False)
    return identify_and_judge(robot, measured, options, tuple(findings))


def _apply(
    action: AdvisedAction, measured: Measurements, options: RunOptions
) -> tuple[Measurements, RunOptions] | None:
    """Carry out an action on readings and options; None for an action that changes neither."""
    if action.observations and action.kind in ("leave_out_readings", "fit_causes"):
        kept = [i for i, label in enumerate(measured.labels) if label not in action.observations]
        measured = measured[np.array(kept)]
    if action.kind == "leave_out_readings":
        return measured, options
    if action.kind == "fit_causes":
        return measured, options.model_copy(update={"causes": [*options.causes, *action.causes]})
    if action.kind == "use_huber":
        return measured, options.model_copy(update={"loss": "huber"})
    if action.kind == "omit_noise":
        return replace(measured, refuted_sigma=measured.sigma, sigma=None), options
    return None


def _measure_errors(arm: SpringArm, result: RunResult) -> tuple[float, float]:
    """Return the largest error of a joint in standard uncertainties, and the median relative error."""
    off, relative = [0.0], []
    for joint, true in zip(result.joints, arm.compliances, strict=True):
        error = abs((joint.compliance or 0.0) - true)
        relative.append(error / true)
        if joint.standard_uncertainty:
            off.append(error / joint.standard_uncertainty)
    return max(off), float(np.median(relative))


def follow_advice(arm: SpringArm, measured: Measurements) -> Ending:
    """Identify readings, and follow the advice of the reasons until there is none."""
    options, done = RunOptions(), list[str]()
    result = _judge(arm, measured, options)
    while len(done) < _MOST_ACTIONS:
        actions = [reason.action for reason in result.assessment.reasons if reason.action is not None]
        changes = [(each, _apply(each, measured, options)) for each in actions]
        change = next(((each, new) for each, new in changes if new is not None), None)
        if change is None:
            break
        action, (measured, options) = change
        causes = [f"{each.name} since {each.first}" if each.first else each.name for each in action.causes]
        done.append(" ".join([action.kind, *causes, *action.observations]))
        result = _judge(arm, measured, options)
    return Ending(result.assessment.verdict, *_measure_errors(arm, result), tuple(done))


def _plant_pair(pair: Sequence[str], seed: int) -> tuple[SpringArm, Measurements]:
    generator = np.random.default_rng([seed, _STREAM])
    design = design_campaign(5000 + seed)
    planted = Planted.clean(design)
    for name in pair:
        planted = _PLANTS[name](planted, generator)
    return design.arm, read(planted, generator, sigma=seed % 2 == 0)


def study_pairs(*, quick: bool) -> Section:
    """Plant two mistakes in each campaign, and follow the advice of the runs to the end."""
    seeds = range(1 if quick else 6)
    rows, right, sold, count = [], 0, 0, 0
    for number, pair in enumerate(PAIRS):
        endings = [follow_advice(*_plant_pair(pair, 100 * number + seed)) for seed in seeds]
        within = sum(each.worst <= BEYOND for each in endings)
        wrong_uses = sum(each.verdict == "use" and each.worst > BEYOND for each in endings)
        right, sold, count = right + within, sold + wrong_uses, count + len(endings)
        verdicts = Counter(each.verdict for each in endings)
        worst = ", ".join(f"{each.worst:.1f}" for each in endings)
        words = ", ".join(f"{name} {number}" for name, number in verdicts.items())
        rows.append((" and ".join(pair), f"{within} of {len(endings)}", worst, words))
    return Section(
        title="Two mistakes in a campaign, and the advice of the runs followed to its end",
        columns=("planted", "end within 3 u", "worst joint [u]", "verdicts"),
        rows=tuple(rows),
        figures=(
            Figure(f"pairs of mistakes: of {count}, end within 3 u", right, "at least", 0.875 * count),
            Figure.none(f"pairs of mistakes: of {count}, plain use beyond 3 u", sold),
        ),
    )


def _mistake_posture(seed: int) -> tuple[SpringArm, Measurements, Measurements]:
    """Return an arm, its clean readings, and the same with the angles of another reading in one of 20."""
    arm, generator = default_arm(), np.random.default_rng([seed, _STREAM, 1])
    plan = plan_experiment(arm, configurations=20, load="pull", force=1500.0, seed=seed)
    campaign = SpringCampaign.by(arm, plan)
    noise = SIGMA * generator.standard_normal((2, *campaign.loaded.shape))
    clean = campaign.measurements(
        campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=SIGMA if seed % 2 else None
    )
    wrong, other = generator.choice(len(clean), 2, replace=False)
    angles = clean.joints.copy()
    angles[wrong] = angles[other]
    return arm, clean, replace(clean, joints=angles)


def study_single_readings(*, quick: bool) -> Section:
    """Give one reading of 20 the posture of another, and compare the errors with those of clean readings."""
    seeds = range(3 if quick else 30)
    errors, verdicts = [], Counter[str]()
    for seed in seeds:
        arm, *sets = _mistake_posture(seed)
        results = [_judge(arm, each, RunOptions()) for each in sets]
        errors.append([_measure_errors(arm, each)[1] for each in results])
        verdicts[results[1].assessment.verdict] += 1
    clean, wrong = np.median(errors, axis=0).tolist()
    return Section(
        title="One reading of 20 with the posture of another",
        columns=("readings", "median error of a stiffness [%]", "verdicts"),
        rows=(
            ("clean", f"{100 * clean:.2f}", ""),
            ("one wrong", f"{100 * wrong:.2f}", ", ".join(f"{k} {n}" for k, n in verdicts.items())),
        ),
        figures=(
            Figure(
                "one wrong reading of 20: error over that of clean readings", wrong / clean, "at most", 1.5
            ),
            Figure.none(
                f"one wrong reading of 20: of {len(seeds)}, not *do not use*",
                len(seeds) - verdicts["do_not_use"],
            ),
        ),
    )
