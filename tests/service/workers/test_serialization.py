"""The engine keeps JSON, and runs no pickle that someone else wrote into its tables."""

from __future__ import annotations

import base64
import json
import pickle
from contextlib import closing

import pytest
from dbos._serialization import deserialize_args, deserialize_exception, deserialize_value
from sqlalchemy import MetaData, create_engine, select, update
from support.jobs import request, stored_set
from support.processes import until, working

from jointstiff.service.jobs import Parts
from jointstiff.service.problems import VerdictError, problem_of
from jointstiff.service.programs.errors import Fault, ProgramError
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import (
    EngineDataError,
    JobQueue,
    JsonSerializer,
    engine_url,
    refuse_pickles,
    schema_of,
)
from jointstiff.solver.errors import MeasurementError


class Planted:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")

    def text(self):
        return base64.b64encode(pickle.dumps(self)).decode()


@pytest.mark.parametrize("serialization", ["py_pickle", None])
@pytest.mark.parametrize("read", [deserialize_value, deserialize_args, deserialize_exception])
def test_a_pickle_is_not_read_however_its_row_is_marked(tmp_path, serialization, read):
    refuse_pickles()
    with pytest.raises((EngineDataError, json.JSONDecodeError)):
        read(Planted(tmp_path / "ran").text(), serialization, JsonSerializer())
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("value", [None, "text", [[[0, 5], [5, 9]]], {"args": ["run", "1"], "kwargs": {}}])
def test_values_come_back(value):
    serializer = JsonSerializer()
    assert serializer.deserialize(serializer.serialize(value)) == value


def test_a_refusal_comes_back_as_what_it_was_and_anything_else_as_its_words():
    serializer = JsonSerializer()
    refusal = serializer.deserialize(serializer.serialize(MeasurementError("odd", remedy="mend", where="a")))
    assert isinstance(refusal, MeasurementError)
    assert (refusal.reason, refusal.remedy, refusal.where) == ("odd", "mend", "a")
    other = serializer.deserialize(serializer.serialize(KeyError("x")))
    assert isinstance(other, EngineDataError)
    assert "KeyError: 'x'" in str(other)


@pytest.mark.process
@pytest.mark.usefixtures("postgresql_url")
def test_a_pickle_planted_in_the_database_is_not_run_and_its_job_ends(either_database_url, tmp_path):
    with Store.open(either_database_url) as store, closing(JobQueue(store, either_database_url)) as queue:
        runs = Parts(store, queue.enqueue).jobs["run"]
        stored = stored_set(store)
        planted, other = (runs.create(request(stored), None) for _ in range(2))
        engine = create_engine(engine_url(either_database_url).replace("postgresql:", "postgresql+psycopg:"))
        tables = MetaData(schema=schema_of(store) if either_database_url.startswith("postgresql") else None)
        tables.reflect(engine, only=["workflow_status"])
        (workflows,) = tables.tables.values()
        mine = workflows.c.workflow_uuid == planted.id
        pickled = Planted(tmp_path / "ran").text()
        with engine.begin() as connection:
            names = {row.serialization for row in connection.execute(select(workflows.c.serialization))}
            connection.execute(
                update(workflows).where(mine).values(inputs=pickled, serialization="py_pickle")
            )
        engine.dispose()
        assert names == {"jointstiff_json"}
        with working(either_database_url, "worker"):
            until(lambda: not runs.records.status(planted.id).goes_on, seconds=60)
            until(lambda: not runs.records.status(other.id).goes_on, seconds=60)
        assert runs.records.status(planted.id).state == "failed"
        assert runs.records.status(other.id).state == "succeeded"
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "error",
    [
        ProgramError([Fault("a.src", 3, "not reached", "move it"), Fault("a.src", 5, "nor this", "move it")]),
        VerdictError.of("the run", "run_id", [("joint_1", "capped", "load it"), ("all", "odd", "read")]),
    ],
)
def test_faults_come_back_one_by_one(error):
    serializer = JsonSerializer()
    assert problem_of(serializer.deserialize(serializer.serialize(error))) == problem_of(error)
