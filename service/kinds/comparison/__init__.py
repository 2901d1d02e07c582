"""Several methods on one measurement set, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.comparison import Comparison, ComparisonOptions, ComparisonRequest, ComparisonSummary
from jointstiff.service.kinds.kind import File, Kind

if TYPE_CHECKING:
    from jointstiff.schemas.comparison import ComparisonResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "default": {"measurement_set_id": "ID_OF_A_STORED_SET"},
    "two methods, 10 configurations drawn 1000 times": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "methods": [
            {"method": "complete_pose", "weighting": "characteristic_length", "characteristic_length": 0.6},
            {"method": "partial_pose"},
        ],
        "constraints": ["positive"],
        "resampling": {"size": 10, "repetitions": 1000, "seed": 1},
    },
}


def _compute(inputs: Inputs, request: ComparisonRequest) -> Work:
    from jointstiff.service.kinds.comparison.work import work

    return work(inputs, request)


def _report(job: Comparison, result: ComparisonResult, view: View) -> Report:
    from jointstiff.service.kinds.comparison.tables import report

    return report(job, result, view)


def _entries_sheet(source: Comparison) -> Sheet:
    from jointstiff.service.kinds.comparison.tables import entries_sheet

    return entries_sheet(source)


COMPARISON: Final = Kind[Comparison, ComparisonRequest, ComparisonSummary](
    message=Comparison,
    request=ComparisonRequest,
    options=ComparisonOptions,
    compute=_compute,
    report=_report,
    sources=("measurement_set",),
    summary=ComparisonSummary,
    title="Comparison of methods",
    stepped=True,
    filters={"measurement_set_id": "measurement set", "robot_id": "robot"},
    examples=_EXAMPLES,
    files=(
        File(
            name="table.csv",
            description="the result as a table for spreadsheets: one row per entry and joint, units in "
            "the headers.",
            media_type="text/csv",
            sheet=_entries_sheet,
            made_of="result",
        ),
    ),
    description="""Identify by several methods, unconstrained and constrained, side by side.

Answers 201 with the finished comparison, or, if it resamples and takes longer than `wait` seconds, 202
with the comparison as it is and its address. A method that the readings cannot support is an entry with
its `error`; the others have their numbers.""",
)
