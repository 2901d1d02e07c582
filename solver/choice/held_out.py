"""Choice of model, loss and penalty by cross-validation over configurations (method.md §7).

The rows of each fold are compressed once to a triangular matrix. The training set of a held-out fold merges
the triangles of the other folds, for all weights and models; the prediction error is computed from the
triangle of the held-out fold.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import CrossValidation, Loss
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.evidence.causes import CLEAR_GAIN, HeldOutGain, Screening
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit.elastic import ElasticFit, fit_elastic
from jointstiff.solver.fit.part import (
    MOST_TARGETS,
    Part,
    compress_parts,
    generate_elastic_rows,
    select_rows_of_part,
)
from jointstiff.solver.fit.reduced import LOSSES, Candidate, Reduced, fit_loss, reduce_part
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.mechanics.measurements import find_first_equal
from jointstiff.solver.models import MODELS, Columns

_NAMES: Final = tuple(model.name for model in MODELS)
WITH_BASE: Final = frozenset(model.name for model in MODELS if model.has_base)
"""Models whose base bends: compared with the others only if a test finds that the base bends."""
LINKS_ALONE: Final = frozenset(model.name for model in MODELS if model.has_links and not model.has_base)
"""Models whose links bend and whose base does not."""


def list_models_to_compare(screening: Screening, requested: ModelName | None) -> tuple[ModelName, ...]:
    """Return the models to compare, from simple to rich.

    Models with a bending base are compared only if a test finds that the base bends. The model with links and
    base is compared if the base explains something in addition to links. The models with links are omitted if
    this is the case, but links explain nothing in addition to the base.

    Args:
        screening: tests of the residuals of joints alone for other causes.
        requested: model that the request names; None leaves the choice to the tests.
    """
    # If the request lets the base bend, all models are compared: with a bending base and with a rigid one.
    if requested in WITH_BASE:
        return _NAMES
    if requested is not None or not screening.base_needs_validation:
        return tuple(name for name in _NAMES if name not in WITH_BASE)
    base_adds_to_links = screening.base_p_value_with_links < LINKS_LEVEL
    links_add_to_base = screening.links_p_value_with_base < LINKS_LEVEL
    if not base_adds_to_links:
        return tuple(name for name in _NAMES if name != "links_and_base")
    return _NAMES if links_add_to_base else ("joints", "joints_and_base")


WEIGHTS: Final = tuple(10.0 ** (quarter / 4.0) for quarter in range(-12, 1, 4))
"""Weights λ of the penalty, one per decade, that suffice to tell models that predict well from others."""
LIMITS: Final = (1e-7, 10.0)
"""Least and greatest weight λ tried: hardly any penalty, and a penalty with which no link bends."""
_GAP: Final = 1e-4
"""Tolerance of the fitted readings, or of the sum of their residuals, relative to the size of all readings:
far below the accuracy of predicted readings."""


def draw_folds(validation: CrossValidation, joints: FloatArray) -> tuple[IndexArray, ...]:
    """Divide observations at random into folds for cross-validation.

    All observations with the same joint angles (one posture) are put into the same fold.

    Args:
        validation: numbers of folds and draws, and the seed.
        joints: (N, n) joint angles of the observations.

    Returns:
        The ascending indices of the observations of each fold: all folds of the first draw, then all folds of
        the second draw, and so on.

    Raises:
        UnsupportedMethodError: the set has a single posture.
    """
    # Postures are numbered by first appearance, so that the values of the angles do not affect the draw.
    postures, posture_of_observation = np.unique(find_first_equal(joints), return_inverse=True)
    posture_count = len(postures)
    if posture_count < 2:
        raise UnsupportedMethodError(
            "the set has one posture, and cross-validation needs at least two",
            where="observations",
            remedy="add postures, or use elasticity joints",
        )
    generator = np.random.default_rng(validation.seed)
    fold_count = min(validation.folds, posture_count)
    folds = []
    for _ in range(validation.draws):
        fold_of_posture = np.empty(posture_count, dtype=np.intp)
        fold_of_posture[generator.permutation(posture_count)] = np.arange(posture_count) % fold_count
        fold_of_observation = fold_of_posture[posture_of_observation]
        folds += [np.flatnonzero(fold_of_observation == number) for number in range(fold_count)]
    return tuple(folds)


@dataclass(frozen=True, eq=False)
class PenaltyPath:
    """Fits of a model with each of K folds held out in turn, for W ascending weights of the penalty."""

    weights: tuple[float, ...]  #: W weights λ
    #: (K, W, P + E) fitted compliances and E stated errors; NaN where no optimum was certified
    unknowns: FloatArray
    #: (K, W) mean norm of the held-out targets' whitened residuals [m]; the root mean square of their
    #: coordinates in a set of more than `MOST_TARGETS` targets
    errors: FloatArray

    @property
    def least_error(self) -> float:
        """Least mean error of the weights whose fits are certified in all folds; inf without any."""
        certified = self.errors[:, find_certified_weights(self.errors)]
        return float(certified.mean(axis=0).min(initial=np.inf))


class Folds:
    """Measurement set divided into folds; each fold is compressed once, when it is first needed.

    Attributes:
        rows: N observations.
        columns: columns of the richest model.
        visible: (n,) mask of the joints that the whole set determines.
        validation: how the set is divided, and the rule by which a weight is chosen.
        statements: stated errors that are fitted together with the compliances; None without any.
        held_out: indices of the observations of each fold.
        per_draw: number of folds of one draw.
    """

    def __init__(
        self,
        rows: Rows,
        columns: Columns,
        visible: BoolArray,
        validation: CrossValidation,
        statements: Statements | None,
    ) -> None:
        """Divide the set into folds.

        Raises:
            UnsupportedMethodError: all observations have the same posture.
        """
        self.rows = rows
        self.columns, self.visible, self.validation = columns, visible, validation
        self.statements = statements
        self.held_out = draw_folds(validation, rows.measurements.joints)
        self.per_draw = len(self.held_out) // validation.draws
        self._training: dict[int | None, Part] = {}
        self._reduced: dict[tuple[int | None, ModelName], Reduced] = {}

    def __len__(self) -> int:
        return len(self.held_out)

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Compressed rows of each fold, in the order of the folds."""
        return compress_parts(self.rows, self.columns, self.held_out, self.statements)

    def merge_training_rows(self, fold: int | None) -> Part:
        """Return the compressed rows of a training set: all folds of a draw except the held-out `fold`.

        If `fold` is None, the rows of the whole set are returned.
        """
        if fold not in self._training:
            # The folds of one draw make up the whole set, so None merges all folds of the first draw.
            start = 0 if fold is None else fold // self.per_draw * self.per_draw
            draw = range(start, start + self.per_draw)
            self._training[fold] = Part.merge([self.parts[each] for each in draw if each != fold])
        return self._training[fold]

    def reduce_training_rows(self, candidate: Candidate, fold: int | None = None) -> Reduced:
        """Return the rows of a training set, reduced to the parameters of a model.

        All folds of a draw except the held-out `fold` are used; the whole set if `fold` is None.

        Raises:
            UnsupportedMethodError: no target moved or no load acts, so that the penalty has no scale.
        """
        key = fold, candidate.model.name
        if key not in self._reduced:
            training, sigma = self.merge_training_rows(fold), self.rows.measurements.sigma
            self._reduced[key] = reduce_part(training, candidate, self.visible, sigma)
        return self._reduced[key]

    def fit_whole_set(self, candidate: Candidate, weight: float) -> ElasticFit:
        """Fit a model to the whole set for a given weight λ of the penalty, and certify the optimum.

        Raises:
            UnsupportedMethodError: the penalty has no scale, or is too small for the optimum to be certified.
        """
        return fit_elastic(self.rows, self.merge_training_rows(None), candidate, self.visible, weight)

    def compute_prediction_errors(self, fold: int, unknowns: FloatArray) -> FloatArray:
        """Return the errors (W,) [m] with which W vectors of unknowns (W, P + E) predict a fold's readings.

        An error is the mean norm of the targets' whitened residuals; in a set of more than `MOST_TARGETS`
        targets, it is the root mean square of the residuals' coordinates.
        """
        part = self.parts[fold]
        if int(self.rows.measurements.present.sum()) <= MOST_TARGETS:
            return np.array([part.compute_residual_norms(each).mean() for each in unknowns])
        residual = unknowns @ part.triangle[:, :-1].T - part.triangle[:, -1]
        return np.asarray(np.sqrt(np.square(residual).sum(axis=1) / max(1, part.size.readings)))


