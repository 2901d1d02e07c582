"""Summary of many resamples: means, standard deviations and shares (method.md §6; paper, Table II)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.resampling.draws import Resamples


@dataclass(frozen=True, eq=False)
class ResamplingSummary:
    """Statistics of the estimates of each of n joints over K repetitions.

    All but `share_undetermined` and `share_any_negative` are over the repetitions that determine the
    joint; NaN where there are too few: none for a mean, share or interval, one for a deviation.
    """

    compliance_mean: FloatArray  #: (n,) [rad/(N·m)]
    compliance_deviation: FloatArray  #: (n,) standard deviation of one repetition [rad/(N·m)]
    compliance_interval: FloatArray  #: (n, 2) percentile interval [rad/(N·m)]
    stiffness_mean: FloatArray  #: (n,) of the finite stiffnesses [N·m/rad]; beside `share_infinite`
    stiffness_deviation: FloatArray  #: (n,) standard deviation of one finite stiffness [N·m/rad]
    #: (n, 2) what the interval of the compliance means for the stiffness [N·m/rad]; open upwards (inf)
    #: where that reaches zero
    stiffness_interval: FloatArray
    share_negative: FloatArray  #: (n,) negative compliance, hence negative stiffness
    #: (n,) compliance of exactly zero: these configurations cannot tell it from rigid
    share_infinite: FloatArray
    share_at_bound: FloatArray  #: (n,) held by a bound, zero or another
    share_undetermined: FloatArray  #: (n,) share of the K repetitions that leave it undetermined
    share_any_negative: float  #: share of the K repetitions with a negative stiffness
    #: over all configurations, of the repetitions that determine every visible joint
    compensation_mean: float
    compensation_deviation: float  #: standard deviation of one repetition
    compensation_interval: tuple[float, float]  #: percentile interval

    def without(self, hidden: BoolArray) -> ResamplingSummary:
        """Withhold the numbers of joints (n,) that the whole set does not show."""
        return replace(
            self,
            compliance_mean=np.where(hidden, np.nan, self.compliance_mean),
            compliance_deviation=np.where(hidden, np.nan, self.compliance_deviation),
            compliance_interval=np.where(hidden[:, None], np.nan, self.compliance_interval),
            stiffness_mean=np.where(hidden, np.nan, self.stiffness_mean),
            stiffness_deviation=np.where(hidden, np.nan, self.stiffness_deviation),
            share_negative=np.where(hidden, 0.0, self.share_negative),
            share_infinite=np.where(hidden, 0.0, self.share_infinite),
            share_undetermined=np.where(hidden, 1.0, self.share_undetermined),
        )


@dataclass(frozen=True)
class _Statistics:
    """Statistics of some numbers; NaN where there are too few."""

    mean: float
    deviation: float
    interval: tuple[float, float]


def summarise(resamples: Resamples, *, confidence: float = 0.95) -> ResamplingSummary:
    """Summarise resamples.

    Args:
        resamples: K repetitions, at least one.
        confidence: share of the repetitions within the percentile intervals.

    Raises:
        RequestError: if there is no repetition, or the confidence is not between 0 and 1.
    """
    if not len(resamples.compliance):
        raise RequestError(
            "there is no repetition to summarise",
            where="resampling.repetitions",
            remedy="request at least one",
        )
    if not 0 < confidence < 1:
        raise RequestError(
            f"the confidence level is {confidence:g}",
            where="confidence",
            remedy="give a number between 0 and 1",
        )
    columns = [c[~np.isnan(c)] for c in resamples.compliance.T]
    compliance = [_statistics(c, confidence) for c in columns]
    stiffness = [_statistics(1.0 / c[c != 0], confidence) for c in columns]
    compensation = resamples.compensation[~np.isnan(resamples.compensation)]
    judged = _statistics(compensation, confidence)
    intervals = np.array([of_joint.interval for of_joint in compliance])
    return ResamplingSummary(
        compliance_mean=np.array([of_joint.mean for of_joint in compliance]),
        compliance_deviation=np.array([of_joint.deviation for of_joint in compliance]),
        compliance_interval=intervals,
        stiffness_mean=np.array([of_joint.mean for of_joint in stiffness]),
        stiffness_deviation=np.array([of_joint.deviation for of_joint in stiffness]),
        stiffness_interval=_stiffness_interval(intervals),
        share_negative=_share(resamples, resamples.compliance < 0),
        share_infinite=_share(resamples, resamples.compliance == 0),
        share_at_bound=_share(resamples, resamples.active != 0),
        share_undetermined=resamples.undetermined.mean(axis=0),
        share_any_negative=float((resamples.compliance < 0).any(axis=1).mean()),
        compensation_mean=judged.mean,
        compensation_deviation=judged.deviation,
        compensation_interval=judged.interval,
    )


def _statistics(values: FloatArray, confidence: float) -> _Statistics:
    nothing = float("nan")
    if not len(values):
        return _Statistics(nothing, nothing, (nothing, nothing))
    tail = (1.0 - confidence) / 2.0
    lower, upper = np.quantile(values, [tail, 1.0 - tail])
    deviation = float(values.std(ddof=1)) if len(values) > 1 else nothing
    return _Statistics(float(values.mean()), deviation, (float(lower), float(upper)))


def _share(resamples: Resamples, which: BoolArray) -> FloatArray:
    """(n,) how many of the repetitions that determine a joint are among `which` (K, n)."""
    determined = (~resamples.undetermined).sum(axis=0)
    share: FloatArray = which.sum(axis=0) / np.where(determined > 0, determined, np.nan)
    return share


def _stiffness_interval(compliance: FloatArray) -> FloatArray:
    """[1/c_hi, 1/c_lo] (n, 2), open upwards where the compliances (n, 2) reach zero."""
    inverse = 1.0 / np.where(compliance == 0, np.nan, compliance)
    reaches_zero = (compliance[:, 0] <= 0) & (compliance[:, 1] >= 0)
    lower = np.where(compliance[:, 1] == 0, np.inf, inverse[:, 1])
    return np.stack([lower, np.where(reaches_zero, np.inf, inverse[:, 0])], axis=1)
