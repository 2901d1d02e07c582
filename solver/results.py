"""The last step of an identification: the result classes of `schemas`, filled once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from jointstiff.schemas import assessment, model, run
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.options import RunOptions
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.advice import Advice
from jointstiff.solver.evidence.assessment import Assessment
from jointstiff.solver.evidence.budget import UncertaintyBudget
from jointstiff.solver.evidence.estimate import Estimate, JointCompliance
from jointstiff.solver.evidence.prediction import Contributions, Prediction
from jointstiff.solver.links.choice import HeldOut, Selection
from jointstiff.solver.links.fit import ElasticEstimate
from jointstiff.solver.links.model import Loss
from jointstiff.solver.messages import message, messages_of, rows
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
) -> run.RunResult:
    """Return the numbers of a run, with residuals by observation and target, and advice."""
    names = [joint.name for joint in estimate.joints]
    return message(
        run.RunResult,
        estimate,
        assessment=to_assessment(assessment, estimate.joints),
        joints=to_joints(estimate.joints, assessment.joints, to_joint_budgets(budget, len(names))),
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        goodness=message(run.Goodness, estimate, test=estimate.sigma_test),
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


def to_contributions(contributions: Contributions | None, names: Sequence[str]) -> list[run.Contribution]:
    """Return each joint's part of the predicted deflection; none where links bend, too."""
    if contributions is None:
        return []
    return rows(
        run.Contribution,
        joint=names,
        share=contributions.share,
        mean=contributions.mean,
        by_observation=contributions.by_observation,
    )


def to_identifiability(
    estimate: Estimate, advice: Sequence[Advice], robot: Robot, measurements: Measurements
) -> run.Identifiability:
    """Return rank, condition, combinations and indices, with advice in words."""
    names = [joint.name for joint in estimate.joints]
    return message(
        run.Identifiability,
        estimate,
        stages=estimate.identifiability,
        observability=estimate.observability_indices,
        advice=[
            message(
                run.Advice,
                piece,
                joint=names[piece.joint],
                observation=None if piece.observation is None else measurements.labels[piece.observation],
                message=piece.in_words(robot, measurements),
            )
            for piece in advice
        ],
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


def to_encoder_residuals(
    measurements: Measurements, predicted: FloatArray, robot: Robot
) -> list[run.EncoderResidual]:
    """Return measured and predicted deflection (N, n) [rad] of each encoder that was read."""
    encoders = measurements.encoders
    if encoders is None:
        return []
    i, j = np.nonzero(encoders.present)
    return rows(
        run.EncoderResidual,
        observation=np.array(measurements.labels)[i],
        joint=np.array(robot.joint_names)[j],
        deflection=encoders.deflection[i, j],
        predicted=predicted[i, j],
        residual=(encoders.deflection - predicted)[i, j],
    )


def to_resampling_result(
    summary: ResamplingSummary, joints: list[run.JointResult], repetitions: int
) -> run.ResamplingResult:
    """Return statistics of the draws; joints that the whole set does not show get no numbers."""
    shown = summary.without(np.array([joint.status == "not_observable" for joint in joints]))
    return run.ResamplingResult(
        repetitions=repetitions,
        joints=rows(
            run.ResampledJoint,
            name=[joint.name for joint in joints],
            **{name: getattr(shown, name) for name in run.ResampledJoint.model_fields if name != "name"},
        ),
        share_any_negative=summary.share_any_negative,
        compensation=message(
            run.ResampledCompensation,
            summary,
            mean=summary.compensation_mean,
            deviation=summary.compensation_deviation,
            interval=np.array(summary.compensation_interval),
        ),
    )


def _residuals(prediction: Prediction, measurements: Measurements) -> list[run.Residual]:
    i, t = np.nonzero(measurements.present)
    return rows(
        run.Residual,
        observation=np.array(measurements.labels)[i],
        target=np.array(measurements.targets)[t],
        deflection=measurements.deflection[i, t],
        predicted=prediction.predicted[i, t],
        residual=prediction.residual[i, t],
    )


def to_links_result(
    elastic: ElasticEstimate, joint_names: Sequence[str], options: RunOptions, losses: Sequence[Loss]
) -> model.LinksResult:
    """Return the links, with what each element explains."""
    return message(
        model.LinksResult,
        elastic,
        model=elastic.model.name,
        model_source="cross_validation" if options.elasticity == "automatic" else "given",
        loss=elastic.model.loss,
        loss_source="cross_validation" if len(losses) > 1 else "given",
        penalty_source="cross_validation" if options.link_penalty is None else "given",
        links=[message(model.LinkCompliance, link, joint=joint_names[link.joint]) for link in elastic.links],
        elements=[
            message(
                model.ElementShare,
                element,
                joint=None if element.joint is None else joint_names[element.joint],
            )
            for element in elastic.elements
        ],
    )


def to_selection(selection: Selection, chosen: HeldOut) -> model.ModelSelection:
    """Return models and losses side by side."""
    losses = {scored.model: selection.of(scored.model).loss for scored in selection.models}
    return message(
        model.ModelSelection, selection, chosen=chosen.model, chosen_loss=chosen.loss, losses=losses
    )


_LACK_OF_FIT: Final = {
    "lack_of_fit",
    "links_bend_with_joints",
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


def to_assessment(judgement: Assessment, joints: Sequence[JointCompliance]) -> assessment.Assessment:
    """Return verdict and reasons of an identification, and how many of its joints have a number."""
    return assessment.Assessment(
        verdict=judgement.verdict,
        joints_identified=sum(joint.status == "identified" for joint in joints),
        joint_count=len(joints),
        reasons=list(judgement.reasons),
        notes=list(judgement.notes),
    )


def to_joints(
    joints: Sequence[JointCompliance],
    verdicts: Sequence[Verdict],
    budgets: Sequence[run.UncertaintyBudget | None],
) -> list[run.JointResult]:
    """Return the joints, each with its verdict and its budget."""
    known = [joint.one_sided for joint in joints if joint.one_sided is not None]
    bounds = iter(messages_of(run.OneSidedBounds, known))
    one_sided = [None if joint.one_sided is None else next(bounds) for joint in joints]
    return messages_of(run.JointResult, joints, verdict=verdicts, budget=budgets, one_sided=one_sided)
