"""Elastic links as work: cross-validation cut into steps of a few seconds, and what it comes to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final, Protocol

import numpy as np

from jointstiff.schemas.model import IdentifiedModel
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import RunResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.kinds.deflection.models import to_elastic_model
from jointstiff.service.kinds.run.links import (
    to_choice_by_comparison,
    to_elastic_columns,
    to_links_result,
    to_losses,
    to_plan,
    to_selection,
)
from jointstiff.service.kinds.run.results import to_result
from jointstiff.service.kinds.run.settings import identified, to_settings
from jointstiff.service.kinds.work import Arrays, Span, Work
from jointstiff.solver.errors import JointstiffError, UnsupportedMethodError
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.fitting.robust import DEFAULT_THRESHOLD
from jointstiff.solver.links.choice import (
    FoldFit,
    Folds,
    HeldOut,
    fit_fold,
    judge_losses,
    judge_penalty,
    refined,
    select_model,
)
from jointstiff.solver.links.fit import (
    ElasticEstimate,
    effective_compliances,
    first_certified,
    refuse_unsupported_elastic,
    with_links,
)
from jointstiff.solver.links.model import MODELS, ElasticModel, Loss, compared_losses
from jointstiff.solver.predict.model_error import ModelError, leave_folds_out
from jointstiff.solver.predict.models import ElasticPredictor

_WEIGHTS_A_STEP: Final = 3
"""For all models and losses in one fold they take 0.5 s for 30 targets, and 5 s for 300."""


class JointRun(Protocol):
    """Identification of the prepared set by joints alone."""

    @property
    def screening(self) -> Screening:
        """Return what joints alone leave unexplained."""

    def conclude_with(self, screening: Screening) -> RunResult:
        """Report joints alone, with what is known of links beside them."""


_OUTLYING: Final = frozenset({"suspicious_readings", "deflection_unexplained"})
"""Reasons that remain where links do not explain what joints alone did not."""


class ElasticWork(Work):
    """The work of a run beyond joints: each unit is a weight of the penalty in a fold, for all models.

    A penalty that is given leaves one weight, which is quick: such work takes no steps.
    """

    unit = "penalties"
    activity = "cross-validating"

    def __init__(
        self,
        prepared: PreparedSet,
        options: RunOptions,
        input_hash: str,
        by_joints: Callable[[RunOptions], JointRun],
    ) -> None:
        """Check what is asked for.

        Raises:
            RequestError: the readings cannot support it, or something about a joint that is not there.
        """
        self.robot_id, self.input_hash = prepared.robot_id, input_hash
        self._prepared, self._options, self._by_joints = prepared, options, by_joints
        self._settings = to_settings(options, prepared.robot)
        refuse_unsupported_elastic(prepared.measurements, self._settings)
        if options.resampling is not None:
            raise UnsupportedMethodError(
                "resampling supports only elasticity joints",
                where="resampling",
                remedy="omit `resampling`; the cross-validation shows the dispersion",
            )
        self._columns = to_elastic_columns(options, prepared.robot)
        self._plan = to_plan(options)
        self._losses = compared_losses(prepared.measurements, to_losses(options))
        self._fold_count = len(self._plan.assigned(prepared.measurements.joints))

    def steps(self) -> tuple[Span, ...]:
        """Return the weights of one fold after the other; none where the penalty is given."""
        if self._options.link_penalty is not None:
            return ()
        count = len(self._plan.weights)
        return tuple(
            (fold * count + start, fold * count + min(start + _WEIGHTS_A_STEP, count))
            for fold in range(self._fold_count)
            for start in range(0, count, _WEIGHTS_A_STEP)
        )

    def compute(self, span: Span) -> Arrays:
        """Fit all models for some of the weights of a fold.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        fold, start = divmod(span[0], len(self._plan.weights))
        weights = self._plan.weights[start : start + span[1] - span[0]]
        fits = [fit_fold(self._folds, model, fold, weights) for model in self._models]
        return {
            "fold_compliances": np.array([fit.compliances for fit in fits]),
            "error": np.array([fit.error for fit in fits]),
        }

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Choose the penalty, fit the whole set, and report.

        Raises:
            JointstiffError: as the identification of the whole set does, or an optimum is not certified.
        """
        robot, measurements = self._prepared.robot, self._prepared.measurements
        spans = self.steps()
        if not spans:
            count = len(self._plan.weights)
            spans = tuple((fold * count, (fold + 1) * count) for fold in range(self._fold_count))
            parts = [self.compute(span) for span in spans]
        fits = {
            model.key: self._by_fold(
                spans, [FoldFit(part["fold_compliances"][number], part["error"][number]) for part in parts]
            )
            for number, model in enumerate(self._models)
        }
        options = self._options
        elasticity = None if options.elasticity == "automatic" else options.elasticity
        screened = elasticity is None  # `work` compares models only where the screening speaks
        selection = select_model(
            robot, measurements, self._folds, fits, self._plan, elasticity, screened=screened
        )
        chosen = selection.of(elasticity or selection.simplest)
        if chosen.model == "joints":
            chosen = selection.of("joints", ("squared", "huber"))
        plan, model = self._plan, self._model_of(chosen)
        if chosen.model != "joints" and options.link_penalty is None:
            plan, fits[model.key] = refined(self._folds, model, fits[model.key], plan)
            of_model = {model.key: fits[model.key]}
            chosen = select_model(robot, measurements, self._folds, of_model, plan, chosen.model).models[0]
            selection = selection.with_refined(chosen)

        def joints_alone(loss: Loss) -> JointRun:
            alone: dict[str, object] = {
                "elasticity": "joints",
                "loss": loss,
                "links": [],
                "link_penalty": None,
            }
            return self._by_joints(options.model_copy(update=alone))

        plain = joints_alone("squared")
        screening = replace(plain.screening, gain=selection.gain)
        same = (chosen.model, chosen.loss) == ("joints", "squared")
        choice = to_choice_by_comparison(
            selection,
            chosen,
            screening,
            given=elasticity is not None,
            plain=None if same else plain.conclude_with(screening),
        )
        if chosen.model == "joints":
            result = joints_alone(chosen.loss).conclude_with(screening)
        else:
            result = self._result(chosen, plan.weights, screening)
        return result.model_copy(update={"selection": to_selection(selection, chosen), "choice": choice})

    @property
    def _models(self) -> list[ElasticModel]:
        threshold = self._options.huber_threshold or DEFAULT_THRESHOLD
        return [
            ElasticModel(name, self._columns, loss, threshold) for name in MODELS for loss in self._losses
        ]

    @cached_property
    def _joints(self) -> Estimate:
        """Return the estimate of the joint model."""
        return identified(self._prepared, self._settings)[1]

    @cached_property
    def _folds(self) -> Folds:
        prepared = self._prepared
        visible = ~self._joints.observability.null
        return Folds(prepared.robot, prepared.measurements, self._columns, visible, self._plan)

    def _by_fold(self, spans: Sequence[Span], fits: Sequence[FoldFit]) -> list[FoldFit]:
        """The steps of one model, put together fold by fold."""
        count = len(self._plan.weights)
        of_fold: list[list[FoldFit]] = [[] for _ in range(self._fold_count)]
        for (start, _), fit in zip(spans, fits, strict=True):
            of_fold[start // count].append(fit)
        return [
            FoldFit(
                np.concatenate([fit.compliances for fit in steps]),
                np.concatenate([fit.error for fit in steps]),
            )
            for steps in of_fold
        ]

    def _model_of(self, chosen: HeldOut) -> ElasticModel:
        return next(model for model in self._models if model.key == (chosen.model, chosen.loss))

    def _result(self, chosen: HeldOut, grid: Sequence[float], screening: Screening) -> RunResult:
        prepared, options, model = self._prepared, self._options, self._model_of(chosen)
        robot, weight = prepared.robot, chosen.penalty or grid[0]
        elastic = first_certified(
            robot, prepared.measurements, self._folds, model, grid[grid.index(weight) :]
        )
        effective = effective_compliances(
            robot, elastic, self._settings.confidence, with_ends=options.link_penalty is None
        )
        estimate = with_links(self._joints, elastic, effective)
        # No advice: what a further reading would bring is known for a model of joints alone.
        assessment = prepared.assess(self._settings, estimate, elastic.prediction, screening)
        outlying = any(reason.code in _OUTLYING for reason in assessment.reasons)
        warnings = [each for each in prepared.warnings if outlying or each.code != "residual_outlier"]
        warnings += assessment.remarks
        if options.link_penalty is None:
            warnings += judge_penalty(weight, elastic.penalty)
            if options.loss == "automatic":
                warnings += judge_losses(int(prepared.measurements.present.sum()))
        result = to_result(robot, estimate, elastic.prediction, assessment, prepared.measurements, warnings)
        links = to_links_result(elastic, robot.joint_names, options, self._losses)
        return result.model_copy(update={"links": links, "model": self._model(elastic)})

    def _model(self, elastic: ElasticEstimate) -> IdentifiedModel:
        robot, measurements = self._prepared.robot, self._prepared.measurements
        predictor = ElasticPredictor.of(robot, elastic)
        error: ModelError | JointstiffError
        try:
            error = leave_folds_out(robot, measurements, elastic)
        except JointstiffError as none:  # the run stands without it, and predictions say why
            error = none
        return to_elastic_model(predictor, error)
