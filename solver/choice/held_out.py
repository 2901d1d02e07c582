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
from itertools import chain, product
from typing import Final, Literal, NamedTuple

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import CrossValidation, Loss
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.evidence.causes import CLEAR_GAIN, HeldOutGain, Screening
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit.elastic import ElasticFit, Penalised
from jointstiff.solver.fit.fit import fit
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
from jointstiff.solver.mechanics.block import BlockRows
from jointstiff.solver.mechanics.measurements import find_first_equal
from jointstiff.solver.models import ELASTIC_MODELS, Columns

_NAMES: Final = tuple(model.name for model in ELASTIC_MODELS)
WITH_BASE: Final = frozenset(model.name for model in ELASTIC_MODELS if model.has_base)
"""Models whose base bends: compared with the others only if a test finds that the base bends."""
LINKS_ALONE: Final = frozenset(
    model.name for model in ELASTIC_MODELS if model.has_links and not model.has_base
)
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
    if requested in WITH_BASE:  # compared with all models, also those with a rigid base
        return _NAMES
    base_is_suspected = requested is None and screening.base_needs_validation
    if not base_is_suspected:
        return tuple(name for name in _NAMES if name not in WITH_BASE)
    base_adds_to_links = screening.base_p_value_with_links < LINKS_LEVEL
    links_add_to_base = screening.links_p_value_with_base < LINKS_LEVEL
    if not base_adds_to_links:
        return tuple(name for name in _NAMES if name != "links_and_base")
    if not links_add_to_base:
        return ("joints", "joints_and_base")
    return _NAMES


WEIGHTS: Final = tuple(10.0 ** (quarter / 4.0) for quarter in range(-12, 1, 4))
"""Weights λ of the penalty, one per decade, that suffice to tell models that predict well from others."""
LIMITS: Final = (1e-7, 10.0)
"""Least and greatest weight λ tried: hardly any penalty, and a penalty with which no link bends."""
_TWO_DECADES: Final = 8
"""Two decades in quarters of a decade."""
_GAP: Final = 1e-4
"""Tolerance of the fitted readings, or of the sum of their residuals, relative to the size of all readings:
far below the accuracy of predicted readings."""


def draw_folds(validation: CrossValidation, joints: FloatArray) -> tuple[IndexArray, ...]:
    """Divide observations at random into folds for cross-validation.

    All observations with the same joint angles (one posture) are put into the same fold. Postures are
    numbered by first appearance, so that the values of the angles do not affect the draw.

    Args:
        validation: numbers of folds and draws, and the seed.
        joints: (N, n) joint angles of the observations.

    Returns:
        The ascending indices of the observations of each fold: all folds of the first draw, then all folds of
        the second draw, and so on.

    Raises:
        UnsupportedMethodError: the set has a single posture.
    """
    posture_of_observation = _number_postures(joints)
    posture_count = int(posture_of_observation.max()) + 1
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
        fold_of_posture = _deal_postures(posture_count, fold_count, generator)
        fold_of_observation = fold_of_posture[posture_of_observation]
        folds += [np.flatnonzero(fold_of_observation == number) for number in range(fold_count)]
    return tuple(folds)


def _number_postures(joints: FloatArray) -> IndexArray:
    """Return the number (N,) of the posture of each observation, from 0, by its joint angles (N, n).

    Postures are numbered in the order of their first observations: angles a, b, a, c give 0, 1, 0, 2.
    """
    first_with_same_posture = find_first_equal(joints)  # (N,) index of an observation
    _, posture_of_observation = np.unique(first_with_same_posture, return_inverse=True)
    return np.asarray(posture_of_observation)


def _deal_postures(posture_count: int, fold_count: int, generator: np.random.Generator) -> IndexArray:
    """Return the fold (P,) of each posture: shuffled postures are dealt to the folds in turn, like cards."""
    fold_of_posture = np.empty(posture_count, dtype=np.intp)
    shuffled_postures = generator.permutation(posture_count)
    fold_of_posture[shuffled_postures] = np.arange(posture_count) % fold_count
    return fold_of_posture


