"""The last step of an identification: the result classes of `schemas`, filled once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from jointstiff.schemas import finding, run
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.joints import stated_kinds
from jointstiff.solver.evidence.assessment import Assessment
from jointstiff.solver.evidence.estimate import Estimate, JointCompliance, Prediction, UncertaintyBudget
from jointstiff.solver.messages import message, messages_of, rows
from jointstiff.solver.readings.measurements import Measurements

MAX_SUSPICIOUS: Final = 100
"""Readings that are listed; all are counted."""


def run_result(
    estimate: Estimate,
    prediction: Prediction,
    assessment: Assessment,
    measurements: Measurements,
    warnings: list[Finding],
    advice: Sequence[run.Advice] = (),
    budget: UncertaintyBudget | None = None,
    **parts: object,
) -> run.RunResult:
    """Return the numbers of a run, with residuals by observation and target, and advice.

    Warnings are of the set, then of the fit; `parts` are further fields of the result, null if they are left
    out.
    """
    labels, targets = np.array(measurements.labels), np.array(measurements.targets)
    names = [joint.name for joint in estimate.joints]
    i, t = np.nonzero(measurements.present)
    by_encoder, contributions = [], []
    if measurements.encoders is not None and prediction.encoders is not None:
        k, j = np.nonzero(measurements.encoders.present)
        read, predicted = measurements.encoders.deflection[k, j], prediction.encoders[k, j]
        by_encoder = rows(
            run.EncoderResidual,
            observation=labels[k],
            joint=np.array(names)[j],
            deflection=read,
            predicted=predicted,
            residual=read - predicted,
        )
    if prediction.contributions is not None:
        contributions = rows(run.Contribution, joint=names, **vars(prediction.contributions))
    absent = dict.fromkeys(("resampling", "model", "links", "selection", "choice", "weight"))
    return message(
        run.RunResult,
        estimate,
        assessment=to_assessment(assessment, estimate.joints),
        joint_kinds=stated_kinds(names, [joint.kind for joint in estimate.joints]),
        joints=messages_of(
            run.JointResult,
            estimate.joints,
            verdict=assessment.joints,
            budget=to_joint_budgets(budget, len(names)),
        ),
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        goodness=message(run.Goodness, estimate, test=estimate.sigma_test),
        identifiability=message(
            run.Identifiability,
            estimate,
            stages=estimate.identifiability,
            observability=estimate.observability_indices,
            advice=advice,
        ),
        robust=to_robust_loss(estimate, measurements),
        contributions=contributions,
        budget=to_budget(budget, names, [reason.code for reason in assessment.reasons]),
        residuals=rows(
            run.Residual,
            observation=labels[i],
            target=targets[t],
            deflection=measurements.deflection[i, t],
            predicted=prediction.predicted[i, t],
            residual=prediction.residual[i, t],
        ),
        encoder_residuals=by_encoder,
        warnings=warnings,
        **{**absent, **parts},
    )


def to_robust_loss(estimate: Estimate, measurements: Measurements) -> run.RobustLoss | None:
    """Return the readings that the Huber loss suspects, worst first; None for the squared loss."""
    robust = estimate.robust
    if robust is None:
        return None
    i, t = robust.suspicious[:MAX_SUSPICIOUS].T
    suspicious = rows(
        run.SuspiciousReading,
        observation=np.array(measurements.labels)[i],
        target=np.array(measurements.targets)[t],
        weight=robust.weight[i, t],
        residual_norm=robust.residual_norm[i, t],
    )
    return message(run.RobustLoss, robust, suspicious=suspicious, suspicious_count=len(robust.suspicious))


_LACK_OF_FIT: Final = {
    "lack_of_fit",
    "links_bend_with_joints",
    "base_bends",
    "residuals_exceed_sigma",
    "deflection_unexplained",
    "alternative_explains_better",
}
"""Reasons of an assessment for which the joints alone are not all that bends, or not as stated."""


def to_budget(
    budget: UncertaintyBudget | None, names: Sequence[str], reasons: Iterable[str]
) -> run.Budget | None:
    """Return the budget of the joints that have an estimate; None for none."""
    if budget is None:
        return None
    shown, total = budget.joints, budget.total()
    square = np.ix_(shown, shown)
    return run.Budget(
        joints=[names[j] for j in shown],
        components=[
            run.BudgetComponent(
                source=part.source,
                evaluation=part.evaluation,
                included=part.included,
                degrees_of_freedom=part.degrees_of_freedom,
                contributions=part.spread.uncertainty[shown].tolist(),
                correlation=part.spread.correlation[square].tolist(),
            )
            for part in budget.components
        ],
        standard_uncertainty=total.uncertainty[shown].tolist(),
        correlation=total.correlation[square].tolist(),
        probability=budget.probability,
        coverage_factor=budget.coverage_factor,
        expanded_uncertainty=(budget.coverage_factor * total.uncertainty[shown]).tolist(),
        missing=[
            *([] if any(part.source == "model_error" for part in budget.components) else ["model_error"]),
            *([] if _LACK_OF_FIT.isdisjoint(reasons) else ["lack_of_fit"]),
        ],
        expanded_with_model_error=(
            budget.coverage_factor * budget.total(whole=True).uncertainty[shown]
        ).tolist(),
    )


def to_joint_budgets(budget: UncertaintyBudget | None, count: int) -> list[run.UncertaintyBudget | None]:
    """Return the included contributions of each of `count` joints, where there is more than readings."""
    included = [] if budget is None else [part for part in budget.components if part.included]
    if budget is None or len(included) < 2:
        return [None] * count
    parts = {part.source: part.spread.uncertainty for part in included}
    return [
        run.UncertaintyBudget(**{str(source): float(u[j]) for source, u in parts.items()})
        if j in budget.joints
        else None
        for j in range(count)
    ]


def to_assessment(judgement: Assessment, joints: Sequence[JointCompliance]) -> finding.Assessment:
    """Return verdict and reasons of an identification, and how many of its joints have a number."""
    return finding.Assessment(
        verdict=judgement.verdict,
        joints_identified=sum(joint.status == "identified" for joint in joints),
        joint_count=len(joints),
        reasons=list(judgement.reasons),
        notes=list(judgement.notes),
    )
