"""What the API takes as it is written, and what it refuses with a reason."""

import codecs
import csv
import gzip
import json
import re
from typing import Literal, get_args, get_origin

import pytest
from fastapi.routing import iter_route_contexts
from pydantic import ValidationError
from support.in_process import Client, description
from typing_extensions import TypeAliasType

from jointstiff.schemas import query
from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import JobChange
from jointstiff.schemas.trend import TrendQuery
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.app import all_routes
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.store.store import Store
from jointstiff.service.tables.files import csv_text
from jointstiff.service.tables.table import Sheet

JSON = {"Content-Type": "application/json"}
ROBOT = json.dumps(EXAMPLES["robots"]["modified DH"]).encode()
TRUE_TO_OTHERS = (1, 0, 1.0, 0.0, "true", "false", "yes", "1")


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with Store.open(f"sqlite:///{tmp_path_factory.mktemp('strict') / 'jointstiff.db'}") as store:
        yield Client(store)


def messages():
    assert KINDS  # their messages are imported
    found, waiting = [], [Message]
    while waiting:
        waiting += (message := waiting.pop()).__subclasses__()
        found.append(message)
    ours = [each for each in found if each.__module__.startswith("jointstiff.")]
    ours = [each for each in ours if not each.__name__.startswith("_")]  # no request has a private message
    # A parameter of an address is text. Queries, and the parts of queries that their module has.
    queries = declared_queries()
    parts = {base for each in queries for base in each.__mro__ if base.__module__ == query.__name__}
    return [each for each in ours if each not in queries | parts]


def declared_queries():
    """The messages that routes declare by `Query()`."""
    waiting = [context.original_route.dependant for context in iter_route_contexts(list(all_routes()))]
    found = set()
    while waiting:
        dependant = waiting.pop()
        waiting += dependant.dependencies
        annotations = [parameter.field_info.annotation for parameter in dependant.query_params]
        found |= {each for each in annotations if isinstance(each, type) and issubclass(each, Message)}
    assert TrendQuery in found
    return found


def boolean_parameters():
    """Address and name of each parameter of the API that is true or false."""
    shared = description()["components"].get("parameters", {})
    return [
        (re.sub(r"\{\w+\}", "nothing", path), parameter["name"])
        for path, operations in description()["paths"].items()
        for each in operations.get("get", {}).get("parameters", ())
        for parameter in [shared[each["$ref"].split("/")[-1]] if "$ref" in each else each]
        if parameter["in"] == "query" and "boolean" in json.dumps(parameter["schema"])
    ]


def test_each_parameter_that_is_true_or_false_is_read_from_an_address(client):
    """A robot or job that is not there is 404, once the parameters are read."""
    asked = boolean_parameters()
    assert {name for _, name in asked} >= {"deleted", "details", "positive"}
    for address, name in asked:
        for value in ("true", "false"):
            answer = client.get(f"{address}?{name}={value}")
            assert answer.status_code in {200, 404}, (address, name, value, answer.text)
        assert client.get(f"{address}?{name}=perhaps").status_code == 422


def states_a_boolean(annotation):
    """Return whether true or false, or one of them, is a value of a type."""
    if isinstance(annotation, TypeAliasType):
        return states_a_boolean(annotation.__value__)
    if get_origin(annotation) is Literal:
        return any(isinstance(each, bool) for each in get_args(annotation))
    return annotation is bool or any(map(states_a_boolean, get_args(annotation)))


def test_no_field_of_a_message_takes_a_number_or_a_word_for_a_boolean():
    fields = [
        (message, name)
        for message in messages()
        for name, field in message.model_fields.items()
        if states_a_boolean(field.annotation)
    ]
    assert len(fields) > 30
    assert (JobChange, "cancelled") in fields
    for message, name in fields:
        for value in TRUE_TO_OTHERS:
            with pytest.raises(ValidationError, match="bool"):
                message.__pydantic_validator__.validate_assignment(message.model_construct(), name, value)


@pytest.mark.parametrize("value", TRUE_TO_OTHERS)
def test_what_is_no_boolean_deletes_nothing(client, value):
    created = client.request("POST", "/v1/robots", content=ROBOT, headers=JSON)
    address = created.headers["Location"]
    body = json.dumps({"deleted": value}).encode()
    assert client.request("PATCH", address, content=body, headers=JSON).status_code == 422
    assert client.get(address).status_code == 200


@pytest.mark.parametrize("value", [*TRUE_TO_OTHERS, False])
def test_what_is_no_true_cancels_nothing(value):
    with pytest.raises(ValidationError, match=r"boolean|must be true"):
        JobChange.model_validate_json(json.dumps({"cancelled": value}))
    assert JobChange.model_validate_json('{"cancelled": true}').cancelled is True


def test_json_with_a_byte_order_mark_is_taken(client):
    content = codecs.BOM_UTF8 + ROBOT
    assert client.request("POST", "/v1/robots", content=content, headers=JSON).status_code == 201


