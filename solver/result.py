"""Messages of a run's result, filled field by field from estimate, prediction and assessment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas import run as runs
from jointstiff.schemas.finding import Assessment as StatedAssessment
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.model import IdentifiedModel, LinksResult, ScoredModel
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.schemas.run import ModelChoice, RunResult
from jointstiff.solver.choice.competition import Competition, Elastic, Winner
from jointstiff.solver.choice.held_out import report_losses, report_penalty
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.reliability import LeastMistake, find_least_mistakes
from jointstiff.solver.evidence.scatter import Repeatability
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit.effective import replace_by_effective
from jointstiff.solver.fit.estimate import (
    ComplementaryStiffness,
    Estimate,
    JointCompliance,
    Prediction,
    UncertaintyBudget,
    predict,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.messages import build_messages, finite_or_none, list_joint_kinds
from jointstiff.solver.predict.answers import build_stored_model
from jointstiff.solver.predict.models import (
    ElasticPredictor,
    JointModel,
    ModelError,
    estimate_error_by_leaving_folds_out,
    estimate_error_by_leaving_postures_out,
)
from jointstiff.solver.rules import Assessment, assess
from jointstiff.solver.text import length_text

MAX_SUSPICIOUS: Final = 100
"""Greatest number of suspicious readings that a result lists; it counts all of them."""
_OUTLYING: Final = frozenset({"residual_outlier", "deflection_unexplained"})
"""Codes of reasons which show that elastic links leave readings unexplained, too."""


@dataclass(frozen=True, eq=False)
class RunOutcome:
    """Outcome of an identification: the model, the compliances with intervals, and the evidence for them."""

    estimate: Estimate  #: compliances of the joints; effective ones where links bend
    prediction: Prediction  #: prediction of the same readings, as far as the evidence supports it
    assessment: Assessment
    warnings: tuple[Finding, ...]  #: warnings about the set, then about the fit
    model: IdentifiedModel
    choice: ModelChoice
    screening: Screening
    #: scatter of the joints from posture to posture; None if there is none
    repeatability: Repeatability | None
    budget: UncertaintyBudget | None = None  #: None with links, or where sigma is unknown
    unseen: tuple[LeastMistake, ...] = ()  #: mistakes that the tests hardly find; none with links
    links: LinksResult | None = None  #: result for links and base; None if only joints bend


def report_joints_alone(joints: JointsAlone, screening: Screening, choice: ModelChoice) -> RunOutcome:
    """Build the outcome of a run in which only joints bend.

    Where this model does not fit the readings, the model error widens the intervals of the compliances.

    Args:
        joints: fit of the joints alone.
        screening: tests of the residuals; if models were compared, also how much better links predict
            held-out postures.
        choice: model and loss of the run, with a message that explains why only joints are assumed to bend.

    Raises:
        JointstiffError: the identification of the joints fails.
    """
    robot, rows = joints.robot, joints.rows
    settings, estimate = joints.settings, joints.estimate
    model = JointModel.from_estimate(robot, estimate, settings.constraints)
    jackknife = None  # fits that each leave out one posture; None if such a fit fails
    error: ModelError | JointstiffError
    try:
        error = estimate_error_by_leaving_postures_out(rows, settings, estimate, model)
        jackknife = error.left_out
    except JointstiffError as failure:  # the run is valid without a model error; predictions say why
        error = failure
    has_lack_of_fit = screening.lack_of_fit and joints.are_sound
    budget = UncertaintyBudget.from_estimate(
        estimate, settings.confidence, jackknife, lack_of_fit=has_lack_of_fit
    )
    if budget is not None and has_lack_of_fit:
        estimate = budget.widen_intervals(estimate, settings.bounds)
    prediction = predict(
        rows.at(estimate.balanced),
        estimate.compliance,
        is_estimated=estimate.estimated,
        statements=estimate.statements,
    )
    # Smallest mistakes in loads and readings that the tests would find; empty if the tests found something.
    least_mistakes: tuple[LeastMistake, ...] = ()
    if not (screening.causes or screening.lack_of_fit) and joints.are_sound:
        prior = None if settings.prior is None else settings.prior.in_units_of(estimate.sigma or 1.0)
        least_mistakes = find_least_mistakes(rows, estimate, len(screening.tests), prior)
    assessment = assess(joints, estimate, prediction, screening, least_mistakes)
    return RunOutcome(
        estimate=estimate,
        prediction=assessment.drop_meaningless_numbers(prediction),
        assessment=assessment,
        warnings=(*joints.noticed, *assessment.remarks),
        model=build_stored_model(model, error),
        choice=choice,
        screening=screening,
        repeatability=Repeatability.from_rows(rows, estimate.sigma),
        budget=budget,
        unseen=least_mistakes,
    )


def report_elastic_model(
    joints: JointsAlone, competition: Competition, winner: Winner, elastic: Elastic, screening: Screening
) -> RunOutcome:
    """Build the outcome of a run whose elastic model predicts held-out postures better than joints alone.

    Args:
        joints: fit of the joints alone.
        competition: comparison of the models.
        winner: model that predicts held-out postures best.
        elastic: fit of this model to all readings.
        screening: tests of the residuals of joints alone.
    """
    # The scatter that residuals of joints alone show includes the bending of links, so it is not used here.
    robot, measurements, elastic_estimate = joints.robot, joints.given.measurements, elastic.estimate
    estimate = replace_by_effective(joints.estimate, elastic_estimate, elastic.effective)
    assessment = assess(joints, estimate, elastic_estimate.prediction, screening)
    # Outliers of joints alone are kept only if links leave these readings unexplained, too.
    has_outliers = any(reason.code in _OUTLYING for reason in assessment.reasons)
    warnings = [each for each in joints.noticed if has_outliers or each.code != "residual_outlier"]
    warnings += assessment.remarks
    if not competition.penalty_is_given:
        warnings += report_penalty(
            winner.held_out.penalty or elastic_estimate.penalty, elastic_estimate.penalty
        )
        if competition.loss_is_automatic:
            warnings += report_losses(int(measurements.present.sum()))
    error: ModelError | JointstiffError
    try:
        error = estimate_error_by_leaving_folds_out(joints.given, elastic_estimate)
    except JointstiffError as failure:  # the run is valid without a model error; predictions say why
        error = failure
    return RunOutcome(
        estimate=estimate,
        prediction=elastic_estimate.prediction,
        assessment=assessment,
        warnings=tuple(warnings),
        model=build_stored_model(ElasticPredictor.from_estimate(robot, elastic_estimate), error),
        choice=describe_choice_by_comparison(winner, screening),
        screening=screening,
        repeatability=Repeatability.from_rows(joints.given, estimate.sigma),
        links=LinksResult(
            loss_source="cross_validation" if competition.loss_is_compared else "given",
            penalty=elastic_estimate.penalty,
            penalty_source="given" if competition.penalty_is_given else "cross_validation",
            coupled_joints=None
            if elastic_estimate.coupled_joints is None
            else elastic_estimate.coupled_joints.tolist(),
            links=list(elastic_estimate.links),
            base=elastic_estimate.base,
            elements=list(elastic_estimate.elements),
            unexplained=elastic_estimate.unexplained,
            effective_freedom=elastic_estimate.effective_freedom,
            parameters=elastic_estimate.parameters,
            certificate=elastic_estimate.certificate,
        ),
    )


def describe_choice_of_joints(options: RunOptions, screening: Screening, excluded: str | None) -> ModelChoice:
    """Build the message that explains why only joints are assumed to bend, where no models were compared.

    Args:
        options: options of the run.
        screening: tests of the residuals of joints alone.
        excluded: name of the option that rules out elastic links; None if no option does.
    """
    loss: Loss = "huber" if options.loss == "huber" else "squared"
    p = f"F test of links added to the joints: p = {screening.links_p_value:.1g}"
    if options.elasticity != "automatic":
        source, text = "given", f"The model has elastic joints alone, as requested ({p})."
    elif excluded is not None:
        source = "options"
        text = (
            "The model has elastic joints alone: elastic links cannot be combined with the option "
            f"{excluded.replace('_', ' ')} ({p})."
        )
    elif screening.links_p_value < LINKS_LEVEL:
        source = "screening"
        text = f"The model has elastic joints alone: first correct the mistake that the reasons name ({p})."
    else:
        source, text = (
            "screening",
            f"The model has elastic joints alone: no test shows that other parts bend ({p}).",
        )
    return ModelChoice(
        elasticity="joints",
        loss=loss,
        source=source,
        links_p_value=screening.links_p_value,
        message=text,
    )


def describe_choice_by_comparison(winner: Winner, screening: Screening) -> ModelChoice:
    """Build the message that names the model chosen by its errors on held-out postures, with all scores.

    Args:
        winner: chosen model, with the comparison of all models.
        screening: tests of the residuals of joints alone.
    """
    selection, chosen, elastic = winner.selection, winner.held_out, winner.elastic
    intervals = None if elastic is None else elastic.intervals
    name, gain = chosen.model.replace("_", " ").capitalize(), selection.gain
    evidence = f"F test of links added to the joints: p = {screening.links_p_value:.1g}"
    if gain is not None:
        evidence += (
            f"; held-out postures are predicted to {length_text(chosen.mean_residual)}, by joints "
            f"alone to {length_text(gain.error_of_joints)}"
        )
    remarks = "" if chosen.model == "joints" else " K_c is neglected."
    tied = selection.tied is not None and not winner.given
    if intervals == chosen.model and not tied:
        remarks += " The intervals of stiffness are computed with this model."
    elif tied:
        remarks += " The readings do not distinguish links from base: the intervals of stiffness "
        remarks += (
            "contain both models' values."
            if elastic is None or elastic.estimate.prediction.joined or intervals is None
            else f"are computed with {intervals.replace('_', ' ')} alone, because no optimum of the other "
            "model was certified."
        )
    elif intervals is not None:
        richer = intervals.replace("_", " ")
        remarks += (
            f" The intervals of stiffness are computed with {richer}, the richest of the models compared."
        )
    return ModelChoice(
        elasticity=chosen.model,
        loss=chosen.loss,
        source="given" if winner.given else "cross_validation",
        links_p_value=screening.links_p_value,
        message=f"{name}, loss {chosen.loss} ({evidence}).{remarks}",
        models=[
            ScoredModel(
                model=each.model,
                loss=each.loss,
                penalty=each.penalty,
                compensation=each.compensation,
                standard_error=each.standard_error,
                by_fold=each.by_fold.tolist(),
                mean_residual=finite_or_none(each.mean_residual),
            )
            for each in selection.models
        ],
        losses={scored.model: selection.find_held_out(scored.model).loss for scored in selection.models},
        best=selection.best,
        simplest=selection.simplest,
    )


def build_run_result(
    found: RunOutcome,
    measurements: Measurements,
    advice: Sequence[runs.Advice] = (),
    resampling: runs.ResamplingResult | None = None,
) -> RunResult:
    """Build the message of a run's result.

    Args:
        found: outcome of the identification.
        measurements: readings of the run.
        advice: further readings that would reduce the uncertainties most.
        resampling: statistics of resampled fits; None without resampling.
    """
    estimate, prediction, assessment = found.estimate, found.prediction, found.assessment
    names = [joint.name for joint in estimate.joints]
    kinds = [joint.kind for joint in estimate.joints]
    contributions: list[runs.Contribution] = []
    if prediction.contributions is not None:
        contributions = build_messages(runs.Contribution, joint=names, **vars(prediction.contributions))
    robust = estimate.robust
    return RunResult(
        assessment=build_assessment_message(assessment, estimate.joints),
        joint_kinds=list_joint_kinds(names, kinds),
        joints=list(build_joint_results(assessment, estimate.joints)),
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        sigma=estimate.sigma,
        goodness=_build_goodness(estimate, found.repeatability),
        identifiability=_build_identifiability(estimate, advice),
        certificate=estimate.certificate,
        characteristic_length=estimate.characteristic_length,
        complementary_stiffness=_build_complementary_stiffness(estimate.complementary_stiffness),
        huber_threshold=None if robust is None else robust.threshold,
        suspicious=list_suspicious_readings(estimate, measurements),
        suspicious_count=0 if robust is None else len(robust.suspicious),
        resampling=resampling,
        links=found.links,
        choice=found.choice,
        causes=list(_add_least_mistakes(found.screening.tests, found.unseen)),
        residuals=_build_residuals(prediction, measurements),
        contributions=contributions,
        encoder_residuals=_build_encoder_residuals(prediction, measurements, names),
        model=found.model,
        budget=build_budget_message(found.budget, names, assessment.reasons),
        warnings=list(found.warnings),
    )


def _add_least_mistakes(
    tests: Iterable[runs.CauseTest], mistakes: Sequence[LeastMistake]
) -> Iterator[runs.CauseTest]:
    """Yield the tests of causes with the least mistakes that they find."""
    by_name = {each.name: each for each in mistakes}
    for test in tests:
        least = by_name.get(test.name) if test.first is None else None
        if least is None:
            yield test
        else:
            found = {"least_found": least.size, "unit": least.unit, "joint": least.joint}
            yield test.model_copy(update=found | {"moves": least.moves})


def build_joint_results(
    assessment: Assessment, joints: Sequence[JointCompliance]
) -> Iterator[runs.JointResult]:
    """Yield the message of each joint's result.

    If the assessment says not to use the result, the reason does not state the lower limit of the stiffness.
    """
    for joint, verdict in zip(joints, assessment.joints, strict=True):
        reason = joint.reason
        if reason is not None and assessment.verdict == "do_not_use":
            reason = reason.removeprefix(joint.limit)  # the reason begins with the limit in words
        yield runs.JointResult(
            name=joint.name,
            kind=joint.kind,
            status=joint.status,
            verdict=verdict,
            compliance=joint.compliance,
            stiffness=joint.stiffness,
            standard_uncertainty=joint.standard_uncertainty,
            compliance_interval=joint.compliance_interval,
            stiffness_interval=joint.stiffness_interval,
            stiffness_at_least=joint.stiffness_at_least,
            prior_to_data=finite_or_none(joint.prior_to_data),
            reason=reason,
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
    i, t = np.nonzero(measurements.present)
    return build_messages(
        runs.Residual,
        observation=np.array(measurements.labels)[i],
        target=np.array(measurements.targets)[t],
        deflection=measurements.deflection[i, t],
        predicted=prediction.predicted[i, t],
        residual=prediction.residual[i, t],
    )


def _build_encoder_residuals(
    prediction: Prediction, measurements: Measurements, names: Sequence[str]
) -> list[runs.EncoderResidual]:
    """Build one message for each encoder reading: measured and predicted deflection of the joint.

    The list is empty if no encoder was read.
    """
    encoders = measurements.encoders
    if encoders is None or prediction.encoders is None:
        return []
    i, j = np.nonzero(encoders.present)
    measured, predicted = encoders.deflection[i, j], prediction.encoders[i, j]
    return build_messages(
        runs.EncoderResidual,
        observation=np.array(measurements.labels)[i],
        joint=np.array(names)[j],
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
    i, t = robust.suspicious[:MAX_SUSPICIOUS].T
    return build_messages(
        runs.SuspiciousReading,
        observation=np.array(measurements.labels)[i],
        target=np.array(measurements.targets)[t],
        weight=robust.weight[i, t],
        residual_norm=robust.residual_norm[i, t],
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
    # The rows of the spread are the components, the sum of the included components, and the sum of all.
    spread = budget.spread
    lack_of_fit = any(each.code in _LACK_OF_FIT or each.weight == "do_not_use" for each in reasons)
    uncertainty = spread.uncertainty[:, estimated]
    correlation = spread.correlation[:, estimated][..., estimated]
    missing: list[runs.BudgetGap] = []  # contributions that the budget does not include
    if all(part.source != "model_error" for part in budget.components):
        missing.append("model_error")
    if lack_of_fit:
        missing.append("lack_of_fit")
    return runs.Budget(
        joints=[names[j] for j in estimated],
        components=[
            runs.BudgetComponent(
                source=part.source,
                evaluation=part.evaluation,
                included=part.included,
                degrees_of_freedom=finite_or_none(part.degrees_of_freedom),
                contributions=contributions.tolist(),
                correlation=correlations.tolist(),
                responses=None if part.responses is None else part.responses[estimated].tolist(),
            )
            for part, contributions, correlations in zip(
                budget.components, uncertainty[:-2], correlation[:-2], strict=True
            )
        ],
        standard_uncertainty=uncertainty[-2].tolist(),
        correlation=correlation[-2].tolist(),
        probability=budget.probability,
        coverage_factor=factor,
        expanded_uncertainty=(factor * uncertainty[-2]).tolist(),
        missing=missing,
        expanded_with_model_error=(factor * uncertainty[-1]).tolist(),
    )
