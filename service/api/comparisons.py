"""The table of a comparison, for spreadsheets."""

from __future__ import annotations

from typing import Any, Final, cast

from fastapi import APIRouter, HTTPException, Response

from jointstiff.schemas.comparison import Comparison
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.jobs import JobId
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.kinds.comparison.csv_table import comparison_csv

_TABLE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The table as CSV (RFC 4180).", "content": {"text/csv": {}}}
}

router = APIRouter(prefix="/v1/comparisons", tags=["comparisons"], route_class=AccessRoute)


@router.get(
    "/{comparison_id}/table.csv",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_TABLE | problems(404, 409, 422),
)
def get_comparison_table(parts: PartsOf, comparison_id: JobId) -> Response:
    """Get the result as a table for spreadsheets: one row an entry and joint, units in the headers."""
    comparison = cast("Comparison", parts.jobs[Comparison.kind].current(comparison_id))
    if comparison.result is None:
        raise HTTPException(409, f"the comparison has no table, because its state is {comparison.state}")
    return Response(
        comparison_csv(comparison.result),
        media_type="text/csv",
        headers={"Content-Disposition": f'attachment; filename="comparison-{comparison.id}.csv"'},
    )
