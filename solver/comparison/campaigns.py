"""Estimates compared with each other: of two campaigns, such as before and after.

All results follow from the campaigns' estimates. For each joint the ratio of the two stiffnesses has
Fieller's interval, and a p-value of the hypothesis that the stiffness has not changed. On request both
campaigns are fitted in one problem, in which no joint is softer in the second campaign. The share of the
deflection that the second campaign avoids is measured where observations match, and predicted for all
observations. For Gaussian ĉ₁, ĉ₂ the variable ``ĉ₁ − ρ ĉ₂`` has mean zero at the true ratio ρ = c₁/c₂ =
k₂/k₁, so that ``|ĉ₁ − ρ ĉ₂| ≤ t √(s₁² − 2 ρ s₁₂ + ρ² s₂²)`` holds with exactly the
probability of t (E. C. Fieller, *Some problems in interval estimation*, J. R. Stat. Soc. B 16, 1954).

A change over time is the difference of ``ln k = -ln c`` of two campaigns; it has the variance of the errors
that they do not share, and Student's distribution where their sigmas come from residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from math import asin, atan2, exp, hypot, inf, isfinite, isinf, log, pi, sqrt, tan
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special
from scipy.linalg import block_diag
from scipy.spatial import KDTree

from jointstiff.schemas.comparison import (
    AvoidedDeflection,
    ConfigurationShare,
    JointRatio,
    OrderedJoint,
    OrderedResult,
)
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.robot import Estimate
from jointstiff.schemas.run import JointResult
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence.structure import Apart, TargetsEstimate, take_two_runs_apart
from jointstiff.solver.fit.constraints import Bounds, Constraints, Order
from jointstiff.solver.fit.estimate import (
    compute_profile_ends,
    invert_compliance,
    predict,
    stiffness_interval,
)
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import greatest_violations
from jointstiff.solver.fit.stages import Likelihood, SolvedStage, invert_to_root, student_quantile
from jointstiff.solver.mechanics.measurements import FORCE_UNITS, Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import build_messages
from jointstiff.solver.text import figure

POSTURE_TOLERANCE: Final = 1e-3
"""Greatest difference of a joint angle [rad] between matching postures: it moves the end of 3 m by 3 mm."""
LOAD_TOLERANCE: Final = 5e-3
"""Greatest difference of matching loads, relative to their magnitude."""
LOAD_POINT_TOLERANCE: Final = 1e-3
"""Greatest distance of matching load points [m]."""
_MODEL_TOLERANCE: Final = 1e-9
_NO_EFFECT: Final = 1e-9
"""Norm of a joint's column, relative to the largest, that counts as rounding."""
_QUARTER: Final = pi / 2
_ALIKE: Final = 0.5
"""Greatest relative difference of the deflections at which forces that differ are taken for a wrong unit."""
_CONTRADICTED_ORDER: Final = 1e-6
"""p-value of equal stiffnesses below which a joint that is softer in the second campaign contradicts the
order."""
_SAME_LOAD: Final = "same_load"
_SAME_CELL: Final = "same_cell"
"""Names of the options, as places of an error."""
_UNKNOWN: Final = (
    "the uncertainty of the joint is unknown in one of the sets: state `noise`, or add observations"
)
_SOFTER: Final = "the joint is softer in the second set, so that the difference is no spring"
_NEGATIVE: Final = "the readings give a negative compliance in one of the sets"


@dataclass(frozen=True, eq=False)
class FreeEstimate:
    """Estimate of n compliances without constraints, which is Gaussian [rad/(N·m)]."""

    compliance: FloatArray  #: (n,) NaN without an estimate
    covariance: FloatArray  #: (n, n) covariance due to all errors
    readings: FloatArray | None  #: (n, n) part due to the noise of the readings; None if sigma is unknown
    force_scale: FloatArray  #: (n, n) part due to the scale of all forces, stated or assumed
    #: (n, 3) change of the estimate by one standard uncertainty of the load point along each axis of the
    #: flange; (n, 0) if the load point has no stated or assumed uncertainty
    load_point: FloatArray
    sigma: float | None  #: standard uncertainty of one coordinate of one reading [m]
    degrees_of_freedom: float  #: degrees of freedom of sigma; inf if it was given
    reasons: Sequence[str | None]  #: (n,) why the joint has no estimate; None if it has one
    unseen: BoolArray  #: (n,) mask of joints that the readings do not show, not even in combination


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two campaigns, with the estimate from its own readings."""

    robot: Robot  #: n joints
    measurements: Measurements  #: N observations of T targets
    compliance: FloatArray  #: (n,) constrained estimate, used for predictions [rad/(N·m)]
    constraints: Constraints  #: constraints of this estimate
    complementary_stiffness: bool  #: whether the model includes the complementary stiffness K_c
    free: FreeEstimate  #: estimate without constraints


@dataclass(frozen=True)
class SharedErrors:
    """Errors of loads that the user states to be the same in both campaigns; others are independent."""

    load: bool = False  #: whether the load acted at the same point of the flange: one error of the load point
    cell: bool = False  #: whether the same cell or weights gave the forces: one error of their scale


_OWN: Final = SharedErrors()


class Comparison(NamedTuple):
    """Result of the comparison of two campaigns."""

    joints: list[JointRatio]  #: ratio of the stiffnesses of each of the n joints
    differences: list[JointResult]  #: compliance of each joint in the first campaign less that in the second
    #: gearboxes and structure by one fit; None unless one campaign has readings of encoders behind the
    #: gearboxes, and in the other these encoders close the position loop
    apart: Apart | None
    ordered: OrderedResult | None  #: fit of both campaigns in one problem; None if not requested
    avoided: AvoidedDeflection  #: share of the deflection that the second campaign avoids
    #: labels of both campaigns whose observations differ in posture or load, or share no target
    unlike: tuple[str, ...]
    unit_mistake: Finding | None  #: finding of a wrong unit of force; None if none is suspected


class PairCovariance(NamedTuple):
    """Covariance of two campaigns' estimates, without the errors that cancel in a comparison."""

    own: Sequence[FloatArray | None]  #: (n, n) of each campaign; None where sigma is unknown
    cross: FloatArray  #: (n, n) between the first campaign (rows) and the second campaign (columns)

    def select(self, j: int) -> tuple[float | None, float | None, float]:
        """Return the variances of joint j in both campaigns, None if unknown, and the covariance of both."""
        first, second = (None if part is None else float(part[j, j]) for part in self.own)
        return first, second, float(self.cross[j, j])

    def stack(self) -> FloatArray:
        """Return the covariance (2 n, 2 n) of the first, then the second campaign; zero where unknown."""
        first, second = (np.zeros_like(self.cross) if part is None else part for part in self.own)
        return np.block([[first, self.cross], [self.cross.T, second]])


