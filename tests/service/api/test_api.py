"""The API as a client sees it: its description and contract, refusals, kinematics, and the page."""

import asyncio
import copy
import math
import re
import time
import uuid
import zlib
from concurrent.futures import ThreadPoolExecutor
from itertools import count

import httpx2
import pytest
from fastapi import FastAPI
from hypothesis import HealthCheck, Phase
from support.api import CANCEL, EITHER_DATABASE, job_at, post
from support.examples import examples, is_full

from jointstiff.schemas.deflection import DeflectionRequest
from jointstiff.schemas.finding import Problem
from jointstiff.schemas.live import MeasurementSetPost
from jointstiff.schemas.options import MAX_REPETITIONS
from jointstiff.schemas.robot import RobotRequest
from jointstiff.schemas.run import Campaign
from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.service.api.page import install_page
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


@pytest.mark.parametrize(
    ("request_", "where"),
    [
        ({"method": "best"}, "method"),
        ({"resampling": {"size": 9}}, "resampling.size"),
        ({"resampling": {"size": 5, "repetitions": MAX_REPETITIONS + 1}}, "resampling.repetitions"),
        ({"wait": 61}, "query.wait"),
    ],
)
def test_runs_are_refused_with_the_place_and_nothing_stored(client, readings, request_, where):
    set_id, wait = post(client, "/v1/measurement-sets", readings)["id"], request_.get("wait", 1)
    body = {"measurement_set_id": set_id} | request_
    body.pop("wait", None)
    problem = post(client, f"/v1/runs?wait={wait}", body, 422)
    assert problem["where"] == where
    assert problem["remedy"]
    assert client.get("/v1/runs", params={"measurement_set_id": set_id}).json()["items"] == []


@EITHER_DATABASE
@pytest.mark.parametrize("collection", ["robots", "measurement-sets"])
def test_the_same_key_gives_one_resource(client, campaign, readings, collection):
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


def test_a_span_that_ends_before_it_begins_is_refused(local):
    span = {"measured_from": "2026-11-21T00:00:00Z", "measured_to": "2026-11-20T00:00:00Z"}
    answer = local.get("/v1/measurement-sets", params=span)
    assert answer.status_code == 422
    assert "after" in answer.text


