"""Two identified campaigns with one kind of robot: motor and secondary encoders, or before and after.

All comes from the campaigns' estimates. For each joint the ratio of its stiffnesses comes with Fieller's
interval, and with the p-value that it has not changed; on request both are fitted in one problem in which no
joint is softer in the second; and the share of the deflection that the second avoids is measured where the
configurations match, and predicted for all.

For Gaussian ĉ₁, ĉ₂ the variable ``ĉ₁ − ρ ĉ₂`` has mean zero at the true ratio ρ = c₁/c₂ = k₂/k₁, so that
``|ĉ₁ − ρ ĉ₂| ≤ t √(s₁² + ρ² s₂²)`` holds with exactly the probability of t (E. C. Fieller, *Some problems in
interval estimation*, J. R. Stat. Soc. B 16, 1954).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import asin, atan2, hypot, inf, pi, tan
from typing import Final, Literal

import numpy as np
from scipy import special
from scipy.linalg import block_diag

from jointstiff.schemas.run import Certificate as StagesCertificate
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.problem import Bounds, Constraints, Order
from jointstiff.solver.convex.solution import Certificate, greatest_violations
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.estimate import Estimate, Evidence, stiffness_of
from jointstiff.solver.evidence.intervals import profile_ends
from jointstiff.solver.evidence.prediction import predict
from jointstiff.solver.fitting.fit import Likelihood, Scale, StageFit, fit_method
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import WRIST_JOINTS, Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import regressor_blocks

SAME_PLACE: Final = 1e-9
"""Load points that differ by less are one [m]."""
POSTURE_TOLERANCE: Final = 1e-3
"""Tolerance of each joint angle [rad]: it changes a lever of 3 m by a thousandth."""
LOAD_TOLERANCE: Final = 5e-3
"""Tolerance of the load, relative to its magnitude."""
LOAD_POINT_TOLERANCE: Final = 1e-3
"""Tolerance of the load point [m]."""
_MODEL_TOLERANCE: Final = 1e-9
_NO_EFFECT: Final = 1e-9
"""Norm of a joint's column, relative to the largest, that counts as rounding."""
_QUARTER: Final = pi / 2
_UNKNOWN: Final = "its uncertainty is unknown in one of the sets: state `noise`, or add observations"


@dataclass(frozen=True, eq=False)
class Campaign:
    """One of the two campaigns, identified by itself."""

    robot: Robot  #: n joints
    measurements: Measurements  #: N observations of T targets
    settings: Settings  #: settings of its identification, without priors
    estimate: Estimate  #: estimate by these settings


_Pair = tuple[Campaign, Campaign]
_Estimates = tuple[Estimate, Estimate]


@dataclass(frozen=True)
class GaussianEstimate:
    """An unconstrained estimate of a compliance."""

    value: float  #: [rad/(N·m)]
    standard_uncertainty: float  #: positive, in the same unit
    degrees_of_freedom: float = inf  #: degrees of freedom of that uncertainty; inf where sigma was given


@dataclass(frozen=True)
class RatioInterval:
    """All ratios that the estimates do not exclude, or the least interval that holds them."""

    lower: float | None  #: None where there is no lower limit
    upper: float | None  #: None where there is no upper limit
    #: where the ratios are those outside an interval, that interval; else None
    excluded: tuple[float, float] | None = None


@dataclass(frozen=True)
class JointRatio:
    """One joint in both campaigns."""

    name: str
    #: k_second / k_first of the unconstrained estimates; None where one of them is not positive
    ratio: float | None = None
    interval: RatioInterval | None = None  #: Fieller's interval of that ratio; None where there is none
    #: probability of estimates as far apart if the compliance is the same; None where it is unknown
    p_value: float | None = None
    reason: str | None = None  #: why there are no numbers


