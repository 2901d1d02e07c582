"""Assessments of campaigns with one planted mistake and of clean ones, and what the alternatives cost.

By name only. A mistake may pass only where it does no harm: no result that is off by more than `HARM`
standard uncertainties may be called "use". Thresholds were looked at on seeds from 100,000 on, and are
judged on others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from benchmarks.campaigns import default_robot, default_settings, small_campaign
from benchmarks.designs import Design
from benchmarks.report import Figure, Section, times_table
from benchmarks.studies.mistakes import MISTAKES, SIGMA, Posted, clean_set, only_deflections
from benchmarks.studies.verdicts import METHODS
from benchmarks.timing import interleaved
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.solution import Bounds
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.alternatives import better_alternative
from jointstiff.solver.evidence.assessment import Assessment, assess, judge
from jointstiff.solver.evidence.estimate import Estimate, predict
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.integrity import inspect
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

__all__ = ["PLANTED", "Assessed", "assess_set", "clean_campaign", "planted_campaign", "run"]

Generator = np.random.Generator

FIRST_SEED, SETS = 0, 2_000
HARM: Final = 5.0
"""Error of a compliance in standard uncertainties that no result called "use" may have."""
WELL_DETERMINED: Final = 0.2
"""Greatest relative standard uncertainty of a set that must be called "use" if it is clean."""
_STREAM, _CLEAN_STREAM = 60, 61


@dataclass(frozen=True, eq=False)
class Assessed:
    """A campaign with its assessment and the truth.

    Attributes:
        estimate: of the joints.
        assessment: of that estimate.
        error: greatest error of a compliance in standard uncertainties, over the joints with a number.
        relative_uncertainty: greatest u(c)/c over the joints with a number.
    """

    estimate: Estimate
    assessment: Assessment
    error: float
    relative_uncertainty: float


def run(*, quick: bool) -> list[Section]:
    """Assess planted mistakes and clean sets, and take the time of the alternatives."""
    sets = 2 * len(PLANTED) if quick else SETS
    return [_planted_section(sets), _clean_section(sets), _cost_section(3 if quick else 200)]


def assess_set(posted: Posted, method: str, truth: FloatArray) -> Assessed:
    """Inspect, identify with K_c included, and assess."""
    robot, m = _ROBOT, posted.measurements
    findings = inspect(robot, m, degrees=posted.degrees)
    settings = Settings(METHODS[method], "covariance", Bounds.positive(robot.n), complementary_stiffness=True)
    estimate = identify(robot, m, settings)
    prediction = predict(robot, m, estimate.compliance, balanced=estimate.balanced)
    assessment = assess(robot, m, settings, estimate, prediction, findings)
    known = [(j, joint) for j, joint in enumerate(estimate.joints) if joint.standard_uncertainty]
    u = np.array([joint.standard_uncertainty for _, joint in known])
    c = np.array([joint.compliance for _, joint in known])
    error = np.abs(c - truth[[j for j, _ in known]]) / u
    with np.errstate(divide="ignore"):
        relative = u / c
    return Assessed(estimate, assessment, float(error.max(initial=0.0)), float(relative.max(initial=0.0)))


def planted_campaign(seed: int) -> tuple[str, Posted, str, FloatArray]:
    """Make a campaign with one mistake: its name, the set, the method, and the true compliances."""
    generator = np.random.default_rng([seed, _STREAM])
    name, make, by_deflections = PLANTED[seed % len(PLANTED)]
    clean = clean_set(seed, model_error=bool(generator.random() < 0.5))
    if by_deflections and generator.random() < 0.5:
        name, clean = f"{name} (deflections)", only_deflections(clean)
    method = str(generator.choice(list(METHODS)))
    return name, make(clean, generator), method, _truth_of_clean_set(seed)


def clean_campaign(seed: int) -> tuple[Measurements, str, FloatArray]:
    """Make a set of 5 to 40 configurations without mistakes: the set, the method, the true compliances."""
    generator = np.random.default_rng([seed, _CLEAN_STREAM])
    arm = default_arm("secondary" if generator.random() < 0.5 else "motor")
    experiment = plan_experiment(
        arm,
        configurations=int(generator.integers(5, 41)),
        load="pull" if generator.random() < 0.5 else "dead_weight",
        force=float(generator.uniform(800.0, 2500.0)),
        seed=seed,
    )
    measurements = next(Design.of(arm, experiment).measured(1, seed=seed, sigma=SIGMA))
    if generator.random() < 0.5:
        measurements = replace(measurements, sigma=None)
    if generator.random() < 0.5:
        measurements = only_deflections(measurements)
    return measurements, str(generator.choice(list(METHODS))), arm.compliances


def _truth_of_clean_set(seed: int) -> FloatArray:
    """Return the compliances behind `clean_set`, whose first draw chooses the arm."""
    first = np.random.default_rng([seed, 50]).random()
    return default_arm("secondary" if first < 0.5 else "motor").compliances


def _coupled(m: Measurements, generator: Generator) -> Posted:
    """Post the third joint as a controller shows it that couples it to the second."""
    joints = m.joints.copy()
    joints[:, 2] += joints[:, 1] * (1.0 if generator.random() < 0.5 else -1.0)
    return Posted(replace(m, joints=joints))


def _zero_offset(m: Measurements, generator: Generator) -> Posted:
    """Post a joint's angle by another zero, a quarter turn or a half away."""
    joints = m.joints.copy()
    joints[:, int(generator.integers(joints.shape[1]))] += 0.5 * np.pi * generator.choice([-1.0, 1.0, 2.0])
    return Posted(replace(m, joints=joints))


