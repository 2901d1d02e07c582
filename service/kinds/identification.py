"""The work of a run: by joints alone with its draws, or beyond joints by cross-validation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from pydantic import ValidationError

from jointstiff.schemas.model import IdentifiedModel, LinksResult, ScoredModel
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.schemas.run import (
    ModelChoice,
    ResamplingResult,
    RunRequest,
    RunResult,
)
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.robots import joint_index
from jointstiff.service.kinds.own_weight import identified_by_weight
from jointstiff.service.kinds.work import Arrays, QuickWork, Span, Work, spans
from jointstiff.service.resources.inputs import Inputs
from jointstiff.solver.design.plan import advise
from jointstiff.solver.errors import JointstiffError, RequestError, SolverError, UnsupportedMethodError
from jointstiff.solver.estimation.assessment import assess
from jointstiff.solver.estimation.causes import LINKS_LEVEL, Screening, screen_estimate
from jointstiff.solver.estimation.estimate import Estimate, UncertaintyBudget, predict
from jointstiff.solver.estimation.fit import DEFAULT_THRESHOLD
from jointstiff.solver.estimation.identify import identify, refuse_unsupported
from jointstiff.solver.estimation.method import Prior, Settings
from jointstiff.solver.estimation.resampling import (
    GramBlocks,
    Resamples,
    gram_blocks,
    refuse_nonlinear,
    resample,
    summarise,
)
from jointstiff.solver.estimation.solution import Bounds, Order
from jointstiff.solver.links.choice import (
    WEIGHTS,
    Folds,
    HeldOut,
    PenaltyPath,
    Selection,
    compared_models,
    fit_fold,
    judge_losses,
    judge_penalty,
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
    with_links,
)
from jointstiff.solver.links.model import (
    LINKS_ALONE,
    LOSSES,
    ElasticColumns,
    ElasticModel,
    compared_losses,
)
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import message, messages_of
from jointstiff.solver.predict.answers import (
    run_result,
    stored_model,
)
from jointstiff.solver.predict.models import (
    ElasticPredictor,
    JointModel,
    ModelError,
    leave_folds_out,
    leave_postures_out,
)
from jointstiff.solver.text import length_text


def to_settings(options: RunOptions, robot: Robot) -> Settings:
    """Return how to identify, statements on stiffnesses turned into statements on compliances.

    Raises:
        RequestError: something about a joint that the robot does not have, or an order of the joints that
            contradicts itself or the bounds.
    """
    pairs = (pair for chain in options.stiffness_order for pair in pairwise(chain))
    order = tuple(
        dict.fromkeys(
            (
                joint_index(robot, first, f"stiffness_order.{first}"),
                joint_index(robot, second, f"stiffness_order.{second}"),
            )
            for first, second in pairs
        )
    )
    # With links the loss belongs to the elastic model.
    huber = options.loss == "huber" and options.elasticity in {"joints", "automatic"}
    prior = _prior(options, robot)
    settings = Settings(
        method=options.method,
        weighting=options.weighting,
        characteristic_length=options.characteristic_length,
        bounds=_bounds(options, robot, order),
        confidence=options.confidence,
        order=order,
        prior=prior,
        loss="huber" if huber else "squared",
        huber_threshold=options.huber_threshold or DEFAULT_THRESHOLD,
        complementary_stiffness=options.complementary_stiffness == "included",
    )
    _ = settings.constraints  # refuses contradictions before any work is done
    return settings


def identified(prepared: PreparedSet, settings: Settings) -> tuple[Settings, Estimate]:
    """Identify, and neglect K_c where the load has no balance with joints as soft as the readings say.

    Readings in a wrong unit do that; the verdict on them says so, and that K_c is neglected.

    Returns:
        The settings that were used, and the estimate.

    Raises:
        JointstiffError: as `jointstiff.solver.estimation.identify.identify`.
    """
    robot, measurements = prepared.robot, prepared.measurements
    try:
        return settings, identify(robot, measurements, settings)
    except SolverError as error:
        if error.where != "complementary_stiffness":
            raise
        neglected = replace(settings, complementary_stiffness=False)
        estimate = identify(robot, measurements, neglected)
        if estimate.complementary_stiffness is None:
            raise
        size = replace(estimate.complementary_stiffness, obstacle=error.reason)
        return neglected, replace(estimate, complementary_stiffness=size)


def _bounds(options: RunOptions, robot: Robot, order: Order) -> Bounds:
    """Return the bounds; joints with a bound, and those in an order, are positive in any case."""
    bounds = Bounds.positive(robot.n) if options.positive else Bounds.unconstrained(robot.n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for pair in order:
        lower[list(pair)] = 0.0
    for name, (least, greatest) in options.stiffness_bounds.items():
        j = joint_index(robot, name, f"stiffness_bounds.{name}")
        lower[j] = 0.0 if greatest is None else 1.0 / greatest
        upper[j] = np.inf if least is None else 1.0 / least
    return Bounds(lower, upper)


def _prior(options: RunOptions, robot: Robot) -> Prior | None:
    """Return the prior in compliance, to first order: c₀ = 1/k₀ and s₀ = u(k₀)/k₀²."""
    if not options.priors:
        return None
    mean, uncertainty = np.full(robot.n, np.nan), np.full(robot.n, np.inf)
    for name, known in options.priors.items():
        j = joint_index(robot, name, f"priors.{name}")
        mean[j] = 1.0 / known.stiffness
        uncertainty[j] = known.standard_uncertainty / known.stiffness**2
    return Prior(mean, uncertainty)


STEP_SECONDS: Final = 0.25
_SECONDS_A_REPETITION: Final = 8e-6
_SECONDS_A_READING: Final = 2.5e-8
"""Measured on the developers' machine; they decide the size of a step and nothing else."""


