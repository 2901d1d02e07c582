"""A comparison of methods or of two measurement sets: the declaration of the kind, its report and files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

from jointstiff.schemas.comparison import (
    AvoidedDeflection,
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
from jointstiff.schemas.robot import Estimate
from jointstiff.schemas.run import JointResult, ResampledJoint, ResamplingResult
from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.kinds.run.kind import compute_mean_and_deviation, parts_table
from jointstiff.service.tables.estimate import (
    ShownEstimate,
    estimate_columns,
    percent_text,
    show_cell,
    show_estimate,
)
from jointstiff.service.tables.report import METHOD_NAMES, Report, View, joint_reason_lines
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import (
    Chart,
    Column,
    Line,
    NumberParts,
    Part,
    Sheet,
    Table,
    Value,
    as_line,
    format_percent,
    format_rounded,
    number_formatter,
)
from jointstiff.solver.text import figure

if TYPE_CHECKING:
    from jointstiff.schemas.options import Resampling
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs

_SIDES: Final = ("first", "second")
_METHOD_ABBREVIATIONS: Final = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_WEIGHTING_SUFFIXES: Final = {"covariance": "", "characteristic_length": "/L", "uniform": "/u"}
_CONSTRAINT_NAMES: Final = {False: "free", True: "≥ 0"}
_METHODS_PER_TABLE: Final = 2
"""Greatest number of methods (columns) in a table of intervals, which is at most 80 characters wide."""
_DRAWN_PER_TABLE: Final = 4
"""Greatest number of methods in a table of resampled fits, whose cells are shorter."""
_LONGEST_NAME: Final = 24
_DRAWN_IN_WORDS: Final = (
    "drawn: explained share of all configurations, mean & standard deviation over the drawn fits"
)

Cell = Callable[[ComparedRun, int], Line]
"""Function that formats a cell of a table, for a run and the index of a joint."""


def _make_report(_job: Comparison, result: ComparisonResult, view: View) -> Report:
    """Return the report of a comparison: ratios of two sides, a column for each method, failed methods.

    `view.details` adds rows that repeat the numbers of other rows.
    """
    parts: list[Part] = []
    if result.joints:
        parts += _list_ratio_parts(result, view.unit)
    compared_runs = sorted((entry for entry in result.entries if entry.joints), key=_table_sort_key)
    methods = {_method_abbreviation(entry) for entry in compared_runs}
    if compared_runs and (len(result.sides) == 1 or len(methods) > 1):
        parts += _list_method_parts(compared_runs, view)
    return Report([*parts, *_failure_lines(result.entries)])


def _list_ratio_parts(result: ComparisonResult, unit: StiffnessUnit) -> list[Part]:
    """Return tables of both sides' stiffnesses and their ratios, and a line on the avoided deflection.

    The avoided deflection is how much less the targets deflect on the second side.
    """
    run_by_id = {entry.run_id: entry for entry in result.entries}
    # The leading run of each side, from which the ratios were computed.
    first_run, second_run = (run_by_id[side.run_id] for side in result.sides)
    parts: list[Part] = [_ratio_table(result, first_run, second_run, unit)]
    parts += joint_reason_lines((joint.name, joint.reason) for joint in result.joints)
    if result.differences:
        parts += [Line(""), _differences_table(result, unit)]
    if result.gearboxes:
        parts.append(parts_table(result, result.confidence, unit))
    if result.ordered is not None:
        parts.append(_ordered_table(result.ordered, unit))
    if result.avoided is not None:
        parts.append(_describe_avoided_deflection(result.avoided))
    return parts


def _ratio_table(
    result: ComparisonResult, first_run: ComparedRun, second_run: ComparedRun, unit: StiffnessUnit
) -> Table:
    """Return the table with the stiffness of each joint on both sides, and the ratio of the stiffnesses.

    `first_run` and `second_run` are the leading runs of the sides.
    """
    joints = result.joints
    columns = [
        Column("joint", [joint.name for joint in joints], text=True),
        Column("first", [unit.show_joint(joint) for joint in first_run.joints], show_cell),
        Column("second", [unit.show_joint(joint) for joint in second_run.joints], show_cell),
        Column("ratio", [_show_ratio(joint) for joint in joints], show_cell),
        Column("p", [joint.p_value for joint in joints], _format_p_value),
    ]
    caption = (
        f"stiffness in {unit.label_of(first_run.joints)} and ratio of the stiffnesses, "
        f"second to first; in brackets: {100 * result.confidence:g} % interval; p: p-value of equal "
        "stiffnesses"
    )
    return Table(columns, title=_make_ratio_title(first_run, second_run), caption=caption)


def _make_ratio_title(first_run: ComparedRun, second_run: ComparedRun) -> str:
    """Return the title of the table of ratios; it names the method if both runs have the same."""
    if _method_abbreviation(first_run) == _method_abbreviation(second_run):
        return f"Two sides, {METHOD_NAMES[first_run.method]}"
    return "Two sides"


def _format_p_value(p_value: float) -> str:
    """Format a p-value with two digits; a very small one as an upper limit."""
    return "< 0.0001" if p_value < 1e-4 else f"{p_value:.2g}"


def _describe_avoided_deflection(avoided: AvoidedDeflection) -> Line:
    """Return a line on how much less the targets deflect on the second side, as measured and as predicted."""
    measured_text = "no observation is common to both sides"
    if avoided.measured is not None:
        percentage_text = _percentage_text(avoided.measured)
        measured_text = f"measured {percentage_text} in {avoided.matching} observations on both sides"
    predicted_text = format_percent(avoided.predicted)
    return Line(
        f"  deflection avoided by the second side: {measured_text}; predicted {predicted_text} in "
        "all observations"
    )


def _differences_table(result: ComparisonResult, unit: StiffnessUnit) -> Table:
    """Return the table of what the second side removes: gearboxes, if its encoders are behind them."""
    shown = [unit.show_joint(joint) for joint in result.differences]
    return Table(
        [
            Column("joint", [joint.name for joint in result.differences], text=True),
            *estimate_columns("removed stiffness", shown, result.confidence),
        ],
        title="Difference of the compliances, first less second",
        caption=f"stiffness of what bends on the first side alone, such as gearboxes, in "
        f"{unit.label_of(result.differences)}",
    )


def _show_ratio(joint: JointRatio) -> ShownEstimate:
    """Format a ratio of stiffnesses with Fieller's interval.

    The interval may have no limit on a side, or consist of all ratios outside an excluded range.
    """
    shown = show_estimate(joint.ratio, joint.ratio_interval, bare=".3g")
    if joint.ratio is None or joint.ratio_excluded is None:
        return shown
    lower, upper = joint.ratio_excluded
    return replace(shown, value=figure(joint.ratio, ".3g"), interval=f"not {lower:.3g} … {upper:.3g}")


def _ordered_table(ordered: OrderedResult, unit: StiffnessUnit) -> Table:
    """Return a table of both sides' joints, fitted so that no joint is softer on the second side.

    The remark "made equal" marks a joint that would be softer on the second side without the constraint.
    """
    joints = ordered.joints
    first, second = list[ShownEstimate](), list[ShownEstimate]()
    for joint in joints:
        first.append(
            unit.show_compliance(joint.compliance_first, joint.compliance_interval_first, joint.kind)
        )
        second.append(
            unit.show_compliance(joint.compliance_second, joint.compliance_interval_second, joint.kind)
        )
    columns = [
        Column("joint", [joint.name for joint in joints], text=True),
        Column("first", first, show_cell),
        Column("second", second, show_cell),
        Column("remark", ["made equal" if joint.equal else "" for joint in joints], text=True),
    ]
    title = "Both sides identified together, no joint softer on the second side"
    return Table(columns, title=title, caption=_make_ordered_caption(ordered, unit))


def _make_ordered_caption(ordered: OrderedResult, unit: StiffnessUnit) -> str:
    """Return the caption of the table of the ordered fit: its unit, and what the constraint costs in χ²."""
    return (
        f"stiffness (interval) in {unit.label_of(ordered.joints)}, all constraints; the constraint "
        f"that no joint is softer increases χ² by {ordered.chi_square_increase:.3g}"
    )


def _percentage_text(fraction: Estimate) -> str:
    """Format a fraction in %, with its 95 % interval if that is known."""
    if not fraction.standard_uncertainty:
        return format_percent(fraction.value)
    return percent_text(fraction)


def _list_method_parts(compared_runs: Sequence[ComparedRun], view: View) -> list[Part]:
    """Return tables of the joints with a column for each method, and a table of the fits as a whole."""
    resampling = next((entry.draws for entry in compared_runs if entry.draws), None)
    style = _choose_cell_style(view.unit, is_resampled=resampling is not None)
    shown_runs = _omit_idle_constraints(compared_runs, style, view)
    legend = _legend(
        shown_runs,
        hides_constrained=len(shown_runs) < len(compared_runs),
        resampled=style.is_resampled,
        shows_repeated=view.details,
    )
    title = _make_methods_title(compared_runs, view.unit, resampling)
    parts: list[Part] = []
    parts += _joint_tables(shown_runs, title, style, legend, shows_repeated=view.details)
    if style.is_resampled:
        parts += _list_resampled_share_parts(compared_runs, view)
    return [*parts, _fits_table(shown_runs, shows_repeated=view.details)]


@dataclass(frozen=True)
class _CellStyle:
    """Content of a cell for a joint and a method."""

    format_cell: Cell
    methods_per_table: int  # greatest number of methods (columns) in a table
    is_resampled: bool = True  # whether the cell is about resampled fits


def _choose_cell_style(unit: StiffnessUnit, *, is_resampled: bool) -> _CellStyle:
    """Return the style of cells: mean and deviation of resampled fits or, without these, an interval."""
    if is_resampled:
        return _CellStyle(partial(_resampled_cell, unit), _DRAWN_PER_TABLE)
    return _CellStyle(partial(_interval_cell, unit), _METHODS_PER_TABLE, is_resampled=False)


def _interval_cell(unit: StiffnessUnit, entry: ComparedRun, joint: int) -> Line:
    """Format the stiffness of a joint, given by its index, with its interval."""
    return unit.show_joint(entry.joints[joint]).cell


def _omit_idle_constraints(
    compared_runs: Sequence[ComparedRun], style: _CellStyle, view: View
) -> Sequence[ComparedRun]:
    """Return the runs to show: without runs with a constraint if constraints change no number.

    Details and statistics of resampled fits are always shown of all runs.
    """
    shows_all = view.details or style.is_resampled
    if shows_all or not _constraints_change_nothing(compared_runs, style.format_cell):
        return compared_runs
    return [entry for entry in compared_runs if not entry.positive]


def _make_methods_title(
    compared_runs: Sequence[ComparedRun], unit: StiffnessUnit, resampling: Resampling | None
) -> str:
    """Return the title of the tables of methods: quantity, unit and how fits were resampled, if they were."""
    title = f"Stiffness in {unit.label_of(compared_runs[0].joints)}"
    if resampling is None:
        return title
    return (
        f"{title}, mean & standard deviation of\n{resampling.repetitions} fits of {resampling.size} "
        f"configurations drawn at random (seed {resampling.seed})"
    )


def _constraints_change_nothing(entries: Sequence[ComparedRun], format_cell: Cell) -> bool:
    """Return whether each fit with the constraint compliance ≥ 0 shows the same numbers as the free fit."""
    # Side and method → numbers as they are shown
    free: dict[tuple[str, str], list[str]] = {}
    constrained: dict[tuple[str, str], list[str]] = {}
    for entry in entries:
        numbers = [str(format_cell(entry, j)) for j in range(len(entry.joints))]
        (constrained if entry.positive else free)[entry.side, _method_abbreviation(entry)] = numbers
    return free == constrained


def _joint_tables(
    compared_runs: Sequence[ComparedRun],
    title: str,
    style: _CellStyle,
    caption: str = "",
    *,
    shows_repeated: bool,
) -> list[Table]:
    """Return tables of the joints, each with as many methods as columns as the style allows.

    Only the first table has the caption.
    """
    methods = list(dict.fromkeys(map(_method_abbreviation, compared_runs)))
    tables = list[Table]()
    for start in range(0, len(methods), style.methods_per_table):
        shown_methods = methods[start : start + style.methods_per_table]
        entries = [entry for entry in compared_runs if _method_abbreviation(entry) in shown_methods]
        table = _joint_table(entries, style.format_cell, shows_repeated=shows_repeated)
        if tables:
            tables.append(replace(table, title=f"{title}, continued"))
        else:
            tables.append(replace(table, title=title, caption=caption))
    return tables


def _list_resampled_share_parts(entries: Sequence[ComparedRun], view: View) -> list[Part]:
    """Return tables of the share of resampled fits in which a joint is negative, rigid or undetermined.

    If all shares are zero, return a line that says so.
    """
    if not any(map(_has_share, _list_resampled_joints(entries))):
        return [Line("No fit gave a joint a negative, infinite or undetermined stiffness.")]
    title = "Fits negative / rigid / undetermined, in %"
    style = _CellStyle(_shares_cell, _DRAWN_PER_TABLE)
    return [*_joint_tables(entries, title, style, shows_repeated=view.details)]


def _list_resampled_joints(entries: Sequence[ComparedRun]) -> list[ResampledJoint]:
    """Return the statistics over the resampled fits of all runs, of joints that the readings can show."""
    found = list[ResampledJoint]()
    for entry in entries:
        if entry.resampling is None:
            continue
        for joint, statistics in zip(entry.joints, entry.resampling.joints, strict=False):
            if joint.status != "not_observable":
                found.append(statistics)
    return found


def _has_share(joint: ResampledJoint) -> bool:
    """Return whether a resampled fit gave this joint a negative, infinite or undetermined stiffness."""
    return bool(joint.share_negative or joint.share_infinite or joint.share_undetermined)


@dataclass(frozen=True)
class _MethodRow:
    """Runs of one side, all with or all without constraint: each joint has a row of them in a table."""

    side: SideName
    positive: bool  # whether compliances are constrained to be positive
    runs: Mapping[str, ComparedRun]  # by the abbreviation of the method, such as "PP/L"

    def format_cells(self, methods: Sequence[str], joint: int, format_cell: Cell) -> list[Line]:
        """Return the cell of a joint, given by its index, for each method; empty without a run."""
        cells = list[Line]()
        for method in methods:
            run = self.runs.get(method)
            cells.append(Line("") if run is None else format_cell(run, joint))
        return cells

    def repeats(self, free: _MethodRow | None, joint: int, format_cell: Cell) -> bool:
        """Return whether this row with a constraint shows the same numbers of a joint as the row without it.

        Then no constraint acts on the joint. `free` is the row of this side without constraint, if any.
        """
        if not self.positive or free is None or free.runs.keys() != self.runs.keys():
            return False
        methods = list(self.runs)
        own, others = (row.format_cells(methods, joint, format_cell) for row in (self, free))
        return [*map(str, own)] == [*map(str, others)]


def _group_by_row(compared_runs: Sequence[ComparedRun]) -> list[_MethodRow]:
    """Return the rows that a joint has: for each side without and with constraint, as far as there are runs.

    Of several runs of a row by the same method, the first is shown.
    """
    runs_by_row = dict[tuple[SideName, bool], dict[str, ComparedRun]]()
    for entry in sorted(compared_runs, key=lambda each: (each.side, each.positive)):
        run_by_method = runs_by_row.setdefault((entry.side, entry.positive), {})
        run_by_method.setdefault(_method_abbreviation(entry), entry)
    return [_MethodRow(side, positive, runs) for (side, positive), runs in runs_by_row.items()]


@dataclass(frozen=True)
class _JointRow:
    """A row of a table of joints, as it is shown."""

    joint_name: str  # empty but in the first row of the joint
    name: str  # constraint, such as "free", or side and constraint, such as "1 free"
    cells: list[Line]  # one for each method


def _joint_table(compared_runs: Sequence[ComparedRun], format_cell: Cell, *, shows_repeated: bool) -> Table:
    """Return a table with a row for each joint, side and constraint, and a column for each method.

    Without `shows_repeated`, a joint has no row for a constraint that changes none of its numbers.
    """
    methods = list(dict.fromkeys(map(_method_abbreviation, compared_runs)))
    has_two_sides = len({entry.side for entry in compared_runs}) > 1
    rows = list[_JointRow]()
    for joint, joint_result in enumerate(compared_runs[0].joints):
        shown = _list_rows_of_joint(compared_runs, joint, format_cell, shows_repeated=shows_repeated)
        for row in shown:
            joint_name = joint_result.name if row is shown[0] else ""
            name = _row_name(row.side, row.positive, with_side=has_two_sides)
            rows.append(_JointRow(joint_name, name, row.format_cells(methods, joint, format_cell)))
    columns = [
        Column("joint", [row.joint_name for row in rows], text=True, widest=_LONGEST_NAME),
        Column("side" if has_two_sides else "sign", [row.name for row in rows], text=True),
    ]
    for number, method in enumerate(methods):
        columns.append(Column(method, [row.cells[number] for row in rows], as_line))
    return Table(columns, plain=True)


def _list_rows_of_joint(
    compared_runs: Sequence[ComparedRun], joint: int, format_cell: Cell, *, shows_repeated: bool
) -> list[_MethodRow]:
    """Return the rows of a joint, given by its index: one for each side and constraint.

    Without `shows_repeated`, a row with a constraint is omitted if the side's row without constraint shows
    the same numbers.
    """
    rows = _group_by_row(compared_runs)
    if shows_repeated:
        return rows
    free_rows = {row.side: row for row in rows if not row.positive}
    return [row for row in rows if not row.repeats(free_rows.get(row.side), joint, format_cell)]


def _row_name(side: SideName, positive: bool, *, with_side: bool) -> str:
    """Return the name of a table's row: the constraint, such as "free", or side and constraint: "1 free"."""
    side_number = f"{_SIDES.index(side) + 1} " if with_side else ""
    return f"{side_number}{_CONSTRAINT_NAMES[positive]}"


