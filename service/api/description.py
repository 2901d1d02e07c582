"""The OpenAPI 3.1 description of the service: one schema for each message, and repeated parts stated once."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

from fastapi import FastAPI

from jointstiff.schemas.fields import Page
from jointstiff.schemas.finding import Problem
from jointstiff.service.api.compact import (
    drop_implied_bounds,
    find_answer_schemas,
    find_used_schemas,
    inline_small_answers,
    name_parts,
    open_answers,
    require_discriminators,
    share_fields,
    shorten_numbers,
)
from jointstiff.service.api.examples import ANSWERS

Node = dict[str, Any]

_PROBLEMS: Final[dict[int | str, str]] = {
    404: "The resource does not exist.",
    409: "The resource's state does not allow this; see `remedy`.",
    422: "The request is invalid: `where` names the field, `remedy` says what to do.",
    "default": "400: the body ended too early. 401: no valid key. 403: the role does not allow this, or a "
    "page of another site requested a change. 413: the body is too large. 415: wrong Content-Type. 429: the "
    "queue is full, or many wrong keys were sent. 503: the database is unavailable. 507: its quota is full.",
}
_STATUSES_OF_ALL_ROUTES: Final[frozenset[int | str]] = frozenset({422, "default"})
# 404: a body may contain the id of a resource that does not exist.
_STATUSES_OF_BODIES: Final = frozenset({404})
_EVENTS: Final = "text/event-stream"
_FORM: Final = "multipart/form-data"
_PAGE: Final = f"{Page.__name__}_"  # Pydantic's names of pages, such as `Page_JobSummary_`
_ABSENT: Final = frozenset({("Progress", "waits")})  # fields of answers that may be absent
_VALUE_KEYWORDS: Final = frozenset({"enum", "const"})  # they list all values, and would exclude null


class DescribedApplication(FastAPI):
    """FastAPI with a description that validators accept and generators of clients understand.

    A key is described as optional, because a service may need none, except in operations of admins.
    """

    def openapi(self) -> Node:
        """Return the OpenAPI description, which is built at the first call."""
        if self.openapi_schema is None:
            document = _drop_titles(super().openapi())
            for path, method, operation in _iterate_operations(document):
                _summarise_operation(operation)
                _shorten_successes(operation)
                _add_problem_responses(path, method, operation)
                _describe_events_as_text(operation)
                # An empty requirement `{}` describes the key as optional; operations of admins need a key.
                security = operation.get("security", [])
                if security and {} not in security and security[0]["key"] != ["admin"]:
                    operation["security"] = [{}, *security]
            _inline_forms(document)
            _add_example_answers(document)
            _drop_unused_schemas(document)
            _require_all_answer_fields(document)
            _inline_pages(document)
            require_discriminators(document)
            share_fields(document)
            open_answers(document)
            _share_components(document)
            document = drop_implied_bounds(_shorten_nullable_types(document))
            inline_small_answers(document)
            self.openapi_schema = shorten_numbers(name_parts(document))
        return self.openapi_schema


def describe_problems(*statuses: int) -> dict[int | str, Node]:
    """Return OpenAPI responses, by status, for errors of a route that not every route can have."""
    return {status: _describe_problem(status) for status in statuses}


def _describe_problem(status: int | str) -> Node:
    """Return the OpenAPI response for an error with this HTTP status; its body is a `Problem`."""
    schema = {"$ref": f"#/components/schemas/{Problem.__name__}"}
    return {"description": _PROBLEMS[status], "content": {"application/problem+json": {"schema": schema}}}


def _iterate_operations(document: Node) -> Iterator[tuple[str, str, Node]]:
    """Yield path, method and description of each operation."""
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            yield path, method, operation


def _drop_titles(node: Any, *, names: bool = False) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a description without the titles that Pydantic makes from the names of fields.

    With `names`, the keys of this part are names of fields, and a field may be called `title`. The title of
    the API itself, next to its `version`, is kept.
    """
    if isinstance(node, dict):
        return {
            key: _drop_titles(value, names=key == "properties")
            for key, value in node.items()
            if names or key != "title" or not isinstance(value, str) or "version" in node
        }
    return [_drop_titles(item) for item in node] if isinstance(node, list) else node


def _summarise_operation(operation: Node) -> None:
    """Move the first sentence of an operation's `description` to its field `summary`."""
    paragraph, _, rest = operation["description"].partition("\n\n")
    sentence, has_more, rest_of_paragraph = " ".join(paragraph.split()).partition(". ")
    operation["summary"] = sentence.removesuffix(".") + "."
    if text := "\n\n".join(filter(None, [rest_of_paragraph if has_more else "", rest])):
        operation["description"] = text
    else:
        del operation["description"]


def _shorten_successes(operation: Node) -> None:
    """Replace the words with which FastAPI describes the answers of an operation that describes none."""
    for answer in operation["responses"].values():
        if answer["description"] == "Successful Response":
            answer["description"] = "Success."


def _add_problem_responses(path: str, method: str, operation: Node) -> None:
    """Add to an operation the error responses that follow from its address, its method and its body."""
    statuses: set[int | str] = set(_STATUSES_OF_ALL_ROUTES)
    if "requestBody" in operation:
        statuses |= _STATUSES_OF_BODIES
    if "{" in path:
        statuses |= {404} if method == "get" else {404, 409}
    responses = operation["responses"] | {str(status): _describe_problem(status) for status in statuses}
    operation["responses"] = dict(sorted(responses.items()))


def _describe_events_as_text(operation: Node) -> None:
    """Describe streams of events as plain text, as OpenAPI 3.1 does not know FastAPI's `itemSchema`."""
    for answer in operation["responses"].values():
        if _EVENTS in answer.get("content", {}):
            answer["content"][_EVENTS] = {"schema": {"type": "string"}}


