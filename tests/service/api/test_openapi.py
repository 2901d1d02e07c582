"""The OpenAPI description: names, units, examples that hold; HEAD, OPTIONS and Allow as it says."""

import re

import httpx2
import pytest
from support.api import CANCEL, job_at

from jointstiff.schemas.deflection import DeflectionRequest
from jointstiff.schemas.live import MeasurementSetPost
from jointstiff.schemas.robot import RobotRequest
from jointstiff.schemas.run import Campaign
from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.service.kinds.registry import KINDS
from jointstiff.simulator import default_arm, simulate_campaign


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