def _table_sort_key(entry: ComparedRun) -> tuple[int, int, bool, int]:
    """Return the key that sorts runs in tables: in order of method, weighting, constraint and side."""
    weighting = ("characteristic_length", "uniform", "covariance").index(entry.weighting)
    return (
        list(_METHOD_ABBREVIATIONS).index(entry.method),
        weighting,
        entry.positive,
        _SIDES.index(entry.side),
    )


def _method_abbreviation(entry: ComparedRun) -> str:
    """Return the abbreviation of a run's method and weighting, such as "PP/L"."""
    return _METHOD_ABBREVIATIONS[entry.method] + _WEIGHTING_SUFFIXES[entry.weighting]


def _resampled_cell(unit: StiffnessUnit, entry: ComparedRun, joint: int) -> Line:
    """Format the mean and standard deviation of a joint's number over the resampled fits of a run."""
    statistics = _resampled_joint(entry, joint)
    if statistics is None:
        return Line("—", "dim")
    mean_value, deviation = compute_mean_and_deviation(statistics, unit)
    if mean_value is None:
        return Line("rigid" if statistics.share_infinite else "—", "dim")
    text = format_rounded(mean_value, deviation, ".2g")
    if deviation is not None:
        text += f" & {format_rounded(deviation, deviation)}"
    # A prismatic joint has another unit than the table, which the cell states.
    joint_unit = unit.for_kind(statistics.kind)
    own_unit = "" if joint_unit is unit else joint_unit.label
    numbers = (NumberParts(text, unit=own_unit),)
    return Line(f"{text} {own_unit}".rstrip(), "bad" if mean_value < 0 else "", numbers)


