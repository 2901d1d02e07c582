"""Robots and their trends, measurement sets, the catalogue of nominal arms."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from jointstiff.schemas import trend
from jointstiff.schemas.fields import Page
from jointstiff.schemas.live import MeasurementSet, MeasurementSetPost
from jointstiff.schemas.measurement import MeasurementSetSummary, SetChange
from jointstiff.schemas.query import MAX_PAGE, RobotQuery, SetQuery
from jointstiff.schemas.robot import (
    Catalogue,
    KinematicsRequest,
    Posture,
    Robot,
    RobotChange,
    RobotDocument,
    RobotSummary,
)
from jointstiff.service.api import answers
from jointstiff.service.api.bodies import BodyRoute, Key, json_body
from jointstiff.service.api.description import describe_problems
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.jobs import RequesterKey
from jointstiff.service.conversion.catalogue import catalogue
from jointstiff.service.conversion.robots import to_postures
from jointstiff.service.problems import ClosedError
from jointstiff.service.resources.stored import robot_from_record, set_from_record
from jointstiff.service.security.access import OPERATOR, VIEWER
from jointstiff.solver.errors import RequestError

RobotId = Annotated[str, Path(max_length=64, description="Id of the robot.")]
SetId = Annotated[str, Path(max_length=64, description="Id of the set.")]

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
    parts: answers.InjectedParts, body: Annotated[RobotDocument, json_body(EXAMPLES["robots"])], key: Key
) -> Response:
    """Store a robot.

    Unsupported parts (mimic joints, unexpanded xacro, axes that are no unit vectors, …) are refused with
    their place. Only the chain of joints from `base` to `flange` is kept; meshes are never opened.
    """
    record = parts.robots.create(body, key)
    return answers.answer_created("robots", record.id, robot_from_record(record).model_dump_json())


@robots.get("/v1/robots", dependencies=[VIEWER], response_model=Page[RobotSummary])
def list_robots(parts: answers.InjectedParts, query: Annotated[RobotQuery, Query()]) -> Page[RobotSummary]:
    """List robots, with the last campaign of each."""
    if query.sort == "worst":  # the order is that of the summaries
        parts.trends.renew_outdated_summaries(MAX_PAGE)
    page = parts.store.robots.page(**query.listing_arguments())
    items = []
    for entry in page.records:
        summary = parts.trends.summarise(entry)
        robot = RobotSummary(
            id=entry.id,
            name=entry.name,
            content_hash=entry.content_hash,
            created_at=entry.created_at,
            last_campaign=summary.last,
            arms=summary.arms,
            **entry.summary,
        )
        items.append(robot)
    return Page(items=items, next=page.next, total=page.total)


@robots.get(
    "/v1/robots/{robot_id}",
    dependencies=[VIEWER],
    response_model=Robot,
    responses=answers.NOT_MODIFIED,
)
def get_robot(request: Request, parts: answers.InjectedParts, robot_id: RobotId) -> Response:
    """Get a robot, with its kinematics and its last campaign."""
    robot = robot_from_record(parts.store.robots.get(robot_id))
    summary = parts.trends.summarise(parts.store.robots.entry(robot_id))
    derived = {"last_campaign": summary.last, "arms": summary.arms}
    return answers.answer_with_etag(request, robot.model_copy(update=derived).model_dump_json())


@robots.patch("/v1/robots/{robot_id}", dependencies=[OPERATOR], response_model=Robot)
def change_robot(
    parts: answers.InjectedParts,
    robot_id: RobotId,
    body: Annotated[RobotChange, json_body(EXAMPLES["robot_changes"])],
) -> Response:
    """Change a robot's name, payload, marks or references, delete it, or restore it.

    A robot that a measurement set or a job refers to cannot be deleted; a deleted robot can be restored for
    30 days.
    """
    return answers.json_response(robot_from_record(parts.robots.change(robot_id, body)).model_dump_json())


@robots.get("/v1/catalogue", dependencies=[VIEWER], response_model=Catalogue)
def get_catalogue() -> Catalogue:
    """Get the nominal arms, each with the source of its figures, and the presets of joint maps.

    Post `{"format": "catalogue", "arm": "NAME"}` as the model of a robot to begin with one. A real arm
    differs from the nominal figures; a geometry finds its figures.
    """
    return catalogue()


@robots.post(
    "/v1/kinematics",
    dependencies=[VIEWER],  # a viewer may draw any robot, as nothing is stored
    response_model=list[Posture],
    responses=describe_problems(404),
)
def compute_kinematics(
    parts: answers.InjectedParts,
    body: KinematicsRequest,
) -> list[Posture]:
    """Compute where joints and flange are in some configurations. Nothing is stored.

    A robot in the request is checked like one that is posted to be stored.
    """
    return to_postures(parts.robots.find(body.robot_id, body.robot), body.joints)


@sets.post(
    "/v1/measurement-sets",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=MeasurementSet,
    responses=answers.LOCATION,
)
def create_measurement_set(
    parts: answers.InjectedParts,
    body: Annotated[MeasurementSetPost, json_body(EXAMPLES["measurement_sets"])],
    key: Key,
) -> Response:
    """Store a measurement set.

    Impossible readings are refused. Suspicious readings are stored with a warning, which every run of the
    set shows.
    With `open`, the set is measured live.
    """
    if body.open is not None:
        set_id = parts.live.create(body, body.open, key)
        return answers.answer_created(
            "measurement-sets", set_id, parts.live.document(set_id).model_dump_json()
        )
    if not body.observations:
        raise RequestError(
            "must have at least 1 item",
            where="observations",
            remedy="give `observations`; or give `open`, if the readings are still to be measured",
        )
    record = parts.sets.create(body, key)
    return answers.answer_created("measurement-sets", record.id, set_from_record(record).model_dump_json())


@sets.get("/v1/measurement-sets", dependencies=[VIEWER], response_model=Page[MeasurementSetSummary])
def list_measurement_sets(
    parts: answers.InjectedParts, query: Annotated[SetQuery, Query()]
) -> Page[MeasurementSetSummary]:
    """List measurement sets without their observations; or only open sets."""
    if query.open:
        return parts.live.page(query)
    page = parts.store.sets.page(**query.model_copy(update={"open": None}).listing_arguments())
    items = [MeasurementSetSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next, total=page.total)


@sets.get(
    "/v1/measurement-sets/{set_id}",
    dependencies=[VIEWER],
    response_model=MeasurementSet,
    responses=answers.NOT_MODIFIED,
)
def get_measurement_set(request: Request, parts: answers.InjectedParts, set_id: SetId) -> Response:
    """Get a measurement set as it was posted, with its findings; an open set with its readings so far."""
    document = parts.live.document(set_id) if parts.live.is_open(set_id) else parts.sets.document(set_id)
    return answers.answer_with_etag(request, document.model_dump_json())


@sets.patch("/v1/measurement-sets/{set_id}", dependencies=[OPERATOR], response_model=MeasurementSetSummary)
def change_measurement_set(
    parts: answers.InjectedParts,
    set_id: SetId,
    body: Annotated[SetChange, json_body(EXAMPLES["set_changes"])],
    by: RequesterKey,
) -> MeasurementSetSummary:
    """Change name and metadata of a measurement set, delete it, or restore it.

    Omitted fields stay as they are; null removes a field. Readings, hash and runs stay unchanged. A set that
    a job refers to cannot be deleted; a deleted set can be restored for 30 days. Of an open set, readings are
    withdrawn or kept, and postures skipped.
    """
    if parts.live.is_open(set_id):
        return parts.live.apply_change(set_id, body, by)
    if body.is_live:
        raise ClosedError(set_id)
    changes = body.model_dump(exclude={"withdrawn", "kept", "skipped"}, exclude_unset=True)
    record = parts.sets.change(set_id, SetChange.model_validate(changes))
    return MeasurementSetSummary.model_validate(record, from_attributes=True)


@trends.get("/v1/robots/{robot_id}/trend", dependencies=[VIEWER], response_model=trend.Trend)
def get_trend(
    parts: answers.InjectedParts, robot_id: RobotId, query: Annotated[trend.TrendQuery, Query()]
) -> trend.Trend:
    """Get the trend of a robot: each joint over its campaigns, and whether it changed since the first."""
    return parts.trend(robot_id, query)
