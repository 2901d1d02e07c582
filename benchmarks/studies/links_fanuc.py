"""Elastic links on a real robot (method.md §7, §11): readings held out, and balls of the model error.

The readings are no part of this project; where they are not beside the checkout, a note says so.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.options import CrossValidation, RunOptions
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.choice.competition import Competition, Winner
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.elastic import ElasticFit
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.part import generate_elastic_rows
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.models import ELASTIC_MODELS, Columns
from jointstiff.solver.predict.models import ElasticPredictor, estimate_error_by_leaving_folds_out

__all__ = ["held_out_compensation", "run"]

_Loss = Literal["squared", "huber", "automatic"]
CAMPAIGN = Path(__file__).parents[3] / "shared" / "data" / "fanuc_r2000ic" / "campaign.json"
COLUMNS = Columns(6, tuple(range(6)))
_MODELS = tuple(model.name for model in ELASTIC_MODELS if not model.has_base)
SPLITS, FITTED = 20, 20
_CHOSEN = "joints_and_links, loss chosen"


def run(*, quick: bool, part: Part) -> list[Section]:
    """Fit 20 postures and hold 10 out, split by split."""
    campaign = Campaign.model_validate(json.loads(CAMPAIGN.read_text(encoding="utf-8")))
    robot = prepare_robot(campaign.robot).robot
    readings = ReadingArrays.from_observations(campaign.measurement_set.observations)
    return [_fanuc(robot, to_measurements(campaign.measurement_set, readings, robot), quick=quick, part=part)]


def _fanuc(robot: Robot, measurements: Measurements, *, quick: bool, part: Part) -> Section:
    candidates: dict[str, tuple[ModelName, _Loss]] = {
        **{name: (name, "squared") for name in _MODELS},
        "joints_and_links, huber": ("joints_and_links", "huber"),
        _CHOSEN: ("joints_and_links", "automatic"),
    }
    found: dict[str, list[float]] = {name: [] for name in candidates}
    shares, of_splits = list[FloatArray](), list[float]()
    for seed in part.of(2 if quick else SPLITS):
        drawn = np.random.default_rng(seed).permutation(len(measurements))
        fitted, held_out = measurements[np.sort(drawn[:FITTED])], measurements[np.sort(drawn[FITTED:])]
        for name, (model, loss) in candidates.items():
            compliances, elastic = _fit(robot, fitted, model, loss, seed)
            found[name].append(_compensation(robot, held_out, compliances))
            if name == _CHOSEN and elastic is not None:
                shares.append(_share_of_ball(robot, fitted, elastic, held_out))
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
            "loss and penalty are those of a run, which chooses them by five folds of the fitted part",
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
    options = RunOptions(elasticity="joints_and_links", loss="automatic")
    return 100 * _compete(robot, measurements, options).held_out.compensation


def _fit(
    robot: Robot, measurements: Measurements, model: ModelName, loss: _Loss, seed: int
) -> tuple[FloatArray, ElasticFit | None]:
    """Fit a model as a run does that names the model: the run chooses the penalty, and a loss left open.

    Returns:
        The compliances (P,) in the order of `COLUMNS`; and the fit, None for joints alone.
    """
    options = RunOptions(elasticity=model, loss=loss, cross_validation=CrossValidation(seed=seed))
    if model == "joints":
        joints = JointsAlone(Rows(robot, measurements), Settings.from_options(options, robot))
        of_joints = joints.estimate.compliance
        return np.concatenate([of_joints, np.zeros(COLUMNS.width - len(of_joints))]), None
    elastic = _compete(robot, measurements, options).elastic
    if elastic is None:
        raise AssertionError("a model that is named is fitted")
    return elastic.estimate.entries, elastic.estimate


def _compete(robot: Robot, measurements: Measurements, options: RunOptions) -> Winner:
    """Return the winner of the competition of a run."""
    joints = JointsAlone(Rows(robot, measurements), Settings.from_options(options, robot))
    competition = Competition(joints, options)
    return competition.choose_winner([competition.compute(step) for step in competition.steps()])


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
    compliances, _ = _fit(robot, fitted, name, "squared", seed)
    return _compensation(robot, held_out, compliances)
