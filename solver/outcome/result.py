"""Messages of a run's result, filled field by field from what a run found and from its assessment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jointstiff.schemas import run as runs
from jointstiff.schemas.finding import UNKNOWN_JOINTS, Finding, Verdict
from jointstiff.schemas.finding import Assessment as StatedAssessment
from jointstiff.schemas.model import IdentifiedModel
from jointstiff.schemas.run import RunResult
from jointstiff.solver.arrays import IndexArray
from jointstiff.solver.evidence.scatter import Repeatability
from jointstiff.solver.evidence.structure import Apart, PartName, build_parts
from jointstiff.solver.fit.estimate import (
    BudgetComponent,
    ComplementaryStiffness,
    Estimate,
    JointCompliance,
    Prediction,
    Spread,
    UncertaintyBudget,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.messages import build_messages, finite_or_none, list_joint_kinds
from jointstiff.solver.outcome.found import Found
from jointstiff.solver.outcome.rules import Assessment
from jointstiff.solver.predict.answers import build_stored_model

MAX_SUSPICIOUS: Final = 100
"""Greatest number of suspicious readings that a result lists; it counts all of them."""
_OUTLYING: Final = frozenset({"residual_outlier", "deflection_unexplained"})
"""Codes of reasons which show that elastic links leave readings unexplained, too."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Numbers:
    """Numbers that a result of every model shows."""

    joints: tuple[JointCompliance, ...]
    compensation: float | None
    rms_residual: float  #: [m]
    sigma: float | None  #: [m]
    goodness: runs.Goodness
    identifiability: runs.Identifiability
    certificate: runs.Certificate
    complementary_stiffness: runs.ComplementaryStiffness | None
    residuals: list[runs.Residual]
    model: IdentifiedModel | None


def build_run_result(
    numbers: Numbers, assessment: Assessment, warnings: Sequence[Finding], details: Mapping[str, Any]
) -> RunResult:
    """Build the message of a run's result.

    Args:
        numbers: numbers of the fit.
        assessment: verdict on these numbers, with its reasons.
        warnings: warnings about the set, then about the fit.
        details: further fields of the message, by name, which only some models have.
    """
    without_details: dict[str, Any] = {"characteristic_length": None}
    return RunResult(
        assessment=build_assessment_message(assessment, numbers.joints),
        joints=build_joint_results(assessment, numbers.joints),
        compensation=numbers.compensation,
        rms_residual=numbers.rms_residual,
        sigma=numbers.sigma,
        goodness=numbers.goodness,
        identifiability=numbers.identifiability,
        certificate=numbers.certificate,
        complementary_stiffness=numbers.complementary_stiffness,
        residuals=numbers.residuals,
        model=numbers.model,
        warnings=list(warnings),
        **(without_details | dict(details)),
    )


def describe_found(
    found: Found,
    assessment: Assessment,
    noticed: Sequence[Finding],
    advice: Sequence[runs.Advice] = (),
    resampling: runs.ResamplingResult | None = None,
) -> RunResult:
    """Build the message of the result of a run with loads.

    Args:
        found: fitted model with its evidence.
        assessment: verdict on the model, with its reasons.
        noticed: findings of the integrity checks of the measurements.
        advice: further readings that would reduce the uncertainties most.
        resampling: statistics of resampled fits; None without resampling.
    """
    shown = replace(found, prediction=assessment.drop_meaningless_numbers(found.prediction))
    details = {
        **_describe_model(shown, assessment),
        **_describe_robust_loss(shown.estimate, shown.rows.measurements),
        **_describe_encoders(shown, assessment),
        "resampling": resampling,
    }
    warnings = (*_list_warnings(found, assessment, noticed), *assessment.remarks, *found.remarks)
    return build_run_result(_collect_numbers(shown, advice), assessment, warnings, details)


def _collect_numbers(found: Found, advice: Sequence[runs.Advice]) -> Numbers:
    """Return the numbers of a fit that a result of every model shows, with advice on further readings."""
    estimate, prediction = found.estimate, found.prediction
    repeatability = Repeatability.from_rows(found.rows, estimate.sigma)
    return Numbers(
        joints=estimate.joints,
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        sigma=estimate.sigma,
        goodness=_build_goodness(estimate, repeatability),
        identifiability=_build_identifiability(estimate, advice),
        certificate=estimate.certificate,
        complementary_stiffness=_build_complementary_stiffness(estimate.complementary_stiffness),
        residuals=_build_residuals(prediction, found.rows.measurements),
        model=build_stored_model(found.predictor, found.model_error),
    )


