"""Results: from estimate and prediction to messages."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.run import JointResult, ResampledCompensation, ResampledJoint, ResamplingResult
from jointstiff.schemas.run import run as runs
from jointstiff.service.conversion.identifiability import to_identifiability
from jointstiff.service.conversion.joints import to_joint
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.conversion.robust_loss import to_robust_loss
from jointstiff.solver.inference import Advice, Estimate, Prediction
from jointstiff.solver.readings import Measurements
from jointstiff.solver.resampling import ResamplingSummary

__all__ = ["to_resampling_result", "to_result"]


def to_result(
    estimate: Estimate,
    prediction: Prediction,
    measurements: Measurements,
    readings: ReadingArrays,
    warnings: list[QualityWarning],
    advice: Sequence[Advice] = (),
) -> runs.RunResult:
    """The numbers of a run, with residuals by observation and target, and advice on what to measure next."""
    return runs.RunResult(
        joints=[to_joint(joint) for joint in estimate.joints],
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        sigma=estimate.sigma,
        goodness=runs.Goodness(
            chi_square=estimate.chi_square,
            degrees_of_freedom=estimate.degrees_of_freedom,
            sigma_source="given" if estimate.sigma_given else "residuals",
            test=_sigma_test(estimate),
        ),
        identifiability=to_identifiability(estimate, advice, readings.labels.tolist()),
        certificate=_certificate(estimate),
        characteristic_length=estimate.characteristic_length,
        complementary_stiffness=_complementary_stiffness(estimate),
        robust=to_robust_loss(estimate, readings),
        residuals=_residuals(prediction, measurements, readings),
        warnings=warnings,
    )


def to_resampling_result(
    summary: ResamplingSummary, joints: list[JointResult], repetitions: int
) -> ResamplingResult:
    """Statistics of the draws; joints that the whole set does not show get no numbers from parts of it."""
    return ResamplingResult(
        repetitions=repetitions,
        joints=[_resampled(summary, j, joint) for j, joint in enumerate(joints)],
        share_any_negative=summary.share_any_negative,
        compensation=ResampledCompensation(
            mean=_finite(summary.compensation_mean),
            deviation=_finite(summary.compensation_deviation),
            interval=_finite_pair(summary.compensation_interval),
        ),
    )


def _resampled(summary: ResamplingSummary, j: int, joint: JointResult) -> ResampledJoint:
    hidden = joint.status == "not_observable"
    low, high = summary.compliance_interval[j].tolist()
    return ResampledJoint(
        name=joint.name,
        compliance_mean=None if hidden else _finite(float(summary.compliance_mean[j])),
        compliance_deviation=None if hidden else _finite(float(summary.compliance_deviation[j])),
        compliance_interval=None if hidden else _finite_pair((low, high)),
        stiffness_mean=None if hidden else _finite(float(summary.stiffness_mean[j])),
        stiffness_deviation=None if hidden else _finite(float(summary.stiffness_deviation[j])),
        share_negative=0.0 if hidden else float(summary.share_negative[j]),
        share_infinite=0.0 if hidden else float(summary.share_infinite[j]),
        share_undetermined=1.0 if hidden else float(summary.share_undetermined[j]),
    )


def _finite_pair(pair: tuple[float, float]) -> tuple[float, float] | None:
    return pair if all(map(isfinite, pair)) else None


def _sigma_test(estimate: Estimate) -> runs.SigmaTest | None:
    test = estimate.sigma_test
    return None if test is None else runs.SigmaTest(p_value=test.p_value, verdict=test.verdict)


def _complementary_stiffness(estimate: Estimate) -> runs.ComplementaryStiffness | None:
    size = estimate.complementary_stiffness
    if size is None:
        return None
    return runs.ComplementaryStiffness(
        included=size.included,
        iterations=size.iterations,
        largest_ratio=size.largest_ratio,
        largest_shift=size.largest_shift,
    )


def _finite(number: float) -> float | None:
    return number if isfinite(number) else None


def _certificate(estimate: Estimate) -> runs.Certificate:
    stages = estimate.certificates
    return runs.Certificate(
        primal=max(stage.primal for stage in stages),
        dual=max(stage.dual for stage in stages),
        complementarity=max(stage.complementarity for stage in stages),
        solved_by=[stage.solved_by for stage in stages],
    )


def _residuals(
    prediction: Prediction, measurements: Measurements, readings: ReadingArrays
) -> list[runs.Residual]:
    labels, targets = readings.labels.tolist(), readings.targets.tolist()
    rows, columns = np.nonzero(measurements.present)
    place = rows, columns
    return [
        runs.Residual(
            observation=labels[i],
            target=targets[t],
            deflection=tuple(deflection),
            predicted=tuple(predicted),
            residual=tuple(residual),
        )
        for i, t, deflection, predicted, residual in zip(
            rows.tolist(),
            columns.tolist(),
            measurements.deflection[place].tolist(),
            prediction.predicted[place].tolist(),
            prediction.residual[place].tolist(),
            strict=True,
        )
    ]
