"""Processes: the declaration of the kind, and the report of a process."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, inf, isfinite, nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from jointstiff.schemas.process import (
    DeflectionBand,
    Process,
    ProcessOptions,
    ProcessPlace,
    ProcessRequest,
    ProcessResult,
)
from jointstiff.service.kinds.kind import Kind, list_table_files
from jointstiff.service.kinds.process.columns import OF_AREA, OF_GRID
from jointstiff.service.kinds.program.kind import CONTENT, make_points_sheet
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
    NO_NUMBER,
    Area,
    Chart,
    Column,
    Line,
    Part,
    Style,
    Table,
    number_formatter,
    vector_formatter,
)
from jointstiff.solver.text import figure

if TYPE_CHECKING:
    from collections.abc import Callable

    from jointstiff.schemas.program import ProgramFrame
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "free turn": {
        "files": [
            "DEF part()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n"
            "PTP {X 1803.0,Y 290.3,Z 1505.4,A 18.5,B 140.5,C 9.0,S 2,T 3}\n"
            "LIN {X 1823.0,Y 290.3,Z 1505.4,A 18.5,B 140.5,C 9.0}\nEND\n"
        ],
        "options": {
            "run_id": "ID_OF_A_RUN",
            "units": {"length": "mm", "angle": "deg", "force": "N"},
            "accuracy_option": "off",
            "load": {"force": [-100.0, -300.0, -500.0]},
            "axes": "feed",
            "tools": [{"name": "TOOL_DATA[1]", "values": [0.0, 0.0, 200.0, 0.0, 45.0, 0.0]}],
            "start": [10.0, -5.0, 10.0, 5.0, 45.0, 3.0],
            "turn": "free",
            "format": "krl",
        },
    }
}


def _prepare_work(inputs: Inputs, request: ProcessRequest) -> Work:
    """Return the work of a process, which is computed later; numerical modules are imported here."""
    with naming_missing_extra("a program file"):
        from jointstiff.service.kinds.process.work import prepare_process

    return prepare_process(inputs, request)


def _choice_sheet(name: str) -> Callable[[Process], Sheet]:
    """Return the function that makes the table of turns or of places from a stored process."""

    def make_sheet(job: Process) -> Sheet:
        """Return the table, decompressed from the stored result of a process."""
        from jointstiff.service.kinds.process import tables
        from jointstiff.service.kinds.program.files import decompress_file

        if job.result is None:
            raise ValueError("the process has no result")
        make = tables.turns_sheet if name == "turns" else tables.places_sheet
        return make(decompress_file(job.result.choice))

    return make_sheet


_GAINS: Final = {
    "no_gain": "no gain: the deflection is the same at all turns, as for a spindle along the last axis",
    "no_order": (
        "it is not certain that the deflection is less than before: the interval of the difference contains "
        "zero, or is unknown"
    ),
}


def _make_report(job: Process, result: ProcessResult, _view: View) -> Report:
    """Return the report: deflection before and after, what turning gains, the best places, remarks."""
    size = "root mean square" if result.objective == "rms" else "greatest"
    parts: list[Part] = [
        Line(f"{_describe_gain(result)}; {result.points} targets, {result.moves} moves"),
        _deflection_table(result, f"Deflection along the path, {size}", job.request.confidence),
    ]
    parts += _describe_fixed_turns(result)
    if result.needed_speeds:
        parts.append(Line(_describe_speeds(result)))
    if result.places:
        parts += _place_parts(result)
    parts += [Line(f"set in the controller: {_frame_text(each, result.format)}") for each in result.frames]
    return Report([*parts, *map(Line, result.remarks)])


def _describe_gain(result: ProcessResult) -> str:
    """Return how the turned program changes the deflection of the path, in words."""
    if result.before is None:
        return "the robot cannot follow the path with the workpiece in its programmed place"
    if result.gain in _GAINS:
        return _GAINS[result.gain]
    share = 1 - result.turned.value / result.before.value
    return f"{figure(100 * share, '.3g')} % less deflection than before"


def _describe_fixed_turns(result: ProcessResult) -> list[Line]:
    """Return a line on the deflections with one turn for the whole path; none if at most one is allowed."""
    allowed = [each for each in result.fixed_deflections if each is not None]
    if len(allowed) <= 1:
        return []
    least, greatest = _format_micrometres(min(allowed)), _format_micrometres(max(allowed))
    return [
        Line(
            f"{len(allowed)} of {len(result.fixed_turns)} fixed turns are within the limits: "
            f"{least} to {greatest} µm"
        )
    ]


def _describe_speeds(result: ProcessResult) -> str:
    """Return what the joints need along the path, and along the program as sent."""
    feed = 0.05 if result.feed is None else result.feed
    needed = ", ".join(figure(degrees(each), ".3g") for each in result.needed_speeds)
    stated = "feed" if result.feed is not None else "feed unknown, assumed"
    text = f"{stated} {figure(1e3 * feed, '.3g')} mm/s: the joints need {needed} °/s"
    for name, shares in (("", result.speed_shares), ("; as sent ", result.sent_speed_shares)):
        known = [each for each in shares if each is not None]
        if known:
            text += f"{name or ', at most '}{figure(100 * max(known), '.3g')} % of their greatest speeds"
    return text


_FRAME_UNITS: Final = {
    "krl": ("mm", "°"),
    "fanuc": ("mm", "°"),
    "rapid": ("mm", "(q1 … q4)"),
    "ur": ("m", "rad"),
}
"""Units of position and orientation of a frame, by the format of the program; a table has its own."""
_DIGITS_OF_METRE: Final = 10
"""Digits after the point of a deflection [m]: less is rounding."""
_ROUNDING: Final = 1e-8
"""Part of the greatest coordinate of a frame up to which numbers are rounding."""


def _frame_text(frame: ProgramFrame, program_format: str) -> str:
    """Return a base frame as text: name, and numbers as the program writes frames, with their units."""
    least = _ROUNDING * max(map(abs, frame.values[:3]))
    numbers = [figure(each if abs(each) > least else 0.0, ".9g") for each in frame.values]
    position, orientation = ", ".join(numbers[:3]), ", ".join(numbers[3:])
    name = frame.name or "the base"
    if program_format not in _FRAME_UNITS:
        return f"{name}: {position}, {orientation}, in the units of the table"
    length, angle = _FRAME_UNITS[program_format]
    return f"{name}: {position} {length}; {orientation} {angle}"


def _format_micrometres(length: float) -> str:
    """Format a length in micrometres."""
    return figure(1e6 * length, ".4g")


def _deflection_table(result: ProcessResult, title: str, confidence: float) -> Table:
    """Return a table of deflections, each with its intervals.

    The rows are the deflection before, the deflection with the chosen turns and place, the difference of the
    two, and the deflection that is left after the correction.
    """
    rows = {
        "before": result.before,
        "as chosen": result.turned,
        "difference": result.difference,
        "left after correction": result.remaining,
    }
    style = style_for(result.assessment.verdict)
    return Table(
        [Column("deflection", list(rows), text=True), *_band_columns([*rows.values()], style)],
        title=title,
        caption=f"in brackets: {100 * confidence:g} % interval by readings, forces and model error",
    )


def _band_columns(bands: Sequence[DeflectionBand | None], style: Style) -> list[Column]:
    """Return columns of values with their intervals, in µm, and whether these include the model error.

    `style` is that of the values.
    """
    return [
        Column("value", [_show_band(band, style) for band in bands], show_cell, "µm"),
        Column("model error", bands, _describe_model_error, text=True),
    ]


def _show_band(band: DeflectionBand | None, style: Style) -> ShownEstimate:
    """Format a deflection [m] in µm with its interval, which includes the model error if that is known.

    A difference below 0.1 nm is rounding, and zero.
    """
    if band is None:
        return show_estimate(None, None)
    interval = band.with_model_error or band.readings
    low, high = interval or (0.0, 0.0)
    ends = (round(low, _DIGITS_OF_METRE), round(high, _DIGITS_OF_METRE))
    value = round(band.value, _DIGITS_OF_METRE)
    return show_estimate(value, None if interval is None else ends, 1e6, style=style)


def _describe_model_error(band: DeflectionBand) -> str:
    """Return whether the interval of a deflection includes the model error; a dash without an interval."""
    if band.with_model_error is None and band.readings is None:
        return NO_NUMBER
    return model_error_text(band.with_model_error is not None)


def _place_parts(result: ProcessResult) -> list[Part]:
    """Return a table of the best places, and how flat the deflection is around them."""
    places = result.places
    bands = [each.deflection for each in places]
    columns = [
        Column("centre of the path", [each.centre for each in places], vector_formatter(".0f", 1e3), "mm"),
        Column("turn about z", [degrees(each.turn) for each in places], number_formatter(".0f"), "°"),
        *_band_columns(bands, style_for(result.assessment.verdict)),
        Column("than the best", [_order(each) for each in places], text=True),
    ]
    reached = f"at {result.places_reached} of {result.places_tried} places the robot can follow the path"
    return [
        Table(columns, title="Best places of the workpiece"),
        Line(reached),
        *_describe_equal_places(result),
    ]


def _describe_equal_places(result: ProcessResult) -> list[Line]:
    """Return a line on the box of places with nearly the least deflection; none if it is not known."""
    if result.flat_low is None or result.flat_high is None:
        return []
    extent = list[str]()
    for axis, low, high in zip("xyz", result.flat_low, result.flat_high, strict=True):
        extent.append(f"{axis} {1e3 * low:.0f} to {1e3 * high:.0f}")
    count = "1 place" if result.flat_places == 1 else f"{result.flat_places} places"
    return [Line(f"{count} of the search with a deflection within 5 % of the best: {', '.join(extent)} mm")]


def _order(place: ProcessPlace) -> str:
    """Return how a place compares with the best."""
    if place.behind_best is None:
        return "—"
    return "worse" if place.is_worse else "no order"


def make_charts(result: ProcessResult) -> list[Chart]:
    """Return a chart of the deflection of each fixed turn; none if only one turn was tried."""
    if len(result.fixed_turns) < 2:
        return []
    names = [f"{degrees(each):.0f}°" for each in result.fixed_turns]
    series = {"the same turn along the path": result.fixed_deflections}
    return [Chart("Deflection at fixed turns", names, series, 1e6, "µm", "turns", quantity="deflection")]


def make_area_map(sheet: Sheet) -> Area | None:
    """Return a map of the deflection over x and y, the least over heights and turns of the workpiece.

    None is returned if no places were searched.
    """
    least = _find_least_deflections(sheet)
    if not least:
        return None
    values = [each if isfinite(each) else nan for each in least.values()]
    return Area(
        "Least deflection at each position of the path's centre",
        x=[place.x for place in least],
        y=[place.y for place in least],
        values=values,
        names=("x [mm]", "y [mm]", "deflection [µm]"),
        factor=1e6,
    )


class _Position(NamedTuple):
    """Position of the path's centre, seen from above [mm]."""

    x: float
    y: float


