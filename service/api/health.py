"""Health of the service, and the index of its addresses."""

from __future__ import annotations

from datetime import timedelta

from fastapi import APIRouter

from jointstiff.schemas.health import Health
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.jobs import KINDS
from jointstiff.service.store import SILENT_SECONDS
from jointstiff.service.versions import JOINTSTIFF_VERSION

router = APIRouter(tags=["health"])


@router.get("/health", response_model=Health, responses=problems())
def get_health(parts: PartsOf) -> Health:
    """Ask the database; return the version of the service and the number of its workers."""
    living = parts.store.heartbeats.living(timedelta(seconds=SILENT_SECONDS))
    return Health(status="ok", version=JOINTSTIFF_VERSION, workers=len(living), database=parts.store.ping())


@router.get("/v1", include_in_schema=False)
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
        "imports": "/v1/imports",
        "kinematics": "/v1/kinematics",
    }
