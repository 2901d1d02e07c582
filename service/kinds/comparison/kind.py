"""A comparison: methods side by side, or two measurement sets, and what people read of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from jointstiff.schemas.comparison import (
    CampaignComparison,
    ComparedRun,
    ComparedSide,
    Comparison,
    ComparisonRequest,
    ComparisonResult,
    Constraint,
    JointRatio,
    OrderedResult,
)
from jointstiff.schemas.comparison import Side as SideName
from jointstiff.schemas.fields import Message
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.robot import Estimate
from jointstiff.schemas.run import JointResult, ResampledJoint, ResamplingResult
from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.kinds.run.kind import moments
from jointstiff.service.tables.report import METHOD_NAMES, Report, View, joint_reason_lines
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import (
    NO_NUMBER,
    Chart,
    Column,
    Line,
    Part,
    Sheet,
    Table,
    as_line,
    number,
    percent,
    rounded,
)

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs

_SIDES: Final = ("first", "second")
_SHORT: Final = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_WEIGHTS: Final = {"covariance": "", "characteristic_length": "/L", "uniform": "/u"}
_CONSTRAINTS: Final = {False: "free", True: "≥ 0"}
_METHODS_ABREAST: Final = 4
_LONGEST_NAME: Final = 24

Cell = Callable[[ComparedRun, int], Line]


def report(_job: Comparison, result: ComparisonResult, view: View) -> Report:
    """Return the ratios of two sides, then the runs side by side; details add rows that repeat another."""
    parts: list[Part] = []
    if result.joints:
        parts += _ratio_parts(result, view.unit)
    entries = sorted((entry for entry in result.entries if entry.joints), key=_place_in_table)
    methods = {_short_name(entry) for entry in entries}
    if entries and (len(result.sides) == 1 or len(methods) > 1):
        parts += _method_parts(entries, view)
    return Report([*parts, *_refusals(result.entries)])


def _ratio_parts(result: ComparisonResult, unit: StiffnessUnit) -> list[Part]:
    """Return the joints on both sides, and the deflection that the second side avoids."""
    by_id = {entry.run_id: entry for entry in result.entries}
    first, second = (by_id[side.run_id] for side in result.sides)
    joints, alike = result.joints, _short_name(first) == _short_name(second)
    parts: list[Part] = [
        Table(
            [
                Column("joint", [joint.name for joint in joints], text=True),
                Column("first", first.joints, unit.concise),
                Column("second", second.joints, unit.concise),
                Column("ratio", joints, lambda joint: _by_interval(joint.ratio, joint)),
                Column(f"{100 * result.confidence:g} % interval", joints, _interval),
                Column(
                    "p", [joint.p_value for joint in joints], lambda p: "< 0.0001" if p < 1e-4 else f"{p:.2g}"
                ),
            ],
            title=f"Two sides, {METHOD_NAMES[first.method]}" if alike else "Two sides",
            caption=f"{unit.quantity} in {unit.label_of(first.joints)} with its standard uncertainty; ratio "
            "of the stiffnesses, second to first; p: p-value of equal stiffnesses",
        ),
        *joint_reason_lines((joint.name, joint.reason) for joint in joints),
    ]
    if result.ordered is not None:
        parts.append(_ordered_table(result.ordered, unit))
    avoided = result.avoided
    if avoided is not None:
        measured = "no observation is common to both sides"
        if avoided.measured is not None:
            shown = _percent(avoided.measured)
            measured = f"measured {shown} in {avoided.matching} observations on both sides"
        predicted = percent(avoided.predicted)
        parts.append(
            Line(f"  deflection avoided by the second side: {measured}; predicted {predicted} in all")
        )
    return parts


def _by_interval(ratio: float | None, joint: JointRatio) -> str:
    """Format a ratio to two digits of its interval's half width."""
    low, high = joint.ratio_interval or (None, None)
    return rounded(ratio, None if low is None or high is None else max(high - low, 0.0) / 2, ".3g")


