"""One identification, from a prepared measurement set to the numbers of a run. No store."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas.run import EncoderResidual, RunOptions, RunResult
from jointstiff.service.conversion import (
    to_encoder_residuals,
    to_resampling_result,
    to_result,
    to_settings,
    to_warnings,
)
from jointstiff.service.resources import PreparedSet
from jointstiff.solver.identification import Settings, identify
from jointstiff.solver.inference import Estimate, advise, judge, predict, predict_encoders
from jointstiff.solver.resampling import Resamples, summarise

__all__ = ["run_identification"]


def run_identification(
    prepared: PreparedSet,
    options: RunOptions,
    parts: Sequence[Resamples] = (),
) -> RunResult:
    """Identify, predict, and report.

    Args:
        prepared: what was measured.
        options: how to identify.
        parts: the fits of the draws, in order, if it resamples.

    Raises:
        RequestError: the options do not fit the robot or the set.
        UnsupportedMethodError: the readings cannot support the method.
        NotObservableError: the readings determine no joint.
        SolverError: optimality could not be certified.
    """
    settings = to_settings(options, prepared.robot)
    estimate = identify(prepared.robot, prepared.measurements, settings)
    prediction = predict(
        prepared.robot,
        prepared.measurements,
        estimate.compliance,
        complementary_stiffness=settings.complementary_stiffness,
        estimated=estimate.estimated,
    )
    warnings = prepared.warnings + to_warnings(judge(estimate, prediction), prepared.readings)
    advice = advise(prepared.robot, prepared.measurements, estimate)
    result = to_result(estimate, prediction, prepared.measurements, prepared.readings, warnings, advice)
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
    encoders = prepared.measurements.encoders
    if encoders is None:
        return []
    predicted = predict_encoders(
        prepared.robot,
        prepared.measurements,
        estimate.compliance,
        complementary_stiffness=settings.complementary_stiffness,
    )
    labels = prepared.readings.labels.tolist()
    return to_encoder_residuals(encoders, predicted, labels, prepared.robot.joint_names)
