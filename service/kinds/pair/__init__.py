"""Two sides compared: encoders, before and after, two units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.pair import Pair, PairOptions, PairRequest, PairSummary
from jointstiff.service.kinds.kind import File, Kind

if TYPE_CHECKING:
    from jointstiff.schemas.pair import PairResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "two encoders": {
        "first": {"measurement_set_id": "ID_OF_THE_SET_WITH_MOTOR_ENCODERS"},
        "second": {"measurement_set_id": "ID_OF_THE_SET_WITH_SECONDARY_ENCODERS"},
        "ordered": True,
    },
    "two runs": {"first": {"run_id": "ID_OF_A_RUN"}, "second": {"run_id": "ID_OF_ANOTHER"}},
}


def _compute(inputs: Inputs, request: PairRequest) -> Work:
    from jointstiff.service.kinds.pair.work import work

    return work(inputs, request)


def _report(job: Pair, result: PairResult, view: View) -> Report:
    from jointstiff.service.kinds.pair.tables import report

    return report(job, result, view)


def _joints_sheet(source: Pair) -> Sheet:
    from jointstiff.service.kinds.pair.tables import joints_sheet

    return joints_sheet(source)


PAIR: Final = Kind[Pair, PairRequest, PairSummary](
    message=Pair,
    request=PairRequest,
    options=PairOptions,
    compute=_compute,
    report=_report,
    sources=("pair",),
    summary=PairSummary,
    title="Comparison of two measurement sets",
    filters={
        "first_set_id": "the first measurement set",
        "second_set_id": "the second measurement set",
        "robot_id": "robot",
    },
    examples=_EXAMPLES,
    files=(
        File(
            name="table.csv",
            description="the joints of both sides with their ratio as a table for spreadsheets, units in "
            "the headers.",
            media_type="text/csv",
            sheet=_joints_sheet,
            made_of="result",
        ),
    ),
    description="""Compare two sides: motor and secondary encoders, before and after, or units A and B.

For each joint: the ratio of its stiffnesses with Fieller's interval, and whether it has changed. For each
observation, and overall: the share of the deflection that the second side avoids, measured where both
sides have the observation, and predicted. With `ordered`, also both sides in one problem in which no
joint is softer on the second.""",
)