@dataclass(frozen=True, eq=False)
class PenaltyPath:
    """Fits of a model with each of K folds held out in turn, for W ascending weights of the penalty."""

    weights: tuple[float, ...]  #: W weights λ
    #: (K, W, P + E) fitted compliances and E stated errors; NaN where no optimum was certified
    unknowns: FloatArray
    #: (K, W) mean norm of the held-out targets' whitened residuals [m]; the root mean square of their
    #: coordinates in a set of more than `MOST_TARGETS` targets
    errors: FloatArray

    def join(self, added: PenaltyPath) -> PenaltyPath:
        """Return the fits of this path and of other weights together, in ascending order of the weights."""
        weights = np.array(self.weights + added.weights)
        unknowns = np.concatenate([self.unknowns, added.unknowns], axis=1)
        errors = np.concatenate([self.errors, added.errors], axis=1)
        ascending = np.argsort(weights)
        return PenaltyPath(tuple(weights[ascending].tolist()), unknowns[:, ascending], errors[:, ascending])

    @property
    def least_error(self) -> float:
        """Least mean error of the weights whose fits are certified in all folds; inf without any."""
        certified_errors = self.errors[:, find_certified_weights(self.errors)]
        mean_errors = certified_errors.mean(axis=0)  # over the folds
        return float(mean_errors.min(initial=np.inf))


