"""Tables and charts of a corrected program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from jointstiff.schemas.correction import (
    CorrectedProgram,
    CorrectionResult,
    ProgramPoint,
    Spread,
    SpreadEnds,
)
from jointstiff.schemas.fields import Interval
from jointstiff.service.tables.estimate import (
    ShownEstimate,
    model_error_text,
    show_cell,
    show_estimate,
    style_for,
)
from jointstiff.service.tables.table import (
    Chart,
    Column,
    Line,
    Part,
    Style,
    Table,
    number_formatter,
)

_TO_MM: Final = 1e3
_SHOWN_POINTS = 8
_REASONS = {
    "no_load": "without load",
    "uncertain": "whose deflection is less than its uncertainty",
    "not_used": "that no move uses",
}


def describe_program(result: CorrectionResult, program: CorrectedProgram) -> list[Part]:
    """Return counts of corrected targets, quantiles of distances and the worst points of a program."""
    counts = f"{program.corrected} of {program.points} targets are corrected"
    if program.capped:
        counts += f"; the limits reduce {program.capped} corrections"
    if program.left_alone:
        reasons = ", ".join(f"{count} {_REASONS[reason]}" for reason, count in program.left_alone.items())
        counts += f"; not corrected: {reasons}"
    if program.moves_left:
        counts += f"; {program.moves_left} of {program.moves} moves are left unchanged"
    parts: list[Part] = [Line(counts), _distances_table(result, program), _corrections_table(program)]
    if program.worst:
        parts.append(_worst_table(result, program))
    return parts


_QUANTILES: Final = {"median": "median", "p95": "95 % of the points", "greatest": "greatest"}
"""Title of the column of each field of a `Spread`."""


def _distances_table(result: CorrectionResult, program: CorrectedProgram) -> Table:
    """Return a table of quantiles of the loaded tool's distance from its target.

    Its rows are the program without correction and as written. Each quantile has its interval; the last
    column says whether the intervals include the model error.
    """
    style = style_for(result.assessment.verdict)
    model_error = model_error_text(program.with_model_error)
    return Table(
        [
            Column("quantity", ["without correction", "predicted, as written"], text=True),
            *(_make_quantile_column(program, field, style) for field in _QUANTILES),
            Column("model error", [model_error, model_error], text=True),
        ],
        title="Distance of the loaded tool from its target, mm",
        caption=f"in brackets: {100 * result.confidence:g} % interval",
    )


def _make_quantile_column(program: CorrectedProgram, field: str, style: Style) -> Column:
    """Return the column of a quantile of the distances: without correction, then as written.

    `field` is the name of the quantile, a key of `_QUANTILES`; `style` is that of the cells.
    """
    without_correction = _show_quantile(program.deflection, program.deflection_ends, field)
    as_written = _show_quantile(program.residual, program.residual_ends, field)
    cells = [replace(cell, style=style) for cell in (without_correction, as_written)]
    return Column(_QUANTILES[field], cells, show_cell)


def _show_quantile(sizes: Spread | None, ends: SpreadEnds | None, name: str) -> ShownEstimate:
    """Format a quantile of distances [m] in mm with its interval; `name` is its field of the spread."""
    value = None if sizes is None else getattr(sizes, name)
    interval = None if ends is None else (getattr(ends.low, name), getattr(ends.high, name))
    return show_estimate(value, interval, _TO_MM)


def _corrections_table(program: CorrectedProgram) -> Table:
    """Return a table of what is written: displacement of the targets, and rounding of their numbers."""
    rows = {"displacement of targets": program.correction, "rounding of the numbers": program.rounding}
    spreads = list(rows.values())  # None without corrected points
    format_mm = number_formatter(".4f", _TO_MM)
    columns = [Column("quantity", list(rows), text=True)]
    for field, title in _QUANTILES.items():
        values = [None if spread is None else getattr(spread, field) for spread in spreads]
        columns.append(Column(title, values, format_mm))
    return Table(columns, title="Corrections as written, mm")


def _worst_table(result: CorrectionResult, program: CorrectedProgram) -> Table:
    """Return a table of the points with the greatest deflections, before and after the correction."""
    points = program.worst[:_SHOWN_POINTS]
    columns = [
        Column("point", [point.number for point in points]),
        Column("name", [point.name for point in points], text=True),
        Column("line", [point.line for point in points]),
        *_make_distance_columns(points, style_for(result.assessment.verdict)),
    ]
    remarks = ["capped" if point.capped else "" for point in points]
    if any(remarks):
        columns.append(Column("", remarks, text=True))
    return Table(
        columns,
        title="Worst points",
        caption=f"distance from the target, with its {100 * result.confidence:g} % interval",
    )


def _make_distance_columns(points: Sequence[ProgramPoint], style: Style) -> list[Column]:
    """Return columns of the tool's distance from its target at points, before and after the correction.

    A last column says whether the intervals include the model error. `style` is that of the cells.
    """
    before, after = [], []
    for point in points:
        before.append(show_estimate(point.deflection, _widest_interval(point), _TO_MM, style=style))
        after.append(show_estimate(point.residual, _widest_residual_interval(point), _TO_MM, style=style))
    included = [model_error_text(point.interval_with_model_error is not None) for point in points]
    return [
        Column("before", before, show_cell, "mm"),
        Column("after", after, show_cell, "mm"),
        Column("model error", included, text=True),
    ]


def _widest_interval(point: ProgramPoint) -> Interval | None:
    """Return the interval of a point's deflection [m]: with model error if its bound is known."""
    return point.interval_with_model_error or point.interval


def _widest_residual_interval(point: ProgramPoint) -> Interval | None:
    """Return the interval of a point's residual [m]: with model error if its bound is known."""
    return point.residual_interval_with_model_error or point.residual_interval


def _make_chart(state: str, names: list[str], distances: Sequence[_Distance]) -> Chart:
    """Return a chart of the tool's distance from its target at the worst points, in mm.

    Args:
        state: state of the program, "without correction" or "as written".
        names: names of the points.
        distances: distance of the tool at each point.
    """
    return Chart(
        title=f"{state.capitalize()}, worst points",
        names=names,
        series={state: [distance.length for distance in distances]},
        factor=_TO_MM,
        unit="mm",
        axis="points",
        intervals={state: [distance.interval for distance in distances]},
        quantity="distance to target",
    )


class _Distance(NamedTuple):
    """Distance of the loaded tool from its target at a point."""

    length: float  # [m]
    interval: Interval | None  # interval of the distance [m]; None where it is not known


def make_charts(result: CorrectionResult) -> list[Chart]:
    """Return charts of a program's worst points: distance of the tool from its target, before and after."""
    points = [] if result.program is None else result.program.worst
    if not points:
        return []
    names = [point.name or str(point.number) for point in points]
    before = [_Distance(point.deflection, _widest_interval(point)) for point in points]
    after = [_Distance(point.residual, _widest_residual_interval(point)) for point in points]
    return [_make_chart("without correction", names, before), _make_chart("as written", names, after)]
