"""A pair for people: a row a joint, then the share of the deflection that the second side avoids."""

from __future__ import annotations

from math import floor, log10

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.pair import (
    AvoidedDeflection,
    DeflectionShare,
    OrderedResult,
    Pair,
    PairedJoint,
    PairResult,
)
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS, StiffnessUnit
from jointstiff.service.tables.terminal import METHOD_NAMES, problem_text
from jointstiff.service.tables.verdict import (
    joint_reason_lines,
    remedies,
    to_do_lines,
    verdict_lines,
    warning_lines,
)

_SMALLEST_P = 1e-4


def pair_report(pair: Pair, *, details: bool = False, unit: str = DEFAULT_UNIT) -> RenderableType:
    """Lay out the verdict, the joints, the deflection, and what to do.

    Args:
        pair: with its result, or its error.
        details: whether to add all warnings and reasons.
        unit: name of a unit of `UNITS`.
    """
    if pair.result is None:
        return problem_text(pair.error) if pair.error else Text(f"the pair is {pair.state}")
    result, shown = pair.result, UNITS[unit]
    parts = verdict_lines(result.assessment, details=details)
    parts.append(_joints_table(pair, result, shown))
    parts += joint_reason_lines((joint.name, joint.reason) for joint in result.joints)
    if result.ordered is not None:
        parts.append(_ordered_table(result.ordered, shown))
    parts.append(_avoided(result.avoided))
    parts += warning_lines(result.assessment, result.warnings, details=details)
    return Group(*parts, *to_do_lines(remedies(result.assessment), details=details))


def _joints_table(pair: Pair, result: PairResult, unit: StiffnessUnit) -> Table:
    confidence = pair.request.confidence or pair.request.options.confidence
    table = Table(
        title=_title(pair),
        caption=f"{unit.quantity} in {unit.label} with its standard uncertainty; ratio of the stiffnesses, "
        "second to first; p: p-value of equal stiffnesses",
    )
    table.add_column("joint")
    for heading in ("first", "second", "ratio", f"{100 * confidence:g} % interval", "p"):
        table.add_column(heading, justify="right")
    for joint in result.joints:
        table.add_row(
            Text(joint.name),
            unit.concise(joint.first),
            unit.concise(joint.second),
            "—" if joint.ratio is None else _number(joint.ratio, joint),
            _interval(joint),
            _p_value(joint.p_value),
        )
    return table


def _title(pair: Pair) -> str:
    """With the method, if both sides are sets; runs have their own."""
    request = pair.request
    if request.first.run_id is not None or request.second.run_id is not None:
        return "Two sides"
    return f"Two sides, {METHOD_NAMES[request.options.method]}"


def _number(ratio: float, joint: PairedJoint) -> str:
    """To two digits of the interval's half width."""
    ends = joint.ratio_interval
    if ends is None or ends[0] is None or ends[1] is None or ends[1] <= ends[0]:
        return f"{ratio:.3g}"
    decimals = 1 - floor(log10((ends[1] - ends[0]) / 2))
    return f"{ratio:.{min(max(decimals, 0), 9)}f}"


def _interval(joint: PairedJoint) -> str:
    ends = joint.ratio_interval
    if ends is None:
        return "—"
    if joint.ratio_excluded is not None:
        low, high = joint.ratio_excluded
        return f"not {low:.3g} … {high:.3g}"
    low_text = "no limit" if ends[0] is None else _number(ends[0], joint)
    return f"{low_text} … {'no limit' if ends[1] is None else _number(ends[1], joint)}"


def _p_value(p: float | None) -> str:
    if p is None:
        return "—"
    return f"< {_SMALLEST_P:g}" if p < _SMALLEST_P else f"{p:.2g}"


def _ordered_table(ordered: OrderedResult, unit: StiffnessUnit) -> Table:
    table = Table(
        title="Both in one problem, no joint softer on the second side",
        caption=f"{unit.quantity} in {unit.label}, interval under all constraints; the order increases χ² by "
        f"{ordered.chi_square_increase:.3g}",
    )
    table.add_column("joint")
    for heading in ("first", "interval", "second", "interval"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for joint in ordered.joints:
        table.add_row(
            Text(joint.name),
            unit.bare(joint.compliance_first),
            unit.bare_interval(joint.compliance_interval_first),
            unit.bare(joint.compliance_second),
            unit.bare_interval(joint.compliance_interval_second),
            "held equal" if joint.equal else "",
        )
    return table


def _avoided(avoided: AvoidedDeflection) -> Text:
    predicted = "—" if avoided.predicted is None else f"{100 * avoided.predicted:.1f} %"
    measured = "no observation is common to both sides"
    if avoided.measured is not None and avoided.measured.value is not None:
        measured = f"measured {_percent(avoided.measured)} in {avoided.matching} observations on both sides"
    return Text(f"  deflection avoided by the second side: {measured}; predicted {predicted} in all")


def _percent(share: DeflectionShare) -> str:
    if share.value is None:
        return "—"
    if not share.standard_uncertainty:
        return f"{100 * share.value:.1f} %"
    return f"({100 * share.value:.2f} ± {100 * share.standard_uncertainty:.2f}) %"