class Folds:
    """Measurement set divided into folds; each fold is compressed once, when it is first needed.

    Attributes:
        rows: N observations.
        columns: columns of the richest model.
        visible: (n,) mask of the joints that the whole set determines.
        validation: how the set is divided, and the rule by which a weight is chosen.
        statements: stated errors that are fitted together with the compliances; None without any.
        held_out: indices of the observations of each fold.
        folds_per_draw: number of folds of one draw.
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
        self.folds_per_draw = len(self.held_out) // validation.draws
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

        If `fold` is None, the rows of the whole set are returned, which are all folds of the first draw. The
        rows are merged when they are first needed.
        """
        if fold not in self._training:
            draw = 0 if fold is None else fold // self.folds_per_draw
            first_of_draw, first_of_next_draw = draw * self.folds_per_draw, (draw + 1) * self.folds_per_draw
            folds_of_draw = range(first_of_draw, first_of_next_draw)
            training_parts = [self.parts[other] for other in folds_of_draw if other != fold]
            self._training[fold] = Part.merge(training_parts)
        return self._training[fold]

    def reduce_training_rows(self, candidate: Candidate, fold: int | None = None) -> Reduced:
        """Return the rows of a training set, reduced to the parameters of a model.

        All folds of a draw except the held-out `fold` are used; the whole set if `fold` is None.

        Raises:
            UnsupportedMethodError: no target moved or no load acts, so that the penalty has no scale.
        """
        key = (fold, candidate.model.name)
        if key not in self._reduced:
            training_rows = self.merge_training_rows(fold)
            stated_sigma = self.rows.measurements.sigma
            self._reduced[key] = reduce_part(training_rows, candidate, self.visible, stated_sigma)
        return self._reduced[key]

    def fit_whole_set(self, candidate: Candidate, weight: float) -> ElasticFit:
        """Fit a model to the whole set for a given weight λ of the penalty, and certify the optimum.

        Raises:
            UnsupportedMethodError: the penalty has no scale, or is too small for the optimum to be certified.
        """
        whole_set = self.merge_training_rows(None)
        options = Penalised(
            candidate.columns, self.visible, weight, whole_set, candidate.loss, candidate.threshold
        )
        return fit(self.rows, candidate.model, options)

    def compute_prediction_errors(self, fold: int, unknowns: FloatArray) -> FloatArray:
        """Return the errors (W,) [m] with which W vectors of unknowns predict a fold's readings.

        An error is the mean norm of the targets' residuals; in a set of more than `MOST_TARGETS` targets, it
        is the root mean square of the residuals' coordinates. Residuals are weighted by the stated noise.

        Args:
            fold: index of the fold.
            unknowns: (W, P + E) P compliances and E stated errors.
        """
        part = self.parts[fold]
        target_count = int(self.rows.measurements.present.sum())
        if target_count <= MOST_TARGETS:
            return np.array([part.compute_residual_norms(x).mean() for x in unknowns])
        # The triangle [R z] of the fold's rows [A d] has ‖R x − z‖ = ‖A x − d‖ for all unknowns x.
        R, z = part.triangle[:, :-1], part.triangle[:, -1]
        residual = unknowns @ R.T - z
        reading_count = max(1, part.sums.readings)
        return np.asarray(np.sqrt(np.square(residual).sum(axis=1) / reading_count))


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
        weights: W weights λ; without penalised parameters, all weights give the same fit.

    Returns:
        The unknowns (W, P + E), compliances and E stated errors; and the errors (W,) [m] with which they
        predict the held-out fold.
    """
    reduced = folds.reduce_training_rows(candidate, fold)
    if reduced.cone.has_penalty:
        unknowns = np.array([_fit_or_nan(reduced, candidate, weight) for weight in weights])
    else:
        one_fit = _fit_or_nan(reduced, candidate, weights[0])
        unknowns = np.tile(one_fit, (len(weights), 1))
    return unknowns, folds.compute_prediction_errors(fold, unknowns)


def fit_folds(folds: Folds, candidate: Candidate, weights: Sequence[float]) -> PenaltyPath:
    """Fit a model with each fold held out in turn, for ascending weights of the penalty; return the fits."""
    unknowns_of_folds, errors_of_folds = [], []
    for fold in range(len(folds)):
        unknowns, errors = fit_fold(folds, candidate, fold, weights)
        unknowns_of_folds.append(unknowns)
        errors_of_folds.append(errors)
    return PenaltyPath(tuple(weights), np.array(unknowns_of_folds), np.array(errors_of_folds))


def refine_path(folds: Folds, candidate: Candidate, path: PenaltyPath) -> PenaltyPath:
    """Fit a model with further weights λ around the weight of least error, until no finer weight is left.

    The finest grid has four weights per decade. If the best weight is at an end of the path, weights beyond
    this end are tried too. Return the path with the added weights, in ascending order.
    """
    while further_weights := _propose_further_weights(np.array(path.weights), path.errors):
        path = path.join(fit_folds(folds, candidate, further_weights))
    return path


def _propose_further_weights(weights: FloatArray, errors: FloatArray) -> list[float]:
    """Return weights λ to try around the weight of least error: halfway to each of its two neighbours.

    Weights are counted in whole quarters q of a decade, λ = 10^(q/4). At an end of the path the missing
    neighbour is taken to be two decades beyond the end, but not beyond `LIMITS`. An empty list means that the
    grid is fine enough.

    Args:
        weights: (W,) ascending weights that were tried.
        errors: (K, W) errors of K held-out folds.
    """
    quarters = np.rint(4.0 * np.log10(weights)).astype(int).tolist()
    least, greatest = (round(4.0 * float(np.log10(limit))) for limit in LIMITS)  # in quarters of a decade
    best_index = choose_weight_index(errors, "best")
    is_first, is_last = best_index == 0, best_index == len(quarters) - 1
    best = quarters[best_index]
    below = max(best - _TWO_DECADES, least) if is_first else quarters[best_index - 1]
    above = min(best + _TWO_DECADES, greatest) if is_last else quarters[best_index + 1]
    halfway = {(best + below) // 2, (best + above + 1) // 2}  # rounded away from the best
    new_quarters = sorted(halfway - set(quarters))
    return [10.0 ** (quarter / 4.0) for quarter in new_quarters]


def _fit_or_nan(reduced: Reduced, candidate: Candidate, weight: float) -> FloatArray:
    """Return the P fitted compliances and E stated errors (P + E,); NaN if no optimum can be certified."""
    try:
        fitted = fit_loss(reduced, candidate, weight, gap=_GAP)
    except SolverError:
        return np.full(reduced.part.compliances + reduced.part.stated_errors, np.nan)
    return reduced.to_unknowns(fitted.solution)


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
    folds_of_draw = len(errors) / draws
    standard_error = errors[:, best_index].std(ddof=1) / np.sqrt(folds_of_draw)
    is_nearly_best = mean_errors <= mean_errors[best_index] + standard_error
    return int(np.flatnonzero(is_nearly_best).max())


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
    folds_per_draw: int  #: number of folds of one draw

    @property
    def compensation(self) -> float:
        """Mean compensation over the folds."""
        return float(self.by_fold.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the mean compensation of one draw, from the dispersion over the folds."""
        return float(self.by_fold.std(ddof=1) / np.sqrt(self.folds_per_draw))

    @property
    def mean_residual(self) -> float:
        """Mean over the postures of the norm of the residuals of held-out readings [m]."""
        return float(self.by_posture.mean())

    def compare_residuals(self, other: HeldOut) -> tuple[float, float]:
        """Return (difference, standard error) [m] of this model's mean residual minus another model's.

        The residuals are compared posture by posture.
        """
        differences = self.by_posture - other.by_posture
        standard_error = differences.std(ddof=1) / np.sqrt(len(differences))
        return float(differences.mean()), float(standard_error)


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
        """Return this selection with a new accuracy of one model and loss, for a better penalty.

        The choice of the models is not repeated; `choose_among` does so.
        """
        key = refined.model, refined.loss
        models = tuple(refined if (each.model, each.loss) == key else each for each in self.models)
        return replace(self, models=models)

    @property
    def names(self) -> list[ModelName]:
        """Names of the compared models, each once, from simple to rich."""
        return list(dict.fromkeys(held_out.model for held_out in self.models))

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
        names = list(dict.fromkeys(candidate.model for candidate in models))  # each once
        with_best_loss = [_pick_best_loss(models, name, LOSSES) for name in names]
        best = min(with_best_loss, key=lambda candidate: candidate.mean_residual)
        simplest = find_simplest_model(with_best_loss, best, screened=screened)
        return cls(
            models=tuple(models),
            best=best.model,
            simplest=simplest,
            largest=find_richest_model(names, simplest),
            gain=_compute_gain(with_best_loss),
            tied=_find_tied_model(with_best_loss, simplest, links_may_be_base=links_may_be_base),
        )


