"""Comparisons over HTTP, on a running service with each database."""

from __future__ import annotations

import csv
import io
import uuid

import pytest
from support.api import CANCEL, file_at, job_at, posted_set

from jointstiff.schemas.comparison import Comparison
from jointstiff.schemas.problem import Problem
from jointstiff.simulator import default_arm, simulate_campaign


def post(client, path, body, expected=201, **headers):
    answer = client.post(path, json=body, headers=headers)
    assert answer.status_code == expected, answer.text
    return answer


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign(default_arm(), load="dead_weight", configurations=8, seed=1)


@pytest.fixture
def set_id(client, campaign):
    own = campaign["measurement_set"] | {"name": uuid.uuid4().hex}  # else it would be another test's
    return posted_set(client, campaign | {"measurement_set": own})


def test_a_quick_comparison_is_answered_finished(client, set_id):
    answer = post(client, "/v1/comparisons", {"measurement_set_id": set_id})
    found = Comparison.model_validate_json(answer.content)
    assert found.state == "succeeded"
    assert found.progress is None
    assert len(found.result.entries) == 8
    assert answer.headers["location"] == f"/v1/comparisons/{found.id}"
    assert client.get(answer.headers["location"]).content == answer.content


def test_the_table(client, set_id):
    address = post(client, "/v1/comparisons", {"measurement_set_id": set_id}).headers["location"]
    answer = client.get(file_at(address, "table.csv"))
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/csv")
    assert ".csv" in answer.headers["content-disposition"]
    rows = list(csv.DictReader(io.StringIO(answer.content.decode(), newline="")))
    assert len(rows) == 8 * 6
    assert all(header.endswith("]") for header in rows[0] if "stiffness" in header or "compliance" in header)


def test_one_that_resamples_is_waited_for(client, set_id):
    body = {"measurement_set_id": set_id, "resampling": {"size": 6, "repetitions": 100}}
    found = post(client, "/v1/comparisons?wait=60", body).json()
    assert found["state"] == "succeeded"
    assert found["progress"]["done"] == found["progress"]["total"] == 8 * 100
    assert found["result"]["entries"][0]["resampling"]["repetitions"] == 100


def test_listed_newest_first_and_filtered(client, set_id):
    body = {"measurement_set_id": set_id, "methods": [{"method": "partial_pose"}]}
    sent = [post(client, "/v1/comparisons", body).json()["id"] for _ in range(3)]
    page = client.get("/v1/comparisons", params={"measurement_set_id": set_id, "limit": 2}).json()
    assert [item["id"] for item in page["items"]] == sent[:0:-1]
    query = {"measurement_set_id": set_id, "state": "succeeded", "cursor": page["next"]}
    rest = client.get("/v1/comparisons", params=query).json()
    assert [item["id"] for item in rest["items"]] == sent[:1]
    assert "result" not in rest["items"][0]
    assert client.get("/v1/comparisons", params={"method": "partial_pose"}).status_code == 422


def test_the_same_key_gives_one_comparison(client, set_id):
    body, key = {"measurement_set_id": set_id}, {"Idempotency-Key": uuid.uuid4().hex}
    first = post(client, "/v1/comparisons", body, **key)
    assert post(client, "/v1/comparisons", body, **key).content == first.content
    problem = post(client, "/v1/comparisons", body | {"confidence": 0.9}, 422, **key).json()
    assert problem["type"].endswith("idempotency-conflict")


@pytest.mark.parametrize(
    ("request_", "where"),
    [
        ({"methods": []}, "methods"),
        ({"methods": [{"method": "best"}]}, "methods[0].method"),
        ({"methods": [{"method": "partial_pose"}] * 2}, "methods"),
        ({"constraints": ["negative"]}, "constraints[0]"),
        ({"resampling": {"size": 9}}, "resampling.size"),
        ({"measurement_set_id": "nothing"}, "measurement_set_id"),
        ({"positive": True}, "positive"),
    ],
)
def test_refused_with_the_place_and_nothing_stored(client, set_id, request_, where):
    answer = post(client, "/v1/comparisons", {"measurement_set_id": set_id} | request_, 422)
    problem = Problem.model_validate(answer.json())
    assert problem.where == where
    assert client.get("/v1/comparisons", params={"measurement_set_id": set_id}).json()["items"] == []


@pytest.mark.parametrize("identifier", ["nothing", "%00", "%F0%9F%A4%96", "a%ED%A0%80"])
@pytest.mark.parametrize("collection", ["runs", "comparisons"])
def test_one_that_is_not_there(client, collection, identifier):
    address = f"/v1/{collection}/{identifier}"
    assert client.get(address).status_code == 404
    assert client.get(f"{job_at(identifier)}/events").status_code == 404
    assert client.patch(job_at(identifier), json=CANCEL).status_code == 404
    assert client.get(file_at(identifier, "table.csv")).status_code == 404
