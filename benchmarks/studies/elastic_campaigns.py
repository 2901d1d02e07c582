"""Clean elastic campaigns, all of which must be answered: exact beams, sizes, stiffnesses and noise drawn."""

from __future__ import annotations

from collections import Counter
from typing import Any, Literal

import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.report import Figure, Part, Section
from jointstiff import identify
from jointstiff.schemas.options import Loss
from jointstiff.simulator import default_arm
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign, elastic_positions
from jointstiff.simulator.experiment import TARGETS, plan_experiment
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.links.choice import (
    Folds,
    Plan,
    chosen_weight,
    fit_fold,
    refined,
)
from jointstiff.solver.links.fit import ElasticEstimate, effective_compliances, first_certified
from jointstiff.solver.links.model import LOSSES, ElasticColumns, ElasticModel
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.predict.model_error import leave_folds_out
from jointstiff.solver.predict.models import ElasticPredictor
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

_COLUMNS = ElasticColumns(6, tuple(range(6)))
_PLAN = Plan(folds=2, draws=1, weights=(1e-6, 1e-3, 1.0))


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
    """Run the campaigns that intervals must hold on: by full links, and without a model asked for."""
    return [coverage_section(quick=quick, part=part), default_section(quick=quick, part=part)]


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
    seeds, rows, figures = part.of(1 if quick else 40), [], []
    compared: dict[str, tuple[Loss, ...]] = {loss: (loss,) for loss in LOSSES} | {"automatic": LOSSES}
    for count in (20,) if quick else (20, 40, 100):
        campaigns = [_Campaign(count, seed, compared) for seed in seeds]
        for name in compared:
            held, width = (
                np.array([getattr(each, what)[name] for each in campaigns]) for what in ("held", "width")
            )
            cells = (f"{100 * share:.0f}" for share in held.mean(axis=0))
            rows.append((name, str(count), *cells, f"{np.median(width):.2f}"))
            figures.append(
                Figure(
                    f"effective stiffness, loss {name}, {count} postures: coverage",
                    100 * float(held.mean()),
                    "at least",
                    93,
                    " %",
                )
            )
    return Section(
        title=f"Effective stiffness about each axis: coverage of 95 % intervals, {len(seeds)} campaigns",
        columns=("loss", "postures", *(f"joint {joint + 1}, %" for joint in range(6)), "median half-width"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "half-widths relative to the true compliance; the penalty of intervals was chosen on other seeds",
        ),
    )


def default_section(*, quick: bool, part: Part) -> Section:
    """Count how often the intervals of runs hold what the beams have, after the model was chosen."""
    seeds, rows, figures = part.of(1 if quick else 26), [], []
    campaigns = [_drawn_beams(seed) for seed in seeds]
    losses: tuple[Literal["squared", "huber", "automatic"], ...] = ("squared", "huber", "automatic")
    for loss in losses[:1] if quick else losses:
        chosen, held, width, inside = Counter[str](), list[bool](), list[float](), 0
        for elastic, document in campaigns:
            result = identify(document, elasticity="automatic", loss=loss).result
            if result is None or result.choice is None or result.choice.source != "cross_validation":
                chosen["not escalated"] += 1
                continue
            chosen[result.choice.elasticity] += 1
            for joint, truth in zip(result.joints, effective_truth(elastic), strict=True):
                if joint.compliance is None or joint.compliance_interval is None:
                    held.append(False)
                    continue
                low, high = joint.compliance_interval
                held.append(low <= truth <= high)
                width.append(0.5 * (high - low) / truth)
                inside += low <= joint.compliance <= high
        models = ", ".join(f"{name} {number}" for name, number in chosen.items())
        share = 100 * float(np.mean(held)) if held else 0.0
        half = f"{np.median(width):.2f}" if width else ""
        rows.append((loss, models, f"{sum(held)} of {len(held)}", f"{share:.1f}", half))
        what = f"default runs, loss {loss}: intervals of the effective stiffness"
        figures.append(Figure(f"{what} that hold it", share, "at least", 93, " %"))
        figures.append(Figure(f"{what} without the published value", len(width) - inside, "at most", 0))
    return Section(
        title=f"Effective stiffness after the choice of a model: {len(seeds)} default runs a loss",
        columns=("loss", "models chosen", "joints held", "coverage, %", "median half-width"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "exact beams, EI 3e6 to 6e7 N·m², 20 to 30 postures; what is not escalated is not counted",
            "loss absolute cannot be asked for without a model: automatic compares it with the others",
        ),
    )


def _drawn_beams(seed: int) -> tuple[ElasticArm, dict[str, Any]]:
    """Return an arm whose links are beams, and a campaign on it."""
    rng = np.random.default_rng([seed, 63])
    elastic = beam_arm(default_arm(), bending=3e6 * 20.0 ** rng.uniform())
    return elastic, elastic_campaign(elastic, configurations=int(rng.integers(20, 31)), seed=seed + 7_000)


def effective_truth(elastic: ElasticArm) -> FloatArray:
    """(n,) compliances of the joints with their links' rotations about their axes [rad/(N·m)]."""
    axes = elastic.arm.axis_directions
    of_links: FloatArray = np.einsum("ji,jik,jk->j", axes, elastic.links[:, 3:, 3:], axes)
    return elastic.arm.compliances + of_links


