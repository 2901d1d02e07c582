"""Elastic links: from what is asked for to the numerical core, and from what it finds to messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.schemas.run import RunOptions
from jointstiff.schemas.run import links as messages
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import Certificate
from jointstiff.solver.errors import RequestError
from jointstiff.solver.inference import Estimate, JointCompliance
from jointstiff.solver.links import WEIGHTS, ElasticColumns, ElasticEstimate, LinkCompliance, Plan, Selection
from jointstiff.solver.robot import Robot

__all__ = ["to_elastic_columns", "to_links_result", "to_plan", "to_selection", "with_links"]


LARGEST_SPREAD: Final = 0.5
"""Of a joint's compliance over the folds, relative to it, above which it is hardly known."""


def to_elastic_columns(options: RunOptions, robot: Robot) -> ElasticColumns:
    """The links that may bend.

    Raises:
        RequestError: the robot has no such joint.
        UnsupportedMethodError: the robot has too many joints.
    """
    for name in options.links:
        if name not in robot.joint_names:
            raise RequestError(
                f"the robot has no joint '{name}' that could carry a link",
                where="links",
                remedy=f"use one of {', '.join(robot.joint_names)}",
            )
    chosen = options.links or robot.joint_names
    return ElasticColumns(robot.n, tuple(j for j, name in enumerate(robot.joint_names) if name in chosen))


def to_plan(options: RunOptions) -> Plan:
    """How to cross-validate; a weight that is given is the only one."""
    asked = options.cross_validation
    weights = WEIGHTS if options.link_penalty is None else (options.link_penalty,)
    return Plan(folds=asked.folds, seed=asked.seed, weights=weights, rule=asked.rule)


def with_links(estimate: Estimate, elastic: ElasticEstimate, jackknife: FloatArray) -> Estimate:
    """A joints' estimate as it is where links may bend.

    Args:
        estimate: of joints alone.
        elastic: with links.
        jackknife: (n,) standard uncertainties of the joints [rad/(N·m)].
    """
    joints = tuple(
        _joint(joint, float(c), float(u))
        for joint, c, u in zip(estimate.joints, elastic.compliance, jackknife, strict=True)
    )
    certificate = elastic.certificate
    evidence = Certificate(
        primal=max(0.0, -certificate.least_eigenvalue),
        dual=certificate.dual,
        complementarity=certificate.gap,
        solved_by="clarabel",
    )
    return replace(
        estimate,
        joints=joints,
        compliance=np.nan_to_num(elastic.compliance),
        covariance=None,
        sigma=elastic.sigma,
        chi_square=elastic.chi_square,
        degrees_of_freedom=elastic.degrees_of_freedom,
        complementary_stiffness=None,
        certificates=(evidence,),
    )


def to_links_result(
    elastic: ElasticEstimate, joint_names: Sequence[str], *, given: bool
) -> messages.LinksResult:
    """The links with what everything explains."""
    certificate = elastic.certificate
    return messages.LinksResult(
        model=elastic.model.name,
        penalty=elastic.weight,
        penalty_source="given" if given else "cross_validation",
        coupled_joints=None if elastic.coupled is None else elastic.coupled.tolist(),
        links=[_link(link, joint_names) for link in elastic.links],
        elements=[
            messages.ElementShare(
                kind=element.kind,
                joint=None if element.joint is None else joint_names[element.joint],
                share=element.share,
                by_observation=element.by_observation.tolist(),
            )
            for element in elastic.elements
        ],
        unexplained=1.0 - sum(element.share for element in elastic.elements),
        effective_freedom=elastic.effective_freedom,
        parameters=elastic.parameters,
        certificate=messages.LinkCertificate(
            least_eigenvalue=certificate.least_eigenvalue,
            dual=certificate.dual,
            gap=certificate.gap,
            scale=certificate.scale,
        ),
    )


def to_selection(selection: Selection) -> messages.ModelSelection:
    """The models side by side."""
    return messages.ModelSelection(
        models=[
            messages.ScoredModel(
                model=scored.model,
                penalty=scored.weight,
                compensation=scored.compensation,
                standard_error=scored.standard_error,
                by_fold=scored.by_fold.tolist(),
            )
            for scored in selection.models
        ],
        best=selection.best,
        simplest=selection.simplest,
    )


def _joint(joint: JointCompliance, compliance: float, uncertainty: float) -> JointCompliance:
    """A joint's verdict where links may bend; one that is not observable stays so."""
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    rigid = compliance == 0.0
    reason = "links explain the readings without it" if rigid else _spread(compliance, uncertainty)
    return JointCompliance(
        name=joint.name,
        status="at_bound" if rigid else "identified",
        compliance=compliance,
        standard_uncertainty=uncertainty,
        interval=None,
        one_sided=None,
        reason=reason,
    )


def _spread(compliance: float, uncertainty: float) -> str | None:
    """What to think of a joint that the folds tell differently."""
    share = uncertainty / abs(compliance)
    if not share > LARGEST_SPREAD:
        return None
    return (
        f"hardly known: over the folds of the cross-validation its compliance varies by {100 * share:.0f} % "
        "(standard uncertainty), as links can bend in its place"
    )


def _link(link: LinkCompliance, joint_names: Sequence[str]) -> messages.LinkCompliance:
    return messages.LinkCompliance(
        joint=joint_names[link.joint],
        matrix=link.matrix.tolist(),
        translation=_principal(*link.translation),
        rotation=_principal(*link.rotation),
        effective_freedom=link.effective_freedom,
        parameters=link.parameters,
    )


def _principal(values: FloatArray, directions: FloatArray) -> list[messages.PrincipalCompliance]:
    return [
        messages.PrincipalCompliance(value=value, direction=(x, y, z))
        for value, (x, y, z) in zip(values.tolist(), directions.T.tolist(), strict=True)
    ]
