"""Choice of model, loss and penalty by cross-validation over configurations (method.md §7).

Each fold is compressed once. The training set of a fold merges the triangles of the others, whatever the
weight and the model; an error of prediction is that of the held-out fold's triangle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import CrossValidation, Loss
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.estimation.causes import CLEAR_GAIN, LINKS_LEVEL, HeldOutGain, Screening
from jointstiff.solver.links.model import (
    LINKS_ALONE,
    LOSSES,
    MODELS,
    MOST_TARGETS,
    WITH_BASE,
    ElasticColumns,
    ElasticModel,
    ElasticRows,
    Formulation,
    elastic_blocks,
    elastic_rows,
    formulate,
    within,
)
from jointstiff.solver.mechanics.measurements import Measurements, first_equal
from jointstiff.solver.mechanics.robot import Robot


def compared_models(screening: Screening, requested: ModelName | None) -> tuple[ModelName, ...]:
    """Return the models to compare, from simple to rich.

    A base is compared only where its test speaks for it. Where links have nothing to explain once the base
    bends, the base is compared alone; where the base has nothing to explain once links bend either, links and
    base compete; where each explains something that the other leaves, both together are compared, too.

    Args:
        screening: of what joints alone leave unexplained.
        requested: model; None for those that the tests support.
    """
    if requested in WITH_BASE:
        return MODELS
    if requested is not None or not screening.base_speaks:
        return tuple(name for name in MODELS if name not in WITH_BASE)
    base_is_needed = screening.base_beside_links < LINKS_LEVEL
    if screening.links_beside_base >= LINKS_LEVEL and base_is_needed:
        return ("joints", "joints_and_base")
    return tuple(name for name in MODELS if base_is_needed or name != "links_and_base")


WEIGHTS: Final = tuple(10.0 ** (quarter / 4.0) for quarter in range(-12, 1, 2))
"""λ that suffice to choose between models and losses, two a decade."""
LIMITS: Final = (1e-7, 10.0)
"""λ with hardly any penalty, and λ that leaves nothing of the links: `refined` does not go beyond."""
_GAP: Final = 1e-4
"""Tolerance of the fitted readings, or of the sum of their residuals, relative to all: far below the accuracy
of predicted readings."""


def shared_out(validation: CrossValidation, joints: FloatArray) -> tuple[IndexArray, ...]:
    """Return the observations (N, n) of each fold, draw by draw; observations of one posture stay together.

    Raises:
        UnsupportedMethodError: there is one posture only.
    """
    # In the order of their first appearance, so that the angles' values do not decide.
    postures, posture = np.unique(first_equal(joints), return_inverse=True)
    count = len(postures)
    if count < 2:
        raise UnsupportedMethodError(
            "the set has one posture, and cross-validation needs at least two",
            where="observations",
            remedy="add postures, or use elasticity joints",
        )
    generator, folds = np.random.default_rng(validation.seed), min(validation.folds, count)
    shares = []
    for _ in range(validation.draws):
        fold = np.empty(count, dtype=np.intp)
        fold[generator.permutation(count)] = np.arange(count) % folds
        shares += [np.flatnonzero(fold[posture] == number) for number in range(folds)]
    return tuple(shares)


@dataclass(frozen=True, eq=False)
class PenaltyPath:
    """A model fitted without each of K folds, for W ascending weights of the penalty."""

    weights: tuple[float, ...]  #: λ
    compliances: FloatArray  #: (K, W, P); NaN where no answer was certified
    #: (K, W) mean norm of the held-out targets' whitened residuals [m]; the root mean square of their
    #: coordinates in a set of more than `MOST_TARGETS` targets
    errors: FloatArray


class Folds:
    """A measurement set shared out to folds, each compressed once, when it is first needed.

    Attributes:
        robot: n joints.
        measurements: N observations.
        columns: of the richest model.
        visible: (n,) joints that the whole set sees.
        validation: how they are shared out, and the rule by which a weight is chosen.
        held_out: the observations of each fold.
        per_draw: how many folds share out the configurations once.
    """

    def __init__(
        self,
        robot: Robot,
        measurements: Measurements,
        columns: ElasticColumns,
        visible: BoolArray,
        validation: CrossValidation,
    ) -> None:
        """Draw the folds.

        Raises:
            UnsupportedMethodError: there is one posture only.
        """
        self.robot, self.measurements = robot, measurements
        self.columns, self.visible, self.validation = columns, visible, validation
        self.held_out = shared_out(validation, measurements.joints)
        self.per_draw = len(self.held_out) // validation.draws
        self._training: dict[int | None, ElasticRows] = {}
        self._formulations: dict[tuple[int | None, ModelName], Formulation] = {}

    def __len__(self) -> int:
        return len(self.held_out)

    @cached_property
    def rows(self) -> tuple[ElasticRows, ...]:
        """Return the compressed rows of each fold."""
        return elastic_rows(self.robot, self.measurements, self.columns, self.held_out)

    def training(self, fold: int | None) -> ElasticRows:
        """Return the compressed rows of all folds of a draw but one; of the whole set for None."""
        if fold not in self._training:
            start = 0 if fold is None else fold // self.per_draw * self.per_draw
            draw = range(start, start + self.per_draw)
            self._training[fold] = ElasticRows.merged([self.rows[each] for each in draw if each != fold])
        return self._training[fold]

    def formulation(self, model: ElasticModel, fold: int | None = None) -> Formulation:
        """Return a model on all folds but one, or on the whole set, ready to be fitted.

        Raises:
            UnsupportedMethodError: the penalty has no scale.
        """
        key = fold, model.name
        if key not in self._formulations:
            training, sigma = self.training(fold), self.measurements.sigma
            self._formulations[key] = formulate(training, model, self.visible, sigma)
        return self._formulations[key]

    def error(self, fold: int, compliances: FloatArray) -> FloatArray:
        """(W,) prediction errors [m] of compliances (W, P) in a fold; see `PenaltyPath`."""
        rows = self.rows[fold]
        if int(self.measurements.present.sum()) <= MOST_TARGETS:
            return np.array([rows.lengths(each).mean() for each in compliances])
        residual = compliances @ rows.triangle[:, :-1].T - rows.triangle[:, -1]
        return np.asarray(np.sqrt(np.square(residual).sum(axis=1) / max(1, rows.readings)))


def fit_fold(
    folds: Folds, model: ElasticModel, fold: int, weights: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Fit a model to all but one fold, for some weights of the penalty.

    A weight for which no answer can be certified has no number, and is not chosen.

    Args:
        folds: the set.
        model: what bends.
        fold: which fold is held out.
        weights: W of λ; of joints alone, without a penalty, all give the same.

    Returns:
        (W, P) compliances and (W,) errors, as in `PenaltyPath`.
    """
    form = folds.formulation(model, fold)
    cone = form.cone
    if cone.penalised or cone.sizes:
        parameters = np.array([_parameters(form, model, weight) for weight in weights])
    else:
        alone = form.joints_only() if model.loss == "squared" else _parameters(form, model, 1.0)
        parameters = np.tile(alone, (len(weights), 1))
    compliances = form.compliances(parameters)
    return compliances, folds.error(fold, compliances)


