"""Results of a run: from estimate and prediction to messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas import run as identifiabilities
from jointstiff.schemas import run as runs
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.run import JointResult, ResampledCompensation, ResampledJoint, ResamplingResult
from jointstiff.service.conversion.assessments import to_assessment, to_joints
from jointstiff.service.kinds.run.budgets import to_budget, to_joint_budgets
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.advice import Advice
from jointstiff.solver.evidence.assessment import Assessment
from jointstiff.solver.evidence.budget import UncertaintyBudget
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.prediction import Contributions, Prediction
from jointstiff.solver.messages import message, rows
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.resampling import ResamplingSummary
from jointstiff.solver.robot.model import Robot

MAX_SUSPICIOUS: Final = 100
"""Readings that are listed; all are counted."""


def to_result(
    robot: Robot,
    estimate: Estimate,
    prediction: Prediction,
    assessment: Assessment,
    measurements: Measurements,
    warnings: list[Finding],
    advice: Sequence[Advice] = (),
    budget: UncertaintyBudget | None = None,
) -> runs.RunResult:
    """Return the numbers of a run, with residuals by observation and target, and advice."""
    names = [joint.name for joint in estimate.joints]
    return message(
        runs.RunResult,
        estimate,
        assessment=to_assessment(assessment, estimate.joints),
        joints=to_joints(estimate.joints, assessment.joints, to_joint_budgets(budget, len(names))),
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        goodness=message(runs.Goodness, estimate, test=estimate.sigma_test),
        identifiability=to_identifiability(estimate, advice, robot, measurements),
        robust=to_robust_loss(estimate, measurements),
        contributions=to_contributions(prediction.contributions, names),
        resampling=None,
        model=None,
        budget=to_budget(budget, names, [reason.code for reason in assessment.reasons]),
        links=None,
        selection=None,
        choice=None,
        residuals=_residuals(prediction, measurements),
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
    estimate: Estimate, advice: Sequence[Advice], robot: Robot, measurements: Measurements
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
                observation=None if piece.observation is None else measurements.labels[piece.observation],
                message=piece.in_words(robot, measurements),
            )
            for piece in advice
        ],
    )


def to_robust_loss(estimate: Estimate, measurements: Measurements) -> runs.RobustLoss | None:
    """Return the readings that the Huber loss suspects, worst first; None for the squared loss."""
    robust = estimate.robust
    if robust is None:
        return None
    i, t = robust.suspicious[:MAX_SUSPICIOUS].T
    suspicious = rows(
        runs.SuspiciousReading,
        observation=np.array(measurements.labels)[i],
        target=np.array(measurements.targets)[t],
        weight=robust.weight[i, t],
        residual_norm=robust.residual_norm[i, t],
    )
    return message(runs.RobustLoss, robust, suspicious=suspicious, suspicious_count=len(robust.suspicious))


def to_encoder_residuals(
    measurements: Measurements, predicted: FloatArray, robot: Robot
) -> list[runs.EncoderResidual]:
    """Return measured and predicted deflection (N, n) [rad] of each encoder that was read."""
    encoders = measurements.encoders
    if encoders is None:
        return []
    i, j = np.nonzero(encoders.present)
    return rows(
        runs.EncoderResidual,
        observation=np.array(measurements.labels)[i],
        joint=np.array(robot.joint_names)[j],
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


def _residuals(prediction: Prediction, measurements: Measurements) -> list[runs.Residual]:
    i, t = np.nonzero(measurements.present)
    return rows(
        runs.Residual,
        observation=np.array(measurements.labels)[i],
        target=np.array(measurements.targets)[t],
        deflection=measurements.deflection[i, t],
        predicted=prediction.predicted[i, t],
        residual=prediction.residual[i, t],
    )