def _describe_model(found: Found, assessment: Assessment) -> dict[str, Any]:
    """Return the fields of a result on its model: joints, links, tested causes and uncertainty budget."""
    joints = found.estimate.joints
    names = [joint.name for joint in joints]
    return {
        "joint_kinds": list_joint_kinds(names, [joint.kind for joint in joints]),
        "characteristic_length": found.estimate.characteristic_length,
        "links": found.links,
        "alone": found.alone,
        "choice": found.choice,
        "causes": list(found.screening.tests),
        "contributions": _build_contributions(found.prediction, names),
        "budget": build_budget_message(found.budget, names, assessment.reasons),
    }


def _build_contributions(prediction: Prediction, names: Sequence[str]) -> list[runs.Contribution]:
    """Build one message for each joint: its contribution to the deflections; empty where it is unknown."""
    contributions = prediction.contributions
    if contributions is None:
        return []
    return build_messages(runs.Contribution, joint=names, **vars(contributions))


def _describe_robust_loss(estimate: Estimate, measurements: Measurements) -> dict[str, Any]:
    """Return the fields of a result on the Huber loss: its threshold, and the readings of low weight.

    With the squared loss, all readings have the same weight, so that the fields are empty.
    """
    robust = estimate.robust
    if robust is None:
        return {"huber_threshold": None, "suspicious": [], "suspicious_count": 0}
    return {
        "huber_threshold": robust.threshold,
        "suspicious": list_suspicious_readings(estimate, measurements),
        "suspicious_count": len(robust.suspicious),
    }


def _describe_encoders(found: Found, assessment: Assessment) -> dict[str, Any]:
    """Return the fields of a result on encoders: their residuals, and gearboxes and structure apart."""
    names = [joint.name for joint in found.estimate.joints]
    return {
        "encoder_residuals": _build_encoder_residuals(found.prediction, found.rows.measurements, names),
        "gearboxes": _build_parts(found.apart, "gearboxes", names, assessment),
        "structures": _build_parts(found.apart, "structure", names, assessment),
    }


def _list_warnings(found: Found, assessment: Assessment, noticed: Sequence[Finding]) -> list[Finding]:
    """Return the findings of the integrity checks that the fitted model leaves.

    Outliers of joints alone are kept only if links leave these readings unexplained, too.
    """
    only_joints_bend = found.links is None
    links_leave_outliers = any(reason.code in _OUTLYING for reason in assessment.reasons)
    if only_joints_bend or links_leave_outliers:
        return list(noticed)
    return [finding for finding in noticed if finding.code != "residual_outlier"]


_SAME_FIELDS: Final = (
    "name",
    "kind",
    "status",
    "compliance",
    "own_compliance",
    "stiffness",
    "standard_uncertainty",
    "compliance_interval",
    "stiffness_interval",
    "stiffness_at_least",
    "prior_to_data",
)
"""Fields that the estimate of a joint and its message have in common."""


def build_joint_results(assessment: Assessment, joints: Sequence[JointCompliance]) -> list[runs.JointResult]:
    """Build the message of each joint's result.

    If the assessment says not to use the result, the reason does not state the lower limit of the stiffness.
    """
    if assessment.verdict == "do_not_use":  # then the limit is meaningless
        reasons = [joint.reason_without_limit for joint in joints]
    else:
        reasons = [joint.reason for joint in joints]
    columns: dict[str, Sequence[Any]] = {"verdict": assessment.joints, "reason": reasons}
    for field in _SAME_FIELDS:
        columns[field] = [getattr(joint, field) for joint in joints]
    return build_messages(runs.JointResult, **columns)


