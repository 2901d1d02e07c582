"""Robot programs, corrected."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.program import Program, ProgramOptions, ProgramRequest, ProgramSummary
from jointstiff.service.kinds.kind import File, Kind

if TYPE_CHECKING:
    from jointstiff.schemas.program import ProgramResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View
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


def _compute(inputs: Inputs, request: ProgramRequest) -> Work:
    from jointstiff.service.kinds.program.work import work

    return work(inputs, request)


def _report(job: Program, result: ProgramResult, view: View) -> Report:
    from jointstiff.service.kinds.program.tables import report

    return report(job, result, view)


def _points_sheet(source: Program) -> Sheet:
    from jointstiff.service.kinds.program.tables import points_sheet

    return points_sheet(source)


def _without_contents(document: str) -> str:
    from jointstiff.service.kinds.program.work import without_contents

    return without_contents(document)


PROGRAM: Final = Kind[Program, ProgramRequest, ProgramSummary](
    message=Program,
    request=ProgramRequest,
    options=ProgramOptions,
    compute=_compute,
    report=_report,
    sources=("run", "files"),
    summary=ProgramSummary,
    title="Compensated program",
    stepped=True,
    max_bytes=16 * 1024 * 1024,
    is_form=True,
    answered=_without_contents,
    files=(
        File(
            name="points.csv",
            operation="get_program_points",
            description="Get all points as a table: deflection, correction, interval, residual, and reason "
            "if not corrected.",
            content="One row per point (RFC 4180), in the order of the path.",
            media_type="text/csv",
            sheet=_points_sheet,
            made_of="result",
        ),
        File(
            name="points.json",
            operation="get_program_columns",
            description="Get the table as JSON, column by column, with units.",
            content="`columns`, each with `name`, `unit` and `values`.",
            media_type="application/json",
            sheet=_points_sheet,
            made_of="result",
        ),
    ),
    filters={"robot_id": "robot"},
    examples=_EXAMPLES,
    description="""Compensate a program: the loaded tool then reaches the programmed points.

Send the program as fields `files` of a form (a .src with its .dat, if it has one), and the run, tool,
base, loads and the state of
the controller's accuracy option as JSON in a field `options`. Only numbers change: the corrected files
are at /program, every
point with its deflection, correction, interval and predicted residual at /points.csv. A program that is
not understood
as a whole is refused by line, and nothing is stored. Programs of more than 10,000 targets are jobs with
progress.""",
)
