"""Files of jobs over HTTP: names, tags, headers; programs that are sent again; deletion in order."""

import json
from urllib.parse import quote, unquote

import numpy as np
import pytest
from support.api import DELETE, RESTORE, file_at, job_at, post
from support.documents import campaign, changed
from support.kinds import TEXT
from support.programs import options
from support.refusals import told

POSTED = campaign()
FILES = "tables.json, report.pdf, report.html, model.csv, model.xlsx, model.mjcf, joints.csv, residuals.csv"


@pytest.fixture(scope="module")
def run(local):
    return post(local, "/v1/campaigns", POSTED)


def addresses_of(local, run):
    """Return the addresses of a run, its measurement set, and its robot."""
    set_id = run["request"]["measurement_set_id"]
    robot = local.get(f"/v1/measurement-sets/{set_id}").json()["robot_id"]
    return [f"/v1/jobs/{run['id']}", f"/v1/measurement-sets/{set_id}", f"/v1/robots/{robot}"]


@pytest.mark.parametrize(
    ("name", "reason", "remedy"),
    [
        *(
            (name, "a run has no such file", f"use one of {FILES}")
            for name in ("nothing", "model.step", "report.docx", "%00")
        ),
    ],
)
def test_a_file_that_there_is_not_is_answered_with_those_that_there_are(local, run, name, reason, remedy):
    assert told(local.get(file_at(run, name))) == f"404 | {reason} | {remedy}"


@pytest.mark.parametrize("name", ["", "../x", "../model.csv"])
def test_an_address_without_a_file_is_answered_with_the_description(local, run, name):
    answer = told(local.get(file_at(run, name)))
    assert answer.startswith(f"404 | there is no address /v1/jobs/{run['id']}/")
    assert answer.endswith(" | GET /openapi.json describes all addresses")


@pytest.mark.parametrize(
    "place", ["run", "set", "robot", "tables.json", "model.csv", "report.html", "report.pdf"]
)
def test_who_has_a_document_is_told_so(local, run, place):
    documents = dict(zip(("run", "set", "robot"), addresses_of(local, run), strict=True))
    address = documents.get(place) or file_at(run, place)
    first = local.get(address)
    tag = first.headers["etag"]
    for known in (tag, tag.removeprefix("W/"), f'"other", {tag}', "*"):
        answer = local.get(address, headers={"If-None-Match": known})
        assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", tag), known
    for known in ('"other"', ""):
        answer = local.get(address, headers={"If-None-Match": known})
        assert (answer.status_code, answer.headers["etag"]) == (200, tag), known
        assert answer.content == first.content


def test_a_new_name_is_a_new_document(local, run):
    robot = addresses_of(local, run)[2]
    tag = local.get(robot).headers["etag"]
    assert local.request("PATCH", robot, json={"name": "another name"}).status_code == 200
    assert local.get(robot, headers={"If-None-Match": tag}).status_code == 200


NOTHING_ELSE = "default-src 'none'; frame-ancestors 'none'"


@pytest.mark.parametrize(
    ("name", "media_type", "disposition"),
    [
        ("report.pdf", "application/pdf", "inline; NAME%20stiffness.pdf"),
        ("report.html", "text/html; charset=utf-8", "inline; NAME%20stiffness.html"),
        ("model.mjcf", "application/xml", "attachment; NAME%20model%20ID.mjcf"),
        ("joints.csv", "text/csv; charset=utf-8", "attachment; NAME%20run%20joints%20ID.csv"),
        ("tables.json", "application/json", None),
    ],
)
def test_browsers_show_reports_and_save_the_rest_and_load_nothing(local, run, name, media_type, disposition):
    answer = local.get(file_at(run, name))
    assert answer.headers["content-type"] == media_type
    name_of_set = quote(POSTED["measurement_set"]["name"])
    day = run["provenance"]["created_at"][:10]
    disposition = disposition and disposition.replace("ID", run["id"][:8])
    expected = disposition and disposition.replace("NAME", f"filename*=UTF-8''{name_of_set}%20{day}")
    assert answer.headers.get("content-disposition") == expected
    policy = answer.headers["content-security-policy"]
    if name == "report.html":  # its own pictures, and the one style sheet whose hash is stated
        assert policy.startswith(
            "default-src 'none'; img-src data:; frame-ancestors 'none'; style-src 'sha256-"
        )
        assert "unsafe" not in policy
    else:
        assert policy == NOTHING_ELSE
    assert local.get(file_at(run, name)).content == answer.content


def test_a_file_has_a_name_that_people_can_file(local):
    """Serial number, set, day of the measurement and content, without what a file system refuses."""
    measured = {
        **POSTED["measurement_set"],
        "name": "press / cell: 7?",
        "serial_number": "F-2110",
        "measured_at": "2026-09-21T09:00:00Z",
    }
    run = post(local, "/v1/campaigns", POSTED | {"measurement_set": measured})
    for name, shown in (("report.pdf", "stiffness.pdf"), ("joints.csv", f"run joints {run['id'][:8]}.csv")):
        disposition = local.get(file_at(run, name)).headers["content-disposition"]
        assert unquote(disposition).endswith(f"''F-2110 press - cell- 7 2026-09-21 {shown}")