class ByJoints(Work):
    """The work of a run of joints alone: its draws, of which a quick run has none."""

    unit = "resamples"
    activity = "resampling"

    def __init__(self, prepared: PreparedSet, options: RunOptions, input_hash: str) -> None:
        """Check what is asked for.

        Args:
            prepared: the readings.
            options: how to identify.
            input_hash: of both.

        Raises:
            RequestError: the readings cannot support it, draws cannot be made, or there is no such link.
        """
        self.robot_id, self.input_hash = prepared.robot_id, input_hash
        self._prepared, self._options = prepared, options
        self._settings = to_settings(options, prepared.robot)
        self._drawn = resampling = options.resampling
        if resampling is not None:
            count = len(prepared.measurements)
            refuse_unsupported(prepared.robot, prepared.measurements, self._settings)
            refuse_nonlinear(self._settings)
            if resampling.size > count:
                raise RequestError(
                    f"a draw of {resampling.size} configurations exceeds the set's {count}",
                    where="resampling.size",
                    remedy=f"set `size` to at most {count}",
                )
        #: the option that keeps an automatic choice to joints alone, if one does
        self.excluded = None
        if options.elasticity == "automatic":
            self.excluded = _excluded(prepared, options, self._settings)

    @cached_property
    def identified(self) -> tuple[Settings, Estimate]:
        """Return the estimate of the joints, and how it was made.

        Raises:
            JointstiffError: as `jointstiff.solver.estimation.identify.identify` does.
        """
        return identified(self._prepared, self._settings)

    @cached_property
    def screening(self) -> Screening:
        """Return what joints alone leave unexplained; raises as `identified` does."""
        screening = screen_estimate(self._prepared.robot, self._prepared.measurements, self.identified[1])
        return replace(screening, comparable=self.excluded is None)

    @cached_property
    def _blocks(self) -> GramBlocks:
        settings, estimate = self.identified
        return gram_blocks(self._prepared.robot, self._prepared.measurements, settings, estimate)

    def steps(self) -> Sequence[Span]:
        """Return the draws, cut into steps of about `STEP_SECONDS`."""
        if self._drawn is None:
            return ()
        readings = int(self._prepared.measurements.present.sum())
        seconds = _SECONDS_A_REPETITION + _SECONDS_A_READING * readings
        return spans(self._drawn.repetitions, max(1, int(STEP_SECONDS / seconds)))

    def compute(self, span: Span) -> Arrays:
        """Fit some of the draws; their numbers do not depend on worker or division.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        if self._drawn is None:
            raise ValueError("this run has no steps")
        return vars(resample(self._blocks, self._drawn, self._settings.bounds, *span))

    def _statistics(self, parts: Sequence[Arrays], estimate: Estimate) -> ResamplingResult:
        """Return what the draws come to, of the joints that the whole set shows."""
        return summarise(
            Resamples.concatenate([Resamples(**part) for part in parts]),
            [joint.name for joint in estimate.joints],
            kinds=[joint.kind for joint in estimate.joints],
            hidden=np.array([joint.status == "not_observable" for joint in estimate.joints]),
            confidence=self._settings.confidence,
        )

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Identify from the whole set, with the statistics of the draws and the model that predicts.

        Raises:
            JointstiffError: as `identified` does.
        """
        return self.result(self.screening, parts)

    def result(
        self, screening: Screening, parts: Sequence[Arrays] = (), choice: ModelChoice | None = None
    ) -> RunResult:
        """Report joints alone, with what is known of links beside them; raises as `conclude` does."""
        prepared, options, (settings, estimate) = self._prepared, self._options, self.identified
        robot, measurements = prepared.robot, prepared.measurements
        choice = choice or to_choice_of_joints(options, screening, self.excluded)
        model, left_out = JointModel.of(robot, estimate, settings.constraints), None
        error: ModelError | JointstiffError
        try:
            error = leave_postures_out(robot, measurements, settings, estimate, model)
            left_out = error.left_out
        except JointstiffError as none:  # the run stands without it, and predictions say why
            error = none
        lacks = screening.lack_of_fit and prepared.is_sound(estimate)
        budget = UncertaintyBudget.of(estimate, settings.confidence, left_out, lack_of_fit=lacks)
        if budget is not None and lacks:
            estimate = budget.widened(estimate, settings.bounds)
        prediction = predict(
            robot,
            measurements,
            estimate.compliance,
            balanced=estimate.balanced,
            estimated=estimate.estimated,
        )
        assessment = assess(robot, measurements, settings, estimate, prediction, prepared.warnings, screening)
        # Behind a mistake, what another reading would bring is not known.
        usable = assessment.verdict != "do_not_use"
        return run_result(
            estimate,
            assessment.supported(prediction),
            assessment,
            measurements,
            [*prepared.warnings, *assessment.remarks],
            advise(robot, measurements, estimate) if usable else (),
            budget,
            resampling=self._statistics(parts, estimate) if parts else None,
            choice=choice,
            model=stored_model(model, error),
            causes=screening.tests,
        )


