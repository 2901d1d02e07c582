"""Clean elastic campaigns, all of which must be answered: exact beams, sizes, stiffnesses and noise drawn."""

from __future__ import annotations

from collections import Counter

import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.report import Figure, Part, Section
from jointstiff.simulator import default_arm
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_positions
from jointstiff.simulator.experiment import TARGETS, plan_experiment
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.links.cross_validation import WEIGHTS, Folds, Plan, chosen_weight, fit_fold
from jointstiff.solver.links.estimation import effective_intervals, first_certified
from jointstiff.solver.links.model import LOSSES, ElasticModel, Loss
from jointstiff.solver.links.regressor import ElasticColumns
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

_COLUMNS = ElasticColumns(6, tuple(range(6)))
_PLAN = Plan(folds=2, weights=WEIGHTS[1::3])


def beams(seed: int) -> tuple[Robot, Measurements]:
    """A campaign of 8 to 60 pulls on an arm whose links are beams, 2 to 50 µm of noise."""
    rng = np.random.default_rng([seed, 61])
    elastic = beam_arm(default_arm(), bending=6e6 * 10.0 ** rng.uniform(-0.3, 1.0))
    count, sigma = int(rng.integers(8, 61)), 10.0 ** rng.uniform(-5.7, -4.3)
    return _campaign(elastic, count, seed, sigma, known=bool(rng.random() < 0.7))


def _campaign(
    elastic: ElasticArm, count: int, seed: int, sigma: float, *, known: bool
) -> tuple[Robot, Measurements]:
    experiment = plan_experiment(elastic.arm, configurations=count, load="pull", seed=seed)
    unloaded, loaded = elastic_positions(elastic, experiment, TARGETS, sigma=sigma, seed=seed)
    present = np.ones(unloaded.shape[:2], dtype=np.bool_)
    return default_robot(elastic.arm), Measurements(
        joints=experiment.joints,
        force=experiment.forces,
        moment=experiment.moments,
        load_point=np.array(experiment.load_points),
        position=unloaded,
        in_flange=~present,
        deflection=loaded - unloaded,
        present=present,
        sigma=sigma if known else None,
    )


def run_answered(*, quick: bool, part: Part) -> list[Section]:
    """Run the campaigns that must be answered."""
    return [answered_section(quick=quick, part=part)]


def run_coverage(*, quick: bool, part: Part) -> list[Section]:
    """Run the campaigns that intervals must hold on."""
    return [coverage_section(quick=quick, part=part)]


def answered_section(*, quick: bool, part: Part) -> Section:
    """Choose the penalty by cross-validation and fit the whole set, joints and links, each loss in turn."""
    seeds = part.of(6 if quick else 500)
    ends: Counter[str] = Counter()
    gaps = []
    for seed in seeds:
        robot, measurements = beams(seed)
        try:
            gaps.append(_gap(robot, measurements, LOSSES[seed % 3]))
            ends["answered"] += 1
        except JointstiffError as error:
            ends[error.reason] += 1
    return Section(
        title=f"Clean campaigns on beams: {len(seeds)}, 8 to 60 configurations, 2 to 50 µm of noise",
        columns=("end", "campaigns"),
        rows=tuple((end, str(number)) for end, number in ends.items()),
        figures=(
            Figure("clean elastic campaigns without an answer", len(seeds) - ends["answered"], "at most", 0),
            Figure("clean elastic campaigns: greatest gap", max(gaps), "at most", 1e-2, " sigma"),
        ),
        notes=("loss squared, huber and absolute in turn; three penalties and two folds",),
    )


def coverage_section(*, quick: bool, part: Part) -> Section:
    """Count how often the 95 % intervals of the effective compliances hold what the beams have."""
    seeds, rows, figures = part.of(2 if quick else 40), [], []
    for count in (20,) if quick else (20, 40, 100):
        found = [_held(count, seed) for seed in seeds]
        held, width = (np.array(each) for each in zip(*found, strict=True))
        cells = (f"{100 * share:.0f}" for share in held.mean(axis=0))
        rows.append((str(count), *cells, f"{np.median(width):.2f}"))
        share = 100 * float(held.mean())
        figures.append(
            Figure(f"effective stiffness, {count} postures: coverage", share, "at least", 93, " %")
        )
    return Section(
        title=f"Effective stiffness about each axis: coverage of 95 % intervals, {len(seeds)} campaigns",
        columns=("postures", *(f"joint {joint + 1}, %" for joint in range(6)), "median half-width"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=("half-widths relative to the true compliance; loss squared",),
    )


def _held(count: int, seed: int) -> tuple[BoolArray, FloatArray]:
    """Return which intervals (n,) hold the truth, and their half-widths relative to it."""
    bending = 6e6 * 10.0 ** np.random.default_rng([seed, 62]).uniform(0.0, 1.0)
    elastic, model = beam_arm(default_arm(), bending=bending), ElasticModel("joints_and_links", _COLUMNS)
    robot, measurements = _campaign(elastic, count, seed, 2e-5, known=True)
    plan, axes = Plan(), elastic.arm.axis_directions
    folds = Folds(robot, measurements, _COLUMNS, np.ones(6, dtype=np.bool_), plan)
    fits = [fit_fold(folds, model, fold, plan.weights) for fold in range(len(folds))]
    place = chosen_weight(np.array([fit.error for fit in fits]), plan.rule)
    estimate = first_certified(robot, measurements, folds, model, plan.weights[place:])
    truth = elastic.arm.compliances + np.einsum("ji,jik,jk->j", axes, elastic.links[:, 3:, 3:], axes)
    intervals = effective_intervals(robot, estimate, 0.95)
    if intervals is None:
        return np.zeros(6, dtype=np.bool_), np.full(6, np.inf)
    low, high = intervals.ends.T
    return (low <= truth) & (truth <= high), 0.5 * (high - low) / truth


def _gap(robot: Robot, measurements: Measurements, loss: Loss) -> float:
    model = ElasticModel("joints_and_links", _COLUMNS, loss)
    folds = Folds(robot, measurements, _COLUMNS, np.ones(6, dtype=np.bool_), _PLAN)
    fits = [fit_fold(folds, model, fold, _PLAN.weights) for fold in range(len(folds))]
    place = chosen_weight(np.array([fit.error for fit in fits]), _PLAN.rule)
    weights = WEIGHTS[WEIGHTS.index(_PLAN.weights[place]) :]
    return first_certified(robot, measurements, folds, model, weights).certificate.gap
