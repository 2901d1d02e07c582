"""Kinematics: where the joints of a robot are, for those who draw it."""

from __future__ import annotations

from fastapi import APIRouter

from jointstiff.schemas.kinematics import Kinematics, KinematicsRequest
from jointstiff.service.api.access import VIEWER
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.conversion.robots import to_kinematics

router = APIRouter(prefix="/v1/kinematics", tags=["robots"], route_class=BodyRoute)


@router.post(
    "",
    dependencies=[VIEWER],  # a drawing of what is stored, or might be
    response_model=Kinematics,
    responses=problems(400, 404, 413, 415, 422),
)
def compute_kinematics(
    parts: PartsOf,
    body: KinematicsRequest,
) -> Kinematics:
    """Compute where joints and flange are in some configurations. Nothing is stored.

    A robot that is not stored is vetted as one that is posted, so that it can be looked at before it is kept.
    """
    return to_kinematics(parts.robots.find(body.robot_id, body.robot), body.joints)
