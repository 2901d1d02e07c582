"""A comparison for people, with the numbers of the paper's Table II: joints as rows, methods as columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import floor, log10

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.comparison import ComparedFit, Comparison
from jointstiff.schemas.run.resampling import ResampledJoint, ResamplingResult
from jointstiff.service.kinds.run.resampling_table import moments
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS, StiffnessUnit
from jointstiff.service.tables.terminal import METHOD_NAMES, problem_text
from jointstiff.service.tables.verdict import remedies, to_do_lines, verdict_lines, warning_lines

_SHORT = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_WEIGHTS = {"covariance": "", "characteristic_length": "/L", "uniform": "/u"}
_CONSTRAINTS = {False: "free", True: "≥ 0"}
_METHODS_ABREAST = 4
_LONGEST_NAME = 24


Cell = Callable[[ComparedFit, int], Text]


def comparison_report(
    comparison: Comparison, *, details: bool = False, unit: str = DEFAULT_UNIT
) -> RenderableType:
    """Show the methods side by side, unconstrained and constrained; or why there is no result.

    Args:
        comparison: with its result, or its error.
        details: whether to add the fits as a whole, all warnings, and rows that repeat another.
        unit: name of a unit of `UNITS`.
    """
    result = comparison.result
    if result is None:
        state = Text(f"the comparison is {comparison.state}")
        return problem_text(comparison.error) if comparison.error else state
    parts = verdict_lines(result.assessment, details=details)
    numbers = [entry for entry in result.entries if entry.joints]
    if numbers:
        parts += _numbers(comparison, numbers, UNITS[unit], details=details)
    parts += _refusals(result.entries)
    parts += warning_lines(result.assessment, result.warnings, details=details)
    return Group(*parts, *to_do_lines(remedies(result.assessment), details=details))


def _numbers(
    comparison: Comparison, entries: Sequence[ComparedFit], unit: StiffnessUnit, *, details: bool
) -> list[RenderableType]:
    """Return the joints, what each fit explains, and the words of both."""
    drawn = comparison.request.resampling is not None
    alike = not details and not drawn and _constraints_change_nothing(entries)
    shown = [entry for entry in entries if not entry.positive] if alike else entries
    cell: Cell = partial(_drawn_cell, unit) if drawn else lambda entry, j: unit.concise(entry.joints[j])
    parts: list[RenderableType] = [*_joint_tables(shown, _title(comparison, unit), cell)]
    if drawn:
        parts += _shares_tables(entries)
    parts.append(_fits_table(shown))
    if alike:
        parts.append(Text("≥ 0 gives the same numbers as free: no constraint is active", style="dim"))
    return [*parts, _legend(comparison, shown)]


def _constraints_change_nothing(entries: Sequence[ComparedFit]) -> bool:
    """Return whether each fit has the same numbers unconstrained and constrained."""
    by_constraint = [
        {_short(entry): [joint.model_dump() for joint in entry.joints] for entry in entries if same(entry)}
        for same in (lambda entry: entry.positive, lambda entry: not entry.positive)
    ]
    return by_constraint[0] == by_constraint[1]


def _title(comparison: Comparison, unit: StiffnessUnit) -> str:
    drawn = comparison.request.resampling
    if drawn is None:
        return f"{unit.quantity.capitalize()} in {unit.label}"
    return (
        f"{unit.quantity.capitalize()} in {unit.label}, mean & standard deviation of\n"
        f"{drawn.repetitions} fits of {drawn.size} configurations drawn at random (seed {drawn.seed})"
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


def _drawn_cell(unit: StiffnessUnit, entry: ComparedFit, j: int) -> Text:
    """Format mean & standard deviation."""
    drawn = _joint(entry, j)
    mean, deviation = (None, None) if drawn is None else moments(drawn, unit)
    if mean is None:
        return Text("rigid" if drawn and drawn.share_infinite else "—", style="dim")
    text = _two_digits(mean, deviation)
    return Text(
        text if deviation is None else f"{text} & {_two_digits(deviation)}", style="red" if mean < 0 else ""
    )


def _shares(entry: ComparedFit, j: int) -> Text:
    drawn = _joint(entry, j)
    if drawn is None or entry.joints[j].status == "not_observable":
        return Text("—", style="dim")
    shares = (drawn.share_negative, drawn.share_infinite, drawn.share_undetermined)
    return Text("/".join(f"{100 * share:.2g}" for share in shares), style="red" if shares[0] else "")


def _joint(entry: ComparedFit, j: int) -> ResampledJoint | None:
    return entry.resampling.joints[j] if entry.resampling else None


def _two_digits(value: float, deviation: float | None = None) -> str:
    """Format to two significant digits, or as many as its deviation has decimals."""
    sizes = [abs(size) for size in (value, deviation) if size]
    decimals = max((1 - floor(log10(size)) for size in sizes), default=0)
    return f"{value:.{min(max(decimals, 0), 9)}f}"


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


def _legend(comparison: Comparison, entries: Sequence[ComparedFit]) -> Text:
    """Explain the signs that stand in the tables, and no others."""
    methods = {_SHORT[entry.method]: METHOD_NAMES[entry.method] for entry in entries}
    lengths = {entry.characteristic_length for entry in entries if entry.characteristic_length}
    of = f" of {', '.join(f'{length:.3g}' for length in sorted(lengths))} m" if lengths else ""
    weights = {
        "characteristic_length": f"/L: translations divided by a length{of}",
        "uniform": "/u: uniform weights",
    }
    drawn = comparison.request.resampling is not None
    lines = [
        "; ".join(f"{short}: {name}" for short, name in methods.items()),
        "; ".join(
            weights[entry] for entry in dict.fromkeys(e.weighting for e in entries) if entry in weights
        ),
        "free: unconstrained"
        + ("; ≥ 0: compliances zero or positive" if any(e.positive for e in entries) else ""),
        "drawn: all configurations by the fits of the drawn ones, mean & standard deviation"
        if drawn
        else "3.188(17): 3.188 with standard uncertainty 0.017",
    ]
    return Text("\n".join(line for line in lines if line), style="dim")


def _refusals(entries: Sequence[ComparedFit]) -> list[Text]:
    """Return why methods have no numbers, those of the same reason in one line."""
    methods: dict[str, list[str]] = {}
    for entry in entries:
        if entry.error is not None:
            methods.setdefault(entry.error.detail, []).append(METHOD_NAMES[entry.method])
    return [
        Text(f"no {', '.join(dict.fromkeys(names))}: {detail}", style="yellow")
        for detail, names in methods.items()
    ]
