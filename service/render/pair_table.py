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
from jointstiff.service.render.terminal import METHOD_NAMES, concise_stiffness, problem_text, verdict_report

_MEGA = 1e-6
_SMALLEST_P = 1e-4


def pair_report(pair: Pair) -> RenderableType:
    """Warnings first, then the joints, then the deflection."""
    if pair.result is None:
        return problem_text(pair.error) if pair.error else Text(f"the pair is {pair.state}")
    result = pair.result
    parts = verdict_report(result.assessment, result.warnings)
    parts.append(_joints_table(pair, result))
    parts += [Text(f"  {joint.name}: {joint.reason}", style="dim") for joint in result.joints if joint.reason]
    if result.ordered is not None:
        parts.append(_ordered_table(result.ordered))
    parts.append(_avoided(result.avoided))
    return Group(*parts)


def _joints_table(pair: Pair, result: PairResult) -> Table:
    confidence = pair.request.confidence or pair.request.options.confidence
    table = Table(
        title=_title(pair),
        caption="stiffness k in 10⁶ N·m/rad with its standard uncertainty; p: p-value of equal stiffnesses",
    )
    table.add_column("joint")
    for heading in ("k first", "k second", "ratio", f"{100 * confidence:g} % interval", "p"):
        table.add_column(heading, justify="right")
    for joint in result.joints:
        table.add_row(
            Text(joint.name),
            concise_stiffness(joint.first),
            concise_stiffness(joint.second),
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


def _ordered_table(ordered: OrderedResult) -> Table:
    table = Table(
        title="Both in one problem, no joint softer on the second side",
        caption="stiffness in 10⁶ N·m/rad, interval under all constraints; the order increases χ² by "
        f"{ordered.chi_square_increase:.3g}",
    )
    table.add_column("joint")
    for heading in ("k first", "interval", "k second", "interval"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for joint in ordered.joints:
        table.add_row(
            Text(joint.name),
            _stiffness(joint.compliance_first),
            _stiffness_interval(joint.compliance_interval_first),
            _stiffness(joint.compliance_second),
            _stiffness_interval(joint.compliance_interval_second),
            "held equal" if joint.equal else "",
        )
    return table


def _stiffness(compliance: float | None) -> str:
    if compliance is None:
        return "—"
    return f"{_MEGA / compliance:.3g}" if compliance else "rigid"


def _stiffness_interval(ends: tuple[float, float] | None) -> str:
    """In stiffness: the ends of the compliance swap, and one at zero has no limit."""
    if ends is None or ends[1] <= 0:
        return "—"
    upper = f"{_MEGA / ends[0]:.3g}" if ends[0] > 0 else "no limit"
    return f"{_MEGA / ends[1]:.3g} … {upper}"


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
