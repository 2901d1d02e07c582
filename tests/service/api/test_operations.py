"""Operations: who may do what by operations.txt, methods of addresses, and what is described."""

import json
import re
from collections import defaultdict
from pathlib import Path

import pytest

from jointstiff.schemas.correction import CorrectionRequest
from jointstiff.schemas.deflection import DeflectionRequest
from jointstiff.schemas.job import JobSummary
from jointstiff.schemas.live import MeasurementSetPost
from jointstiff.schemas.query import JobQuery
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.files import file_names
from jointstiff.service.kinds.registry import KINDS

TABLE = (Path(__file__).parent / "operations.txt").read_text(encoding="utf-8").splitlines()
OPERATIONS = {line.partition(" | ")[0]: line for line in TABLE if line.startswith(("GET", "P", "DELETE"))}


def line_of(openapi, path, method):
    """Return what the description says of an operation, as operations.txt has it."""
    operation = openapi["paths"][path][method]
    security = operation.get("security", [{"key": ["anyone"]}])
    assert security[:-1] in ([], [{}])
    (role,) = security[-1]["key"]
    assert (len(security) == 2) == (role in {"viewer", "operator"}), "an open service asks for no key"
    parameters = operation.get("parameters", ())
    bodies = operation.get("requestBody", {}).get("content", {})
    assert bodies.keys() <= {"application/json", "multipart/form-data"}
    messages = [each["schema"].get("$ref", "form").rpartition("/")[2] for each in bodies.values()]
    assert {"422", "default"} <= operation["responses"].keys()
    answers = [each for each in operation["responses"] if each not in {"422", "default"}]
    parts = [operation["operationId"], role, " ".join(each["name"] for each in parameters) or "-"]
    return " | ".join([f"{method.upper()} {path}", *parts, *(messages or ["-"]), " ".join(answers)])


def test_each_operation_needs_the_role_and_takes_what_the_table_says(openapi):
    described = [(path, method) for path, methods in openapi["paths"].items() for method in methods]
    assert sorted(line_of(openapi, *each) for each in described) == sorted(OPERATIONS.values())
    names = [line.split(" | ")[1] for line in OPERATIONS.values()]
    assert len(set(names)) == len(names) == 39
    assert all(name.isalpha() for name in names)


def methods_of():
    """Return the methods of each address of the table, and of those beside it."""
    found = defaultdict(set)
    for each in OPERATIONS:
        method, path = each.split(" ")
        found[path] |= {"OPTIONS", method} | ({"HEAD"} if method == "GET" else set())
    beside = ["/", "/v1", "/openapi.json", "/favicon.svg", "/assets/nothing"]
    return found | {path: {"GET", "HEAD", "OPTIONS"} for path in beside}


@pytest.mark.parametrize("path", methods_of())
def test_options_names_the_methods_of_an_address_and_head_is_get_without_content(path, local):
    address = re.sub(r"\{\w+\}", "nothing", path)
    options, head, get = (local.request(method, address) for method in ("OPTIONS", "HEAD", "GET"))
    allowed = ", ".join(sorted(methods_of()[path]))
    assert (options.status_code, options.content, options.headers["allow"]) == (204, b"", allowed)
    assert (head.status_code, head.content) == (get.status_code, b"")
    without_id = [
        {name: value for name, value in each.headers.items() if name != "x-request-id"}
        for each in (head, get)
    ]
    assert without_id[0] == without_id[1]
    if "GET" not in methods_of()[path]:
        assert (head.status_code, head.headers["allow"]) == (405, allowed)


def test_the_description_names_the_service_and_where_to_begin(openapi, local):
    assert openapi["info"]["title"] == "Jointstiff"
    assert openapi["servers"] == [{"url": "/", "description": "This service"}]
    begun = local.get("/v1").json()
    assert begun.pop("version") == openapi["info"]["version"]
    assert begun == {
        "name": "Jointstiff",
        "description": "/openapi.json",
        "health": "/health",
        "jobs": "/v1/jobs",
    }


FILES = """\
* `model.…` of a run: tables with intervals (csv, xlsx), or MJCF with springs; `do_not_use` needs
* `program` of the correction of a program: a corrected file (`file`); only numbers of its targets differ
* tables, by the kind of the job; their headers have the units
* geometry: `axes.csv` (each axis: a point, the direction, and the uncertainties of both, in the base frame R0 at model angle zero)
* plan: `report.pdf`, `report.html`, `readings.csv` (the readings in their order)
"""  # noqa: E501 - lines of the description


@pytest.mark.parametrize("line", FILES.splitlines())
def test_the_description_names_each_file_of_each_kind(line, openapi):
    said = openapi["paths"]["/v1/jobs/{job_id}/files/{name}"]["get"]["description"]
    assert line in said.splitlines()


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_description_names_each_file_once(kind, openapi):
    said = openapi["paths"]["/v1/jobs/{job_id}/files/{name}"]["get"]["description"].splitlines()
    (line,) = [each for each in said if each.startswith(f"* {kind.name}: ")]
    names = [name for name in file_names(kind) if name != "tables.json"]
    assert all(line.count(f"`{name}`") == 1 for name in names)
    assert sum("`tables.json`" in each for each in said) == 1


UNITS = {
    "JointResult": {
        "rad/(N.m)": {"compliance", "own_compliance", "standard_uncertainty", "compliance_interval"},
        "N.m/rad": {"stiffness", "stiffness_interval", "stiffness_at_least"},
    },
    "RunResult": {"m": {"rms_residual", "sigma", "characteristic_length"}, "1": {"huber_threshold"}},
    "DhRow": {"m": {"a", "d"}, "rad": {"alpha", "theta", "lower", "upper"}, "rad/s": {"speed"}},
}


@pytest.mark.parametrize("name", UNITS)
def test_a_number_carries_its_unit(name, openapi):
    found = defaultdict(set)
    for field, described in openapi["components"]["schemas"][name]["properties"].items():
        if "unit" in described:
            found[described["unit"]].add(field)
    assert found == UNITS[name]


EXAMPLES_OF = {
    RobotDocument: EXAMPLES["robots"],
    Campaign: EXAMPLES["campaigns"],
    MeasurementSetPost: EXAMPLES["measurement_sets"],
    DeflectionRequest: EXAMPLES["deflections"],
    CorrectionRequest: EXAMPLES["corrections"],
} | {kind.request: kind.examples for kind in KINDS if not kind.is_form}


@pytest.mark.parametrize("message", EXAMPLES_OF, ids=lambda message: message.__name__)
def test_the_examples_of_a_request_are_valid_and_described(message, openapi):
    for example in EXAMPLES_OF[message].values():
        message.model_validate(example)
    described = json.dumps(openapi["paths"])
    for name in EXAMPLES_OF[message]:
        assert json.dumps(name) in described


def test_jobs_are_filtered_by_fields_of_their_summary():
    filters = JobQuery.model_fields.keys() - {"limit", "cursor", "q", "sort", "deleted"}
    assert filters <= JobSummary.model_fields.keys()
