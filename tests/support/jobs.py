"""Runs on a store."""

import json

from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
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
