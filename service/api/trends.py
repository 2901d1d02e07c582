"""Trends: the stiffness of a robot's joints over its campaigns, and the fleet at a glance."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query

from jointstiff.schemas.trend import (
    Acknowledgement,
    AcknowledgementRequest,
    BaselineRequest,
    Fleet,
    Trend,
    TrendBaseline,
    TrendQuery,
)
from jointstiff.service.api.access import OPERATOR, VIEWER
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.jobs import AskedBy
from jointstiff.service.api.parts import PartsOf, problems

_RobotId = Annotated[str, Path(max_length=64)]

router = APIRouter(prefix="/v1", tags=["trends"], route_class=BodyRoute)


@router.get(
    "/robots/{robot_id}/trend", dependencies=[VIEWER], response_model=Trend, responses=problems(404, 422)
)
def get_trend(parts: PartsOf, robot_id: _RobotId, query: Annotated[TrendQuery, Query()]) -> Trend:
    """Get the trend of a robot: each joint's campaigns against its baseline, with alarms and their reasons.

    A campaign is a measurement set with its newest run of the same method, weighting, constraint, encoders
    and serial number; `left_out` names campaigns without such a run. The limits include the noise of the
    readings, the scatter between campaigns and the uncertainty of the baseline. A baseline needs three
    campaigns; with fewer there is only a test of two.
    """
    return parts.trends.trend(robot_id, query)


@router.post(
    "/robots/{robot_id}/trend/baselines",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=TrendBaseline,
    responses=problems(400, 404, 413, 415, 422, 507),
)
def create_trend_baseline(
    parts: PartsOf, robot_id: _RobotId, body: BaselineRequest, by: AskedBy
) -> TrendBaseline:
    """Begin a new baseline, as after a repair. It counts for all trends of the same serial number.

    Campaigns before it keep their charts. Of two baselines from the same campaign on, the later one counts.
    """
    return parts.trends.add_baseline(robot_id, body, by)


@router.post(
    "/robots/{robot_id}/trend/acknowledgements",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Acknowledgement,
    responses=problems(400, 404, 413, 415, 422, 507),
)
def acknowledge_alarm(
    parts: PartsOf, robot_id: _RobotId, body: AcknowledgementRequest, by: AskedBy
) -> Acknowledgement:
    """Acknowledge an alarm with a note. The alarm stays in the trend; its joint counts as seen."""
    return parts.trends.acknowledge(robot_id, body, by)


@router.get("/fleet", dependencies=[VIEWER], response_model=Fleet, responses=problems(422))
def get_fleet(parts: PartsOf) -> Fleet:
    """Get one row for each robot and serial number, with its worst joint; those in alarm first."""
    return parts.trends.fleet()