@dataclass(frozen=True, eq=False)
class OrderedJoint:
    """One joint in the problem of both campaigns; NaN where a campaign does not determine it."""

    name: str
    compliance_first: float  #: compliance in the first campaign [rad/(N·m)]
    compliance_second: float  #: compliance in the second campaign, never above [rad/(N·m)]
    #: (2,) profile-likelihood interval under all constraints, first campaign [rad/(N·m)]
    compliance_interval_first: FloatArray
    compliance_interval_second: FloatArray  #: (2,) that of the second campaign [rad/(N·m)]
    equal: bool  #: whether the order holds both together

    @property
    def stiffness_first(self) -> float | None:
        """Stiffness in the first campaign [N·m/rad]; None for a rigid joint."""
        return stiffness_of(self.compliance_first)

    @property
    def stiffness_second(self) -> float | None:
        """Stiffness in the second campaign [N·m/rad]; None for a rigid joint."""
        return stiffness_of(self.compliance_second)


@dataclass(frozen=True, eq=False)
class OrderedFit:
    """The optimum of both campaigns together."""

    names: tuple[str, ...]  #: names of the n joints
    #: (2, n) compliances in the first and the second campaign, nowhere greater in the second [rad/(N·m)]; NaN
    #: for joints that a campaign does not see
    compliance: FloatArray
    intervals: FloatArray  #: (2, n, 2) [rad/(N·m)]; NaN for joints that a campaign does not determine
    equal: BoolArray  #: (n,) joints that the order holds together
    #: increase of both campaigns' χ² by the order; large where the readings contradict it
    chi_square_increase: float
    certificates: tuple[Certificate, ...]  #: certificates of each stage of the method

    @property
    def certificate(self) -> StagesCertificate:
        """The greatest violations over the stages."""
        return greatest_violations(self.certificates)

    @property
    def joints(self) -> tuple[OrderedJoint, ...]:
        """Numbers by joint; one without an interval has no compliance either."""
        c = np.where(np.isfinite(self.intervals).all(axis=2), self.compliance, np.nan).tolist()
        columns = zip(self.names, *c, *self.intervals, self.equal.tolist(), strict=True)
        return tuple(OrderedJoint(*joint) for joint in columns)


@dataclass(frozen=True, eq=False)
class Matches:
    """Observations of the same posture under the same load, in both campaigns."""

    observations: IndexArray  #: (2, K) their indices in the first and in the second campaign
    targets: IndexArray  #: (2, T) indices of the shared targets in both campaigns
    present: BoolArray  #: (K, T) shared targets read in both
    unlike: tuple[str, ...]  #: labels that both have, with another posture or load, or no shared target


@dataclass(frozen=True)
class Share:
    """``1 − d_second / d_first`` of mean deflections d."""

    value: float | None  #: dimensionless; None where the first did not move
    standard_uncertainty: float | None = None  #: from that of the readings; None where it is unknown


@dataclass(frozen=True)
class ConfigurationShare:
    """Share of the deflection avoided in one observation, over its targets."""

    observation: str  #: its label
    side: Literal["first", "second", "both"]  #: campaigns that have it
    measured: Share | None  #: from the readings; None unless both have it
    predicted: float | None  #: from both campaigns' compliances, dimensionless; None where they do not tell


