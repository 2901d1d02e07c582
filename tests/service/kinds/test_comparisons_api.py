"""Comparisons over HTTP, on a running service with each database."""

from __future__ import annotations

import uuid

import pytest

from jointstiff.schemas.comparison import Comparison
from jointstiff.schemas.finding import Problem
from jointstiff.simulator import default_arm, simulate_campaign


def post(client, path, body, expected=201, **headers):
    answer = client.post(path, json=body, headers=headers)
    assert answer.status_code == expected, answer.text
    return answer


@pytest.fixture
def run_ids(client):
    """Two runs of one set."""
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=8, seed=1)
    robot = post(client, "/v1/robots", campaign["robot"]).json()
    readings = campaign["measurement_set"] | {"robot_id": robot["id"]}
    set_id = post(client, "/v1/measurement-sets", readings).json()["id"]
    bodies = [{"measurement_set_id": set_id, "positive": each} for each in (True, False)]
    return [post(client, "/v1/runs", body).json()["id"] for body in bodies]


def test_a_comparison_is_answered_finished_listed_and_made_once(client, run_ids):
    body, key = {"run_ids": run_ids}, {"Idempotency-Key": uuid.uuid4().hex}
    answer = post(client, "/v1/comparisons", body, **key)
    found = Comparison.model_validate_json(answer.content)
    assert (found.state, found.progress, len(found.result.entries)) == ("succeeded", None, 2)
    assert answer.headers["location"] == f"/v1/comparisons/{found.id}"
    assert client.get(answer.headers["location"]).content == answer.content
    assert post(client, "/v1/comparisons", body, **key).content == answer.content
    problem = post(client, "/v1/comparisons", body | {"confidence": 0.9}, 422, **key).json()
    assert problem["type"].endswith("idempotency-conflict")
    listed = client.get("/v1/comparisons", params={"first_set_id": found.first_set_id}).json()["items"]
    assert [(item["id"], item["second_set_id"]) for item in listed] == [(found.id, None)]
    assert client.get("/v1/comparisons", params={"method": "partial_pose"}).status_code == 422


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"run_ids": ["one"]}, "run_ids"),
        ({"run_ids": ["one", "one"]}, "run_ids"),
        ({"run_ids": ["one", "nobody"]}, "run_ids[0]"),
        ({"confidence": 2.0}, "confidence"),
        ({"measurement_set_id": "x"}, "measurement_set_id"),
    ],
)
def test_refused_with_the_place(client, run_ids, change, where):
    answer = post(client, "/v1/comparisons", {"run_ids": run_ids} | change, 422)
    assert Problem.model_validate(answer.json()).where == where
