"""Which model the held-out readings call for: compensation of each, and the simplest that is good enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import diagonal
from jointstiff.solver.links.cross_validation import FoldFit, Folds, Plan, chosen_weight
from jointstiff.solver.links.model import MODELS, ModelName
from jointstiff.solver.links.regressor import elastic_blocks
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot


@dataclass(frozen=True, eq=False)
class HeldOut:
    """How a model predicts readings that it was not fitted to.

    Attributes:
        model: which.
        penalty: weight λ that was chosen; None of joints alone.
        compensation: mean over the folds of ``1 − mean‖δp − δp̂‖ / mean‖δp‖``.
        standard_error: of that mean, from the spread of the folds.
        by_fold: (K,) compensation of each fold.
        jackknife: (n,) standard uncertainty of each joint's compliance by leaving out a fold at a time
            [rad/(N·m)].
    """

    model: ModelName
    penalty: float | None
    compensation: float
    standard_error: float
    by_fold: FloatArray
    jackknife: FloatArray


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
) -> Selection:
    """Choose each model's weight, and compare the models at theirs.

    Args:
        robot: n joints.
        measurements: that the folds share out.
        folds: of them.
        fits: of each model, one a fold.
        plan: weights and rule.

    Raises:
        SolverError: a model has no weight with certified answers.
    """
    names = [name for name in MODELS if name in fits]
    places = [chosen_weight(np.array([fit.error for fit in fits[name]]), plan.rule) for name in names]
    chosen = np.array(
        [[fit.compliances[place] for fit in fits[name]] for name, place in zip(names, places, strict=True)]
    )
    compensation = np.array(
        [
            _compensation(robot, measurements[indices], folds, chosen[:, number])
            for number, indices in enumerate(folds.held_out)
        ]
    ).T
    columns = folds.columns
    coupled = columns.coupling[diagonal(columns.n)]
    joints = chosen[..., columns.joints] + chosen[..., coupled]
    models = tuple(
        _held_out(name, plan.weights[place], joints[number], compensation[number])
        for number, (name, place) in enumerate(zip(names, places, strict=True))
    )
    best = max(models, key=lambda each: each.compensation)
    limit = best.compensation - best.standard_error
    simplest = next(each for each in models if each.compensation >= limit)
    return Selection(models, best.model, simplest.model)


def _held_out(name: ModelName, weight: float, compliances: FloatArray, by_fold: FloatArray) -> HeldOut:
    """Mean and spread; the joints' compliances (K, n) of the folds give the jackknife's uncertainty."""
    count = len(by_fold)
    spread = np.square(compliances - compliances.mean(axis=0)).sum(axis=0)
    return HeldOut(
        model=name,
        penalty=None if name == "joints" else weight,
        compensation=float(by_fold.mean()),
        standard_error=float(by_fold.std(ddof=1) / np.sqrt(count)),
        by_fold=by_fold,
        jackknife=np.sqrt((count - 1) / count * spread),
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
