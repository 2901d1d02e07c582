"""The engine's tables, real ones: what has ended is removed."""

from __future__ import annotations

import time
from contextlib import closing
from datetime import timedelta

import pytest
from sqlalchemy import MetaData, create_engine, func, select
from support.processes import until, working

from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import JobQueue, engine_url, schema_of
from jointstiff.simulator import default_arm, simulate_campaign


def rows_of(store, database):
    """Rows in the engine's tables of workflows and of their steps."""
    engine = create_engine(engine_url(database).replace("postgresql:", "postgresql+psycopg:"))
    schema = schema_of(store) if database.startswith("postgresql") else None
    tables = MetaData(schema=schema)
    names = ["workflow_status", "operation_outputs"]
    with engine.connect() as connection:
        tables.reflect(connection, only=names)
        counted = [tables.tables[f"{schema}.{name}" if schema else name] for name in names]
        found = tuple(
            connection.execute(select(func.count()).select_from(table)).scalar_one() for table in counted
        )
    engine.dispose()
    return found


@pytest.mark.process
@pytest.mark.usefixtures("postgresql_url")
def test_a_run_ends_and_its_steps_are_removed_later(either_database_url):
    document = simulate_campaign(default_arm(), load="pull", configurations=40, seed=1)
    with Store.open(either_database_url) as store, closing(JobQueue(store, either_database_url)) as queue:
        parts = Parts(store, queue.enqueue)
        robot = parts.robots.create(RobotDocument.model_validate(document["robot"]), None)
        readings = document["measurement_set"] | {"robot_id": robot.id}
        stored = parts.sets.create(MeasurementSetRequest.model_validate(readings), None)
        body = {"measurement_set_id": stored.id, "resampling": {"size": 10, "repetitions": 40_000}}
        run = parts.jobs["run"].create(RunRequest.model_validate(body), None)

        with working(either_database_url, "worker"):
            until(lambda: not parts.jobs["run"].records.status(run.id).goes_on, seconds=60)
            until(lambda: queue.statuses([run.id])[run.id] == "SUCCESS")
            assert parts.jobs["run"].current(run.id).state == "succeeded"
            assert parts.jobs["run"].records.status(run.id).done == 40_000
            workflows, steps = rows_of(store, either_database_url)
            assert workflows > 1
            assert steps > workflows

            assert queue.forget_ended(timedelta(hours=1), 20) == []
            time.sleep(0.01)
            before = parts.jobs["run"].document(run.id)
            assert queue.forget_ended(timedelta(0), 20) == [run.id]
            assert rows_of(store, either_database_url) == (0, 0)
            assert queue.forget_ended(timedelta(0), 20) == []
            assert parts.jobs["run"].document(run.id) == before
