"""Elastic links on a real robot (method.md §7, §11): readings held out, and balls of the model error.

The readings are no part of this project; where they are not beside the checkout, a note says so.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.options import CrossValidation, Loss
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.choice.held_out import (
    WEIGHTS,
    Folds,
    choose_weight_index,
    fit_first_certified,
    fit_folds,
    refine_path,
    select_model,
)
from jointstiff.solver.fit.elastic import ElasticFit
from jointstiff.solver.fit.part import generate_elastic_rows
from jointstiff.solver.fit.reduced import LOSSES, Candidate, fit_loss
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.models import ELASTIC_MODELS, Columns, find_model
from jointstiff.solver.predict.models import ElasticPredictor, estimate_error_by_leaving_folds_out

__all__ = ["held_out_compensation", "run"]

CAMPAIGN = Path(__file__).parents[3] / "shared" / "data" / "fanuc_r2000ic" / "campaign.json"
COLUMNS = Columns(6, tuple(range(6)))
VISIBLE = np.ones(6, dtype=np.bool_)
_MODELS = tuple(model.name for model in ELASTIC_MODELS if not model.has_base)
SPLITS, FITTED = 20, 20
_CHOSEN = "joints_and_links, loss chosen"
_GAP = 1e-4  # gap of the fit of joints alone, relative to the readings


def run(*, quick: bool, part: Part) -> list[Section]:
    """Fit 20 postures and hold 10 out, split by split."""
    campaign = Campaign.model_validate(json.loads(CAMPAIGN.read_text(encoding="utf-8")))
    robot = prepare_robot(campaign.robot).robot
    readings = ReadingArrays.from_observations(campaign.measurement_set.observations)
    return [_fanuc(robot, to_measurements(campaign.measurement_set, readings, robot), quick=quick, part=part)]


def _fanuc(robot: Robot, measurements: Measurements, *, quick: bool, part: Part) -> Section:
    candidates: dict[str, tuple[ModelName, tuple[Loss, ...]]] = {
        **{name: (name, ("squared",)) for name in _MODELS},
        **{f"joints_and_links, {loss}": ("joints_and_links", (loss,)) for loss in LOSSES[1:]},
        _CHOSEN: ("joints_and_links", LOSSES),
    }
    found: dict[str, list[float]] = {name: [] for name in candidates}
    shares, of_splits = list[FloatArray](), list[float]()
    for seed in part.of(2 if quick else SPLITS):
        drawn = np.random.default_rng(seed).permutation(len(measurements))
        parts = measurements[np.sort(drawn[:FITTED])], measurements[np.sort(drawn[FITTED:])]
        folds = Folds(Rows(robot, parts[0]), COLUMNS, VISIBLE, CrossValidation(seed=seed), None)
        for name, (model, losses) in candidates.items():
            compliances, elastic = _best_loss(folds, model, losses)
            found[name].append(_compensation(robot, parts[1], compliances))
            if name == _CHOSEN and elastic is not None:
                shares.append(_share_of_ball(robot, parts[0], elastic, parts[1]))
                of_splits.append(1.0 / float(np.quantile(shares[-1], 0.9)))
    held = np.concatenate(shares) <= 1.0
    joints = np.array(found["joints"])
    rows = []
    for name, values in found.items():
        gain = 100 * (np.array(values) - joints)
        rows.append((name, *_mean_and_spread(100 * np.array(values)), *_mean_and_spread(gain)))
    compensated, radius = 100 * float(np.mean(found[_CHOSEN])), float(np.median(of_splits))
    crossed = _cross_validated(robot, measurements)
    return Section(
        title=f"FANUC R-2000iC, real readings: {len(joints)} splits, {FITTED} fitted and 10 held out",
        columns=("model", "held out, %", "deviation", "gain, points", "deviation"),
        rows=tuple(rows),
        figures=(
            Figure("FANUC: held-out compensation", compensated, "at least", 85.2, " %"),
            Figure("FANUC: cross-validated, 30 poses", crossed, "at least", 87, " %"),
            Figure("FANUC: ball of 90 %, radius over need, median", radius, "at most", 1.4),
            Figure("FANUC: readings within the ball of 90 %", 100 * float(held.mean()), "at least", 88, " %"),
        ),
        notes=(
            "loss and weight of the penalty are chosen within the fitted part, by five folds",
            "need: the factor of the balls' radii by which they hold 90 % of a split's held-out readings",
        ),
        data=found | {"radius over need": of_splits},
    )


def _share_of_ball(robot: Robot, fitted: Measurements, elastic: ElasticFit, held: Measurements) -> FloatArray:
    """Return how far held-out readings are from their predictions, over the radii of the balls for 90 %."""
    error = estimate_error_by_leaving_folds_out(Rows(robot, fitted), elastic)
    place = held.position[:, 0]  # in the flange frame
    cases = LoadCases(held.joints, held.force, held.moment, held.load_point, place.copy())
    bent = ElasticPredictor.from_estimate(robot, elastic).deflect(cases)
    off = np.linalg.norm(held.deflection[:, 0] - bent.displacement, axis=1)
    return np.asarray(off / error.bound(cases, bent.leverage, 0.9).radius)


def _cross_validated(robot: Robot, measurements: Measurements) -> float:
    """Compensation [%] of the whole set by cross-validation, joints and links, loss and penalty chosen."""
    folds = Folds(Rows(robot, measurements), COLUMNS, VISIBLE, CrossValidation(), None)
    models = [Candidate(find_model("joints_and_links"), COLUMNS, loss) for loss in LOSSES]
    selection = select_model(folds, {model.key: fit_folds(folds, model, WEIGHTS) for model in models})
    return 100 * selection.find_held_out("joints_and_links").compensation


def _best_loss(folds: Folds, name: ModelName, losses: Sequence[Loss]) -> tuple[FloatArray, ElasticFit | None]:
    """Compliances (P,) of a whole set under the loss and the weight that its folds choose, and the fit."""
    chosen = []
    for loss in losses:
        model = Candidate(find_model(name), COLUMNS, loss)
        path = fit_folds(folds, model, WEIGHTS)
        chosen.append((float(path.errors[:, choose_weight_index(path.errors, "best")].mean()), path, model))
    _, path, model = min(chosen, key=lambda each: each[0])
    if name == "joints":
        form = folds.reduce_training_rows(model)
        solution = fit_loss(form, model, path.weights[0], gap=_GAP).solution
        return form.to_compliances(solution.x), None
    path = refine_path(folds, model, path)
    elastic = fit_first_certified(folds, model, path.weights[choose_weight_index(path.errors, "best") :])
    return elastic.entries, elastic


def _compensation(robot: Robot, measurements: Measurements, compliances: FloatArray) -> float:
    residual, moved = [], []
    for rows in generate_elastic_rows(Rows(robot, measurements), COLUMNS):
        part = rows.block.measurements
        left = np.linalg.norm(rows.targets[..., -1] - rows.targets[..., :-1] @ compliances, axis=-1)
        residual.append(left[part.present])
        moved.append(np.linalg.norm(part.deflection, axis=-1)[part.present])
    return float(1.0 - np.concatenate(residual).mean() / np.concatenate(moved).mean())


def _mean_and_spread(values: FloatArray) -> tuple[str, str]:
    return f"{values.mean():.2f}", f"{values.std(ddof=1):.2f}"


def held_out_compensation(
    robot: Robot, fitted: Measurements, held_out: Measurements, name: ModelName, *, seed: int
) -> float:
    """Compensation of readings that took part neither in the fit nor in the choice of the weight."""
    folds = Folds(Rows(robot, fitted), COLUMNS, VISIBLE, CrossValidation(seed=seed), None)
    compliances, _ = _best_loss(folds, name, ("squared",))
    return _compensation(robot, held_out, compliances)