def _shares_cell(entry: ComparedRun, j: int) -> Line:
    """Format the shares [%] of resampled fits in which a joint is negative, rigid, or undetermined.

    `j` is the index of the joint.
    """
    statistics = _resampled_joint(entry, j)
    if statistics is None or entry.joints[j].status == "not_observable":
        return Line("—", "dim")
    shares = (statistics.share_negative, statistics.share_infinite, statistics.share_undetermined)
    return Line("/".join(f"{100 * share:.2g}" for share in shares), "bad" if shares[0] else "")


def _resampled_joint(entry: ComparedRun, j: int) -> ResampledJoint | None:
    """Return the statistics of joint `j` over the resampled fits; None for a run without resampling."""
    return entry.resampling.joints[j] if entry.resampling else None


def _fits_table(compared_runs: Sequence[ComparedRun], *, shows_repeated: bool) -> Table:
    """Return a table with a row for each fit: explained deflection, residual, condition number.

    Unless `shows_repeated` is true, a fit with the constraint of positive stiffness is omitted if its numbers
    equal those of the fit without the constraint.
    """
    shown_runs = list(compared_runs) if shows_repeated else _omit_repeated_fits(compared_runs)
    columns = [
        Column("fit", _name_fits(shown_runs), text=True, widest=_LONGEST_NAME),
        Column("explained", [format_percent(entry.compensation) for entry in shown_runs]),
        Column("rms", [entry.rms_residual for entry in shown_runs], number_formatter(".0f", 1e6), "µm"),
        Column("condition", [entry.condition_number for entry in shown_runs], number_formatter(".3g")),
    ]
    if any(entry.resampling for entry in shown_runs):
        cells = [_resampled_cells(entry.resampling) for entry in shown_runs]
        columns.append(Column("explained, drawn", [each.explained for each in cells]))
        columns.append(Column("any negative", [each.any_negative for each in cells]))
    return Table(columns, title="Fits as a whole", plain=True)


