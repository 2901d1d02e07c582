"""Compensated robot programs: the declaration of the kind, and the report of a program."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.program import (
    Program,
    ProgramOptions,
    ProgramRequest,
    ProgramResult,
    Spread,
    SpreadEnds,
)
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
    Table,
    number_formatter,
)

if TYPE_CHECKING:
    from jointstiff.schemas.process import Process
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
        from jointstiff.service.kinds.program.work import prepare_compensation

    return prepare_compensation(inputs, request)


def make_points_sheet(job: Program | Process) -> Sheet:
    """Return the sheet of all points, decompressed from the stored result of a program."""
    from jointstiff.service.kinds.program.files import decompress_file
    from jointstiff.service.kinds.program.work import points_sheet

    if job.result is None:
        raise ValueError("the program has no result")
    return points_sheet(decompress_file(job.result.table))


CONTENT: Final = re.compile(r'"content":"[A-Za-z0-9+/=]*"')
"""Pattern of a file's content in a job's JSON; texts of users cannot match: their quotes are escaped."""


def choose_program_paths(path: Path, names: Iterable[str]) -> dict[str, Path]:
    """Return name → path to write, for each file of a program.

    If `path` is a folder, the files keep their names there. Else a single file gets this path; each of
    several files gets the path with its own ending, and with its name, too, if an earlier file has the same
    ending.
    """
    plain = {name: Path(name).name for name in names}
    if path.is_dir():
        return {name: path / file for name, file in plain.items()}
    if len(plain) == 1:
        return dict.fromkeys(plain, path)
    paths = dict[str, Path]()
    for name, file in plain.items():
        own = path.with_suffix(Path(file).suffix)
        paths[name] = path.with_name(f"{path.stem}_{file}") if own in paths.values() else own
    return paths


_SHOWN_POINTS = 8
_REASONS = {
    "no_load": "without load",
    "uncertain": "whose deflection is less than its uncertainty",
    "not_used": "that no move uses",
}


def _make_report(_job: Program, result: ProgramResult, _view: View) -> Report:
    """Return the report: counts of corrected targets, quantiles of distances, worst points, remarks."""
    reasons = ", ".join(f"{count} {_REASONS[reason]}" for reason, count in result.left_alone.items())
    capped = f"; the limits reduce {result.capped} corrections" if result.capped else ""
    uncorrected = f"; not corrected: {reasons}" if reasons else ""
    moves = f"; {result.moves_left} of {result.moves} moves are left unchanged" if result.moves_left else ""
    counts = Line(f"{result.corrected} of {result.points} targets are corrected{capped}{uncorrected}{moves}")
    worst: list[Part] = [_worst_table(result)] if result.worst else []
    tables: list[Part] = [_distances_table(result), _corrections_table(result), *worst]
    return Report([counts, *tables, *map(Line, result.remarks)])


def _distances_table(result: ProgramResult) -> Table:
    """Return a table of quantiles of the loaded tool's distance from its target, and of the corrections.

    Each quantile has its interval; the last column says whether the intervals include the model error.
    """
    confidence, style = f"{100 * result.confidence:g} %", style_for(result.assessment.verdict)
    rows = {
        "without correction": (result.deflection, result.deflection_ends),
        "predicted, as written": (result.residual, result.residual_ends),
    }
    quantiles = {"median": "median", "95 % of the points": "p95", "greatest": "greatest"}
    columns = [
        Column(title, [replace(_show_quantile(*row, name), style=style) for row in rows.values()], show_cell)
        for title, name in quantiles.items()
    ]
    return Table(
        [
            Column("quantity", list(rows), text=True),
            *columns,
            Column("model error", [model_error_text(result.with_model_error)] * len(rows), text=True),
        ],
        title="Distance of the loaded tool from its target, mm",
        caption=f"in brackets: {confidence} interval",
    )


def _show_quantile(sizes: Spread | None, ends: SpreadEnds | None, name: str) -> ShownEstimate:
    """Format a quantile of distances [m] in mm with its interval; `name` is its field of the spread."""
    value = None if sizes is None else getattr(sizes, name)
    interval = None if ends is None else (getattr(ends.low, name), getattr(ends.high, name))
    return show_estimate(value, interval, 1e3)


def _corrections_table(result: ProgramResult) -> Table:
    """Return a table of what is written: displacement of the targets, and rounding of their numbers."""
    rows = {"displacement of targets": result.correction, "rounding of the numbers": result.rounding}
    format_mm = number_formatter(".4f", 1e3)
    return Table(
        [
            Column("quantity", list(rows), text=True),
            Column("median", [each and each.median for each in rows.values()], format_mm),
            Column("95 % of the points", [each and each.p95 for each in rows.values()], format_mm),
            Column("greatest", [each and each.greatest for each in rows.values()], format_mm),
        ],
        title="Corrections as written, mm",
    )


def _worst_table(result: ProgramResult) -> Table:
    """Return a table of the points with the greatest deflections, before and after the correction."""
    points, style = result.worst[:_SHOWN_POINTS], style_for(result.assessment.verdict)
    before = [
        show_estimate(point.deflection, point.interval_with_model_error or point.interval, 1e3, style=style)
        for point in points
    ]
    after = [
        show_estimate(
            point.residual,
            point.residual_interval_with_model_error or point.residual_interval,
            1e3,
            style=style,
        )
        for point in points
    ]
    included = [model_error_text(point.interval_with_model_error is not None) for point in points]
    remarks = ["capped" if point.capped else "" for point in points]
    return Table(
        [
            Column("point", [point.number for point in points]),
            Column("name", [point.name for point in points], text=True),
            Column("line", [point.line for point in points]),
            Column("before", before, show_cell, "mm"),
            Column("after", after, show_cell, "mm"),
            Column("model error", included, text=True),
            *([Column("", remarks, text=True)] if any(remarks) else []),
        ],
        title="Worst points",
        caption=f"distance from the target, with its {100 * result.confidence:g} % interval",
    )


def make_charts(result: ProgramResult) -> list[Chart]:
    """Return a chart of the worst points: distance of the tool from its target, corrected and uncorrected."""
    points = result.worst
    before = {"without correction": [point.deflection for point in points]}
    after = {"as written": [point.residual for point in points]}
    intervals = {
        "without correction": [point.interval_with_model_error or point.interval for point in points]
    }
    intervals_after = {
        "as written": [
            point.residual_interval_with_model_error or point.residual_interval for point in points
        ]
    }
    names = [point.name or str(point.number) for point in points]
    charts = [
        Chart("Without correction, worst points", names, before, 1e3, "mm", "points", intervals),
        Chart("As written, worst points", names, after, 1e3, "mm", "points", intervals_after),
    ]
    return [replace(chart, quantity="distance to target") for chart in charts] if points else []


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
