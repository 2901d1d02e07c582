"""Requests and what is answered: place, reason and remedy of each refusal, a line of refusals.txt each."""

import json
import re
from pathlib import Path

import pytest
from support.api import posted
from support.changes import changed
from support.in_process import Client
from support.kinds import MAP, PLAN
from support.outcomes import counts, outcome_of

from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

CASES = (Path(__file__).parent / "refusals.txt").read_text(encoding="utf-8").partition("\n=== ")[2]
LINES = [
    pytest.param(head, *line.split(" -> "), id=f"{head}: {line.partition(' -> ')[0][:60]}")
    for head, *lines in (part.splitlines() for part in CASES.split("\n=== "))
    for line in lines
    if line
]
CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=6, seed=1)
UNITS = {"length": "m", "angle": "rad", "force": "N", "moment": "N.m"}
CASE = {"label": "a", "joints": [0.1, 0.2, -0.3, 0.4, 0.5, 0.6], "force": [0, 0, -500], "moment": [0, 0, 1]}
STATED = {
    "measured_at": "2021-02-03T04:05:06Z",
    "serial_number": "S",
    "instrument": "T",
    "joint_kinds": ["revolute"] * 6,
}
BODIES = {
    "campaign": CAMPAIGN,
    "run": {"measurement_set_id": "{set}", "method": "partial_pose"},
    "plan": PLAN | {"measurement_set_id": "{set}"},
    "map": MAP | {"run_id": "{run}"},
    "deflection": {"run_id": "{run}", "units": UNITS, "load_point": [0, 0, 0.1], "cases": [CASE]},
    "geometry": next(iter(GEOMETRY.examples.values())),
    "comparison": {"run_ids": ["{run}"]},
    "robot": EXAMPLES["robots"]["modified DH"],
    "set": CAMPAIGN["measurement_set"] | STATED | {"robot_id": "{robot}"},
    "posture": {"robot_id": "{robot}", "joints": [[0.0] * 6]},
}


@pytest.fixture(scope="module")
def client():
    with Store.open("sqlite://") as store:
        yield Client(store)


@pytest.fixture(scope="module")
def ids(client):
    """Ids of a run, of its set and of its robot, by what stands in place of them in the cases."""
    run = posted(client, CAMPAIGN)
    of_set = run["request"]["measurement_set_id"]
    robot = client.get(f"/v1/measurement-sets/{of_set}").json()["robot_id"]
    return {"{run}": run["id"], "{set}": of_set, "{robot}": robot}


def filled(text, ids):
    for name, identifier in ids.items():
        text = text.replace(name, identifier)
    return text


def body_of(name, changes):
    """Return a body with the changes that a case states, apart from each other by ` & `."""
    body = BODIES.get(name, {})
    for change in changes.split(" & "):
        field, _, value = change.partition(" = ")
        if value:
            body = changed(body, field, json.loads(value))
        elif field != "nothing":
            body = changed(body, field.removeprefix("without "))
    return body


@pytest.mark.parametrize(("head", "request_", "wanted"), LINES)
def test_a_request_is_answered_as_stated_and_what_is_refused_stores_nothing(
    head, request_, wanted, client, ids
):
    before = counts(client)
    if head == "addresses":
        method, address = request_.split(" ", 1)
        body = {"json": {"deleted": True}} if method == "PATCH" else {}
    else:
        (method, address), name = head.partition(" of ")[0].split(" "), head.partition(" of ")[2]
        body = {"content": filled(json.dumps(body_of(name, request_)), ids)}
        body["headers"] = {"Content-Type": "application/json"}
    answer = client.request(method, filled(address, ids), **body)
    said = outcome_of(answer)
    for name, identifier in ids.items():
        said = said.replace(identifier, name)
    assert said == wanted
    assert answer.status_code < 400 or counts(client) == before


ADDRESSES = {
    "set": "/v1/measurement-sets",
    "run": "/v1/runs",
    "map": "/v1/maps",
    "plan": "/v1/plans",
    "deflection": "/v1/deflections",
    "geometry": "/v1/geometries",
    "robot": "/v1/robots",
}


def fields_of(value, way=""):
    """Yield the path of each field, and its value; of a list the first entry."""
    parts = value.items() if isinstance(value, dict) else [(0, value[0])] if isinstance(value, list) else ()
    for key, part in parts:
        if isinstance(key, str):
            yield f"{way}{key}", part
        yield from fields_of(part, f"{way}{key}.")