def _interval(joint: JointRatio) -> str:
    if joint.ratio_interval is None:
        return NO_NUMBER
    if joint.ratio_excluded is not None:
        low, high = joint.ratio_excluded
        return f"not {low:.3g} … {high:.3g}"
    return " … ".join("no limit" if end is None else _by_interval(end, joint) for end in joint.ratio_interval)


def _ordered_table(ordered: OrderedResult, unit: StiffnessUnit) -> Table:
    joints = ordered.joints

    def _ends(ends: tuple[float, float] | None, kind: JointKind) -> str:
        return unit.of(kind).bare_interval(ends)

    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column("first", joints, lambda joint: unit.bare(joint.compliance_first, joint.kind)),
            Column("interval", joints, lambda joint: _ends(joint.compliance_interval_first, joint.kind)),
            Column("second", joints, lambda joint: unit.bare(joint.compliance_second, joint.kind)),
            Column("interval", joints, lambda joint: _ends(joint.compliance_interval_second, joint.kind)),
            Column("remark", ["held equal" if joint.equal else "" for joint in joints], text=True),
        ],
        title="Both in one problem, no joint softer on the second side",
        caption=f"{unit.quantity} in {unit.label_of(joints)}, interval under all constraints; the order "
        f"increases χ² by {ordered.chi_square_increase:.3g}",
    )


def _percent(share: Estimate) -> str:
    if not share.standard_uncertainty:
        return percent(share.value)
    return f"({100 * share.value:.2f} ± {100 * share.standard_uncertainty:.2f}) %"


def _method_parts(entries: Sequence[ComparedRun], view: View) -> list[Part]:
    """Return the joints by method, what each fit explains, and the words of both."""
    unit, drawn = view.unit, next((entry.draws for entry in entries if entry.draws), None)
    cell: Cell = partial(_drawn_cell, unit) if drawn else lambda entry, j: unit.concise(entry.joints[j])
    alike = not view.details and drawn is None and _constraints_change_nothing(entries, cell)
    shown = [entry for entry in entries if not entry.positive] if alike else entries
    title = f"{unit.quantity.capitalize()} in {unit.label_of(entries[0].joints)}"
    if drawn is not None:
        title += (
            f", mean & standard deviation of\n{drawn.repetitions} fits of {drawn.size} configurations drawn "
            f"at random (seed {drawn.seed})"
        )
    parts: list[Part] = [*_joint_tables(shown, title, cell, _legend(shown, alike=alike, drawn=bool(drawn)))]
    if drawn is not None:
        parts += _shares_tables(entries)
    return [*parts, _fits_table(shown)]


def _constraints_change_nothing(entries: Sequence[ComparedRun], cell: Cell) -> bool:
    """Return whether each fit is shown with the same numbers unconstrained and constrained."""
    by_constraint: dict[bool, dict[tuple[str, str], list[str]]] = {False: {}, True: {}}
    for entry in entries:
        numbers = [str(cell(entry, j)) for j in range(len(entry.joints))]
        by_constraint[entry.positive][entry.side, _short_name(entry)] = numbers
    return by_constraint[False] == by_constraint[True]


def _joint_tables(entries: Sequence[ComparedRun], title: str, cell: Cell, caption: str = "") -> list[Table]:
    """Return tables by joint, side and constraint, as many methods in each as 80 columns hold."""
    methods = list(dict.fromkeys(map(_short_name, entries)))
    return [
        _joint_table(
            [entry for entry in entries if _short_name(entry) in methods[start : start + _METHODS_ABREAST]],
            f"{title}, continued" if start else title,
            cell,
            "" if start else caption,
        )
        for start in range(0, len(methods), _METHODS_ABREAST)
    ]


def _shares_tables(entries: Sequence[ComparedRun]) -> list[Part]:
    drawn = [
        joint
        for entry in entries
        for j, joint in enumerate(entry.resampling.joints if entry.resampling else [])
        if entry.joints[j].status != "not_observable"
    ]
    if not any(joint.share_negative or joint.share_infinite or joint.share_undetermined for joint in drawn):
        return [Line("No fit was negative, rigid or undetermined for any joint.")]
    return [*_joint_tables(entries, "Share of fits negative / rigid / undetermined, in %", _shares)]


