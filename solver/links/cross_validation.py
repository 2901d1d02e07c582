"""Cross-validation over configurations: what a model fitted to some predicts of the others (method.md §7).

Each fold is compressed once. The training set of a fold merges the triangles of the others, whatever the
weight and the model; an error of prediction is that of the held-out fold's triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.links.losses import MOST_TARGETS, LossProblem, TargetFits
from jointstiff.solver.links.model import ElasticModel, Formulation, ModelName, formulate
from jointstiff.solver.links.regressor import (
    ElasticColumns,
    ElasticRows,
    ElasticTargets,
    elastic_rows,
    elastic_targets,
)
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

Rule = Literal["best", "one_standard_error"]

WEIGHTS: Final = tuple(10.0 ** (quarter / 4.0) for quarter in range(-12, 1, 2))
"""λ that suffice to choose between models and losses, two a decade."""
LIMITS: Final = (1e-7, 10.0)
"""λ with hardly any penalty, and λ that leaves nothing of the links: `refined` does not go beyond."""
_GAP: Final = 1e-4
"""Tolerance of the fitted readings, or of the sum of their residuals, relative to all: far below the accuracy
of predicted readings."""


@dataclass(frozen=True)
class Plan:
    """Settings of the cross-validation."""

    folds: int = 5  #: how many a draw, at least 2; fewer where there are fewer configurations
    draws: int = 4  #: how often the configurations are shared out anew
    seed: int = 0  #: seed of the draw that shares out the configurations
    weights: tuple[float, ...] = WEIGHTS  #: λ to choose from, ascending
    #: `best` takes the weight of least error, `one_standard_error` the largest whose error is within one
    #: standard error of that
    rule: Rule = "best"

    def assigned(self, joints: FloatArray) -> tuple[IndexArray, ...]:
        """The observations (N, n) of each fold, draw by draw; observations of one posture stay together.

        Raises:
            UnsupportedMethodError: there is one posture only.
        """
        _, posture = np.unique(joints, axis=0, return_inverse=True)
        count = int(posture.max()) + 1
        if count < 2:
            raise UnsupportedMethodError(
                "the set has one posture, and cross-validation needs at least two",
                where="observations",
                remedy="add postures, or use elasticity joints",
            )
        # In the order of their first appearance, so that the angles' values do not decide.
        first = np.full(count, len(joints))
        np.minimum.at(first, posture, np.arange(len(joints)))
        order = np.argsort(np.argsort(first))
        generator, folds = np.random.default_rng(self.seed), min(self.folds, count)
        assigned = []
        for _ in range(self.draws):
            fold = np.empty(count, dtype=np.intp)
            fold[generator.permutation(count)] = np.arange(count) % folds
            of_each = fold[order[posture.reshape(-1)]]
            assigned += [np.flatnonzero(of_each == number) for number in range(folds)]
        return tuple(assigned)


@dataclass(frozen=True, eq=False)
class FoldFit:
    """A model fitted to all but one fold, for each of W weights."""

    compliances: FloatArray  #: (W, P); NaN where no answer was certified
    #: (W,) mean norm of the held-out targets' whitened residuals [m]; the root mean square of their
    #: coordinates in a set of more than `MOST_TARGETS` targets
    error: FloatArray


class Folds:
    """A measurement set shared out to folds, each compressed once, when it is first asked for.

    Attributes:
        columns: of the richest model.
        visible: (n,) joints that the whole set sees.
        held_out: the observations of each fold.
    """

    def __init__(
        self,
        robot: Robot,
        measurements: Measurements,
        columns: ElasticColumns,
        visible: BoolArray,
        plan: Plan,
    ) -> None:
        """Draw the folds.

        Raises:
            UnsupportedMethodError: there is one posture only.
        """
        self._robot, self._measurements = robot, measurements
        self.columns, self.visible = columns, visible
        self.held_out = plan.assigned(measurements.joints)
        self.per_draw = len(self.held_out) // plan.draws
        """How many folds share out the configurations once."""
        self.sigma = measurements.sigma
        self.few = int(measurements.present.sum()) <= MOST_TARGETS
        """Return whether there are few enough targets for robust losses."""
        self._formulations: dict[tuple[int | None, ModelName], Formulation] = {}
        self._fits: dict[tuple[int | None, ModelName], TargetFits] = {}

    def __len__(self) -> int:
        return len(self.held_out)

    @cached_property
    def rows(self) -> tuple[ElasticRows, ...]:
        """Return the compressed rows of each fold."""
        return tuple(
            elastic_rows(self._robot, self._measurements[indices], self.columns) for indices in self.held_out
        )

    @cached_property
    def all_rows(self) -> ElasticRows:
        """Return the compressed rows of the whole set."""
        return ElasticRows.merged(list(self.rows[: self.per_draw]))

    @cached_property
    def targets(self) -> tuple[ElasticTargets, ...]:
        """Return the rows of the targets of each fold, one by one."""
        return tuple(
            elastic_targets(self._robot, self._measurements[indices], self.columns)
            for indices in self.held_out
        )

    def training(self, fold: int | None) -> ElasticRows:
        """Return the compressed rows of all folds of a draw but one."""
        if fold is None:
            return self.all_rows
        return ElasticRows.merged([self.rows[other] for other in self._others(fold)])

    def _others(self, fold: int | None) -> list[int]:
        """Return the other folds of the same draw; all of the first one for None."""
        start = 0 if fold is None else fold // self.per_draw * self.per_draw
        return [number for number in range(start, start + self.per_draw) if number != fold]

    def problem(self, model: ElasticModel, fold: int | None = None) -> LossProblem:
        """Return a model on all folds but one, or on the whole set, ready to be fitted.

        Raises:
            UnsupportedMethodError: the penalty has no scale.
        """
        key = fold, model.name
        if key not in self._formulations:
            self._formulations[key] = formulate(self.training(fold), model, self.visible)
        formulation = self._formulations[key]
        if model.loss != "squared" and key not in self._fits:
            targets = ElasticTargets.merged([self.targets[other] for other in self._others(fold)])
            self._fits[key] = TargetFits(formulation, targets)
        return LossProblem(model, formulation, self._fits.get(key), self.sigma)

    def error(self, fold: int, compliances: FloatArray) -> FloatArray:
        """(W,) prediction errors [m] of compliances (W, P) in a fold; see `FoldFit`."""
        if self.few:
            held_out = self.targets[fold]
            return np.array([np.linalg.norm(held_out.residuals(each), axis=1).mean() for each in compliances])
        rows = self.rows[fold]
        residual = compliances @ rows.triangle[:, :-1].T - rows.triangle[:, -1]
        return np.asarray(np.sqrt(np.square(residual).sum(axis=1) / max(1, rows.readings)))


def fit_fold(folds: Folds, model: ElasticModel, fold: int, weights: Sequence[float]) -> FoldFit:
    """Fit a model to all but one fold, for some weights of the penalty.

    A weight for which no answer can be certified has no number, and is not chosen.

    Args:
        folds: the set.
        model: what bends.
        fold: which fold is held out.
        weights: λ; of joints alone, without a penalty, all give the same.
    """
    problem = folds.problem(model, fold)
    cone = problem.formulation.cone
    if problem.formulation.penalised.any() or cone.sizes:
        parameters = np.array([_parameters(problem, weight) for weight in weights])
    else:
        alone = problem.joints_only() if model.loss == "squared" else _parameters(problem, 1.0)
        parameters = np.tile(alone, (len(weights), 1))
    compliances = problem.formulation.compliances(parameters)
    return FoldFit(compliances, folds.error(fold, compliances))


def refined(
    folds: Folds, model: ElasticModel, fits: Sequence[FoldFit], plan: Plan
) -> tuple[Plan, list[FoldFit]]:
    """Fit a model for further weights around the best: four a decade, and beyond an end of the weights.

    Returns:
        The plan with all weights, and the fits for them.
    """
    known = np.array(plan.weights)
    compliances = np.array([fit.compliances for fit in fits])
    errors = np.array([fit.error for fit in fits])
    while further := _further(known, errors):
        added = [fit_fold(folds, model, fold, further) for fold in range(len(folds))]
        known = np.concatenate([known, further])
        order = np.argsort(known)
        known = known[order]
        compliances = np.concatenate([compliances, [fit.compliances for fit in added]], axis=1)[:, order]
        errors = np.concatenate([errors, [fit.error for fit in added]], axis=1)[:, order]
    finer = replace(plan, weights=tuple(known.tolist()))
    return finer, [FoldFit(*both) for both in zip(compliances, errors, strict=True)]


def _further(weights: FloatArray, errors: FloatArray) -> list[float]:
    """Return weights to try beside the best: a decade beyond an end, or halfway to its neighbours."""
    quarters = np.rint(4.0 * np.log10(weights)).astype(int)
    least, greatest = (round(4.0 * float(np.log10(limit))) for limit in LIMITS)
    best = chosen_weight(errors, "best")
    below = quarters[best - 1] if best > 0 else max(quarters[best] - 8, least)
    above = quarters[best + 1] if best < len(quarters) - 1 else min(quarters[best] + 8, greatest)
    halfway = {(quarters[best] + below) // 2, (quarters[best] + above + 1) // 2}
    return [10.0 ** (quarter / 4.0) for quarter in sorted(halfway.difference(quarters.tolist()))]


def _parameters(problem: LossProblem, weight: float) -> FloatArray:
    try:
        return problem.fit(weight, gap=_GAP).solution.x
    except SolverError:
        return np.full(problem.formulation.cone.dimension, np.nan)


def answered(errors: FloatArray) -> BoolArray:
    """(W,) weights with an answer in all of the K folds, of their errors (K, W)."""
    return np.asarray(np.isfinite(errors).all(axis=0))


def chosen_weight(errors: FloatArray, rule: Rule, draws: int = 1) -> int:
    """Return the place of the weight that cross-validation chooses.

    Args:
        errors: (K, W) of K folds for W ascending weights; NaN where there is no answer.
        rule: see `Plan`.
        draws: how many share out the same postures, which are not more postures.

    Raises:
        UnsupportedMethodError: no weight has an answer in all folds.
    """
    mean = np.where(answered(errors), errors.mean(axis=0), np.inf)
    best = int(mean.argmin())
    if not np.isfinite(mean[best]):
        raise UnsupportedMethodError(
            "no penalty has a certified answer in all folds of the cross-validation",
            where="link_penalty",
            remedy="omit link_penalty or give a larger one, choose fewer links, or use elasticity joints",
        )
    if rule == "best":
        return best
    limit = mean[best] + errors[:, best].std(ddof=1) / np.sqrt(len(errors) / draws)
    return int(np.flatnonzero(mean <= limit).max())