class GaussianEstimate(NamedTuple):
    """An unconstrained estimate of a compliance."""

    value: float  #: [rad/(N·m)]
    standard_uncertainty: float  #: positive [rad/(N·m)]
    degrees_of_freedom: float = inf  #: degrees of freedom of the uncertainty; inf where sigma was given


class RatioInterval(NamedTuple):
    """Interval of the ratios that the estimates do not exclude."""

    lower: float | None  #: None where there is no lower limit
    upper: float | None  #: None where there is no upper limit
    #: if exactly the ratios in an interval are excluded: this interval; else None
    excluded: tuple[float, float] | None = None

    def shift(self, amount: float) -> RatioInterval:
        """Return the interval of ratios that are larger by an amount."""
        lower = None if self.lower is None else self.lower + amount
        upper = None if self.upper is None else self.upper + amount
        if self.excluded is None:
            return RatioInterval(lower, upper)
        return RatioInterval(lower, upper, (self.excluded[0] + amount, self.excluded[1] + amount))


@dataclass(frozen=True, eq=False)
class Matches:
    """Observations of the same posture under the same load, in both campaigns."""

    observations: IndexArray  #: (2, K) indices of the observations in the first and in the second campaign
    targets: IndexArray  #: (2, T) indices of the shared targets in both campaigns
    present: BoolArray  #: (K, T) mask of the shared targets that both campaigns read
    #: labels of both campaigns whose observations differ in posture or load, or share no target
    unlike: tuple[str, ...]


def compare_sides(
    first: Side,
    second: Side,
    *,
    confidence: float,
    ordered: bool = False,
    shared: SharedErrors = _OWN,
) -> Comparison:
    """Compare the stiffnesses of two campaigns whose readings are independent.

    Args:
        first: campaign of the softer state, such as before a repair, or with motor encoders in the loop.
        second: campaign of the stiffer state, such as after a repair, or with secondary encoders in the loop.
        confidence: level of the intervals, between 0 and 1.
        ordered: whether to fit both in one problem with c_second ≤ c_first for every joint.
        shared: errors that are the same in both campaigns.

    Raises:
        RequestError: the robots' joints differ, the order contradicts the constraints or the readings, or the
            campaigns cannot share an error.
        SolverError: optimality could not be certified.
    """
    _refuse_different_joints(first.robot, second.robot)
    sides = (first, second)
    covariance = _compute_pair_covariance(sides, shared)
    compliances_are_positive = all(bool((side.constraints.bounds.lower >= 0).all()) for side in sides)
    compliances = np.stack([side.compliance for side in sides])
    ordered_result = None
    if ordered:
        ordered_result, optimum = fit_ordered(sides, covariance, confidence)
        compliances = np.where(np.isnan(optimum), compliances, optimum)
    ratios, differences = [], []
    for j in range(first.robot.n):
        ratios.append(_compare_joint(j, sides, covariance, confidence, positive=compliances_are_positive))
        differences.append(_subtract_joint(j, sides, covariance, confidence, shared))
    if ordered:
        _refuse_contradicted_order(sides, ratios)
    matches = match_observations(first.measurements, second.measurements)
    return Comparison(
        joints=ratios,
        differences=differences,
        apart=_take_apart(sides, confidence, shared),
        ordered=ordered_result,
        avoided=compute_avoided_deflection(sides, matches, compliances),
        unlike=matches.unlike,
        unit_mistake=find_force_unit_mistake(first.measurements, second.measurements, matches),
    )


def _refuse_contradicted_order(sides: Sequence[Side], ratios: Sequence[JointRatio]) -> None:
    """Refuse an order of two campaigns if the second one has softer joints, beyond any chance.

    Raises:
        RequestError: the readings contradict the order.
    """
    softer = list[str]()
    for joint in ratios:
        if joint.ratio is None or joint.p_value is None:
            continue
        if joint.ratio < 1.0 and joint.p_value < _CONTRADICTED_ORDER:
            softer.append(f"{joint.name} ({figure(joint.ratio, '.3g')} times)")
    if not softer:
        return
    first, second = ("secondary" if side.measurements.closed_on_links else "motor" for side in sides)
    loops = f"; the first set has {first} encoders in the loop, the second {second} encoders"
    raise RequestError(
        "with `ordered` no joint may be softer in the second set, but in the readings these have less "
        f"stiffness there than in the first set, p < {_CONTRADICTED_ORDER:.0e}: {', '.join(softer)}"
        f"{loops if first != second else ''}",
        where="ordered",
        remedy="exchange the two campaigns, or omit `ordered`",
    )


def _refuse_different_joints(first: Robot, second: Robot) -> None:
    """Refuse two robots whose joints differ in name or kind.

    Raises:
        RequestError: the joints differ.
    """
    if first.joint_names != second.joint_names or first.joint_kinds != second.joint_kinds:
        raise RequestError(
            f"the robots have different joints: {', '.join(first.joint_names)} in the first set, "
            f"{', '.join(second.joint_names)} in the second",
            where="run_ids",
            remedy=_name_remedy(first, second),
        )


