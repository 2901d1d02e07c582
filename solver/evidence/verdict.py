"""Each joint's result and verdict: compliance and stiffness with intervals, or in words why it has none."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal, NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.problem import Constraints
from jointstiff.solver.evidence.profile import profile_ends
from jointstiff.solver.fitting.fit import Fit, Scale
from jointstiff.solver.fitting.observability import Observability, noise_reason
from jointstiff.solver.text import rounded_down


def stiffness_of(compliance: float | None) -> float | None:
    """Return 1 / c; None for a rigid joint and where the inverse overflows."""
    if not compliance:
        return None
    stiffness = 1.0 / compliance
    return stiffness if isfinite(stiffness) else None


def stiffness_interval(interval: tuple[float, float] | None) -> tuple[float, float | None] | None:
    """Return [1/c_hi, 1/c_lo], open above (None) where the compliance reaches zero.

    An interval of compliances that are all negative, or that spans zero downwards, is no interval of
    stiffness: it has no least stiffness.
    """
    if interval is None or interval[0] < 0 or interval[1] <= 0:
        return None
    least = stiffness_of(interval[1])
    return None if least is None else (least, stiffness_of(interval[0]))


class OneSidedBounds(NamedTuple):
    """Bounds on a compliance from below and above, each at the full confidence [rad/(N·m)]."""

    compliance_at_least: float
    compliance_at_most: float

    @property
    def stiffness_at_least(self) -> float | None:
        """Lower bound of the stiffness [N·m/rad]; None where the compliance may be negative."""
        return (stiffness_interval(self) or (None, None))[0]

    @property
    def stiffness_at_most(self) -> float | None:
        """Upper bound of the stiffness [N·m/rad]; None where there is none."""
        return (stiffness_interval(self) or (None, None))[1]


@dataclass(frozen=True)
class JointCompliance:
    """Result for one joint; numbers are None if the joint is not observable."""

    name: str
    #: "uncertain" where the standard uncertainty reaches the compliance and the interval contains zero, so
    #: that there is no greatest stiffness
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    compliance: float | None = None  #: [rad/(N·m)]
    standard_uncertainty: float | None = None  #: of the compliance, without constraints [rad/(N·m)]
    #: profile-likelihood interval under the constraints [rad/(N·m)]
    compliance_interval: tuple[float, float] | None = None
    one_sided: OneSidedBounds | None = None  #: bounds from below and above [rad/(N·m)]
    #: information of its prior over that of the readings; inf where the prior alone tells it from other
    #: joints, None without a prior
    prior_to_data: float | None = None
    reason: str | None = None  #: why there is no number, or what holds it

    stiffness: float | None = field(init=False)  #: [N·m/rad]; None for a rigid joint and where it overflows
    #: interval of the stiffness [N·m/rad], open above (None) where the joint may be rigid
    stiffness_interval: tuple[float, float | None] | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", stiffness_of(self.compliance))
        object.__setattr__(self, "stiffness_interval", stiffness_interval(self.compliance_interval))


_NO_UNCERTAINTY = (
    "its uncertainty is unknown: sigma is not given, and there are no more readings than "
    "joints to estimate it; state `noise`, or add observations"
)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data on which the verdicts are based."""

    names: tuple[str, ...]  #: names of the n joints
    fit: Fit  #: outcome of the method
    observability: Observability  #: observability in these readings
    scale: Scale  #: sigma
    constraints: Constraints  #: on the compliances
    confidence: float  #: level of the intervals
    prior_to_data: FloatArray  #: (n,) NaN where there is no prior, inf where only the prior speaks

    def uncertainty(self, j: int) -> float | None:
        """Standard uncertainty of the unconstrained compliance [rad/(N·m)]; None where sigma is unknown."""
        sigma = self.scale.sigma
        return None if sigma is None else sigma * float(np.sqrt(self.fit.covariance[j, j]))


def verdicts(evidence: Evidence) -> tuple[JointCompliance, ...]:
    """One for each joint.

    Raises:
        SolverError: if the end of an interval could not be certified.
    """
    hidden = [_hidden(evidence, j) for j in range(len(evidence.names))]
    shown = np.array([j for j, reason in enumerate(hidden) if reason is None], dtype=np.intp)
    ends = _ends(evidence, shown)
    out = [
        JointCompliance(name, "not_observable", reason=reason)
        for name, reason in zip(evidence.names, hidden, strict=True)
    ]
    for place, j in enumerate(shown.tolist()):
        out[j] = _verdict(evidence, j, None if ends is None else ends[:, place])
    return tuple(out)


