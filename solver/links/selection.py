"""Which model the held-out readings call for: compensation of each, and the simplest that is good enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.links.cross_validation import FoldFit, Folds, Plan, answered, chosen_weight
from jointstiff.solver.links.effective import EffectiveSpread, effective_rows
from jointstiff.solver.links.model import MODELS, ModelName
from jointstiff.solver.links.regressor import elastic_blocks
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Prediction of readings that were not used in the fit.

    Attributes:
        model: which.
        penalty: weight λ that was chosen; None of joints alone.
        compensation: mean over the folds of ``1 − mean‖δp − δp̂‖ / mean‖δp‖``.
        standard_error: of that mean, from the spread of the folds.
        by_fold: (K,) compensation of each fold.
        effective: dispersion of the joints' effective compliances.
    """

    model: ModelName
    penalty: float | None
    compensation: float
    standard_error: float
    by_fold: FloatArray
    effective: EffectiveSpread


@dataclass(frozen=True, eq=False)
class Selection:
    """The models side by side, from simple to rich.

    Attributes:
        models: that were compared.
        best: of the greatest mean compensation.
        simplest: the simplest whose mean is within one standard error of the best one's.
    """

    models: tuple[HeldOut, ...]
    best: ModelName
    simplest: ModelName

    def of(self, model: ModelName) -> HeldOut:
        """One of them."""
        return next(held_out for held_out in self.models if held_out.model == model)


def select_model(
    robot: Robot,
    measurements: Measurements,
    folds: Folds,
    fits: Mapping[ModelName, Sequence[FoldFit]],
    plan: Plan,
    asked: ModelName | None = None,
) -> Selection:
    """Choose each model's weight, and compare the models at theirs.

    Args:
        robot: n joints.
        measurements: that the folds share out.
        folds: of them.
        fits: of each model, one a fold.
        plan: weights and rule.
        asked: the model that must have an answer; one without certified answers is left out otherwise.

    Raises:
        UnsupportedMethodError: that model has no weight with certified answers.
    """
    errors = {name: np.array([fit.error for fit in fits[name]]) for name in MODELS if name in fits}
    names = [name for name, each in errors.items() if name == asked or answered(each).any()]
    places = [chosen_weight(errors[name], plan.rule) for name in names]
    chosen = np.array(
        [[fit.compliances[place] for fit in fits[name]] for name, place in zip(names, places, strict=True)]
    )
    compensation = np.array(
        [
            _compensation(robot, measurements[indices], folds, chosen[:, number])
            for number, indices in enumerate(folds.held_out)
        ]
    ).T
    rows = effective_rows(robot, folds.columns)
    spreads = [
        EffectiveSpread.of(np.array([fit.compliances for fit in fits[name]]) @ rows.T, place)
        for name, place in zip(names, places, strict=True)
    ]
    models = tuple(
        _held_out(name, plan.weights[place], spreads[number], compensation[number])
        for number, (name, place) in enumerate(zip(names, places, strict=True))
    )
    best = max(models, key=lambda each: each.compensation)
    limit = best.compensation - best.standard_error
    simplest = next(each for each in models if each.compensation >= limit)
    return Selection(models, best.model, simplest.model)


def _held_out(name: ModelName, weight: float, effective: EffectiveSpread, by_fold: FloatArray) -> HeldOut:
    """Return mean and spread over the folds."""
    return HeldOut(
        model=name,
        penalty=None if name == "joints" else weight,
        compensation=float(by_fold.mean()),
        standard_error=float(by_fold.std(ddof=1) / np.sqrt(len(by_fold))),
        by_fold=by_fold,
        effective=effective,
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
