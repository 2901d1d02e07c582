"""Two campaigns with one kind of robot beside each other: motor and secondary encoders, before and after.

Each is identified by itself; for each joint the ratio of its stiffnesses comes with Fieller's interval
(`ratio`) and the question whether it has changed is answered; the share of the deflection that the
second avoids is measured where configurations match, and predicted for all; and on request both are
identified in one problem in which no joint is softer in the second (`ordered_pair`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimate import identify
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.paired.avoided import (
    ConfigurationShare,
    MeasuredShare,
    PredictedDeflection,
    Share,
    configuration_shares,
    measured_share,
    predicted_deflection,
)
from jointstiff.solver.paired.ordered_pair import (
    OrderedFit,
    OrderedJoint,
    WhitenedCampaign,
    fit_ordered,
    ordered_constraints,
    ordered_intervals,
    ordered_joints,
)
from jointstiff.solver.paired.ratio import (
    GaussianEstimate,
    RatioInterval,
    difference_p_value,
    ratio_interval,
    two_sided_quantile,
)
from jointstiff.solver.paired.sides import Matches, PairSide, match, refuse_other_joints
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import WRIST_JOINTS

_Both = tuple[Estimate, Estimate]

_UNKNOWN = "its uncertainty is unknown in one of the sets: state `noise`, or add observations"
_CONTRADICTION = "the readings give a negative compliance in one of the sets"


@dataclass(frozen=True)
class JointRatio:
    """One joint in both campaigns."""

    name: str
    #: k_second / k_first of the unconstrained estimates; None where one of them is not positive
    ratio: float | None = None
    #: Fieller's, of that ratio; None where nothing can be said, and why
    interval: RatioInterval | None = None
    #: probability of estimates as far apart if the compliance is the same; None likewise
    p_value: float | None = None
    reason: str | None = None  #: why there are no numbers


SAME_PLACE: Final = 1e-9
"""Load points that differ by less are one [m]."""


@dataclass(frozen=True, eq=False)
class AvoidedDeflection:
    """Share of the deflection that the second campaign avoids."""

    matches: Matches  #: the observations that both campaigns have
    measured: MeasuredShare | None  #: from their readings; None if there are none
    of_first: PredictedDeflection  #: predicted for the first campaign's observations
    of_second: PredictedDeflection  #: predicted for the second's
    predicted: Share  #: avoided share of all observations' mean deflection, as predicted; matching once
    #: observation by observation, the first campaign's before those that only the second has
    configurations: tuple[ConfigurationShare, ...]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two campaigns beside each other."""

    first: Estimate  #: estimate of the first by its settings
    second: Estimate  #: estimate of the second by its settings
    joints: tuple[JointRatio, ...]  #: the n ratios
    ordered: OrderedFit | None  #: both in one problem; None if that was not asked for
    #: (2, n, 2) of the compliances in that problem [rad/(N·m)], NaN where a campaign says nothing; None
    #: likewise
    ordered_intervals: FloatArray | None
    avoided: AvoidedDeflection  #: share of the deflection that the second avoids

    @property
    def ordered_joints(self) -> tuple[OrderedJoint, ...]:
        """Numbers by joint in the problem of both campaigns; empty if it was not asked for."""
        if self.ordered is None or self.ordered_intervals is None:
            return ()
        return ordered_joints(self.ordered, self.ordered_intervals, [joint.name for joint in self.joints])


def compare_pair(first: PairSide, second: PairSide, *, confidence: float, ordered: bool) -> Pair:
    """Compare two campaigns whose readings are independent.

    Args:
        first: such as with the motors' encoders in the loop, or before.
        second: such as with secondary encoders in the loop, or after.
        confidence: of the ratios' intervals.
        ordered: whether to identify both in one problem with c_second ≤ c_first for every joint.

    Raises:
        RequestError: the robots' joints differ, a prior takes part, or the order does not go with the
            settings.
        JointstiffError: as `jointstiff.solver.estimate.identify` does of either campaign.
    """
    refuse_other_joints(first.robot, second.robot)
    sides = first, second
    for side in sides:
        if side.settings.prior is not None:
            raise RequestError(
                "the same prior enters both sets, so their estimates are not independent",
                where="priors",
                remedy="omit `priors`",
            )
    estimates = [identify(side.robot, side.measurements, side.settings) for side in sides]
    is_shared = _is_one_hook(first.measurements, second.measurements)
    free = _free(first, without_hook=is_shared), _free(second, without_hook=is_shared)
    positive = all(bool((side.settings.bounds.lower >= 0).all()) for side in sides)
    together = intervals = None
    if ordered:
        together = _together(sides, estimates, free)
        quantile = two_sided_quantile(confidence, min(map(_freedom, free)))
        intervals = ordered_intervals(free, (first.settings, second.settings), together, quantile)
    compliances = estimates[0].compliance, estimates[1].compliance
    if together is not None:
        compliances = np.nan_to_num(together.first), np.nan_to_num(together.second)
    matches = match(first, second)
    measured = None
    if len(matches.first):
        measured = measured_share(first, second, matches, (free[0].sigma, free[1].sigma))
    unknown = free[0].observability.null | free[1].observability.null
    of_first, of_second = (predicted_deflection(side, compliances, unknown) for side in (first, second))
    alone = np.setdiff1d(np.arange(len(second.measurements)), matches.second)
    rest = PredictedDeflection(of_second.first[alone], of_second.second[alone])
    shares = (
        *configuration_shares(first, of_first, "first", matches, measured),
        *(s for i, s in enumerate(configuration_shares(second, of_second, "second")) if i in alone),
    )
    return Pair(
        first=estimates[0],
        second=estimates[1],
        joints=tuple(
            _ratio(j, name, free, confidence, positive=positive)
            for j, name in enumerate(first.robot.joint_names)
        ),
        ordered=together,
        ordered_intervals=intervals,
        avoided=AvoidedDeflection(
            matches, measured, of_first, of_second, of_first.joined(rest).share(), shares
        ),
    )


