"""One identification, from a prepared measurement set to the numbers of a run. No store."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from schemas.run import RunOptions, RunResult
from service.conversion import (
    to_resampling_result,
    to_result,
    to_settings,
    to_warnings,
)
from service.prepared import PreparedSet
from service.resample import ResamplingWork
from solver.identification import identify
from solver.plausibility import judge
from solver.prediction import predict
from solver.resampling import Resamples
from solver.resampling_summary import summarise

__all__ = ["run_identification"]


def run_identification(
    prepared: PreparedSet,
    options: RunOptions,
    parts: Sequence[Resamples] | None = None,
    tell: Callable[[int], object] | None = None,
) -> RunResult:
    """Identify, predict, resample, and report.

    Args:
        prepared: what was measured.
        options: how to identify.
        parts: the draws, in order, if they were computed elsewhere.
        tell: told how many draws are done, after each step.

    Raises:
        RequestError: the options do not fit the robot or the set.
        UnsupportedMethodError: the readings cannot support the method.
        NotObservableError: the readings determine no joint.
        SolverError: optimality could not be certified.
    """
    settings = to_settings(options, prepared.robot)
    estimate = identify(prepared.robot, prepared.measurements, settings)
    prediction = predict(prepared.robot, prepared.measurements, estimate.compliance)
    warnings = prepared.warnings + to_warnings(judge(estimate, prediction), prepared.readings)
    result = to_result(estimate, prediction, prepared.measurements, prepared.readings, warnings)
    if options.resampling is None:
        return result
    if parts is None:
        work = ResamplingWork(prepared, options, options.resampling)
        parts = list(_computed(work, tell))
    summary = summarise(Resamples.concatenate(parts), confidence=options.confidence)
    repetitions = options.resampling.repetitions
    resampling = to_resampling_result(summary, result.joints, repetitions)
    return result.model_copy(update={"resampling": resampling})


def _computed(work: ResamplingWork, tell: Callable[[int], object] | None) -> Iterator[Resamples]:
    for span in work.steps():
        yield work.compute(span)
        if tell is not None:
            tell(span[1])
