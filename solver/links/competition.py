"""Competition of models on held-out postures: what else bends, with which loss and penalty (method.md §7).

A unit of the competition is a weight of the penalty in a fold, for all models. A penalty that is given leaves
one weight, which is quick: such a competition takes no steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.estimation.causes import Screening
from jointstiff.solver.estimation.joints import JointsAlone
from jointstiff.solver.estimation.method import DEFAULT_THRESHOLD, Settings
from jointstiff.solver.links.choice import (
    WEIGHTS,
    Folds,
    HeldOut,
    PenaltyPath,
    Selection,
    draw_folds,
    fit_fold,
    list_models_to_compare,
    refine_path,
    select_model,
)
from jointstiff.solver.links.fit import (
    EffectiveCompliances,
    ElasticEstimate,
    compute_effective_compliances,
    fit_first_certified,
    refuse_unsupported_elastic,
)
from jointstiff.solver.links.model import (
    LINKS_ALONE,
    LOSSES,
    ElasticColumns,
    ElasticModel,
    list_losses_to_compare,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot

_Paths: TypeAlias = dict[tuple[ModelName, Loss], PenaltyPath]

_WEIGHTS_A_STEP: Final = 3
"""Weights that one step fits: with all models and losses 0.5 s for 30 targets, and 5 s for 300."""


def find_excluding_option(
    options: RunOptions, settings: Settings, robot: Robot, measurements: Measurements
) -> str | None:
    """Return the name of an option that excludes models with bending links or base; None without such.

    Raises:
        RequestError: a link is named that the robot does not have.
    """
    if options.resampling is not None:
        return "resampling"
    try:
        refuse_unsupported_elastic(measurements, settings)
        ElasticColumns.from_options(options, robot)
    except UnsupportedMethodError as error:
        return error.where or "elasticity"
    joints = measurements.joints
    return "observations" if (joints == joints[0]).all() else None  # one posture cannot be left out


@dataclass(frozen=True, eq=False)
class Elastic:
    """Fit of a model with bending links or base to the whole set, with intervals of joint compliances."""

    estimate: ElasticEstimate
    #: effective compliances of the joints, with intervals that account for the choice of the model
    effective: EffectiveCompliances
    intervals: ModelName | None  #: model whose fit gives the intervals; None if the penalty was given


@dataclass(frozen=True, eq=False)
class Winner:
    """Winning model: the simplest that predicts held-out postures nearly as well as the best."""

    selection: Selection  #: all models and losses that were compared
    held_out: HeldOut  #: prediction of the winner
    elastic: Elastic | None  #: fit of the winner to the whole set; None for joints alone
    given: bool  #: True if the request names the model, so that none was chosen


class Competition:
    """Comparison of models by their prediction of held-out postures, computed in short steps."""

    unit = "penalties"
    activity = "cross-validating"

    def __init__(self, joints: JointsAlone, options: RunOptions) -> None:
        """Check the request, and determine the losses and penalties to compare.

        Args:
            joints: identification of joints alone, with which the models are compared.
            options: model, losses, penalty and cross-validation.

        Raises:
            RequestError: the readings or options do not support the comparison, or a joint does not exist.
        """
        measurements, given = joints.given, options.link_penalty
        refuse_unsupported_elastic(measurements, joints.stated)
        if options.resampling is not None:
            raise UnsupportedMethodError(
                "resampling supports only elasticity joints",
                where="resampling",
                remedy="omit `resampling`; the cross-validation shows the dispersion",
            )
        self._joints, self._options = joints, options
        self._columns = ElasticColumns.from_options(options, joints.robot)
        self._requested = None if options.elasticity == "automatic" else options.elasticity
        # A given penalty is not chosen by repeated draws: one draw shows how well the model predicts.
        once = {} if given is None else {"draws": 1}
        self._validation = options.cross_validation.model_copy(update=once)
        self._weights = WEIGHTS if given is None else (given,)
        # A given penalty is relative to squares: with another loss it would mean something else.
        losses: tuple[Loss, ...] = LOSSES if given is None else ("squared",)
        if options.loss != "automatic":
            losses = (options.loss,)
        self._losses = list_losses_to_compare(measurements, losses)
        self._fold_count = len(draw_folds(self._validation, measurements.joints))

    @property
    def loss_is_compared(self) -> bool:
        """Return whether several losses are compared on held-out postures."""
        return len(self._losses) > 1

    @property
    def loss_is_automatic(self) -> bool:
        """Return whether no loss was requested."""
        return self._options.loss == "automatic"

    @property
    def penalty_is_given(self) -> bool:
        """Return whether the request gives the penalty, so that cross-validation does not choose one."""
        return self._options.link_penalty is not None

    @property
    def screening(self) -> Screening:
        """Tests of the residuals of joints alone, fitted with the squared loss, for other causes."""
        return self._joints.with_loss("squared").screening

    def steps(self) -> tuple[tuple[int, int], ...]:
        """Return the steps as spans of fold-and-weight numbers; no steps if the penalty is given.

        A span (start, stop) counts the weights of fold 0, then those of fold 1, and so on.
        """
        if self.penalty_is_given:
            return ()
        count = len(self._weights)
        return tuple(
            (fold * count + start, fold * count + min(start + _WEIGHTS_A_STEP, count))
            for fold in range(self._fold_count)
            for start in range(0, count, _WEIGHTS_A_STEP)
        )

    def compute(self, span: tuple[int, int]) -> dict[str, FloatArray]:
        """Fit all models for the weights of one step, with the step's fold held out.

        Returns:
            `fold_compliances` (M, W, P) and `error` (M, W) [m] of M models for W weights.

        Raises:
            JointstiffError: joints alone cannot be identified, or the penalty has no scale.
        """
        fold, start = divmod(span[0], len(self._weights))
        weights = self._weights[start : start + span[1] - span[0]]
        fits = [fit_fold(self._folds, model, fold, weights) for model in self._models]
        compliances, errors = map(np.array, zip(*fits, strict=True))
        return {"fold_compliances": compliances, "error": errors}

    def winner(self, parts: Sequence[Mapping[str, FloatArray]]) -> Winner:
        """Choose model, loss and penalty, and fit the chosen model to the whole set.

        Args:
            parts: results of `compute` of all steps, in order.

        Raises:
            JointstiffError: joints alone cannot be identified, or no optimum is certified.
        """
        paths = self._collect_paths(parts)
        selection, held_out = self._choose(paths)
        elastic = None if held_out.model == "joints" else self._fit_whole_set(held_out, selection, paths)
        return Winner(selection, held_out, elastic, self._requested is not None)

    def _collect_paths(self, parts: Sequence[Mapping[str, FloatArray]]) -> _Paths:
        """Return the fits of all models with each fold held out; keys are (model, loss)."""
        if not self.steps():
            count = len(self._weights)
            parts = [self.compute((k * count, (k + 1) * count)) for k in range(self._fold_count)]
        shape = len(self._models), self._fold_count, len(self._weights)
        compliances, errors = (
            np.concatenate([part[name] for part in parts], axis=1) for name in ("fold_compliances", "error")
        )
        return {
            model.key: PenaltyPath(self._weights, *of_model)
            for model, *of_model in zip(
                self._models, compliances.reshape(*shape, -1), errors.reshape(shape), strict=True
            )
        }

    def _choose(self, paths: _Paths) -> tuple[Selection, HeldOut]:
        """Choose the model with its loss and penalty, after trying finer penalties around the best penalties.

        Return the comparison of all models, and the chosen model. Fits with finer penalties are added to
        `paths`.
        """
        given, automatic = self.penalty_is_given, self._requested is None
        selection = select_model(self._folds, paths, self._requested, screened=automatic)
        if automatic and not given:
            # A model whose best penalty is the smallest tried needs a smaller one for a fair comparison.
            for name in dict.fromkeys(each.model for each in selection.models):
                ended = selection.find_held_out(name)
                if ended.penalty == self._weights[0]:
                    selection = self._refine(ended, selection, paths)
            selection = Selection.choose_among(selection.models, screened=automatic)
        chosen = selection.find_held_out(self._requested or selection.simplest)
        if chosen.model == "joints":
            chosen = selection.find_held_out("joints", ("squared", "huber"))
        elif not given:
            selection = self._refine(chosen, selection, paths)
            chosen = selection.find_held_out(chosen.model, (chosen.loss,))
        return selection, chosen

    @cached_property
    def _models(self) -> list[ElasticModel]:
        """Models to compare, each with all losses."""
        threshold = self._options.huber_threshold or DEFAULT_THRESHOLD
        names = list_models_to_compare(self.screening, self._requested)
        return [ElasticModel(name, self._columns, loss, threshold) for name in names for loss in self._losses]

    @cached_property
    def _folds(self) -> Folds:
        """Measurement set divided into folds."""
        joints = self._joints
        visible = ~joints.estimate.observability.null
        return Folds(joints.robot, joints.given, self._columns, visible, self._validation)

    def _find_model(self, held_out: HeldOut) -> ElasticModel:
        """Return the model with the name and loss of a held-out accuracy."""
        return next(model for model in self._models if model.key == (held_out.model, held_out.loss))

    def _refine(self, held_out: HeldOut, selection: Selection, paths: _Paths) -> Selection:
        """Search the penalty of the model with this score on a finer grid; return the new selection.

        The path of the model in `paths` is replaced.
        """
        model = self._find_model(held_out)
        paths[model.key] = refine_path(self._folds, model, paths[model.key])
        of_model = select_model(self._folds, {model.key: paths[model.key]}, held_out.model)
        return selection.replace_refined(of_model.models[0])

    def _fit_with_chosen_penalty(self, held_out: HeldOut, paths: _Paths) -> ElasticEstimate:
        """Fit a model to the whole set with the penalty that cross-validation chose.

        Raises:
            UnsupportedMethodError: neither the chosen nor a larger penalty has a certified optimum.
        """
        grid = paths[held_out.model, held_out.loss].weights
        place = grid.index(held_out.penalty or grid[0])
        return fit_first_certified(self._folds, self._find_model(held_out), grid[place:])

    def _fit_whole_set(self, held_out: HeldOut, selection: Selection, paths: _Paths) -> Elastic:
        """Fit the chosen model to the whole set, with intervals that account for the choice of the model.

        If held-out postures do not distinguish links from the base, the intervals contain the intervals of
        both models, provided that the model with links has a certified optimum.
        """
        elastic = self._fit_with_chosen_penalty(held_out, paths)
        if self._requested is not None:
            named = None if self.penalty_is_given else elastic.model.name
            return Elastic(elastic, self._compute_effective(elastic, elastic), named)
        widest = self._widest_fit(elastic, selection, paths)
        effective = self._compute_effective(elastic, widest)
        if selection.tied is not None:
            of_links = self._compute_effective_of_links(selection.tied, selection, paths)
            if of_links is not None:
                effective = effective.joined(of_links)
            prediction = replace(elastic.prediction, bending="links_or_base", joined=of_links is not None)
            elastic = replace(elastic, prediction=prediction)
        return Elastic(elastic, effective, widest.model.name)

    def _widest_fit(self, elastic: ElasticEstimate, selection: Selection, paths: _Paths) -> ElasticEstimate:
        """Return the fit of the richest model, for intervals; the chosen fit if that is not certified."""
        if selection.largest == elastic.model.name:
            return elastic
        try:
            return self._fit_with_chosen_penalty(selection.find_held_out(selection.largest), paths)
        except UnsupportedMethodError:
            return elastic

    def _compute_effective_of_links(
        self, tied: ModelName, selection: Selection, paths: _Paths
    ) -> EffectiveCompliances | None:
        """Return the effective compliances of the tied model with links; None if its fit is not certified.

        Their intervals come from the richest model with links alone, or from the tied model if the fit of the
        richest is not certified.
        """
        richest = next(each.model for each in reversed(selection.models) if each.model in LINKS_ALONE)
        try:
            links = self._fit_with_chosen_penalty(selection.find_held_out(tied), paths)
        except UnsupportedMethodError:
            return None
        try:
            return self._compute_effective(
                links, self._fit_with_chosen_penalty(selection.find_held_out(richest), paths)
            )
        except UnsupportedMethodError:
            return self._compute_effective(links, links)

    def _compute_effective(self, elastic: ElasticEstimate, widest: ElasticEstimate) -> EffectiveCompliances:
        """Return effective joint compliances of the fit `elastic`, with ranges from the fit `widest`."""
        return compute_effective_compliances(
            self._joints.robot,
            elastic,
            self._joints.stated.confidence,
            widest,
            with_ends=not self.penalty_is_given,
        )