def build_assessment_message(assessment: Assessment, joints: Sequence[JointCompliance]) -> StatedAssessment:
    """Convert an assessment to a message: verdict, reasons, notes, and the number of joints that are known.

    Joints that are not known within the goal, or that are negative, do not count.
    """
    unknown = {reason.where for reason in assessment.reasons if reason.code in UNKNOWN_JOINTS}
    known = [joint for joint in joints if joint.name not in unknown]
    return StatedAssessment(
        verdict=assessment.verdict,
        reasons=list(assessment.reasons),
        questions=list(assessment.questions),
        joints_identified=runs.count_identified_joints(known),
        joint_count=len(joints),
        notes=list(assessment.notes),
    )


def _build_goodness(estimate: Estimate, repeatability: Repeatability | None) -> runs.Goodness:
    """Build the message of the goodness of fit: χ², its degrees of freedom, test of sigma, repeatability."""
    test = estimate.sigma_test
    return runs.Goodness(
        chi_square=estimate.chi_square,
        degrees_of_freedom=estimate.degrees_of_freedom,
        sigma_source=estimate.sigma_source,
        p_value=None if test is None else test.p_value,
        test=None if test is None else test.result,
        repeatability=None if repeatability is None else repeatability.joint,
        repeatability_at_targets=None if repeatability is None else repeatability.targets,
        repeatability_source=None if repeatability is None else repeatability.source,
    )


def _build_identifiability(estimate: Estimate, advice: Sequence[runs.Advice]) -> runs.Identifiability:
    """Build the message that states how well the readings determine the parameters, with advice."""
    return runs.Identifiability(
        parameters=estimate.parameters,
        rank=estimate.rank,
        condition_number=finite_or_none(estimate.condition_number),
        combinations=estimate.combinations,
        observability=estimate.observability_indices,
        advice=list(advice),
        weakest=estimate.weakest,
        stages=_build_stages(estimate),
    )


def _build_stages(estimate: Estimate) -> list[runs.StageIdentifiability]:
    """Build one message for each stage of the method: how well its readings determine its joints."""
    stages = []
    for stage in estimate.identifiability:
        message = runs.StageIdentifiability(
            rank=stage.rank,
            condition_number=finite_or_none(stage.condition_number),
            singular_values=stage.singular_values.tolist(),
        )
        stages.append(message)
    return stages


def _build_complementary_stiffness(size: ComplementaryStiffness | None) -> runs.ComplementaryStiffness | None:
    """Build the message of the size of the complementary stiffness K_c; None if the size is unknown."""
    if size is None:
        return None
    return runs.ComplementaryStiffness(
        included=size.included,
        iterations=size.iterations,
        largest_ratio=size.largest_ratio,
        largest_shift=finite_or_none(size.largest_shift),
    )


def _build_residuals(prediction: Prediction, measurements: Measurements) -> list[runs.Residual]:
    """Build one message for each reading: measured and predicted deflection, and their difference."""
    observation, target = np.nonzero(measurements.present)  # indices of each reading
    return build_messages(
        runs.Residual,
        observation=np.array(measurements.labels)[observation],
        target=np.array(measurements.targets)[target],
        deflection=measurements.deflection[observation, target],
        predicted=prediction.predicted[observation, target],
        residual=prediction.residual[observation, target],
    )


def _build_parts(
    apart: Apart | None, part: PartName, names: Sequence[str], assessment: Assessment
) -> list[runs.JointResult]:
    """Build one message for each joint that is taken apart, with a verdict no better than the run's.

    Args:
        apart: compliances of gearboxes and structure of some joints; None without encoders.
        part: which of the two parts.
        names: names of the n joints.
        assessment: assessment of the run, whose reasons concern these numbers, too.
    """
    messages = []
    for message in build_parts(apart, part, names):
        verdict_on_joint = assessment.joints[names.index(message.name)]
        verdict: Verdict = message.verdict
        if "do_not_use" in (assessment.verdict, verdict_on_joint):
            verdict = "do_not_use"
        elif assessment.verdict != "use":
            verdict = "use_with_care"
        messages.append(message.model_copy(update={"verdict": verdict}))
    return messages