def _force_unit(m: Measurements, generator: Generator) -> Posted:
    return Posted(replace(m, force=m.force * (1e3 if generator.random() < 0.5 else 1e-3)))


def _deflection_unit(m: Measurements, generator: Generator) -> Posted:
    factor = 1e3 if generator.random() < 0.5 else 1e-3
    return Posted(replace(m, deflection=factor * m.deflection))


def _wrong_sigma(m: Measurements, generator: Generator) -> Posted:
    return Posted(replace(m, sigma=SIGMA * 10.0 ** generator.uniform(-1.5, 1.0)))


def _exchanged_load(m: Measurements, generator: Generator) -> Posted:
    """Post the place of a target as the load point, and that of the load as the target's."""
    t = int(generator.integers(m.position.shape[1]))
    position = m.position.copy()
    position[:, t] = np.where(m.in_flange[:, t, None], m.load_point, position[:, t])
    place = np.broadcast_to(np.array(list(TARGETS.values()))[t], m.load_point.shape)
    return Posted(replace(m, load_point=place, position=position))


PLANTED: tuple[tuple[str, Callable[[Measurements, Generator], Posted], bool], ...] = (
    *((mistake.name, mistake.make, mistake.by_deflections) for mistake in MISTAKES),
    ("coupled joints", _coupled, True),
    ("zero of one joint", _zero_offset, True),
    ("N/kN", _force_unit, True),
    ("unit of the deflections", _deflection_unit, True),
    ("wrong sigma", _wrong_sigma, True),
    ("load and target exchanged", _exchanged_load, True),
)


def _planted_section(sets: int) -> Section:
    verdicts: dict[str, Counter[str]] = {}
    harm: Counter[str] = Counter()
    seeds = []
    for seed in range(FIRST_SEED, FIRST_SEED + sets):
        name, posted, method, truth = planted_campaign(seed)
        counts = verdicts.setdefault(name, Counter())
        try:
            found = assess_set(posted, method, truth)
        except JointstiffError:
            counts[_REFUSED] += 1
            continue
        counts[found.assessment.verdict] += 1
        if found.assessment.verdict == "use" and found.error > HARM:
            harm[name] += 1
            seeds.append(seed)
    rows = tuple(
        (name, *(str(counts[v]) for v in (*_VERDICTS, _REFUSED)), str(harm[name]))
        for name, counts in sorted(verdicts.items())
    )
    what = f'{sets:,} planted mistakes: "use" with an estimate off by more than {HARM:g} u'
    return Section(
        title=f"Assessment: {sets:,} campaigns with one mistake each",
        columns=("mistake", *_VERDICTS, _REFUSED, f'"use", off by more than {HARM:g} u'),
        rows=rows,
        figures=(Figure(what, float(len(seeds)), "at most", 0.0),),
        notes=("all methods, K_c included; 10 to 40 configurations; sigma stated in half of them",),
        data={"seeds": seeds},
    )


