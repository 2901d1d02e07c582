"""Joints of a model in which links may bend: their verdicts, by the folds of the cross-validation."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.solver.convex import Certificate
from jointstiff.solver.inference import Estimate, JointCompliance
from jointstiff.solver.links.effective import EffectiveSpread, effective_rows
from jointstiff.solver.links.estimate import ElasticEstimate
from jointstiff.solver.robot import Robot

LARGEST_DISPERSION: Final = 0.5
"""Relative standard uncertainty of a joint's compliance over the folds above which it is poorly known."""

RIGID: Final = 1e-12
"""Compliance [rad/(N·m)] that no reading tells from none: cone programs stop short of zero."""

_TOGETHER: Final = (
    "effective: the joint and its link's rotation about its axis together, which readings do not tell apart"
)


def with_links(
    robot: Robot, estimate: Estimate, elastic: ElasticEstimate, spread: EffectiveSpread, confidence: float
) -> Estimate:
    """Return the estimate of the effective compliances about the joints' axes.

    Args:
        robot: n joints.
        estimate: of joints alone.
        elastic: with links.
        spread: of the effective compliances over the folds.
        confidence: level of the intervals.
    """
    effective = effective_rows(robot, elastic.model.columns) @ elastic.entries
    effective[np.isnan(elastic.compliance)] = np.nan
    half = spread.half_width(confidence)
    bends = {link.joint for link in elastic.links}
    joints = tuple(
        _joint(joint, float(effective[j]), float(spread.uncertainty[j]), float(half[j]), with_link=j in bends)
        for j, joint in enumerate(estimate.joints)
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
        compliance=np.nan_to_num(effective),
        covariance=None,
        sigma=elastic.sigma,
        chi_square=elastic.chi_square,
        degrees_of_freedom=elastic.degrees_of_freedom,
        complementary_stiffness=None,
        certificates=(evidence,),
    )


def _joint(
    joint: JointCompliance, compliance: float, uncertainty: float, half: float, *, with_link: bool
) -> JointCompliance:
    """Return the result about a joint's axis; a joint that is not observable stays so."""
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    rigid = compliance < RIGID
    interval = None if np.isnan(half) else (max(0.0, compliance - half), compliance + half)
    return JointCompliance(
        name=joint.name,
        status="at_bound" if rigid else "identified" if uncertainty < compliance else "uncertain",
        compliance=0.0 if rigid else compliance,
        standard_uncertainty=uncertainty,
        compliance_interval=interval,
        reason=_remarks(compliance, uncertainty, rigid=rigid, with_link=with_link),
    )


def _remarks(compliance: float, uncertainty: float, *, rigid: bool, with_link: bool) -> str | None:
    """Return what there is to say about the number."""
    if rigid:
        return "the links explain the readings without it"
    remarks = [_TOGETHER] if with_link else []
    if uncertainty > LARGEST_DISPERSION * compliance:
        remarks.append(
            "poorly determined: over the folds of the cross-validation its compliance varies by "
            f"{100 * uncertainty / compliance:.0f} % (standard uncertainty), because links can replace it"
        )
    return "; ".join(remarks) or None