class _Campaign:
    """Intervals of a campaign on beams for each choice of losses, and the balls of the model error."""

    def __init__(self, count: int, seed: int, compared: dict[str, tuple[Loss, ...]]) -> None:
        """Fit each loss once."""
        bending = 6e6 * 10.0 ** np.random.default_rng([seed, 62]).uniform(0.0, 1.0)
        self.beams, self.seed = beam_arm(default_arm(), bending=bending), seed
        self.robot, self.measurements = _campaign(self.beams, count, seed, 2e-5, known=True)
        plan = Plan()
        self.folds = Folds(self.robot, self.measurements, _COLUMNS, np.ones(6, dtype=np.bool_), plan)
        truth = effective_truth(self.beams)
        found = {
            loss: self._fitted(loss, plan) for loss in {each for some in compared.values() for each in some}
        }
        self.held, self.width = dict[str, BoolArray](), dict[str, FloatArray]()
        self.chosen = dict[str, ElasticEstimate]()
        for name, losses in compared.items():
            _, estimate = min((found[loss] for loss in losses), key=lambda each: each[0])
            ends = effective_compliances(self.robot, estimate, 0.95).ends
            self.held[name] = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
            self.width[name] = 0.5 * np.ptp(ends, axis=1) / truth
            self.chosen[name] = estimate

    def _fitted(self, loss: Loss, plan: Plan) -> tuple[float, ElasticEstimate]:
        """Return the held-out error, and the fit to the whole set."""
        model = ElasticModel("joints_and_links", _COLUMNS, loss)
        fits = [fit_fold(self.folds, model, fold, plan.weights) for fold in range(len(self.folds))]
        plan, fits = refined(self.folds, model, fits, plan)
        errors = np.array([fit.error for fit in fits])
        place = chosen_weight(errors, plan.rule)
        estimate = first_certified(self.robot, self.measurements, self.folds, model, plan.weights[place:])
        return float(errors[:, place].mean()), estimate

    def ball(self, estimate: ElasticEstimate) -> tuple[float, float]:
        """Return how often the ball for 90 % holds exact beams elsewhere, and its radius over need."""
        model = ElasticPredictor.of(self.robot, estimate)
        error = leave_folds_out(self.robot, self.measurements, estimate)
        other = plan_experiment(self.beams.arm, configurations=100, load="pull", seed=self.seed + 50_000)
        unloaded, loaded = elastic_positions(self.beams, other, TARGETS, sigma=0.0, seed=0)
        count = unloaded.shape[1]
        joints, force, moment, load_point = (
            np.repeat(np.asarray(each), count, axis=0)
            for each in (other.joints, other.forces, other.moments, other.load_points)
        )
        cases = LoadCases(
            joints, force, moment, load_point, np.tile(np.array(list(TARGETS.values())), (100, 1))
        )
        deflection = model.deflect(cases)
        off = np.linalg.norm(deflection.displacement - (loaded - unloaded).reshape(-1, 3), axis=1)
        share = off / error.bound(cases, deflection.leverage, 0.9).radius
        return float((share <= 1.0).mean()), 1.0 / float(np.quantile(share, 0.9))


def run_ball(*, quick: bool, part: Part) -> list[Section]:
    """Hold the balls of the model error beside exact beams in postures that were not fitted."""
    rows, figures = [], []
    for count in (20,) if quick else (20, 40):
        campaigns = [
            _Campaign(count, seed, {"squared": ("squared",)}) for seed in part.of(2 if quick else 24)
        ]
        covers, over = (
            np.array(each)
            for each in zip(*(each.ball(each.chosen["squared"]) for each in campaigns), strict=True)
        )
        rows.append((str(count), f"{100 * covers.mean():.1f}", f"{np.median(over):.2f}", f"{over.max():.2f}"))
        what = f"ball of 90 %, {count} postures:"
        figures.append(Figure(f"{what} covers", 100 * float(covers.mean()), "at least", 88, " %"))
        figures.append(Figure(f"{what} covers", 100 * float(covers.mean()), "at most", 97, " %"))
        figures.append(Figure(f"{what} radius over need, median", float(np.median(over)), "at most", 1.5))
    return [
        Section(
            title="Model error of elastic links on exact beams: balls for 90 %",
            columns=("postures", "covers, %", "radius over need, median", "greatest"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=("100 other postures a campaign, three targets, no noise in what is to be held",),
        )
    ]


def _gap(robot: Robot, measurements: Measurements, loss: Loss) -> float:
    model = ElasticModel("joints_and_links", _COLUMNS, loss)
    folds = Folds(robot, measurements, _COLUMNS, np.ones(6, dtype=np.bool_), _PLAN)
    fits = [fit_fold(folds, model, fold, _PLAN.weights) for fold in range(len(folds))]
    place = chosen_weight(np.array([fit.error for fit in fits]), _PLAN.rule)
    weights = [_PLAN.weights[place] * 10.0**decade for decade in range(4)]
    return first_certified(robot, measurements, folds, model, weights).certificate.gap