def fit_first_certified(folds: Folds, candidate: Candidate, weights: Sequence[float]) -> ElasticFit:
    """Fit a model to the whole set with the smallest penalty in `weights` that gives a certified optimum.

    Args:
        folds: measurement set with its compressed rows.
        candidate: elastic elements that bend, and the loss.
        weights: weights λ of the penalty to try one after the other, in ascending order.

    Raises:
        UnsupportedMethodError: no optimum is certified; the error names the largest penalty.
    """
    for weight in weights[:-1]:
        with suppress(UnsupportedMethodError):
            return folds.fit_whole_set(candidate, weight)
    return folds.fit_whole_set(candidate, weights[-1])


def fit_fold(
    folds: Folds, candidate: Candidate, fold: int, weights: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Fit a model with one fold of a draw held out, for some weights of the penalty.

    Where no optimum can be certified for a weight, unknowns and error are NaN.

    Args:
        folds: the divided measurement set.
        candidate: elastic elements that bend, and the loss.
        fold: index of the fold that is held out.
        weights: W weights λ; a model of joints alone has no penalty, so that all weights give the same fit.

    Returns:
        The unknowns (W, P + E), compliances and E stated errors; and the errors (W,) [m] with which they
        predict the held-out fold.
    """
    reduced = folds.reduce_training_rows(candidate, fold)
    if not candidate.model.has_only_joints:
        unknowns = np.array([_fit_unknowns(reduced, candidate, weight) for weight in weights])
    else:  # Joints alone have no penalty, so that one fit serves for all weights.
        is_squared = candidate.loss == "squared"
        one_fit = reduced.fit_joints_only() if is_squared else _fit_unknowns(reduced, candidate, 1.0)
        unknowns = np.tile(one_fit, (len(weights), 1))
    return unknowns, folds.compute_prediction_errors(fold, unknowns)


def fit_folds(folds: Folds, candidate: Candidate, weights: Sequence[float]) -> PenaltyPath:
    """Fit a model with each fold held out in turn, for ascending weights of the penalty; return the fits."""
    fits = [fit_fold(folds, candidate, fold, weights) for fold in range(len(folds))]
    unknowns, errors = map(np.array, zip(*fits, strict=True))
    return PenaltyPath(tuple(weights), unknowns, errors)


def refine_path(folds: Folds, candidate: Candidate, path: PenaltyPath) -> PenaltyPath:
    """Fit a model with further weights λ around the weight of least error, until no finer weight is left.

    The finest grid has four weights per decade. If the best weight is at an end of the path, weights beyond
    this end are tried too. Return the path with the added weights, in ascending order.
    """
    while further := _propose_further_weights(np.array(path.weights), path.errors):
        added = fit_folds(folds, candidate, further)
        weights = np.array(path.weights + added.weights)
        order = np.argsort(weights)
        path = PenaltyPath(
            tuple(weights[order].tolist()),
            np.concatenate([path.unknowns, added.unknowns], axis=1)[:, order],
            np.concatenate([path.errors, added.errors], axis=1)[:, order],
        )
    return path


def _propose_further_weights(weights: FloatArray, errors: FloatArray) -> list[float]:
    """Return weights λ to try around the weight of least error: halfway to each of its two neighbours.

    Weights are counted in quarters of a decade. At an end of the path the missing neighbour is taken to be
    two decades beyond the end, but not beyond `LIMITS`. An empty list means that the grid is fine enough.
    """
    quarters = np.rint(4.0 * np.log10(weights)).astype(int)
    least, greatest = (round(4.0 * float(np.log10(limit))) for limit in LIMITS)
    best = choose_weight_index(errors, "best")
    below = quarters[best - 1] if best > 0 else max(quarters[best] - 8, least)
    above = quarters[best + 1] if best < len(quarters) - 1 else min(quarters[best] + 8, greatest)
    halfway = {(quarters[best] + below) // 2, (quarters[best] + above + 1) // 2}
    return [10.0 ** (quarter / 4.0) for quarter in sorted(halfway.difference(quarters.tolist()))]


def _fit_unknowns(reduced: Reduced, candidate: Candidate, weight: float) -> FloatArray:
    """Return the fitted unknowns (P + E,) of a model; NaN if no optimum can be certified."""
    try:
        return reduced.to_unknowns(fit_loss(reduced, candidate, weight, gap=_GAP).solution)
    except SolverError:
        return np.full(reduced.part.compliances + reduced.part.stated_errors, np.nan)


def find_certified_weights(errors: FloatArray) -> BoolArray:
    """Return a mask (W,) of the weights whose fit is certified in every one of K folds.

    Errors (K, W) are NaN for a fold and weight without a certified fit.
    """
    return np.asarray(np.isfinite(errors).all(axis=0))


def choose_weight_index(
    errors: FloatArray, rule: Literal["best", "one_standard_error"], draws: int = 1
) -> int:
    """Return the index of the weight that cross-validation chooses.

    Args:
        errors: (K, W) errors of K folds for W ascending weights; NaN where no fit was certified.
        rule: `best` takes the weight of least error, `one_standard_error` the largest whose error is
            within one standard error of the least error.
        draws: number of random divisions of the same postures into folds. Further draws add no independent
            errors, so the standard error is computed for the folds of one draw.

    Raises:
        UnsupportedMethodError: no weight has a certified fit in every fold.
    """
    mean_errors = np.where(find_certified_weights(errors), errors.mean(axis=0), np.inf)
    best_index = int(mean_errors.argmin())
    if not np.isfinite(mean_errors[best_index]):
        raise UnsupportedMethodError(
            "the cross-validation found no penalty whose fit can be certified in every fold",
            where="link_penalty",
            remedy="omit link_penalty or give a larger one, choose fewer links, or use elasticity joints",
        )
    if rule == "best":
        return best_index
    error_limit = mean_errors[best_index] + errors[:, best_index].std(ddof=1) / np.sqrt(len(errors) / draws)
    return int(np.flatnonzero(mean_errors <= error_limit).max())


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Accuracy of a model's prediction of readings that were held out of its fit."""

    model: ModelName  #: name of the model
    loss: Loss  #: loss of its fit
    error: float  #: mean over the folds of the held-out error for which the penalty was chosen [m]
    penalty: float | None  #: chosen weight λ of the penalty; None for joints alone
    #: (K,) compensation of each fold, ``1 − mean‖δp − δp̂‖ / mean‖δp‖``, of deflections δp and predictions
    #: δp̂
    by_fold: FloatArray
    #: (P,) mean norm of the held-out residuals in each of P postures, mean over the draws [m]
    by_posture: FloatArray
    per_draw: int  #: number of folds of one draw

    @property
    def compensation(self) -> float:
        """Mean compensation over the folds."""
        return float(self.by_fold.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the mean compensation of one draw, from the dispersion over the folds."""
        return float(self.by_fold.std(ddof=1) / np.sqrt(self.per_draw))

    @property
    def mean_residual(self) -> float:
        """Mean over the postures of the norm of the residuals of held-out readings [m]."""
        return float(self.by_posture.mean())

    def compare_residuals(self, other: HeldOut) -> tuple[float, float]:
        """Return (difference, standard error) [m] of this model's mean residual minus another model's.

        The residuals are compared posture by posture.
        """
        difference = self.by_posture - other.by_posture
        return float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(len(difference)))


@dataclass(frozen=True, eq=False)
class Selection:
    """Comparison of models and losses on held-out postures, and the models chosen from it."""

    models: tuple[HeldOut, ...]  #: compared models, from simple to rich; one entry for each loss of a model
    best: ModelName  #: model of least mean residual of held-out postures, where each model has its best loss
    simplest: ModelName  #: simplest model that predicts nearly as well as the best; see `find_simplest_model`
    largest: ModelName  #: richest model that contains `simplest`: its fit gives the intervals
    #: gain of the best model with links or base over joints alone; None if one of the two was not compared
    gain: HeldOutGain | None
    #: best model that bends links where the chosen one bends the base, or the reverse, if the readings do not
    #: distinguish the two
    tied: ModelName | None = None

    def find_held_out(self, model: ModelName, losses: Sequence[Loss] = LOSSES) -> HeldOut:
        """Return the held-out accuracy of a model, with the loss among `losses` that has the least error."""
        return _pick_best_loss(self.models, model, losses)

    def replace_refined(self, refined: HeldOut) -> Selection:
        """Return this selection, where `refined` replaces the entry with the same model and loss."""
        key = refined.model, refined.loss
        models = tuple(refined if (each.model, each.loss) == key else each for each in self.models)
        return replace(self, models=models)

    @classmethod
    def choose_among(
        cls, models: Sequence[HeldOut], *, screened: bool, links_may_be_base: bool = False
    ) -> Selection:
        """Compare models, and return the selection with the best, the simplest and the largest of them.

        Args:
            models: accuracy of each model and loss, models listed from simple to rich.
            screened: whether a test has shown that something in addition to the joints bends.
            links_may_be_base: whether the tests do not distinguish links from the base.
        """
        model_names = dict.fromkeys(candidate.model for candidate in models)
        best_loss_of_model = [_pick_best_loss(models, name, LOSSES) for name in model_names]
        best = min(best_loss_of_model, key=lambda candidate: candidate.mean_residual)
        simplest = find_simplest_model(best_loss_of_model, best, screened=screened)
        largest = find_richest_model(list(model_names), simplest)
        return cls(
            tuple(models),
            best.model,
            simplest,
            largest,
            _compute_gain(best_loss_of_model),
            _find_tied_model(best_loss_of_model, simplest, links_may_be_base=links_may_be_base),
        )


def _pick_best_loss(models: Sequence[HeldOut], name: ModelName, losses: Sequence[Loss]) -> HeldOut:
    """Return the held-out accuracy of the model `name`, with the loss among `losses` of least error."""
    scores = [each for each in models if each.model == name and each.loss in losses]
    return min(scores, key=lambda each: each.error)


def select_model(
    folds: Folds,
    paths: Mapping[tuple[ModelName, Loss], PenaltyPath],
    requested: ModelName | None = None,
    *,
    screened: bool = False,
    links_may_be_base: bool = False,
) -> Selection:
    """Choose the penalty's weight for each model and loss, and compare the models at these weights.

    Args:
        folds: the divided measurement set.
        paths: fits of each model and loss.
        requested: model that must have a certified fit; other models without a certified fit are left out.
        screened: whether a test has shown that something in addition to the joints bends.
        links_may_be_base: whether the tests do not distinguish links from the base.

    Raises:
        UnsupportedMethodError: the requested model has no weight with a certified fit in every fold.
    """
    validation = folds.validation
    models_and_losses = [(name, loss) for name in _NAMES for loss in LOSSES if (name, loss) in paths]
    is_certified = {key: bool(find_certified_weights(paths[key].errors).any()) for key in models_and_losses}
    # If no fit of the requested model is certified, its keys are kept: `choose_weight_index` then raises.
    none_certified = not any(is_certified[key] for key in models_and_losses if key[0] == requested)
    models_and_losses = [
        key for key in models_and_losses if is_certified[key] or (none_certified and key[0] == requested)
    ]
    chosen_index = {
        key: choose_weight_index(paths[key].errors, validation.rule, validation.draws)
        for key in models_and_losses
    }
    chosen_unknowns = np.array([paths[key].unknowns[:, index] for key, index in chosen_index.items()])
    compensation, residual_norms = _score_held_out(folds, chosen_unknowns)
    # The columns of `norms` are in the order of the folds: find the posture of each column.
    first_equal = find_first_equal(folds.rows.measurements.joints)
    posture_of_observation = np.unique(first_equal, return_inverse=True)[1]
    posture_of_column = posture_of_observation[np.concatenate(folds.held_out)]
    norm_sums = np.array([np.bincount(posture_of_column, model_norms) for model_norms in residual_norms])
    by_posture = norm_sums / np.bincount(posture_of_column)
    models = tuple(
        HeldOut(
            model=key[0],
            loss=key[1],
            error=float(paths[key].errors[:, index].mean()),
            penalty=None if key[0] == "joints" else paths[key].weights[index],
            by_fold=compensation[number],
            by_posture=by_posture[number],
            per_draw=folds.per_draw,
        )
        for number, (key, index) in enumerate(chosen_index.items())
    )
    return Selection.choose_among(models, screened=screened, links_may_be_base=links_may_be_base)


def find_simplest_model(candidates: Sequence[HeldOut], best: HeldOut, *, screened: bool) -> ModelName:
    """Return the simplest model that predicts nearly as well as the best model.

    "Nearly" means within one standard error of the difference. For joints alone the limit is two standard
    errors, unless a test has shown that something else bends: otherwise a robot with rigid links would get a
    richer model in nearly half of all campaigns.

    Args:
        candidates: models from simple to rich.
        best: model with the least residual.
        screened: whether a test has shown that something in addition to the joints bends.
    """
    joints_limit = 1.0 if screened else CLEAR_GAIN  # in standard errors
    compared = [(each.model, *each.compare_residuals(best)) for each in candidates]
    return next(
        model
        for model, difference, standard_error in compared
        if difference <= standard_error * (joints_limit if model == "joints" else 1.0)
    )


def find_richest_model(names: Sequence[ModelName], chosen: ModelName) -> ModelName:
    """Return the richest of some models; the base bends if the base of the chosen model bends.

    A model with a rigid base is skipped if the base bends in the chosen model. Intervals computed as if the
    chosen model were true would be too narrow (Leeb & Pötscher, *Model selection and inference: facts and
    fiction*, 2005); intervals of the richest model are valid, even if this model predicts worse.

    Args:
        names: models from simple to rich.
        chosen: model that the readings chose; one of `names`.
    """
    return [name for name in names if name in WITH_BASE or chosen not in WITH_BASE][-1]


def _find_tied_model(
    by_name: Sequence[HeldOut], chosen: ModelName, *, links_may_be_base: bool
) -> ModelName | None:
    """Return the best model that bends links instead of the base, or the base instead of links.

    None if the chosen model bends neither or both, or if the readings distinguish the two: the tests do, and
    the model with links predicts worse than the chosen base by more than one standard error.
    """
    with_base = next((each for each in by_name if each.model == "joints_and_base"), None)
    links = [each for each in by_name if each.model in LINKS_ALONE]
    if with_base is None or not links:
        return None
    best = min(links, key=lambda each: each.mean_residual)
    if chosen in LINKS_ALONE:
        return with_base.model if links_may_be_base else None
    if chosen != with_base.model:
        return None
    difference, standard_error = best.compare_residuals(with_base)
    return best.model if links_may_be_base or difference <= standard_error else None


def _compute_gain(by_name: Sequence[HeldOut]) -> HeldOutGain | None:
    """Return the gain of the best model with links or base over joints alone.

    None if joints alone, or all models with links or base, are missing from `by_name`.
    """
    joints = next((each for each in by_name if each.model == "joints"), None)
    others = [each for each in by_name if each.model != "joints"]
    if joints is None or not others:
        return None
    best = min(others, key=lambda each: each.mean_residual)
    return HeldOutGain(
        best.model, best.mean_residual, joints.mean_residual, joints.compare_residuals(best)[1]
    )


def _score_held_out(folds: Folds, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Predict each of K folds with M models whose unknowns (M, K, P + E) were fitted without that fold.

    Returns:
        The compensation (M, K), one minus the ratio of residuals to deflections; and the mean norm (M, D N)
        of the residuals of each observation's targets [m]. Its columns are in the order of the folds: each of
        D draws divides all N observations.
    """
    residual_sum, deflection_sum = np.zeros(unknowns.shape[:2]), np.zeros(len(folds))
    norms_of_folds = [
        np.zeros((len(unknowns), len(fold_observations))) for fold_observations in folds.held_out
    ]
    start = 0  # index of the first observation of the block
    for rows in generate_elastic_rows(folds.rows, folds.columns, folds.statements):
        in_block = rows.block.measurements
        for fold, fold_observations in enumerate(folds.held_out):
            in_fold = select_rows_of_part(fold_observations, start, start + len(in_block))
            deflection, present = in_block.deflection[in_fold], in_block.present[in_fold]
            predicted = np.einsum("btip,mp->mbti", rows.targets[in_fold, ..., :-1], unknowns[:, fold])
            residual = np.linalg.norm(deflection - predicted, axis=-1)
            count = np.maximum(present.sum(axis=1), 1)
            # Position in the fold of the block's first observation
            first_position = int(np.searchsorted(fold_observations, start))
            mean_norm = np.where(present, residual, 0.0).sum(axis=-1) / count
            norms_of_folds[fold][:, first_position : first_position + len(in_fold)] = mean_norm
            residual_sum[:, fold] += residual[:, present].sum(axis=1)
            deflection_sum[fold] += float(np.linalg.norm(deflection, axis=-1)[present].sum())
        start += len(in_block)
    # A fold without any deflection gets a ratio of one: nothing could be compensated.
    ratio = np.divide(
        residual_sum, deflection_sum, out=np.ones_like(residual_sum), where=deflection_sum > 0.0
    )
    return 1.0 - ratio, np.concatenate(norms_of_folds, axis=1)


def report_penalty(chosen: float, used: float) -> Iterator[Finding]:
    """Report a penalty at an end of the range that was tried, or a penalty that had to be raised.

    Args:
        chosen: weight λ that cross-validation chose.
        used: weight λ of the final fit: the smallest weight, at or above `chosen`, with a certified optimum.
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
            "determine the links nearly without a penalty, and the penalty does not bias the links",
            remedy="to try a smaller penalty, give link_penalty; predictions will hardly change",
        )
    if used > chosen:
        yield Finding(
            code="link_penalty_raised",
            weight="use",
            message=f"cross-validation chose a penalty of {chosen:.3g}, but rounding errors prevent the "
            f"proof that the fit with this penalty is optimal: a penalty of {used:.3g} was used instead",
            remedy="compare `selection`; give link_penalty, or choose fewer links",
        )


def report_losses(targets: int) -> Iterator[Finding]:
    """Yield a finding that the losses were not compared, if the set has more than `MOST_TARGETS` targets."""
    if targets > MOST_TARGETS:
        yield Finding(
            code="loss_not_compared",
            weight="use",
            message=f"loss squared was used: other losses are compared only in sets of at most "
            f"{MOST_TARGETS} targets, and this one has {targets}",
            remedy="leave observations out to compare losses; with so many readings the loss matters little",
        )