def _ends(evidence: Evidence, joints: IndexArray) -> FloatArray | None:
    """(2, w, 2) ends of the two-sided intervals and the one-sided bounds; None where sigma is unknown.

    A profile-likelihood interval takes the constraints on the other joints for information, and where they
    truly are at their bounds it covers too little: 86 % instead of 95 % were seen beside two rigid joints.
    So it is widened to contain what the constraints leave of the unconstrained interval, whose coverage is
    exact wherever the truth lies; that is where the profile ends anyway if no constraint matters. It is
    widened, too, to contain the estimate: that of a method that is not maximum likelihood, such as the
    decoupled one, may lie outside its own interval under constraints.
    """
    sigma, scale, likelihood = evidence.scale.sigma, evidence.scale, evidence.fit.likelihood
    if sigma is None or not len(joints):
        return None
    tail = 1.0 - evidence.confidence
    radii = np.array([sigma * scale.quantile(1.0 - 0.5 * tail), sigma * scale.quantile(1.0 - tail)])
    wanted = np.searchsorted(likelihood.joints, joints)
    constraints = evidence.constraints.select(likelihood.joints)
    ends = profile_ends(likelihood, constraints, wanted, radii)
    free = likelihood.interval(wanted, radii)
    bounds = constraints.bounds.select(wanted)
    held = np.clip(free, bounds.lower[:, None], bounds.upper[:, None])
    value = evidence.fit.compliance[joints]
    lower = np.minimum(np.minimum(ends[..., 0], held[..., 0]), value)
    upper = np.maximum(np.maximum(ends[..., 1], held[..., 1]), value)
    return np.stack([lower, upper], axis=-1)


def _verdict(evidence: Evidence, j: int, ends: FloatArray | None) -> JointCompliance:
    name, value = evidence.names[j], float(evidence.fit.compliance[j])
    held = _held(evidence, j, ends)
    ratio = float(evidence.prior_to_data[j])
    two_sided, one_sided = (None, None) if ends is None else ends.tolist()
    unsure = None if held else _uncertain(evidence, j, ends)
    reasons = [
        held,
        unsure,
        _NO_UNCERTAINTY if ends is None and held is None else None,
        f"the readings show {name} only in combination with other joints: only its prior separates them"
        if np.isinf(ratio)
        else None,
    ]
    return JointCompliance(
        name,
        "at_bound" if held else "uncertain" if unsure else "identified",
        value,
        evidence.uncertainty(j),
        None if two_sided is None else (two_sided[0], two_sided[1]),
        None if one_sided is None else OneSidedBounds(*one_sided),
        None if np.isnan(ratio) else ratio,
        "; ".join(reason for reason in reasons if reason) or None,
    )


def _held(evidence: Evidence, j: int, ends: FloatArray | None) -> str | None:
    """Return the active constraint of joint j in words, or None."""
    value, active = float(evidence.fit.compliance[j]), int(evidence.fit.active[j])
    if active and value == 0.0:
        rigid = "these readings cannot distinguish it from a rigid joint"
        return f"{_stiffer_than(evidence, ends) or 'its compliance is zero: '}{rigid}"
    partners = [evidence.names[k] for k in _tied(evidence, j)]
    if partners:
        return f"`stiffness_order` makes its stiffness equal to that of {', '.join(partners)}"
    if active:
        return f"it is at the {'maximum' if active < 0 else 'minimum'} stiffness of `stiffness_bounds`"
    return None


def _uncertain(evidence: Evidence, j: int, ends: FloatArray | None) -> str | None:
    """Return why a joint has only a bound, or None."""
    value, uncertainty = float(evidence.fit.compliance[j]), evidence.uncertainty(j)
    if ends is None or uncertainty is None or not ends[0, 0] <= 0.0 <= ends[0, 1]:
        return None
    size = f"the standard uncertainty of its compliance, {1e6 * uncertainty:.2g} µrad/(N·m), "
    size += "exceeds the compliance itself" if uncertainty >= abs(value) else "leaves no upper limit"
    more = f"add loads with more torque about the axis of {evidence.names[j]}"
    return f"{_stiffer_than(evidence, ends)}{size}: {more}"


def _tied(evidence: Evidence, j: int) -> list[int]:
    """Joints that the order ties to joint j: equal to the last digit, which noise never is.

    An order through a joint that the readings do not see ties those on both sides of it.
    """
    if not (evidence.fit.tied[j] or evidence.fit.active[j]):
        return []
    compliance, seen = evidence.fit.compliance, np.flatnonzero(~evidence.observability.null)
    pairs = [seen[[i, k]].tolist() for i, k in evidence.constraints.select(seen).order]
    return [i + k - j for i, k in pairs if j in (i, k) and compliance[i] == compliance[k]]


def _stiffer_than(evidence: Evidence, ends: FloatArray | None) -> str:
    """Return the lower limit of a stiffness, as in the tables; empty without one."""
    if ends is None or ends[1, 1] <= 0.0:
        return ""
    lower = rounded_down(1.0 / float(ends[1, 1]))
    stiffness = f"{lower / 1e6:.3g} · 10⁶ N·m/rad" if lower >= 1e4 else f"{lower:.3g} N·m/rad"
    return f"stiffer than {stiffness} at {100 * evidence.confidence:g} %: "


def _hidden(evidence: Evidence, j: int) -> str | None:
    """Return why joint j has no stiffness, or None if it has one."""
    observability, name = evidence.observability, evidence.names[j]
    if observability.null[j]:
        if np.isnan(evidence.prior_to_data[j]):
            return observability.reasons[j]
        return (
            f"{observability.reasons[j]}; its prior is not returned as a result, because the readings do "
            f"not determine {name}"
        )
    for group in evidence.fit.undetermined:
        if j in group.joints:
            return group.reason(evidence.names)
    uncertainty = evidence.uncertainty(j)
    if uncertainty is not None and uncertainty > float(observability.reference_compliance[j]):
        return noise_reason(j, evidence.names, observability, uncertainty)
    return None