def _name_remedy(first: Robot, second: Robot) -> str:
    """Return the remedy for joints that differ: other names of the same joints, or other robots."""
    remedy = "compare sets of one robot, or of two robots of the same model with the same joint names"
    if first.joint_kinds != second.joint_kinds or models_differ(first, second):
        return remedy
    pairs = zip(second.joint_names, first.joint_names, strict=True)
    renamed = ", ".join(f"{old} to {new}" for old, new in pairs if old != new)
    return (
        f"both robots have the same axes: rename the joints in the second robot's URDF, {renamed}; and "
        "identify its set again"
    )


def models_differ(first: Robot, second: Robot) -> bool:
    """Return whether two robots with the same joints differ in geometry or joint map (in two postures)."""
    if first is second:
        return False
    controller_joints = np.stack([np.zeros(first.n), np.linspace(0.3, 1.1, first.n)])  # any two postures
    of_first = Postures(first, first.joint_map.model_angles(controller_joints))
    of_second = Postures(second, second.joint_map.model_angles(controller_joints))
    differences = (
        of_first.q - of_second.q,
        of_first.jacobian - of_second.jacobian,
        of_first.flange_rotation - of_second.flange_rotation,
        of_first.flange_translation - of_second.flange_translation,
    )
    return any(bool((np.abs(difference) > _MODEL_TOLERANCE).any()) for difference in differences)


def _compute_pair_covariance(sides: Sequence[Side], shared: SharedErrors) -> PairCovariance:
    """Compute the covariance of both campaigns' estimates without the errors that cancel in a comparison.

    Each campaign has errors of its own, stated or assumed: another cell has another scale, and a load that is
    hung anew hangs elsewhere. Only what the user states to be the same cancels.

    Raises:
        RequestError: the campaigns cannot share an error.
    """
    if shared.cell:
        check_same_cell([side.measurements for side in sides])
    own: list[FloatArray | None] = []
    for estimate in (side.free for side in sides):
        if estimate.readings is None:  # sigma is unknown
            own.append(None)
        elif shared.cell:
            own.append(estimate.covariance - estimate.force_scale)
        else:
            own.append(estimate.covariance)
    n = sides[0].robot.n
    cross = _compute_covariance_by_load_point(sides) if shared.load else np.zeros((n, n))
    return PairCovariance(own, cross)


def check_same_cell(campaigns: Sequence[Measurements]) -> None:
    """Check that all campaigns have the same uncertainty of the scale of their forces.

    Raises:
        RequestError: the uncertainties differ.
    """
    scales = [campaign.common_uncertainty.scale for campaign in campaigns]
    other = next((scale for scale in scales if scale != scales[0]), None)
    if other is not None:
        stated = f"{figure(100.0 * scales[0], '.3g')} and {figure(100.0 * other, '.3g')}"
        raise RequestError(
            f"two sets state uncertainties of {stated} % for the scale of the force, so both sets cannot "
            "have the same error of scale",
            where=_SAME_CELL,
            remedy=f"omit `{_SAME_CELL}`, or state the same `noise.force.scale` in all sets",
        )


def _compute_covariance_by_load_point(sides: Sequence[Side]) -> FloatArray:
    """Return the covariance (n, n) of both campaigns' estimates if they share the error of the load point.

    Raises:
        RequestError: the campaigns cannot share a load point.
    """
    # Changes (n, 3) of an estimate by one standard uncertainty of the load point along each axis.
    first_changes, second_changes = (side.free.load_point for side in sides)
    if not first_changes.any() or not second_changes.any():
        raise RequestError(
            "one of the runs states no uncertainty of its load point, so the sets cannot share an error of "
            "the load point",
            where=_SAME_LOAD,
            remedy="omit `same_load`, or identify both sets again with an uncertainty "
            "`noise.load_point` above zero and without a fitted load point",
        )
    check_same_load([side.measurements for side in sides])
    return np.asarray(first_changes @ second_changes.T)


def check_same_load(campaigns: Sequence[Measurements]) -> None:
    """Check that all campaigns state the same load points with the same uncertainty.

    Raises:
        RequestError: the load points differ by more than `LOAD_POINT_TOLERANCE`, or their uncertainties
            differ.
    """
    points_of_campaigns = []
    for campaign in campaigns:
        has_force = campaign.force.any(axis=1)  # a moment alone has no load point
        points_of_campaigns.append(np.unique(campaign.load_point[has_force], axis=0))
    if any(len(points) == 0 for points in points_of_campaigns):
        return
    first_points, first_uncertainty = points_of_campaigns[0], campaigns[0].common_uncertainty.load_point
    for points, campaign in zip(points_of_campaigns, campaigns, strict=True):
        distances_to_first, _ = KDTree(first_points).query(points)
        distances_from_first, _ = KDTree(points).query(first_points)
        farthest = max(np.max(distances_to_first), np.max(distances_from_first))
        uncertainty = campaign.common_uncertainty.load_point
        if farthest > LOAD_POINT_TOLERANCE or uncertainty != first_uncertainty:
            stated = f"{figure(1e3 * first_uncertainty, '.3g')} and {figure(1e3 * uncertainty, '.3g')}"
            raise RequestError(
                f"two sets state load points that are {figure(1e3 * farthest, '.3g')} mm apart, with "
                f"uncertainties of {stated} mm, so both sets cannot have the same error of the load point",
                where=_SAME_LOAD,
                remedy="omit `same_load`, or state the same load point and uncertainty in all sets",
            )


