"""Postures and loads to measure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.plan import Plan, PlanOptions, PlanRequest, PlanSummary
from jointstiff.service.kinds.kind import READINGS_BYTES, File, Kind

if TYPE_CHECKING:
    from jointstiff.schemas.plan import PlanResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "begin a campaign": {
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "readings": 15,
        "load": {"kind": "any_direction", "force": 1500.0},
        "targets": {"P10": [0.147, 0.055, 0.05], "P11": [-0.137, 0.087, 0.085], "P12": [-0.007, -0.14, 0.12]},
        "load_point": [-0.06, 0.02, 0.18],
        "surroundings": {"floor": 0.1},
    },
    "go on with a campaign": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "readings": 8,
        "criterion": "d",
        "load": {"kind": "any_direction", "force": 1500.0},
    },
}


def _compute(inputs: Inputs, request: PlanRequest) -> Work:
    from jointstiff.service.kinds.plan.work import work

    return work(inputs, request)


def _report(job: Plan, result: PlanResult, view: View) -> Report:
    from jointstiff.service.kinds.plan.tables import report

    return report(job, result, view)


def _readings_sheet(source: Plan) -> Sheet:
    from jointstiff.service.kinds.plan.tables import readings_sheet

    return readings_sheet(source)


PLAN: Final = Kind[Plan, PlanRequest, PlanSummary](
    message=Plan,
    request=PlanRequest,
    options=PlanOptions,
    compute=_compute,
    report=_report,
    sources=("robot_or_set",),
    summary=PlanSummary,
    title="Plan of a campaign",
    max_bytes=READINGS_BYTES,
    filters={"robot_id": "robot", "measurement_set_id": "measurement set"},
    examples=_EXAMPLES,
    files=(
        File(
            name="readings.csv",
            operation="get_plan_table",
            description="Get the readings of a plan in their order as a table for spreadsheets, units in the "
            "headers.",
            content="The table as CSV (RFC 4180).",
            media_type="text/csv",
            sheet=_readings_sheet,
            made_of="result",
        ),
    ),
    description="""Plan which postures and loads to measure, to begin or continue a campaign.

The list has a certificate: its least share of the best list's information, proved by a sweep over all
candidates. The answer has the expected uncertainty of each joint, the efficiency of random and one-at-a-time
plans, and the number of infeasible readings by reason. An impossible plan is refused with a remedy, and
nothing is stored.""",
)
