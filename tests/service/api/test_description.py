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
    assert len(operations(openapi)) <= 41
    # 150, nine of gearboxes, five of logs of a motion, two of arms and marks of a robot, and the job of
    # corrections, the grounds of a campaign's statements, and a planned weight step
    assert len(openapi["components"]["schemas"]) <= 166
    # 260,000 bytes less 10,000 for turned paths, 6,000 for `POST /v1/corrections` with its columns and
    # statuses, 14,000 for gearboxes with their examples, 7,300 for logs of a
    # motion, 2,200 for arms, marks and references of a robot, and
    # 400 for gearbox and structure apart; 2,300 for the job of corrections, the form with their table, and
    # their files; 800 for grounds of statements, less 500 for the least mistakes of causes; 400 for the
    # weight step of an import, 300 for `same_cell` in comparisons and trends, 200 for causes of the path of
    # the load; 1,000 for planned weight steps, 800 for targets from the wrist centre,
    # 400 for the target at the hook, 300 for what the controller did between two readings,
    # 700 for the check of the solver in the health, 500 for what the force is known by,
    # 14,200 for descriptions that are understood alone: whole sentences, repeated nouns, the frame R0 named.
    assert len(json.dumps(openapi, ensure_ascii=False, separators=(",", ":")).encode()) <= 302_000


def parts(node):
    """Every object of a JSON document."""
    if isinstance(node, dict):
        yield node
    for each in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from parts(each)


def bases_of(schema):
    """The names of the messages whose fields a message has, too."""
    return [each["$ref"].rpartition("/")[2] for each in schema.get("allOf", ()) if "$ref" in each]


