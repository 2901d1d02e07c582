"""Joints of a model in which links may bend: their verdicts, by the folds of the cross-validation."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import Certificate
from jointstiff.solver.inference import Estimate, JointCompliance
from jointstiff.solver.links.estimate import ElasticEstimate

LARGEST_DISPERSION: Final = 0.5
"""Relative standard uncertainty of a joint's compliance over the folds above which it is hardly known."""


def with_links(estimate: Estimate, elastic: ElasticEstimate, jackknife: FloatArray) -> Estimate:
    """Return the joints' estimate as it is where links may bend.

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


def _joint(joint: JointCompliance, compliance: float, uncertainty: float) -> JointCompliance:
    """Return a joint's verdict where links may bend; one that is not observable stays so."""
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    rigid = compliance == 0.0
    return JointCompliance(
        name=joint.name,
        status="at_bound" if rigid else "identified",
        compliance=compliance,
        standard_uncertainty=uncertainty,
        reason="links explain the readings without it" if rigid else _dispersion(compliance, uncertainty),
    )


def _dispersion(compliance: float, uncertainty: float) -> str | None:
    """Return a remark on a joint whose compliance differs much between the folds."""
    share = uncertainty / abs(compliance)
    if not share > LARGEST_DISPERSION:
        return None
    return (
        f"hardly known: over the folds of the cross-validation its compliance varies by {100 * share:.0f} % "
        "(standard uncertainty), as links can bend in its place"
    )
