"""The catalogue: nominal arms to begin with, and presets of joint maps."""

from __future__ import annotations

from fastapi import APIRouter

from jointstiff.schemas.catalogue import Catalogue
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.parts import problems
from jointstiff.service.resources.nominal_arms import catalogue

router = APIRouter(prefix="/v1/catalogue", tags=["robots"], route_class=AccessRoute)


@router.get("", dependencies=[VIEWER], response_model=Catalogue, responses=problems())
def get_catalogue() -> Catalogue:
    """Get the nominal arms, each with the source of its figures, and the presets of joint maps.

    Post `{"format": "catalogue", "arm": "NAME"}` as the model of a robot to begin with one. Nominal figures
    differ from those of a real arm; a geometry finds the latter.
    """
    return catalogue()
