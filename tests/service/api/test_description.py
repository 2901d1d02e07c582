"""The OpenAPI description: valid, complete, and with sentences."""

import json
import re

import pytest
from fastapi.routing import iter_route_contexts
from openapi_spec_validator import OpenAPIV31SpecValidator
from support.in_process import Client

from jointstiff.schemas.access import Health
from jointstiff.schemas.fields import Page
from jointstiff.schemas.job import JobSummary
from jointstiff.schemas.live import LiveOptions, MeasurementSet, MeasurementSetPost
from jointstiff.schemas.measurement import SetChange
from jointstiff.schemas.robot import Robot
from jointstiff.schemas.run import Run, RunRequest
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
    described, known = {}, {}
    for path, method, operation in operations(openapi):
        stated = operation.get("parameters", ())
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


def parts(node):
    """Every object of a JSON document."""
    if isinstance(node, dict):
        yield node
    for each in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from parts(each)


SYSTEM = """\
    Action Activator Array Attribute Boolean Buffer Byte Char Console Convert Cookie DateOnly DateTime Decimal
    Delegate Double Enum Enumerable Environment Exception Guid Half HttpContent Index IPAddress Math Nullable
    Object Random Range Single String TimeOnly TimeSpan Tuple Type Uri Version"""
"""Names of classes without type parameters in `System`, `System.Linq` and `System.Net`."""


class TestRulesOfOpenapiGenerator:
    """What `openapi-generator validate --recommend` (7.26) finds fault with, or its generators warn of."""

    def test_each_reference_leads_to_a_component_and_each_component_is_used(self, openapi):
        references = {each["$ref"] for each in parts(openapi) if isinstance(each.get("$ref"), str)}
        references |= {
            each
            for part in parts(openapi)
            for each in part.get("discriminator", {}).get("mapping", {}).values()
        }
        components = {
            f"#/components/{kind}/{name}"
            for kind, named in openapi["components"].items()
            if kind != "securitySchemes"
            for name in named
        }
        assert references == components

    def test_a_client_in_csharp_has_no_name_twice_and_no_constant_but_texts(self, openapi):
        """Its files use `System` and `System.Net`: a message of the same name is ambiguous there."""
        assert not set(SYSTEM.split()).intersection(openapi["components"]["schemas"])
        constants = [[each["const"]] if "const" in each else each.get("enum", []) for each in parts(openapi)]
        stated = [value for values in constants if isinstance(values, list) for value in values]
        assert stated
        assert all(isinstance(value, str) for value in stated)

    def test_an_operation_has_a_name_of_its_own_and_its_parameters_of_the_path(self, openapi):
        names = [each["operationId"] for *_, each in operations(openapi)]
        assert len(set(names)) == len(names)
        for path, method, each in operations(openapi):
            stated = each.get("parameters", ())
            in_path = {one["name"] for one in stated if one["in"] == "path" and one["required"]}
            assert in_path == set(re.findall(r"\{(\w+)\}", path)), (method, path)
            assert not [one["name"] for one in stated if one["in"] == "header" and "_" in one["name"]]
            assert "requestBody" not in each or method not in {"get", "head", "delete"}

    def test_the_field_that_tells_alternatives_apart_is_required(self, openapi):
        schemas = openapi["components"]["schemas"]
        discriminators = [each["discriminator"] for each in parts(schemas) if "discriminator" in each]
        assert len(discriminators) >= 5
        for each in discriminators:
            for value, reference in each["mapping"].items():
                message = schemas[reference.rpartition("/")[2]]
                assert each["propertyName"] in message["required"]
                assert message["properties"][each["propertyName"]]["const"] == value

    def test_no_message_has_the_name_of_a_type_of_the_languages(self, openapi):
        taken = {
            "Set",
            "Date",
            "Array",
            "Object",
            "String",
            "Number",
            "Error",
            "Record",
            "Promise",
            "Task",
        }
        assert not taken & openapi["components"]["schemas"].keys()


@pytest.mark.parametrize(
    "name",
    ["RunRequest", "RunOptions", "PlanRequest", "MeasurementSetPost", "SetChange", "CorrectionRequest"],
)
def test_a_request_refuses_fields_that_are_not_described(name, openapi):
    assert openapi["components"]["schemas"][name]["additionalProperties"] is False


def test_a_message_has_all_the_fields_of_its_class(openapi):
    for message in (
        Run,
        RunRequest,
        Robot,
        MeasurementSet,
        MeasurementSetPost,
        LiveOptions,
        SetChange,
    ):
        schema = openapi["components"]["schemas"][message.__name__]
        assert schema["properties"].keys() == message.model_fields.keys()


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


@pytest.mark.parametrize("name", ["job_id", "robot_id", "set_id"])
def test_an_id_in_an_address_says_of_what_it_is(openapi, name):
    stated = [each for *_, operation in operations(openapi) for each in operation.get("parameters", ())]
    described = [each["description"] for each in stated if (each["in"], each["name"]) == ("path", name)]
    assert described
    assert all(each.startswith("Id of the ") for each in described)


def test_each_operation_has_a_sentence_for_its_summary(openapi):
    for path, method, operation in operations(openapi):
        assert re.fullmatch(r"[A-Z][^\n]+\.", operation["summary"]), (method, path)
        assert operation.get("description", "").split(". ")[0] != operation["summary"]


def test_every_field_of_what_only_answers_have_is_required(openapi):
    schemas = openapi["components"]["schemas"]
    for name in ("RunResult", "Run", "Problem", "JointResult"):
        assert set(schemas[name]["required"]) == schemas[name]["properties"].keys()
        assert "additionalProperties" not in schemas[name]
    assert schemas["RunRequest"]["required"] == ["measurement_set_id"]