def whole(schema, openapi):
    """The fields of a message, with those of its bases, and the names of those that it requires."""
    schemas = openapi["components"]["schemas"]
    all_parts = [schema, *(each for each in schema.get("allOf", ()) if "$ref" not in each)]
    fields = {name: value for part in all_parts for name, value in part.get("properties", {}).items()}
    required = {name for part in all_parts for name in part.get("required", ())}
    for base in bases_of(schema):
        inherited, required_there = whole(schemas[base], openapi)
        fields, required = inherited | fields, required | required_there
    return fields, required


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

    def test_a_message_of_a_union_requires_its_discriminator_where_it_describes_it(self, openapi):
        schemas = openapi["components"]["schemas"]
        for union in (
            each["discriminator"] for each in parts(openapi) if "mapping" in each.get("discriminator", {})
        ):
            for reference in union["mapping"].values():
                message = schemas[reference.rpartition("/")[2]]
                own = next(each for each in [*message.get("allOf", ()), message] if "properties" in each)
                assert union["propertyName"] in own["required"], reference

    def test_an_operation_has_a_name_of_its_own_and_its_parameters_of_the_path(self, openapi):
        names = [each["operationId"] for *_, each in operations(openapi)]
        assert len(set(names)) == len(names)
        shared = openapi["components"]["parameters"]
        for path, method, each in operations(openapi):
            stated = [
                shared[one["$ref"].rpartition("/")[2]] if "$ref" in one else one
                for one in each.get("parameters", ())
            ]
            in_path = {one["name"] for one in stated if one["in"] == "path" and one["required"]}
            assert in_path == set(re.findall(r"\{(\w+)\}", path)), (method, path)
            assert not [one["name"] for one in stated if one["in"] == "header" and "_" in one["name"]]
            assert "requestBody" not in each or method not in {"get", "head", "delete"}

    def test_alternatives_have_no_fields_beside_them(self, openapi):
        for each in parts(openapi["components"]["schemas"]):
            if isinstance(each.get("oneOf", each.get("anyOf")), list):
                assert "properties" not in each

    def test_the_field_that_tells_alternatives_apart_is_required(self, openapi):
        schemas = openapi["components"]["schemas"]
        discriminators = [each["discriminator"] for each in parts(schemas) if "discriminator" in each]
        assert len(discriminators) >= 5
        for each in discriminators:
            for value, reference in each["mapping"].items():
                fields, required = whole(schemas[reference.rpartition("/")[2]], openapi)
                assert each["propertyName"] in required
                assert fields[each["propertyName"]]["const"] == value

    def test_no_message_has_the_name_of_a_type_of_the_languages(self, openapi):
        taken = {
            "Map",
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
        named = {each["title"] for each in parts(openapi["components"]) if isinstance(each.get("title"), str)}
        assert not taken & (openapi["components"]["schemas"].keys() | named)

    def test_no_part_of_a_message_refuses_the_fields_of_the_whole(self, openapi):
        """`additionalProperties` knows only the fields next to it, not those of `allOf`."""
        schemas = openapi["components"]["schemas"]
        names, heirs = list(schemas), {name: each for name, each in schemas.items() if "allOf" in each}
        assert len(heirs) >= 12
        for name, each in heirs.items():
            assert each.keys() <= {"allOf", "description", "required", "unevaluatedProperties"}
            for base in bases_of(each):
                assert "additionalProperties" not in schemas[base]
                assert names.index(base) < names.index(name), "openapi-python-client reads it first"


@pytest.mark.parametrize(
    "name", ["RunRequest", "PlanRequest", "MeasurementSetPost", "SetChange", "ProgramRequest"]
)
def test_a_request_refuses_fields_that_are_not_described(name, openapi):
    schema = openapi["components"]["schemas"][name]
    assert schema.get("unevaluatedProperties", schema.get("additionalProperties")) is False


def test_the_options_of_a_fleet_refuse_fields_that_are_not_described(openapi):
    assert (
        openapi["components"]["schemas"]["FleetRequest"]["properties"]["run"]["unevaluatedProperties"]
        is False
    )


def test_a_message_has_all_the_fields_of_its_class(openapi):
    """Whether they are its own or those of a message that others are made of, too."""
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
        assert whole(schema, openapi)[0].keys() == message.model_fields.keys()


def test_a_value_that_may_be_null_names_null_in_its_type(openapi):
    text = json.dumps(openapi)
    assert not re.search(
        r'"anyOf": \[\{"type": "(number|string|integer|boolean)"\}, \{"type": "null"\}\]', text
    )
    length = openapi["components"]["schemas"]["RunOptions"]["properties"]["characteristic_length"]
    assert (length["type"], length["minimum"]) == (["number", "null"], 0.001)


def test_no_bound_is_implied_by_another(openapi):
    for each in parts(openapi["components"]["schemas"]):
        assert not isinstance(each.get("exclusiveMinimum"), int) or "minimum" not in each
        assert not isinstance(each.get("maximum"), float) or not each["maximum"].is_integer()
    assert openapi["components"]["schemas"]["Quantity"] == {
        "type": "number",
        "minimum": -1_000_000_000_000,
        "maximum": 1_000_000_000_000,
    }
    cut = openapi["components"]["schemas"]["Cut"]["properties"]
    assert (cut["diameter"]["exclusiveMinimum"], cut["exponent"]["minimum"]) == (0, 0)


def test_a_message_within_a_field_that_is_described_has_no_second_description(openapi):
    messages = openapi["components"]["schemas"]
    described = [
        field
        for message in messages.values()
        for field in message.get("properties", {}).values()
        if "description" in field and "title" in field.get("items", {})
    ]
    assert described
    assert not any("description" in field["items"] for field in described)


def test_an_answer_of_several_statuses_is_stated_once(openapi):
    answers = openapi["paths"]["/v1/plans"]["post"]["responses"]
    assert answers["201"] == answers["202"] == {"$ref": "#/components/responses/Plan"}
    stated = openapi["components"]["responses"]["Plan"]
    assert stated["content"]["application/json"]["schema"]["$ref"].endswith("/Plan")
    assert stated["headers"].keys() == {"Location"}


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
    for name in ("RunResult", "Run", "Problem", "JointResult", "Job"):
        fields, required = whole(schemas[name], openapi)
        assert required == fields.keys()
    assert whole(schemas["RunRequest"], openapi)[1] == {"measurement_set_id"}


@pytest.mark.parametrize("kind", ["parameters", "responses", "headers"])
def test_what_repeats_is_stated_once(openapi, kind):
    references = re.findall(rf'"#/components/{kind}/(\w+)"', json.dumps(openapi["paths"]))
    assert set(references) == openapi["components"][kind].keys()
    assert all(references.count(name) > 1 for name in references)
