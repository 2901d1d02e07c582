"""The OpenAPI description: valid, small, and with sentences."""

import json
import re

import pytest
from fastapi.routing import iter_route_contexts
from openapi_spec_validator import OpenAPIV31SpecValidator
from support.in_process import Client

from jointstiff.schemas.access import Health
from jointstiff.schemas.fields import Page
from jointstiff.schemas.job import JobSummary
from jointstiff.schemas.run import Run
from jointstiff.service.api.answers import query_names
from jointstiff.service.app import create_app
from jointstiff.service.store.store import Store


def operations(document):
    return [
        (path, method, operation)
        for path, verbs in document["paths"].items()
        for method, operation in verbs.items()
    ]


def test_an_invalid_request_builds_no_description(monkeypatch):
    """To build it takes seconds, in which a service would answer nobody."""
    with Store.open("sqlite://") as store:
        client = Client(store)
        monkeypatch.setattr(client._app, "openapi", lambda: pytest.fail("the description was built"))
        answer = client.get("/v1/jobs?limt=3")
    assert answer.status_code == 422
    assert "did you mean `limit`" in answer.json()["errors"][0]["reason"]


def test_a_route_knows_the_query_parameters_that_are_described(openapi):
    shared, described, known = openapi["components"]["parameters"], {}, {}
    for path, method, operation in operations(openapi):
        stated = [
            shared[each["$ref"].rpartition("/")[2]] if "$ref" in each else each
            for each in operation.get("parameters", ())
        ]
        described[path, method] = {each["name"] for each in stated if each["in"] == "query"}
    with Store.open("sqlite://") as store:
        for context in iter_route_contexts(create_app(store).routes):
            for method in getattr(context.original_route, "methods", ()):
                if (place := (context.path, method.lower())) in described:
                    known[place] = set(query_names(context.original_route.dependant))
    assert known == described
    assert sum(map(len, known.values())) > 20


def test_validators_of_openapi_take_the_description(openapi):
    assert openapi["openapi"].startswith("3.1.")
    assert [error.message for error in OpenAPIV31SpecValidator(openapi).iter_errors()] == []


def test_the_description_is_small(openapi):
    """Few operations, one message for one thing: an integrator reads it in an afternoon."""
    assert len(operations(openapi)) <= 42
    assert len(openapi["components"]["schemas"]) <= 170
    assert len(json.dumps(openapi, ensure_ascii=False, separators=(",", ":")).encode()) <= 300_000


def test_a_value_that_may_be_null_names_null_in_its_type(openapi):
    text = json.dumps(openapi)
    assert not re.search(
        r'"anyOf": \[\{"type": "(number|string|integer|boolean)"\}, \{"type": "null"\}\]', text
    )
    length = openapi["components"]["schemas"]["RunOptions"]["properties"]["characteristic_length"]
    assert (length["type"], length["minimum"]) == (["number", "null"], 0.001)


def test_a_page_is_stated_where_it_is_answered(openapi):
    answered = [
        answer.get("content", {}).get("application/json", {}).get("schema", {})
        for *_, operation in operations(openapi)
        for answer in operation["responses"].values()
    ]
    pages = [each for each in answered if "next" in each.get("properties", ())]
    assert [set(page["required"]) for page in pages] == [{"items", "next", "total"}] * 4
    assert not [name for name in openapi["components"]["schemas"] if name.startswith("Page")]


def test_examples_of_answers_are_answers(openapi):
    shown = {
        each["operationId"]: answer["content"]["application/json"]["example"]
        for *_, each in operations(openapi)
        for answer in each["responses"].values()
        if "example" in answer.get("content", {}).get("application/json", {})
    }
    Run.model_validate(shown.pop("createCampaign"))
    Page[JobSummary].model_validate(shown.pop("listJobs"))
    Health.model_validate(shown.pop("getHealth"))
    assert shown == {}


def test_nothing_of_openapi_3_2_is_in_the_description(openapi):
    assert "itemSchema" not in json.dumps(openapi)


def test_each_message_has_one_shape(openapi):
    names = openapi["components"]["schemas"].keys()
    assert [name for name in names if name.endswith(("-Input", "-Output"))] == []


@pytest.mark.parametrize("name", ["JobId", "RobotId", "SetId"])
def test_an_id_in_an_address_says_of_what_it_is(openapi, name):
    assert openapi["components"]["parameters"][name]["description"].startswith("Id of the ")


def test_each_operation_has_a_sentence_for_its_summary(openapi):
    for path, method, operation in operations(openapi):
        assert re.fullmatch(r"[A-Z][^\n]+\.", operation["summary"]), (method, path)
        assert operation.get("description", "").split(". ")[0] != operation["summary"]


def test_every_field_of_what_only_answers_have_is_required(openapi):
    schemas = openapi["components"]["schemas"]
    for name in ("RunResult", "Run", "Problem", "JointResult"):
        assert sorted(schemas[name]["required"]) == sorted(schemas[name]["properties"])
    assert schemas["RunRequest"]["required"] == ["measurement_set_id"]


@pytest.mark.parametrize("kind", ["parameters", "responses"])
def test_what_repeats_is_stated_once(openapi, kind):
    references = re.findall(rf'"#/components/{kind}/(\w+)"', json.dumps(openapi["paths"]))
    assert set(references) == openapi["components"][kind].keys()
    assert all(references.count(name) > 1 for name in references)
