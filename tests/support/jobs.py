"""Runs on a store, and records of jobs for tests of the store."""

import dataclasses
import json
from datetime import UTC, datetime
from typing import Any

from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import Resource
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import JobRecord, MeasurementSetRecord, RobotRecord
from jointstiff.simulator import default_arm, simulate_campaign


def runs_of(store, enqueue=None):
    return Parts(store, enqueue).jobs["run"]


def stored_set(store, **options):
    return set_of(
        Parts(store), simulate_campaign(default_arm(), load="pull", configurations=12, seed=1, **options)
    )


def set_of(parts, document):
    """Store robot and measurement set of a campaign; return the id of the set."""
    robot = parts.robots.create(RobotDocument.model_validate_json(json.dumps(document["robot"])), None)
    readings = document["measurement_set"] | {"robot_id": robot.id}
    return parts.sets.create(MeasurementSetRequest.model_validate_json(json.dumps(readings)), None).id


def run_request(set_id, **changes):
    resampling = {"size": 8, "repetitions": 300, "seed": 4}
    return RunRequest.model_validate({"measurement_set_id": set_id, "resampling": resampling} | changes)


RESOURCES = {kind.name: kind.resource for kind in KINDS}
RUN = RESOURCES["run"]
TIME = datetime(2026, 11, 20, 23, 59, 59, 999_999, tzinfo=UTC)


def job_record(kind: Resource = RUN, identifier: str = "u1", **changes: Any) -> JobRecord:
    """A job on the set s1 of the robot r1."""
    record = JobRecord(
        id=identifier,
        kind=kind.name,
        state="succeeded",
        created_at=TIME,
        summary={"method": "partial_pose", "positive": True},
        robot_id="r1",
        measurement_set_id="s1",
        method=None,
        weighting=None,
        elasticity=None,
        verdict=None,
        second_set_id=None,
        name=None,
        document="{}",
    )
    return dataclasses.replace(record, **changes)


def keeper(store: Store, record: Any) -> Any:
    """The collection of a record."""
    if isinstance(record, JobRecord):
        return store.jobs(RESOURCES[record.kind])
    return {RobotRecord: store.robots, MeasurementSetRecord: store.sets}[type(record)]