@dataclass(frozen=True)
class AvoidedDeflection:
    """Share of the deflection that the second campaign avoids."""

    matching: int  #: number of observations that both campaigns have
    unlike: tuple[str, ...]  #: labels that both have, with another posture or load, or no shared target
    #: share of the mean deflection of the matching observations, from their readings; None if there are none
    measured: Share | None
    #: predicted share of the mean deflection of all observations, matching ones counted once
    predicted: float | None
    #: observation by observation, the first campaign's before those that only the second has
    configurations: tuple[ConfigurationShare, ...]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two campaigns side by side."""

    joints: tuple[JointRatio, ...]  #: the n ratios
    ordered: OrderedFit | None  #: both in one problem; None if that was not asked for
    avoided: AvoidedDeflection  #: share of the deflection that the second avoids


def compare_campaigns(
    first: Campaign, second: Campaign, *, confidence: float, ordered: bool = False
) -> Comparison:
    """Compare two campaigns whose readings are independent.

    Args:
        first: such as with the motors' encoders in the loop, or before.
        second: such as with secondary encoders in the loop, or after.
        confidence: level of the intervals, between 0 and 1.
        ordered: whether to fit both in one problem with c_second ≤ c_first for every joint.

    Raises:
        RequestError: the robots' joints differ, a prior takes part, or the order does not go with the
            settings.
        SolverError: optimality could not be certified.
    """
    refuse_other_joints(first.robot, second.robot)
    pair = first, second
    if any(campaign.settings.prior is not None for campaign in pair):
        raise RequestError(
            "the same prior enters both sets, so their estimates are not independent",
            where="priors",
            remedy="omit `priors`",
        )
    # What both assume of one load point is the same error, and cancels.
    places = np.vstack([campaign.measurements.load_point for campaign in pair])
    common = [campaign.measurements.common_uncertainty for campaign in pair]
    assumed = all(each is not None and each.load_point_assumed for each in common)
    same = assumed and bool(np.ptp(places, axis=0).max() < SAME_PLACE)
    free = unconstrained(first, same_load_point=same), unconstrained(second, same_load_point=same)
    positive = all(bool((campaign.settings.bounds.lower >= 0).all()) for campaign in pair)
    together = fit_ordered(pair, free, confidence) if ordered else None
    compliances = np.stack([campaign.estimate.compliance for campaign in pair])
    if together is not None:
        compliances = np.nan_to_num(together.compliance)
    return Comparison(
        joints=tuple(
            _joint_ratio(j, name, free, confidence, positive=positive)
            for j, name in enumerate(first.robot.joint_names)
        ),
        ordered=together,
        avoided=avoided_deflection(pair, free, compliances),
    )


def refuse_other_joints(first: Robot, second: Robot) -> None:
    """Refuse robots whose joints do not correspond.

    Raises:
        RequestError: they differ in number or names.
    """
    if first.joint_names != second.joint_names:
        raise RequestError(
            f"the robots have different joints: {', '.join(first.joint_names)}, and "
            f"{', '.join(second.joint_names)}",
            where="second",
            remedy="compare sets of one robot, or of two robots of the same model with the same joint names",
        )


def models_differ(first: Robot, second: Robot) -> bool:
    """Return whether two robots of the same joints differ in geometry or joint map, seen in two postures."""
    postures = np.stack([np.zeros(first.n), np.linspace(0.3, 1.1, first.n)])
    shapes = []
    for robot in (first, second):
        at = Configurations(robot, robot.joint_map.model_angles(postures))
        shapes.append((at.q, at.jacobian, at.flange_rotation, at.flange_translation))
    return any(bool((np.abs(a - b) > _MODEL_TOLERANCE).any()) for a, b in zip(*shapes, strict=True))


def unconstrained(campaign: Campaign, *, same_load_point: bool) -> Estimate:
    """Return the estimate without constraints, which is Gaussian, with its campaign's own errors.

    It is read off the campaign's estimate where no constraint holds a joint. Where one does, or a robust loss
    weighs the readings under constraints, weights, K_c and common errors are those of other compliances, so
    that the campaign is identified again.

    Args:
        campaign: identified under constraints.
        same_load_point: whether an assumed error of the load point is the same in both campaigns.
    """
    robot, measurements, estimate = campaign.robot, campaign.measurements, campaign.estimate
    settings = replace(campaign.settings, bounds=Bounds.unconstrained(robot.n), order=())
    likelihood, common = estimate.likelihood, measurements.common_uncertainty
    if same_load_point and common is not None:
        measurements = replace(measurements, common_uncertainty=common.stated)
    held = likelihood is None or (likelihood.centre != estimate.compliance[likelihood.joints]).any()
    if held or estimate.robust is not None:
        return identify(robot, measurements, settings)
    if not same_load_point or estimate.common is None or not estimate.sigma:
        return estimate
    fit = fit_method(estimate.triangles, estimate.observability.null, settings.constraints)
    for source, responses in estimate.common.by_source.items():
        if source != "assumed_load_point":
            fit = fit.with_common(responses / estimate.sigma)
    evidence = Evidence(
        robot.joint_names,
        fit,
        estimate.observability,
        Scale(estimate.sigma, estimate.sigma_given, estimate.chi_square, estimate.degrees_of_freedom),
        settings.constraints,
        settings.confidence,
        prior_to_data=np.full(robot.n, np.nan),
    )
    return replace(estimate, joints=evidence.verdicts(), covariance=estimate.sigma**2 * fit.covariance)


def _joint_ratio(j: int, name: str, free: _Estimates, confidence: float, *, positive: bool) -> JointRatio:
    gaussian = []
    for which, estimate in zip(("first", "second"), free, strict=True):
        joint = estimate.joints[j]
        if joint.compliance is None:
            return JointRatio(name, reason=f"in the {which} set: {joint.reason}")
        if joint.standard_uncertainty:
            gaussian.append(
                GaussianEstimate(joint.compliance, joint.standard_uncertainty, _freedom(estimate))
            )
    if len(gaussian) < len(free):
        return JointRatio(name, reason=_UNKNOWN)
    one, two = gaussian
    sound = one.value > 0 and two.value > 0
    return JointRatio(
        name,
        ratio=one.value / two.value if sound else None,
        interval=ratio_interval(one, two, confidence, positive=positive),
        p_value=difference_p_value(one, two),
        reason=None if sound else "the readings give a negative compliance in one of the sets",
    )


def _freedom(estimate: Estimate) -> float:
    """Return the degrees of freedom of its sigma; inf where that was given."""
    return inf if estimate.sigma_given else estimate.degrees_of_freedom


def two_sided_quantile(confidence: float, degrees_of_freedom: float) -> float:
    """Return the quantile t of Student's distribution, normal for inf, such that ±t covers `confidence`."""
    return float(special.stdtrit(degrees_of_freedom, 0.5 + confidence / 2))


