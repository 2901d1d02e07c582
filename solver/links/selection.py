"""Choice of model and loss by the held-out readings, and of the simplest model that is good enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.inference.screening import CLEAR_GAIN, HeldOutGain
from jointstiff.solver.links.cross_validation import FoldFit, Folds, Plan, answered, chosen_weight
from jointstiff.solver.links.model import LOSSES, MODELS, Loss, ModelName
from jointstiff.solver.links.regressor import elastic_blocks
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Prediction of readings that were not used in the fit."""

    model: ModelName  #: which
    loss: Loss  #: which
    error: float  #: mean over the folds of the held-out error that chose the penalty; see `FoldFit` [m]
    penalty: float | None  #: weight λ that was chosen; None of joints alone
    compensation: float  #: mean over the folds of ``1 − mean‖δp − δp̂‖ / mean‖δp‖``
    standard_error: float  #: standard error of that mean for one draw, from the spread of the folds
    by_fold: FloatArray  #: (K,) compensation of each fold
    #: (P,) mean norm of the residuals of each posture while it was left out, mean over the draws [m]
    by_posture: FloatArray


@dataclass(frozen=True, eq=False)
class Selection:
    """Models and losses side by side, from simple to rich."""

    models: tuple[HeldOut, ...]  #: that were compared, each with all losses
    best: ModelName  #: model of least mean residual of held-out postures, each with its best loss
    simplest: ModelName  #: whose mean is near the best one's, paired by posture; see `simplest_of`
    #: gain of the best model but joints over joints alone; None where either has no answer
    gain: HeldOutGain | None

    def of(self, model: ModelName, losses: Sequence[Loss] = LOSSES) -> HeldOut:
        """Return a model with the loss of least held-out error."""
        return _best_loss(self.models, model, losses)

    def with_refined(self, refined: HeldOut) -> Selection:
        """Return the same with a model at another penalty."""
        key = refined.model, refined.loss
        models = tuple(refined if (each.model, each.loss) == key else each for each in self.models)
        return replace(self, models=models)


def _best_loss(models: Sequence[HeldOut], name: ModelName, losses: Sequence[Loss]) -> HeldOut:
    scores = [each for each in models if each.model == name and each.loss in losses]
    return min(scores, key=lambda each: each.error)


def select_model(
    robot: Robot,
    measurements: Measurements,
    folds: Folds,
    fits: Mapping[tuple[ModelName, Loss], Sequence[FoldFit]],
    plan: Plan,
    asked: ModelName | None = None,
    *,
    screened: bool = False,
) -> Selection:
    """Choose the weight of each model and loss, and compare them at these weights.

    Args:
        robot: n joints.
        measurements: that the folds share out.
        folds: of them.
        fits: of each model and loss, one a fold.
        plan: weights and rule.
        asked: the model that must have an answer; one without certified answers is left out otherwise.
        screened: whether a test has shown that something besides the joints bends.

    Raises:
        UnsupportedMethodError: that model has no weight with certified answers.
    """
    keys = [(name, loss) for name in MODELS for loss in LOSSES if (name, loss) in fits]
    errors = {key: np.array([fit.error for fit in fits[key]]) for key in keys}
    answers = {key: bool(answered(errors[key]).any()) for key in keys}
    none = not any(answers[key] for key in keys if key[0] == asked)
    keys = [key for key in keys if answers[key] or (none and key[0] == asked)]
    places = [chosen_weight(errors[key], plan.rule, plan.draws) for key in keys]
    chosen = np.array(
        [[fit.compliances[place] for fit in fits[key]] for key, place in zip(keys, places, strict=True)]
    )
    _, posture = np.unique(measurements.joints, axis=0, return_inverse=True)
    predicted = [
        _compensation(robot, measurements[indices], folds, chosen[:, number])
        for number, indices in enumerate(folds.held_out)
    ]
    compensation = np.array([each for each, _ in predicted]).T
    norms = np.concatenate([each for _, each in predicted], axis=1)
    of_posture = posture.reshape(-1)[np.concatenate(folds.held_out)]
    by_posture = np.array([np.bincount(of_posture, row) for row in norms]) / np.bincount(of_posture)
    models = tuple(
        _held_out(
            key,
            float(errors[key][:, place].mean()),
            plan.weights[place],
            compensation[number],
            by_posture[number],
            folds.per_draw,
        )
        for number, (key, place) in enumerate(zip(keys, places, strict=True))
    )
    by_name = [_best_loss(models, name, LOSSES) for name in MODELS if any(name == key[0] for key in keys)]
    best = min(by_name, key=lambda each: float(each.by_posture.mean()))
    return Selection(models, best.model, simplest_of(by_name, best, screened=screened), _gain(by_name))


