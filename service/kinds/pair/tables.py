"""A pair for people and for spreadsheets: a row a joint; the deflection that the second side avoids."""

from __future__ import annotations

from jointstiff.schemas.pair import (
    DeflectionShare,
    OrderedResult,
    Pair,
    PairedJoint,
    PairResult,
)
from jointstiff.schemas.run import JointResult
from jointstiff.service.tables.report import METHOD_NAMES, Report, View, joint_reason_lines
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import (
    NO_NUMBER,
    Column,
    Line,
    Part,
    Sheet,
    Table,
    Value,
    percent,
    rounded,
)

_SMALLEST_P = 1e-4


def report(job: Pair, result: PairResult, view: View) -> Report:
    """Return the joints on both sides, and the deflection that the second side avoids."""
    parts: list[Part] = [_joints_table(job, result, view.unit)]
    parts += joint_reason_lines((joint.name, joint.reason) for joint in result.joints)
    if result.ordered is not None:
        parts.append(_ordered_table(result.ordered, view.unit))
    avoided = result.avoided
    measured = "no observation is common to both sides"
    if avoided.measured is not None and avoided.measured.value is not None:
        measured = f"measured {_percent(avoided.measured)} in {avoided.matching} observations on both sides"
    predicted = percent(avoided.predicted)
    line = f"  deflection avoided by the second side: {measured}; predicted {predicted} in all"
    return Report([*parts, Line(line)])


def _joints_table(pair: Pair, result: PairResult, unit: StiffnessUnit) -> Table:
    confidence, joints = pair.request.confidence or pair.request.options.confidence, result.joints
    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column("first", [joint.first for joint in joints], unit.concise),
            Column("second", [joint.second for joint in joints], unit.concise),
            Column(
                "ratio",
                joints,
                lambda joint: NO_NUMBER if joint.ratio is None else _number(joint.ratio, joint),
            ),
            Column(f"{100 * confidence:g} % interval", joints, _interval),
            Column(
                "p",
                [joint.p_value for joint in joints],
                lambda p: f"{p:.2g}" if p >= _SMALLEST_P else f"< {_SMALLEST_P:g}",
            ),
        ],
        title=_title(pair),
        caption=f"{unit.quantity} in {unit.label} with its standard uncertainty; ratio of the stiffnesses, "
        "second to first; p: p-value of equal stiffnesses",
    )


def _title(pair: Pair) -> str:
    """Return the title, with the method if both sides are sets."""
    request = pair.request
    if request.first.run_id is not None or request.second.run_id is not None:
        return "Two sides"
    return f"Two sides, {METHOD_NAMES[request.options.method]}"


def _number(ratio: float, joint: PairedJoint) -> str:
    """Format a ratio to two digits of its interval's half width."""
    low, high = joint.ratio_interval or (None, None)
    return rounded(ratio, None if low is None or high is None else max(high - low, 0.0) / 2, ".3g")


def _interval(joint: PairedJoint) -> str:
    ends = joint.ratio_interval
    if ends is None:
        return "—"
    if joint.ratio_excluded is not None:
        low, high = joint.ratio_excluded
        return f"not {low:.3g} … {high:.3g}"
    low_text = "no limit" if ends[0] is None else _number(ends[0], joint)
    return f"{low_text} … {'no limit' if ends[1] is None else _number(ends[1], joint)}"


def _ordered_table(ordered: OrderedResult, unit: StiffnessUnit) -> Table:
    joints = ordered.joints
    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column("first", [joint.compliance_first for joint in joints], unit.bare),
            Column("interval", [joint.compliance_interval_first for joint in joints], unit.bare_interval),
            Column("second", [joint.compliance_second for joint in joints], unit.bare),
            Column("interval", [joint.compliance_interval_second for joint in joints], unit.bare_interval),
            Column("remark", ["held equal" if joint.equal else "" for joint in joints], text=True),
        ],
        title="Both in one problem, no joint softer on the second side",
        caption=f"{unit.quantity} in {unit.label}, interval under all constraints; the order increases χ² by "
        f"{ordered.chi_square_increase:.3g}",
    )


def _percent(share: DeflectionShare) -> str:
    if share.value is None or not share.standard_uncertainty:
        return percent(share.value)
    return f"({100 * share.value:.2f} ± {100 * share.standard_uncertainty:.2f}) %"


def joints_sheet(pair: Pair) -> Sheet:
    """Return the joints of both sides with their ratio."""
    return Sheet.of_rows(_row(joint) for joint in (pair.result.joints if pair.result else ()))


def _row(joint: PairedJoint) -> dict[str, Value]:
    low, high = joint.ratio_interval or (None, None)
    not_from, not_to = joint.ratio_excluded or (None, None)
    return {
        "joint": joint.name,
        **_side("first", joint.first),
        **_side("second", joint.second),
        "ratio of stiffnesses, second to first [1]": joint.ratio,
        "ratio low [1]": low,
        "ratio high [1]": high,
        "excluded ratios from [1]": not_from,
        "excluded ratios to [1]": not_to,
        "p-value of equal stiffnesses [1]": joint.p_value,
        "reason": joint.reason,
    }


def _side(name: str, joint: JointResult) -> dict[str, Value]:
    low, high = joint.stiffness_interval or (None, None)
    return {
        f"{name} status": joint.status,
        f"{name} verdict": joint.verdict,
        f"{name} stiffness [N.m/rad]": joint.stiffness,
        f"{name} stiffness low [N.m/rad]": low,
        f"{name} stiffness high [N.m/rad]": high,
        f"{name} compliance [rad/(N.m)]": joint.compliance,
        f"{name} compliance standard uncertainty [rad/(N.m)]": joint.standard_uncertainty,
    }
