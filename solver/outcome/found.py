"""Fitted model of a run with the evidence for it, before any verdict."""

from __future__ import annotations

from dataclasses import dataclass

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.model import LinksResult, ScoredModel
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.schemas.run import ModelChoice
from jointstiff.solver.choice.competition import Competition, Elastic, Winner
from jointstiff.solver.choice.held_out import report_losses, report_penalty
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.doubt import PointDoubt, find_doubt
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.structure import Apart
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit.effective import replace_by_effective
from jointstiff.solver.fit.estimate import Estimate, Prediction, UncertaintyBudget, predict
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.messages import finite_or_none
from jointstiff.solver.predict.models import (
    ElasticPredictor,
    JointModel,
    ModelError,
    estimate_error_by_leaving_folds_out,
    estimate_error_by_leaving_postures_out,
)
from jointstiff.solver.text import length_text


@dataclass(frozen=True, eq=False)
class Found:
    """Fitted model of a run: the compliances with intervals, and the evidence for them."""

    rows: Rows  #: observations, with the noise of the fit
    estimate: Estimate  #: compliances of the joints; effective ones where links bend
    prediction: Prediction  #: prediction of the same readings
    predictor: JointModel | ElasticPredictor  #: model that predicts other loads and postures
    model_error: ModelError | JointstiffError  #: model error, or why it is not known
    choice: ModelChoice  #: model and loss of the run, and why they were chosen
    screening: Screening  #: tests of what joints alone leave unexplained
    budget: UncertaintyBudget | None = None  #: None with links, or where sigma is unknown
    doubt: PointDoubt | None = None  #: doubt about the stated load point; None with links
    links: LinksResult | None = None  #: result for links and base; None if only joints bend
    remarks: tuple[Finding, ...] = ()  #: findings on the choice of penalty and loss
    apart: Apart | None = None  #: gearboxes and structure apart; None with links, or without encoders


def find_joints(joints: JointsAlone, screening: Screening, choice: ModelChoice) -> Found:
    """Gather the evidence for a model in which only joints bend.

    Where this model does not fit the readings, the model error widens the intervals of the compliances, but
    not after a gross mistake in the data, which gives a lack of fit no meaning. The model error is that of
    fits that each leave out one posture; if such a fit fails, the run is valid without a model error.

    Args:
        joints: fit of the joints alone.
        screening: tests of the residuals; if models were compared, also how much better links predict
            held-out postures.
        choice: model and loss of the run, with a message that explains why only joints are assumed to bend.

    Raises:
        JointstiffError: the identification of the joints fails.
    """
    rows, settings, estimate = joints.rows, joints.settings, joints.estimate
    predictor = JointModel.from_estimate(rows.robot, estimate, settings.constraints)
    fits_without_a_posture = None
    error: ModelError | JointstiffError
    try:
        error = estimate_error_by_leaving_postures_out(rows, settings, estimate, predictor)
        fits_without_a_posture = error.left_out
    except JointstiffError as failure:  # predictions say why there is no model error
        error = failure
    has_lack_of_fit = screening.lack_of_fit and joints.are_sound
    budget = UncertaintyBudget.from_estimate(
        estimate, settings.confidence, fits_without_a_posture, lack_of_fit=has_lack_of_fit
    )
    if budget is not None and has_lack_of_fit:
        estimate = budget.widen_intervals(estimate, settings.bounds)
    # Causes that are found explain more than a doubt does.
    is_explained = bool(screening.causes) or screening.lack_of_fit
    doubt = None if is_explained or not joints.are_sound else find_doubt(joints.tested, estimate)
    prediction = predict(
        rows.at(estimate.balanced),
        estimate.compliance,
        is_estimated=estimate.estimated,
        statements=estimate.statements,
    )
    return Found(
        rows=rows,
        estimate=estimate,
        prediction=prediction,
        predictor=predictor,
        model_error=error,
        choice=choice,
        screening=screening,
        budget=budget,
        doubt=doubt,
        apart=joints.apart,
    )


def find_elastic(
    joints: JointsAlone, competition: Competition, winner: Winner, elastic: Elastic, screening: Screening
) -> Found:
    """Gather the evidence for an elastic model that predicts held-out postures better than joints alone.

    Args:
        joints: fit of the joints alone.
        competition: comparison of the models.
        winner: model that predicts held-out postures best.
        elastic: fit of this model to all readings.
        screening: tests of the residuals of joints alone.
    """
    # The scatter that residuals of joints alone show includes the bending of links, so it is not used here.
    rows, fit = joints.given, elastic.estimate
    error: ModelError | JointstiffError
    try:
        error = estimate_error_by_leaving_folds_out(rows, fit)
    except JointstiffError as failure:  # the run is valid without a model error; predictions say why
        error = failure
    coupled_joints = fit.coupled_joints
    links = LinksResult(
        loss_source="cross_validation" if competition.loss_is_compared else "given",
        penalty=fit.penalty,
        penalty_source="given" if competition.penalty_is_given else "cross_validation",
        coupled_joints=None if coupled_joints is None else coupled_joints.tolist(),
        links=list(fit.links),
        base=fit.base,
        elements=list(fit.elements),
        unexplained=fit.unexplained,
        effective_freedom=fit.effective_freedom,
        parameters=fit.parameters,
        certificate=fit.certificate,
    )
    return Found(
        rows=rows,
        estimate=replace_by_effective(joints.estimate, fit, elastic.effective),
        prediction=fit.prediction,
        predictor=ElasticPredictor.from_estimate(rows.robot, fit),
        model_error=error,
        choice=describe_choice_by_comparison(winner, screening),
        screening=screening,
        links=links,
        remarks=tuple(_list_remarks_on_choice(competition, winner, elastic, rows)),
    )


