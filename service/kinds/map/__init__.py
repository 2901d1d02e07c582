"""Deflection over a work area."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.map import Map, MapOptions, MapRequest, MapSummary
from jointstiff.service.kinds.kind import File, Kind

if TYPE_CHECKING:
    from jointstiff.schemas.map import MapResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.map.work import MapWork
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "milling a plate": {
        "run_id": "ID_OF_A_RUN",
        "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.4]],
        "grid": [9, 13, 1],
        "place": [0.0, 0.0, 0.25],
        "turns": 8,
        "force": [0.0, 300.0, -500.0],
    },
    "the same posture throughout, force along with the tool": {
        "run_id": "ID_OF_A_RUN",
        "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 1.2]],
        "grid": [9, 13, 5],
        "place": [0.0, 0.0, 0.25],
        "directions": [[0.0, 0.0, -1.0], [0.5, 0.0, -0.8660254]],
        "force": [100.0, 0.0, -400.0],
        "axes": "flange",
        "near": [0.0, -0.5, 0.8, 0.0, 1.0, 0.0],
    },
}


def _compute(inputs: Inputs, request: MapRequest) -> Work:
    from jointstiff.service.kinds.map.work import work

    return work(inputs, request)


def _report(job: Map, result: MapResult, view: View) -> Report:
    from jointstiff.service.kinds.map.tables import report

    return report(job, result, view)


def _places_sheet(source: MapWork) -> Sheet:
    from jointstiff.service.kinds.map.tables import places_sheet

    return places_sheet(source)


MAP: Final = Kind[Map, MapRequest, MapSummary](
    message=Map,
    request=MapRequest,
    options=MapOptions,
    compute=_compute,
    report=_report,
    sources=("run",),
    summary=MapSummary,
    title="Map of a work area",
    stepped=True,
    filters={"robot_id": "robot", "name": "name (exact)"},
    examples=_EXAMPLES,
    files=(
        File(
            name="map.csv",
            operation="get_map_table",
            description="""Get all places as a table: status, place, posture, deflection, intervals,
compliance; units in headers.

The table is computed again from the map's run, which never changes: keep the run as long as the map.""",
            content="One row per place (RFC 4180).",
            media_type="text/csv",
            sheet=_places_sheet,
            made_of="work",
        ),
        File(
            name="map.npz",
            operation="get_map_arrays",
            description="Get all places as numpy's npz, with all digits.",
            content="Arrays `headers`, `table`, `status` and `overall verdict`.",
            media_type="application/octet-stream",
            sheet=_places_sheet,
            made_of="work",
        ),
        File(
            name="map.json",
            operation="get_map_columns",
            description="Get the table as JSON, column by column, with units.",
            content="`columns`, each with `name`, `unit` and `values`.",
            media_type="application/json",
            sheet=_places_sheet,
            made_of="work",
        ),
    ),
    description="""Map a work area: deflection of the tool at each place, by the model of a run.

The posture at each place is the stiffest, or the nearest to a given one, of all branches of the inverse
kinematics and all orientations of the tool within the joint limits. Its deflection is the exact balance of
springs and load, with both intervals. The answer is a summary; `map.csv` and `map.npz` have all places.
201 with the finished map, or 202 if it takes longer than `wait` seconds.""",
)
