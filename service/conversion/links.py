"""Elastic links: from the request to the numerical core, and from its findings to messages."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas.run import RunOptions
from jointstiff.schemas.run import links as messages
from jointstiff.service.conversion.message import message
from jointstiff.service.conversion.requests import joint_index
from jointstiff.solver.links import WEIGHTS, ElasticColumns, ElasticEstimate, Plan, Selection
from jointstiff.solver.robot import Robot


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
    asked = options.cross_validation
    weights = WEIGHTS if options.link_penalty is None else (options.link_penalty,)
    return Plan(folds=asked.folds, seed=asked.seed, weights=weights, rule=asked.rule)


def to_links_result(
    elastic: ElasticEstimate, joint_names: Sequence[str], *, given: bool
) -> messages.LinksResult:
    """Return the links, with what each element explains."""
    return message(
        messages.LinksResult,
        elastic,
        model=elastic.model.name,
        penalty_source="given" if given else "cross_validation",
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


def to_selection(selection: Selection) -> messages.ModelSelection:
    """Return the models side by side."""
    return message(messages.ModelSelection, selection)