def identification(inputs: Inputs, request: RunRequest) -> Work:
    """Return the work of a run; an automatic choice compares models only where the screening speaks.

    Mistakes come first: a gross one in the readings, too, leaves patterns as links do.

    Raises:
        RequestError: there is no such set, or the readings cannot support what is asked for.
    """
    prepared = inputs.measured(request.measurement_set_id, "measurement_set_id", request.leave_out)
    if prepared.is_unloaded and prepared.robot.bodies:
        request = _by_own_weight(request)
    input_hash = prepared.run_hash(request)
    if request.weight is not None:
        compute = partial(identified_by_weight, prepared, request, request.weight)
        return QuickWork(compute, input_hash, prepared.robot_id, {"request": request})
    prepared = prepared.with_loads().beside(request.causes)
    if request.elasticity == "joints":
        return ByJoints(prepared, request, input_hash)
    if request.elasticity == "automatic":
        plain = ByJoints(prepared, request, input_hash)
        try:
            screening = plain.screening
            speaks = plain.excluded is None and (screening.links_speak or screening.base_speaks)
            speaks = speaks and prepared.is_sound(plain.identified[1])
        except JointstiffError:  # the run fails when it is carried out, and says why
            speaks = False
        if not speaks:
            return plain

    return ByLinks(prepared, request, input_hash)


def _by_own_weight(request: RunRequest) -> RunRequest:
    """Return a request by own weight, the only load there is; as it is, where its options forbid that."""
    options = request.model_dump(mode="json", exclude_unset=True)
    try:
        return RunRequest.model_validate_json(json.dumps({"weight": {}} | options))
    except ValidationError:
        return request


def _excluded(prepared: PreparedSet, options: RunOptions, settings: Settings) -> str | None:
    """Return the option that does not go with more than joints; None where all do.

    Raises:
        RequestError: a link is named that the robot does not have.
    """
    if options.resampling is not None:
        return "resampling"
    try:
        refuse_unsupported_elastic(prepared.measurements, settings)
        to_elastic_columns(options, prepared.robot)
    except UnsupportedMethodError as error:
        return error.where or "elasticity"
    joints = prepared.measurements.joints
    return "observations" if (joints == joints[0]).all() else None  # one posture cannot be left out


Paths: TypeAlias = dict[tuple[ModelName, Loss], PenaltyPath]