def _pick_best_loss(models: Sequence[HeldOut], name: ModelName, losses: Sequence[Loss]) -> HeldOut:
    """Return the held-out accuracy of the model `name`, with the loss among `losses` of least error."""
    candidates = [held_out for held_out in models if held_out.model == name and held_out.loss in losses]
    return min(candidates, key=lambda held_out: held_out.error)


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
    chosen_fits = []
    for (name, loss), path in _list_paths_to_compare(paths, requested).items():
        index = choose_weight_index(path.errors, folds.validation.rule, folds.validation.draws)
        chosen_fits.append(_ChosenFit(name, loss, path, index))
    models = _score_models(folds, chosen_fits)
    return Selection.choose_among(models, screened=screened, links_may_be_base=links_may_be_base)


class _ChosenFit(NamedTuple):
    """Fits of one model and loss to the folds, with the chosen weight of the penalty."""

    model: ModelName
    loss: Loss
    path: PenaltyPath  # fits with all weights
    weight_index: int  # of the chosen weight

    @property
    def penalty(self) -> float | None:
        """Chosen weight; None for joints alone, which have no penalty."""
        return None if self.model == "joints" else self.path.weights[self.weight_index]

    @property
    def unknowns(self) -> FloatArray:
        """(K, P + E) unknowns of the fit without each of K folds."""
        return self.path.unknowns[:, self.weight_index]

    @property
    def error(self) -> float:
        """Mean over the folds of the held-out error [m]."""
        return float(self.path.errors[:, self.weight_index].mean())


def _score_models(folds: Folds, chosen_fits: Sequence[_ChosenFit]) -> list[HeldOut]:
    """Return the accuracy with which each fit predicts the readings of the folds that it did not use."""
    scores = _score_held_out(folds, np.array([chosen.unknowns for chosen in chosen_fits]))
    by_posture = _average_by_posture(folds, scores.residual_norms)
    models = []
    for number, chosen in enumerate(chosen_fits):
        held_out = HeldOut(
            model=chosen.model,
            loss=chosen.loss,
            error=chosen.error,
            penalty=chosen.penalty,
            by_fold=scores.compensation[number],
            by_posture=by_posture[number],
            folds_per_draw=folds.folds_per_draw,
        )
        models.append(held_out)
    return models


def _list_paths_to_compare(
    paths: Mapping[tuple[ModelName, Loss], PenaltyPath], requested: ModelName | None
) -> dict[tuple[ModelName, Loss], PenaltyPath]:
    """Return the fits of each model and loss that have a certified optimum, models from simple to rich.

    If the requested model has none, its fits are returned all the same: `choose_weight_index` then raises the
    error that no fit is certified.
    """
    from_simple_to_rich = [key for key in product(_NAMES, LOSSES) if key in paths]
    certified = [key for key in from_simple_to_rich if find_certified_weights(paths[key].errors).any()]
    of_requested = [(name, loss) for name, loss in from_simple_to_rich if name == requested]
    requested_is_certified = any(key in certified for key in of_requested)
    compared = certified if requested_is_certified else certified + of_requested
    return {key: paths[key] for key in compared}