def _joint_table(entries: Sequence[ComparedRun], title: str, cell: Cell, caption: str) -> Table:
    by_row: dict[tuple[SideName, bool], dict[str, ComparedRun]] = {}
    for entry in sorted(entries, key=lambda each: (each.side, each.positive)):
        by_row.setdefault((entry.side, entry.positive), {}).setdefault(_short_name(entry), entry)
    methods = list(dict.fromkeys(map(_short_name, entries)))
    several = len({entry.side for entry in entries}) > 1
    heading = "side" if several else "sign"
    lines = [(j, joint, row) for j, joint in enumerate(entries[0].joints) for row in by_row]
    first = next(iter(by_row))

    def column(method: str) -> Column:
        cells = [cell(by_row[row][method], j) if method in by_row[row] else Line("") for j, _, row in lines]
        return Column(method, cells, as_line)

    return Table(
        [
            Column(
                "joint",
                [joint.name if row == first else "" for _, joint, row in lines],
                text=True,
                widest=_LONGEST_NAME,
            ),
            Column(heading, [_row_name(*row, several=several) for _, _, row in lines], text=True),
            *map(column, methods),
        ],
        title=title,
        caption=caption,
        plain=True,
    )


def _row_name(side: SideName, positive: bool, *, several: bool) -> str:
    return f"{f'{_SIDES.index(side) + 1} ' * several}{_CONSTRAINTS[positive]}"


def _place_in_table(entry: ComparedRun) -> tuple[int, int, bool, int]:
    """Return the place of a run in the tables: by method, weighting, constraint, side."""
    weighting = ("characteristic_length", "uniform", "covariance").index(entry.weighting)
    return list(_SHORT).index(entry.method), weighting, entry.positive, _SIDES.index(entry.side)


def _short_name(entry: ComparedRun) -> str:
    return _SHORT[entry.method] + _WEIGHTS[entry.weighting]


def _drawn_cell(unit: StiffnessUnit, entry: ComparedRun, j: int) -> Line:
    """Format mean & standard deviation."""
    drawn = _drawn_joint(entry, j)
    mean, deviation = (None, None) if drawn is None else moments(drawn, unit)
    if mean is None:
        return Line("rigid" if drawn and drawn.share_infinite else "—", "dim")
    text = rounded(mean, deviation, ".2g")
    if deviation is not None:
        text += f" & {rounded(deviation, deviation)}"
    if drawn is not None and (own := unit.of(drawn.kind)) is not unit:
        text += f" {own.label}"
    return Line(text, "bad" if mean < 0 else "")


def _shares(entry: ComparedRun, j: int) -> Line:
    drawn = _drawn_joint(entry, j)
    if drawn is None or entry.joints[j].status == "not_observable":
        return Line("—", "dim")
    shares = (drawn.share_negative, drawn.share_infinite, drawn.share_undetermined)
    return Line("/".join(f"{100 * share:.2g}" for share in shares), "bad" if shares[0] else "")


def _drawn_joint(entry: ComparedRun, j: int) -> ResampledJoint | None:
    return entry.resampling.joints[j] if entry.resampling else None


def _fits_table(entries: Sequence[ComparedRun]) -> Table:
    """Return what each fit as a whole is worth."""
    several = len({entry.side for entry in entries}) > 1
    names = [
        f"{_short_name(entry)} {_row_name(entry.side, entry.positive, several=several)}" for entry in entries
    ]
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
    deviation = resampling.compensation_deviation
    spread = "" if deviation is None else f" & {100 * deviation:.2g}"
    return percent(resampling.compensation_mean) + spread, percent(resampling.share_any_negative)


