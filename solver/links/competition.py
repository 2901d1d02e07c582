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
    compared_models,
    fit_fold,
    refined,
    select_model,
    shared_out,
)
from jointstiff.solver.links.fit import (
    EffectiveCompliances,
    ElasticEstimate,
    effective_compliances,
    first_certified,
    refuse_unsupported_elastic,
)
from jointstiff.solver.links.model import (
    LINKS_ALONE,
    LOSSES,
    ElasticColumns,
    ElasticModel,
    compared_losses,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot

_Paths: TypeAlias = dict[tuple[ModelName, Loss], PenaltyPath]

_WEIGHTS_A_STEP: Final = 3
"""For all models and losses in one fold they take 0.5 s for 30 targets, and 5 s for 300."""


def excluded_option(
    options: RunOptions, settings: Settings, robot: Robot, measurements: Measurements
) -> str | None:
    """Return the option that does not go with more than joints; None where all do.

    Raises:
        RequestError: a link is named that the robot does not have.
    """
    if options.resampling is not None:
        return "resampling"
    try:
        refuse_unsupported_elastic(measurements, settings)
        ElasticColumns.of(options, robot)
    except UnsupportedMethodError as error:
        return error.where or "elasticity"
    joints = measurements.joints
    return "observations" if (joints == joints[0]).all() else None  # one posture cannot be left out


@dataclass(frozen=True, eq=False)
class Elastic:
    """A model with more than joints, fitted to the whole set."""

    estimate: ElasticEstimate
    effective: EffectiveCompliances  #: about the joints' axes, with the intervals that hold after the choice
    intervals: ModelName | None  #: model whose intervals these are; None of a penalty that was given


@dataclass(frozen=True, eq=False)
class Winner:
    """The model that predicts held-out postures best, or the simplest that does so nearly as well."""

    selection: Selection  #: all models and losses that were compared
    held_out: HeldOut  #: prediction of the winner
    elastic: Elastic | None  #: the winner on the whole set; None of joints alone
    given: bool  #: whether the model was named rather than chosen


class Competition:
    """Models that are compared on held-out postures, in steps of a fraction of a second."""

    unit = "penalties"
    activity = "cross-validating"

    def __init__(self, joints: JointsAlone, options: RunOptions) -> None:
        """Check the request.

        Args:
            joints: identified alone, with which the models are compared.
            options: model, losses, penalty and cross-validation.

        Raises:
            RequestError: the readings cannot support it, or something about a joint that is not there.
        """
        measurements, given = joints.measurements, options.link_penalty
        refuse_unsupported_elastic(measurements, joints.stated)
        if options.resampling is not None:
            raise UnsupportedMethodError(
                "resampling supports only elasticity joints",
                where="resampling",
                remedy="omit `resampling`; the cross-validation shows the dispersion",
            )
        self._joints, self._options = joints, options
        self._columns = ElasticColumns.of(options, joints.robot)
        self._requested = None if options.elasticity == "automatic" else options.elasticity
        once = {} if given is None else {"draws": 1}
        self._validation = options.cross_validation.model_copy(update=once)
        self._weights = WEIGHTS if given is None else (given,)
        losses: tuple[Loss, ...] = (
            LOSSES if given is None else ("squared",)
        )  # which give a penalty its meaning
        if options.loss != "automatic":
            losses = (options.loss,)
        self._losses = compared_losses(measurements, losses)
        self._fold_count = len(shared_out(self._validation, measurements.joints))

    @property
    def loss_is_compared(self) -> bool:
        """Tell whether held-out postures choose the loss."""
        return len(self._losses) > 1

    @property
    def loss_is_automatic(self) -> bool:
        """Return whether no loss was requested."""
        return self._options.loss == "automatic"

    @property
    def penalty_is_given(self) -> bool:
        """Tell whether the penalty was stated, so that held-out postures do not choose it."""
        return self._options.link_penalty is not None

    @property
    def screening(self) -> Screening:
        """Tests of what joints alone leave unexplained by the squared loss."""
        return self._joints.with_loss("squared").screening

    def steps(self) -> tuple[tuple[int, int], ...]:
        """Return the weights of one fold after the other; none where the penalty is given."""
        if self.penalty_is_given:
            return ()
        count = len(self._weights)
        return tuple(
            (fold * count + start, fold * count + min(start + _WEIGHTS_A_STEP, count))
            for fold in range(self._fold_count)
            for start in range(0, count, _WEIGHTS_A_STEP)
        )

    def compute(self, span: tuple[int, int]) -> dict[str, FloatArray]:
        """Fit all models for some of the weights of a fold.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        fold, start = divmod(span[0], len(self._weights))
        weights = self._weights[start : start + span[1] - span[0]]
        fits = [fit_fold(self._folds, model, fold, weights) for model in self._models]
        compliances, errors = map(np.array, zip(*fits, strict=True))
        return {"fold_compliances": compliances, "error": errors}

    def winner(self, parts: Sequence[Mapping[str, FloatArray]]) -> Winner:
        """Choose model, loss and penalty, and fit the whole set.

        Args:
            parts: what all steps computed, in order.

        Raises:
            JointstiffError: as the identification of the whole set does, or an optimum is not certified.
        """
        paths = self._paths(parts)
        selection, held_out = self._choose(paths)
        elastic = None if held_out.model == "joints" else self._whole_set(held_out, selection, paths)
        return Winner(selection, held_out, elastic, self._requested is not None)

    def _paths(self, parts: Sequence[Mapping[str, FloatArray]]) -> _Paths:
        """Return the fits without each fold, of all models."""
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
        """Choose a model with its loss and penalty; paths are refined about the best penalties."""
        given, automatic = self.penalty_is_given, self._requested is None
        selection = select_model(self._folds, paths, self._requested, screened=automatic)
        if automatic and not given:
            # Where both models are at an end of the weights, the richer one is judged by too large a penalty.
            for name in dict.fromkeys(each.model for each in selection.models):
                ended = selection.of(name)
                if ended.penalty == self._weights[0]:
                    selection = self._refine(ended, selection, paths)
            selection = Selection.among(selection.models, screened=automatic)
        chosen = selection.of(self._requested or selection.simplest)
        if chosen.model == "joints":
            chosen = selection.of("joints", ("squared", "huber"))
        elif not given:
            selection = self._refine(chosen, selection, paths)
            chosen = selection.of(chosen.model, (chosen.loss,))
        return selection, chosen

    @cached_property
    def _models(self) -> list[ElasticModel]:
        threshold = self._options.huber_threshold or DEFAULT_THRESHOLD
        names = compared_models(self.screening, self._requested)
        return [ElasticModel(name, self._columns, loss, threshold) for name in names for loss in self._losses]

    @cached_property
    def _folds(self) -> Folds:
        joints = self._joints
        visible = ~joints.estimate.observability.null
        return Folds(joints.robot, joints.measurements, self._columns, visible, self._validation)

    def _model_of(self, held_out: HeldOut) -> ElasticModel:
        return next(model for model in self._models if model.key == (held_out.model, held_out.loss))

    def _refine(self, held_out: HeldOut, selection: Selection, paths: _Paths) -> Selection:
        """Try further penalties of a model, and replace its path, and its place in the selection."""
        model = self._model_of(held_out)
        paths[model.key] = refined(self._folds, model, paths[model.key])
        of_model = select_model(self._folds, {model.key: paths[model.key]}, held_out.model)
        return selection.with_refined(of_model.models[0])

    def _fit(self, held_out: HeldOut, paths: _Paths) -> ElasticEstimate:
        """Fit a model to the whole set with the penalty that cross-validation chose.

        Raises:
            UnsupportedMethodError: neither that nor a larger penalty has a certified optimum.
        """
        grid = paths[held_out.model, held_out.loss].weights
        place = grid.index(held_out.penalty or grid[0])
        return first_certified(self._folds, self._model_of(held_out), grid[place:])

    def _whole_set(self, held_out: HeldOut, selection: Selection, paths: _Paths) -> Elastic:
        """Return a model on the whole set, with the intervals that hold after the choice.

        Where held-out postures do not distinguish links from the base, intervals contain those of both, if
        one with links has a certified optimum.
        """
        elastic = self._fit(held_out, paths)
        if self._requested is not None:
            named = None if self.penalty_is_given else elastic.model.name
            return Elastic(elastic, self._effective(elastic, elastic), named)
        widest = self._widest_fit(elastic, selection, paths)
        effective = self._effective(elastic, widest)
        if selection.tied is not None:
            of_links = self._effective_of_links(selection.tied, selection, paths)
            if of_links is not None:
                effective = effective.joined(of_links)
            prediction = replace(elastic.prediction, bending="links_or_base", joined=of_links is not None)
            elastic = replace(elastic, prediction=prediction)
        return Elastic(elastic, effective, widest.model.name)

    def _widest_fit(self, elastic: ElasticEstimate, selection: Selection, paths: _Paths) -> ElasticEstimate:
        """Return the fit whose intervals hold after the choice; the chosen one where it is not certified."""
        if selection.largest == elastic.model.name:
            return elastic
        try:
            return self._fit(selection.of(selection.largest), paths)
        except UnsupportedMethodError:
            return elastic

    def _effective_of_links(
        self, tied: ModelName, selection: Selection, paths: _Paths
    ) -> EffectiveCompliances | None:
        """Return those of the model with links alone that is tied; None where it has no certified optimum.

        Their intervals are of the richest model with links alone, or of the tied one where the richest has no
        certified optimum.
        """
        richest = next(each.model for each in reversed(selection.models) if each.model in LINKS_ALONE)
        try:
            links = self._fit(selection.of(tied), paths)
        except UnsupportedMethodError:
            return None
        try:
            return self._effective(links, self._fit(selection.of(richest), paths))
        except UnsupportedMethodError:
            return self._effective(links, links)

    def _effective(self, elastic: ElasticEstimate, widest: ElasticEstimate) -> EffectiveCompliances:
        return effective_compliances(
            self._joints.robot,
            elastic,
            self._joints.stated.confidence,
            widest,
            with_ends=not self.penalty_is_given,
        )
