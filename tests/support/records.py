"""Records of jobs for tests of the store, and where a record belongs."""

import dataclasses
from datetime import UTC, datetime
from typing import Any

from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import Resource
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import JobRecord, MeasurementSetRecord, RobotRecord

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
        first_set_id=None,
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
