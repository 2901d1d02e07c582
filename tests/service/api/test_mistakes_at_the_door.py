"""Mistakes of programs at the HTTP door: the answer names the cause, and its remedy, carried out, works."""

import gzip
import json
import re
from typing import Any

import pytest
from support.api import posted
from support.in_process import Client
from support.kinds import MAP

from jointstiff.service.conversion.parsing import MAX_SET_BYTES, USE_ARRAYS
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=6, seed=1)
TEXT = json.dumps(CAMPAIGN)
URDF = CAMPAIGN["robot"]["model"]["urdf"]
CASE = {"joints": [0, -20, 30, 0, 45, 0], "force": [0, 0, -500]}
MISTAKEN = simulate_campaign(default_arm(), load="pull", configurations=8, seed=2)
for _observation in MISTAKEN["measurement_set"]["observations"]:
    _observation["force"] = [-each for each in _observation["force"]]
JSON = {"Content-Type": "application/json"}
RUN = {"measurement_set_id": "{set}"}
TABLE = ("readings.csv", b"J1 [deg],J2 [deg]\n1,2\n")


def request(method: str, path: str, **options: Any) -> dict[str, Any]:
    return {"method": method, "path": path, **options}


def get(path: str) -> dict[str, Any]:
    return request("GET", path)


def post_campaign(**options: Any) -> dict[str, Any]:
    return request("POST", "/v1/campaigns", **({"content": TEXT, "headers": JSON} | options))


def post_set(**changes: Any) -> dict[str, Any]:
    """A post of the campaign whose measurement set has changes, of which None takes a field away."""
    measured = CAMPAIGN["measurement_set"] | changes
    measured = {name: value for name, value in measured.items() if value is not None}
    return request("POST", "/v1/campaigns", json=CAMPAIGN | {"measurement_set": measured})


def post_first(**changes: Any) -> dict[str, Any]:
    """A post of the campaign whose first observation has changes."""
    first, *others = CAMPAIGN["measurement_set"]["observations"]
    return post_set(observations=[first | changes, *others])


def post_run(**fields: Any) -> dict[str, Any]:
    return request("POST", "/v1/runs", json=RUN | fields)


def imported(**options: Any) -> dict[str, Any]:
    return request("POST", "/v1/imports", **options)


def predicted(angle: str) -> dict[str, Any]:
    """A prediction in a posture in degrees, whose unit is stated as `angle`."""
    units = {"length": "m", "angle": angle, "force": "N"}
    body = {"run_id": "{run}", "units": units, "load_point": [0, 0, 0.1], "cases": [CASE]}
    return request("POST", "/v1/deflections", json=body)


