"""The OpenAPI description: valid, small, and with sentences."""

import json
import re

import pytest
from openapi_spec_validator import OpenAPIV31SpecValidator


def operations(document):
    return [
        (path, method, operation)
        for path, verbs in document["paths"].items()
        for method, operation in verbs.items()
    ]


def test_validators_of_openapi_take_the_description(openapi):
    assert openapi["openapi"].startswith("3.1.")
    assert [error.message for error in OpenAPIV31SpecValidator(openapi).iter_errors()] == []


def test_nothing_of_openapi_3_2_is_in_the_description(openapi):
    assert "itemSchema" not in json.dumps(openapi)


def test_each_message_has_one_shape(openapi):
    names = openapi["components"]["schemas"].keys()
    assert [name for name in names if name.endswith(("-Input", "-Output"))] == []


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