def _build_encoder_residuals(
    prediction: Prediction, measurements: Measurements, names: Sequence[str]
) -> list[runs.EncoderResidual]:
    """Build one message for each encoder reading: measured and predicted deflection of the joint.

    The list is empty if no encoder was read.
    """
    encoders = measurements.encoders
    if encoders is None or prediction.encoders is None:
        return []
    observation, joint = np.nonzero(encoders.present)  # indices of each reading
    measured = encoders.deflection[observation, joint]
    predicted = prediction.encoders[observation, joint]
    return build_messages(
        runs.EncoderResidual,
        observation=np.array(measurements.labels)[observation],
        joint=np.array(names)[joint],
        deflection=measured,
        predicted=predicted,
        residual=measured - predicted,
    )


def list_suspicious_readings(estimate: Estimate, measurements: Measurements) -> list[runs.SuspiciousReading]:
    """Build messages of readings with low weight in the Huber loss: at most `MAX_SUSPICIOUS`, worst first.

    The list is empty for a fit with the squared loss.
    """
    robust = estimate.robust
    if robust is None:
        return []
    observation, target = robust.suspicious[:MAX_SUSPICIOUS].T  # indices of each reading
    return build_messages(
        runs.SuspiciousReading,
        observation=np.array(measurements.labels)[observation],
        target=np.array(measurements.targets)[target],
        weight=robust.weight[observation, target],
        residual_norm=robust.residual_norm[observation, target],
    )


_LACK_OF_FIT: Final = {
    "lack_of_fit",
    "links_bend_with_joints",
    "base_bends",
    "links_or_base",
    "residuals_exceed_sigma",
    "deflection_unexplained",
    "alternative_explains_better",
}
"""Codes of reasons which show that more than the joints bends, or that the model does not fit."""


def build_budget_message(
    budget: UncertaintyBudget | None, names: Sequence[str], reasons: Iterable[Finding]
) -> runs.Budget | None:
    """Build the message of the uncertainty budget of all joints that have an estimate.

    Args:
        budget: contributions to the uncertainties; None gives None.
        names: names of all joints.
        reasons: reasons of the assessment; some of them show a lack of fit, which is not in the budget.
    """
    if budget is None:
        return None
    included = _select_joints(budget.total(), budget.joints)
    with_model_error = _select_joints(budget.total(all_components=True), budget.joints)
    return runs.Budget(
        joints=[names[j] for j in budget.joints],
        components=[_build_budget_component(component, budget.joints) for component in budget.components],
        standard_uncertainty=included.uncertainty.tolist(),
        correlation=included.correlation.tolist(),
        probability=budget.probability,
        coverage_factor=budget.coverage_factor,
        expanded_uncertainty=(budget.coverage_factor * included.uncertainty).tolist(),
        missing=_list_missing_contributions(budget, reasons),
        expanded_with_model_error=(budget.coverage_factor * with_model_error.uncertainty).tolist(),
    )


def _select_joints(spread: Spread, joints: IndexArray) -> Spread:
    """Return the uncertainty of some joints, from that of all n joints."""
    return Spread(spread.covariance[np.ix_(joints, joints)])


def _build_budget_component(component: BudgetComponent, joints: IndexArray) -> runs.BudgetComponent:
    """Build the message of one source of uncertainty, for the joints with an estimate.

    For example the load point moves the compliances of q joints by `responses` (q, 3) for one standard
    uncertainty along each of its axes; other sources have no such directions.
    """
    of_joints = _select_joints(component, joints)
    responses = None
    if component.responses is not None:
        responses = component.responses[joints].tolist()
    return runs.BudgetComponent(
        source=component.source,
        evaluation=component.evaluation,
        included=component.included,
        degrees_of_freedom=finite_or_none(component.degrees_of_freedom),
        contributions=of_joints.uncertainty.tolist(),
        correlation=of_joints.correlation.tolist(),
        responses=responses,
    )


def _list_missing_contributions(
    budget: UncertaintyBudget, reasons: Iterable[Finding]
) -> list[runs.BudgetGap]:
    """Return the names of contributions to the uncertainty that the budget does not include."""
    missing: list[runs.BudgetGap] = []
    has_model_error = any(part.source == "model_error" for part in budget.components)
    if not has_model_error:
        missing.append("model_error")
    shows_lack_of_fit = any(
        reason.code in _LACK_OF_FIT or reason.weight == "do_not_use" for reason in reasons
    )
    if shows_lack_of_fit:
        missing.append("lack_of_fit")
    return missing
