"""A run: one identification of a prepared measurement set, with its resampling or its elastic links."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial

from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import EncoderResidual, RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.deflection.models import to_identified_model
from jointstiff.service.kinds.run.elastic import ElasticWork
from jointstiff.service.kinds.run.links import to_choice_of_joints, to_elastic_columns
from jointstiff.service.kinds.run.resampling import ResamplingWork
from jointstiff.service.kinds.run.results import to_encoder_residuals, to_resampling_result, to_result
from jointstiff.service.kinds.run.settings import identified, to_settings
from jointstiff.service.kinds.work import Arrays, QuickWork, Span, Work
from jointstiff.solver.design.advice import advise
from jointstiff.solver.errors import JointstiffError, UnsupportedMethodError
from jointstiff.solver.estimate import refuse_unsupported
from jointstiff.solver.evidence.budget import LeftOut, UncertaintyBudget
from jointstiff.solver.evidence.causes import Screening, screen_estimate
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.prediction import predict, predict_encoders
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.links.fit import refuse_unsupported_elastic
from jointstiff.solver.predict.model_error import ModelError, leave_postures_out
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.resampling import Resamples, summarise


class RunWork(Work):
    """The work of a run of joints alone: its draws, of which a quick run has none."""

    unit = "resamples"
    activity = "resampling"

    def __init__(
        self, prepared: PreparedSet, options: RunOptions, input_hash: str, excluded: str | None = None
    ) -> None:
        """Check what is asked for.

        Args:
            prepared: the readings.
            options: how to identify.
            input_hash: of both.
            excluded: the option that keeps an automatic choice to joints alone, if one does.

        Raises:
            RequestError: the readings cannot support it, or draws that cannot be made.
        """
        self.robot_id, self.input_hash = prepared.robot_id, input_hash
        self._prepared, self._options, self._excluded = prepared, options, excluded
        self._settings = to_settings(options, prepared.robot)
        self._draws: ResamplingWork | None = None
        if options.resampling is not None:
            refuse_unsupported(prepared.robot, prepared.measurements, self._settings)
            self._draws = ResamplingWork(prepared, options, options.resampling)

    @cached_property
    def identified(self) -> tuple[Settings, Estimate]:
        """Return the estimate of the joints, and how it was made.

        Raises:
            JointstiffError: as `run_identification` does.
        """
        return identified(self._prepared, self._settings)

    @cached_property
    def screening(self) -> Screening:
        """Return what joints alone leave unexplained; raises as `identified` does."""
        screening = screen_estimate(self._prepared.robot, self._prepared.measurements, self.identified[1])
        return replace(screening, comparable=self._excluded is None)

    def steps(self) -> Sequence[Span]:
        """Return the draws, cut into steps."""
        return () if self._draws is None else self._draws.steps()

    def compute(self, span: Span) -> Arrays:
        """Fit some of the draws.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        if self._draws is None:
            raise ValueError("this run has no steps")
        return vars(self._draws.compute(span))

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Identify from the whole set, with the statistics of the draws and the model that predicts.

        Raises:
            JointstiffError: as `run_identification` does.
        """
        return self.conclude_with(self.screening, [Resamples(**part) for part in parts])

    def conclude_with(self, screening: Screening, parts: Sequence[Resamples] = ()) -> RunResult:
        """Report joints alone, with what is known of links beside them; raises as `conclude` does."""
        prepared, options, (settings, estimate) = self._prepared, self._options, self.identified
        model = JointModel.of(prepared.robot, estimate, settings.constraints)
        error: ModelError | JointstiffError
        try:
            error = leave_postures_out(prepared.robot, prepared.measurements, settings, estimate, model)
        except JointstiffError as none:  # the run stands without it, and predictions say why
            error = none
        left_out = error.left_out if isinstance(error, ModelError) else None
        result = _reported(prepared, options, settings, estimate, parts, left_out, screening)
        choice = to_choice_of_joints(options, screening, self._excluded)
        return result.model_copy(update={"model": to_identified_model(model, error), "choice": choice})


def work(inputs: Inputs, request: RunRequest) -> RunWork | ElasticWork | QuickWork:
    """Return the work of a run; an automatic choice compares models only where the screening speaks.

    Mistakes come first: a gross one in the readings, too, leaves patterns as links do.

    Raises:
        RequestError: there is no such set, or the readings cannot support what is asked for.
    """
    prepared = inputs.measured(request.measurement_set_id, "measurement_set_id", request.leave_out)
    input_hash = run_hash(prepared, request)
    if request.weight is not None:
        from jointstiff.service.kinds.run.weight import identified_by_weight  # needs the room of geometry

        compute = partial(identified_by_weight, prepared, request, request.weight)
        return QuickWork(compute, input_hash, prepared.robot_id)
    prepared = prepared.with_loads()
    if request.elasticity == "joints":
        return RunWork(prepared, request, input_hash)
    excluded = _excluded(prepared, request) if request.elasticity == "automatic" else None
    plain = RunWork(prepared, request, input_hash, excluded)
    if request.elasticity == "automatic":
        try:
            speaks = excluded is None and plain.screening.links_speak
            speaks = speaks and prepared.is_sound(plain.identified[1])
        except JointstiffError:  # the run fails when it is carried out, and says why
            speaks = False
        if not speaks:
            return plain

    def by_joints(options: RunOptions) -> RunWork:
        return RunWork(prepared, options, input_hash)

    return ElasticWork(prepared, request, input_hash, by_joints)


def _excluded(prepared: PreparedSet, options: RunOptions) -> str | None:
    """Return the option that does not go with more than joints; None where all do.

    Raises:
        RequestError: a link is named that the robot does not have.
    """
    if options.resampling is not None:
        return "resampling"
    try:
        refuse_unsupported_elastic(prepared.measurements, to_settings(options, prepared.robot))
        to_elastic_columns(options, prepared.robot)
    except UnsupportedMethodError as error:
        return error.where or "elasticity"
    joints = prepared.measurements.joints
    return "observations" if (joints == joints[0]).all() else None  # one posture cannot be left out


def run_hash(prepared: PreparedSet, request: RunRequest) -> str:
    """Return the SHA-256 of robot, readings and options, by which a run knows its campaign."""
    options = request.model_dump_json(exclude={"measurement_set_id", "leave_out", "variant_of"})
    bodies = "" if request.weight is None else repr(prepared.robot.bodies)
    return hash_of(prepared.content, options, bodies)


def run_identification(
    prepared: PreparedSet,
    options: RunOptions,
    parts: Sequence[Resamples] = (),
) -> RunResult:
    """Identify, predict, and report, without the model that predicts.

    It takes a refit a posture only where joints alone do not fit: their intervals hold what that says.

    Raises:
        RequestError: the options do not fit the robot or the set.
        UnsupportedMethodError: the readings cannot support the method.
        NotObservableError: the readings determine no joint.
        SolverError: optimality could not be certified.
    """
    robot, measurements = prepared.robot, prepared.measurements
    settings, estimate = identified(prepared, to_settings(options, robot))
    screening, left_out = screen_estimate(robot, measurements, estimate), None
    if screening.lack_of_fit:
        model = JointModel.of(robot, estimate, settings.constraints)
        with suppress(JointstiffError):
            left_out = leave_postures_out(robot, measurements, settings, estimate, model).left_out
    return _reported(prepared, options, settings, estimate, parts, left_out, screening)


def _reported(
    prepared: PreparedSet,
    options: RunOptions,
    settings: Settings,
    estimate: Estimate,
    parts: Sequence[Resamples],
    left_out: LeftOut | None = None,
    screening: Screening | None = None,
) -> RunResult:
    lacks = screening is not None and screening.lack_of_fit and prepared.is_sound(estimate)
    budget = UncertaintyBudget.of(estimate, settings.confidence, left_out, lack_of_fit=lacks)
    if budget is not None and lacks:
        estimate = budget.widened(estimate, settings.bounds)
    prediction = predict(
        prepared.robot,
        prepared.measurements,
        estimate.compliance,
        complementary_stiffness=settings.complementary_stiffness,
        estimated=estimate.estimated,
    )
    assessment = prepared.assess(settings, estimate, prediction, screening)
    # Behind a mistake, what another reading would bring is not known.
    usable = assessment.verdict != "do_not_use"
    advice = advise(prepared.robot, prepared.measurements, estimate) if usable else ()
    prediction = assessment.supported(prediction)
    result = to_result(
        prepared.robot,
        estimate,
        prediction,
        assessment,
        prepared.measurements,
        [*prepared.warnings, *assessment.remarks],
        advice,
        budget,
    )
    result = result.model_copy(update={"encoder_residuals": _encoder_residuals(prepared, settings, estimate)})
    if options.resampling is None or not parts:
        return result
    summary = summarise(Resamples.concatenate(parts), confidence=options.confidence)
    repetitions = options.resampling.repetitions
    resampling = to_resampling_result(summary, result.joints, repetitions)
    return result.model_copy(update={"resampling": resampling})


def _encoder_residuals(
    prepared: PreparedSet, settings: Settings, estimate: Estimate
) -> list[EncoderResidual]:
    if prepared.measurements.encoders is None:
        return []
    predicted = predict_encoders(
        prepared.robot,
        prepared.measurements,
        estimate.compliance,
        complementary_stiffness=settings.complementary_stiffness,
    )
    return to_encoder_residuals(prepared.measurements, predicted, prepared.robot)
