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
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.reliability import LeastMistake, find_least_mistakes
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
    unseen: tuple[LeastMistake, ...] = ()  #: mistakes that the tests hardly find; none with links
    links: LinksResult | None = None  #: result for links and base; None if only joints bend
    remarks: tuple[Finding, ...] = ()  #: findings on the choice of penalty and loss
    apart: Apart | None = None  #: gearboxes and structure apart; None with links, or without encoders


def find_joints(joints: JointsAlone, screening: Screening, choice: ModelChoice) -> Found:
    """Gather the evidence for a model in which only joints bend.

    Where this model does not fit the readings, the model error widens the intervals of the compliances.

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
    jackknife = None  # fits that each leave out one posture; None if such a fit fails
    error: ModelError | JointstiffError
    try:
        error = estimate_error_by_leaving_postures_out(rows, settings, estimate, predictor)
        jackknife = error.left_out
    except JointstiffError as failure:  # the run is valid without a model error; predictions say why
        error = failure
    has_lack_of_fit = screening.lack_of_fit and joints.are_sound
    budget = UncertaintyBudget.from_estimate(
        estimate, settings.confidence, jackknife, lack_of_fit=has_lack_of_fit
    )
    if budget is not None and has_lack_of_fit:
        estimate = budget.widen_intervals(estimate, settings.bounds)
    # Smallest mistakes in loads and readings that the tests would find; empty if the tests found something.
    least_mistakes: tuple[LeastMistake, ...] = ()
    if not (screening.causes or screening.lack_of_fit) and joints.are_sound:
        prior = None if settings.prior is None else settings.prior.in_units_of(estimate.sigma or 1.0)
        # The tests of causes account for scatter only where the residuals show it.
        tested = rows if joints.shows_scatter else joints.given
        least_mistakes = find_least_mistakes(tested, estimate, len(screening.tests), prior)
    return Found(
        rows=rows,
        estimate=estimate,
        prediction=predict(
            rows.at(estimate.balanced),
            estimate.compliance,
            is_estimated=estimate.estimated,
            statements=estimate.statements,
        ),
        predictor=predictor,
        model_error=error,
        choice=choice,
        screening=screening,
        budget=budget,
        unseen=least_mistakes,
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
    coupled = fit.coupled_joints
    return Found(
        rows=rows,
        estimate=replace_by_effective(joints.estimate, fit, elastic.effective),
        prediction=fit.prediction,
        predictor=ElasticPredictor.from_estimate(rows.robot, fit),
        model_error=error,
        choice=describe_choice_by_comparison(winner, screening),
        screening=screening,
        links=LinksResult(
            loss_source="cross_validation" if competition.loss_is_compared else "given",
            penalty=fit.penalty,
            penalty_source="given" if competition.penalty_is_given else "cross_validation",
            coupled_joints=None if coupled is None else coupled.tolist(),
            links=list(fit.links),
            base=fit.base,
            elements=list(fit.elements),
            unexplained=fit.unexplained,
            effective_freedom=fit.effective_freedom,
            parameters=fit.parameters,
            certificate=fit.certificate,
        ),
        remarks=tuple(_list_remarks_on_choice(competition, winner, elastic, rows)),
    )


def _list_remarks_on_choice(
    competition: Competition, winner: Winner, elastic: Elastic, rows: Rows
) -> list[Finding]:
    """Return findings on a penalty at an end of its range, and on losses that were not compared."""
    if competition.penalty_is_given:
        return []
    penalty = elastic.estimate.penalty
    remarks = list(report_penalty(winner.held_out.penalty or penalty, penalty))
    if competition.loss_is_automatic:
        remarks += report_losses(int(rows.measurements.present.sum()))
    return remarks


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