def _average_by_posture(folds: Folds, norms: FloatArray) -> FloatArray:
    """Return the mean norm of the residuals in each of P postures, for each of M models: (M, P) [m].

    `norms` (M, D N) [m] are those of all N observations in each of D draws, in the order of the folds.
    """
    posture_of_observation = _number_postures(folds.rows.measurements.joints)
    observation_of_column = np.concatenate(folds.held_out)
    posture_of_column = posture_of_observation[observation_of_column]
    sums = np.array([np.bincount(posture_of_column, norms_of_model) for norms_of_model in norms])
    return np.asarray(sums / np.bincount(posture_of_column))


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
    for candidate in candidates:
        allowed_standard_errors = 1.0
        if candidate.model == "joints" and not screened:
            allowed_standard_errors = CLEAR_GAIN
        difference, standard_error = candidate.compare_residuals(best)
        if difference <= allowed_standard_errors * standard_error:
            return candidate.model
    return best.model


def find_richest_model(names: Sequence[ModelName], chosen: ModelName) -> ModelName:
    """Return the richest of some models; the base bends if the base of the chosen model bends.

    A model with a rigid base is skipped if the base bends in the chosen model. Intervals computed as if the
    chosen model were true would be too narrow (Leeb & Pötscher, *Model selection and inference: facts and
    fiction*, 2005); intervals of the richest model are valid, even if this model predicts worse.

    Args:
        names: models from simple to rich.
        chosen: model that the readings chose; one of `names`.
    """
    base_must_bend = chosen in WITH_BASE
    possible_names = [name for name in names if name in WITH_BASE or not base_must_bend]
    return possible_names[-1]


def _find_tied_model(
    by_name: Sequence[HeldOut], chosen: ModelName, *, links_may_be_base: bool
) -> ModelName | None:
    """Return the best model that bends links instead of the base, or the base instead of links.

    None if the chosen model bends neither or both, or if the readings distinguish the two: the tests do, and
    the model with links predicts worse than the chosen base by more than one standard error.

    Args:
        by_name: accuracy of each model, with its best loss.
        chosen: model that the readings chose.
        links_may_be_base: whether the tests do not distinguish links from the base.
    """
    with_links = [held_out for held_out in by_name if held_out.model in LINKS_ALONE]
    with_base = next((held_out for held_out in by_name if held_out.model == "joints_and_base"), None)
    if with_base is None or not with_links:  # not both kinds were compared
        return None
    links_are_chosen, base_is_chosen = chosen in LINKS_ALONE, chosen == with_base.model
    if links_are_chosen and links_may_be_base:
        return with_base.model
    if base_is_chosen:
        best_with_links = min(with_links, key=lambda held_out: held_out.mean_residual)
        difference, standard_error = best_with_links.compare_residuals(with_base)
        predicts_nearly_as_well = difference <= standard_error
        if links_may_be_base or predicts_nearly_as_well:
            return best_with_links.model
    return None


def _compute_gain(by_name: Sequence[HeldOut]) -> HeldOutGain | None:
    """Return the gain of the best model with links or base over joints alone.

    None if joints alone, or all models with links or base, are missing from `by_name`.
    """
    joints = next((held_out for held_out in by_name if held_out.model == "joints"), None)
    others = [held_out for held_out in by_name if held_out.model != "joints"]
    if joints is None or not others:
        return None
    best = min(others, key=lambda held_out: held_out.mean_residual)
    _, standard_error = joints.compare_residuals(best)
    return HeldOutGain(best.model, best.mean_residual, joints.mean_residual, standard_error)


class _HeldOutScores(NamedTuple):
    """Residuals of N observations in each of K folds, D draws, as M models predict them without the fold."""

    compensation: FloatArray  # (M, K) one minus the sum of the residuals over that of the deflections
    #: (M, D N) mean norm of the residuals of each observation's targets [m], in the order of the folds
    residual_norms: FloatArray


