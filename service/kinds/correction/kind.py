"""Corrected poses, in tables or in robot programs: the declaration of the kind, its report and its files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.correction import (
    CorrectionJob,
    CorrectionOptions,
    CorrectionRequest,
    CorrectionResult,
)
from jointstiff.service.kinds.correction.files import CONTENT, decompress_file
from jointstiff.service.kinds.correction.table import describe_program, make_charts
from jointstiff.service.kinds.kind import File, Kind, list_table_files
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Column, Line, Table

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "two rows": {
        "files": [
            "x [mm],y [mm],z [mm],a [deg],b [deg],c [deg]\n"
            "1803.0,290.3,1505.4,18.5,140.5,9.0\n1813.0,290.3,1505.4,18.5,140.5,9.0\n"
        ],
        "options": {
            "run_id": "ID_OF_A_RUN",
            "units": {"length": "mm", "angle": "deg", "force": "N"},
            "tool": [0.0, 0.0, 200.0, 0.0, 0.0, 0.0],
            "force": [0.0, 300.0, -500.0],
            "start": [10.0, -5.0, 10.0, 5.0, 45.0, 3.0],
        },
    },
    "milling": {
        "files": [
            "DEF part()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n"
            "LIN {X 1803.0,Y 290.3,Z 1505.4,A 18.5,B 140.5,C 9.0}\nEND\n"
        ],
        "options": {
            "run_id": "ID_OF_A_RUN",
            "units": {"length": "mm", "angle": "deg", "force": "N"},
            "accuracy_option": "off",
            "force": [0.0, 300.0, -500.0],
            "axes": "tool",
            "tools": [{"name": "TOOL_DATA[1]", "values": [0.0, 0.0, 200.0, 0.0, 0.0, 0.0]}],
            "start": [10.0, -5.0, 10.0, 5.0, 45.0, 3.0],
            "format": "krl",
        },
    },
}


def _prepare_work(inputs: Inputs, request: CorrectionRequest) -> Work:
    """Return the work of a request, which is computed later; numerical modules are imported here."""
    from jointstiff.service.kinds.correction.work import prepare_correction

    return prepare_correction(inputs, request)


def make_rows_sheet(job: CorrectionJob) -> Sheet:
    """Return the sheet of all corrected rows, or of all points of a program, from the stored result."""
    if job.result is None or job.result.table is None:
        raise ValueError("the correction has no result")
    content = decompress_file(job.result.table)
    if job.result.program is not None:
        from jointstiff.service.kinds.correction.programs import points_sheet

        return points_sheet(content)
    from jointstiff.service.tables.packed import unpack_sheet

    return unpack_sheet(content)


def _make_report(_job: CorrectionJob, result: CorrectionResult, _view: View) -> Report:
    """Return the report: rows by status, or what was corrected of a program; and remarks."""
    if result.program is not None:
        return Report([*describe_program(result, result.program), *map(Line, result.remarks)])
    statuses = Table(
        [
            Column("status", [name.replace("_", " ") for name in result.counts], text=True),
            Column("rows", list(result.counts.values())),
            Column("first row", [result.first[name] for name in result.counts]),
        ],
        title="Rows by status",
    )
    return Report([statuses, *map(Line, result.remarks)])


CORRECTION: Final = Kind[CorrectionJob, CorrectionRequest](
    message=CorrectionJob,
    request=CorrectionRequest,
    options=CorrectionOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("run_or_robot", "files"),
    title="Corrected poses",
    stepped=True,
    max_bytes=32 * 1024 * 1024,  # 100,000 rows of 20 numbers with 15 digits
    is_form=True,
    writes_programs=True,
    make_charts=make_charts,
    to_answer=lambda document: CONTENT.sub('"content":null', document),  # the rows have their own addresses
    files=(
        *list_table_files(
            "rows",
            "all rows: status, corrected pose and joints, deflection, intervals; or all points of a program",
            make_rows_sheet,
        ),
        File("rows.parquet", "the same as Parquet", make_rows_sheet, "result"),
    ),
    examples=_EXAMPLES,
    description="""Correct poses for the deflection under load, by the model of a run or by a prior.

Columns: the answer (200) has the columns of the request, corrected, and the status of each row; nothing is
stored. Over 5,000 rows are a job, at most 100,000. Or send files as fields `files` of a form, and the other
fields as JSON in a field `options`: that is a job.

* A CSV or Parquet file: the job has the files `rows.csv` and `rows.parquet`. With joints, a wrong tool, base
  or unit is refused, and frames that fit are proposed.
* A robot program (a .src with its .dat): state the controller's accuracy option. Only numbers change: see the
  files `program` and `rows.csv`. A program that is not understood is refused, with the lines.""",
)
