"""Pairs: from two campaigns beside each other to messages."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas import pair as pairs
from jointstiff.schemas.measurement import QualityWarning
from jointstiff.service.conversion.message import message
from jointstiff.solver.inference import JointCompliance
from jointstiff.solver.paired import JointRatio, Pair


def to_pair_result(pair: Pair, warnings: Sequence[QualityWarning]) -> pairs.PairResult:
    """Return the numbers of a pair."""
    sides = zip(pair.joints, pair.first.joints, pair.second.joints, strict=True)
    avoided, measured = pair.avoided, pair.avoided.measured
    return pairs.PairResult(
        joints=[_joint(ratio, one, two) for ratio, one, two in sides],
        avoided=message(
            pairs.AvoidedDeflection,
            avoided,
            matching=len(avoided.matches.first),
            measured=None if measured is None else measured.overall,
            predicted=avoided.predicted.value,
        ),
        ordered=None
        if pair.ordered is None
        else message(pairs.OrderedResult, pair.ordered, joints=pair.ordered_joints),
        warnings=list(warnings),
    )


def _joint(ratio: JointRatio, first: JointCompliance, second: JointCompliance) -> pairs.PairedJoint:
    interval = ratio.interval
    return message(
        pairs.PairedJoint,
        ratio,
        first=first,
        second=second,
        ratio_interval=None if interval is None else (interval.lower, interval.upper),
        ratio_excluded=None if interval is None else interval.excluded,
    )
