"""Runs that leave observations out, and runs that vary another: what the page's buttons ask for."""

from __future__ import annotations

import numpy as np
import pytest

from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture
def stored(client):
    """A clean set of 12 configurations, and the same with a target bumped in the fifth."""
    document = simulate_campaign(default_arm("motor"), configurations=12, seed=3)
    robot = client.post("/v1/robots", json=document["robot"]).json()["id"]

    def add():
        answer = client.post("/v1/measurement-sets", json={**document["measurement_set"], "robot_id": robot})
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    clean = add()
    observations = document["measurement_set"]["observations"]
    label = observations[4]["label"]
    shift = 2.0 if document["measurement_set"]["units"]["length"] == "mm" else 2e-3
    observations[4]["readings"][0]["loaded"][0] += shift
    bumped = add()
    del observations[4]
    return clean, bumped, add(), label


def run(client, set_id, **options):
    answer = client.post("/v1/runs", json={"measurement_set_id": set_id, **options})
    assert answer.status_code == 201, answer.text
    return answer.json()


def test_a_run_without_an_observation_is_that_of_a_set_without_it(client, stored):
    _, bumped, shorter, label = stored
    left, other = run(client, bumped, leave_out=[label]), run(client, shorter)
    compliance = [[j["compliance"] or 0.0 for j in r["result"]["joints"]] for r in (left, other)]
    np.testing.assert_allclose(compliance[0], compliance[1], rtol=1e-12)
    assert left["provenance"]["input_hash"] == other["provenance"]["input_hash"]
    assert label not in {residual["observation"] for residual in left["result"]["residuals"]}
    assert label not in str(left["result"]["warnings"])


@pytest.mark.parametrize("left", [["no such label"], None])
def test_what_cannot_be_left_out_is_refused(client, stored, left):
    set_id = stored[0]
    labels = [o["label"] for o in client.get(f"/v1/measurement-sets/{set_id}").json()["observations"]]
    answer = client.post("/v1/runs", json={"measurement_set_id": set_id, "leave_out": left or labels})
    assert answer.status_code == 422, answer.text
    assert answer.json()["where"] == "leave_out"
    assert answer.json()["remedy"]
