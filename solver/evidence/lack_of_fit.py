"""Intervals of joints where something besides them bends: held-out postures speak, too."""

from __future__ import annotations

from dataclasses import replace

from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.evidence.budget import UncertaintyBudget
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.verdict import JointCompliance, OneSidedBounds

_NO_UPPER_END = "without single postures its stiffness has no upper limit: something besides the joints bends"


def widened(estimate: Estimate, budget: UncertaintyBudget, bounds: Bounds) -> Estimate:
    """Return the estimate whose intervals hold the compliances ± the budget's expanded uncertainty.

    Args:
        estimate: of n joints.
        budget: of the estimate, with the model error included.
        bounds: on the compliances; an interval that ends at one does not pass it.
    """
    joints = list(estimate.joints)
    uncertainty = budget.total().uncertainty
    for j in budget.joints.tolist():
        lower, upper = float(bounds.lower[j]), float(bounds.upper[j])
        joints[j] = _widened(joints[j], float(uncertainty[j]), budget.coverage_factor, lower, upper)
    return replace(estimate, joints=tuple(joints))


def _widened(
    joint: JointCompliance, uncertainty: float, factor: float, lower: float, upper: float
) -> JointCompliance:
    interval, sides, value = joint.compliance_interval, joint.one_sided, joint.compliance
    if interval is None or sides is None or value is None:
        return joint
    least, most = max(lower, value - factor * uncertainty), min(upper, value + factor * uncertainty)
    interval = min(interval[0], least), max(interval[1], most)
    unsure = joint.status == "identified" and interval[0] <= 0.0
    return replace(
        joint,
        status="uncertain" if unsure else joint.status,
        standard_uncertainty=uncertainty,
        compliance_interval=interval,
        one_sided=OneSidedBounds(min(sides[0], least), max(sides[1], most)),
        reason="; ".join(filter(None, [joint.reason, _NO_UPPER_END if unsure else None])) or None,
    )