def _name_fits(compared_runs: Sequence[ComparedRun]) -> list[str]:
    """Return a name for each fit: method and constraint, such as "PP free"; of two sides also the side."""
    has_two_sides = len({entry.side for entry in compared_runs}) > 1
    names = list[str]()
    for entry in compared_runs:
        row_name = _row_name(entry.side, entry.positive, with_side=has_two_sides)
        names.append(f"{_method_abbreviation(entry)} {row_name}")
    return names


def _omit_repeated_fits(compared_runs: Sequence[ComparedRun]) -> list[ComparedRun]:
    """Return runs without those whose constraint changes no number of the same fit without constraint."""
    cells_of_free_run = {
        (entry.side, _method_abbreviation(entry)): _fit_cells(entry)
        for entry in compared_runs
        if not entry.positive
    }
    kept_runs = list[ComparedRun]()
    for entry in compared_runs:
        cells_without_constraint = cells_of_free_run.get((entry.side, _method_abbreviation(entry)))
        if not entry.positive or cells_without_constraint != _fit_cells(entry):
            kept_runs.append(entry)
    return kept_runs


def _fit_cells(entry: ComparedRun) -> tuple[object, ...]:
    """Return the numbers of a fit as its row shows them."""
    explained = format_percent(entry.compensation)
    drawn = _resampled_cells(entry.resampling)
    residual = entry.rms_residual
    return explained, None if residual is None else f"{1e6 * residual:.0f}", drawn


