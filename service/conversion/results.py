"""Results: from estimate and prediction to messages."""

from __future__ import annotations

from math import isfinite

import numpy as np

from schemas import run as runs
from schemas.measurement_set import QualityWarning
from schemas.resampling import ResampledCompensation, ResampledJoint, ResamplingResult
from service.conversion.readings import ReadingArrays
from solver.estimate import Estimate, JointCompliance
from solver.measurements import Measurements
from solver.prediction import Prediction
from solver.resampling_summary import ResamplingSummary

__all__ = ["to_resampling_result", "to_result"]


def to_result(
    estimate: Estimate,
    prediction: Prediction,
    measurements: Measurements,
    readings: ReadingArrays,
    warnings: list[QualityWarning],
) -> runs.RunResult:
    """The numbers of a run, with residuals by observation and target."""
    return runs.RunResult(
        joints=[_joint(joint) for joint in estimate.joints],
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        sigma=estimate.sigma,
        goodness=runs.Goodness(
            chi_square=estimate.chi_square,
            degrees_of_freedom=estimate.degrees_of_freedom,
            sigma_source="given" if estimate.sigma_given else "residuals",
        ),
        identifiability=_identifiability(estimate),
        certificate=_certificate(estimate),
        characteristic_length=estimate.characteristic_length,
        residuals=_residuals(prediction, measurements, readings),
        warnings=warnings,
    )


def to_resampling_result(
    summary: ResamplingSummary, joints: list[runs.JointResult], repetitions: int
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


def _resampled(summary: ResamplingSummary, j: int, joint: runs.JointResult) -> ResampledJoint:
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


def _joint(joint: JointCompliance) -> runs.JointResult:
    return runs.JointResult(
        name=joint.name,
        status=joint.status,
        compliance=joint.compliance,
        stiffness=_stiffness(joint.compliance),
        standard_uncertainty=joint.standard_uncertainty,
        compliance_interval=joint.interval,
        stiffness_interval=_stiffness_interval(joint.interval),
        reason=joint.reason,
    )


def _stiffness(compliance: float | None) -> float | None:
    """1 / c; None for a rigid joint and for numbers whose inverse overflows."""
    if not compliance:
        return None
    return _finite(1.0 / compliance)


def _stiffness_interval(interval: tuple[float, float] | None) -> tuple[float, float | None] | None:
    """[1/c_hi, 1/c_lo], open above where the compliance reaches zero.

    An interval of compliances that are all negative, or that spans zero downwards, is no interval of
    stiffness: it has no least stiffness.
    """
    if interval is None or interval[0] < 0 or interval[1] <= 0:
        return None
    return 1.0 / interval[1], _stiffness(interval[0])


def _identifiability(estimate: Estimate) -> runs.Identifiability:
    names = [joint.name for joint in estimate.joints]
    analyses = estimate.identifiability
    return runs.Identifiability(
        parameters=len(names),
        rank=sum(analysis.rank for analysis in analyses),
        condition_number=_finite(max(analysis.condition_number for analysis in analyses)),
        combinations=[
            [names[j] for j in group.joints] for analysis in analyses for group in analysis.combinations
        ],
        stages=[
            runs.StageIdentifiability(
                rank=analysis.rank,
                condition_number=_finite(analysis.condition_number),
                singular_values=analysis.singular_values.tolist(),
            )
            for analysis in analyses
        ],
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