@pytest.mark.parametrize("as_file", [True, False])
def test_options_of_a_form_with_a_byte_order_mark_are_taken(client, as_file):
    table = b"name;x [mm];y [mm];z [mm]\nP1;1;2;3\n"
    options = codecs.BOM_UTF8 + b'{"name": "day"}'
    form = {"files": ("a.csv", table), "options": ("options.json" if as_file else None, options)}
    answer = client.request("POST", "/v1/imports", files=form)
    assert answer.status_code < 300, answer.text


@pytest.mark.parametrize("coding", ["gzip", "br", "x"])
def test_a_coded_body_is_refused_with_what_to_do(client, coding):
    headers = JSON | {"Content-Encoding": coding}
    answer = client.request("POST", "/v1/robots", content=gzip.compress(ROBOT), headers=headers)
    assert answer.status_code == 415
    assert "without" in answer.json()["remedy"]


def test_a_body_that_is_cut_says_line_and_column_wherever_it_is_cut(client):
    for end in range(1, len(ROBOT.rstrip()) - 1, 7):
        answer = client.request("POST", "/v1/robots", content=ROBOT[:end], headers=JSON)
        assert answer.status_code == 422
        assert re.search(r"line \d+ column \d+", answer.json()["detail"]), (ROBOT[:end], answer.text)


@pytest.mark.parametrize(
    ("address", "meant"),
    [
        ("/v1/jobs?metod=complete_pose", "method"),
        ("/v1/robots?metod=x", None),
        ("/v1/robots?limt=3", "limit"),
    ],
)
def test_an_unknown_parameter_is_compared_with_those_of_its_route_only(client, address, meant):
    reason = client.get(address).json()["errors"][0]["reason"]
    assert (f"did you mean `{meant}`" in reason) if meant else ("did you mean" not in reason)


def test_every_get_refuses_a_parameter_that_it_does_not_know(client):
    paths = client.get("/openapi.json").json()["paths"]
    answers = {
        path: client.get(re.sub(r"\{\w+\}", "nothing", path) + "?limt=3&colour=red")
        for path, operations in paths.items()
        if "get" in operations
    }
    refused_by_role = {path for path, answer in answers.items() if answer.status_code == 403}
    assert refused_by_role <= {"/v1/keys", "/v1/audit"}
    for path in answers.keys() - refused_by_role:
        places = [fault["where"] for fault in answers[path].json()["errors"]]
        assert (path, answers[path].status_code, places) == (path, 422, ["query.limt", "query.colour"])


def test_every_post_that_names_what_is_not_there_answers_a_status_that_it_declares(client):
    described = client.get("/openapi.json").json()["paths"]
    for path, operations in described.items():
        if "post" not in operations or "application/json" not in operations["post"].get(
            "requestBody", {}
        ).get("content", {}):
            continue
        examples = operations["post"]["requestBody"]["content"]["application/json"].get("examples", {})
        for example in examples.values():
            unknown = re.sub(r"\{\w+\}", "nothing", path)
            answer = client.request(
                "POST", unknown, content=json.dumps(example["value"]).encode(), headers=JSON
            )
            assert str(answer.status_code) in operations["post"]["responses"], (path, answer.text)
        assert "404" in operations["post"]["responses"], path


@pytest.mark.parametrize("formula", ["=1+1", "+1", "@x", "\uff1d1", '"=1+1', "'=1", '" =1', ' ""=1'])
@pytest.mark.parametrize("sign", [";", "\t", "\n", "\r\n", "\r", "; ", '"\n'])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_no_cell_is_a_formula_however_a_spreadsheet_parts_the_table(formula, sign, delimiter):
    """Read by another delimiter, a quoted cell ends at that delimiter and at line ends."""
    text = csv_text(Sheet({"number": ["1"], "name": [f"a{sign}{formula}{sign}b"]}))
    cells = [cell for row in csv.reader(text.splitlines(), delimiter=delimiter) for cell in row]
    assert not [each for each in cells if each.lstrip(' "').startswith(("=", "+", "-", "@", "\uff1d"))], text


@pytest.mark.parametrize("sign", ";\t")
def test_a_formula_behind_a_sign_that_parts_cells_elsewhere_is_guarded(sign):
    text = csv_text(Sheet({"name": [f"arm{sign}=HYPERLINK(1)", f"arm{sign} @x", f"a{sign}b"]}))
    cells = [cell.strip().strip('"') for line in text.splitlines()[1:] for cell in line.split(sign)]
    assert not any(cell.startswith(("=", "+", "-", "@")) for cell in cells), text
    assert f"a{sign}b" in text


def test_a_query_parameter_that_is_given_twice_is_refused_by_name(client):
    """The last one would count, and the first would be ignored."""
    answer = client.get("/v1/robots?limit=1&limit=2")
    assert (answer.status_code, answer.json()["errors"][0]["where"]) == (422, "query.limit")
    assert "more than once" in answer.json()["errors"][0]["reason"]
