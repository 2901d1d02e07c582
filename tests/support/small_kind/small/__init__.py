"""A small kind of work, which tests add to the others."""

from __future__ import annotations

from typing import Final

from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.kinds.small.messages import Small, SmallOptions, SmallRequest, SmallSummary

SMALL: Final = Kind[Small, SmallRequest, SmallSummary](
    room=__name__,
    message=Small,
    request=SmallRequest,
    options=SmallOptions,
    sources=("measurement_set",),
    summary=SmallSummary,
    title="Count of readings",
    description="Count the readings of a measurement set.",
    filters={"measurement_set_id": "measurement set"},
    examples={"all": {"measurement_set_id": "ID_OF_A_STORED_SET"}},
    files=(
        File(
            name="counts.csv",
            operation="get_small_counts",
            description="Get the counts as a table.",
            content="The table as CSV.",
            media_type="text/csv",
            made_of="result",
        ),
    ),
)