class _FoldPart(NamedTuple):
    """Readings of one fold in one block of observations, with the columns of all unknowns."""

    columns: FloatArray  # (b, T, 3, P + E) motions of T targets by unit unknowns
    deflection: FloatArray  # (b, T, 3) [m]
    present: BoolArray  # (b, T) which targets were read

    def compute_residual_norms(self, unknowns: FloatArray) -> FloatArray:
        """Return the lengths (M, b, T) of the residuals [m] by M models with unknowns (M, P + E)."""
        # Model m, observation b of the block, target t, axis i, unknown p.
        predicted = np.einsum("btip,mp->mbti", self.columns, unknowns)
        return np.asarray(np.linalg.norm(self.deflection - predicted, axis=-1))

    def average_over_targets(self, norms: FloatArray) -> FloatArray:
        """Return the mean (M, b) over the targets that were read, of lengths (M, b, T)."""
        target_count = np.maximum(self.present.sum(axis=1), 1)
        return np.asarray(np.where(self.present, norms, 0.0).sum(axis=-1) / target_count)

    @property
    def deflection_sum(self) -> float:
        """Sum of the lengths of all deflections that were read [m]."""
        return float(np.linalg.norm(self.deflection, axis=-1)[self.present].sum())


def _score_held_out(folds: Folds, unknowns: FloatArray) -> _HeldOutScores:
    """Predict each of K folds with M models whose unknowns (M, K, P + E) were fitted without that fold.

    A fold without any deflection has the compensation zero: nothing could be compensated.
    """
    model_count = len(unknowns)
    residual_sum = np.zeros((model_count, len(folds)))
    deflection_sum = np.zeros(len(folds))
    norms_of_folds: list[list[FloatArray]] = [[] for _ in folds.held_out]
    start = 0  # index of the first observation of the block
    for rows in generate_elastic_rows(folds.rows, folds.columns, folds.statements):
        for fold, observations in enumerate(folds.held_out):
            part = _select_fold(rows, observations, start)
            norms = part.compute_residual_norms(unknowns[:, fold])
            norms_of_folds[fold].append(part.average_over_targets(norms))
            residual_sum[:, fold] += norms[:, part.present].sum(axis=1)
            deflection_sum[fold] += part.deflection_sum
        start += len(rows.block.measurements)
    ratio = np.ones_like(residual_sum)
    np.divide(residual_sum, deflection_sum, out=ratio, where=deflection_sum > 0.0)
    return _HeldOutScores(1.0 - ratio, np.concatenate([*chain(*norms_of_folds)], axis=1))


def _select_fold(rows: BlockRows, observations: IndexArray, start: int) -> _FoldPart:
    """Return the part of a block that belongs to a fold.

    Args:
        rows: rows of a block of observations.
        observations: ascending indices of the fold's observations in the whole set.
        start: index of the block's first observation in the whole set.
    """
    block = rows.block.measurements
    in_fold = select_rows_of_part(observations, start, start + len(block))
    return _FoldPart(rows.targets[in_fold, ..., :-1], block.deflection[in_fold], block.present[in_fold])


def report_penalty(chosen: float, used: float) -> Iterator[Finding]:
    """Report a penalty at an end of the range that was tried, or a penalty that had to be raised.

    Args:
        chosen: weight λ that cross-validation chose.
        used: weight λ of the final fit: the smallest weight, at or above `chosen`, with a certified optimum.
    """
    if chosen >= WEIGHTS[-1]:
        yield _report_largest_penalty(chosen)
    elif chosen <= LIMITS[0]:
        yield _report_smallest_penalty(chosen)
    if used > chosen:
        yield Finding(
            code="link_penalty_raised",
            weight="use",
            message=f"cross-validation chose a penalty of {chosen:.3g}, but rounding errors prevent the "
            f"proof that the fit with this penalty is optimal: a penalty of {used:.3g} was used instead",
            remedy="compare `selection`; give link_penalty, or choose fewer links",
        )


def _report_largest_penalty(chosen: float) -> Finding:
    """Return the finding that cross-validation chose the largest penalty that it tries."""
    return Finding(
        code="link_penalty_at_end",
        weight="use",
        message=f"cross-validation chose a penalty of {chosen:.3g}: held-out readings are predicted best "
        "when hardly any link bends",
        remedy="use elasticity joints; compare the models' held-out compensation in `selection`",
    )


def _report_smallest_penalty(chosen: float) -> Finding:
    """Return the finding that cross-validation chose the smallest penalty that it tries."""
    return Finding(
        code="link_penalty_at_end",
        weight="use",
        message=f"cross-validation chose the smallest penalty that it tries, {chosen:.3g}: the readings "
        "determine the links nearly without a penalty, and the penalty does not bias the links",
        remedy="to try a smaller penalty, give link_penalty; predictions will hardly change",
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
