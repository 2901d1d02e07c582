"""Elastic links: from the request to the numerical core, and from its findings to messages."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas import model as messages
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import ModelChoice, PlainModel, RunResult
from jointstiff.service.kinds.run.settings import joint_index
from jointstiff.solver.evidence.causes import LINKS_LEVEL, Screening
from jointstiff.solver.links.choice import WEIGHTS, HeldOut, Plan, Selection
from jointstiff.solver.links.fit import ElasticEstimate
from jointstiff.solver.links.model import LOSSES, ElasticColumns, Loss
from jointstiff.solver.messages import message
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.text import length_text


def to_elastic_columns(options: RunOptions, robot: Robot) -> ElasticColumns:
    """Return the links that may bend.

    Raises:
        RequestError: the robot has no such joint.
        UnsupportedMethodError: the robot has too many joints.
    """
    chosen = {joint_index(robot, name, "links") for name in options.links or robot.joint_names}
    return ElasticColumns(robot.n, tuple(sorted(chosen)))


def to_plan(options: RunOptions) -> Plan:
    """Return how to cross-validate; a weight that is given is the only one."""
    validation = options.cross_validation
    given = options.link_penalty
    return Plan(
        folds=validation.folds,
        draws=validation.draws if given is None else 1,
        seed=validation.seed,
        weights=WEIGHTS if given is None else (given,),
        rule=validation.rule,
    )


def to_losses(options: RunOptions) -> tuple[Loss, ...]:
    """Return the losses to compare; squares alone under a penalty that is given, whose meaning they give."""
    if options.loss != "automatic":
        return (options.loss,)
    return LOSSES if options.link_penalty is None else ("squared",)


def to_links_result(
    elastic: ElasticEstimate, joint_names: Sequence[str], options: RunOptions, losses: Sequence[Loss]
) -> messages.LinksResult:
    """Return the links, with what each element explains."""
    return message(
        messages.LinksResult,
        elastic,
        model=elastic.model.name,
        model_source="cross_validation" if options.elasticity == "automatic" else "given",
        loss=elastic.model.loss,
        loss_source="cross_validation" if len(losses) > 1 else "given",
        penalty_source="cross_validation" if options.link_penalty is None else "given",
        links=[
            message(messages.LinkCompliance, link, joint=joint_names[link.joint]) for link in elastic.links
        ],
        elements=[
            message(
                messages.ElementShare,
                element,
                joint=None if element.joint is None else joint_names[element.joint],
            )
            for element in elastic.elements
        ],
    )


def to_choice_of_joints(options: RunOptions, screening: Screening, excluded: str | None) -> ModelChoice:
    """Return the choice of joints alone, with its reason."""
    loss: Loss = "huber" if options.loss == "huber" else "squared"
    p = f"F test of links beside joints: p = {screening.links_p_value:.1g}"
    if options.elasticity != "automatic":
        source, text = "given", f"Joints alone, as requested ({p})."
    elif excluded is not None:
        source, text = "options", f"Joints alone: elastic links exclude {excluded.replace('_', ' ')} ({p})."
    elif screening.links_p_value < LINKS_LEVEL:
        source, text = "screening", f"Joints alone: correct the mistake named in the reasons first ({p})."
    else:
        source, text = "screening", f"Joints alone: no sign that anything else bends ({p})."
    return ModelChoice(
        elasticity="joints",
        loss=loss,
        source=source,
        links_p_value=screening.links_p_value,
        message=text,
    )


def to_choice_by_comparison(
    selection: Selection, chosen: HeldOut, screening: Screening, *, given: bool, plain: RunResult | None
) -> ModelChoice:
    """Return the choice among models that were compared on held-out postures."""
    name, gain = chosen.model.replace("_", " ").capitalize(), selection.gain
    evidence = f"F test of links beside joints: p = {screening.links_p_value:.1g}"
    if gain is not None:
        evidence += (
            f"; held-out postures are predicted to {length_text(float(chosen.by_posture.mean()))}, by joints "
            f"alone to {length_text(gain.error_of_joints)}"
        )
    neglected = "" if chosen.model == "joints" else " K_c is neglected."
    return ModelChoice(
        elasticity=chosen.model,
        loss=chosen.loss,
        source="given" if given else "cross_validation",
        links_p_value=screening.links_p_value,
        message=f"{name}, loss {chosen.loss} ({evidence}).{neglected}",
        plain=None
        if plain is None
        else PlainModel(
            joints=plain.joints, compensation=plain.compensation, rms_residual=plain.rms_residual
        ),
    )


def to_selection(selection: Selection, chosen: HeldOut) -> messages.ModelSelection:
    """Return models and losses side by side."""
    losses = {scored.model: selection.of(scored.model).loss for scored in selection.models}
    return message(
        messages.ModelSelection, selection, chosen=chosen.model, chosen_loss=chosen.loss, losses=losses
    )
