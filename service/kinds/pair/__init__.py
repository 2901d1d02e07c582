"""Two sides compared: encoders, before and after, two units."""

from __future__ import annotations

from typing import Any, Final

from jointstiff.schemas.pair import Pair, PairOptions, PairRequest, PairSummary
from jointstiff.service.kinds.kind import File, Kind

_EXAMPLES: Final[dict[str, Any]] = {
    "two encoders": {
        "first": {"measurement_set_id": "ID_OF_THE_SET_WITH_MOTOR_ENCODERS"},
        "second": {"measurement_set_id": "ID_OF_THE_SET_WITH_SECONDARY_ENCODERS"},
        "ordered": True,
    },
    "two runs": {"first": {"run_id": "ID_OF_A_RUN"}, "second": {"run_id": "ID_OF_ANOTHER"}},
}

PAIR: Final = Kind[Pair, PairRequest, PairSummary](
    room=__name__,
    message=Pair,
    request=PairRequest,
    options=PairOptions,
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
            operation="get_pair_table",
            description="Get the joints of both sides with their ratio as a table for spreadsheets, units in "
            "the headers.",
            content="The table as CSV (RFC 4180).",
            media_type="text/csv",
            made_of="result",
        ),
    ),
    description="""Compare two sides: motor and secondary encoders, before and after, or units A and B.

For each joint: the ratio of its stiffnesses with Fieller's interval, and whether it has changed. For each
observation, and overall: the share of the deflection that the second side avoids, measured where both
sides have the observation, and predicted. With `ordered`, also both sides in one problem in which no
joint is softer on the second.""",
)
