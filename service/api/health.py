"""Health of the service, and the index of its addresses."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from jointstiff.schemas.health import Health
from jointstiff.service.api.access import PUBLIC, VIEWER, AccessRoute
from jointstiff.service.api.parts import problems
from jointstiff.service.api.watch import Seen, Watch
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.versions import JOINTSTIFF_VERSION

router = APIRouter(tags=["health"], route_class=AccessRoute)


@router.get("/health", dependencies=[VIEWER], response_model=Health, responses=problems())
async def get_health(request: Request) -> Health:
    """Return the version of the service, its database and the number of its workers, as last looked at."""
    watch: Watch = request.app.state.watch
    return _health(request, await watch.latest())


@router.get("/ready", dependencies=[VIEWER], response_model=Health, responses=problems())
async def get_ready(request: Request) -> Health:
    """Return the same as /health: 503 while the database cannot be written, as work would be lost."""
    watch: Watch = request.app.state.watch
    return _health(request, await watch.writable())


@router.get("/live", dependencies=[PUBLIC], status_code=204, response_class=Response)
async def get_live() -> Response:
    """Return nothing: the process answers, whatever its database does."""
    return Response(status_code=204)


def _health(request: Request, seen: Seen) -> Health:
    # No thread and no database while the service runs: it is answered however much others ask for.
    return Health(
        status="ok",
        version=JOINTSTIFF_VERSION,
        workers=seen.workers,
        failing_workers=request.app.state.failing_workers(),
        database=seen.database,
        stored_bytes=seen.stored_bytes,
        quota_bytes=request.app.state.watch.quota_bytes,
        access=request.app.state.access,
    )


@router.get("/v1", dependencies=[VIEWER], include_in_schema=False)
def get_index() -> dict[str, str]:
    """Return the addresses of the API; the page for people is at /."""
    return {
        "name": "Jointstiff",
        "version": JOINTSTIFF_VERSION,
        "description": "/openapi.json",
        "health": "/health",
        "robots": "/v1/robots",
        "measurement_sets": "/v1/measurement-sets",
        **{kind.collection: f"/v1/{kind.collection}" for kind in KINDS},
        "deflections": "/v1/deflections",
        "imports": "/v1/imports",
        "kinematics": "/v1/kinematics",
        "catalogue": "/v1/catalogue",
        "session": "/v1/session",
        "keys": "/v1/keys",
        "audit": "/v1/audit",
    }
