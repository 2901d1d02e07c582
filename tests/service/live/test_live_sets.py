"""Open sets in the store: listed apart, deleted, restored and purged; followed and shown as a code."""

from datetime import UTC, datetime

import numpy as np
import pytest
from fastapi.testclient import TestClient
from support.api import post
from support.live import ARM, OPEN, SIGMA, declared, described, measured

from jointstiff.service.app import create_app
from jointstiff.service.live import stored as stored_sets
from jointstiff.service.store.store import Store
from jointstiff.service.workers.worker import purge
from jointstiff.simulator import LOAD_POINT, TARGETS, robot_document, simulate_campaign


@pytest.fixture
def store():
    with Store.open("sqlite://") as store:
        yield store


@pytest.fixture
def client(store):
    with TestClient(create_app(store), base_url="http://127.0.0.1") as client:
        yield client


def deleted(client, address, gone=True):
    """Delete or restore; return the status."""
    return client.patch(address, json={"deleted": gone}).status_code


def ids(client, **query):
    return [each["id"] for each in client.get("/v1/measurement-sets", params=query).json()["items"]]


def test_open_sets_are_listed_apart_and_no_run_takes_one(client):
    address = declared(client)
    measured(client, address, 2)
    robot = client.get(address).json()["robot_id"]
    readings = simulate_campaign(ARM, configurations=6)["measurement_set"]
    other = post(client, "/v1/measurement-sets", readings | {"robot_id": robot})["id"]
    identifier = address.rpartition("/")[2]
    assert (ids(client), ids(client, open="true")) == ([other], [identifier])
    problem = post(client, "/v1/runs", {"measurement_set_id": identifier}, 422)
    assert problem["where"] == "measurement_set_id"
    assert problem["detail"] == f"there is no measurement set '{identifier}'"
    assert len(client.get(address).json()["observations"]) == 2


def test_what_is_declared_does_not_change_and_a_deleted_set_comes_back_with_its_readings(client):
    address = declared(client)
    measured(client, address, 2)
    problem = client.patch(address, json={"name": "other"}).json()
    assert (problem["status"], problem["where"]) == (422, "name")
    assert problem["detail"] == "the declaration of a live campaign cannot be changed"
    assert (
        problem["remedy"]
        == "first close the campaign; or delete the campaign, and declare another live campaign"
    )
    assert deleted(client, address) == 200
    problem = client.get(f"{address}/next").json()
    assert (problem["status"], problem["type"]) == (404, "urn:jointstiff:problem:deleted")
    assert problem["remedy"] == f'restore it with PATCH {address} {{"deleted": false}}'
    assert deleted(client, address, gone=False) == 200
    assert len(client.get(f"{address}/next").json()["readings"]) == 2


def test_a_tablet_gets_the_address_of_a_page_as_a_code_and_no_script(client):
    address = declared(client)
    pages = ("http://cell3:8000/", "https://cell3/", "javascript:alert(1)")
    first, second, script = (client.get(f"{address}/code.svg", params={"page": page}) for page in pages)
    assert (first.status_code, first.headers["content-type"]) == (200, "image/svg+xml")
    assert "<svg" in first.text
    assert (second.status_code, second.text == first.text) == (200, False)
    assert (script.status_code, script.headers["content-type"]) == (422, "application/problem+json")
    missing = client.get("/v1/measurement-sets/none/code.svg", params={"page": "http://cell3/"})
    assert (missing.status_code, missing.json()["detail"]) == (404, "there is no measurement set 'none'")


