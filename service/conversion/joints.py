"""Joints: from the verdict on a compliance to the stiffness that people ask for."""

from __future__ import annotations

from math import isfinite

from jointstiff.schemas.run import JointResult, OneSidedBounds
from jointstiff.solver.inference import JointCompliance

__all__ = ["to_joint"]


def to_joint(joint: JointCompliance) -> JointResult:
    """The numbers of a joint in both, compliance and stiffness."""
    return JointResult(
        name=joint.name,
        status=joint.status,
        compliance=joint.compliance,
        stiffness=_stiffness(joint.compliance),
        standard_uncertainty=joint.standard_uncertainty,
        compliance_interval=joint.interval,
        stiffness_interval=_stiffness_interval(joint.interval),
        one_sided=_one_sided(joint.one_sided),
        prior_to_data=_finite(joint.prior_to_data),
        reason=joint.reason,
    )


def _stiffness(compliance: float | None) -> float | None:
    """1 / c; None for a rigid joint and for numbers whose inverse overflows."""
    if not compliance:
        return None
    return _finite(1.0 / compliance)


def _finite(number: float | None) -> float | None:
    return number if number is not None and isfinite(number) else None


def _stiffness_interval(interval: tuple[float, float] | None) -> tuple[float, float | None] | None:
    """[1/c_hi, 1/c_lo], open above where the compliance reaches zero.

    An interval of compliances that are all negative, or that spans zero downwards, is no interval of
    stiffness: it has no least stiffness.
    """
    if interval is None or interval[0] < 0 or interval[1] <= 0:
        return None
    least = _stiffness(interval[1])
    return None if least is None else (least, _stiffness(interval[0]))


def _one_sided(ends: tuple[float, float] | None) -> OneSidedBounds | None:
    """Bounds on the compliance as bounds on the stiffness, where it has any; see `_stiffness_interval`."""
    if ends is None:
        return None
    stiffness = _stiffness_interval(ends) or (None, None)
    return OneSidedBounds(
        compliance_at_least=ends[0],
        compliance_at_most=ends[1],
        stiffness_at_least=stiffness[0],
        stiffness_at_most=stiffness[1],
    )