_WEIGHTS_A_STEP: Final = 3
"""For all models and losses in one fold they take 0.5 s for 30 targets, and 5 s for 300."""


_OUTLYING: Final = frozenset({"residual_outlier", "deflection_unexplained"})
"""Reasons that remain where links do not explain what joints alone did not."""


class ByLinks(Work):
    """The work of a run beyond joints: each unit is a weight of the penalty in a fold, for all models.

    A penalty that is given leaves one weight, which is quick: such work takes no steps.
    """

    unit = "penalties"
    activity = "cross-validating"

    def __init__(self, prepared: PreparedSet, options: RunOptions, input_hash: str) -> None:
        """Check what is asked for.

        Raises:
            RequestError: the readings cannot support it, or something about a joint that is not there.
        """
        self.robot_id, self.input_hash = prepared.robot_id, input_hash
        self._prepared, self._options = prepared, options
        self._settings = to_settings(options, prepared.robot)
        refuse_unsupported_elastic(prepared.measurements, self._settings)
        if options.resampling is not None:
            raise UnsupportedMethodError(
                "resampling supports only elasticity joints",
                where="resampling",
                remedy="omit `resampling`; the cross-validation shows the dispersion",
            )
        self._columns = to_elastic_columns(options, prepared.robot)
        given = options.link_penalty
        once = {} if given is None else {"draws": 1}
        self._validation = options.cross_validation.model_copy(update=once)
        self._weights = WEIGHTS if given is None else (given,)
        losses: tuple[Loss, ...] = (
            LOSSES if given is None else ("squared",)
        )  # which give a penalty its meaning
        if options.loss != "automatic":
            losses = (options.loss,)
        self._losses = compared_losses(prepared.measurements, losses)
        self._fold_count = len(shared_out(self._validation, prepared.measurements.joints))

    def steps(self) -> tuple[Span, ...]:
        """Return the weights of one fold after the other; none where the penalty is given."""
        if self._options.link_penalty is not None:
            return ()
        count = len(self._weights)
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
        fold, start = divmod(span[0], len(self._weights))
        weights = self._weights[start : start + span[1] - span[0]]
        fits = [fit_fold(self._folds, model, fold, weights) for model in self._models]
        compliances, errors = map(np.array, zip(*fits, strict=True))
        return {"fold_compliances": compliances, "error": errors}

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Choose the penalty, fit the whole set, and report.

        Raises:
            JointstiffError: as the identification of the whole set does, or an optimum is not certified.
        """
        if not self.steps():
            count = len(self._weights)
            parts = [self.compute((k * count, (k + 1) * count)) for k in range(self._fold_count)]
        shape = len(self._models), self._fold_count, len(self._weights)
        compliances, errors = (
            np.concatenate([part[name] for part in parts], axis=1) for name in ("fold_compliances", "error")
        )
        paths = {
            model.key: PenaltyPath(self._weights, *of_model)
            for model, *of_model in zip(
                self._models, compliances.reshape(*shape, -1), errors.reshape(shape), strict=True
            )
        }
        options = self._options
        elasticity = None if options.elasticity == "automatic" else options.elasticity
        screened = elasticity is None  # `identification` compares models only where the screening speaks
        selection = select_model(self._folds, paths, elasticity, screened=screened)
        if screened and options.link_penalty is None:
            # Beside each other at an end of the weights, the richer model is judged by too large a penalty.
            for name in dict.fromkeys(each.model for each in selection.models):
                ended = selection.of(name)
                if ended.penalty == self._weights[0]:
                    selection = self._refined(ended, selection, paths)
            selection = Selection.among(selection.models, screened=screened)
        chosen = selection.of(elasticity or selection.simplest)
        if chosen.model == "joints":
            chosen = selection.of("joints", ("squared", "huber"))
        if chosen.model != "joints" and options.link_penalty is None:
            selection = self._refined(chosen, selection, paths)
            chosen = selection.of(chosen.model, (chosen.loss,))

        screening = replace(self._joints_alone("squared").screening, gain=selection.gain)
        choose = partial(to_choice_by_comparison, selection, chosen, screening, given=elasticity is not None)
        if chosen.model == "joints":
            result = self._joints_alone(chosen.loss).result(screening, choice=choose())
        else:
            elastic = self._fit(chosen, paths)
            elastic, effective, of_model = self._ranges(elastic, selection, paths)
            choice = choose(
                intervals=None if options.link_penalty is not None else of_model,
                joined=elastic.prediction.joined,
            )
            result = self._result(chosen, elastic, effective, screening, choice)
        return result

    def _joints_alone(self, loss: Loss) -> ByJoints:
        alone: dict[str, object] = {
            "elasticity": "joints",
            "loss": loss,
            "links": [],
            "link_penalty": None,
        }
        return ByJoints(self._prepared, self._options.model_copy(update=alone), self.input_hash)

    @cached_property
    def _models(self) -> list[ElasticModel]:
        options = self._options
        threshold = options.huber_threshold or DEFAULT_THRESHOLD
        asked = None if options.elasticity == "automatic" else options.elasticity
        names = compared_models(self._joints_alone("squared").screening, asked)
        return [ElasticModel(name, self._columns, loss, threshold) for name in names for loss in self._losses]

    @cached_property
    def _joints(self) -> Estimate:
        """Return the estimate of the joint model."""
        return identified(self._prepared, self._settings)[1]

    @cached_property
    def _folds(self) -> Folds:
        prepared = self._prepared
        visible = ~self._joints.observability.null
        return Folds(prepared.robot, prepared.measurements, self._columns, visible, self._validation)

    def _model_of(self, chosen: HeldOut) -> ElasticModel:
        return next(model for model in self._models if model.key == (chosen.model, chosen.loss))

    def _refined(self, chosen: HeldOut, selection: Selection, paths: Paths) -> Selection:
        """Try further penalties of a model, and replace its path, and its place in the selection."""
        model = self._model_of(chosen)
        paths[model.key] = refined(self._folds, model, paths[model.key])
        of_model = select_model(self._folds, {model.key: paths[model.key]}, chosen.model)
        return selection.with_refined(of_model.models[0])

    def _fit(self, chosen: HeldOut, paths: Paths) -> ElasticEstimate:
        """Fit a model to the whole set with the penalty that cross-validation chose.

        Raises:
            UnsupportedMethodError: neither that nor a larger penalty has a certified optimum.
        """
        grid = paths[chosen.model, chosen.loss].weights
        place = grid.index(chosen.penalty or grid[0])
        return first_certified(self._folds, self._model_of(chosen), grid[place:])

    def _widest(self, selection: Selection, elastic: ElasticEstimate, paths: Paths) -> ElasticEstimate:
        """Return the fit whose intervals hold after the choice; the chosen one where it is not certified."""
        if selection.largest == elastic.model.name:
            return elastic
        try:
            return self._fit(selection.of(selection.largest), paths)
        except UnsupportedMethodError:
            return elastic

    def _ranges(
        self, elastic: ElasticEstimate, selection: Selection, paths: Paths
    ) -> tuple[ElasticEstimate, EffectiveCompliances, ModelName]:
        """Return the estimate with its effective compliances, and the model whose intervals they have.

        Where held-out postures do not distinguish links from the base, intervals contain those of both, if
        one with links has a certified optimum.
        """
        if self._options.elasticity != "automatic":
            return elastic, self._effective(elastic, elastic), elastic.model.name
        widest = self._widest(selection, elastic, paths)
        effective = self._effective(elastic, widest)
        if selection.tied is not None:
            if (of_links := self._effective_of_links(selection.tied, selection, paths)) is not None:
                effective = effective.joined(of_links)
            prediction = replace(elastic.prediction, bending="links_or_base", joined=of_links is not None)
            elastic = replace(elastic, prediction=prediction)
        return elastic, effective, widest.model.name

    def _effective_of_links(
        self, tied: ModelName, selection: Selection, paths: Paths
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
            self._prepared.robot,
            elastic,
            self._settings.confidence,
            widest,
            with_ends=self._options.link_penalty is None,
        )

    def _result(
        self,
        chosen: HeldOut,
        elastic: ElasticEstimate,
        effective: EffectiveCompliances,
        screening: Screening,
        choice: ModelChoice,
    ) -> RunResult:
        prepared, options, settings = self._prepared, self._options, self._settings
        robot, measurements = prepared.robot, prepared.measurements
        estimate = with_links(self._joints, elastic, effective)
        # No advice: what a further reading would bring is known for a model of joints alone.
        assessment = assess(
            robot, measurements, settings, estimate, elastic.prediction, prepared.warnings, screening
        )
        outlying = any(reason.code in _OUTLYING for reason in assessment.reasons)
        warnings = [each for each in prepared.warnings if outlying or each.code != "residual_outlier"]
        warnings += assessment.remarks
        if options.link_penalty is None:
            warnings += judge_penalty(chosen.penalty or elastic.penalty, elastic.penalty)
            if options.loss == "automatic":
                warnings += judge_losses(int(measurements.present.sum()))
        return run_result(
            estimate,
            elastic.prediction,
            assessment,
            prepared.measurements,
            warnings,
            links=message(
                LinksResult,
                elastic,
                loss_source="cross_validation" if len(self._losses) > 1 else "given",
                penalty_source="cross_validation" if options.link_penalty is None else "given",
            ),
            model=self._model(elastic),
            choice=choice,
            causes=screening.tests,
        )

    def _model(self, elastic: ElasticEstimate) -> IdentifiedModel:
        robot, measurements = self._prepared.robot, self._prepared.measurements
        predictor = ElasticPredictor.of(robot, elastic)
        error: ModelError | JointstiffError
        try:
            error = leave_folds_out(robot, measurements, elastic)
        except JointstiffError as none:  # the run stands without it, and predictions say why
            error = none
        return stored_model(predictor, error)


def to_elastic_columns(options: RunOptions, robot: Robot) -> ElasticColumns:
    """Return the links that may bend.

    Raises:
        RequestError: the robot has no such joint.
        UnsupportedMethodError: the robot has too many joints.
    """
    named = sorted({joint_index(robot, name, "links") for name in options.links})
    return ElasticColumns(robot.n, tuple(named or range(robot.n)))


def to_choice_of_joints(options: RunOptions, screening: Screening, excluded: str | None) -> ModelChoice:
    """Return the choice of joints alone, with its reason."""
    loss: Loss = "huber" if options.loss == "huber" else "squared"
    p = f"F test of links beside joints: p = {screening.links_p_value:.1g}"
    if options.elasticity != "automatic":
        source, text = "given", f"Joints alone, as requested ({p})."
    elif excluded is not None:
        source, text = "options", f"Joints alone: elastic links exclude {excluded.replace('_', ' ')} ({p})."
    elif screening.links_p_value < LINKS_LEVEL:
        source, text = "screening", f"Joints alone: correct the mistake named in the reasons first ({p})."
    else:
        source, text = "screening", f"Joints alone: no sign that anything else bends ({p})."
    return ModelChoice(
        elasticity="joints",
        loss=loss,
        source=source,
        links_p_value=screening.links_p_value,
        message=text,
    )


def to_choice_by_comparison(
    selection: Selection,
    chosen: HeldOut,
    screening: Screening,
    *,
    given: bool,
    intervals: ModelName | None = None,
    joined: bool = True,
) -> ModelChoice:
    """Return the choice among models that were compared on held-out postures.

    Args:
        selection: of models and losses.
        chosen: which predicts.
        screening: of what joints alone leave unexplained.
        given: whether the model was named in the request.
        intervals: model whose intervals the stiffnesses have; None where that is not said.
        joined: whether they contain those of a tied model, too.
    """
    name, gain = chosen.model.replace("_", " ").capitalize(), selection.gain
    evidence = f"F test of links beside joints: p = {screening.links_p_value:.1g}"
    if gain is not None:
        evidence += (
            f"; held-out postures are predicted to {length_text(chosen.mean_residual)}, by joints "
            f"alone to {length_text(gain.error_of_joints)}"
        )
    remarks = "" if chosen.model == "joints" else " K_c is neglected."
    tied = selection.tied is not None and not given
    if intervals == chosen.model and not tied:
        remarks += " Intervals of stiffness are of this model."
    elif tied:
        remarks += " Held-out postures do not distinguish links from base: intervals "
        remarks += (
            "contain both models' values."
            if joined or intervals is None
            else f"are of {intervals.replace('_', ' ')} alone, as no optimum of links alone was certified."
        )
    elif intervals is not None:
        richer = intervals.replace("_", " ")
        remarks += f" Intervals of stiffness are of {richer}, the richest model compared."
    return ModelChoice(
        elasticity=chosen.model,
        loss=chosen.loss,
        source="given" if given else "cross_validation",
        links_p_value=screening.links_p_value,
        message=f"{name}, loss {chosen.loss} ({evidence}).{remarks}",
        models=messages_of(ScoredModel, selection.models),
        losses={scored.model: selection.of(scored.model).loss for scored in selection.models},
        best=selection.best,
        simplest=selection.simplest,
    )