@pytest.mark.parametrize("name", ADDRESSES)
def test_a_field_of_another_type_is_refused_at_its_own_place(name, client, ids):
    """A text, a number, a list and an object in place of each field of each request."""
    before, asked = counts(client), 0
    for field, value in fields_of(BODIES[name]):
        for wrong in ("", -1, [], {}, True):
            if isinstance(wrong, type(value)) or {type(wrong), type(value)} <= {int, float}:
                continue
            content = filled(json.dumps(changed(BODIES[name], field, wrong)), ids)
            headers = {"Content-Type": "application/json"}
            answer = client.request("POST", ADDRESSES[name], content=content, headers=headers)
            assert answer.status_code == 422, (field, wrong)
            place = re.sub(r"\.(\d+)", r"[\1]", field)
            found = answer.json()["where"].replace(".any_direction", "").replace("[0][0]", "[0]")
            assert found.startswith(place) or place.rpartition(".")[0] == found, (field, wrong, found)
            asked += 1
    assert asked >= 8
    assert counts(client) == before


def test_a_key_of_ones_own_gives_one_resource(client, ids):
    sets = BODIES["set"] | {"robot_id": ids["{robot}"]}
    for path, body, what in (
        ("/v1/robots", CAMPAIGN["robot"], "a robot"),
        ("/v1/measurement-sets", sets, "a measurement set"),
    ):
        headers = {"Idempotency-Key": "mine"}
        first, again = (client.request("POST", path, json=body, headers=headers) for _ in range(2))
        assert (first.status_code, first.json()) == (201, again.json())
        assert first.headers["location"] == again.headers["location"] == f"{path}/{first.json()['id']}"
        other = client.request("POST", path, json=body | {"name": "x"}, headers=headers)
        assert outcome_of(other).split(" | ") == [
            "422 idempotency-conflict",
            "-",
            f"the idempotency key 'mine' was already used with another body to create {what}",
            "send the first body again, or use a new key",
        ]


@pytest.mark.parametrize(
    ("key", "reason"),
    [
        ("", "must have at least 1 character | write a longer text"),
        ("x" * 256, "must have at most 255 characters | write a shorter text"),
    ],
)
@pytest.mark.parametrize("path", ["/v1/robots", "/v1/measurement-sets"])
def test_a_key_of_ones_own_has_1_to_255_characters(path, key, reason, client, ids):
    body = BODIES[path.removeprefix("/v1/").removeprefix("measurement-").removesuffix("s")]
    body = json.loads(filled(json.dumps(body), ids))
    answer = client.request("POST", path, json=body, headers={"Idempotency-Key": key})
    assert outcome_of(answer) == f"422 invalid-request | header.idempotency-key | {reason}"
    longest = client.request("POST", path, json=body, headers={"Idempotency-Key": "x" * 255})
    assert longest.status_code == 201


def test_robot_and_readings_of_a_run_that_is_refused_are_kept(client, ids):
    before = counts(client)
    reading = "measurement_set.observations.2.readings.0.loaded"
    answer = client.request("POST", "/v1/campaigns", json=changed(CAMPAIGN, reading))
    assert outcome_of(answer).split(" | ")[:3] == [
        "422 invalid-measurement-set",
        "measurement_set.observations[2].readings",
        "observations[2] 'c03', target P10: `loaded` is missing (1 of 18 readings)",
    ]
    robots, sets, jobs = before
    assert counts(client) == [robots, sets + 1, jobs]
    given = CAMPAIGN | {"run": {"leave_out": ["zz"]}}
    assert outcome_of(client.request("POST", "/v1/campaigns", json=given)) == (
        "422 invalid-request | run.leave_out | the set has no observation 'zz' | "
        "give labels of the set's observations: c01, c02, c03, c04, c05, c06"
    )


def test_a_set_has_at_most_sixteen_targets(client, ids):
    before = counts(client)
    many = json.loads(filled(json.dumps(BODIES["set"]), ids))
    for number, observation in enumerate(many["observations"]):
        for reading in observation["readings"]:
            reading["target"] += f" {number}"
    assert outcome_of(client.request("POST", "/v1/measurement-sets", json=many)) == (
        "422 invalid-measurement-set | observations | the set has 18 different targets, more than 16 | "
        "use the same names in every observation"
    )
    assert counts(client) == before


def test_an_answer_is_waited_for_a_minute_at_most(client, ids):
    before = counts(client)
    answer = client.request("POST", "/v1/runs?wait=61", json={"measurement_set_id": ids["{set}"]})
    assert outcome_of(answer) == (
        "422 invalid-request | query.wait | must be less than or equal to 60 | "
        "give a number within this limit, and check its unit"
    )
    assert counts(client) == before