@pytest.mark.parametrize("closed", [True, False])
def test_the_record_goes_and_comes_with_its_set_and_after_the_robot(client, store, closed):
    address = declared(client)
    robot = f"/v1/robots/{client.get(address).json()['robot_id']}"
    measured(client, address, 6)
    if closed:
        assert deleted(client, f"/v1/jobs/{post(client, f'{address}/close', {}, 200)['run_id']}") == 200
    assert (deleted(client, address), deleted(client, robot)) == (200, 200)
    assert deleted(client, address, gone=False) == 404
    assert (deleted(client, robot, gone=False), deleted(client, address, gone=False)) == (200, 200)
    assert len(client.get(f"{address}/next").json()["readings"]) == 6
    assert (deleted(client, address), deleted(client, robot)) == (200, 200)
    purge(store, datetime.now(UTC))
    assert deleted(client, robot, gone=False) == 404
    assert store.live_entries.find(set_id=address.rpartition("/")[2]) == []


def test_two_readings_after_the_next_one_are_chosen_ahead(client):
    """Each is a posture of its own; once the next one is read as predicted, the first of them comes."""
    address = declared(client)
    for number in range(1, 4):
        state = client.get(f"{address}/next").json()
        ahead = [state["next"], *state["following"]]
        assert [each["label"] for each in ahead] == [f"m{number + i:02d}" for i in range(3)]
        for first, second in ((0, 1), (0, 2), (1, 2)):
            apart = np.abs(np.subtract(ahead[first]["joints"], ahead[second]["joints"])).max()
            assert apart > 0.05
        for each in ahead:
            assert each["force"] == pytest.approx([0.0, 0.0, -150.0 * 9.80665])
        measured(client, address, 1)
    measured(client, address, 1)
    post(client, f"{address}/close", {}, 200)
    assert client.get(f"{address}/next").json()["following"] == []


def test_the_residuals_of_the_last_reading_are_told(client):
    """Noise alone at the targets; without an identification there are none."""
    address = declared(client)
    assert client.get(f"{address}/next").json()["residuals"] == []
    state = measured(client, address, 5)
    assert {(each["observation"], each["target"]) for each in state["residuals"]} == {
        ("m05", name) for name in TARGETS
    }
    for each in state["residuals"]:
        moved = np.subtract(each["deflection"], each["predicted"])
        assert each["residual"] == pytest.approx(moved, abs=1e-12)
        assert np.linalg.norm(each["residual"]) < 6 * np.sqrt(2) * SIGMA


@pytest.mark.parametrize(
    ("fields", "where"),
    [
        ({"load_point_target": "hook"}, "load_point_target"),
        ({"noise": {"sigma": 2e-5, "grounds": {"between": "payload_declared"}}}, "noise.grounds.between"),
    ],
)
def test_a_live_set_that_can_have_no_useful_reading_is_refused_when_it_is_declared(client, fields, where):
    robot = post(client, "/v1/robots", robot_document(ARM))["id"]
    body = described(robot, OPEN, load_point=list(LOAD_POINT)) | fields
    answer = client.post("/v1/measurement-sets", json=body)
    assert (answer.status_code, answer.json()["where"]) == (422, where)


def test_who_follows_a_closed_set_is_told_so_once(client):
    address = declared(client)
    measured(client, address, 1)
    post(client, f"{address}/close", {}, 200)
    lines = client.get(f"{address}/next", params={"follow": "true"}).text.splitlines()
    (data,) = [line for line in lines if line.startswith("data")]
    assert '"state":"closed"' in data


def test_a_record_with_its_load_point_among_the_options_alone_is_completed(client, store, monkeypatch):
    robot = post(client, "/v1/robots", robot_document(ARM))["id"]
    units = {"length": "mm", "angle": "rad", "force": "N"}
    body = described(robot, OPEN | {"load_point": list(LOAD_POINT)}, units=units)
    with monkeypatch.context() as earlier:
        earlier.setattr(
            stored_sets,
            "complete_declaration",
            lambda sent, options: sent.model_copy(update={"open": options}),
        )
        made = post(client, "/v1/measurement-sets", body)["id"]
    with TestClient(create_app(store), base_url="http://127.0.0.1") as other:
        stored = other.get(f"/v1/measurement-sets/{made}").json()
    assert stored["load_point"] == pytest.approx([-60.0, 20.0, 180.0])