def _legend(entries: Sequence[ComparedRun], *, alike: bool, drawn: bool) -> str:
    """Explain the signs that stand in the tables, and no others."""
    methods = {_SHORT[entry.method]: METHOD_NAMES[entry.method] for entry in entries}
    lengths = {f"{entry.characteristic_length:.3g}" for entry in entries if entry.characteristic_length}
    of = f" of {', '.join(sorted(lengths))} m" if lengths else ""
    weights = {
        "characteristic_length": f"/L: translations divided by a length{of}",
        "uniform": "/u: uniform weights",
    }
    weightings = dict.fromkeys(entry.weighting for entry in entries)
    lines = [
        *(f"{short}: {name}" for short, name in methods.items()),
        *(weights[weighting] for weighting in weightings if weighting in weights),
        "1, 2: first and second side" if len({entry.side for entry in entries}) > 1 else "",
        "free: unconstrained",
        "≥ 0: compliances zero or positive" if any(entry.positive for entry in entries) else "",
        "drawn: all configurations by the fits of the drawn ones, mean & standard deviation"
        if drawn
        else "3.188(17): 3.188 with standard uncertainty 0.017",
        "≥ 0 gives the same numbers as free: no constraint is active" if alike else "",
    ]
    return "; ".join(line for line in lines if line)


def _refusals(entries: Sequence[ComparedRun]) -> list[Line]:
    """Return why methods have no numbers, those of the same reason in one line."""
    methods: dict[str, list[str]] = {}
    for entry in entries:
        if entry.error is not None:
            methods.setdefault(entry.error.detail, []).append(METHOD_NAMES[entry.method])
    return [
        Line(f"no {', '.join(dict.fromkeys(names))}: {detail}", "care") for detail, names in methods.items()
    ]


def charts(result: ComparisonResult) -> list[Chart]:
    """Return the paper's figures 7 and 8: deflection of each configuration, and what each method leaves."""
    charts: list[Chart] = []
    for side in result.sides:
        entries = [entry for entry in result.entries if entry.side == side.side and entry.left]
        kept = {_short_name(entry): entry for entry in sorted(entries, key=lambda each: each.positive)}
        charts.append(
            Chart(
                f"Deflection of each configuration and what is left after compensation, mean over the targets"
                f"{f', {side.side} side' * (len(result.sides) > 1)}",
                side.configurations,
                {"measured": side.deflection, **{name: entry.left for name, entry in kept.items()}},
                1e3,
                "mm",
            )
        )
    if paired := _paired(result):
        series = {
            f"{side.side} side": [_deflections(side)[label] for label in paired] for side in result.sides
        }
        title = "Deflection of each configuration that both sides have, mean over the targets"
        charts.insert(0, Chart(title, paired, series, 1e3, "mm"))
    return charts


def _deflections(side: ComparedSide) -> dict[str, float | None]:
    return dict(zip(side.configurations, side.deflection, strict=True))


def _paired(result: ComparisonResult) -> list[str]:
    """Return the observations that both sides have, in the same posture under the same load."""
    shares = [] if result.avoided is None else result.avoided.configurations
    return [share.observation for share in shares if share.side == "both"]


# The files


class _Row(Message):
    """A joint in a run, as a row of the table; a run without numbers has no joint."""

    fit: ComparedRun
    constraint: Constraint
    joint: JointResult | None = None
    drawn: ResampledJoint | None = None


_COLUMNS: Final = {
    "side": "fit.side",
    "method": "fit.method",
    "weighting": "fit.weighting",
    "constraint": "constraint",
    "characteristic_length": "fit.characteristic_length",
    "error": "fit.error.detail",
    "compensation": "fit.compensation",
    "rms_residual": "fit.rms_residual",
    "condition_number": "fit.condition_number",
    "joint": "joint.name",
    "status": "joint.status",
    "verdict": "joint.verdict",
    "stiffness": "joint.stiffness",
    "stiffness_{low high}": "joint.stiffness_interval",
    "compliance": "joint.compliance",
    "compliance_standard_uncertainty": "joint.standard_uncertainty",
    "compliance_{low high}": "joint.compliance_interval",
    "resamples": "fit.resampling.repetitions",
    "resampled_stiffness_mean": "drawn.stiffness_mean",
    "resampled_stiffness_deviation": "drawn.stiffness_deviation",
    "resampled_compliance_mean": "drawn.compliance_mean",
    "resampled_compliance_deviation": "drawn.compliance_deviation",
    "share_negative": "drawn.share_negative",
    "share_infinite": "drawn.share_infinite",
    "share_undetermined": "drawn.share_undetermined",
    "share_any_negative": "fit.resampling.share_any_negative",
    "resampled_compensation_mean": "fit.resampling.compensation_mean",
    "resampled_compensation_deviation": "fit.resampling.compensation_deviation",
}
_RATIOS: Final = {
    "joint": "name",
    "ratio of stiffnesses, second to first": "ratio",
    "ratio {low high}": "ratio_interval",
    "excluded ratios {from to}": "ratio_excluded",
    "p-value of equal stiffnesses": "p_value",
    "reason": "reason",
}
"""Headers, and where each column's numbers stand; units are those of the fields."""


