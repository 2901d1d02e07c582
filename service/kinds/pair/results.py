"""Pairs: from two campaigns beside each other to messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jointstiff.schemas import pair as pairs
from jointstiff.schemas.assessment import Assessment
from jointstiff.schemas.measurement.measurement_set import QualityWarning
from jointstiff.schemas.run.joints import JointResult
from jointstiff.service.conversion.assessments import combined
from jointstiff.service.conversion.message import message
from jointstiff.solver.paired.comparison import JointRatio, Pair


@dataclass(frozen=True, eq=False)
class AssessedSide:
    """A side by itself."""

    assessment: Assessment  # places in it begin with the side
    joints: list[JointResult]  # with their verdicts
    # share of its mean deflection that its model predicts; None where nothing moved
    compensation: float | None
    warnings: list[QualityWarning]  # about its set and its fit; places in them begin with the side


def to_pair_result(
    pair: Pair, first: AssessedSide, second: AssessedSide, about_both: Sequence[QualityWarning]
) -> pairs.PairResult:
    """Return the numbers of a pair."""
    sides = zip(pair.joints, first.joints, second.joints, strict=True)
    avoided, measured = pair.avoided, pair.avoided.measured
    return pairs.PairResult(
        assessment=combined([first.assessment, second.assessment]),
        compensation_first=first.compensation,
        compensation_second=second.compensation,
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
        warnings=[*first.warnings, *second.warnings, *about_both],
    )


def _joint(ratio: JointRatio, first: JointResult, second: JointResult) -> pairs.PairedJoint:
    interval = ratio.interval
    return message(
        pairs.PairedJoint,
        ratio,
        first=first,
        second=second,
        ratio_interval=None if interval is None else (interval.lower, interval.upper),
        ratio_excluded=None if interval is None else interval.excluded,
    )