def ratio_interval(
    first: GaussianEstimate, second: GaussianEstimate, confidence: float, *, positive: bool
) -> RatioInterval | None:
    """Return Fieller's interval of c_first / c_second = k_second / k_first.

    In units of the uncertainties, with the point ``(ĉ₂/s₂, ĉ₁/s₁)`` at distance r and angle θ, it is
    ``|sin(θ − φ)| ≤ t/r`` for ``tan φ = ρ s₂/s₁``: an arc of directions, repeated every half turn. It may
    pass through the vertical, where the ratio is infinite: then it has no upper limit.

    Exact where both uncertainties have the same degrees of freedom from one sigma, or sigma is given; else
    the fewer degrees of freedom are taken, which covers at least as often.

    Args:
        first: estimate of the first compliance.
        second: estimate of the second, independent of it.
        confidence: between 0 and 1.
        positive: whether both compliances are known to be zero or positive: the ratio is, too.

    Returns:
        The interval; None if `positive` and all ratios that the estimates allow are negative.
    """
    t = two_sided_quantile(confidence, min(first.degrees_of_freedom, second.degrees_of_freedom))
    y = first.value / first.standard_uncertainty
    x = second.value / second.standard_uncertainty
    scale = first.standard_uncertainty / second.standard_uncertainty
    r = hypot(x, y)
    if r <= t:
        return RatioInterval(0.0 if positive else None, None)
    angle = atan2(y, x)
    if angle > _QUARTER or angle <= -_QUARTER:  # a ratio does not change when both signs do
        angle -= pi if angle > 0 else -pi
    low, high = angle - asin(t / r), angle + asin(t / r)
    lower, upper = scale * tan(low), scale * tan(high)
    if low > -_QUARTER and high < _QUARTER:
        if positive and upper < 0.0:
            return None
        return RatioInterval(max(0.0, lower) if positive else lower, upper)
    # Through the vertical: all ratios but those between the arc's ends
    if positive and upper < 0.0:
        return RatioInterval(max(0.0, lower), None)
    return RatioInterval(0.0 if positive else None, None, (upper, lower))