def _compare_joint(
    j: int,
    sides: Sequence[Side],
    covariance: PairCovariance,
    confidence: float,
    *,
    positive: bool,
) -> JointRatio:
    """Build the ratio of the stiffnesses of joint j with interval and p-value, or say why it is unknown.

    Args:
        j: index of the joint.
        sides: both campaigns.
        covariance: covariance of both estimates.
        confidence: level of the interval.
        positive: whether compliances are known to be zero or positive.
    """
    name = sides[0].robot.joint_names[j]
    *variances, shared_covariance = covariance.select(j)
    for ordinal, side in zip(("first", "second"), sides, strict=True):
        if not isfinite(side.free.compliance[j]):
            return JointRatio(name=name, reason=f"in the {ordinal} set: {side.free.reasons[j]}")
    estimates = [
        GaussianEstimate(float(side.free.compliance[j]), sqrt(variance), side.free.degrees_of_freedom)
        for side, variance in zip(sides, variances, strict=True)
        if variance is not None and variance > 0.0
    ]
    if len(estimates) < len(sides):
        return JointRatio(name=name, reason=_UNKNOWN)
    first, second = estimates
    # Student's test of the hypothesis that both compliances are equal.
    variance_of_difference = (
        first.standard_uncertainty**2 + second.standard_uncertainty**2 - 2.0 * shared_covariance
    )
    student_t = abs(first.value - second.value) / sqrt(variance_of_difference)
    freedom = min(first.degrees_of_freedom, second.degrees_of_freedom)
    interval = compute_ratio_interval(
        first, second, confidence, positive=positive, covariance=shared_covariance
    )
    are_positive = first.value > 0 and second.value > 0
    return JointRatio(
        name=name,
        ratio=first.value / second.value if are_positive else None,
        ratio_interval=None if interval is None else (interval.lower, interval.upper),
        ratio_excluded=None if interval is None else interval.excluded,
        p_value=float(2.0 * special.stdtr(freedom, -student_t)),
        reason=None if are_positive else _NEGATIVE,
    )


def _subtract_joint(
    j: int, sides: Sequence[Side], covariance: PairCovariance, confidence: float, shared: SharedErrors
) -> JointResult:
    """Return the compliance of joint j in the first campaign less that in the second, with its interval.

    With motor encoders in the loop first, and secondary encoders then, the difference is the gearbox:
    ``c_off − c_on ± t √(s₁² + s₂² − 2 s₁₂ + (u (c_off − c_on))²)``. An error u of the scale of all loads that
    both campaigns share cancels in a ratio, but not in a difference (method.md §18).

    Args:
        j: index of the joint.
        sides: both campaigns.
        covariance: covariance of both estimates, without a shared scale.
        confidence: level of the interval.
        shared: errors that are the same in both campaigns.
    """
    first, second = (side.free for side in sides)
    name, kind = sides[0].robot.joint_names[j], sides[0].robot.joint_kinds[j]
    first_variance, second_variance, shared_covariance = covariance.select(j)
    difference = float(first.compliance[j] - second.compliance[j])
    if not isfinite(difference) or not first_variance or not second_variance:
        reason = first.reasons[j] or second.reasons[j] or _UNKNOWN
        return _make_difference(name, kind, compliance=None, uncertainty=None, interval=None, reason=reason)
    scale_uncertainty = sides[0].measurements.common_uncertainty.scale if shared.cell else 0.0
    variance = first_variance + second_variance - 2.0 * shared_covariance
    variance += (scale_uncertainty * difference) ** 2
    uncertainty = sqrt(variance)
    freedom = min(first.degrees_of_freedom, second.degrees_of_freedom)
    t = student_quantile(0.5 * (1.0 + confidence), freedom if isfinite(freedom) else None)
    low, high = difference - t * uncertainty, difference + t * uncertainty
    if high <= 0.0:
        return _make_difference(
            name, kind, compliance=None, uncertainty=uncertainty, interval=None, reason=_SOFTER
        )
    return _make_difference(
        name,
        kind,
        compliance=max(difference, 0.0),
        uncertainty=uncertainty,
        interval=(max(low, 0.0), high),
        reason=None,
    )


def _take_apart(sides: Sequence[Side], confidence: float, shared: SharedErrors) -> Apart | None:
    """Return gearboxes and structure by one fit of both campaigns; None unless their encoders allow it."""
    motor, secondary = sorted(sides, key=lambda side: side.measurements.closed_on_links)
    if motor.measurements.closed_on_links or not secondary.measurements.closed_on_links:
        return None
    estimates = []
    for side in (motor, secondary):
        free = side.free
        sigma = side.measurements.sigma or free.sigma
        if sigma is None:
            return None
        balanced = side.compliance if side.complementary_stiffness else None
        rows = Rows(side.robot, side.measurements, balanced)
        estimates.append(TargetsEstimate(rows, side.compliance, ~free.unseen, sigma, free.degrees_of_freedom))
    of_motor, of_secondary = estimates
    return take_two_runs_apart(
        of_motor, of_secondary, confidence, same_load=shared.load, same_cell=shared.cell
    )


def _make_difference(
    name: str,
    kind: JointKind,
    *,
    compliance: float | None,
    uncertainty: float | None,
    interval: tuple[float, float] | None,
    reason: str | None,
) -> JointResult:
    """Build the message of a difference of compliances; without a compliance, `reason` says why."""
    excludes_zero = interval is not None and interval[0] > 0.0
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    verdict: Verdict
    if compliance is None:
        status, verdict = "not_observable", "do_not_use"
    elif excludes_zero:
        status, verdict = "identified", "use"
    elif compliance > 0.0:
        status, verdict = "uncertain", "use_with_care"
    else:
        status, verdict = "at_bound", "use_with_care"
    return JointResult(
        name=name,
        kind=kind,
        status=status,
        verdict=verdict,
        compliance=compliance,
        stiffness=invert_compliance(compliance),
        standard_uncertainty=uncertainty,
        compliance_interval=interval,
        stiffness_interval=stiffness_interval(interval),
        reason=reason,
    )


