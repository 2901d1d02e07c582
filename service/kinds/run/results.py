"""Results of a run: from estimate and prediction to messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.measurement.measurement_set import QualityWarning
from jointstiff.schemas.run import identifiability as identifiabilities
from jointstiff.schemas.run import run as runs
from jointstiff.schemas.run.joints import JointResult
from jointstiff.schemas.run.resampling import ResampledCompensation, ResampledJoint, ResamplingResult
from jointstiff.service.conversion.assessments import to_assessment, to_joints
from jointstiff.service.conversion.message import message, rows
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.kinds.run.budgets import to_budget, to_joint_budgets
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.advice import Advice
from jointstiff.solver.inference.assessment import Assessment
from jointstiff.solver.inference.budget import UncertaintyBudget
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.prediction import Contributions, Prediction
from jointstiff.solver.readings.measurements import EncoderReadings, Measurements
from jointstiff.solver.resampling import ResamplingSummary

MAX_SUSPICIOUS: Final = 100
"""Readings that are listed; all are counted."""


def to_result(
    estimate: Estimate,
    prediction: Prediction,
    assessment: Assessment,
    measurements: Measurements,
    readings: ReadingArrays,
    warnings: list[QualityWarning],
    advice: Sequence[Advice] = (),
    budget: UncertaintyBudget | None = None,
) -> runs.RunResult:
    """Return the numbers of a run, with residuals by observation and target, and advice."""
    names = [joint.name for joint in estimate.joints]
    return message(
        runs.RunResult,
        estimate,
        assessment=to_assessment(assessment, estimate.joints, readings),
        joints=to_joints(estimate.joints, assessment.joints, to_joint_budgets(budget, len(names))),
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        goodness=message(runs.Goodness, estimate, test=estimate.sigma_test),
        identifiability=to_identifiability(estimate, advice, readings.labels.tolist()),
        robust=to_robust_loss(estimate, readings),
        contributions=to_contributions(prediction.contributions, names),
        resampling=None,
        model=None,
        budget=to_budget(budget, names, [reason.code for reason in assessment.reasons]),
        links=None,
        selection=None,
        choice=None,
        residuals=_residuals(prediction, measurements, readings),
        encoder_residuals=[],
        weight=None,
        warnings=warnings,
    )


def to_contributions(contributions: Contributions | None, names: Sequence[str]) -> list[runs.Contribution]:
    """Return each joint's part of the predicted deflection; none where links bend, too."""
    if contributions is None:
        return []
    return rows(
        runs.Contribution,
        joint=names,
        share=contributions.share,
        mean=contributions.mean,
        by_observation=contributions.by_observation,
    )


def to_identifiability(
    estimate: Estimate, advice: Sequence[Advice], labels: Sequence[str]
) -> identifiabilities.Identifiability:
    """Return rank, condition, combinations and indices, with advice in words."""
    names = [joint.name for joint in estimate.joints]
    return message(
        identifiabilities.Identifiability,
        estimate,
        stages=estimate.identifiability,
        observability=estimate.observability_indices,
        advice=[
            message(
                identifiabilities.Advice,
                piece,
                joint=names[piece.joint],
                observation=None if piece.observation is None else labels[piece.observation],
                message=piece.in_words(names, labels),
            )
            for piece in advice
        ],
    )


def to_robust_loss(estimate: Estimate, readings: ReadingArrays) -> runs.RobustLoss | None:
    """Return the readings that the Huber loss suspects, worst first; None for the squared loss."""
    robust = estimate.robust
    if robust is None:
        return None
    i, t = robust.suspicious[:MAX_SUSPICIOUS].T
    suspicious = rows(
        runs.SuspiciousReading,
        observation=readings.labels[i],
        target=readings.targets[t],
        weight=robust.weight[i, t],
        residual_norm=robust.residual_norm[i, t],
    )
    return message(runs.RobustLoss, robust, suspicious=suspicious, suspicious_count=len(robust.suspicious))


def to_encoder_residuals(
    encoders: EncoderReadings, predicted: FloatArray, labels: Sequence[str], joint_names: Sequence[str]
) -> list[runs.EncoderResidual]:
    """Return measured and predicted deflection (N, n) [rad] of each encoder that was read."""
    i, j = np.nonzero(encoders.present)
    return rows(
        runs.EncoderResidual,
        observation=np.array(labels)[i],
        joint=np.array(joint_names)[j],
        deflection=encoders.deflection[i, j],
        predicted=predicted[i, j],
        residual=(encoders.deflection - predicted)[i, j],
    )


def to_resampling_result(
    summary: ResamplingSummary, joints: list[JointResult], repetitions: int
) -> ResamplingResult:
    """Return statistics of the draws; joints that the whole set does not show get no numbers."""
    shown = summary.without(np.array([joint.status == "not_observable" for joint in joints]))
    return ResamplingResult(
        repetitions=repetitions,
        joints=rows(
            ResampledJoint,
            name=[joint.name for joint in joints],
            **{name: getattr(shown, name) for name in ResampledJoint.model_fields if name != "name"},
        ),
        share_any_negative=summary.share_any_negative,
        compensation=message(
            ResampledCompensation,
            summary,
            mean=summary.compensation_mean,
            deviation=summary.compensation_deviation,
            interval=np.array(summary.compensation_interval),
        ),
    )


def _residuals(
    prediction: Prediction, measurements: Measurements, readings: ReadingArrays
) -> list[runs.Residual]:
    i, t = np.nonzero(measurements.present)
    return rows(
        runs.Residual,
        observation=readings.labels[i],
        target=readings.targets[t],
        deflection=measurements.deflection[i, t],
        predicted=prediction.predicted[i, t],
        residual=prediction.residual[i, t],
    )