def difference_p_value(first: GaussianEstimate, second: GaussianEstimate) -> float:
    """Return the probability of estimates as far apart if the compliance has not changed (two-sided)."""
    spread = hypot(first.standard_uncertainty, second.standard_uncertainty)
    freedom = min(first.degrees_of_freedom, second.degrees_of_freedom)
    return float(2.0 * special.stdtr(freedom, -abs(first.value - second.value) / spread))


def fit_ordered(pair: _Pair, free: _Estimates, confidence: float) -> OrderedFit:
    """Fit both campaigns in one problem subject to ``c_second ≤ c_first`` for every joint (method.md §5).

    The unknowns are the 2 n compliances of both. The rows of each campaign are those of its estimate, stage
    by stage, whitened by its sigma; the order is a constraint between the campaigns beside their own.

    Args:
        pair: the softer campaign, such as with the motors' encoders in the loop, and the stiffer one.
        free: their estimates without constraints.
        confidence: level of the intervals.

    Raises:
        RequestError: the constraints contradict each other, or do not go with one problem of both.
        UnsupportedMethodError: the campaigns are identified by different methods.
        SolverError: optimality could not be certified.
    """
    sigmas = [_sigma_in_one_problem(*each) for each in zip(pair, free, strict=True)]
    settings, triangles = zip(*((one.settings, one.estimate.triangles) for one in pair), strict=True)
    if settings[0].method != settings[1].method:
        raise UnsupportedMethodError(
            f"both sets must use one method, not {settings[0].method} and {settings[1].method}",
            where="ordered",
            remedy="identify both by the same method, or set `ordered` to false",
        )
    n = pair[0].robot.n
    bounds = Bounds(
        np.concatenate([each.bounds.lower for each in settings]),
        np.concatenate([each.bounds.upper for each in settings]),
    )
    own: Order = tuple((i + k * n, j + k * n) for k in (0, 1) for i, j in settings[k].order)
    apart, together = Constraints(bounds, own), Constraints(bounds, (*((n + j, j) for j in range(n)), *own))
    seen = np.concatenate([~one.estimate.observability.null for one in pair])
    c, increase, certificates = np.zeros(2 * n), 0.0, []
    for stage, *sides in zip(triangles[0].method.stages, *(each.stages for each in triangles), strict=True):
        joints, known = (
            np.flatnonzero(seen & np.tile(np.isin(np.arange(n), part), 2))
            for part in (stage.joints, stage.known)
        )
        if not len(joints):
            continue
        R = block_diag(*(side.matrix / sigma for side, sigma in zip(sides, sigmas, strict=True)))
        z = np.concatenate([side.rhs / sigma for side, sigma in zip(sides, sigmas, strict=True)])
        z, R = z - R[:, known] @ c[known], R[:, joints]
        ordered, separate = (
            StageFit.of(R, z, joints, each.select(joints), None, 2 * n).solution for each in (together, apart)
        )
        increase += float(np.square(R @ ordered.compliance - z).sum())
        increase -= float(np.square(R @ separate.compliance - z).sum())
        c[joints] = ordered.compliance
        certificates.append(ordered.certificate)
    quantile = two_sided_quantile(confidence, min(map(_freedom, free)))
    compliance = np.where(seen, c, np.nan).reshape(2, n)
    return OrderedFit(
        names=pair[0].robot.joint_names,
        compliance=compliance,
        intervals=_ordered_intervals(free, together, c, quantile),
        equal=compliance[0] == compliance[1],
        chi_square_increase=max(0.0, increase),
        certificates=tuple(certificates),
    )


def _sigma_in_one_problem(campaign: Campaign, free: Estimate) -> float:
    """Return the sigma that weighs a campaign beside another; refuse what one problem cannot take in."""
    arm, settings = campaign.robot.n - WRIST_JOINTS, campaign.settings
    across = any((i < arm) != (j < arm) for i, j in settings.order)
    fault = None
    if settings.loss == "huber":
        fault = "loss `huber`"
    elif settings.method == "decoupled_partial_pose" and across:
        fault = "an order between arm and wrist, which are fitted separately"
    if fault is not None:
        raise RequestError(
            f"the joint problem of both sets does not support {fault}",
            where="ordered",
            remedy="omit it, or set `ordered` to false",
        )
    if not free.sigma:
        raise RequestError(
            "sigma is neither given nor determined by the residuals, so the two sets cannot be weighted",
            where="noise",
            remedy="state `noise.sigma`, or add observations",
        )
    return free.sigma


