"""Runs on a store, and an engine that is a queue."""

from __future__ import annotations

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


def request(set_id, **changes):
    resampling = {"size": 8, "repetitions": 300, "seed": 4}
    return RunRequest.model_validate({"measurement_set_id": set_id, "resampling": resampling} | changes)


class QueueEngine:
    """An engine that is a queue: what is pending, with whom, and what became of jobs."""

    def __init__(self):
        self.queue = self
        self.active = []
        self.inherited = {}
        self.taken = {}
        self.ended = {}
        self.resumed = []
        self.forgotten = []
        self.shared_out = set()

    def has_parts(self, job_id):
        return job_id in self.shared_out

    def pending(self):
        return dict(self.taken)

    def resume(self, workflows):
        for name, kind in workflows:
            self.resumed.append((name, kind))
            self.taken.pop(name)

    def statuses(self, job_ids):
        return {name: status for name, status in self.ended.items() if name in job_ids}

    def forget_ended(self, _age, limit):
        return self.forgotten[:limit]
