"""Kinematics: where the joints of a robot are, for those who draw it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends

from jointstiff.schemas.kinematics import Kinematics, KinematicsRequest
from jointstiff.service.api.bodies import MAX_ROBOT_BYTES, Body, describe_body, read_body
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.conversion import to_kinematics

__all__ = ["router"]

router = APIRouter(prefix="/v1/kinematics", tags=["robots"])


@router.post(
    "",
    response_model=Kinematics,
    responses=problems(400, 404, 413, 415, 422),
    openapi_extra=describe_body(KinematicsRequest, {}),
)
def compute_kinematics(
    parts: PartsOf,
    body: Annotated[Body[KinematicsRequest], Depends(read_body(KinematicsRequest, MAX_ROBOT_BYTES))],
) -> Kinematics:
    """Where joints and flange are in some configurations. Nothing is stored.

    A robot that is not stored is vetted as one that is posted, so that it can be looked at before it is kept.
    """
    request = body.message
    return to_kinematics(parts.robots.find(request.robot_id, request.robot), request.joints)