def simplest_of(by_name: Sequence[HeldOut], best: HeldOut, *, screened: bool) -> ModelName:
    """Return the simplest of models, from simple to rich, that predicts nearly as well as the best.

    Nearly means one paired standard error; two for joints alone, unless a test has shown that something
    besides them bends: without it nearly every other rigid campaign would get a model with more.
    """
    of_joints = 1.0 if screened else CLEAR_GAIN
    return next(
        each.model
        for each in by_name
        if _behind(each, best) <= (of_joints if each.model == "joints" else 1.0)
    )


def _behind(one: HeldOut, best: HeldOut) -> float:
    """Return by how many paired standard errors a model predicts worse than the best."""
    worse = one.by_posture - best.by_posture
    spread = float(worse.std(ddof=1)) / np.sqrt(len(worse))
    return float(worse.mean()) / spread if spread > 0.0 else 0.0


def _gain(by_name: Sequence[HeldOut]) -> HeldOutGain | None:
    joints = next((each for each in by_name if each.model == "joints"), None)
    others = [each for each in by_name if each.model != "joints"]
    if joints is None or not others:
        return None
    best = min(others, key=lambda each: float(each.by_posture.mean()))
    better = joints.by_posture - best.by_posture
    return HeldOutGain(
        best.model,
        float(best.by_posture.mean()),
        float(joints.by_posture.mean()),
        float(better.std(ddof=1)) / np.sqrt(len(better)),
    )


def _held_out(
    key: tuple[ModelName, Loss],
    error: float,
    weight: float,
    by_fold: FloatArray,
    by_posture: FloatArray,
    per_draw: int,
) -> HeldOut:
    """Return mean and spread over the folds, of which a draw has so many."""
    return HeldOut(
        model=key[0],
        loss=key[1],
        error=error,
        penalty=None if key[0] == "joints" else weight,
        compensation=float(by_fold.mean()),
        standard_error=float(by_fold.std(ddof=1) / np.sqrt(per_draw)),
        by_fold=by_fold,
        by_posture=by_posture,
    )


def _compensation(
    robot: Robot, measurements: Measurements, folds: Folds, compliances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Predict some observations by the compliances (M, P) of M models.

    Returns:
        (M,) compensation; (M, N) mean norm of the residuals of each observation's targets [m].
    """
    left, moved, norms = np.zeros(len(compliances)), 0.0, []
    for block, rows in elastic_blocks(robot, measurements, folds.columns):
        part = block.measurements
        predicted = np.einsum("btip,mp->mbti", rows[..., :-1], compliances)
        residual = np.linalg.norm(part.deflection - predicted, axis=-1)
        count = np.maximum(part.present.sum(axis=1), 1)
        norms.append(np.where(part.present, residual, 0.0).sum(axis=-1) / count)
        left += residual[:, part.present].sum(axis=1)
        moved += float(np.linalg.norm(part.deflection, axis=-1)[part.present].sum())
    compensation = 1.0 - left / moved if moved > 0.0 else np.zeros(len(compliances))
    return compensation, np.concatenate(norms, axis=1)
