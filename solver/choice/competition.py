"""Competition of elastic models on held-out postures, with the choice of loss and penalty (method.md §7).

Models compete in two stages. First all models are fitted by squares, for all weights of the penalty. Then
those whose error is near the least are fitted by Huber's loss, near the weight that squares chose: a robust
fit takes several times as long, and seldom changes the order of the models.

The unit of work is the fit of all models by squares with some weights and one fold held out. If the request
gives the penalty, only one weight is fitted: this is so quick that the competition has no steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from jointstiff.schemas.options import CrossValidation, Loss, RunOptions
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.choice.held_out import (
    LIMITS,
    LINKS_ALONE,
    WEIGHTS,
    WITH_BASE,
    Folds,
    HeldOut,
    PenaltyPath,
    Selection,
    choose_weight_index,
    draw_folds,
    find_certified_weights,
    fit_first_certified,
    fit_fold,
    fit_folds,
    list_models_to_compare,
    refine_path,
    select_model,
)
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.effective import EffectiveCompliances, compute_effective_compliances
from jointstiff.solver.fit.elastic import ElasticFit, refuse_unsupported_elastic
from jointstiff.solver.fit.method import DEFAULT_THRESHOLD, Settings
from jointstiff.solver.fit.reduced import (
    LOSSES,
    Candidate,
    convert_weight_to_huber,
    list_losses_to_compare,
)
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.terms import list_stated_terms
from jointstiff.solver.models import Columns, find_model

_Paths: TypeAlias = dict[tuple[ModelName, Loss], PenaltyPath]
"""For each model and loss the fits with each fold held out, for several weights of the penalty."""

_PENALTIES_PER_STEP: Final = 4
"""Number of penalties that one step fits: with all models 0.2 s for 30 targets, 1 s for 300."""
_NEAR: Final = 1.5
"""Error of a model, relative to the least of all models, up to which further losses are tried."""
_STEPS_NEAR: Final = (-2, 0, 2)
"""Weights tried with a further loss: quarters of a decade from the weight that squares chose."""


def find_obstacle_to_elastic_links(
    options: RunOptions, settings: Settings, robot: Robot, measurements: Measurements
) -> str | None:
    """Return the field of the request that rules out models with bending links or base; None if nothing does.

    The field is "observations" if all observations have the same posture: cross-validation holds postures
    out, so that it needs two.

    Raises:
        RequestError: a link is named that the robot does not have.
    """
    if options.resampling is not None:
        return "resampling"
    try:
        # Call the functions that a fit with links calls first, for their refusals only.
        refuse_unsupported_elastic(settings)
        Columns.from_options(options, robot)
        if options.loss != "automatic":
            list_losses_to_compare(measurements, (options.loss,))
    except UnsupportedMethodError as error:
        return error.where or "elasticity"
    has_one_posture = (measurements.joints == measurements.joints[0]).all()
    return "observations" if has_one_posture else None


@dataclass(frozen=True, eq=False)
class Elastic:
    """Fit of a model with bending links or base to the whole set, with intervals of joint compliances."""

    estimate: ElasticFit  #: fit of the chosen model
    #: effective compliances of the joints, with intervals that account for the choice of the model
    effective: EffectiveCompliances
    #: model whose fit gives the intervals; None without intervals, because the penalty was given
    intervals: ModelName | None


@dataclass(frozen=True, eq=False)
class Winner:
    """Winning model: the simplest that predicts held-out postures nearly as well as the best."""

    selection: Selection  #: all models and losses that were compared
    held_out: HeldOut  #: prediction of the winner
    elastic: Elastic | None  #: fit of the winner to the whole set; None for joints alone
    given: bool  #: True if the request names the model, so that no model was chosen


class _Pairs(NamedTuple):
    """Numbers of the pairs of a held-out fold and a weight of the penalty.

    First come the pairs of fold 0 with all weights, then those of fold 1, and so on: the pair of fold k with
    weight w has the number ``k · weight_count + w``. A span (start, stop) of numbers has pairs of one fold.
    """

    fold_count: int
    weight_count: int

    def list_spans(self, most_pairs: int) -> tuple[tuple[int, int], ...]:
        """Divide the pairs of each fold into spans of at most `most_pairs` pairs."""
        spans: list[tuple[int, int]] = []
        for fold in range(self.fold_count):
            first_of_fold, first_of_next_fold = fold * self.weight_count, (fold + 1) * self.weight_count
            for start in range(first_of_fold, first_of_next_fold, most_pairs):
                stop = min(start + most_pairs, first_of_next_fold)
                spans.append((start, stop))
        return tuple(spans)

    def find_fold(self, span: tuple[int, int]) -> int:
        """Return the fold of the pairs of a span."""
        start, _ = span
        return start // self.weight_count

    def find_weights(self, span: tuple[int, int]) -> slice:
        """Return the indices of the weights of the pairs of a span, which all belong to one fold."""
        start, stop = span
        first_of_fold = self.find_fold(span) * self.weight_count
        return slice(start - first_of_fold, stop - first_of_fold)


class _FitsOfPairs(NamedTuple):
    """Fits of M models by squares, for each of some pairs of a held-out fold and a weight of the penalty."""

    unknowns: FloatArray  # (M, pairs, P + E) compliances and stated errors of each model and pair
    errors: FloatArray  # (M, pairs) errors with which they predict the held-out fold [m]

    @classmethod
    def join_steps(cls, arrays_of_steps: Sequence[Mapping[str, FloatArray]]) -> _FitsOfPairs:
        """Return the fits of all steps in order, from the arrays of each step that `to_arrays` gave."""
        unknowns = np.concatenate([arrays["fold_compliances"] for arrays in arrays_of_steps], axis=1)
        errors = np.concatenate([arrays["error"] for arrays in arrays_of_steps], axis=1)
        return cls(unknowns, errors)

    def to_arrays(self) -> dict[str, FloatArray]:
        """Return the arrays of a step by their names, as they are stored between processes."""
        return {"fold_compliances": self.unknowns, "error": self.errors}

    def arrange_by_fold(self, model: int, pairs: _Pairs, weights: tuple[float, ...]) -> PenaltyPath:
        """Return the fits of one model, with an axis for the folds and an axis for the weights.

        Args:
            model: index of the model.
            pairs: numbers of all pairs, which are those of these fits.
            weights: weights of the penalty.
        """
        unknowns = self.unknowns[model].reshape(pairs.fold_count, pairs.weight_count, -1)
        errors = self.errors[model].reshape(pairs.fold_count, pairs.weight_count)
        return PenaltyPath(weights, unknowns, errors)


def _choose_cross_validation(options: RunOptions) -> CrossValidation:
    """Return the cross-validation of the request, with one draw of folds if the request gives the penalty.

    Repeated draws serve to choose the penalty.
    """
    if options.link_penalty is None:
        return options.cross_validation
    return options.cross_validation.model_copy(update={"draws": 1})


def _list_losses(options: RunOptions, measurements: Measurements) -> tuple[Loss, ...]:
    """Return the losses to compare: the loss that the request names, or else those that the set supports.

    If the request gives the penalty but no loss, the loss is squared: the strength of a given penalty is
    relative to the squared loss.

    Raises:
        UnsupportedMethodError: the set does not support the loss of the request.
    """
    losses: tuple[Loss, ...] = LOSSES
    if options.link_penalty is not None:
        losses = ("squared",)
    if options.loss != "automatic":
        losses = (options.loss,)
    return list_losses_to_compare(measurements, losses)


def _refuse_resampling(options: RunOptions) -> None:
    """Refuse a request that resamples observations.

    Raises:
        UnsupportedMethodError: `resampling` is in the request.
    """
    if options.resampling is not None:
        raise UnsupportedMethodError(
            "resampling works only with elasticity joints",
            where="resampling",
            remedy="omit `resampling`; the cross-validation shows the dispersion",
        )


class Competition:
    """Comparison of models by their prediction of held-out postures, computed in short steps."""

    unit = "penalties"
    activity = "cross-validating"

    def __init__(self, joints: JointsAlone, options: RunOptions) -> None:
        """Check the request, and determine what is compared: models, losses and weights of the penalty.

        If the request gives the penalty, that is the only weight. Models are still compared.

        Args:
            joints: identification of joints alone, with which the models are compared.
            options: model, losses, penalty and cross-validation.

        Raises:
            RequestError: the readings or options do not support the comparison, or a joint does not exist.
        """
        refuse_unsupported_elastic(joints.stated)
        _refuse_resampling(options)
        measurements = joints.given.measurements
        self._joints, self._options = joints, options
        self._columns = Columns.from_options(options, joints.robot)
        #: model that the request names; None if the model is chosen automatically
        self._requested = None if options.elasticity == "automatic" else options.elasticity
        self._weights = WEIGHTS if options.link_penalty is None else (options.link_penalty,)
        self._validation = _choose_cross_validation(options)
        self._losses = _list_losses(options, measurements)
        fold_count = len(draw_folds(self._validation, measurements.joints))
        self._pairs = _Pairs(fold_count, len(self._weights))

    @property
    def loss_is_compared(self) -> bool:
        """True if several losses are compared on held-out postures."""
        return len(self._losses) > 1

    @property
    def loss_is_automatic(self) -> bool:
        """True if the request names no loss."""
        return self._options.loss == "automatic"

    @property
    def penalty_is_given(self) -> bool:
        """True if the request gives the penalty, so that cross-validation does not choose one."""
        return self._options.link_penalty is not None

    @property
    def screening(self) -> Screening:
        """Tests of the residuals of joints alone, fitted with the squared loss, for other causes."""
        return self._joints.with_loss("squared").screening

    def steps(self) -> tuple[tuple[int, int], ...]:
        """Return the steps of the cross-validation; no steps if the request gives the penalty.

        Each step is a span (start, stop) of numbered pairs of a held-out fold and a weight of the penalty
        (`_Pairs`). A span has pairs of one fold.
        """
        return () if self.penalty_is_given else self._pairs.list_spans(_PENALTIES_PER_STEP)

    def compute(self, span: tuple[int, int]) -> dict[str, FloatArray]:
        """Fit all models for the weights of one step, with the step's fold held out.

        Args:
            span: one of `steps`.

        Returns:
            `fold_compliances` (M, W, P + E) and `error` (M, W) [m], the compliances and stated errors of M
            models fitted by squares for W weights, and the errors with which they predict the held-out fold.

        Raises:
            JointstiffError: joints alone cannot be identified, or the penalty has no scale.
        """
        fold = self._pairs.find_fold(span)
        weights = self._weights[self._pairs.find_weights(span)]
        unknowns_of_models, errors_of_models = [], []
        for candidate in self._squared_candidates:
            unknowns, errors = fit_fold(self._folds, candidate, fold, weights)
            unknowns_of_models.append(unknowns)
            errors_of_models.append(errors)
        return _FitsOfPairs(np.array(unknowns_of_models), np.array(errors_of_models)).to_arrays()

    def choose_winner(self, parts: Sequence[Mapping[str, FloatArray]]) -> Winner:
        """Choose model, loss and penalty, and fit the chosen model to the whole set.

        All models are fitted by squares; those that predict nearly as well as the best are then fitted with
        Huber's loss, too.

        Args:
            parts: results of `compute` of all steps, in order.

        Raises:
            JointstiffError: joints alone cannot be identified, or no optimum is certified.
        """
        paths = self._collect_paths_of_squares(parts)
        near_the_best = self._list_models_near_best(paths)
        for candidate in near_the_best:
            paths[candidate.key] = self._search_penalty_of_squares(candidate, paths[candidate.key])
        if "huber" in self._losses:
            paths |= self._fit_folds_by_huber(near_the_best, paths)
        selection, chosen = self._choose_model(paths)
        elastic = None
        if chosen.model != "joints":
            elastic = self._fit_whole_set(chosen, selection, paths)
        return Winner(selection, chosen, elastic, given=self._requested is not None)

    def _collect_paths_of_squares(self, arrays_of_steps: Sequence[Mapping[str, FloatArray]]) -> _Paths:
        """Return the fits of all models by squares, for each weight and with each fold held out.

        If the request gives the penalty, there are no steps, and the fits are computed here.

        Args:
            arrays_of_steps: results of `compute` of all steps, in order.
        """
        if self.penalty_is_given:
            one_span_per_fold = self._pairs.list_spans(most_pairs=self._pairs.weight_count)
            arrays_of_steps = [self.compute(span) for span in one_span_per_fold]
        fits = _FitsOfPairs.join_steps(arrays_of_steps)
        paths = {}
        for index, candidate in enumerate(self._squared_candidates):
            paths[candidate.key] = fits.arrange_by_fold(index, self._pairs, self._weights)
        return paths

    def _list_models_near_best(self, paths: _Paths) -> list[Candidate]:
        """Return the models whose fits by squares predict nearly as well as the best.

        If the request names another loss than squares, all models are returned.
        """
        if "squared" not in self._losses:
            return list(self._squared_candidates)
        least_errors = {key: path.least_error for key, path in paths.items()}
        limit = _NEAR * min(least_errors.values())
        return [candidate for candidate in self._squared_candidates if least_errors[candidate.key] <= limit]

    def _fit_folds_by_huber(self, candidates: Sequence[Candidate], paths: _Paths) -> _Paths:
        """Return the fits of some models by Huber's loss, with each fold held out.

        `paths` are the fits by squares, whose penalties show which penalties to try.
        """
        huber_paths = {}
        for candidate in candidates:
            with_huber = replace(candidate, loss="huber")
            weights = self._list_weights_for_huber(candidate, paths[candidate.key])
            huber_paths[with_huber.key] = fit_folds(self._folds, with_huber, weights)
        return huber_paths

    def _list_weights_for_huber(self, candidate: Candidate, path: PenaltyPath) -> list[float]:
        """Return the weights to try with Huber's loss, around the weight that is as strong as squares' best.

        Weights are ``λ = 10^(q/4)`` with whole quarters of a decade q. All weights are returned if none of
        squares was certified, or if the request gives the only weight.

        Args:
            candidate: model, fitted by squares.
            path: its fits by squares for several weights.
        """
        if self.penalty_is_given or not find_certified_weights(path.errors).any():
            return list(self._weights)
        best = choose_weight_index(path.errors, "best")
        mean_unknowns = path.unknowns[:, best].mean(axis=0)  # over the folds
        training_rows = self._folds.reduce_training_rows(candidate)
        equal_weight = convert_weight_to_huber(training_rows, candidate, mean_unknowns, path.weights[best])
        middle = _count_quarters_of_decade(equal_weight)
        least, greatest = (_count_quarters_of_decade(limit) for limit in LIMITS)
        quarters = {min(max(middle + step, least), greatest) for step in _STEPS_NEAR}
        return [10.0 ** (quarter / 4.0) for quarter in sorted(quarters)]

    def _search_penalty_of_squares(self, candidate: Candidate, path: PenaltyPath) -> PenaltyPath:
        """Return the fits of a model by squares with finer weights of the penalty around the best.

        The fits are returned as they are if there is no weight to search: the model has no penalty, the
        request gives the weight, or no optimum was certified, so that no weight is known to be the best.
        """
        has_free_penalty = not (self.penalty_is_given or candidate.model.has_only_joints)
        has_certified_optimum = find_certified_weights(path.errors).any()
        if has_free_penalty and has_certified_optimum:
            return refine_path(self._folds, candidate, path)
        return path

    def _choose_model(self, paths: _Paths) -> tuple[Selection, HeldOut]:
        """Choose the model with its loss and penalty, after trying finer penalties around the best penalties.

        Return the comparison of all models, and the chosen model. Fits with finer penalties are added to
        `paths`.
        """
        selection = self._compare_models(paths)
        chosen = selection.find_held_out(self._requested or selection.simplest)
        if chosen.model == "joints":
            # The identification of joints alone supports these two losses only.
            chosen = selection.find_held_out("joints", ("squared", "huber"))
        elif not self.penalty_is_given and chosen.loss == "squared":
            selection = self._refine_penalty(chosen, selection, paths)
            chosen = selection.find_held_out(chosen.model, (chosen.loss,))
        return selection, chosen

    def _compare_models(self, paths: _Paths) -> Selection:
        """Compare the models with the losses of the request.

        Fits by squares are always among `paths`, as those by Huber's loss follow from them; they are compared
        only if the squared loss is one of the request's losses.
        """
        model_is_automatic = self._requested is None
        selection = select_model(
            self._folds,
            {(name, loss): path for (name, loss), path in paths.items() if loss in self._losses},
            self._requested,
            # Models are compared automatically only after a test has indicated that links or base bend.
            screened=model_is_automatic,
            links_may_be_base=model_is_automatic and self.screening.links_may_be_base,
        )
        if model_is_automatic and not self.penalty_is_given:
            return self._refine_smallest_penalties(selection, paths)
        return selection

    def _refine_smallest_penalties(self, selection: Selection, paths: _Paths) -> Selection:
        """Compare the models again, after trying still smaller penalties of some models.

        A model whose best penalty is the smallest that was tried might predict better with a smaller one, so
        that the comparison would not be fair. Fits with finer penalties are added to `paths`.
        """
        smallest_tried = self._weights[0]
        for name in selection.names:
            held_out = selection.find_held_out(name)
            if held_out.penalty == smallest_tried and held_out.loss == "squared":
                selection = self._refine_penalty(held_out, selection, paths)
        links_may_be_base = self.screening.links_may_be_base
        return Selection.choose_among(selection.models, screened=True, links_may_be_base=links_may_be_base)

    @cached_property
    def _squared_candidates(self) -> list[Candidate]:
        """Models to compare, with the squared loss."""
        threshold = self._options.huber_threshold or DEFAULT_THRESHOLD
        names = list_models_to_compare(self.screening, self._requested)
        return [Candidate(find_model(name), self._columns, "squared", threshold) for name in names]

    @cached_property
    def _folds(self) -> Folds:
        """Measurement set divided into folds."""
        joints = self._joints
        visible = ~joints.estimate.observability.null
        return Folds(joints.given, self._columns, visible, self._validation, self._statements)

    @cached_property
    def _statements(self) -> Statements | None:
        """Statements on loads, places and compliances, to be fitted with the readings; None without any.

        Their columns are computed at the compliances of joints alone: those of links change the columns by a
        fraction of an error that is small itself.
        """
        measurements, estimate = self._joints.given.measurements, self._joints.estimate
        prior = self._joints.stated.prior
        stated_terms = list_stated_terms(measurements)
        if not stated_terms and prior is None:
            return None
        sigma = measurements.sigma or estimate.sigma or 0.0
        return Statements(
            terms=stated_terms,
            common=measurements.common_uncertainty,
            compliance=np.maximum(estimate.compliance, 0.0),
            sigma=max(sigma, LEAST_STATED_SIGMA),
            prior=prior,
        )

    def _find_candidate(self, held_out: HeldOut) -> Candidate:
        """Return the compared model whose name and loss are those of `held_out`."""
        candidates = {candidate.model.name: candidate for candidate in self._squared_candidates}
        return replace(candidates[held_out.model], loss=held_out.loss)

    def _refine_penalty(self, held_out: HeldOut, selection: Selection, paths: _Paths) -> Selection:
        """Search the penalty of one model on a finer grid, and return the selection with its new accuracy.

        The path of the model in `paths` is replaced.

        Args:
            held_out: accuracy of the model so far, which names model and loss.
            selection: comparison of all models so far.
            paths: fits of each model and loss.
        """
        candidate = self._find_candidate(held_out)
        refined_path = refine_path(self._folds, candidate, paths[candidate.key])
        paths[candidate.key] = refined_path
        this_model_alone = select_model(self._folds, {candidate.key: refined_path}, held_out.model)
        (refined_accuracy,) = this_model_alone.models
        return selection.replace_refined(refined_accuracy)

    def _fit_with_chosen_penalty(self, held_out: HeldOut, paths: _Paths) -> ElasticFit:
        """Fit a model to the whole set with the penalty that cross-validation chose.

        If no optimum is certified with this penalty, the next larger penalties are tried. A model without a
        penalty has one fit, whatever the weight.

        Raises:
            UnsupportedMethodError: neither the chosen nor a larger penalty has a certified optimum.
        """
        weights = paths[held_out.model, held_out.loss].weights
        chosen_index = weights.index(held_out.penalty or weights[0])
        chosen_and_larger = weights[chosen_index:]  # ascending
        return fit_first_certified(self._folds, self._find_candidate(held_out), chosen_and_larger)

    def _fit_whole_set(self, held_out: HeldOut, selection: Selection, paths: _Paths) -> Elastic:
        """Fit the chosen model to the whole set, with intervals that account for the choice of the model.

        Intervals are those of a fit of the richest model by squares, whatever the loss; those of the chosen
        model if the request names the model. If the readings do not distinguish links from the base, the
        chosen model is tied with one of the other kind: then the intervals contain the intervals of both
        models, provided that the tied model has a certified optimum.

        Args:
            held_out: the chosen model.
            selection: comparison of all models.
            paths: fits of each model and loss.
        """
        elastic = self._fit_with_chosen_penalty(held_out, paths)
        if self.penalty_is_given:
            return Elastic(elastic, self._compute_effective(elastic, elastic), intervals=None)
        if self._requested is not None:
            name = elastic.model.name
            by_squares = self._fit_whole_set_by_squares(name, paths) or elastic
            return Elastic(elastic, self._compute_effective(elastic, by_squares), intervals=name)
        richest = self._fit_whole_set_by_squares(selection.largest, paths) or elastic
        effective = self._compute_effective(elastic, richest)
        whole_set = Elastic(elastic, effective, intervals=richest.model.name)
        if selection.tied is None:
            return whole_set
        return self._widen_by_tied_model(whole_set, selection.tied, selection, paths)

    def _widen_by_tied_model(
        self, whole_set: Elastic, tied: ModelName, selection: Selection, paths: _Paths
    ) -> Elastic:
        """Widen the intervals of a fit to contain those of a tied model, which the readings do not rule out.

        One of the two models has bending links, the other a bending base. The prediction of the fit states
        that either may bend, and whether the intervals contain those of both models.

        Args:
            whole_set: fit of the chosen model.
            tied: the other model.
            selection: comparison of all models.
            paths: fits of each model and loss.
        """
        elastic, effective = whole_set.estimate, whole_set.effective
        effective_of_tied = self._compute_effective_of_tied(tied, selection, paths)
        if effective_of_tied is not None:
            effective = effective.widen_ranges_by(effective_of_tied)
        prediction = replace(
            elastic.prediction,
            bending="links_or_base",
            predicted_by="base" if elastic.model.name in WITH_BASE else "links",
            joined=effective_of_tied is not None,
        )
        return replace(whole_set, estimate=replace(elastic, prediction=prediction), effective=effective)

    def _fit_whole_set_by_squares(self, name: ModelName, paths: _Paths) -> ElasticFit | None:
        """Fit a model to the whole set by squares, with its best penalty; None if no optimum is certified.

        The penalty is searched on the finer grid first; then larger penalties are tried.
        """
        candidate = next(candidate for candidate in self._squared_candidates if candidate.model.name == name)
        path = self._search_penalty_of_squares(candidate, paths[candidate.key])
        paths[candidate.key] = path
        if not find_certified_weights(path.errors).any():
            return None
        chosen_index = choose_weight_index(path.errors, self._validation.rule, self._validation.draws)
        chosen_and_larger = path.weights[chosen_index:]
        try:
            return fit_first_certified(self._folds, candidate, chosen_and_larger)
        except UnsupportedMethodError:
            return None

    def _compute_effective_of_tied(
        self, tied: ModelName, selection: Selection, paths: _Paths
    ) -> EffectiveCompliances | None:
        """Return the effective compliances of the tied model; None if its fit is not certified.

        The intervals come from the richest model with links and rigid base if links are tied, or from the
        tied model if the fit of the richest is not certified.
        """
        try:
            fit_of_tied = self._fit_with_chosen_penalty(selection.find_held_out(tied), paths)
        except UnsupportedMethodError:
            return None
        richest = tied
        if tied in LINKS_ALONE:
            *_, richest = [name for name in selection.names if name in LINKS_ALONE]  # from simple to rich
        fit_of_richest = self._fit_whole_set_by_squares(richest, paths) or fit_of_tied
        return self._compute_effective(fit_of_tied, fit_of_richest)

    def _compute_effective(self, elastic: ElasticFit, fit_for_ranges: ElasticFit) -> EffectiveCompliances:
        """Return the effective joint compliances of a fit, with ranges that another fit gives.

        The effective compliance of a joint includes the bending of its link about the joint's axis. Ranges
        are published as intervals only if cross-validation chose the penalty.

        Args:
            elastic: fit of the chosen model.
            fit_for_ranges: fit of the richest model, as the ranges of a model that the readings chose would
                be too narrow.
        """
        return compute_effective_compliances(
            self._joints.robot,
            elastic,
            self._joints.stated.confidence,
            fit_for_ranges,
            publishes_ranges=not self.penalty_is_given,
        )


def _count_quarters_of_decade(weight: float) -> int:
    """Return the whole number q for which ``10^(q/4)`` is nearest to a weight."""
    return round(4.0 * float(np.log10(weight)))
