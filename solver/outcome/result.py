"""Messages of a run's result, filled field by field from what a run found and from its assessment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jointstiff.schemas import run as runs
from jointstiff.schemas.finding import Assessment as StatedAssessment
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.model import IdentifiedModel
from jointstiff.schemas.run import RunResult
from jointstiff.solver.evidence.scatter import Repeatability
from jointstiff.solver.evidence.structure import Apart, build_parts
from jointstiff.solver.fit.estimate import (
    ComplementaryStiffness,
    Estimate,
    JointCompliance,
    Prediction,
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
        details: further fields of the message, which only some models have.
    """
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
        **({"characteristic_length": None} | dict(details)),
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
    estimate, measurements = found.estimate, found.rows.measurements
    prediction = assessment.drop_meaningless_numbers(found.prediction)
    names = [joint.name for joint in estimate.joints]
    numbers = Numbers(
        joints=estimate.joints,
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        sigma=estimate.sigma,
        goodness=_build_goodness(estimate, Repeatability.from_rows(found.rows, estimate.sigma)),
        identifiability=_build_identifiability(estimate, advice),
        certificate=estimate.certificate,
        complementary_stiffness=_build_complementary_stiffness(estimate.complementary_stiffness),
        residuals=_build_residuals(prediction, measurements),
        model=build_stored_model(found.predictor, found.model_error),
    )
    contributions: list[runs.Contribution] = []
    if prediction.contributions is not None:
        contributions = build_messages(runs.Contribution, joint=names, **vars(prediction.contributions))
    robust = estimate.robust
    details = {
        "joint_kinds": list_joint_kinds(names, [joint.kind for joint in estimate.joints]),
        "characteristic_length": estimate.characteristic_length,
        "huber_threshold": None if robust is None else robust.threshold,
        "suspicious": list_suspicious_readings(estimate, measurements),
        "suspicious_count": 0 if robust is None else len(robust.suspicious),
        "resampling": resampling,
        "links": found.links,
        "choice": found.choice,
        "causes": list(found.screening.tests),
        "contributions": contributions,
        "encoder_residuals": _build_encoder_residuals(prediction, measurements, names),
        "gearboxes": _build_parts(found.apart, 0, names, assessment),
        "structures": _build_parts(found.apart, 1, names, assessment),
        "budget": build_budget_message(found.budget, names, assessment.reasons),
    }
    warnings = (*_list_warnings(found, assessment, noticed), *assessment.remarks, *found.remarks)
    return build_run_result(numbers, assessment, warnings, details)


def _list_warnings(found: Found, assessment: Assessment, noticed: Sequence[Finding]) -> list[Finding]:
    """Return the findings of the integrity checks that the fitted model leaves.

    Outliers of joints alone are kept only if links leave these readings unexplained, too.
    """
    only_joints_bend = found.links is None
    links_leave_outliers = any(reason.code in _OUTLYING for reason in assessment.reasons)
    if only_joints_bend or links_leave_outliers:
        return list(noticed)
    return [finding for finding in noticed if finding.code != "residual_outlier"]


def build_joint_results(assessment: Assessment, joints: Sequence[JointCompliance]) -> list[runs.JointResult]:
    """Build the message of each joint's result.

    If the assessment says not to use the result, the reason does not state the lower limit of the stiffness.
    """
    reasons = [joint.reason for joint in joints]
    limit_is_meaningless = assessment.verdict == "do_not_use"
    if limit_is_meaningless:
        reasons = [joint.reason_without_limit for joint in joints]
    return build_messages(
        runs.JointResult,
        name=[joint.name for joint in joints],
        kind=[joint.kind for joint in joints],
        status=[joint.status for joint in joints],
        verdict=assessment.joints,
        compliance=[joint.compliance for joint in joints],
        stiffness=[joint.stiffness for joint in joints],
        standard_uncertainty=[joint.standard_uncertainty for joint in joints],
        compliance_interval=[joint.compliance_interval for joint in joints],
        stiffness_interval=[joint.stiffness_interval for joint in joints],
        stiffness_at_least=[joint.stiffness_at_least for joint in joints],
        prior_to_data=[joint.prior_to_data for joint in joints],
        reason=reasons,
    )


def build_assessment_message(assessment: Assessment, joints: Sequence[JointCompliance]) -> StatedAssessment:
    """Convert an assessment to a message: verdict, reasons, notes, and the number of identified joints."""
    return StatedAssessment(
        verdict=assessment.verdict,
        reasons=list(assessment.reasons),
        joints_identified=runs.count_identified_joints(joints),
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
        stages=[
            runs.StageIdentifiability(
                rank=stage.rank,
                condition_number=finite_or_none(stage.condition_number),
                singular_values=stage.singular_values.tolist(),
            )
            for stage in estimate.identifiability
        ],
    )


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
    apart: Apart | None, part: int, names: Sequence[str], assessment: Assessment
) -> list[runs.JointResult]:
    """Build one message for each joint that is taken apart, with a verdict no better than the run's.

    Args:
        apart: compliances of gearboxes and structure of some joints; None without encoders.
        part: 0 for gearboxes, 1 for structure.
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
    estimated, factor = budget.joints, budget.coverage_factor
    # Rows of the spread: each component, then the sum of the included components, then the sum of all.
    *component_uncertainties, included, with_model_error = budget.spread.uncertainty[:, estimated]
    correlations = budget.spread.correlation[:, estimated][:, :, estimated]
    *component_correlations, correlation, _ = correlations
    rows = zip(budget.components, component_uncertainties, component_correlations, strict=True)
    components = []
    for part, uncertainty, correlation_of_part in rows:
        responses = None if part.responses is None else part.responses[estimated].tolist()
        component = runs.BudgetComponent(
            source=part.source,
            evaluation=part.evaluation,
            included=part.included,
            degrees_of_freedom=finite_or_none(part.degrees_of_freedom),
            contributions=uncertainty.tolist(),
            correlation=correlation_of_part.tolist(),
            responses=responses,
        )
        components.append(component)
    return runs.Budget(
        joints=[names[j] for j in estimated],
        components=components,
        standard_uncertainty=included.tolist(),
        correlation=correlation.tolist(),
        probability=budget.probability,
        coverage_factor=factor,
        expanded_uncertainty=(factor * included).tolist(),
        missing=_list_missing_contributions(budget, reasons),
        expanded_with_model_error=(factor * with_model_error).tolist(),
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
