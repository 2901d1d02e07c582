"""A comparison for people, in the layout of the paper's Table II: a row a method, a column a joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product, zip_longest
from math import floor, log10
from textwrap import wrap
from typing import Protocol

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.comparison import ComparedFit, Comparison
from jointstiff.schemas.run import ResampledJoint, ResamplingResult
from jointstiff.service.render.terminal import METHOD_NAMES, concise_stiffness, problem_text, warning_lines

__all__ = ["comparison_table"]

_SHORT = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_WEIGHTS = {"covariance": "", "characteristic_length": "/L", "uniform": "/u"}
_LONGEST_NAME = 14
_MEGA = 1e-6


class Cells(Protocol):
    """Makes the cells of a table."""

    def __call__(self, entry: ComparedFit, j: int, *, broken: bool) -> Text:
        """The cell of an entry and a joint, on two lines if it must be narrow."""


def comparison_table(comparison: Comparison, width: int) -> RenderableType:
    """The methods side by side, free and constrained.

    Args:
        comparison: which may have failed.
        width: of the terminal, in characters; the joints are spread over as many tables as it takes.
    """
    if comparison.result is None:
        state = Text(f"the comparison is {comparison.state}")
        return problem_text(comparison.error) if comparison.error else state
    entries = comparison.result.entries
    parts: list[RenderableType] = [
        Text(line, style="yellow") for line in warning_lines(comparison.result.warnings)
    ]
    numbers = [entry for entry in entries if entry.joints]
    if numbers:
        drawn = comparison.request.resampling is not None
        parts += _joint_tables(numbers, _title(comparison), _drawn_cell if drawn else _cell, width)
        if drawn:
            parts += _shares_tables(numbers, width)
        parts.append(_fits_table(numbers))
        parts.append(_legend(comparison))
    return Group(*parts, *_refusals(entries))


def _title(comparison: Comparison) -> str:
    drawn = comparison.request.resampling
    if drawn is None:
        return "Stiffness in 10⁶ N·m/rad"
    return (
        f"Stiffness in 10⁶ N·m/rad, mean & standard deviation of {drawn.repetitions} fits\n"
        f"of {drawn.size} configurations drawn at random (seed {drawn.seed})"
    )


def _joint_tables(entries: Sequence[ComparedFit], title: str, cells: Cells, width: int) -> list[Table]:
    """One table, or several with as many joints as there is room for: a number is never cut."""
    count = len(entries[0].joints)
    for size, broken in product(range(count, 0, -1), (False, True)):
        tables = [
            _joint_table(
                entries,
                title if start == 0 else "",
                partial(cells, broken=broken),
                range(start, min(start + size, count)),
            )
            for start in range(0, count, size)
        ]
        if all(_width(table, width) <= width for table in tables):
            break
    return tables


def _shares_tables(entries: Sequence[ComparedFit], width: int) -> list[RenderableType]:
    drawn = [
        joint
        for entry in entries
        for j, joint in enumerate(entry.resampling.joints if entry.resampling else [])
        if entry.joints[j].status != "not_observable"
    ]
    if not any(joint.share_negative or joint.share_infinite or joint.share_undetermined for joint in drawn):
        return [Text("No fit was negative, rigid or undetermined for any joint.")]
    return [*_joint_tables(entries, "Fits negative / rigid / undetermined, in %", _shares, width)]


def _width(table: Table, width: int) -> int:
    measuring = Console(width=10 * width)
    return Measurement.get(measuring, measuring.options, table).maximum


def _joint_table(
    entries: Sequence[ComparedFit], title: str, cells: Callable[[ComparedFit, int], Text], joints: range
) -> Table:
    table = _table(title)
    for j in joints:
        name = Text("\n".join(wrap(entries[0].joints[j].name, _LONGEST_NAME)))  # a name is no markup
        table.add_column(name, justify="right", no_wrap=True)
    for entry, following in zip_longest(entries, entries[1:]):
        another = following is not None and following.method != entry.method
        table.add_row(_label(entry), *(cells(entry, j) for j in joints), end_section=another)
    return table


def _table(title: str) -> Table:
    table = Table(title=title or None, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("", no_wrap=True)
    return table


def _label(entry: ComparedFit) -> str:
    return f"{_short(entry)} {'≥ 0' if entry.positive else 'free'}"


def _short(entry: ComparedFit) -> str:
    return _SHORT[entry.method] + _WEIGHTS[entry.weighting]


def _cell(entry: ComparedFit, j: int, *, broken: bool) -> Text:  # noqa: ARG001 - it has one number
    return concise_stiffness(entry.joints[j])


def _drawn_cell(entry: ComparedFit, j: int, *, broken: bool) -> Text:
    """Mean & standard deviation."""
    drawn = _joint(entry, j)
    if drawn is None or drawn.stiffness_mean is None:
        return Text("rigid" if drawn and drawn.share_infinite else "—", style="dim")
    style = "red" if drawn.stiffness_mean < 0 else ""
    if drawn.stiffness_deviation is None:
        return Text(_two_digits(drawn.stiffness_mean), style=style)
    deviation = drawn.stiffness_deviation
    blank = "\n" if broken else " "
    return Text(
        f"{_two_digits(drawn.stiffness_mean, deviation)}{blank}& {_two_digits(deviation)}", style=style
    )


def _shares(entry: ComparedFit, j: int, *, broken: bool) -> Text:
    drawn = _joint(entry, j)
    if drawn is None or entry.joints[j].status == "not_observable":
        return Text("—", style="dim")
    shares = (drawn.share_negative, drawn.share_infinite, drawn.share_undetermined)
    slash = "/\n" if broken else "/"
    return Text(slash.join(f"{100 * share:.2g}" for share in shares), style="red" if shares[0] else "")


def _joint(entry: ComparedFit, j: int) -> ResampledJoint | None:
    return entry.resampling.joints[j] if entry.resampling else None


def _two_digits(value: float, deviation: float | None = None) -> str:
    """In 10⁶: two significant digits, or as many as its deviation has decimals."""
    sizes = [abs(size) * _MEGA for size in (value, deviation) if size]
    decimals = max((1 - floor(log10(size)) for size in sizes), default=0)
    return f"{value * _MEGA:.{min(max(decimals, 0), 9)}f}"


def _fits_table(entries: Sequence[ComparedFit]) -> Table:
    """What each fit as a whole is worth."""
    table = _table("")
    drawn = any(entry.resampling for entry in entries)
    names = ["explained", "rms [µm]", "condition"]
    for name in [*names, "explained, drawn", "any negative"] if drawn else names:
        table.add_column(name, justify="right", no_wrap=True)
    for entry in entries:
        condition = "—" if entry.condition_number is None else f"{entry.condition_number:.3g}"
        rms = "—" if entry.rms_residual is None else f"{1e6 * entry.rms_residual:.0f}"
        table.add_row(
            _label(entry), _percent(entry.compensation), rms, condition, *_drawn_worth(entry.resampling)
        )
    return table


def _drawn_worth(resampling: ResamplingResult | None) -> list[str]:
    if resampling is None:
        return []
    found = resampling.compensation
    spread = "" if found.deviation is None else f" & {100 * found.deviation:.2g}"
    return [_percent(found.mean) + spread, _percent(resampling.share_any_negative)]


def _percent(share: float | None) -> str:
    return "—" if share is None else f"{100 * share:.1f} %"


def _legend(comparison: Comparison) -> Text:
    entries = comparison.result.entries if comparison.result else []
    lengths = {entry.characteristic_length for entry in entries if entry.characteristic_length}
    of = f" of {', '.join(f'{length:.3g}' for length in sorted(lengths))} m" if lengths else ""
    lines = ["free: compliances of any sign; ≥ 0: zero or positive; rigid: compliance 0"]
    if comparison.request.resampling is None:
        lines.append("3.188(17): 3.188 with standard uncertainty 0.017")
    lines += [
        "CP: complete pose; PP: partial pose; DPP: decoupled partial pose",
        f"/L: translations divided by a length{of}; /u: all rows alike; else by covariance",
        "explained: share of the mean deflection; rms: of the residual vectors",
    ]
    if comparison.request.resampling is not None:
        lines.append("drawn: of all configurations by fits of the drawn ones, mean & standard deviation")
    return Text("\n".join(lines), style="dim")


def _refusals(entries: Sequence[ComparedFit]) -> list[Text]:
    """Why a method has no numbers, once a method."""
    reasons = {
        _short(entry): f"{_short(entry)} ({METHOD_NAMES[entry.method]}): {entry.error.detail}"
        for entry in entries
        if entry.error is not None
    }
    return [Text(reason, style="yellow") for reason in reasons.values()]
