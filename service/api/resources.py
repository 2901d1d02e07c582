"""Robots and their trends, measurement sets, the catalogue of nominal arms."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from jointstiff.schemas import trend
from jointstiff.schemas.fields import Page
from jointstiff.schemas.measurement import (
    MeasurementSet,
    MeasurementSetRequest,
    MeasurementSetSummary,
    SetChange,
)
from jointstiff.schemas.query import RobotQuery, SetQuery
from jointstiff.schemas.robot import (
    Catalogue,
    Kinematics,
    KinematicsRequest,
    Robot,
    RobotChange,
    RobotRequest,
    RobotSummary,
)
from jointstiff.service.api import answers
from jointstiff.service.api.bodies import EXAMPLES, BodyRoute, Key, shown
from jointstiff.service.api.jobs import AskedBy
from jointstiff.service.conversion.robots import to_kinematics
from jointstiff.service.resources.catalogue import catalogue
from jointstiff.service.resources.stored import assembled, described
from jointstiff.service.security.access import OPERATOR, VIEWER

Id = Annotated[str, Path(max_length=64)]

robots = APIRouter(tags=["robots"], route_class=BodyRoute)
sets = APIRouter(tags=["measurement sets"], route_class=BodyRoute)
trends = APIRouter(tags=["trends"], route_class=BodyRoute)


@robots.post(
    "/v1/robots",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Robot,
    responses=answers.LOCATION,
)
def create_robot(
    parts: answers.PartsOf, body: Annotated[RobotRequest, shown(EXAMPLES["robots"])], key: Key
) -> Response:
    """Store a robot.

    The description is vetted: anything that a kinematics library would silently misread (mimic joints,
    unexpanded xacro, axes that are no unit vectors, …) is refused with its place. Only the chain of
    revolute joints from `base` to `flange` is kept; meshes are never opened. Of a geometry the robot keeps
    the identified model, and the geometry's id.
    """
    record = parts.robots.create(body, key)
    return answers.created("robots", record.id, described(record).model_dump_json())


@robots.get("/v1/robots", dependencies=[VIEWER], response_model=Page[RobotSummary])
def list_robots(parts: answers.PartsOf, query: Annotated[RobotQuery, Query()]) -> Page[RobotSummary]:
    """List robots, newest first."""
    page = parts.store.robots.page(**query.listing())
    alarms = parts.trends.alarms([record.id for record in page.records])
    items = [
        RobotSummary.model_validate(
            described(record).model_copy(update={"alarms": alarms.get(record.id, [])}), from_attributes=True
        )
        for record in page.records
    ]
    return Page(items=items, next=page.next)


@robots.get(
    "/v1/robots/{robot_id}",
    dependencies=[VIEWER],
    response_model=Robot,
    responses=answers.NOT_MODIFIED,
)
def get_robot(request: Request, parts: answers.PartsOf, robot_id: Id) -> Response:
    """Get a robot, with its kinematics as they were understood, and the alarms of its trend."""
    robot = described(parts.store.robots.get(robot_id))
    alarms = parts.trends.alarms([robot_id]).get(robot_id, [])
    return answers.unchanging(request, robot.model_copy(update={"alarms": alarms}).model_dump_json())


@robots.patch("/v1/robots/{robot_id}", dependencies=[OPERATOR], response_model=Robot)
def change_robot(
    parts: answers.PartsOf,
    robot_id: Id,
    body: Annotated[RobotChange, shown(EXAMPLES["robot_changes"])],
) -> Response:
    """Change a robot's name, archive it, delete it, or restore it.

    Listings leave an archived robot out, and everything else stays. A robot that a measurement set or a job
    refers to cannot be deleted; a deleted one can be restored for 30 days.
    """
    return answers.json_response(described(parts.robots.change(robot_id, body)).model_dump_json())


@robots.delete("/v1/robots/{robot_id}", dependencies=[OPERATOR], **answers.DELETES)
def delete_robot(parts: answers.PartsOf, robot_id: Id) -> Response:
    """Delete a robot that no measurement set and no job refers to. It can be restored for 30 days."""
    parts.robots.delete(robot_id)
    return Response(status_code=204)


@robots.get("/v1/catalogue", dependencies=[VIEWER], response_model=Catalogue)
def get_catalogue() -> Catalogue:
    """Get the nominal arms, each with the source of its figures, and the presets of joint maps.

    Post `{"format": "catalogue", "arm": "NAME"}` as the model of a robot to begin with one. Nominal figures
    differ from those of a real arm; a geometry finds the latter.
    """
    return catalogue()


@robots.post(
    "/v1/kinematics",
    dependencies=[VIEWER],  # a drawing of what is stored, or might be
    response_model=Kinematics,
    responses=answers.problems(404),
)
def compute_kinematics(
    parts: answers.PartsOf,
    body: KinematicsRequest,
) -> Kinematics:
    """Compute where joints and flange are in some configurations. Nothing is stored.

    A robot that is not stored is vetted as one that is posted, so that it can be looked at before it is kept.
    """
    return to_kinematics(parts.robots.find(body.robot_id, body.robot), body.joints)


@sets.post(
    "/v1/measurement-sets",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=MeasurementSet,
    responses=answers.LOCATION,
)
def create_measurement_set(
    parts: answers.PartsOf,
    body: Annotated[MeasurementSetRequest, shown(EXAMPLES["measurement_sets"])],
    key: Key,
) -> Response:
    """Store a measurement set.

    What cannot be right is refused with its place and the remedy, and nothing is stored. What is
    suspicious (targets that did not move as one body, deflection against the force, angles that look
    like the other unit, …) is stored with a warning, which every run of the set shows.
    """
    record = parts.sets.create(body, key)
    return answers.created("measurement-sets", record.id, assembled(record).model_dump_json())


@sets.get("/v1/measurement-sets", dependencies=[VIEWER], response_model=Page[MeasurementSetSummary])
def list_measurement_sets(
    parts: answers.PartsOf, query: Annotated[SetQuery, Query()]
) -> Page[MeasurementSetSummary]:
    """List measurement sets without their observations, newest first."""
    page = parts.store.sets.page(**query.listing())
    items = [MeasurementSetSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@sets.get(
    "/v1/measurement-sets/{set_id}",
    dependencies=[VIEWER],
    response_model=MeasurementSet,
    responses=answers.NOT_MODIFIED,
)
def get_measurement_set(request: Request, parts: answers.PartsOf, set_id: Id) -> Response:
    """Get a measurement set as it was posted, with what was noticed."""
    return answers.unchanging(request, parts.sets.document(set_id).model_dump_json())


@sets.patch("/v1/measurement-sets/{set_id}", dependencies=[OPERATOR], response_model=MeasurementSetSummary)
def change_measurement_set(
    parts: answers.PartsOf,
    set_id: Id,
    body: Annotated[SetChange, shown(EXAMPLES["set_changes"])],
) -> MeasurementSetSummary:
    """Change name and metadata of a measurement set, archive it, delete it, or restore it.

    Fields that are left out stay; null removes one. Readings, hash and runs stay as they are, whatever
    changes. Listings leave an archived set out. A set that a job refers to cannot be deleted; a deleted one
    can be restored for 30 days.
    """
    return MeasurementSetSummary.model_validate(parts.sets.change(set_id, body), from_attributes=True)


@sets.delete("/v1/measurement-sets/{set_id}", dependencies=[OPERATOR], **answers.DELETES)
def delete_measurement_set(parts: answers.PartsOf, set_id: Id) -> Response:
    """Delete a measurement set that no job refers to. It can be restored for 30 days."""
    parts.sets.delete(set_id)
    return Response(status_code=204)


@trends.get("/v1/robots/{robot_id}/trend", dependencies=[VIEWER], response_model=trend.Trend)
def get_trend(
    parts: answers.PartsOf, robot_id: Id, query: Annotated[trend.TrendQuery, Query()]
) -> trend.Trend:
    """Get the trend of a robot: each joint's campaigns against its baseline, with alarms and their reasons.

    A campaign is a measurement set with its newest run of the same method, weighting, constraint, encoders
    and serial number; `left_out` names campaigns without such a run. The limits include the noise of the
    readings, the scatter between campaigns and the uncertainty of the baseline. A baseline needs three
    campaigns; with fewer there is only a test of two.
    """
    return parts.trends.trend(robot_id, query)


@trends.post(
    "/v1/robots/{robot_id}/trend/baselines",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=trend.TrendBaseline,
)
def create_trend_baseline(
    parts: answers.PartsOf, robot_id: Id, body: trend.BaselineRequest, by: AskedBy
) -> trend.TrendBaseline:
    """Begin a new baseline, as after a repair. It counts for all trends of the same serial number.

    Campaigns before it keep their charts. Of two baselines from the same campaign on, the later one counts.
    """
    return parts.trends.add_baseline(robot_id, body, by)


@trends.post(
    "/v1/robots/{robot_id}/trend/acknowledgements",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=trend.Acknowledgement,
)
def acknowledge_alarm(
    parts: answers.PartsOf, robot_id: Id, body: trend.AcknowledgementRequest, by: AskedBy
) -> trend.Acknowledgement:
    """Acknowledge an alarm with a note. The alarm stays in the trend; its joint counts as seen."""
    return parts.trends.acknowledge(robot_id, body, by)


@trends.get("/v1/fleet", dependencies=[VIEWER], response_model=trend.Fleet)
def get_fleet(parts: answers.PartsOf) -> trend.Fleet:
    """Get one row for each robot and serial number, with its worst joint; those in alarm first."""
    return parts.trends.fleet()
