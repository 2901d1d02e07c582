"""Compensated robot programs: the declaration of the kind, and the report of a program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from jointstiff.schemas.fields import Interval
from jointstiff.schemas.program import (
    Program,
    ProgramOptions,
    ProgramPoint,
    ProgramRequest,
    ProgramResult,
    Spread,
    SpreadEnds,
)
from jointstiff.service.kinds.correction.files import CONTENT
from jointstiff.service.kinds.kind import Kind, list_table_files
from jointstiff.service.problems import naming_missing_extra
from jointstiff.service.tables.estimate import (
    ShownEstimate,
    model_error_text,
    show_cell,
    show_estimate,
    style_for,
)
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import (
    Chart,
    Column,
    Line,
    Part,
    Style,
    Table,
    number_formatter,
)

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "milling": {
        "files": [
            "DEF part()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n"
            "LIN {X 1803.0,Y 290.3,Z 1505.4,A 18.5,B 140.5,C 9.0}\nEND\n"
        ],
        "options": {
            "run_id": "ID_OF_A_RUN",
            "units": {"length": "mm", "angle": "deg", "force": "N"},
            "accuracy_option": "off",
            "load": {"force": [0.0, 300.0, -500.0]},
            "axes": "tool",
            "tools": [{"name": "TOOL_DATA[1]", "values": [0.0, 0.0, 200.0, 0.0, 0.0, 0.0]}],
            "start": [10.0, -5.0, 10.0, 5.0, 45.0, 3.0],
            "format": "krl",
        },
    }
}


def _prepare_work(inputs: Inputs, request: ProgramRequest) -> Work:
    """Return the work of a program, which is computed later; numerical modules are imported here."""
    with naming_missing_extra("a program file"):
        from jointstiff.service.kinds.correction.programs import prepare_compensation

    return prepare_compensation(inputs, request)


def make_points_sheet(job: Program) -> Sheet:
    """Return the sheet of all points, decompressed from the stored result of a program."""
    from jointstiff.service.kinds.correction.files import decompress_file
    from jointstiff.service.kinds.correction.programs import points_sheet

    if job.result is None:
        raise ValueError("the program has no result")
    return points_sheet(decompress_file(job.result.table))


def choose_program_paths(path: Path, names: Iterable[str]) -> dict[str, Path]:
    """Choose the path to write for each file of a program; the result has the paths by the files' names.

    If `path` is a folder, the files keep their names there. Else a single file gets this path; each of
    several files gets the path with its own ending, and with its name, too, if an earlier file has the same
    ending.
    """
    file_names = {name: Path(name).name for name in names}  # without folders
    if path.is_dir():
        return {name: path / file_name for name, file_name in file_names.items()}
    if len(file_names) == 1:
        return dict.fromkeys(file_names, path)
    paths = dict[str, Path]()
    for name, file_name in file_names.items():
        with_own_ending = path.with_suffix(Path(file_name).suffix)
        is_taken = with_own_ending in paths.values()
        paths[name] = path.with_name(f"{path.stem}_{file_name}") if is_taken else with_own_ending
    return paths


_TO_MM: Final = 1e3
_SHOWN_POINTS = 8
_REASONS = {
    "no_load": "without load",
    "uncertain": "whose deflection is less than its uncertainty",
    "not_used": "that no move uses",
}


def _make_report(_job: Program, result: ProgramResult, _view: View) -> Report:
    """Return the report: counts of corrected targets, quantiles of distances, worst points, remarks."""
    counts = f"{result.corrected} of {result.points} targets are corrected"
    if result.capped:
        counts += f"; the limits reduce {result.capped} corrections"
    if result.left_alone:
        reasons = ", ".join(f"{count} {_REASONS[reason]}" for reason, count in result.left_alone.items())
        counts += f"; not corrected: {reasons}"
    if result.moves_left:
        counts += f"; {result.moves_left} of {result.moves} moves are left unchanged"
    parts: list[Part] = [Line(counts), _distances_table(result), _corrections_table(result)]
    if result.worst:
        parts.append(_worst_table(result))
    return Report([*parts, *map(Line, result.remarks)])


_QUANTILES: Final = {"median": "median", "p95": "95 % of the points", "greatest": "greatest"}
"""Title of the column of each field of a `Spread`."""


def _distances_table(result: ProgramResult) -> Table:
    """Return a table of quantiles of the loaded tool's distance from its target.

    Its rows are the program without correction and as written. Each quantile has its interval; the last
    column says whether the intervals include the model error.
    """
    model_error = model_error_text(result.with_model_error)
    return Table(
        [
            Column("quantity", ["without correction", "predicted, as written"], text=True),
            *(_make_quantile_column(result, field) for field in _QUANTILES),
            Column("model error", [model_error, model_error], text=True),
        ],
        title="Distance of the loaded tool from its target, mm",
        caption=f"in brackets: {100 * result.confidence:g} % interval",
    )


def _make_quantile_column(result: ProgramResult, field: str) -> Column:
    """Return the column of a quantile of the distances: without correction, then as written.

    `field` is the name of the quantile, a key of `_QUANTILES`.
    """
    style = style_for(result.assessment.verdict)
    without_correction = _show_quantile(result.deflection, result.deflection_ends, field)
    as_written = _show_quantile(result.residual, result.residual_ends, field)
    cells = [replace(cell, style=style) for cell in (without_correction, as_written)]
    return Column(_QUANTILES[field], cells, show_cell)


def _show_quantile(sizes: Spread | None, ends: SpreadEnds | None, name: str) -> ShownEstimate:
    """Format a quantile of distances [m] in mm with its interval; `name` is its field of the spread."""
    value = None if sizes is None else getattr(sizes, name)
    interval = None if ends is None else (getattr(ends.low, name), getattr(ends.high, name))
    return show_estimate(value, interval, _TO_MM)


def _corrections_table(result: ProgramResult) -> Table:
    """Return a table of what is written: displacement of the targets, and rounding of their numbers."""
    rows = {"displacement of targets": result.correction, "rounding of the numbers": result.rounding}
    spreads = list(rows.values())  # None without corrected points
    format_mm = number_formatter(".4f", _TO_MM)
    columns = [Column("quantity", list(rows), text=True)]
    for field, title in _QUANTILES.items():
        values = [None if spread is None else getattr(spread, field) for spread in spreads]
        columns.append(Column(title, values, format_mm))
    return Table(columns, title="Corrections as written, mm")


def _worst_table(result: ProgramResult) -> Table:
    """Return a table of the points with the greatest deflections, before and after the correction."""
    points = result.worst[:_SHOWN_POINTS]
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


def make_charts(result: ProgramResult) -> list[Chart]:
    """Return charts of the worst points: distance of the tool from its target, before and after."""
    points = result.worst
    if not points:
        return []
    names = [point.name or str(point.number) for point in points]
    before = [_Distance(point.deflection, _widest_interval(point)) for point in points]
    after = [_Distance(point.residual, _widest_residual_interval(point)) for point in points]
    return [_make_chart("without correction", names, before), _make_chart("as written", names, after)]


PROGRAM: Final = Kind[Program, ProgramRequest](
    message=Program,
    request=ProgramRequest,
    options=ProgramOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("run", "files"),
    make_charts=make_charts,
    title="Compensated program",
    stepped=True,
    max_bytes=16 * 1024 * 1024,
    is_form=True,
    writes_programs=True,
    to_answer=lambda document: CONTENT.sub('"content":null', document),  # files have their own addresses
    files=(
        *list_table_files(
            "points",
            "all points: deflection, correction, residual, intervals, reason if not corrected",
            make_points_sheet,
        ),
    ),
    examples=_EXAMPLES,
    description="""Compensate a program: the loaded tool then reaches the programmed points.

Send the program as fields `files` of a form (a .src with its .dat), and run, tool, base, loads and the
controller's accuracy option as JSON in a field `options`. Only numbers change: see the files `program` and
`points.csv`. A program that is not understood is refused, with the lines.""",
)
