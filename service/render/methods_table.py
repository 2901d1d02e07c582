"""A comparison for people, with the numbers of the paper's Table II: joints as rows, methods as columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import floor, log10

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.comparison import ComparedFit, Comparison
from jointstiff.schemas.run import ResampledJoint, ResamplingResult
from jointstiff.service.render.terminal import METHOD_NAMES, concise_stiffness, problem_text, verdict_report

_SHORT = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_WEIGHTS = {"covariance": "", "characteristic_length": "/L", "uniform": "/u"}
_CONSTRAINTS = {False: "free", True: "≥ 0"}
_METHODS_ABREAST = 4
_LONGEST_NAME = 24
_MEGA = 1e-6


Cell = Callable[[ComparedFit, int], Text]


def comparison_report(comparison: Comparison) -> RenderableType:
    """Show the methods side by side, free and constrained; or why there is no result."""
    if comparison.result is None:
        state = Text(f"the comparison is {comparison.state}")
        return problem_text(comparison.error) if comparison.error else state
    entries = comparison.result.entries
    parts = verdict_report(comparison.result.assessment, comparison.result.warnings)
    numbers = [entry for entry in entries if entry.joints]
    if numbers:
        drawn = comparison.request.resampling is not None
        parts += _joint_tables(numbers, _title(comparison), _drawn_cell if drawn else _cell)
        if drawn:
            parts += _shares_tables(numbers)
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


def _joint_tables(entries: Sequence[ComparedFit], title: str, cell: Cell) -> list[Table]:
    """Return tables of rows by joint and constraint, with as many methods as 80 columns hold."""
    methods = list(dict.fromkeys(_short(entry) for entry in entries))
    return [
        _joint_table(
            [entry for entry in entries if _short(entry) in methods[start : start + _METHODS_ABREAST]],
            "" if start else title,
            cell,
        )
        for start in range(0, len(methods), _METHODS_ABREAST)
    ]


def _shares_tables(entries: Sequence[ComparedFit]) -> list[RenderableType]:
    drawn = [
        joint
        for entry in entries
        for j, joint in enumerate(entry.resampling.joints if entry.resampling else [])
        if entry.joints[j].status != "not_observable"
    ]
    if not any(joint.share_negative or joint.share_infinite or joint.share_undetermined for joint in drawn):
        return [Text("No fit was negative, rigid or undetermined for any joint.")]
    return [*_joint_tables(entries, "Share of fits negative / rigid / undetermined, in %", _shares)]


def _joint_table(entries: Sequence[ComparedFit], title: str, cell: Cell) -> Table:
    by_row: dict[bool, dict[str, ComparedFit]] = {}
    for entry in entries:
        by_row.setdefault(entry.positive, {})[_short(entry)] = entry
    table = _table(title, "joint")
    table.add_column("", no_wrap=True)
    methods = list(dict.fromkeys(map(_short, entries)))
    for method in methods:
        table.add_column(method, justify="right", no_wrap=True)
    for j, joint in enumerate(entries[0].joints):
        name = joint.name
        for positive, row in by_row.items():
            cells = (cell(row[method], j) if method in row else "" for method in methods)
            table.add_row(Text(name), _CONSTRAINTS[positive], *cells)  # a name is no markup
            name = ""
    return table


def _table(title: str, heading: str) -> Table:
    table = Table(title=title or None, box=SIMPLE_HEAD, padding=0, show_edge=False)
    table.add_column(heading, overflow="fold", max_width=_LONGEST_NAME)
    return table


def _label(entry: ComparedFit) -> str:
    return f"{_short(entry)} {_CONSTRAINTS[entry.positive]}"


def _short(entry: ComparedFit) -> str:
    return _SHORT[entry.method] + _WEIGHTS[entry.weighting]


def _cell(entry: ComparedFit, j: int) -> Text:
    return concise_stiffness(entry.joints[j])


def _drawn_cell(entry: ComparedFit, j: int) -> Text:
    """Mean & standard deviation."""
    drawn = _joint(entry, j)
    if drawn is None or drawn.stiffness_mean is None:
        return Text("rigid" if drawn and drawn.share_infinite else "—", style="dim")
    style = "red" if drawn.stiffness_mean < 0 else ""
    if drawn.stiffness_deviation is None:
        return Text(_two_digits(drawn.stiffness_mean), style=style)
    deviation = drawn.stiffness_deviation
    return Text(f"{_two_digits(drawn.stiffness_mean, deviation)} & {_two_digits(deviation)}", style=style)


def _shares(entry: ComparedFit, j: int) -> Text:
    drawn = _joint(entry, j)
    if drawn is None or entry.joints[j].status == "not_observable":
        return Text("—", style="dim")
    shares = (drawn.share_negative, drawn.share_infinite, drawn.share_undetermined)
    return Text("/".join(f"{100 * share:.2g}" for share in shares), style="red" if shares[0] else "")


def _joint(entry: ComparedFit, j: int) -> ResampledJoint | None:
    return entry.resampling.joints[j] if entry.resampling else None


def _two_digits(value: float, deviation: float | None = None) -> str:
    """In 10⁶: two significant digits, or as many as its deviation has decimals."""
    sizes = [abs(size) * _MEGA for size in (value, deviation) if size]
    decimals = max((1 - floor(log10(size)) for size in sizes), default=0)
    return f"{value * _MEGA:.{min(max(decimals, 0), 9)}f}"


def _fits_table(entries: Sequence[ComparedFit]) -> Table:
    """Return what each fit as a whole is worth."""
    table = _table("", "fit")
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
    lines = ["free: unconstrained; ≥ 0: compliances zero or positive; rigid: compliance 0"]
    if comparison.request.resampling is None:
        lines.append("3.188(17): 3.188 with standard uncertainty 0.017")
    lines += [
        "CP: complete pose; PP: partial pose; DPP: decoupled partial pose",
        f"/L: translations divided by a length{of}; /u: uniform weights; else covariance weights",
        "compensation: share of the mean deflection; rms: of the residual vectors",
    ]
    if comparison.request.resampling is not None:
        lines.append("drawn: all configurations by the fits of the drawn ones, mean & standard deviation")
    return Text("\n".join(lines), style="dim")


def _refusals(entries: Sequence[ComparedFit]) -> list[Text]:
    """Why a method has no numbers, once a method."""
    reasons = {
        _short(entry): f"{_short(entry)} ({METHOD_NAMES[entry.method]}): {entry.error.detail}"
        for entry in entries
        if entry.error is not None
    }
    return [Text(reason, style="yellow") for reason in reasons.values()]