def _list_remarks_on_choice(
    competition: Competition, winner: Winner, elastic: Elastic, rows: Rows
) -> list[Finding]:
    """Return findings on a penalty at an end of its range, and on losses that were not compared."""
    if competition.penalty_is_given:
        return []
    penalty_of_fit = elastic.estimate.penalty
    penalty_by_comparison = winner.held_out.penalty or penalty_of_fit
    remarks = list(report_penalty(penalty_by_comparison, penalty_of_fit))
    if competition.loss_is_automatic:
        reading_count = int(rows.measurements.present.sum())
        remarks += report_losses(reading_count)
    return remarks


def describe_choice_of_joints(options: RunOptions, screening: Screening, excluded: str | None) -> ModelChoice:
    """Build the message that explains why only joints are assumed to bend, where no models were compared.

    Args:
        options: options of the run.
        screening: tests of the residuals of joints alone.
        excluded: name of the option that rules out elastic links; None if no option does.
    """
    loss: Loss = "huber" if options.loss == "huber" else "squared"
    if options.elasticity != "automatic":
        source, why = "given", ", as requested"
    elif excluded is not None:
        option = excluded.replace("_", " ")
        source, why = "options", f": elastic links cannot be combined with the option {option}"
    elif screening.links_p_value < LINKS_LEVEL:
        source, why = "screening", ": first correct the mistake that the reasons name"
    else:
        source, why = "screening", ": no test shows that other parts bend"
    evidence = f"F test of links added to the joints: p = {screening.links_p_value:.1g}"
    return ModelChoice(
        elasticity="joints",
        loss=loss,
        source=source,
        links_p_value=screening.links_p_value,
        message=f"The model has elastic joints alone{why} ({evidence}).",
    )


def describe_choice_by_comparison(winner: Winner, screening: Screening) -> ModelChoice:
    """Build the message that names the model chosen by its errors on held-out postures, with all scores.

    Args:
        winner: chosen model, with the comparison of all models.
        screening: tests of the residuals of joints alone.
    """
    selection, chosen = winner.selection, winner.held_out
    name, gain = chosen.model.replace("_", " ").capitalize(), selection.gain
    evidence = f"F test of links added to the joints: p = {screening.links_p_value:.1g}"
    if gain is not None:
        evidence += (
            f"; held-out postures are predicted to {length_text(chosen.mean_residual)}, by joints "
            f"alone to {length_text(gain.error_of_joints)}"
        )
    k_c_remark = "" if chosen.model == "joints" else " K_c is neglected."
    scored_models = [
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
    ]
    return ModelChoice(
        elasticity=chosen.model,
        loss=chosen.loss,
        source="given" if winner.given else "cross_validation",
        links_p_value=screening.links_p_value,
        message=f"{name}, loss {chosen.loss} ({evidence}).{k_c_remark}{_describe_intervals(winner)}",
        models=scored_models,
        losses={scored.model: selection.find_held_out(scored.model).loss for scored in selection.models},
        best=selection.best,
        simplest=selection.simplest,
    )


def _describe_intervals(winner: Winner) -> str:
    """Return a sentence on the model with which the intervals of stiffness were computed; "" for joints.

    If the readings do not distinguish links from base, the intervals contain the values of both models,
    unless one of the two has no certified optimum.
    """
    elastic = winner.elastic
    interval_model = None if elastic is None else elastic.intervals
    model_text = "" if interval_model is None else interval_model.replace("_", " ")
    if winner.selection.tied is not None and not winner.given:
        both_models_count = elastic is None or elastic.estimate.prediction.joined or interval_model is None
        intervals = "contain both models' values."
        if not both_models_count:
            intervals = (
                f"are computed with {model_text} alone, because no optimum of the other model was certified."
            )
        return f" The readings do not distinguish links from base: the intervals of stiffness {intervals}"
    if interval_model == winner.held_out.model:
        return " The intervals of stiffness are computed with this model."
    if interval_model is not None:
        return (
            f" The intervals of stiffness are computed with {model_text}, the richest of the models compared."
        )
    return ""