def _is_one_hook(first: Measurements, second: Measurements) -> bool:
    """Return whether both campaigns assume an error of one load point: it is the same error, and cancels."""
    places = np.vstack([first.load_point, second.load_point])
    assumed = [each.common_uncertainty for each in (first, second)]
    return all(each is not None and each.load_point_assumed for each in assumed) and bool(
        np.ptp(places, axis=0).max() < SAME_PLACE
    )


def _free(side: PairSide, *, without_hook: bool) -> Estimate:
    """The estimate without constraints, which is Gaussian, with the errors that are its campaign's own."""
    unconstrained, measurements = Bounds.unconstrained(side.robot.n), side.measurements
    if without_hook and measurements.common_uncertainty is not None:
        measurements = replace(measurements, common_uncertainty=measurements.common_uncertainty.stated)
    return identify(side.robot, measurements, replace(side.settings, bounds=unconstrained, order=()))


def _together(sides: tuple[PairSide, PairSide], estimates: list[Estimate], free: _Both) -> OrderedFit:
    campaigns = []
    ordered_constraints(
        (sides[0].settings, sides[1].settings)
    )  # refuses contradictions before any work is done
    for side, estimate, sigma in zip(sides, estimates, (each.sigma for each in free), strict=True):
        # one convex problem of both sets cannot take everything in
        arm = side.robot.n - WRIST_JOINTS
        decoupled = side.settings.method == "decoupled_partial_pose"
        faults = {
            "loss `huber`": side.settings.loss == "huber",
            "an order between arm and wrist, which are fitted separately": (
                decoupled and any((i < arm) != (j < arm) for i, j in side.settings.order)
            ),
        }
        for fault in (name for name, present in faults.items() if present):
            raise RequestError(
                f"the joint problem of both sets does not support {fault}",
                where="ordered",
                remedy="omit it, or set `ordered` to false",
            )
        if not sigma:
            raise RequestError(
                "sigma is neither given nor determined by the residuals, so the two sets cannot be weighted",
                where="noise",
                remedy="state `noise.sigma`, or add observations",
            )
        campaigns.append(WhitenedCampaign(estimate, sigma, side.settings))
    return fit_ordered(*campaigns)


def _ratio(j: int, name: str, free: _Both, confidence: float, *, positive: bool) -> JointRatio:
    verdicts = [estimate.joints[j] for estimate in free]
    for which, verdict in zip(("first", "second"), verdicts, strict=True):
        if verdict.compliance is None:
            return JointRatio(name, reason=f"in the {which} set: {verdict.reason}")
    one, two = (_gaussian(estimate, j) for estimate in free)
    if one is None or two is None:
        return JointRatio(name, reason=_UNKNOWN)
    sound = one.value > 0 and two.value > 0
    return JointRatio(
        name,
        ratio=one.value / two.value if sound else None,
        interval=ratio_interval(one, two, confidence, positive=positive),
        p_value=difference_p_value(one, two),
        reason=None if sound else _CONTRADICTION,
    )


def _gaussian(estimate: Estimate, j: int) -> GaussianEstimate | None:
    joint = estimate.joints[j]
    if joint.compliance is None or not joint.standard_uncertainty:
        return None
    return GaussianEstimate(joint.compliance, joint.standard_uncertainty, _freedom(estimate))


def _freedom(estimate: Estimate) -> float:
    """Degrees of freedom of its sigma."""
    return inf if estimate.sigma_given else estimate.degrees_of_freedom