WELL = post_campaign()
JOB = get("/v1/jobs/{run}")
MISTAKES: dict[str, tuple[dict[str, Any], int, str, dict[str, Any]]] = {
    "one run twice": (
        request("POST", "/v1/comparisons", json={"run_ids": ["{run}", "{run}"]}),
        422,
        "must not contain duplicates.*give each entry only once",
        request("POST", "/v1/comparisons", json={"run_ids": ["{run}", "{other}"]}),
    ),
    "name of a file": (
        get("/v1/jobs/{run}/files/report.docx"),
        404,
        "a run has no such file.*report.html",
        get("/v1/jobs/{run}/files/report.html"),
    ),
    # Ids
    "name with blanks for an id": (
        post_run(measurement_set_id="pull, 6 configurations, motor encoders"),
        422,
        r"measurement_set_id: must be an id, which has at most 64 letters, digits, - and _; a name is no "
        r"id \| give the id: GET /v1/measurement-sets lists the ids with the names$",
        get("/v1/measurement-sets"),
    ),
    "name of a robot for an id": (
        request("POST", "/v1/measurement-sets", json=CAMPAIGN["measurement_set"] | {"robot_id": "KR 210"}),
        422,
        r"a name is no id \| give the id: GET /v1/robots lists the ids with the names$",
        request("POST", "/v1/measurement-sets", json=CAMPAIGN["measurement_set"] | {"robot_id": "{robot}"}),
    ),
    "field without id": (
        request("POST", "/v1/runs", json={"measurement_set": "pull"}),
        422,
        "measurement_set_id: required field is missing.*with an id, not a name: GET /v1/measurement-sets "
        "lists the ids with the names$",
        post_run(),
    ),
    "robot of a run": (
        post_run(robot="simulated 6R"),
        422,
        r"robot: unknown field \| remove this field",
        post_run(),
    ),
    "load point of a run": (
        post_run(load_point=[0, 0, 0.1]),
        422,
        r"load_point: unknown field \| remove this field: it is stated in the measurement set",
        post_run(),
    ),
    "id of nothing": (
        get("/v1/jobs/123"),
        404,
        "no job '123'.*list the existing ids with GET /v1/jobs",
        get("/v1/jobs"),
    ),
    "id of a run for a set": (
        post_run(measurement_set_id="{run}"),
        422,
        "no measurement set '{run}': this is the id of a run \\| give `request.measurement_set_id` of the "
        "run, GET /v1/jobs/{run}; or list the existing ids with GET /v1/measurement-sets",
        get("/v1/jobs/{run}"),
    ),
    "id of a set for a run": (
        request("POST", "/v1/maps", json=MAP | {"run_id": "{set}"}),
        422,
        "no run '{set}': this is the id of a measurement set \\| identify the set with POST /v1/runs "
        '{"measurement_set_id": "{set}"}; or list the existing ids with GET /v1/jobs',
        request("POST", "/v1/runs", json={"measurement_set_id": "{set}"}),
    ),
    "id of a robot for a run": (
        request("POST", "/v1/maps", json=MAP | {"run_id": "{robot}"}),
        422,
        r"this is the id of a robot \| give the id of one of the robot's runs, "
        r"GET /v1/jobs\?kind=run&robot_id={robot}",
        get("/v1/jobs?kind=run&robot_id={robot}"),
    ),
    "id of a robot for a set": (
        post_run(measurement_set_id="{robot}"),
        422,
        r"this is the id of a robot \| .*GET /v1/measurement-sets\?robot_id={robot}",
        get("/v1/measurement-sets?robot_id={robot}"),
    ),
    "id of a set for a job": (
        get("/v1/jobs/{set}"),
        404,
        r"no job '{set}': this is the id of a measurement set \| get the set with "
        "GET /v1/measurement-sets/{set}",
        get("/v1/measurement-sets/{set}"),
    ),
    "id of a set for a robot": (
        get("/v1/robots/{set}"),
        404,
        "this is the id of a measurement set \\| give `robot_id` of the set, GET /v1/measurement-sets/{set}",
        get("/v1/measurement-sets/{set}"),
    ),
    # Documents
    "robot for a campaign": (
        request("POST", "/v1/campaigns", json=CAMPAIGN["robot"]),
        422,
        r"the body is a robot \| send the robot with POST /v1/robots$",
        request("POST", "/v1/robots", json=CAMPAIGN["robot"]),
    ),
    "campaign for a robot": (
        request("POST", "/v1/robots", json=CAMPAIGN),
        422,
        r"the body is a campaign \| send the campaign with POST /v1/campaigns$",
        WELL,
    ),
    "set for a campaign": (
        request("POST", "/v1/campaigns", json=CAMPAIGN["measurement_set"]),
        422,
        "the body is a measurement set without a robot.*add `robot_id`.*POST /v1/measurement-sets",
        request("POST", "/v1/measurement-sets", json=CAMPAIGN["measurement_set"] | {"robot_id": "{robot}"}),
    ),
    "set of a robot for a campaign": (
        request("POST", "/v1/campaigns", json=CAMPAIGN["measurement_set"] | {"robot_id": "{robot}"}),
        422,
        "the body is a measurement set of a stored robot.*with POST /v1/measurement-sets$",
        request("POST", "/v1/measurement-sets", json=CAMPAIGN["measurement_set"] | {"robot_id": "{robot}"}),
    ),
    # Methods
    "readings by target": (
        post_set(observations=[CAMPAIGN["measurement_set"]["observations"][0] | {"readings": {"P10": {}}}]),
        422,
        r'give a list of objects, such as \[\{"target": "P10", "unloaded": ',
        WELL,
    ),
    "get where one posts": (get("/v1/campaigns"), 405, "send POST$", WELL),
    "post where one gets": (request("POST", "/v1/jobs", json={}), 405, "send GET$", get("/v1/jobs")),
    # Query parameters
    "misspelt parameter": (
        get("/v1/jobs?kidn=run"),
        422,
        "give `kind` in its place",
        get("/v1/jobs?kind=run"),
    ),
    "number of a page": (get("/v1/jobs?cursor=2"), 422, "use `next` of the previous page", get("/v1/jobs")),
    "version of a resource": (
        request("PATCH", "/v1/jobs/{run}", json={}, headers={"If-Match": '"1"'}),
        412,
        "compares no versions.*leave out the header If-Match",
        request("PATCH", "/v1/jobs/{run}", json={}, headers={"If-Match": "*"}),
    ),
    "comment": (
        post_campaign(content=f"{TEXT[:-1]}, // the end\n}}"),
        422,
        r"Invalid JSON: .* at line 1 column \d+",
        WELL,
    ),
    "trailing comma": (
        post_campaign(content=f"{TEXT[:-1]},}}"),
        422,
        r"Invalid JSON: trailing comma at line 1 column \d+",
        WELL,
    ),
    "word of Python": (
        post_campaign(content='{"run": None}'),
        422,
        "Invalid JSON: expected ident at line 1 column 10",
        WELL,
    ),
    "name without quotes": (
        post_campaign(content="{robot: 1}"),
        422,
        "Invalid JSON: key must be a string at line 1 column 2",
        WELL,
    ),
    "decimal comma in JSON": (
        post_campaign(content='{"a": 1,5}'),
        422,
        "Invalid JSON: key must be a string at line 1 column 9",
        WELL,
    ),
    "number with a point first": (
        post_campaign(content='{"a": .5}'),
        422,
        "Invalid JSON: expected value at line 1 column 7",
        WELL,
    ),
    "table as JSON": (
        post_campaign(content=TABLE[1]),
        422,
        "Invalid JSON: .* at line 1 column",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "table as a form": (
        request("POST", "/v1/campaigns", files={"file": TABLE}),
        415,
        "send a table to POST /v1/imports",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "compressed without a word": (
        post_campaign(content=gzip.compress(TEXT.encode())),
        422,
        "the body is compressed.*send the document uncompressed",
        WELL,
    ),
    "joints by name": (
        post_first(joints={"joint_1": 0.1}),
        422,
        "must be a list.*one number for each joint, in the order of the robot's joints",
        WELL,
    ),
    "readings as lists": (post_first(readings=[[1, 2, 3]]), 422, "must be an object.*list of objects", WELL),
    "plural kind": (get("/v1/jobs?kind=runs"), 422, "must be 'run'", get("/v1/jobs?kind=run")),
    "limit of zero": (
        get("/v1/jobs?limit=0"),
        422,
        "must be greater than or equal to 1",
        get("/v1/jobs?limit=1"),
    ),
    "limit as a word": (get("/v1/jobs?limit=all"), 422, "give a whole number", get("/v1/jobs?limit=50")),
    "truth as a word": (
        get("/v1/robots?deleted=maybe"),
        422,
        "give true or false",
        get("/v1/robots?deleted=true"),
    ),
    "wait as a word": (
        request("POST", "/v1/campaigns?wait=yes", content=TEXT, headers=JSON),
        422,
        "query.wait: must be a number",
        request("POST", "/v1/campaigns?wait=1", content=TEXT, headers=JSON),
    ),
    "foreign cursor": (get("/v1/jobs?cursor=second"), 422, "or omit `cursor`", get("/v1/jobs")),
    "order of times": (
        get("/v1/measurement-sets?measured_from=2026-11-21T00:00:00Z&measured_to=2026-11-20T00:00:00Z"),
        422,
        "`measured_to` must be after `measured_from`",
        get("/v1/measurement-sets?measured_from=2026-11-20T00:00:00Z&measured_to=2026-11-21T00:00:00Z"),
    ),
    # Types and encodings of bodies
    "no type": (post_campaign(headers={}), 415, "no Content-Type.*Content-Type: application/json$", WELL),
    "plain text": (
        post_campaign(headers={"Content-Type": "text/plain"}),
        415,
        "'text/plain'.*application/json$",
        WELL,
    ),
    "table in place of JSON": (
        post_campaign(headers={"Content-Type": "text/csv"}),
        415,
        "'text/csv'.*send a table to POST /v1/imports, in a form of the fields `files` and `options`",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "form in place of JSON": (
        request("POST", "/v1/campaigns", data={"name": "x"}),
        415,
        "send JSON, with the header Content-Type: application/json$",
        WELL,
    ),
    "JSON in place of a form": (
        imported(json={}),
        415,
        "send a form of the fields `files` and `options`, .*header Content-Type: multipart/form-data$",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "UTF-16": (post_campaign(content=TEXT.encode("utf-16")), 422, "send the JSON document in UTF-8$", WELL),
    "Latin-1": (
        post_campaign(content=TEXT.replace('"c01"', '"prüfung"').encode("latin-1")),
        422,
        "not a text in UTF-8",
        post_campaign(content=TEXT.replace('"c01"', '"prüfung"').encode()),
    ),
    "compressed": (
        post_campaign(content=gzip.compress(TEXT.encode()), headers=JSON | {"Content-Encoding": "gzip"}),
        415,
        "send the body without that header$",
        WELL,
    ),
    "empty": (post_campaign(content=b""), 422, "the body is empty.*send a JSON document", WELL),
    "cut off": (
        post_campaign(content=TEXT[:-9]),
        422,
        r"Invalid JSON: EOF while parsing .* at line \d+ column \d+",
        WELL,
    ),
    "too large": (post_campaign(content=TEXT + " " * 2**23), 413, "the body exceeds 8192 KiB", WELL),
    "list of campaigns": (request("POST", "/v1/campaigns", json=[CAMPAIGN]), 422, "must be an object", WELL),
    "postures in degrees": (
        predicted("rad"),
        422,
        "the angle of joint_5 is 45 rad, beyond two turns.*state the unit of the angles, deg or rad",
        predicted("deg"),
    ),
    "name of a file without @": (
        post_campaign(content="campaign.json"),
        422,
        "Invalid JSON: expected value at line 1 column 1",
        WELL,
    ),
    "encoded twice": (
        request("POST", "/v1/campaigns", json=TEXT),
        422,
        "a JSON document in quotes: it was encoded twice",
        WELL,
    ),
    "pairs of a form": (
        post_campaign(content="name=cell&robot=7"),
        422,
        "Invalid JSON: expected ident at line 1 column 2",
        WELL,
    ),
    "file under another name": (
        imported(files={"file": TABLE}, data={"options": '{"name": "day"}'}),
        422,
        "unknown field 'file'.*send the file as `files`, not as `file`$",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "options under another name": (
        imported(files={"files": TABLE}, data={"request": '{"name": "day"}'}),
        422,
        "unknown field 'request'.*send the JSON object as `options`, not as `request`$",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "target that was not read": (
        post_first(readings=[{"target": "P", "unloaded": [1, 2, None], "loaded": [1, 2, 3]}]),
        422,
        "give one number; leave out the reading of a target that was not read",
        WELL,
    ),
    "goal as a number": (
        request("POST", "/v1/plans", json={"robot_id": "{robot}", "goal": 0.15}),
        422,
        "goal: must be an object.*give its fields by name, in braces",
        request(
            "POST",
            "/v1/plans",
            json={"measurement_set_id": "{set}", "goal": {"kind": "joints", "relative": 0.15}},
        ),
    ),
    "option as a field of a form": (
        imported(files={"files": TABLE}, data={"name": "day"}),
        422,
        "unknown field 'name'.*`options` is one JSON object of all options, such as .\"name\": …",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "prior as a pair": (
        post_run(priors={"joint_2": [3e6, 1e5]}),
        422,
        "must be an object.*give its fields by name, in braces",
        post_run(priors={"joint_2": {"stiffness": 3e6, "standard_uncertainty": 1e5}}),
    ),
    "other field of a form": (
        imported(files={"file": TABLE}),
        422,
        "send only the fields `files` and `options`",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "options that are no JSON": (
        imported(files={"files": TABLE}, data={"options": "{'name': 'day'}"}),
        422,
        "options: Invalid JSON.*send valid JSON",
        imported(files={"files": TABLE}, data={"options": '{"name": "day"}'}),
    ),
    "empty key of retries": (
        post_campaign(headers=JSON | {"Idempotency-Key": ""}),
        422,
        "must have at least 1 character.*write a longer text",
        post_campaign(headers=JSON | {"Idempotency-Key": "first"}),
    ),
    # Fields, values and units
    "plural field": (post_first(forces=[0, 0, -500]), 422, "forces: unknown field", WELL),
    "unit": (
        post_set(units={"length": "inch", "angle": "rad", "force": "N"}),
        422,
        "units.length: must be 'm' or 'mm'",
        post_set(units={"length": "m", "angle": "rad", "force": "N"}),
    ),
    "no unit": (
        post_set(units={"length": "m", "angle": "rad"}),
        422,
        "units.force: required field is missing.*add this field: N or kN",
        post_set(units={"length": "m", "angle": "rad", "force": "N"}),
    ),
    "no units": (
        post_set(units=None),
        422,
        "units: required field is missing.*length is m or mm; angle is rad or deg; force is N or kN",
        post_set(units={"length": "m", "angle": "rad", "force": "N"}),
    ),
    "number in quotes": (
        post_first(force=["0", 0, -500]),
        422,
        "must be a number.*give one number",
        post_first(force=[0, 0, -500]),
    ),
    "no encoders": (post_set(encoders=None), 422, "encoders: required field is missing", WELL),
    "time without a zone": (
        post_set(measured_at="2026-11-20T10:00:00"),
        422,
        "add the time zone",
        post_set(measured_at="2026-11-20T10:00:00+01:00"),
    ),
    "method": (
        post_run(method="complete"),
        422,
        "must be .*'complete_pose'",
        post_run(method="complete_pose"),
    ),
    "percent": (post_run(confidence=95), 422, "less than or equal to 0.9999", post_run(confidence=0.95)),
    "missing id": (
        request("POST", "/v1/runs", json={}),
        422,
        "measurement_set_id: required field is missing",
        post_run(),
    ),
    "action in a field": (
        request("POST", "/v1/runs/{mistaken}/apply", json={"action": "{action}"}),
        422,
        "required field is missing|action: unknown field",
        request("POST", "/v1/runs/{mistaken}/apply", json="{action}"),
    ),
    "whole reason": (
        request("POST", "/v1/runs/{mistaken}/apply", json="{reason}"),
        422,
        "required field is missing|action: unknown field",
        request("POST", "/v1/runs/{mistaken}/apply", json="{action}"),
    ),
    "options in a field": (
        post_run(options={"method": "complete_pose"}),
        422,
        "options: unknown field",
        post_run(method="complete_pose"),
    ),
    "campaign in a field": (
        request("POST", "/v1/campaigns", json={"campaign": CAMPAIGN}),
        422,
        "robot: required field is missing",
        WELL,
    ),
    "option next to the campaign": (
        request("POST", "/v1/campaigns", json=CAMPAIGN | {"method": "complete_pose"}),
        422,
        "method: unknown field",
        request("POST", "/v1/campaigns", json=CAMPAIGN | {"run": {"method": "complete_pose"}}),
    ),
    "options next to the campaign": (
        request("POST", "/v1/campaigns", json=CAMPAIGN | {"options": {"method": "complete_pose"}}),
        422,
        "options: unknown field",
        request("POST", "/v1/campaigns", json=CAMPAIGN | {"run": {"method": "complete_pose"}}),
    ),
    "letters of another language": (
        request("POST", "/v1/runs", json={"measurementSetId": "{set}"}),
        422,
        "measurement_set_id: required field is missing",
        post_run(),
    ),
    "URDF without its format": (
        request("POST", "/v1/robots", json={"name": "x", "model": {"urdf": URDF}}),
        422,
        "model: needs the field 'format'",
        request("POST", "/v1/robots", json={"name": "x", "model": CAMPAIGN["robot"]["model"]}),
    ),
    "list in place of a number": (
        post_first(force=[[0, 0, -500]]),
        422,
        "must be a number.*give one number",
        WELL,
    ),
    "cases without a list": (
        request("POST", "/v1/deflections", json=predicted("deg")["json"] | {"cases": CASE}),
        422,
        "cases: must be a list",
        predicted("deg"),
    ),
}


@pytest.fixture(scope="module")
def client():
    with Store.open("sqlite://") as store:
        yield Client(store)


@pytest.fixture(scope="module")
def ids(client):
    """The ids of a run, of its set and of its robot, and of another run, by their names above."""
    run = posted(client, CAMPAIGN)
    mistaken = posted(client, MISTAKEN)
    reason = next(each for each in mistaken["result"]["assessment"]["reasons"] if each["action"])
    of_set = run["request"]["measurement_set_id"]
    robot = client.get(f"/v1/measurement-sets/{of_set}").json()["robot_id"]
    other = posted(client, CAMPAIGN, positive=False)["id"]
    return {
        "{run}": run["id"],
        "{set}": of_set,
        "{robot}": robot,
        "{other}": other,
        "{mistaken}": mistaken["id"],
        '"{action}"': json.dumps(reason["action"]),
        '"{reason}"': json.dumps(reason),
    }


@pytest.fixture
def send(client, ids):
    """Send a request, with ids in place of their names."""

    def send(described: dict[str, Any]) -> Any:
        stated = dict(described)
        body = stated.pop("json", None)
        for name, identifier in ids.items():
            stated["path"] = stated["path"].replace(name, identifier)
            body = json.loads(json.dumps(body).replace(name, identifier))
        if body is not None:
            stated["json"] = body
        return client.request(stated.pop("method"), stated.pop("path"), **stated)

    return send


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_answered_with_a_remedy_that_works(send, ids, name):
    mistake, status, answer, correction = MISTAKES[name]
    refused = send(mistake)
    problem = refused.json()
    words = f"{problem['detail']} | {problem['remedy']}"
    for placeholder, identifier in ids.items():
        words = words.replace(identifier, placeholder)
    assert (refused.status_code, bool(problem["remedy"])) == (status, True), words
    assert re.search(re.sub(r"\{(\w+)\}", r"\\{\1\\}", answer), words), words
    assert "openapi" not in words
    corrected = send(correction)
    assert corrected.status_code in {200, 201, 202}, corrected.text


def test_an_unknown_address_names_the_description_of_all_addresses(client):
    refused = client.get("/v1/welding")
    assert (refused.status_code, refused.json()["detail"]) == (404, "there is no address /v1/welding")
    assert refused.json()["remedy"] == "GET /openapi.json describes all addresses"
    assert "/v1/jobs" in client.get("/openapi.json").json()["paths"]


def test_a_cursor_of_another_list_is_refused(client, ids):
    """The pages of two lists are never mixed, even if both lists have the same order."""
    following = client.get("/v1/jobs?limit=1").json()["next"]
    for other in ("/v1/robots?limit=1", "/v1/jobs?limit=1&kind=run", "/v1/jobs?limit=1&q=pull"):
        refused = client.get(f"{other}&cursor={following}")
        assert (refused.status_code, refused.json()["type"][-14:]) == (422, "invalid-cursor")
        assert "the same address, filters and `sort`" in refused.json()["remedy"]
    assert client.get(f"/v1/jobs?limit=1&cursor={following}").json()["items"]


def test_a_prediction_names_no_option_that_it_does_not_have(send):
    implausible = predicted("deg")
    implausible["json"]["cases"] = [CASE | {"force": [0, 0, -5e5]}]
    (reason, *_) = send(implausible).json()["assessment"]["reasons"]
    assert reason["code"] == "prediction_implausible"
    assert "accept_verdict" not in reason["remedy"]


def test_a_place_of_a_target_that_was_not_read_is_named(client):
    measured = CAMPAIGN["measurement_set"]
    answer = posted(
        client, CAMPAIGN | {"measurement_set": measured | {"flange_targets": {"T9": [0, 0, 0.1]}}}
    )
    assessment = answer["result"]["assessment"]
    (reason,) = [each for each in assessment["reasons"] if each["code"] == "target_name_suspect"]
    assert "'T9', but no observation reads these" in reason["message"]
    right = posted(client, CAMPAIGN)["result"]["assessment"]["reasons"]
    assert "target_name_suspect" not in [each["code"] for each in right]


@pytest.mark.parametrize("path", ["/v1/campaigns", "/v1/measurement-sets"])
def test_too_large_a_campaign_is_not_to_be_split(client, path):
    """Two runs of half a campaign are not one run: the remedy is the library."""
    refused = client.request("POST", path, content=b" " * (MAX_SET_BYTES + 1), headers=JSON)
    problem = refused.json()
    assert (refused.status_code, problem["detail"]) == (413, "the body exceeds 8192 KiB")
    assert problem["remedy"] == USE_ARRAYS
    assert "split" not in problem["remedy"]


def test_an_id_of_a_deleted_resource_of_another_kind_is_not_explained(client):
    """What no reader sees is not told."""
    robot = client.request("POST", "/v1/robots", json=CAMPAIGN["robot"] | {"name": "to be deleted"}).json()[
        "id"
    ]
    client.request("PATCH", f"/v1/robots/{robot}", json={"deleted": True})
    refused = client.request("GET", f"/v1/measurement-sets/{robot}").json()
    assert refused["detail"] == f"there is no measurement set '{robot}'"