def compute_ratio_interval(
    first: GaussianEstimate,
    second: GaussianEstimate,
    confidence: float,
    *,
    positive: bool,
    covariance: float = 0.0,
) -> RatioInterval | None:
    """Compute Fieller's interval of the ratio ρ = c_first / c_second = k_second / k_first.

    The interval is exact if both uncertainties come from one sigma, or sigma is given. Otherwise the fewer
    degrees of freedom are used, so that the interval covers the true ratio at least as often as `confidence`.

    Args:
        first: estimate of the first compliance.
        second: estimate of the second compliance.
        confidence: between 0 and 1.
        positive: whether both compliances, and so their ratio, are known to be zero or positive.
        covariance: covariance of both estimates [(rad/(N·m))²]; zero if they are independent.

    Returns:
        The interval; None if `positive` and all ratios that the estimates allow are negative. The interval
        may instead be all ratios but those of an inner interval, which is then stated as excluded.
    """
    t = student_quantile(0.5 + confidence / 2, min(first.degrees_of_freedom, second.degrees_of_freedom))
    # With b = covariance / s₂², ĉ₁ − b ĉ₂ is independent of ĉ₂, has the variance s₁² − b · covariance, and
    # the ratio ρ − b to ĉ₂.
    b = covariance / second.standard_uncertainty**2
    independent = GaussianEstimate(
        value=first.value - b * second.value,
        standard_uncertainty=sqrt(first.standard_uncertainty**2 - b * covariance),
    )
    interval = _compute_independent_ratio_interval(independent, second, t).shift(b)
    if not positive:
        return interval
    lower, upper, excluded = interval
    if upper is not None and upper < 0.0:
        return None
    if excluded is not None and excluded[0] < 0.0:  # of both parts only the upper part is positive
        return RatioInterval(max(0.0, excluded[1]), None)
    return RatioInterval(0.0 if lower is None else max(0.0, lower), upper, excluded)


def _compute_independent_ratio_interval(
    first: GaussianEstimate, second: GaussianEstimate, t: float
) -> RatioInterval:
    """Compute Fieller's interval of c_first / c_second for independent estimates of any sign.

    In units of the uncertainties, with the point ``(ĉ₂/s₂, ĉ₁/s₁)`` at distance r and angle θ, the interval
    is ``|sin(θ − φ)| ≤ t/r`` for ``tan φ = ρ s₂/s₁``: an arc of directions, repeated every half turn. If the
    arc passes through the vertical, where the ratio is infinite, the interval has no upper limit.

    Args:
        first: estimate of the first compliance.
        second: estimate of the second compliance.
        t: quantile, the greatest |ĉ₁ − ρ ĉ₂| in standard uncertainties.
    """
    y = first.value / first.standard_uncertainty
    x = second.value / second.standard_uncertainty
    scale = first.standard_uncertainty / second.standard_uncertainty
    r = hypot(x, y)
    if r <= t:  # the point is so near the origin that every direction is allowed
        return RatioInterval(None, None)
    angle = atan2(y, x)
    if angle > _QUARTER or angle <= -_QUARTER:  # the ratio stays the same if both signs change
        angle -= pi if angle > 0 else -pi
    low, high = angle - asin(t / r), angle + asin(t / r)
    lower, upper = scale * tan(low), scale * tan(high)
    if low > -_QUARTER and high < _QUARTER:
        return RatioInterval(lower, upper)
    # The arc passes through the vertical: all ratios are allowed but those between `upper` and `lower`.
    return RatioInterval(None, None, (upper, lower))


def fit_ordered(
    sides: Sequence[Side], covariance: PairCovariance, confidence: float
) -> tuple[OrderedResult, FloatArray]:
    """Fit both campaigns in one problem subject to ``c_second ≤ c_first`` for every joint (method.md §5).

    The unknowns are the 2 n compliances, with the likelihood of both Gaussian estimates. The optimum weights
    the estimates with the noise of the readings alone. The intervals use all errors, and are widened to
    contain the optimum. A joint that a campaign does not show has no interval, and does not constrain the
    other campaign.

    Args:
        sides: the softer campaign, such as with motor encoders in the loop, and the stiffer campaign.
        covariance: covariance of both estimates.
        confidence: level of the intervals.

    Returns:
        The result as a message; and the compliances (2, n) [rad/(N·m)], NaN where a campaign does not
        determine them.

    Raises:
        RequestError: the constraints contradict each other, or an uncertainty is unknown.
        SolverError: optimality could not be certified.
    """
    free, n = [side.free for side in sides], sides[0].robot.n
    R = _compute_weights(free)
    separate, together = _combine_constraints(sides)
    estimates = np.concatenate([estimate.compliance for estimate in free])
    known = np.flatnonzero(np.isfinite(estimates))
    estimates = estimates[known]
    ordered_fit, separate_fit = (
        SolvedStage.solve(R, R @ estimates, known, constraints.select(known)).solution
        for constraints in (together, separate)
    )
    compliance = np.full(2 * n, np.nan)
    compliance[known] = ordered_fit.x
    chi_square_of_ordered, chi_square_of_separate = (
        float(np.square(R @ (fit.x - estimates)).sum()) for fit in (ordered_fit, separate_fit)
    )
    quantile = student_quantile(0.5 + confidence / 2, min(each.degrees_of_freedom for each in free))
    likelihood = Likelihood(np.arange(len(known)), estimates, covariance.stack()[np.ix_(known, known)])
    each_compliance = np.eye(len(known))
    (ends,) = compute_profile_ends(likelihood, together.select(known), each_compliance, np.array([quantile]))
    intervals = np.full((2 * n, 2), np.nan)
    intervals[known, 0] = np.minimum(ends[:, 0], ordered_fit.x)
    intervals[known, 1] = np.maximum(ends[:, 1], ordered_fit.x)
    first, second = compliance.reshape(2, n)
    message = OrderedResult(
        joints=build_messages(
            OrderedJoint,
            name=sides[0].robot.joint_names,
            kind=sides[0].robot.joint_kinds,
            compliance_first=first,
            compliance_second=second,
            stiffness_first=[invert_compliance(value) for value in first],
            stiffness_second=[invert_compliance(value) for value in second],
            compliance_interval_first=intervals[:n],
            compliance_interval_second=intervals[n:],
            equal=first == second,
        ),
        chi_square_increase=max(0.0, chi_square_of_ordered - chi_square_of_separate),
        certificate=greatest_violations([ordered_fit.certificate]),
    )
    return message, compliance.reshape(2, n)