def _ordered_intervals(
    free: _Estimates, constraints: Constraints, c: FloatArray, quantile: float
) -> FloatArray:
    """Return profile-likelihood intervals (2, n, 2) under both campaigns' constraints and the order.

    Both estimates are Gaussian and independent, so their likelihood is that of 2 n compliances with a
    covariance of two blocks. Joints of which a campaign says nothing are left out: they neither get an
    interval nor bound another. The intervals are widened to contain the estimate c (2 n,): that of a method
    that is not maximum likelihood, such as the decoupled one, may lie outside its own interval.
    """
    ends = np.full((len(c), 2), np.nan)
    known = np.flatnonzero(np.concatenate([estimate.estimated for estimate in free]))
    covariances = [estimate.covariance for estimate in free if estimate.covariance is not None]
    if len(known):
        likelihood = Likelihood(
            joints=known,
            centre=np.concatenate([estimate.compliance for estimate in free])[known],
            covariance=block_diag(*covariances)[np.ix_(known, known)],
        )
        rows, radii = np.eye(len(known)), np.array([quantile])
        low, high = profile_ends(likelihood, constraints.select(known), rows, radii)[0].T
        ends[known] = np.stack([np.minimum(low, c[known]), np.maximum(high, c[known])], axis=1)
    return ends.reshape(2, -1, 2)


def match(first: Campaign, second: Campaign) -> Matches:
    """Find the observations of equal label, posture and load that share a target."""
    one, two = first.measurements, second.measurements
    shared = [name for name in one.targets if name in two.targets]
    targets = np.array([[own.targets.index(name) for name in shared] for own in (one, two)], np.intp)
    place = {label: i for i, label in enumerate(two.labels)}
    both = [(i, place[label]) for i, label in enumerate(one.labels) if label in place]
    rows = np.array(both, dtype=np.intp).reshape(-1, 2).T
    sides = []
    for m, at, target in zip((one, two), rows[..., None], targets, strict=True):
        direction = np.zeros(m.position.shape) if m.direction is None else m.direction
        sides.append((direction[at, target], m.present[at, target]))
    (along, read), (other, also_read) = sides
    cosine = np.abs((along * other).sum(axis=-1))  # a gauge on the flange turns with the postures
    alike = (cosine > np.cos(2.0 * POSTURE_TOLERANCE)) | ~(along.any(axis=-1) | other.any(axis=-1))
    present = read & also_read & alike
    i, k = rows
    same = np.abs(one.joints[i] - two.joints[k]).max(axis=1) <= POSTURE_TOLERANCE
    near = np.linalg.norm(one.load_point[i] - two.load_point[k], axis=1) <= LOAD_POINT_TOLERANCE
    same &= near | ~one.force[i].any(axis=1)
    for a, b in ((one.force[i], two.force[k]), (one.moment[i], two.moment[k])):
        size = np.maximum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1))
        same &= np.linalg.norm(a - b, axis=1) <= LOAD_TOLERANCE * size
    kept = same & present.any(axis=1)
    return Matches(rows[:, kept], targets, present[kept], tuple(one.labels[j] for j in i[~kept]))


