"""Robots: kinematics from URDF or DH tables, or as a geometry found them; the catalogue of nominal arms."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from jointstiff.schemas.fields import Page
from jointstiff.schemas.kinematics import Kinematics, KinematicsRequest
from jointstiff.schemas.query import RobotQuery
from jointstiff.schemas.robot import Catalogue, Robot, RobotChange, RobotRequest, RobotSummary
from jointstiff.service.api.access import OPERATOR, VIEWER
from jointstiff.service.api.bodies import BodyRoute, Key
from jointstiff.service.api.examples import ROBOT_CHANGES, ROBOTS, shown
from jointstiff.service.api.parts import LOCATION, PartsOf, add_deletion, created, json_response, problems
from jointstiff.service.conversion.robots import to_kinematics
from jointstiff.service.resources.robots import catalogue, described

router = APIRouter(prefix="/v1", tags=["robots"], route_class=BodyRoute)


@router.post(
    "/robots",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Robot,
    responses=LOCATION | problems(400, 413, 415, 422, 507),
)
def create_robot(parts: PartsOf, body: Annotated[RobotRequest, shown(ROBOTS)], key: Key) -> Response:
    """Store a robot.

    The description is vetted: anything that a kinematics library would silently misread (mimic joints,
    unexpanded xacro, axes that are no unit vectors, …) is refused with its place. Only the chain of
    revolute joints from `base` to `flange` is kept; meshes are never opened. Of a geometry the robot keeps
    the identified model, and the geometry's id.
    """
    record = parts.robots.create(body, key)
    return created("robots", record.id, described(record).model_dump_json())


@router.get("/robots", dependencies=[VIEWER], response_model=Page[RobotSummary], responses=problems(422))
def list_robots(parts: PartsOf, query: Annotated[RobotQuery, Query()]) -> Page[RobotSummary]:
    """List robots, newest first."""
    page = parts.store.robots.page(
        limit=query.limit,
        cursor=query.cursor,
        filters=query.filters(),
        deleted=query.deleted,
        archived=query.archived,
    )
    alarms = parts.trends.alarms([record.id for record in page.records])
    items = [
        RobotSummary.model_validate(
            described(record).model_copy(update={"alarms": alarms.get(record.id, [])}), from_attributes=True
        )
        for record in page.records
    ]
    return Page(items=items, next=page.next)


@router.get("/robots/{robot_id}", dependencies=[VIEWER], response_model=Robot, responses=problems(404, 422))
def get_robot(parts: PartsOf, robot_id: Annotated[str, Path(max_length=64)]) -> Response:
    """Get a robot, with its kinematics as they were understood, and the alarms of its trend."""
    robot = described(parts.store.robots.get(robot_id))
    alarms = parts.trends.alarms([robot_id]).get(robot_id, [])
    return json_response(robot.model_copy(update={"alarms": alarms}).model_dump_json())


@router.patch(
    "/robots/{robot_id}",
    dependencies=[OPERATOR],
    response_model=Robot,
    responses=problems(400, 404, 413, 415, 422),
)
def change_robot(
    parts: PartsOf,
    robot_id: Annotated[str, Path(max_length=64)],
    body: Annotated[RobotChange, shown(ROBOT_CHANGES)],
) -> Response:
    """Change a robot's name, or archive it: listings leave it out, and everything else stays."""
    return json_response(parts.robots.change(robot_id, body).model_dump_json())


add_deletion(
    router,
    "/robots/{robot_id}",
    "robot",
    Robot,
    delete=lambda parts, robot_id: parts.robots.delete(robot_id),
    restore=lambda parts, robot_id: parts.robots.restore(robot_id).model_dump_json(),
    description="Delete a robot that no measurement set and no job refers to. "
    "It can be restored for 30 days.",
)


@router.get("/catalogue", dependencies=[VIEWER], response_model=Catalogue, responses=problems())
def get_catalogue() -> Catalogue:
    """Get the nominal arms, each with the source of its figures, and the presets of joint maps.

    Post `{"format": "catalogue", "arm": "NAME"}` as the model of a robot to begin with one. Nominal figures
    differ from those of a real arm; a geometry finds the latter.
    """
    return catalogue()


@router.post(
    "/kinematics",
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