def _combine_constraints(sides: Sequence[Side]) -> tuple[Constraints, Constraints]:
    """Return constraints on the 2 n compliances of both campaigns: their own ones, and also in order.

    The compliances of the second campaign have the numbers n to 2 n − 1. In an order, (i, j) states
    c_i ≤ c_j.

    Raises:
        RequestError: the constraints contradict each other.
    """
    n = sides[0].robot.n
    first, second = (side.constraints for side in sides)
    bounds = Bounds(
        np.concatenate([first.bounds.lower, second.bounds.lower]),
        np.concatenate([first.bounds.upper, second.bounds.upper]),
    )
    order_of_second = [(n + i, n + j) for i, j in second.order]
    own_order: Order = (*first.order, *order_of_second)
    second_is_stiffer = [(n + j, j) for j in range(n)]
    return Constraints(bounds, own_order), Constraints(bounds, (*second_is_stiffer, *own_order))


def _compute_weights(free: Sequence[FreeEstimate]) -> FloatArray:
    """Return R with RᵀR = Σ⁻¹, for the noise Σ of the readings in the known compliances of both campaigns.

    Raises:
        RequestError: the noise of one of the campaigns is unknown.
    """
    roots = []
    for estimate in free:
        if estimate.readings is None:
            raise RequestError(
                "sigma is neither stated nor determined by the residuals, so the two sets cannot be weighted "
                "against each other",
                where="ordered",
                remedy="state `noise.sigma`, or add observations",
            )
        known = np.flatnonzero(np.isfinite(estimate.compliance))
        if len(known):
            roots.append(invert_to_root(estimate.readings[np.ix_(known, known)]))
    return np.asarray(block_diag(*roots))


def find_force_unit_mistake(one: Measurements, two: Measurements, matches: Matches) -> Finding | None:
    """Find out whether one of two campaigns states its forces in a wrong unit, such as kgf read as N.

    The unit is suspect if the forces of most matching postures differ by the ratio of two units, such as N
    and kgf, while the deflections hardly differ.

    Args:
        one: the first campaign.
        two: the second campaign.
        matches: observations that match with the forces as stated.

    Returns:
        The finding; None if no mistake is suspected.
    """
    common_label_count = len(matches.present) + len(matches.unlike)
    for (unit, newtons), (other_unit, other_newtons) in permutations(FORCE_UNITS.items(), 2):
        ratio = newtons / other_newtons
        scaled_matches = match_observations(one, two, force_ratio=ratio)
        newly_matching = np.setdiff1d(scaled_matches.observations[0], matches.observations[0])
        explains_most = 2 * len(newly_matching) > common_label_count
        if not explains_most:
            continue
        _, share = compute_measured_shares((one, two), scaled_matches, sigmas=(None, None))
        if share is not None and abs(share.value) < _ALIKE:
            return Finding(
                code="force_unit_suspect",
                weight="do_not_use",
                message="in the same postures, the forces of the second campaign are "
                f"{figure(ratio, '.3g')} times those of the first, but the deflections "
                f"{figure(1.0 - share.value, '.3g')} times: probably {other_unit} were read as {unit} in the "
                f"second campaign, or {unit} as {other_unit} in the first",
                remedy="correct `units.force` of the campaign whose unit is wrong",
            )
    return None


def match_observations(one: Measurements, two: Measurements, force_ratio: float = 1.0) -> Matches:
    """Find the observations of two campaigns with equal label, posture and load, and a target in common.

    Args:
        one: the first campaign.
        two: the second campaign.
        force_ratio: factor on the forces of the first campaign before they are compared.
    """
    shared_targets = [name for name in one.targets if name in two.targets]
    targets = np.array(
        [
            [one.targets.index(name) for name in shared_targets],
            [two.targets.index(name) for name in shared_targets],
        ],
        np.intp,
    )
    row_in_two = {label: row for row, label in enumerate(two.labels)}
    pairs = [(row, row_in_two[label]) for row, label in enumerate(one.labels) if label in row_in_two]
    observations = np.array(pairs, dtype=np.intp).reshape(-1, 2).T  # rows with a common label
    i, k = observations
    present = _find_comparable_readings(one, two, observations, targets)
    same_posture = np.abs(one.joints[i] - two.joints[k]).max(axis=1) <= POSTURE_TOLERANCE
    # The load point does not matter where no force acts.
    load_point_distance = np.linalg.norm(one.load_point[i] - two.load_point[k], axis=1)
    same_load_point = (load_point_distance <= LOAD_POINT_TOLERANCE) | ~one.force[i].any(axis=1)
    same_force = _are_nearly_equal(force_ratio * one.force[i], two.force[k])
    same_moment = _are_nearly_equal(one.moment[i], two.moment[k])
    is_matching = same_posture & same_load_point & same_force & same_moment & present.any(axis=1)
    unlike = tuple(one.labels[row] for row in i[~is_matching])
    return Matches(observations[:, is_matching], targets, present[is_matching], unlike)


def _are_nearly_equal(first: FloatArray, second: FloatArray) -> BoolArray:
    """Return which vectors (N, 3) are equal to within `LOAD_TOLERANCE` of the longer one."""
    longer = np.maximum(np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1))
    return np.asarray(np.linalg.norm(first - second, axis=1) <= LOAD_TOLERANCE * longer)


def _find_comparable_readings(
    one: Measurements, two: Measurements, observations: IndexArray, targets: IndexArray
) -> BoolArray:
    """Return which targets both campaigns read in all coordinates, or along the same direction: (K, T).

    Args:
        one: the first campaign.
        two: the second campaign.
        observations: (2, K) rows of the observations in both campaigns.
        targets: (2, T) indices of the targets in both campaigns.
    """
    present, directions = [], []
    for campaign, rows, columns in zip((one, two), observations, targets, strict=True):
        readings = np.ix_(rows, columns)
        present.append(campaign.present[readings])
        if campaign.direction is None:
            directions.append(np.zeros((len(rows), len(columns), 3)))
        else:
            directions.append(campaign.direction[readings])
    # A zero vector means that all three coordinates were read.
    read_all = ~(directions[0].any(axis=-1) | directions[1].any(axis=-1))
    # A gauge on the flange turns with the postures, which differ by `POSTURE_TOLERANCE`.
    cosine = np.abs((directions[0] * directions[1]).sum(axis=-1))
    same_direction = cosine > np.cos(2.0 * POSTURE_TOLERANCE)
    return np.asarray(present[0] & present[1] & (same_direction | read_all))


