"""Which model and loss the held-out readings call for, and the simplest model that is good enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
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
    standard_error: float  #: of that mean, from the spread of the folds
    by_fold: FloatArray  #: (K,) compensation of each fold


@dataclass(frozen=True, eq=False)
class Selection:
    """Models and losses side by side, from simple to rich."""

    models: tuple[HeldOut, ...]  #: that were compared, each with all losses
    best: ModelName  #: of the greatest mean compensation, each model with its loss of least held-out error
    simplest: ModelName  #: the simplest whose mean is within one standard error of the best one's

    def of(self, model: ModelName, losses: Sequence[Loss] = LOSSES) -> HeldOut:
        """Return a model with the loss of least held-out error."""
        return _best_loss(self.models, model, losses)


def _best_loss(models: Sequence[HeldOut], name: ModelName, losses: Sequence[Loss]) -> HeldOut:
    found = [each for each in models if each.model == name and each.loss in losses]
    return min(found, key=lambda each: each.error)


def select_model(
    robot: Robot,
    measurements: Measurements,
    folds: Folds,
    fits: Mapping[tuple[ModelName, Loss], Sequence[FoldFit]],
    plan: Plan,
    asked: ModelName | None = None,
) -> Selection:
    """Choose the weight of each model and loss, and compare them at theirs.

    Args:
        robot: n joints.
        measurements: that the folds share out.
        folds: of them.
        fits: of each model and loss, one a fold.
        plan: weights and rule.
        asked: the model that must have an answer; one without certified answers is left out otherwise.

    Raises:
        UnsupportedMethodError: that model has no weight with certified answers.
    """
    keys = [(name, loss) for name in MODELS for loss in LOSSES if (name, loss) in fits]
    errors = {key: np.array([fit.error for fit in fits[key]]) for key in keys}
    answers = {key: bool(answered(errors[key]).any()) for key in keys}
    none = not any(answers[key] for key in keys if key[0] == asked)
    keys = [key for key in keys if answers[key] or (none and key[0] == asked)]
    places = [chosen_weight(errors[key], plan.rule) for key in keys]
    chosen = np.array(
        [[fit.compliances[place] for fit in fits[key]] for key, place in zip(keys, places, strict=True)]
    )
    compensation = np.array(
        [
            _compensation(robot, measurements[indices], folds, chosen[:, number])
            for number, indices in enumerate(folds.held_out)
        ]
    ).T
    models = tuple(
        _held_out(key, float(errors[key][:, place].mean()), plan.weights[place], compensation[number])
        for number, (key, place) in enumerate(zip(keys, places, strict=True))
    )
    by_name = [_best_loss(models, name, LOSSES) for name in MODELS if any(name == key[0] for key in keys)]
    best = max(by_name, key=lambda each: each.compensation)
    limit = best.compensation - best.standard_error
    simplest = next(each for each in by_name if each.compensation >= limit)
    return Selection(models, best.model, simplest.model)


def _held_out(key: tuple[ModelName, Loss], error: float, weight: float, by_fold: FloatArray) -> HeldOut:
    """Return mean and spread over the folds."""
    return HeldOut(
        model=key[0],
        loss=key[1],
        error=error,
        penalty=None if key[0] == "joints" else weight,
        compensation=float(by_fold.mean()),
        standard_error=float(by_fold.std(ddof=1) / np.sqrt(len(by_fold))),
        by_fold=by_fold,
    )


def _compensation(
    robot: Robot, measurements: Measurements, folds: Folds, compliances: FloatArray
) -> FloatArray:
    """(M,) compensation of some observations by the compliances (M, P) of M models."""
    left, moved = np.zeros(len(compliances)), 0.0
    for block in elastic_blocks(robot, measurements, folds.columns):
        part = block.base.measurements
        predicted = np.einsum("btip,mp->mbti", block.rows, compliances)
        residual = np.linalg.norm(part.deflection - predicted, axis=-1)
        left += residual[:, part.present].sum(axis=1)
        moved += float(np.linalg.norm(part.deflection, axis=-1)[part.present].sum())
    return 1.0 - left / moved if moved > 0.0 else np.zeros(len(compliances))