def avoided_deflection(pair: _Pair, free: _Estimates, compliances: FloatArray) -> AvoidedDeflection:
    """Return the share of the deflection that the second campaign avoids, measured and predicted.

    Args:
        pair: both campaigns.
        free: their estimates without constraints: their sigma, and the joints that they see.
        compliances: (2, n) of the joints in both [rad/(N·m)].
    """
    matches = match(*pair)
    each, measured = measured_shares(pair, matches, (free[0].sigma, free[1].sigma))
    unknown = free[0].observability.null | free[1].observability.null
    of_first, of_second = (_predicted_lengths(one, compliances, unknown) for one in pair)
    first, second = (campaign.measurements.labels for campaign in pair)
    alone = np.setdiff1d(np.arange(len(second)), matches.observations[1])
    total = np.nansum(np.vstack([of_first, of_second[alone]]), axis=0)
    by_row = dict(zip(matches.observations[0].tolist(), each, strict=True))
    shares = [
        ConfigurationShare(
            label, "both" if i in by_row else "first", by_row.get(i), _share(*of_first[i]).value
        )
        for i, label in enumerate(first)
    ]
    shares += [ConfigurationShare(second[i], "second", None, _share(*of_second[i]).value) for i in alone]
    return AvoidedDeflection(len(each), matches.unlike, measured, _share(*total).value, tuple(shares))


def measured_shares(
    pair: _Pair, matches: Matches, sigmas: Sequence[float | None]
) -> tuple[list[Share], Share | None]:
    """Compare the readings of matching observations.

    The length of a deflection d has to first order the standard uncertainty ``√(d̂ᵀ Σ d̂)``, d̂ its
    direction and Σ its covariance; readings are independent.

    Args:
        pair: the campaign with the greater deflections, and the other.
        matches: their K matching observations.
        sigmas: standard uncertainty of one coordinate of one reading in each campaign [m], or None.

    Returns:
        Share of the mean deflection of the shared targets, by observation (K,) and over all.
    """
    means, uncertainties, count = [], [], matches.present.sum(axis=1)
    for campaign, rows, targets, sigma in zip(
        pair, matches.observations[..., None], matches.targets, sigmas, strict=True
    ):
        deflection = campaign.measurements.deflection[rows, targets]
        covariance = campaign.measurements.covariance
        if covariance.ndim == 4:
            covariance = covariance[rows, targets]
        length = np.linalg.norm(deflection, axis=2)
        direction = deflection / np.where(length > 0, length, 1.0)[..., None]
        variance = np.sum(direction * (covariance @ direction[..., None])[..., 0], axis=2)
        means.append((length * matches.present).sum(axis=1) / count)
        scale = np.nan if sigma is None else sigma
        uncertainties.append(scale * np.sqrt((variance * matches.present).sum(axis=1)) / count)
    each = [_share(*numbers) for numbers in zip(*means, *uncertainties, strict=True)]
    if not each:
        return each, None
    totals = [float(mean.sum()) for mean in means]
    return each, _share(*totals, *(float(np.sqrt((u**2).sum())) for u in uncertainties))


def _predicted_lengths(campaign: Campaign, compliances: FloatArray, unknown: BoolArray) -> FloatArray:
    """Return the mean predicted deflection of each observation's targets, by both campaigns' compliances.

    Args:
        campaign: N observations, of either campaign.
        compliances: (2, n) of both campaigns [rad/(N·m)].
        unknown: (n,) joints of which one of the campaigns says nothing.

    Returns:
        (N, 2) [m]; NaN for observations that twist an unknown joint.
    """
    robot, measurements = campaign.robot, campaign.measurements
    bent, means = campaign.settings.complementary_stiffness, []
    for compliance in compliances:
        predicted = predict(robot, measurements, compliance, complementary_stiffness=bent).predicted
        lengths = np.linalg.norm(predicted, axis=2) * measurements.present
        means.append(lengths.sum(axis=1) / measurements.present.sum(axis=1))
    blocks = regressor_blocks(robot, measurements)
    size = np.concatenate([np.abs(block.A).max(axis=(1, 2)) for block in blocks])
    hidden = (size[:, unknown] > _NO_EFFECT * size.max()).any(axis=1)
    return np.where(hidden[:, None], np.nan, np.stack(means, axis=1))


def _share(first: float, second: float, u_first: float = np.nan, u_second: float = np.nan) -> Share:
    """Return the share, with the law of propagation of uncertainty (GUM, 5.1.2)."""
    if not first > 0:
        return Share(None)
    ratio = second / first
    uncertainty = float(np.hypot(u_second, ratio * u_first) / first)
    return Share(float(1.0 - ratio), uncertainty if np.isfinite(uncertainty) else None)