class _ResampledCells(NamedTuple):
    """The cells of a fit about its resampled fits."""

    explained: str  # deflection that the fits explain: mean & standard deviation in %
    any_negative: str  # fraction of the fits with a negative stiffness


def _resampled_cells(resampling: ResamplingResult | None) -> _ResampledCells:
    """Format the cells of a fit about its resampled fits; empty cells without resampling."""
    if resampling is None:
        return _ResampledCells("", "")
    deviation = resampling.compensation_deviation
    spread = "" if deviation is None else f" & {100 * deviation:.2g}"
    explained = format_percent(resampling.compensation_mean) + spread
    return _ResampledCells(explained, format_percent(resampling.share_any_negative))


def _legend(
    compared_runs: Sequence[ComparedRun], *, hides_constrained: bool, resampled: bool, shows_repeated: bool
) -> str:
    """Return a caption that explains the abbreviations used in the tables.

    Args:
        compared_runs: runs in the tables.
        hides_constrained: whether runs with a constraint are left out, because no constraint acts.
        resampled: whether the tables show statistics of resampled fits.
        shows_repeated: whether rows are shown that repeat the numbers of free fits.
    """
    sentences = [*_explain_methods(compared_runs), *_explain_weights(compared_runs)]
    if len({entry.side for entry in compared_runs}) > 1:
        sentences.append("1: first side; 2: second side")
    sentences.append("free: unconstrained")
    if any(entry.positive for entry in compared_runs):
        where = "" if shows_repeated else ", where the constraint acts"
        sentences.append(f"≥ 0: compliances zero or positive{where}")
    sentences.append(_DRAWN_IN_WORDS if resampled else "in brackets: the interval")
    if hides_constrained:
        sentences.append("≥ 0 gives the same numbers as free: no constraint is active")
    return "; ".join(sentences)