def _find_least_deflections(sheet: Sheet) -> dict[_Position, float]:
    """Return position → least deflection [m] over the places of the grid there; infinite if all fail.

    The arm follows the path from only some places, so a place may have no deflection.
    """
    columns = [sheet.columns[name] for name in OF_AREA]
    of_grid = sheet.columns.get(OF_GRID, [True] * len(columns[0]))
    least = dict[_Position, float]()
    for x, y, deflection, is_of_grid in zip(*columns, of_grid, strict=True):
        if is_of_grid:
            is_known = deflection is not None and isfinite(deflection)
            position = _Position(1e3 * float(x), 1e3 * float(y))
            least[position] = min(least.get(position, inf), float(deflection) if is_known else inf)
    return least


PROCESS: Final = Kind[Process, ProcessRequest](
    message=Process,
    request=ProcessRequest,
    options=ProcessOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("run_or_robot", "files"),
    make_charts=make_charts,
    make_area_map=make_area_map,
    area_table="places",
    title="Process",
    stepped=True,
    max_bytes=16 * 1024 * 1024,
    is_form=True,
    writes_programs=True,
    to_answer=lambda document: CONTENT.sub('"content":null', document),
    files=(
        *list_table_files("points", "all points", make_points_sheet),
        *list_table_files(
            "turns",
            "turn, deflection before and after, joints and their speeds at each point",
            _choice_sheet("turns"),
        ),
        *list_table_files(
            "places",
            "all places that were tried, with their deflection, and why some are not legal",
            _choice_sheet("places"),
        ),
    ),
    examples=_EXAMPLES,
    description="""Find the least deflection along a path: turns about the spindle, and the workpiece's place.

Send a form as for a compensated program; the program may be a table of poses. The result has the deflection
before, after turning and after correction, and the interval of the difference; `program` has the new
orientations.""",
)