TWO_LINKS = {
    "name": "two links",
    "model": {
        "format": "dh",
        "convention": "standard",
        "rows": [
            {"a": 1.0, "alpha": 0.0, "d": 0.5, "theta": 0.0},
            {"a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0},
        ],
    },
}


def test_two_links_stand_where_trigonometry_puts_them(client):
    first, second = 0.3, 0.4
    answer = client.post("/v1/kinematics", json={"robot": TWO_LINKS, "joints": [[first, second]]}).json()
    (posture,) = answer["postures"]
    elbow = (math.cos(first), math.sin(first), 0.5)
    tip = (elbow[0] + 0.5 * math.cos(first + second), elbow[1] + 0.5 * math.sin(first + second), 0.5)
    # An axis is a line: the origin of joint 1 may lie anywhere along it.
    assert posture["joint_origins"][0][:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert posture["joint_origins"][1][:2] == pytest.approx(elbow[:2], abs=1e-12)
    assert posture["joint_axes"] == [[0, 0, 1], [0, 0, 1]]
    assert posture["flange_origin"] == pytest.approx(tip, abs=1e-12)
    heading = (math.cos(first + second), math.sin(first + second), 0.0)
    assert posture["flange_axes"][0] == pytest.approx(heading, abs=1e-12)


def test_a_stored_robot_is_the_same_as_the_one_that_was_posted(client):
    robot_id = client.post("/v1/robots", json=TWO_LINKS).json()["id"]
    joints = [[0.1, 0.2], [-1.0, 2.0]]
    stored = client.post("/v1/kinematics", json={"robot_id": robot_id, "joints": joints}).json()
    assert stored == client.post("/v1/kinematics", json={"robot": TWO_LINKS, "joints": joints}).json()
    assert len(stored["postures"]) == 2


@pytest.mark.parametrize(
    "name",
    ["/v1/robots", "/v1/measurement-sets", *(f"/v1/{kind.collection}" for kind in KINDS if not kind.is_form)],
)
def test_bodies_and_errors_are_described(name, openapi):
    operation = openapi["paths"][name]["post"]
    content = operation["requestBody"]["content"]["application/json"]
    assert content["examples"]
    assert content["schema"]["$ref"].split("/")[-1] in openapi["components"]["schemas"]
    assert {"201", "413", "415", "422"} <= operation["responses"].keys()
    assert operation["description"]


def test_examples_are_valid():
    for model, documented in (
        (RobotRequest, EXAMPLES["robots"]),
        (Campaign, EXAMPLES["campaigns"]),
        (MeasurementSetPost, EXAMPLES["measurement_sets"]),
        (DeflectionRequest, EXAMPLES["deflections"]),
        *((kind.request, kind.examples) for kind in KINDS if not kind.is_form),
    ):
        for example in documented.values():
            model.model_validate(example)


EXTRA = {"/v1/runs/{run_id}/apply", "/v1/runs/{run_id}/authorisations"}
"""Addresses of runs that no other kind has."""
kinds = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


@kinds
def test_every_kind_has_its_operations_by_short_names(kind, openapi):
    paths, one = openapi["paths"], f"/v1/{kind.collection}/{{{kind.name}_id}}"
    name, all_ = kind.name.capitalize(), kind.collection.capitalize()
    expected = {
        (f"/v1/{kind.collection}", "post"): f"create{name}",
        (f"/v1/{kind.collection}", "get"): f"list{all_}",
        (one, "get"): f"get{name}",
    }
    for (path, method), operation in expected.items():
        assert paths[path][method]["operationId"] == operation
        assert paths[path][method]["description"]
    assert {path for path in paths if path.startswith(f"/v1/{kind.collection}")} - EXTRA == {
        path for path, _ in expected
    }
    (listed,) = [p for p in paths[one]["get"]["parameters"] if p["in"] == "path"]
    assert listed["name"] == f"{kind.name}_id"


@kinds
def test_every_filter_is_a_field_of_the_summary(kind):
    filters = kind.query.model_fields.keys() - {"limit", "cursor", "deleted"}  # these choose the page
    assert filters <= kind.summary.model_fields.keys()


def test_the_api_is_small(openapi):
    assert sum(map(len, openapi["paths"].values())) <= 55


def test_what_all_jobs_share_is_described_once(openapi):
    one = openapi["paths"]["/v1/jobs/{job_id}"]
    assert {"200", "404", "409"} <= one["patch"]["responses"].keys()
    assert {"204", "404", "409"} <= one["delete"]["responses"].keys()
    files = openapi["paths"]["/v1/jobs/{job_id}/files/{name}"]["get"]
    for kind in KINDS:
        for name in (*(file.name for file in kind.files), *(["report.pdf"] if kind.reported else [])):
            assert f"`{name}`" in files["description"]


def test_requests_need_what_has_no_default_and_answers_have_everything(openapi):
    """Clients generated from the description post what the docs post, and read without asking for absence."""
    schemas = openapi["components"]["schemas"]
    assert schemas["RunRequest-Input"]["required"] == ["measurement_set_id"]
    for name in ("RunRequest-Output", "Run", "Problem", "MeasurementSet"):
        assert set(schemas[name]["required"]) == set(schemas[name]["properties"]), name


def test_operations_have_short_names_and_a_server(openapi):
    assert openapi["servers"] == [{"url": "/", "description": "This service"}]
    names = [each["operationId"] for path in openapi["paths"].values() for each in path.values()]
    assert len(set(names)) == len(names)
    others = {"listRobots", "getRobot", "createMeasurementSet", "followJob", "createImport", "getHealth"}
    assert others <= set(names)
    assert all(name.isalpha() for name in names)


def test_numbers_carry_their_unit(openapi):
    schemas = openapi["components"]["schemas"]
    for name in ("compliance", "stiffness", "standard_uncertainty", "compliance_interval"):
        assert schemas["JointResult"]["properties"][name]["unit"], name
    assert schemas["RunResult"]["properties"]["rms_residual"]["unit"] == "m"
    assert schemas["DhRow-Input"]["properties"]["alpha"]["unit"] == "rad"


PAGES = ("/", "/v1", "/openapi.json", "/favicon.svg", "/assets/nothing")


@pytest.fixture(scope="session")
def addresses(openapi) -> dict[str, set[str]]:
    """The methods of each address, as described; those of the page beside them."""
    described = {
        re.sub(r"\{\w+\}", "nothing", path): {name.upper() for name in methods}
        for path, methods in openapi["paths"].items()
    }
    taken = described | {path: {"GET"} for path in PAGES}
    return {path: taken[path] | {"OPTIONS", *(["HEAD"] if "GET" in taken[path] else [])} for path in taken}


def allowed(answer: httpx2.Response) -> set[str]:
    return set(answer.headers["allow"].split(", "))


def test_options(client, addresses):
    for address, methods in addresses.items():
        answer = client.options(address)
        assert (answer.status_code, answer.content) == (204, b""), address
        assert allowed(answer) == methods, address


def test_head_is_get_without_content(client, addresses):
    for address, methods in addresses.items():
        head = client.head(address)
        assert head.content == b"", address
        if "GET" not in methods:
            assert head.status_code == 405, address
            assert allowed(head) == methods, address
            continue
        get = client.get(address)
        assert head.status_code == get.status_code, address
        assert lasting(head, address) == lasting(get, address), address


def lasting(answer: httpx2.Response, address: str) -> dict[str, str]:
    """Return the headers that two requests share; /health may have another length a moment later."""
    passing = {"date", "x-request-id"} | ({"content-length"} if address == "/health" else set())
    return {name: value for name, value in answer.headers.items() if name not in passing}


def test_head_of_a_stream_ends(client):
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=5)
    resampling = {"size": 5, "repetitions": 100_000, "seed": 1}
    asked = campaign | {"run": {"resampling": resampling}}
    address = client.post("/v1/campaigns?wait=0", json=asked).headers["location"]
    head = client.head(f"{job_at(address)}/events")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-type"].startswith("text/event-stream")
    assert client.get("/health").status_code == 200
    assert client.patch(job_at(address), json=CANCEL).status_code == 200


PARTS = 24
"""Each part takes every 24th operation; its cases are made when it runs."""
STRIDE = 5
"""By day every fifth case at the bounds of fields is sent, of thousands; each night all of them."""


@pytest.mark.process
@pytest.mark.parametrize(
    ("part", "service"),
    [
        pytest.param(part, database, marks=pytest.mark.slow if database == "postgresql" else ())
        for database in ("postgresql", "sqlite")
        for part in range(PARTS)
    ],
    indirect=["service"],
)
def test_the_service_keeps_its_contract(part, service, openapi):
    import requests
    import schemathesis
    from schemathesis.checks import not_a_server_error
    from schemathesis.generation.meta import TestPhase
    from schemathesis.pytest.lazy import get_all_tests
    from schemathesis.specs.openapi import checks

    promised = [
        not_a_server_error,
        checks.status_code_conformance,
        checks.content_type_conformance,
        checks.response_schema_conformance,
    ]

    session = requests.Session()
    session.trust_env = False  # a look at all variables for each case

    bounds, stride = count(), 1 if is_full() else STRIDE

    @examples(60, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
    def keeps(case):
        if case.meta.phase.name is TestPhase.COVERAGE and next(bounds) % stride:
            return
        case.call_and_validate(base_url=service.url, session=session, checks=promised, timeout=60)

    schema = schemathesis.openapi.from_dict(openapi)
    labels = [each.ok().label for each in schema.get_all_operations()][part::PARTS]
    for each in get_all_tests(
        schema=schema.include(name=labels), test_func=keeps, settings=None, given_kwargs={}
    ):
        each.ok()[1]()
    session.close()


def test_page_has_a_strict_policy_and_no_inline_code(client):
    answer = client.get("/")
    assert answer.status_code == 200, answer.text
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\bstyle=|\bon\w+=", answer.text)
    assert not re.search(r"(src|href)=\"(https?:)?//", answer.text)


def test_files_of_the_page_are_served_for_ever_and_are_not_sniffed(client):
    page = client.get("/").text
    files = re.findall(r"(?:src|href)=\"\./(assets/[^\"]+)\"", page)
    assert files
    for file in files:
        answer = client.get(f"/{file}")
        assert answer.status_code == 200
        assert "immutable" in answer.headers["cache-control"]
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_page_and_documentation_that_were_not_built_say_so(tmp_path):
    app = FastAPI()
    install_page(app, tmp_path, tmp_path / "docs")

    async def ask(path):
        async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://page") as client:
            return await client.get(path)

    with ThreadPoolExecutor(1) as own_loop:  # the browser's tests leave one running in this thread
        page, docs = (own_loop.submit(lambda p=p: asyncio.run(ask(p))).result() for p in ("/", "/docs/"))
    assert page.status_code == 503
    assert "scripts/setup" in page.text
    assert docs.status_code == 404
    assert "scripts/docs" in docs.text
    assert 'href="../openapi.json"' in docs.text


def test_files_of_the_page_are_packed_for_browsers_that_take_it(client):
    file = re.findall(r"src=\"\./(assets/[^\"]+)\"", client.get("/").text)[0]
    with client.stream("GET", f"/{file}", headers={"Accept-Encoding": "gzip"}) as answer:
        assert answer.headers["content-encoding"] == "gzip"
        assert "javascript" in answer.headers["content-type"]
        assert answer.headers["vary"] == "Accept-Encoding"
        packed = b"".join(answer.iter_raw())
    plain = client.get(f"/{file}", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert zlib.decompress(packed, 31) == plain.content
    assert len(packed) < len(plain.content) / 2