def _explain_methods(compared_runs: Sequence[ComparedRun]) -> list[str]:
    """Return an explanation for each abbreviation of a method, once each: "PP: partial pose"."""
    methods = dict.fromkeys(entry.method for entry in compared_runs)
    return [f"{_METHOD_ABBREVIATIONS[method]}: {METHOD_NAMES[method]}" for method in methods]


def _explain_weights(compared_runs: Sequence[ComparedRun]) -> list[str]:
    """Return an explanation for each abbreviation of weights other than those by covariance, once each."""
    lengths = {f"{entry.characteristic_length:.3g}" for entry in compared_runs if entry.characteristic_length}
    of_lengths = f" of {', '.join(sorted(lengths))} m" if lengths else ""
    explanations = {
        "characteristic_length": f"/L: translations divided by a length{of_lengths}",
        "uniform": "/u: uniform weights",
    }
    weightings = dict.fromkeys(entry.weighting for entry in compared_runs)
    return [explanations[weighting] for weighting in weightings if weighting in explanations]


def _failure_lines(entries: Sequence[ComparedRun]) -> list[Line]:
    """Return the reasons why methods have no numbers; methods with the same reason share a line."""
    methods: dict[str, list[str]] = {}
    for entry in entries:
        if entry.error is not None:
            methods.setdefault(entry.error.detail, []).append(METHOD_NAMES[entry.method])
    return [
        Line(f"no {', '.join(dict.fromkeys(names))}: {detail}", "care") for detail, names in methods.items()
    ]