@pytest.mark.parametrize("mark", [True, False])
def test_a_corrected_program_is_not_corrected_again_but_the_program_itself_may_be(local, run, mark):
    def sent(text):
        stated = json.dumps(options("krl", mark=mark) | {"run_id": run["id"]})
        form = {"files": [("files", ("cell.src", text.encode("latin-1")))], "data": {"options": stated}}
        return local.request("POST", "/v1/corrections", **form)

    made = sent(TEXT)
    job = made.json()
    assert (made.status_code, made.headers["location"]) == (201, f"/v1/jobs/{job['id']}")
    contents = [
        each["content"] for part in (job["result"]["program"], job["request"]) for each in part["files"]
    ]
    assert contents == [None, None]
    corrected = local.get(file_at(job, "program"))
    assert corrected.headers["content-type"] == "application/octet-stream"
    assert corrected.headers["content-disposition"] == "attachment; filename*=UTF-8''cell-corrected.src"
    assert ("; Jointstiff run " in corrected.text) == mark
    assert told(sent(corrected.text)) == (
        f"422 | files | a file of the request is the output of the correction "
        f"'{job['id']}' | send the original program"
    )
    assert sent(TEXT).status_code == 201
    named = local.get(file_at(job, "program"), params={"file": "cell.src"})
    assert (named.status_code, named.content) == (200, corrected.content)
    assert (
        told(local.get(file_at(job, "program"), params={"file": "cell.dat"}))
        == "422 | query.file | the correction has no such file | use one of cell.src"
    )


def test_a_run_without_an_observation_is_that_of_a_set_without_it(local, run):
    robot = addresses_of(local, run)[2].rpartition("/")[2]
    document = POSTED["measurement_set"] | {"robot_id": robot}
    observations = json.loads(json.dumps(document["observations"]))
    label = observations[4]["label"]
    observations[4]["readings"][0]["loaded"][0] += 2e-3  # the target was bumped

    def identified(observations, **more):
        made = post(local, "/v1/measurement-sets", document | {"observations": observations})
        return post(local, "/v1/runs", {"measurement_set_id": made["id"]} | more)

    left = identified(observations, leave_out=[label])
    shorter = identified(observations[:4] + observations[5:])
    of_left, of_shorter = (
        [joint["compliance"] for joint in each["result"]["joints"]] for each in (left, shorter)
    )
    assert np.allclose(of_left, of_shorter, rtol=1e-12, atol=0.0)
    assert left["provenance"]["input_hash"] == shorter["provenance"]["input_hash"]
    assert label not in {each["observation"] for each in left["result"]["residuals"]}
    assert label not in str(left["result"]["warnings"])


def test_a_campaign_is_deleted_from_its_end_and_brought_back_from_its_beginning(local, run):
    mine = post(
        local,
        "/v1/campaigns",
        changed(campaign(configurations=8), ("robot.name", "of this campaign alone")),
    )
    addresses = addresses_of(local, mine)
    at_run, at_set, at_robot = [job_at(mine), *addresses[1:]]
    set_id, robot_id = (address.rpartition("/")[2] for address in addresses[1:])

    def patched(address, body):
        return local.request("PATCH", address, json=body)

    used = f"is used by measurement set {set_id}, run {mine['id']}"
    delete_first = "delete these resources first"
    assert told(patched(at_robot, DELETE)) == f"409 | the robot '{robot_id}' {used} | {delete_first}"
    of_run = f"the measurement set '{set_id}' is used by run {mine['id']}"
    assert told(patched(at_set, DELETE)) == f"409 | {of_run} | {delete_first}"
    shown = [local.get(address).json() for address in addresses]
    names = (f"job '{mine['id']}'", f"measurement set '{set_id}'", f"robot '{robot_id}'")
    for address, at, name in zip(addresses, (at_run, at_set, at_robot), names, strict=True):
        first, again = (patched(at, DELETE) for _ in range(2))
        assert (first.status_code, again.status_code) == (200, 200)
        assert first.json() == again.json()
        gone = f'404 | the {name} was deleted | restore it with PATCH {at} {{"deleted": false}}'
        assert told(local.get(address)) == gone
        assert told(local.get(address, headers={"If-None-Match": "*"})) == gone
        listing, _, identifier = address.rpartition("/")
        listed = [
            identifier in local.get(listing, params={"deleted": deleted, "limit": 100}).text
            for deleted in ("false", "true")
        ]
        assert listed == [False, True]
    lost = f"the run '{mine['id']}' was deleted"
    restore = f'restore it with PATCH {at_run} {{"deleted": false}}'
    assert told(local.get(file_at(mine, "tables.json"))) == f"404 | {lost} | {restore}"
    answer = local.request("POST", "/v1/runs", json={"measurement_set_id": set_id})
    assert told(answer) == (
        f"422 | measurement_set_id | the measurement set '{set_id}' was deleted | "
        f'restore it with PATCH {at_set} {{"deleted": false}}'
    )
    answer = local.request("POST", "/v1/comparisons", json={"run_ids": [run["id"], mine["id"]]})
    assert told(answer) == f"422 | run_ids[1] | {lost} | {restore}"
    assert told(patched(at_run, RESTORE)) == (
        f"404 | the robot '{robot_id}' was deleted | restore it with PATCH {at_robot} {{\"deleted\": false}}"
    )
    for at in (at_robot, at_set, at_run):
        assert patched(at, RESTORE).status_code == 200
    assert [local.get(address).json() for address in addresses] == shown
