"""A comparison for people, with the numbers of the paper's Table II: joints as rows, methods as columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

from jointstiff.schemas.comparison import ComparedFit, Comparison, ComparisonResult
from jointstiff.schemas.run import ResampledJoint, ResamplingResult
from jointstiff.service.kinds.run import moments
from jointstiff.service.tables.report import METHOD_NAMES, Report, View
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import (
    Column,
    Line,
    Part,
    Sheet,
    Table,
    Value,
    as_line,
    number,
    percent,
    rounded,
)

_SHORT = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_WEIGHTS = {"covariance": "", "characteristic_length": "/L", "uniform": "/u"}
_CONSTRAINTS = {False: "free", True: "≥ 0"}
_METHODS_ABREAST = 4
_LONGEST_NAME = 24

Cell = Callable[[ComparedFit, int], Line]


def report(job: Comparison, result: ComparisonResult, view: View) -> Report:
    """Return the methods side by side, unconstrained and constrained.

    Details add the fits as a whole, and rows that repeat another.
    """
    entries = [entry for entry in result.entries if entry.joints]
    parts = _numbers(job, entries, view) if entries else []
    return Report([*parts, *_refusals(result.entries)])


def _numbers(comparison: Comparison, entries: Sequence[ComparedFit], view: View) -> list[Part]:
    """Return the joints, what each fit explains, and the words of both."""
    unit, drawn = view.unit, comparison.request.resampling is not None
    alike = not view.details and not drawn and _constraints_change_nothing(entries)
    shown = [entry for entry in entries if not entry.positive] if alike else entries
    cell: Cell = partial(_drawn_cell, unit) if drawn else lambda entry, j: unit.concise(entry.joints[j])
    caption = _legend(comparison, shown, alike=alike)
    parts: list[Part] = [*_joint_tables(shown, _title(comparison, unit), cell, caption)]
    if drawn:
        parts += _shares_tables(entries)
    return [*parts, _fits_table(shown)]


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


def _joint_tables(entries: Sequence[ComparedFit], title: str, cell: Cell, caption: str = "") -> list[Table]:
    """Return tables by joint and constraint, as many methods in each as 80 columns hold."""
    methods = list(dict.fromkeys(_short(entry) for entry in entries))
    return [
        _joint_table(
            [entry for entry in entries if _short(entry) in methods[start : start + _METHODS_ABREAST]],
            f"{title}, continued" if start else title,
            cell,
            "" if start else caption,
        )
        for start in range(0, len(methods), _METHODS_ABREAST)
    ]


def _shares_tables(entries: Sequence[ComparedFit]) -> list[Part]:
    drawn = [
        joint
        for entry in entries
        for j, joint in enumerate(entry.resampling.joints if entry.resampling else [])
        if entry.joints[j].status != "not_observable"
    ]
    if not any(joint.share_negative or joint.share_infinite or joint.share_undetermined for joint in drawn):
        return [Line("No fit was negative, rigid or undetermined for any joint.")]
    return [*_joint_tables(entries, "Share of fits negative / rigid / undetermined, in %", _shares)]


def _joint_table(entries: Sequence[ComparedFit], title: str, cell: Cell, caption: str) -> Table:
    by_row: dict[bool, dict[str, ComparedFit]] = {}
    for entry in entries:
        by_row.setdefault(entry.positive, {})[_short(entry)] = entry
    methods = list(dict.fromkeys(map(_short, entries)))
    lines = [(j, joint, positive) for j, joint in enumerate(entries[0].joints) for positive in by_row]
    first = next(iter(by_row))
    names = [joint.name if positive == first else "" for _, joint, positive in lines]

    def column(method: str) -> Column:
        cells = [cell(by_row[p][method], j) if method in by_row[p] else Line("") for j, _, p in lines]
        return Column(method, cells, as_line)

    return Table(
        [
            Column("joint", names, text=True, widest=_LONGEST_NAME),
            Column("sign", [_CONSTRAINTS[positive] for _, _, positive in lines], text=True),
            *map(column, methods),
        ],
        title=title,
        caption=caption,
        plain=True,
    )


def _short(entry: ComparedFit) -> str:
    return _SHORT[entry.method] + _WEIGHTS[entry.weighting]


def _drawn_cell(unit: StiffnessUnit, entry: ComparedFit, j: int) -> Line:
    """Format mean & standard deviation."""
    drawn = _joint(entry, j)
    mean, deviation = (None, None) if drawn is None else moments(drawn, unit)
    if mean is None:
        return Line("rigid" if drawn and drawn.share_infinite else "—", "dim")
    text = rounded(mean, deviation, ".2g")
    if deviation is not None:
        text += f" & {rounded(deviation, deviation)}"
    return Line(text, "bad" if mean < 0 else "")


def _shares(entry: ComparedFit, j: int) -> Line:
    drawn = _joint(entry, j)
    if drawn is None or entry.joints[j].status == "not_observable":
        return Line("—", "dim")
    shares = (drawn.share_negative, drawn.share_infinite, drawn.share_undetermined)
    return Line("/".join(f"{100 * share:.2g}" for share in shares), "bad" if shares[0] else "")


def _joint(entry: ComparedFit, j: int) -> ResampledJoint | None:
    return entry.resampling.joints[j] if entry.resampling else None


def _fits_table(entries: Sequence[ComparedFit]) -> Table:
    """Return what each fit as a whole is worth."""
    names = [f"{_short(entry)} {_CONSTRAINTS[entry.positive]}" for entry in entries]
    columns = [
        Column("fit", names, text=True, widest=_LONGEST_NAME),
        Column("explained", [percent(entry.compensation) for entry in entries]),
        Column("rms", [entry.rms_residual for entry in entries], number(".0f", 1e6), "µm"),
        Column("condition", [entry.condition_number for entry in entries], number(".3g")),
    ]
    if any(entry.resampling for entry in entries):
        worth = [_drawn_worth(entry.resampling) for entry in entries]
        columns.append(Column("explained, drawn", [explained for explained, _ in worth]))
        columns.append(Column("any negative", [negative for _, negative in worth]))
    return Table(columns, title="Fits as a whole", plain=True)


def _drawn_worth(resampling: ResamplingResult | None) -> tuple[str, str]:
    if resampling is None:
        return "", ""
    compensation = resampling.compensation
    spread = "" if compensation.deviation is None else f" & {100 * compensation.deviation:.2g}"
    return percent(compensation.mean) + spread, percent(resampling.share_any_negative)


def _legend(comparison: Comparison, entries: Sequence[ComparedFit], *, alike: bool) -> str:
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
        "≥ 0 gives the same numbers as free: no constraint is active" if alike else "",
    ]
    return "; ".join(line for line in lines if line)


def _refusals(entries: Sequence[ComparedFit]) -> list[Line]:
    """Return why methods have no numbers, those of the same reason in one line."""
    methods: dict[str, list[str]] = {}
    for entry in entries:
        if entry.error is not None:
            methods.setdefault(entry.error.detail, []).append(METHOD_NAMES[entry.method])
    return [
        Line(f"no {', '.join(dict.fromkeys(names))}: {detail}", "care") for detail, names in methods.items()
    ]


_COLUMNS: Final = {
    "method": "fit.method",
    "weighting": "fit.weighting",
    "constraint": "fit.positive",
    "characteristic_length [m]": "fit.characteristic_length",
    "error": "fit.error.detail",
    "compensation [1]": "fit.compensation",
    "rms_residual [m]": "fit.rms_residual",
    "condition_number [1]": "fit.condition_number",
    "joint": "joint.name",
    "status": "joint.status",
    "verdict": "joint.verdict",
    "stiffness [N.m/rad]": "joint.stiffness",
    "stiffness_low [N.m/rad]": "joint.stiffness_interval.0",
    "stiffness_high [N.m/rad]": "joint.stiffness_interval.1",
    "compliance [rad/(N.m)]": "joint.compliance",
    "compliance_standard_uncertainty [rad/(N.m)]": "joint.standard_uncertainty",
    "compliance_low [rad/(N.m)]": "joint.compliance_interval.0",
    "compliance_high [rad/(N.m)]": "joint.compliance_interval.1",
    "resamples": "draws.repetitions",
    "resampled_stiffness_mean [N.m/rad]": "drawn.stiffness_mean",
    "resampled_stiffness_deviation [N.m/rad]": "drawn.stiffness_deviation",
    "resampled_compliance_mean [rad/(N.m)]": "drawn.compliance_mean",
    "resampled_compliance_deviation [rad/(N.m)]": "drawn.compliance_deviation",
    "share_negative [1]": "drawn.share_negative",
    "share_infinite [1]": "drawn.share_infinite",
    "share_undetermined [1]": "drawn.share_undetermined",
    "share_any_negative [1]": "draws.share_any_negative",
    "resampled_compensation_mean [1]": "draws.compensation.mean",
    "resampled_compensation_deviation [1]": "draws.compensation.deviation",
}
"""Headers, and where each column's numbers stand."""


def entries_sheet(comparison: Comparison) -> Sheet:
    """Return a row an entry and joint. An entry without numbers has one row, with no joint, that says why.

    What there is no number for is empty, and so is the upper end of a stiffness without upper limit.
    """
    entries = comparison.result.entries if comparison.result else ()
    return Sheet.of_rows(
        {header: _cell(row, path) for header, path in _COLUMNS.items()}
        for entry in entries
        for row in _rows(entry)
    )


def _rows(entry: ComparedFit) -> Iterator[dict[str, Any]]:
    draws = entry.resampling
    drawn = [None] * len(entry.joints) if draws is None else draws.joints
    for joint, of_draws in zip(entry.joints, drawn, strict=True):
        yield {"fit": entry, "joint": joint, "draws": draws, "drawn": of_draws}
    if not entry.joints:
        yield {"fit": entry, "joint": None, "draws": None, "drawn": None}


def _cell(row: dict[str, Any], path: str) -> Value:
    """Return the cell of a row at a path."""
    first, *steps = path.split(".")
    value = row[first]
    for step in steps:
        if value is not None:
            value = value[int(step)] if step.isdigit() else getattr(value, step)
    if isinstance(value, bool):
        return "positive" if value else "unconstrained"
    cell: Value = value
    return cell
