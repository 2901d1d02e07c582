"""Pairs: from two campaigns beside each other to messages."""

from __future__ import annotations

from math import isfinite

import numpy as np

from jointstiff.schemas import pair as pairs
from jointstiff.schemas.run import Certificate
from jointstiff.service.conversion.joints import to_joint
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.inference import JointCompliance
from jointstiff.solver.paired import (
    AvoidedDeflection,
    JointRatio,
    OrderedFit,
    Pair,
    PairSide,
    PredictedDeflection,
    Share,
)

__all__ = ["to_pair_result"]


def to_pair_result(pair: Pair, first: PairSide, second: PairSide) -> pairs.PairResult:
    """The numbers of a pair, without warnings."""
    sides = zip(pair.joints, pair.first.joints, pair.second.joints, strict=True)
    ordered = None
    if pair.ordered is not None and pair.ordered_intervals is not None:
        ordered = _ordered(pair.ordered, pair.ordered_intervals, first.robot.joint_names)
    return pairs.PairResult(
        joints=[_joint(ratio, one, two) for ratio, one, two in sides],
        avoided=_avoided(pair.avoided, first.labels, second.labels),
        ordered=ordered,
        warnings=[],
    )


def _joint(ratio: JointRatio, first: JointCompliance, second: JointCompliance) -> pairs.PairedJoint:
    interval = ratio.interval
    return pairs.PairedJoint(
        name=ratio.name,
        first=to_joint(first),
        second=to_joint(second),
        ratio=ratio.ratio,
        ratio_interval=(interval.lower, interval.upper) if interval else None,
        ratio_excluded=interval.excluded if interval else None,
        p_value=ratio.p_value,
        reason=ratio.reason,
    )


def _avoided(
    avoided: AvoidedDeflection, first: tuple[str, ...], second: tuple[str, ...]
) -> pairs.AvoidedDeflection:
    """Shares by the labels of both sides: the first's observations, then those that only the second has."""
    matches, measured = avoided.matches, avoided.measured
    each = {} if measured is None else dict(zip(matches.first.tolist(), measured.each, strict=True))
    alone = np.setdiff1d(np.arange(len(second)), matches.second).tolist()
    return pairs.AvoidedDeflection(
        matching=len(matches.first),
        measured=None if measured is None else _share(measured.overall),
        predicted=avoided.predicted.value,
        configurations=[
            *(_configuration(label, avoided.of_first, i, each.get(i)) for i, label in enumerate(first)),
            *(_of_second(second[i], avoided.of_second, i) for i in alone),
        ],
    )


def _configuration(
    label: str, predicted: PredictedDeflection, i: int, measured: Share | None
) -> pairs.ConfigurationShare:
    return pairs.ConfigurationShare(
        observation=label,
        side="first" if measured is None else "both",
        measured=None if measured is None else _share(measured),
        predicted=predicted.share(np.array([i])).value,
    )


def _of_second(label: str, predicted: PredictedDeflection, i: int) -> pairs.ConfigurationShare:
    return pairs.ConfigurationShare(
        observation=label, side="second", measured=None, predicted=predicted.share(np.array([i])).value
    )


def _share(share: Share) -> pairs.DeflectionShare:
    return pairs.DeflectionShare(value=share.value, standard_uncertainty=share.standard_uncertainty)


def _ordered(fit: OrderedFit, intervals: FloatArray, names: tuple[str, ...]) -> pairs.OrderedResult:
    return pairs.OrderedResult(
        joints=[_ordered_joint(fit, intervals, j, name) for j, name in enumerate(names)],
        chi_square_increase=fit.chi_square_increase,
        certificate=Certificate(
            primal=max(stage.primal for stage in fit.certificates),
            dual=max(stage.dual for stage in fit.certificates),
            complementarity=max(stage.complementarity for stage in fit.certificates),
            solved_by=[stage.solved_by for stage in fit.certificates],
        ),
    )


def _ordered_joint(fit: OrderedFit, intervals: FloatArray, j: int, name: str) -> pairs.OrderedJoint:
    """A joint without an interval has no number either: the readings do not determine it."""
    one, two = (_known(c[j], ends[j]) for c, ends in zip((fit.first, fit.second), intervals, strict=True))
    return pairs.OrderedJoint(
        name=name,
        compliance_first=one,
        compliance_second=two,
        stiffness_first=_stiffness(one),
        stiffness_second=_stiffness(two),
        compliance_interval_first=_ends(intervals[0, j]),
        compliance_interval_second=_ends(intervals[1, j]),
        equal=bool(fit.equal[j]),
    )


def _known(compliance: float, ends: FloatArray) -> float | None:
    return float(compliance) if np.isfinite(ends).all() and isfinite(compliance) else None


def _ends(ends: FloatArray) -> tuple[float, float] | None:
    low, high = ends.tolist()
    return (low, high) if isfinite(low) and isfinite(high) else None


def _stiffness(compliance: float | None) -> float | None:
    """1 / c; None for a rigid joint and for numbers whose inverse overflows."""
    if not compliance:
        return None
    inverse = 1.0 / compliance
    return inverse if isfinite(inverse) else None