def compute_avoided_deflection(
    sides: Sequence[Side], matches: Matches, compliances: FloatArray
) -> AvoidedDeflection:
    """Compute the share of the deflection that the second campaign avoids, measured and predicted.

    Args:
        sides: both campaigns.
        matches: observations that both campaigns have.
        compliances: (2, n) compliances of the joints in the first and in the second campaign [rad/(N·m)].
    """
    measured_shares, measured_total = compute_measured_shares(
        [side.measurements for side in sides], matches, [side.free.sigma for side in sides]
    )
    is_unseen = sides[0].free.unseen | sides[1].free.unseen
    # Mean deflections (N, 2) in the observations of each campaign, with the compliances of both campaigns
    in_first, in_second = (_predict_mean_lengths(side, compliances, is_unseen) for side in sides)
    first_labels, second_labels = (side.measurements.labels for side in sides)
    only_in_second = np.setdiff1d(np.arange(len(second_labels)), matches.observations[1]).tolist()
    measured_of_row = dict(zip(matches.observations[0].tolist(), measured_shares, strict=True))
    configurations = []
    for row, label in enumerate(first_labels):
        share = ConfigurationShare(
            observation=label,
            side="both" if row in measured_of_row else "first",
            measured=measured_of_row.get(row),
            predicted=_compute_avoided_share(*in_first[row]),
        )
        configurations.append(share)
    for row in only_in_second:
        share = ConfigurationShare(
            observation=second_labels[row],
            side="second",
            measured=None,
            predicted=_compute_avoided_share(*in_second[row]),
        )
        configurations.append(share)
    total_first, total_second = np.nansum(np.vstack([in_first, in_second[only_in_second]]), axis=0)
    return AvoidedDeflection(
        matching=len(measured_shares),
        measured=measured_total,
        predicted=_compute_avoided_share(total_first, total_second),
        configurations=configurations,
    )


def compute_measured_shares(
    readings: Sequence[Measurements], matches: Matches, sigmas: Sequence[float | None]
) -> tuple[list[Estimate | None], Estimate | None]:
    """Compute the share of the measured deflection that the second campaign avoids.

    To first order, the length of a deflection d has the standard uncertainty ``√(d̂ᵀ Σ d̂)``; d̂ is the
    direction of d and Σ the covariance of d. Readings are independent.

    Args:
        readings: readings of the campaign with the greater deflections, then of the other campaign.
        matches: K observations that both campaigns have.
        sigmas: standard uncertainty of one coordinate of one reading in each campaign [m], or None.

    Returns:
        Avoided shares of the mean deflection of the shared targets: a list with the share in each of the K
        observations, and the share over all observations. A share is None if the first campaign shows no
        deflection; the share over all is None, too, if no observation matches.
    """
    first, second = (
        _measure_mean_lengths(campaign, rows, targets, matches.present, sigma)
        for campaign, rows, targets, sigma in zip(
            readings, matches.observations, matches.targets, sigmas, strict=True
        )
    )
    numbers = zip(first.mean, second.mean, first.uncertainty, second.uncertainty, strict=True)
    shares = [_estimate_avoided_share(*numbers_of_observation) for numbers_of_observation in numbers]
    if not shares:
        return shares, None
    total_share = _estimate_avoided_share(
        float(first.mean.sum()),
        float(second.mean.sum()),
        float(np.sqrt(np.square(first.uncertainty).sum())),
        float(np.sqrt(np.square(second.uncertainty).sum())),
    )
    return shares, total_share


class _MeanLengths(NamedTuple):
    """Mean length of the deflections of the targets in each of K observations."""

    mean: FloatArray  # (K,) [m]
    uncertainty: FloatArray  # (K,) standard uncertainty of the mean [m]; NaN without sigma


def _measure_mean_lengths(
    campaign: Measurements,
    rows: IndexArray,
    targets: IndexArray,
    present: BoolArray,
    sigma: float | None,
) -> _MeanLengths:
    """Return the mean length of the deflections in K observations of a campaign.

    Args:
        campaign: measurements.
        rows: (K,) indices of the observations.
        targets: (T,) indices of the targets.
        present: (K, T) which of these targets count.
        sigma: standard uncertainty of one coordinate of one reading [m], or None.
    """
    readings = np.ix_(rows, targets)
    deflection, covariance = campaign.deflection[readings], campaign.covariance
    if covariance.ndim == 4:  # (N, T, 3, 3); otherwise all readings have one covariance (3, 3)
        covariance = covariance[readings]
    length = np.linalg.norm(deflection, axis=2)
    direction = deflection / np.where(length > 0, length, 1.0)[..., None]
    covariance_times_direction = (covariance @ direction[..., None])[..., 0]
    variance = np.sum(direction * covariance_times_direction, axis=2)  # (K, T) in units of sigma²
    count = present.sum(axis=1)
    mean = (length * present).sum(axis=1) / count
    relative_uncertainty = np.sqrt((variance * present).sum(axis=1)) / count
    return _MeanLengths(mean, (np.nan if sigma is None else sigma) * relative_uncertainty)