def make_charts(result: ComparisonResult) -> list[Chart]:
    """Return charts of each configuration's deflection and, for each method, of the residual.

    The numbers are means over the targets. Each side has a pair of charts: figures 7 and 8 of the paper.
    """
    charts: list[Chart] = []
    common_labels = _common_configurations(result)
    if common_labels:
        charts.append(_draw_common_deflection(result.sides, common_labels))
    for side in result.sides:
        side_text = f", {side.side} side" if len(result.sides) > 1 else ""
        if list(side.configurations) != common_labels:
            charts.append(_draw_deflection(side, side_text))
        charts.append(_draw_residuals(result, side, side_text))
    return charts


def _draw_common_deflection(sides: Sequence[ComparedSide], labels: Sequence[str]) -> Chart:
    """Return the chart of the deflection of both sides, in the configurations with these labels."""
    measured = dict[str, Sequence[float | None]]()
    for side in sides:
        deflection_by_label = _deflection_by_label(side)
        measured[f"{side.side} side"] = [deflection_by_label[label] for label in labels]
    title = "Measured deflection, both sides"
    return Chart(title, labels, measured, 1e3, "mm", quantity="deflection")


def _draw_deflection(side: ComparedSide, side_text: str) -> Chart:
    """Return the chart of a side's deflection; `side_text` ends the title, such as ", first side"."""
    series = {"measured": side.deflection}
    title = f"Measured deflection{side_text}"
    return Chart(title, side.configurations, series, 1e3, "mm", quantity="deflection")


def _draw_residuals(result: ComparisonResult, side: ComparedSide, side_text: str) -> Chart:
    """Return the chart of what each method leaves over; `side_text` is the end of its title.

    What is left over is a hundredth of the deflection, so the chart has an axis of its own.
    """
    residuals = _list_residuals(result.entries, side.side)
    title = f"Left over after compensation{side_text}"
    return Chart(title, side.configurations, residuals, 1e6, "µm", quantity="residual")


def _list_residuals(entries: Sequence[ComparedRun], side: SideName) -> dict[str, list[float | None]]:
    """Return method → residual of each configuration [m], of the runs of a side that have residuals.

    If a method has a run with the constraint and a run without, the constrained run is drawn.
    """
    residuals = dict[str, list[float | None]]()
    for entry in sorted(entries, key=lambda each: each.positive):
        if entry.side == side and entry.left:
            residuals[_method_abbreviation(entry)] = entry.left
    return residuals


def _deflection_by_label(side: ComparedSide) -> dict[str, float | None]:
    """Return the measured deflection [m] of each configuration of a side, by label."""
    return dict(zip(side.configurations, side.deflection, strict=True))


