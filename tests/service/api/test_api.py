"""The API as a client sees it: real process, real socket, both databases."""

import copy
import time
import uuid

import httpx2
import pytest
from support.api import EITHER_DATABASE, post

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.options import MAX_REPETITIONS
from jointstiff.service.kinds.registry import KINDS
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign(default_arm(), load="dead_weight", configurations=8, seed=11)


@pytest.fixture(scope="module")
def robot_id(service, campaign):
    with httpx2.Client(base_url=service.url, timeout=60.0) as session:
        return post(session, "/v1/robots", campaign["robot"])["id"]


@pytest.fixture
def readings(robot_id, campaign):
    """A measurement set to post."""
    return copy.deepcopy(campaign["measurement_set"]) | {"robot_id": robot_id}


@pytest.fixture
def set_id(client, readings):
    return post(client, "/v1/measurement-sets", readings)["id"]


def _edit(path, value):
    def change(document):
        *parents, last = path
        for key in parents:
            document = document[key]
        document[last] = value

    return change


class TestMeasurementSets:
    @pytest.mark.parametrize(
        ("change", "where", "reason"),
        [
            (_edit(["robot_id"], "nobody"), "robot_id", "no robot 'nobody'"),
            (_edit(["load_point"], None), "observations[0].load_point", "load point is missing"),
            (_edit(["observations", 0, "force", 0], 1e300), "observations[0].force[0]", "less than"),
            (_edit(["observations", 0, "force"], [1, 5, 0, 0]), "observations[0].force", "at most 3 items"),
        ],
    )
    def test_refused_with_place_and_remedy_and_nothing_stored(self, client, readings, change, where, reason):
        readings["name"] = f"refused {uuid.uuid4().hex}"
        change(readings)
        problem = Problem.model_validate(post(client, "/v1/measurement-sets", readings, 422))
        assert problem.where == where
        assert reason in problem.detail
        assert problem.remedy
        listed = client.get("/v1/measurement-sets", params={"name": readings["name"]}).json()
        assert listed["items"] == []

    def test_a_name_of_its_own_for_every_reading(self, client, readings):
        for i, observation in enumerate(readings["observations"]):
            for reading in observation["readings"]:
                reading["target"] += f" {i}"
        problem = post(client, "/v1/measurement-sets", readings, 422)
        assert "24 different targets, more than 16" in problem["detail"]

    def test_moment_in_millimetres_needs_its_unit(self, client, readings):
        readings["units"]["length"] = "mm"
        readings["observations"][0]["moment"] = [1.0, 0.0, 0.0]
        problem = post(client, "/v1/measurement-sets", readings, 422)
        assert problem["where"] == "units.moment"
        readings["units"]["moment"] = "N.m"
        post(client, "/v1/measurement-sets", readings)


class TestRuns:
    @pytest.mark.parametrize(
        ("request_", "where"),
        [
            ({"method": "best"}, "method"),
            ({"resampling": {"size": 9}}, "resampling.size"),
            ({"resampling": {"size": 5, "repetitions": MAX_REPETITIONS + 1}}, "resampling.repetitions"),
            ({"wait": 61}, "query.wait"),
        ],
    )
    def test_refused_with_the_place_and_nothing_stored(self, client, set_id, request_, where):
        wait = request_.get("wait", 1)
        body = {"measurement_set_id": set_id} | request_
        body.pop("wait", None)
        problem = post(client, f"/v1/runs?wait={wait}", body, 422)
        assert problem["where"] == where
        assert problem["remedy"]
        assert client.get("/v1/runs", params={"measurement_set_id": set_id}).json()["items"] == []


@EITHER_DATABASE
class TestIdempotency:
    @pytest.mark.parametrize("collection", ["robots", "measurement-sets"])
    def test_the_same_key_gives_one_resource(self, client, campaign, readings, collection):
        body, key = campaign["robot"], {"Idempotency-Key": uuid.uuid4().hex}
        if collection == "measurement-sets":
            body = readings
        first = post(client, f"/v1/{collection}", body, **key)
        assert post(client, f"/v1/{collection}", body, **key) == first
        problem = post(client, f"/v1/{collection}", body | {"name": "x"}, 422, **key)
        assert problem["type"].endswith("idempotency-conflict")


def test_health_counts_the_workers(client_of_workers):
    health = client_of_workers.get("/health").json()
    assert health["status"] == "ok"
    assert health["database"] in {"sqlite", "postgresql"}
    assert health["workers"] in {0, 1}
    deadline = time.monotonic() + 60  # the service's own is heard of when it has read its libraries
    while client_of_workers.get("/health").json()["workers"] == 0:
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_index(client):
    index = client.get("/v1").json()
    assert {kind.collection: index[kind.collection] for kind in KINDS} == {
        kind.collection: f"/v1/{kind.collection}" for kind in KINDS
    }
    assert client.get("/openapi.json").json()["info"]["title"] == "Jointstiff"
