"""Mistakes that no reading shows: whether a run says so, and whether it foretells what they move.

The load point is stated to 0.1 mm and the load hangs 8 to 30 mm off. Springs balance the true load exactly;
nothing here knows the solver's own terms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.reliability import find_least_mistakes
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["run"]

_STREAM = 101
STATED = CommonUncertainty(load_point=1e-4, scale=3e-3)
ASSUMED = CommonUncertainty(load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"}))
BEYOND = 3.0
"""Standard uncertainties beyond which a joint is wrong."""
_WORDS = "an error of the load point up to"


@dataclass(frozen=True)
class _Outcome:
    """Words of a run about its campaign, and the error of its worst joint."""

    verdict: str
    says: bool  # that it cannot show a mistake in the load point
    foretold: float  # what the least mistake that is found moves, in standard uncertainties; 0 for none
    worst: float  # largest error of a joint in standard uncertainties


def _measured(seed: int, common: CommonUncertainty, error: FloatArray) -> Measurements:
    """Return readings of 14 to 30 pulls whose load hangs off its stated place by an error (3,) [m]."""
    generator = np.random.default_rng([seed, _STREAM])
    arm, count = default_arm(), int(generator.integers(14, 31))
    plan = plan_experiment(arm, configurations=count, load="pull", force=1500.0, seed=seed)
    campaign = SpringCampaign.by(arm, replace(plan, load_points=plan.load_points + error))
    noise = SIGMA * generator.standard_normal((2, *campaign.loaded.shape))
    read = replace(campaign, experiment=plan).measurements(
        campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=SIGMA
    )
    return replace(read, common_uncertainty=common)


def _outcome(seed: int, common: CommonUncertainty, error: FloatArray) -> _Outcome:
    """Identify a campaign, and compare what it says with the springs."""
    arm = default_arm()
    result = identify_and_judge(robot_of(arm), _measured(seed, common, error), RunOptions())
    off = [
        abs((joint.compliance or 0.0) - true) / joint.standard_uncertainty
        for joint, true in zip(result.joints, arm.compliances, strict=True)
        if joint.standard_uncertainty
    ]
    point = next((each for each in result.causes if each.name == "load_point" and each.moves), None)
    foretold = 0.0 if point is None else point.moves or 0.0
    says = any(_WORDS in note for note in result.assessment.notes)
    return _Outcome(result.assessment.verdict, says, foretold, max(off, default=0.0))


def _draw_error(seed: int) -> FloatArray:
    """Return an error of the load point of 8 to 30 mm in a random direction [m]."""
    generator = np.random.default_rng([seed, _STREAM, 1])
    direction = generator.standard_normal(3)
    return np.asarray(generator.uniform(8e-3, 3e-2) * direction / np.linalg.norm(direction))


def _actual_over_foretold(seed: int) -> float:
    """Plant half of the least mistake in the load point; return by how much more it moves than foretold."""
    arm, none = default_arm(), np.zeros(3)
    robot = robot_of(arm)
    settings = Settings.from_options(RunOptions(), robot)
    clean = JointsAlone(Rows(robot, _measured(seed, STATED, none)), settings)
    found = find_least_mistakes(clean.rows, clean.estimate, len(clean.screening.tests))
    least = next(each for each in found if each.name == "load_point")
    moved = JointsAlone(
        Rows(robot, _measured(seed, STATED, 0.5 * np.array(least.unknowns))), settings
    ).estimate
    j = robot.joint_names.index(least.joint)
    change = abs(moved.compliance[j] - clean.estimate.compliance[j])
    return float(change / (0.5 * least.moves * (clean.estimate.joints[j].standard_uncertainty or np.nan)))


def run(*, quick: bool) -> list[Section]:
    """Plant mistakes in stated load points; then count what clean campaigns say."""
    seeds = range(3 if quick else 40)
    errors = [_draw_error(seed) for seed in seeds]
    planted = [_outcome(seed, STATED, error) for seed, error in zip(seeds, errors, strict=True)]
    wrong = [each for each in planted if each.verdict == "use" and each.worst > BEYOND]
    silent = sum(not each.says for each in wrong)
    # A mistake that is not found moves less than the least one that is; noise adds to what it moves.
    exceeded = sum(each.worst > each.foretold + BEYOND for each in wrong)
    rows = [
        ("stated to 0.1 mm, 8 to 30 mm off: use, a joint beyond 3 u", f"{len(wrong)} of {len(planted)}"),
        ("of these without a word", str(silent)),
        ("of these beyond what the run foretells", str(exceeded)),
    ]
    figures = [
        Figure(f"plain use beyond 3 u, without a word, of {len(planted)}", silent, "at most", 1),
        Figure.none(f"of {len(wrong)} wrong uses, beyond what is foretold", exceeded),
    ]
    for name, common in (("assumed", ASSUMED), ("stated", STATED)):
        clean = [_outcome(seed, common, np.zeros(3)) for seed in seeds]
        says, uses = sum(each.says for each in clean), sum(each.verdict == "use" for each in clean)
        foretold = float(np.median([each.foretold for each in clean]))
        rows.append(
            (
                f"clean, load point {name}",
                f"{uses} of {len(clean)} use, {says} speak of it ({foretold:.1f} u)",
            )
        )
        figures.append(Figure(f"clean, load point {name}: use", uses, "at least", len(clean)))
    ratios = [_actual_over_foretold(seed) for seed in seeds]
    low, high = np.quantile(ratios, [0.1, 0.9])
    rows.append(("half of the least mistake: actual over foretold, 10 to 90 %", f"{low:.2f} to {high:.2f}"))
    figures += [
        Figure("actual over foretold, median", float(np.median(ratios)), "at least", 0.7),
        Figure("actual over foretold, median", float(np.median(ratios)), "at most", 1.3),
    ]
    return [
        Section(
            title="Mistakes that no reading shows",
            columns=("campaigns", "outcome"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                f"14 to 30 pulls of 1500 N, three targets, {1e6 * SIGMA:g} µm, load point stated to 0.1 mm",
            ),
        )
    ]
