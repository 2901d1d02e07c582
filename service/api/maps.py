"""The places of a map, for spreadsheets and for numpy."""

from __future__ import annotations

from typing import Any, Final

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Request, Response

from jointstiff.schemas.map import Map
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.bodies import large_bodies
from jointstiff.service.api.jobs import JobId
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.jobs.life import Jobs
from jointstiff.service.kinds.map.work import MapWork

_CSV: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "One row a place (RFC 4180).", "content": {"text/csv": {}}}
}
_NPZ: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Arrays `headers`, `table` and `status`.",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}

router = APIRouter(prefix="/v1/maps", tags=["maps"], route_class=AccessRoute)


@router.get(
    "/{map_id}/map.csv",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_CSV | problems(404, 409, 422),
)
async def get_map_table(request: Request, parts: PartsOf, map_id: JobId) -> Response:
    """Get all places as a table: status, place, posture, deflection, intervals, compliance; units in headers.

    The table is computed again from the map's run, which never changes: keep the run as long as the map.
    """
    jobs = parts.jobs[Map.kind]
    # Large maps take seconds: they wait for their turn, and leave the other requests theirs.
    text = await run_sync(lambda: _finished(jobs, map_id).csv(), limiter=large_bodies(request))
    return Response(text, media_type="text/csv", headers=_attached(map_id, "csv"))


@router.get(
    "/{map_id}/map.npz",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_NPZ | problems(404, 409, 422),
)
async def get_map_arrays(request: Request, parts: PartsOf, map_id: JobId) -> Response:
    """Get the same as numpy's npz, to the last digit."""
    jobs = parts.jobs[Map.kind]
    content = await run_sync(lambda: _finished(jobs, map_id).npz(), limiter=large_bodies(request))
    return Response(content, media_type="application/octet-stream", headers=_attached(map_id, "npz"))


def _finished(jobs: Jobs, map_id: str) -> MapWork:
    found = jobs.current(map_id)
    if found.result is None:
        raise HTTPException(409, f"the map has no places, because its state is {found.state}")
    work: MapWork = jobs.work(map_id)
    return work


def _attached(map_id: str, suffix: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="map-{map_id}.{suffix}"'}
