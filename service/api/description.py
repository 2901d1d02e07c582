"""The OpenAPI 3.1 description of the service, as FastAPI writes it, with this API's problems and examples."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, Final

from fastapi import FastAPI

from jointstiff.schemas.finding import Problem
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
_REFERENCE: Final = re.compile(r'"#/components/schemas/(\w+)"')
_ABSENT: Final = frozenset({("Progress", "waits")})  # fields of answers that may be absent


class DescribedApplication(FastAPI):
    """FastAPI with a description that validators accept and generators of clients understand.

    A key is described as optional, because a service may need none, except in operations of admins.
    """

    def openapi(self) -> Node:
        """Return the OpenAPI description, which is built at the first call."""
        if self.openapi_schema is None:
            document = super().openapi()
            for path, method, operation in _iterate_operations(document):
                _summarise_operation(operation)
                _add_problem_responses(path, method, operation)
                _describe_events_as_text(operation)
                # An empty requirement `{}` describes the key as optional; operations of admins need a key.
                security = operation.get("security", [])
                if security and {} not in security and security[0]["key"] != ["admin"]:
                    operation["security"] = [{}, *security]
            _add_example_answers(document)
            _drop_unused_schemas(document)
            _describe_answers(document)
            _require_discriminators(document, document["components"]["schemas"])
            self.openapi_schema = document
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


def _summarise_operation(operation: Node) -> None:
    """Move the first sentence of an operation's `description` to its field `summary`."""
    paragraph, _, rest = operation["description"].partition("\n\n")
    sentence, has_more, rest_of_paragraph = " ".join(paragraph.split()).partition(". ")
    operation["summary"] = sentence.removesuffix(".") + "."
    if text := "\n\n".join(filter(None, [rest_of_paragraph if has_more else "", rest])):
        operation["description"] = text
    else:
        del operation["description"]


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


def _add_example_answers(document: Node) -> None:
    """Add the recorded examples to the answers of the operations that users meet first, such as a run."""
    for *_, operation in _iterate_operations(document):
        if (example := ANSWERS.get(operation["operationId"])) is not None:
            status = next(code for code in operation["responses"] if code.startswith("2"))
            operation["responses"][status]["content"]["application/json"]["example"] = example


def _drop_unused_schemas(document: Node) -> None:
    """Remove the schemas that no operation uses, such as that of a field without a promised form."""
    schemas = document["components"]["schemas"]
    used = _find_used_schemas(document["paths"], schemas)
    document["components"]["schemas"] = {name: schemas[name] for name in schemas if name in used}


def _describe_answers(document: Node) -> None:
    """Describe the schemas that no request uses: all fields but `_ABSENT` are sent, others may be added."""
    bodies = [operation.get("requestBody", {}) for *_, operation in _iterate_operations(document)]
    schemas = document["components"]["schemas"]
    for name in schemas.keys() - _find_used_schemas(bodies, schemas):
        schema = schemas[name]
        schema.pop("additionalProperties", None)
        if "properties" in schema:
            schema["required"] = [field for field in schema["properties"] if (name, field) not in _ABSENT]


def _find_used_schemas(part: Any, schemas: Node) -> set[str]:  # noqa: ANN401 - any part of a JSON document
    """Return the names of the schemas that a part of a description uses, also through other schemas."""
    used_names = set[str]()
    to_search = [part]
    while to_search:
        new_names = set(_REFERENCE.findall(json.dumps(to_search.pop()))) - used_names
        used_names |= new_names
        to_search += [schemas[name] for name in new_names]
    return used_names


def _require_discriminators(node: Any, schemas: Node) -> None:  # noqa: ANN401 - any part of a JSON document
    """Mark the fields that tell the alternatives of a union apart as required, as generators demand."""
    if isinstance(node, list):
        for each in node:
            _require_discriminators(each, schemas)
    if not isinstance(node, dict):
        return
    if "discriminator" in node:
        field = node["discriminator"]["propertyName"]
        for reference in node["discriminator"]["mapping"].values():
            schema = schemas[reference.rpartition("/")[2]]
            others = [name for name in schema.get("required", ()) if name != field]
            schema["required"] = [field, *others]
    for each in node.values():
        _require_discriminators(each, schemas)
