"""Joints of a model in which links may bend: their effective compliances and verdicts."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.solution import Certificate
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.verdict import JointCompliance
from jointstiff.solver.links.effective import EffectiveIntervals
from jointstiff.solver.links.estimate import ElasticEstimate

LARGEST_UNCERTAINTY: Final = 0.5
"""Relative standard uncertainty of an effective compliance above which it is poorly known."""

RIGID: Final = 1e-12
"""Compliance [rad/(N·m)] that no reading tells from none: cone programs stop short of zero."""

_TOGETHER: Final = (
    "effective: the joint and its link's rotation about its axis together, which readings do not tell apart"
)


def with_links(
    estimate: Estimate, elastic: ElasticEstimate, effective: FloatArray, intervals: EffectiveIntervals | None
) -> Estimate:
    """Return the estimate of the effective compliances about the joints' axes.

    Args:
        estimate: of joints alone.
        elastic: with links.
        effective: (n,) effective compliances; NaN of joints that are not seen.
        intervals: of them; None where nothing is known of their uncertainty.
    """
    bends = {link.joint for link in elastic.links}
    unknown = np.full(2, np.nan)
    joints = tuple(
        _joint(
            joint,
            float(effective[j]),
            np.nan if intervals is None else float(intervals.uncertainty[j]),
            unknown if intervals is None else intervals.ends[j],
            with_link=j in bends,
        )
        for j, joint in enumerate(estimate.joints)
    )
    certificate = elastic.certificate
    evidence = Certificate(
        primal=max(0.0, -certificate.least_eigenvalue),
        dual=certificate.dual,
        gap=certificate.gap,
        multipliers=np.zeros(0),
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
    joint: JointCompliance, compliance: float, uncertainty: float, ends: FloatArray, *, with_link: bool
) -> JointCompliance:
    """Return the result about a joint's axis; a joint that is not observable stays so."""
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    rigid = compliance < RIGID
    known = bool(np.isfinite(ends).all())
    return JointCompliance(
        name=joint.name,
        status="at_bound" if rigid else "identified" if uncertainty < compliance else "uncertain",
        compliance=0.0 if rigid else compliance,
        standard_uncertainty=uncertainty if np.isfinite(uncertainty) else None,
        compliance_interval=(float(ends[0]), float(ends[1])) if known else None,
        reason=_remarks(compliance, uncertainty, rigid=rigid, with_link=with_link),
    )


def _remarks(compliance: float, uncertainty: float, *, rigid: bool, with_link: bool) -> str | None:
    """Return what there is to say about the number."""
    if rigid:
        return "the links explain the readings without it"
    remarks = [_TOGETHER] if with_link else []
    if not np.isfinite(uncertainty):
        remarks.append("no interval: the range of compliances that fit the readings was not found")
    elif uncertainty > LARGEST_UNCERTAINTY * compliance:
        remarks.append(
            f"poorly determined (standard uncertainty {100 * uncertainty / compliance:.0f} %): links can "
            "replace it"
        )
    return "; ".join(remarks) or None