def entries_sheet(job: Comparison) -> Sheet:
    """Return a row a run and joint. A run without numbers has one row, with no joint, that says why.

    What there is no number for is empty, and so is the upper end of a stiffness without upper limit.
    """
    rows: list[_Row] = []
    pairs: list[tuple[JointResult | None, ResampledJoint | None]]
    for entry in job.result.entries if job.result else ():
        fit = _Row.model_construct(fit=entry, constraint="positive" if entry.positive else "unconstrained")
        drawn = entry.resampling.joints if entry.resampling else [None] * len(entry.joints)
        pairs = [*zip(entry.joints, drawn, strict=True)] or [(None, None)]
        rows += [fit.model_copy(update={"joint": joint, "drawn": own}) for joint, own in pairs]
    kinds = [None if row.joint is None else row.joint.kind for row in rows]
    return Sheet.of_joints(Sheet.of_fields(rows, _COLUMNS), kinds)


def ratios_sheet(job: Comparison) -> Sheet:
    """Return a row a joint with its ratio; empty for one side."""
    return Sheet.of_fields(job.result.joints if job.result else [], _RATIOS)


def configurations_sheet(job: Comparison) -> Sheet:
    """Return a row a configuration of each run: its measured deflection, and what the run leaves of it."""
    result = job.result
    sides = {side.side: side for side in (result.sides if result else ())}
    return Sheet.of_rows(
        {
            "side": entry.side,
            "method": entry.method,
            "weighting": entry.weighting,
            "constraint": "positive" if entry.positive else "unconstrained",
            "configuration": label,
            "deflection [m]": measured,
            "left [m]": left,
        }
        for entry in (result.entries if result else ())
        for label, measured, left in zip(
            sides[entry.side].configurations, sides[entry.side].deflection, entry.left, strict=False
        )
    )


def _compute(inputs: Inputs, request: ComparisonRequest) -> Work:
    from jointstiff.service.kinds.comparison.work import work

    return work(inputs, request)


COMPARISON: Final = Kind[Comparison, ComparisonRequest](
    message=Comparison,
    request=ComparisonRequest,
    options=CampaignComparison,
    compute=_compute,
    report=report,
    sources=("campaigns",),
    charts=charts,
    title="Comparison",
    examples={"two sets": {"run_ids": ["ID_OF_A_RUN", "ID_OF_ANOTHER"], "ordered": True}},
    files=tuple(
        File(
            name=f"{name}.csv",
            description=f"{words}, as a table for spreadsheets; units in the headers",
            sheet=sheet,
            made_of="result",
        )
        for name, sheet, words in (
            ("table", entries_sheet, "the runs, one row per run and joint"),
            ("ratios", ratios_sheet, "the ratios of two sides"),
            (
                "configurations",
                configurations_sheet,
                "deflection by configuration, and what each run leaves",
            ),
        )
    ),
    description="""Compare stored runs of one measurement set, or of two; nothing is identified again.

Runs of one set stand side by side: methods, constraints, other options. Of two sets (motor and secondary
encoders, before and after, units A and B) there is also for each joint the ratio of its stiffnesses with
Fieller's interval, and whether it has changed; and the share of the deflection that the second side avoids,
measured where both sides have the observation, and predicted. With `ordered`, also both sides in one problem
in which no joint is softer on the second side.""",
)
