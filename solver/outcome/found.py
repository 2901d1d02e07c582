"""Fitted model of a run with the evidence for it, before any verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.model import LinksResult, ScoredModel
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.schemas.run import JointAlone, JointsAloneResult, ModelChoice
from jointstiff.solver.choice.competition import Competition, Elastic, Winner
from jointstiff.solver.choice.held_out import HeldOut, report_losses, report_penalty
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.doubt import PointDoubt, find_doubt
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.structure import Apart
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit.effective import replace_by_effective
from jointstiff.solver.fit.elastic import ElasticFit
from jointstiff.solver.fit.estimate import Estimate, Prediction, UncertaintyBudget, predict
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.messages import build_messages, finite_or_none
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
    alone: JointsAloneResult | None = None  #: fit by joints alone, with links; None if only joints bend
    remarks: tuple[Finding, ...] = ()  #: findings on the choice of penalty and loss
    apart: Apart | None = None  #: gearboxes and structure apart; None with links, or without encoders


def find_joints(joints: JointsAlone, screening: Screening, choice: ModelChoice) -> Found:
    """Gather the evidence for a model in which only joints bend.

    Where this model does not fit the readings, the model error widens the intervals of the compliances, but
    not after a gross mistake in the data, which gives a lack of fit no meaning.

    Args:
        joints: fit of the joints alone.
        screening: tests of the residuals; if models were compared, also how much better links predict
            held-out postures.
        choice: model and loss of the run, with a message that explains why only joints are assumed to bend.

    Raises:
        JointstiffError: the identification of the joints fails.
    """
    predictor = JointModel.from_estimate(joints.rows.robot, joints.estimate, joints.settings.constraints)
    model_error = _estimate_error_of_joints(joints, predictor)
    has_lack_of_fit = screening.lack_of_fit and joints.has_sound_data
    budget = _build_budget(joints, model_error, has_lack_of_fit=has_lack_of_fit)
    estimate = joints.estimate
    if budget is not None and has_lack_of_fit:
        estimate = budget.widen_intervals(estimate, joints.settings.bounds)
    return Found(
        rows=joints.rows,
        estimate=estimate,
        prediction=_predict_readings(joints.rows, estimate),
        predictor=predictor,
        model_error=model_error,
        choice=choice,
        screening=screening,
        budget=budget,
        doubt=_find_doubt(joints, estimate, screening),
        apart=joints.apart,
    )


def _estimate_error_of_joints(joints: JointsAlone, predictor: JointModel) -> ModelError | JointstiffError:
    """Return the error of the joints' predictions, from fits that each leave out one posture.

    If such a fit fails, the run is valid without a model error: the failure is returned, so that predictions
    can say why there is none.
    """
    try:
        return estimate_error_by_leaving_postures_out(
            joints.rows, joints.settings, joints.estimate, predictor
        )
    except JointstiffError as failure:
        return failure


def _build_budget(
    joints: JointsAlone, model_error: ModelError | JointstiffError, *, has_lack_of_fit: bool
) -> UncertaintyBudget | None:
    """Return the uncertainty budget of the compliances; None if sigma is unknown.

    The budget lists the model error where the error is known, and includes it in the standard uncertainties
    if joints alone do not fit the readings.
    """
    fits_without_a_posture = None
    if isinstance(model_error, ModelError):
        fits_without_a_posture = model_error.left_out
    return UncertaintyBudget.from_estimate(
        joints.estimate, joints.settings.confidence, fits_without_a_posture, lack_of_fit=has_lack_of_fit
    )


def _find_doubt(joints: JointsAlone, estimate: Estimate, screening: Screening) -> PointDoubt | None:
    """Return the doubt about the stated load point; None if something else explains the residuals better.

    Causes that were found, links that bend and mistakes in the data all explain more than a doubt does.
    """
    is_explained = bool(screening.causes) or screening.lack_of_fit
    if is_explained or not joints.has_sound_data:
        return None
    return find_doubt(joints.tested, estimate)


def _predict_readings(rows: Rows, estimate: Estimate) -> Prediction:
    """Return what the estimated joints predict for the readings from which they were estimated."""
    return predict(
        rows.at(estimate.balanced),
        estimate.compliance,
        is_estimated=estimate.estimated,
        statements=estimate.statements,
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
    return Found(
        rows=rows,
        estimate=replace_by_effective(joints.estimate, fit, elastic.effective),
        prediction=fit.prediction,
        predictor=ElasticPredictor.from_estimate(rows.robot, fit),
        model_error=_estimate_error_of_elastic(rows, fit),
        choice=describe_choice_by_comparison(winner, screening),
        screening=screening,
        links=_build_links_result(competition, fit),
        alone=_describe_joints_alone(joints, winner),
        remarks=tuple(_list_remarks_on_choice(competition, winner, elastic, rows)),
    )


def _describe_joints_alone(joints: JointsAlone, winner: Winner) -> JointsAloneResult:
    """Return the fit by joints alone, with the loss that predicts held-out postures best."""
    held_out = winner.selection.find_held_out("joints", ("squared", "huber"))
    loss: Loss = "huber" if held_out.loss == "huber" else "squared"
    estimate = joints.with_loss(loss).estimate
    columns = {name: [getattr(joint, name) for joint in estimate.joints] for name in JointAlone.model_fields}
    return JointsAloneResult(joints=build_messages(JointAlone, **columns), compensation=held_out.compensation)


def _estimate_error_of_elastic(rows: Rows, fit: ElasticFit) -> ModelError | JointstiffError:
    """Return the error of an elastic model's predictions, from fits that each leave out a group of postures.

    If such a fit fails, the run is valid without a model error: the failure is returned, so that predictions
    can say why there is none.
    """
    try:
        return estimate_error_by_leaving_folds_out(rows, fit)
    except JointstiffError as failure:
        return failure


def _build_links_result(competition: Competition, fit: ElasticFit) -> LinksResult:
    """Build the message of the compliances of links and base, with the origin of loss and penalty."""
    coupled_joints = fit.coupled_joints
    return LinksResult(
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


def _list_remarks_on_choice(
    competition: Competition, winner: Winner, elastic: Elastic, rows: Rows
) -> list[Finding]:
    """Return findings on a penalty at an end of its range, and on losses that were not compared.

    A request that gives the penalty leaves nothing to choose, so that there is nothing to remark.
    """
    if competition.penalty_is_given:
        return []
    penalty_of_fit = elastic.estimate.penalty
    penalty_by_comparison = winner.held_out.penalty or penalty_of_fit
    remarks = list(report_penalty(penalty_by_comparison, penalty_of_fit))
    if competition.loss_is_automatic:
        reading_count = int(rows.measurements.present.sum())
        remarks += report_losses(reading_count)
    return remarks


class _Grounds(NamedTuple):
    """Reason why a model was chosen without a comparison of models."""

    source: Literal["given", "options", "screening"]  # what chose the model
    words: str  # continuation of "The model has elastic joints alone"


def _find_grounds_for_joints(options: RunOptions, screening: Screening, excluded: str | None) -> _Grounds:
    """Return why only joints are assumed to bend: the request, an option, or the tests of the residuals.

    `excluded` is the name of the option that rules out elastic links; None if no option does.
    """
    if options.elasticity != "automatic":
        return _Grounds("given", ", as requested")
    if excluded is not None:
        option = excluded.replace("_", " ")
        return _Grounds("options", f": elastic links cannot be combined with the option {option}")
    if screening.links_p_value < LINKS_LEVEL:  # links seem to bend, but a mistake makes them seem so
        return _Grounds("screening", ": first correct the mistake that the reasons name")
    return _Grounds("screening", ": no test shows that other parts bend")


def describe_choice_of_joints(options: RunOptions, screening: Screening, excluded: str | None) -> ModelChoice:
    """Build the message that explains why only joints are assumed to bend, where no models were compared.

    Args:
        options: options of the run.
        screening: tests of the residuals of joints alone.
        excluded: name of the option that rules out elastic links; None if no option does.
    """
    loss: Loss = "huber" if options.loss == "huber" else "squared"
    grounds = _find_grounds_for_joints(options, screening, excluded)
    return ModelChoice(
        elasticity="joints",
        loss=loss,
        source=grounds.source,
        links_p_value=screening.links_p_value,
        message=f"The model has elastic joints alone{grounds.words} ({_describe_test_of_links(screening)}).",
    )


def _describe_test_of_links(screening: Screening) -> str:
    """Return the result of the test of links in words, such as `F test of links …: p = 0.2`."""
    return f"F test of links added to the joints: p = {screening.links_p_value:.1g}"


def describe_choice_by_comparison(winner: Winner, screening: Screening) -> ModelChoice:
    """Build the message that names the model chosen by its errors on held-out postures, with all scores.

    Args:
        winner: chosen model, with the comparison of all models.
        screening: tests of the residuals of joints alone.
    """
    selection, chosen = winner.selection, winner.held_out
    return ModelChoice(
        elasticity=chosen.model,
        loss=chosen.loss,
        source="given" if winner.given else "cross_validation",
        links_p_value=screening.links_p_value,
        message=_describe_winner(winner, screening),
        models=[_build_scored_model(each) for each in selection.models],
        losses={each.model: selection.find_held_out(each.model).loss for each in selection.models},
        best=selection.best,
        simplest=selection.simplest,
    )


def _describe_winner(winner: Winner, screening: Screening) -> str:
    """Return the winning model in words, with the evidence for it and the model of its intervals.

    For example: `Joints and links, loss squared (F test of links …; held-out postures are predicted to …).`
    """
    chosen = winner.held_out
    name = chosen.model.replace("_", " ").capitalize()
    evidence = _describe_test_of_links(screening)
    gain = winner.selection.gain
    if gain is not None:
        evidence += (
            f"; held-out postures are predicted to {length_text(chosen.mean_residual)}, by joints "
            f"alone to {length_text(gain.error_of_joints)}"
        )
    remark = "" if chosen.model == "joints" else " K_c is neglected."
    return f"{name}, loss {chosen.loss} ({evidence}).{remark}{_describe_intervals(winner)}"


def _build_scored_model(held_out: HeldOut) -> ScoredModel:
    """Build the message of one model's errors on held-out postures."""
    return ScoredModel(
        model=held_out.model,
        loss=held_out.loss,
        penalty=held_out.penalty,
        compensation=held_out.compensation,
        standard_error=held_out.standard_error,
        by_fold=held_out.by_fold.tolist(),
        mean_residual=finite_or_none(held_out.mean_residual),
    )


def _describe_intervals(winner: Winner) -> str:
    """Return a sentence on the model with which the intervals of stiffness were computed; "" for joints."""
    if winner.selection.tied is not None and not winner.given:
        return _describe_intervals_of_tie(winner.elastic)
    model = None if winner.elastic is None else winner.elastic.intervals
    if model is None:
        return ""
    if winner.given:
        name = model.replace("_", " ")
        return (
            f" The request names {name}: the intervals are those of this model, and wrong if another is true."
        )
    if model == winner.held_out.model:
        return " The intervals of stiffness are computed with this model."
    name = model.replace("_", " ")
    return f" The intervals of stiffness are computed with {name}, the richest of the models compared."


def _describe_intervals_of_tie(elastic: Elastic | None) -> str:
    """Return a sentence on the intervals if the readings do not distinguish links from the base.

    The intervals then contain the values of both models, unless one of the two has no certified optimum.
    """
    introduction = " The readings do not distinguish links from base: the intervals of stiffness"
    if elastic is None or elastic.intervals is None or elastic.estimate.prediction.joined:
        return f"{introduction} contain both models' values."
    name = elastic.intervals.replace("_", " ")
    return (
        f"{introduction} are computed with {name} alone, because no optimum of the other model was certified."
    )