def _predict_mean_lengths(side: Side, compliances: FloatArray, unknown: BoolArray) -> FloatArray:
    """Predict the mean deflection of each observation's targets, with the compliances of each campaign.

    Args:
        side: campaign with the N observations.
        compliances: (2, n) compliances of both campaigns [rad/(N·m)].
        unknown: (n,) joints that one of the campaigns does not show.

    Returns:
        (N, 2) mean length [m] in each observation, with the compliances of the first and of the second
        campaign; NaN where an unknown joint is twisted.
    """
    robot, measurements = side.robot, side.measurements
    target_count = measurements.present.sum(axis=1)
    mean_lengths = []
    for compliance in compliances:
        balanced = compliance if side.complementary_stiffness else None
        predicted = predict(Rows(robot, measurements, balanced), compliance).predicted
        lengths = np.linalg.norm(predicted, axis=2) * measurements.present
        mean_lengths.append(lengths.sum(axis=1) / target_count)
    blocks = Rows(robot, measurements).generate_blocks()
    # Largest motion (N, n) of a coordinate by each joint, per unit of its compliance.
    largest_motion = np.concatenate([np.abs(block.A).max(axis=(1, 2)) for block in blocks])
    is_twisted = largest_motion > _NO_EFFECT * largest_motion.max()
    is_unpredictable = is_twisted[:, unknown].any(axis=1)
    return np.where(is_unpredictable[:, None], np.nan, np.stack(mean_lengths, axis=1))


def _compute_avoided_share(first: float, second: float) -> float | None:
    """Return the avoided share ``1 − second/first`` of a deflection; None if the first deflection is zero."""
    return 1.0 - float(second / first) if first > 0 else None


def _estimate_avoided_share(first: float, second: float, u_first: float, u_second: float) -> Estimate | None:
    """Estimate the avoided share ``1 − second/first`` of a mean deflection (GUM, 5.1.2).

    The result is None if the first deflection is zero.

    Args:
        first: mean deflection of the first campaign [m].
        second: mean deflection of the second campaign [m].
        u_first: standard uncertainty of `first` [m]; NaN if unknown.
        u_second: standard uncertainty of `second` [m]; NaN if unknown.
    """
    share = _compute_avoided_share(first, second)
    if share is None:
        return None
    uncertainty = float(np.hypot(u_second, float(second / first) * u_first) / first)
    return Estimate(value=share, standard_uncertainty=uncertainty if isfinite(uncertainty) else None)


MOST_RELATIVE: Final = 0.25
"""Greatest u(c) / c of estimates that are compared over time: above, ln c is neither normal nor free of
bias."""
_MOST_SHARED: Final = 0.999999
"""Greatest share of an uncertainty that errors common to all campaigns may have: readings have own errors."""
CHANGED_LEVEL: Final = 0.05
"""Greatest probability that any joint of a robot is reported as changed if no joint has changed."""


@dataclass(frozen=True)
class Change:
    """Change of ln k, the logarithm of a joint's stiffness, between two campaigns."""

    difference: float  #: difference of ln k
    standard_uncertainty: float  #: standard uncertainty of the difference
    degrees_of_freedom: float = inf  #: degrees of freedom of the uncertainty; inf where sigma was given

    @classmethod
    def between(
        cls,
        first: tuple[float, float],
        second: tuple[float, float],
        degrees_of_freedom: float = inf,
        shared: float = 0.0,
    ) -> Change:
        """Return the change of ln k from the first to the second campaign.

        Args:
            first: ln k of the first campaign, and the standard uncertainty from errors of this campaign
                alone.
            second: ln k and standard uncertainty of the second campaign.
            degrees_of_freedom: the fewer degrees of freedom of the two uncertainties, so that a change is
                found significant by chance at most as often as the level says.
            shared: standard uncertainty of the difference from errors that both campaigns share.
        """
        return cls(second[0] - first[0], hypot(first[1], second[1], shared), degrees_of_freedom)

    @property
    def relative(self) -> float:
        """Relative change of the stiffness, such as -0.1 for a joint that is 10 % softer."""
        return exp(self.difference) - 1.0

    @property
    def relative_uncertainty(self) -> float:
        """Standard uncertainty of the relative change."""
        return exp(self.difference) * self.standard_uncertainty

    @property
    def p_value(self) -> float:
        """Probability of a change at least as large if the stiffness is the same (two-sided)."""
        ratio = abs(self.difference) / self.standard_uncertainty
        return float(2.0 * special.stdtr(self.degrees_of_freedom, -ratio))

    def is_significant(self, tests: int) -> bool:
        """Return whether the change is significant at `CHANGED_LEVEL` divided by the number of tests."""
        return self.p_value < CHANGED_LEVEL / tests

    def find_unchanged_ratios(self, tests: int) -> tuple[float, float]:
        """Return the ends of the ratios of the stiffnesses that would not be significant among `tests`."""
        probability_of_each_side = 0.5 * CHANGED_LEVEL / tests
        if isinf(self.degrees_of_freedom):
            quantile = float(special.ndtri(probability_of_each_side))
        else:
            quantile = float(special.stdtrit(self.degrees_of_freedom, probability_of_each_side))
        largest_ratio = exp(-quantile * self.standard_uncertainty)  # the quantile is negative
        return 1.0 / largest_ratio, largest_ratio


def log_stiffness(
    compliance: float | None, standard_uncertainty: float | None, shared_uncertainty: float = 0.0
) -> tuple[float, float] | None:
    """Return the logarithm ln k = -ln c of a joint's stiffness, and its standard uncertainty u(c) / c.

    The logarithms of compliance and stiffness have the same standard uncertainty.

    Args:
        compliance: [rad/(N·m)].
        standard_uncertainty: standard uncertainty of the compliance [rad/(N·m)].
        shared_uncertainty: part of the uncertainty from errors that are the same in all campaigns, such as
            the scale of one load cell [rad/(N·m)]; these errors cancel in a difference.

    Returns:
        ln k, and its standard uncertainty from errors of this campaign alone; None if the joint has no
        compliance or uncertainty, if it is rigid, or if the uncertainty of ln k exceeds `MOST_RELATIVE`.
    """
    if compliance is None or standard_uncertainty is None or not compliance > 0:
        return None
    shared = min(shared_uncertainty, _MOST_SHARED * standard_uncertainty)
    relative_uncertainty = sqrt(standard_uncertainty**2 - shared**2) / compliance
    if not 0 < relative_uncertainty <= MOST_RELATIVE:
        return None
    return -log(compliance), relative_uncertainty