def fit_folds(folds: Folds, model: ElasticModel, weights: Sequence[float]) -> PenaltyPath:
    """Fit a model without each of the folds, for ascending weights of the penalty."""
    fits = [fit_fold(folds, model, fold, weights) for fold in range(len(folds))]
    compliances, errors = map(np.array, zip(*fits, strict=True))
    return PenaltyPath(tuple(weights), compliances, errors)


def refined(folds: Folds, model: ElasticModel, path: PenaltyPath) -> PenaltyPath:
    """Fit a model for further weights around the best: four a decade, and beyond an end of the weights."""
    while further := _further_weights(np.array(path.weights), path.errors):
        added = fit_folds(folds, model, further)
        weights = np.array(path.weights + added.weights)
        order = np.argsort(weights)
        path = PenaltyPath(
            tuple(weights[order].tolist()),
            np.concatenate([path.compliances, added.compliances], axis=1)[:, order],
            np.concatenate([path.errors, added.errors], axis=1)[:, order],
        )
    return path


def _further_weights(weights: FloatArray, errors: FloatArray) -> list[float]:
    """Return weights to try next to the best: a decade beyond an end, or halfway to its neighbours."""
    quarters = np.rint(4.0 * np.log10(weights)).astype(int)
    least, greatest = (round(4.0 * float(np.log10(limit))) for limit in LIMITS)
    best = chosen_weight(errors, "best")
    below = quarters[best - 1] if best > 0 else max(quarters[best] - 8, least)
    above = quarters[best + 1] if best < len(quarters) - 1 else min(quarters[best] + 8, greatest)
    halfway = {(quarters[best] + below) // 2, (quarters[best] + above + 1) // 2}
    return [10.0 ** (quarter / 4.0) for quarter in sorted(halfway.difference(quarters.tolist()))]


def _parameters(form: Formulation, model: ElasticModel, weight: float) -> FloatArray:
    try:
        return form.fit(model, weight, gap=_GAP)[0].x
    except SolverError:
        return np.full(form.cone.dimension, np.nan)


def answered(errors: FloatArray) -> BoolArray:
    """(W,) weights with an answer in all of the K folds, of their errors (K, W)."""
    return np.asarray(np.isfinite(errors).all(axis=0))


def chosen_weight(errors: FloatArray, rule: Literal["best", "one_standard_error"], draws: int = 1) -> int:
    """Return the place of the weight that cross-validation chooses.

    Args:
        errors: (K, W) of K folds for W ascending weights; NaN where there is no answer.
        rule: `best` takes the weight of least error, `one_standard_error` the largest whose error is within
            one standard error of that.
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


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Prediction of readings that were not used in the fit."""

    model: ModelName  #: which
    loss: Loss  #: which
    error: float  #: mean over the folds of the held-out error that chose the penalty; see `PenaltyPath` [m]
    penalty: float | None  #: weight λ that was chosen; None of joints alone
    by_fold: FloatArray  #: (K,) compensation of each fold, ``1 − mean‖δp − δp̂‖ / mean‖δp‖``
    #: (P,) mean norm of the residuals of each posture while it was left out, mean over the draws [m]
    by_posture: FloatArray
    per_draw: int  #: how many folds share out the postures once

    @property
    def compensation(self) -> float:
        """Return the mean compensation over the folds."""
        return float(self.by_fold.mean())

    @property
    def standard_error(self) -> float:
        """Return the standard error of that mean for one draw, from the spread of the folds."""
        return float(self.by_fold.std(ddof=1) / np.sqrt(self.per_draw))

    @property
    def mean_residual(self) -> float:
        """Return the mean norm of the residuals over the postures [m]."""
        return float(self.by_posture.mean())

    def behind(self, other: HeldOut) -> tuple[float, float]:
        """Return by how much it predicts worse, the mean over the postures, and its standard error [m]."""
        worse = self.by_posture - other.by_posture
        return float(worse.mean()), float(worse.std(ddof=1) / np.sqrt(len(worse)))


@dataclass(frozen=True, eq=False)
class Selection:
    """Models and losses side by side, from simple to rich."""

    models: tuple[HeldOut, ...]  #: that were compared, each with all losses
    best: ModelName  #: model of least mean residual of held-out postures, each with its best loss
    simplest: ModelName  #: whose mean is near the best one's, paired by posture; see `simplest_of`
    largest: ModelName  #: richest of the models that bend as the simplest does: intervals are of it
    #: gain of the best model but joints over joints alone; None where either has no answer
    gain: HeldOutGain | None
    #: best model with links alone, where the base is chosen and held-out postures do not distinguish the two
    tied: ModelName | None = None

    def of(self, model: ModelName, losses: Sequence[Loss] = LOSSES) -> HeldOut:
        """Return a model with the loss of least held-out error."""
        return _best_loss(self.models, model, losses)

    def with_refined(self, refined: HeldOut) -> Selection:
        """Return the same choice with a model at another penalty."""
        key = refined.model, refined.loss
        models = tuple(refined if (each.model, each.loss) == key else each for each in self.models)
        return replace(self, models=models)

    @classmethod
    def among(cls, models: Sequence[HeldOut], *, screened: bool) -> Selection:
        """Return the choice among models with their losses, from simple to rich; see `select_model`."""
        names = dict.fromkeys(each.model for each in models)
        by_name = [_best_loss(models, name, LOSSES) for name in names]
        best = min(by_name, key=lambda each: each.mean_residual)
        simplest = simplest_of(by_name, best, screened=screened)
        largest = largest_of(list(names), simplest)
        return cls(
            tuple(models), best.model, simplest, largest, _gain(by_name), _tied_model(by_name, simplest)
        )


def _best_loss(models: Sequence[HeldOut], name: ModelName, losses: Sequence[Loss]) -> HeldOut:
    scores = [each for each in models if each.model == name and each.loss in losses]
    return min(scores, key=lambda each: each.error)


def select_model(
    folds: Folds,
    paths: Mapping[tuple[ModelName, Loss], PenaltyPath],
    requested: ModelName | None = None,
    *,
    screened: bool = False,
) -> Selection:
    """Choose the weight of each model and loss, and compare them at these weights.

    Args:
        folds: of the measurements.
        paths: of each model and loss.
        requested: the model that must have an answer; one without certified answers is left out otherwise.
        screened: whether a test has shown that something besides the joints bends.

    Raises:
        UnsupportedMethodError: that model has no weight with certified answers.
    """
    validation = folds.validation
    keys = [(name, loss) for name in MODELS for loss in LOSSES if (name, loss) in paths]
    answers = {key: bool(answered(paths[key].errors).any()) for key in keys}
    none = not any(answers[key] for key in keys if key[0] == requested)
    keys = [key for key in keys if answers[key] or (none and key[0] == requested)]
    places = {key: chosen_weight(paths[key].errors, validation.rule, validation.draws) for key in keys}
    chosen = np.array([paths[key].compliances[:, place] for key, place in places.items()])
    compensation, norms = _score_held_out(folds, chosen)
    posture = np.unique(first_equal(folds.measurements.joints), return_inverse=True)[1]
    of_posture = posture[np.concatenate(folds.held_out)]
    by_posture = np.array([np.bincount(of_posture, row) for row in norms]) / np.bincount(of_posture)
    models = tuple(
        HeldOut(
            model=key[0],
            loss=key[1],
            error=float(paths[key].errors[:, place].mean()),
            penalty=None if key[0] == "joints" else paths[key].weights[place],
            by_fold=compensation[number],
            by_posture=by_posture[number],
            per_draw=folds.per_draw,
        )
        for number, (key, place) in enumerate(places.items())
    )
    return Selection.among(models, screened=screened)


def simplest_of(by_name: Sequence[HeldOut], best: HeldOut, *, screened: bool) -> ModelName:
    """Return the simplest of models, from simple to rich, that predicts nearly as well as the best.

    Nearly means one paired standard error; two for joints alone, unless a test has shown that something
    besides them bends: without it nearly every other rigid campaign would get a model with more.
    """
    of_joints = 1.0 if screened else CLEAR_GAIN
    behind = [(each.model, *each.behind(best)) for each in by_name]
    return next(
        model for model, worse, error in behind if worse <= error * (of_joints if model == "joints" else 1.0)
    )


def largest_of(names: Sequence[ModelName], chosen: ModelName) -> ModelName:
    """Return the richest of models, from simple to rich, in which all bends that bends in the chosen one.

    A model that predicts best trades bias for variance, and an interval that takes it for true is too narrow
    (Leeb & Pötscher, *Model selection and inference: facts and fiction*, 2005). How well the richest predicts
    says nothing against its intervals: they are as wide as what the readings leave open.
    """
    return [name for name in names if name in WITH_BASE or chosen not in WITH_BASE][-1]


def _tied_model(by_name: Sequence[HeldOut], chosen: ModelName) -> ModelName | None:
    """Return the best model with links alone, if it predicts within one paired standard error of the base."""
    base = next((each for each in by_name if each.model == chosen == "joints_and_base"), None)
    links = [each for each in by_name if each.model in LINKS_ALONE]
    if base is None or not links:
        return None
    best = min(links, key=lambda each: each.mean_residual)
    worse, error = best.behind(base)
    return best.model if worse <= error else None


def _gain(by_name: Sequence[HeldOut]) -> HeldOutGain | None:
    joints = next((each for each in by_name if each.model == "joints"), None)
    others = [each for each in by_name if each.model != "joints"]
    if joints is None or not others:
        return None
    best = min(others, key=lambda each: each.mean_residual)
    return HeldOutGain(best.model, best.mean_residual, joints.mean_residual, joints.behind(best)[1])


def _score_held_out(folds: Folds, compliances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Score M models on each of the K folds, by the compliances (M, K, P) that were fitted without the fold.

    Returns:
        (M, K) compensation, one less the ratio of residuals and deflections; (M, D N) mean norm of the
        residuals of each observation's targets [m], in the order of the folds. Each of D draws divides all N
        observations.
    """
    left, moved = np.zeros(compliances.shape[:2]), np.zeros(len(folds))
    norms = [np.zeros((len(compliances), len(part))) for part in folds.held_out]
    start = 0
    for block, rows in elastic_blocks(folds.robot, folds.measurements, folds.columns):
        read = block.measurements
        for k, part in enumerate(folds.held_out):
            own = within(part, start, start + len(read))
            deflection, present = read.deflection[own], read.present[own]
            predicted = np.einsum("btip,mp->mbti", rows[own, ..., :-1], compliances[:, k])
            residual = np.linalg.norm(deflection - predicted, axis=-1)
            count = np.maximum(present.sum(axis=1), 1)
            first = int(np.searchsorted(part, start))
            norms[k][:, first : first + len(own)] = np.where(present, residual, 0.0).sum(axis=-1) / count
            left[:, k] += residual[:, present].sum(axis=1)
            moved[k] += float(np.linalg.norm(deflection, axis=-1)[present].sum())
        start += len(read)
    share = np.divide(left, moved, out=np.ones_like(left), where=moved > 0.0)
    return 1.0 - share, np.concatenate(norms, axis=1)


def judge_penalty(chosen: float, used: float) -> Iterator[Finding]:
    """Report a penalty under which no link bends, the least of all, or one that gave way to a larger one.

    Args:
        chosen: weight λ of least held-out residual.
        used: weight of the fit, the first from there on whose optimum is certified.
    """
    if chosen >= WEIGHTS[-1]:
        yield Finding(
            code="link_penalty_at_end",
            weight="use",
            message=f"cross-validation chose a penalty of {chosen:.3g}: held-out readings are predicted best "
            "when hardly any link bends",
            remedy="use elasticity joints; compare the models' held-out compensation in `selection`",
        )
    elif chosen <= LIMITS[0]:
        yield Finding(
            code="link_penalty_at_end",
            weight="use",
            message=f"cross-validation chose the smallest penalty that it tries, {chosen:.3g}: the readings "
            "hardly need one, and the penalty does not bias the links",
            remedy="give link_penalty to try a smaller one; predictions will hardly change",
        )
    if used > chosen:
        yield Finding(
            code="link_penalty_raised",
            weight="use",
            message=f"cross-validation chose a penalty of {chosen:.3g}, but rounding prevents the "
            f"certificate of its optimum: {used:.3g} was used instead",
            remedy="compare `selection`; give link_penalty, or choose fewer links",
        )


def judge_losses(targets: int) -> Iterator[Finding]:
    """Report that losses were not compared in a set of too many targets."""
    if targets > MOST_TARGETS:
        yield Finding(
            code="loss_not_compared",
            weight="use",
            message=f"loss squared was used: other losses are compared only in sets of at most "
            f"{MOST_TARGETS} targets, and this one has {targets}",
            remedy="leave observations out to compare losses; with so many readings the loss matters little",
        )