def _clean_section(sets: int) -> Section:
    verdicts: Counter[str] = Counter()
    codes: Counter[str] = Counter()
    seeds = []
    for seed in range(FIRST_SEED, FIRST_SEED + sets):
        measurements, method, truth = clean_campaign(seed)
        found = assess_set(Posted(measurements), method, truth)
        if found.relative_uncertainty >= WELL_DETERMINED:
            continue
        verdicts[found.assessment.verdict] += 1
        codes.update({reason.code for reason in found.assessment.reasons})
        if found.assessment.verdict != "use":
            seeds.append(seed)
    share = 100.0 * verdicts["use"] / max(1, verdicts.total())
    return Section(
        title=f"Assessment: {verdicts.total():,} of {sets:,} clean sets, all u(c)/c < {WELL_DETERMINED:g}",
        columns=_VERDICTS,
        rows=(tuple(str(verdicts[v]) for v in _VERDICTS),),
        figures=(Figure('clean campaigns called "use"', share, "at least", 99.0, " %"),),
        notes=(
            "all methods, K_c included; 5 to 40 configurations; positions or deflections; sigma in half",
            f"reasons: {', '.join(f'{code} {count}' for code, count in codes.items()) or 'none'}",
        ),
        data={"seeds": seeds},
    )


def _cost_section(rounds: int) -> Section:
    campaign = small_campaign()
    robot, settings = campaign.robot, default_settings(campaign.robot)
    stated, unstated = campaign.measurements, replace(campaign.measurements, sigma=None)
    times = interleaved(
        {
            _RUN: partial(_run, robot, stated, settings),
            _ASSESSED: partial(_run, robot, stated, settings, assessed=True),
            _RUN_WITHOUT_SIGMA: partial(_run, robot, unstated, settings),
            _WITHOUT_SIGMA: partial(_run, robot, unstated, settings, assessed=True),
            _ALTERNATIVES: partial(better_alternative, robot, stated),
        },
        rounds=rounds,
        warm_up=3,
    )
    columns, rows = times_table(times, _RUN)
    what = "alternatives, beside a run of 19 configurations without them"
    return Section(
        title="Assessment: its share of a run, 19 configurations × 3 targets",
        columns=columns,
        rows=rows,
        figures=(Figure(what, 100.0 * times.ratio(_ALTERNATIVES, _RUN), "at most", 25.0, " %"),),
        notes=(
            "a run: inspection, identification, prediction and findings, without store and messages",
            "alternatives are left out where the residuals agree with a stated sigma",
        ),
        data={"seconds": times.seconds},
    )


def _run(robot: Robot, m: Measurements, settings: Settings, *, assessed: bool = False) -> object:
    findings = inspect(robot, m, degrees=False)
    estimate = identify(robot, m, settings)
    prediction = predict(robot, m, estimate.compliance)
    if assessed:
        return assess(robot, m, settings, estimate, prediction, findings)
    return [*judge(estimate)]


_RUN = "run, sigma stated"
_ASSESSED = "run and assessment, sigma stated"
_RUN_WITHOUT_SIGMA = "run, sigma from residuals"
_WITHOUT_SIGMA = "run and assessment, sigma from residuals"
_ALTERNATIVES = "alternatives alone"
_REFUSED = "refused"
_VERDICTS = ("use", "use_with_care", "do_not_use")
_ROBOT = default_robot(default_arm())