def _common_configurations(result: ComparisonResult) -> list[str]:
    """Return the labels of observations that both sides have in the same posture under the same load."""
    shares = [] if result.avoided is None else result.avoided.configurations
    return [share.observation for share in shares if share.side == "both"]


# The files


class _Row(Message):
    """Row of the file `table.csv`: a joint in a run; the only row of a failed run has no joint."""

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
"""Headers, and the field with each column's numbers, whose unit is added to the header."""


def entries_sheet(job: Comparison) -> Sheet:
    """Return the file `table.csv`: a row for each run and joint; a failed run has one row, with its error.

    An unknown number, or an upper limit that does not exist, is an empty cell.
    """
    rows: list[_Row] = []
    for entry in job.result.entries if job.result else ():
        rows += _make_rows_of_run(entry)
    kinds = [None if row.joint is None else row.joint.kind for row in rows]
    return Sheet.with_joint_kinds(Sheet.from_messages(rows, _COLUMNS), kinds)


def _make_rows_of_run(entry: ComparedRun) -> list[_Row]:
    """Return a row for each joint of a run; a failed run, which has no joints, has one row without joint."""
    row = _Row.model_construct(fit=entry, constraint=_name_constraint(entry))
    if not entry.joints:
        return [row]
    rows = list[_Row]()
    for j, joint in enumerate(entry.joints):
        rows.append(row.model_copy(update={"joint": joint, "drawn": _resampled_joint(entry, j)}))
    return rows


def _name_constraint(entry: ComparedRun) -> Constraint:
    """Return the name of a run's constraint in files."""
    return "positive" if entry.positive else "unconstrained"


def ratios_sheet(job: Comparison) -> Sheet:
    """Return the file `ratios.csv`: the stiffness ratio of each joint; empty if only one set is compared."""
    return Sheet.from_messages(job.result.joints if job.result else [], _RATIOS)


def configurations_sheet(job: Comparison) -> Sheet:
    """Return the file `configurations.csv`: deflection and residual of each configuration and run."""
    rows = list[dict[str, Value]]()
    if job.result is not None:
        sides = {side.side: side for side in job.result.sides}
        for entry in job.result.entries:
            rows += _make_configuration_rows(entry, sides[entry.side])
    return Sheet.from_rows(rows)


def _make_configuration_rows(entry: ComparedRun, side: ComparedSide) -> list[dict[str, Value]]:
    """Return a row for each configuration of a run's side; none for a run without residuals."""
    identity: dict[str, Value] = {
        "side": entry.side,
        "method": entry.method,
        "weighting": entry.weighting,
        "constraint": _name_constraint(entry),
    }
    rows = list[dict[str, Value]]()
    for label, measured, residual in zip(side.configurations, side.deflection, entry.left, strict=False):
        numbers = {"configuration": label, "deflection [m]": measured, "left [m]": residual}
        rows.append(identity | numbers)
    return rows


def _prepare_work(inputs: Inputs, request: ComparisonRequest) -> Work:
    """Return the work of a comparison, which is computed later; numerical modules are imported here."""
    from jointstiff.service.kinds.comparison.work import prepare_comparison

    return prepare_comparison(inputs, request)


COMPARISON: Final = Kind[Comparison, ComparisonRequest](
    message=Comparison,
    request=ComparisonRequest,
    options=CampaignComparison,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("campaigns",),
    make_charts=make_charts,
    title="Comparison",
    examples={"two sets": {"run_ids": ["ID_OF_A_RUN", "ID_OF_ANOTHER"], "ordered": True}},
    files=tuple(
        File(
            name=f"{name}.csv",
            description=words,
            sheet=sheet,
            made_of="result",
        )
        for name, sheet, words in (
            ("table", entries_sheet, "the runs, one row per run and joint"),
            ("ratios", ratios_sheet, "the ratios of two sides"),
            (
                "configurations",
                configurations_sheet,
                "deflection of each configuration, and the residual of each run",
            ),
        )
    ),
    description="""Compare stored runs of one measurement set, or of two; nothing is identified again.

Runs of one set are shown side by side. Of two sets (encoders, before and after, two units) the answer also
has the ratio of each joint's stiffnesses with its interval, whether it changed, and the fraction of the
deflection that the second side avoids.""",
)