def _inline_forms(document: Node) -> None:
    """Move the schema of each form from the shared components into the operation that accepts the form."""
    schemas = document["components"]["schemas"]
    for *_, operation in _iterate_operations(document):
        content = operation.get("requestBody", {}).get("content", {})
        name = content.get(_FORM, {}).get("schema", {}).get("$ref", "").rpartition("/")[2]
        if name:
            content[_FORM]["schema"] = schemas.pop(name)


def _inline_pages(document: Node) -> None:
    """Move the schema of each page of a list from the shared components into the only answer that uses it."""
    schemas = document["components"]["schemas"]
    for *_, operation in _iterate_operations(document):
        for answer in operation["responses"].values():
            json_content = answer.get("content", {}).get("application/json", {})
            name = json_content.get("schema", {}).get("$ref", "").rpartition("/")[2]
            if name.startswith(_PAGE):
                json_content["schema"] = schemas.pop(name)
                json_content["schema"].pop("additionalProperties", None)  # as in other answers


def _shorten_nullable_types(node: Any) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a description with `type: [X, null]` in place of `anyOf` of X and null."""
    if isinstance(node, list):
        return [_shorten_nullable_types(item) for item in node]
    if not isinstance(node, dict):
        return node
    match node.get("anyOf"):
        case [{"type": str(type_name)} as type_schema, {"type": "null"}] if (
            not _VALUE_KEYWORDS & type_schema.keys()
        ):
            other_keywords = {key: value for key, value in node.items() if key != "anyOf"}
            if not type_schema.keys() & other_keywords.keys():
                node = {**type_schema, "type": [type_name, "null"], **other_keywords}
    return {key: _shorten_nullable_types(value) for key, value in node.items()}


def _add_example_answers(document: Node) -> None:
    """Add the recorded examples to the answers of the operations that users meet first, such as a run."""
    for *_, operation in _iterate_operations(document):
        if (example := ANSWERS.get(operation["operationId"])) is not None:
            status = next(code for code in operation["responses"] if code.startswith("2"))
            operation["responses"][status]["content"]["application/json"]["example"] = example


def _drop_unused_schemas(document: Node) -> None:
    """Remove from the components the schemas that no operation refers to."""
    schemas = document["components"]["schemas"]
    used = find_used_schemas(document, document["paths"])
    document["components"]["schemas"] = {name: schemas[name] for name in schemas if name in used}


def _require_all_answer_fields(document: Node) -> None:
    """Mark the fields of schemas that only answers use as required: the service sends all but `_ABSENT`."""
    schemas = document["components"]["schemas"]
    for name in find_answer_schemas(document):
        if "properties" in schemas[name]:
            schemas[name]["required"] = [
                field for field in schemas[name]["properties"] if (name, field) not in _ABSENT
            ]


def _share_components(document: Node) -> None:
    """Move parameters and answers that several operations have, headers and errors to the shared components.

    In the operations, references (`$ref`) replace these responses and parameters.
    """
    shared: dict[str, Node] = {"parameters": _share_parameters(document), "responses": {}, "headers": {}}
    for *_, operation in _iterate_operations(document):
        for answer in operation["responses"].values():
            for name, header in answer.get("headers", {}).items():
                shared["headers"][name] = header
                answer["headers"][name] = {"$ref": f"#/components/headers/{name}"}
        for status in operation["responses"].keys() & set(map(str, _PROBLEMS)):
            name = f"Problem{status.title()}"
            shared["responses"][name] = operation["responses"][status]
            operation["responses"][status] = {"$ref": f"#/components/responses/{name}"}
    shared["responses"] |= _share_answers(document)
    document["components"] |= {kind: dict(sorted(components.items())) for kind, components in shared.items()}


def _share_answers(document: Node) -> Node:
    """Move answers with a message that several operations have out of them; return the answers by name."""
    shared: Node = {}
    answers = [
        (operation["responses"], status, answer)
        for *_, operation in _iterate_operations(document)
        for status, answer in operation["responses"].items()
        if "$ref" in answer.get("content", {}).get("application/json", {}).get("schema", {})
    ]
    uses = Counter(json.dumps(answer, sort_keys=True) for *_, answer in answers)
    for responses, status, answer in answers:
        name = answer["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
        if uses[json.dumps(answer, sort_keys=True)] > 1 and shared.setdefault(name, answer) == answer:
            responses[status] = {"$ref": f"#/components/responses/{name}"}
    return shared


def _share_parameters(document: Node) -> Node:
    """Move parameters that several operations use out of the operations; return these parameters by name."""
    shared: Node = {}
    lists = [operation.get("parameters", []) for *_, operation in _iterate_operations(document)]
    for parameter in (parameter for parameters in lists for parameter in parameters):
        parameter["schema"].pop("description", None)  # FastAPI writes it with the parameter, too
        match parameter["schema"].get("anyOf"):
            case [dict(schema), {"type": "null"}]:  # null cannot be sent in an address or a header
                del parameter["schema"]["anyOf"]
                parameter["schema"] |= schema
        if not parameter["required"]:
            del parameter["required"]  # the default of OpenAPI
    uses = Counter(json.dumps(parameter, sort_keys=True) for parameters in lists for parameter in parameters)
    for parameters in lists:
        for index, parameter in enumerate(parameters):
            name = "".join(word.title() for word in re.findall(r"[a-z]+", parameter["name"]))
            if uses[json.dumps(parameter, sort_keys=True)] > 1 and (
                shared.setdefault(name, parameter) == parameter
            ):
                parameters[index] = {"$ref": f"#/components/parameters/{name}"}
    return shared
