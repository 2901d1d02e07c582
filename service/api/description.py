"""The OpenAPI 3.1 description of the service: each message has one shape, and what repeats is stated once."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

from fastapi import FastAPI

from jointstiff.schemas.fields import Page
from jointstiff.schemas.finding import Problem
from jointstiff.service.api.examples import ANSWERS

Node = dict[str, Any]

_PROBLEMS: Final[dict[int | str, str]] = {
    400: "The client disconnected before its body was complete.",
    404: "The resource does not exist.",
    409: "The resource's state does not allow this; see `remedy`.",
    413: "The body is too large.",
    415: "The body has the wrong Content-Type.",
    422: "The request is invalid: `where` names the field, `remedy` says what to do.",
    507: "The database has reached its quota.",
    "default": "401 without a valid key; 403 where its role does not allow this, or a page of another "
    "site requested a change; 429 where the queue is full, or too many wrong keys were sent; 503 while the "
    "database is not available; or another error.",
}
_OF_ALL_ROUTES: Final[frozenset[int | str]] = frozenset({422, "default"})
_OF_BODIES: Final = frozenset({400, 404, 413, 415})  # a body may name what is not there
_FULL: Final = 507
_EVENTS: Final = "text/event-stream"
_FORM: Final = "multipart/form-data"
_PAGE: Final = f"{Page.__name__}_"  # Pydantic's names of pages, such as `Page_JobSummary_`
_VALUES: Final = frozenset({"enum", "const"})  # all values of a type, among which null would have to be


class DescribedApplication(FastAPI):
    """FastAPI with a description that validators accept and generators of clients understand.

    A key is described as optional, as a service may demand none, except in operations of admins.
    """

    def openapi(self) -> Node:
        """Return the OpenAPI description, which is built at the first call."""
        if self.openapi_schema is None:
            document = _without_titles(super().openapi())
            for path, method, operation in _operations(document):
                _summarise_operation(operation)
                _add_problems(path, method, operation)
                _state_events(operation)
                needed = operation.get("security", [])
                if needed and {} not in needed and needed[0]["key"] != ["admin"]:
                    operation["security"] = [{}, *needed]
            _place_forms(document)
            _show_answers(document)
            _drop_unused(document)
            _require_all_of_answers(document)
            _inline_pages(document)
            _share_components(document)
            self.openapi_schema = _shorten_nullable_types(document)
        return self.openapi_schema


def problems(*statuses: int) -> dict[int | str, Node]:
    """Describe errors that a route may answer with in addition to those of all routes."""
    return {status: _describe_problem(status) for status in statuses}


def _describe_problem(status: int | str) -> Node:
    """Return the OpenAPI response of a problem with a status."""
    schema = {"$ref": f"#/components/schemas/{Problem.__name__}"}
    return {"description": _PROBLEMS[status], "content": {"application/problem+json": {"schema": schema}}}


def _operations(document: Node) -> Iterator[tuple[str, str, Node]]:
    """Yield path, method and description of each operation."""
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            yield path, method, operation


def _without_titles(node: Any, *, names: bool = False) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a description without the titles that Pydantic makes of the names of fields."""
    if isinstance(node, dict):
        return {
            key: _without_titles(value, names=key == "properties")
            for key, value in node.items()
            if names or key != "title" or not isinstance(value, str) or "version" in node
        }
    return [_without_titles(each) for each in node] if isinstance(node, list) else node


def _summarise_operation(operation: Node) -> None:
    """Take the first sentence of an operation's description for its summary."""
    first, _, rest = operation["description"].partition("\n\n")
    sentence, stop, more = " ".join(first.split()).partition(". ")
    operation["summary"] = sentence.removesuffix(".") + "."
    if text := "\n\n".join(filter(None, [more if stop else "", rest])):
        operation["description"] = text
    else:
        del operation["description"]


def _add_problems(path: str, method: str, operation: Node) -> None:
    """Add to an operation the problems that it may answer with, by its address, method and body."""
    statuses: set[int | str] = set(_OF_ALL_ROUTES)
    if "requestBody" in operation:
        statuses |= _OF_BODIES
    if "{" in path:
        statuses |= {404} if method == "get" else {404, 409}
    if "201" in operation["responses"] and "security" in operation:
        statuses.add(_FULL)
    answers = operation["responses"] | {str(status): _describe_problem(status) for status in statuses}
    operation["responses"] = dict(sorted(answers.items()))


def _state_events(operation: Node) -> None:
    """Describe streams of events as plain text, as OpenAPI 3.1 does not know FastAPI's `itemSchema`."""
    for answer in operation["responses"].values():
        if _EVENTS in answer.get("content", {}):
            answer["content"][_EVENTS] = {"schema": {"type": "string"}}


def _place_forms(document: Node) -> None:
    """Move the schema of each form into the operation that accepts the form."""
    schemas = document["components"]["schemas"]
    for *_, operation in _operations(document):
        content = operation.get("requestBody", {}).get("content", {})
        if _FORM in content:
            content[_FORM]["schema"] = schemas.pop(content[_FORM]["schema"]["$ref"].rpartition("/")[2])


def _inline_pages(document: Node) -> None:
    """Move the schema of each page of a listing into the answer of its only operation."""
    schemas = document["components"]["schemas"]
    for *_, operation in _operations(document):
        for answer in operation["responses"].values():
            stated = answer.get("content", {}).get("application/json", {})
            name = stated.get("schema", {}).get("$ref", "").rpartition("/")[2]
            if name.startswith(_PAGE):
                stated["schema"] = schemas.pop(name)


def _shorten_nullable_types(node: Any) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a description with `type: [X, null]` in place of `anyOf` of X and null."""
    if isinstance(node, list):
        return [_shorten_nullable_types(each) for each in node]
    if not isinstance(node, dict):
        return node
    match node.get("anyOf"):
        case [{"type": str(kind)} as typed, {"type": "null"}] if not _VALUES & typed.keys():
            rest = {key: value for key, value in node.items() if key != "anyOf"}
            if not typed.keys() & rest.keys():
                node = {**typed, "type": [kind, "null"], **rest}
    return {key: _shorten_nullable_types(value) for key, value in node.items()}


def _show_answers(document: Node) -> None:
    """Add the recorded examples to the answers of the operations that users meet first, such as a run."""
    for *_, operation in _operations(document):
        if (example := ANSWERS.get(operation["operationId"])) is not None:
            status = next(each for each in operation["responses"] if each.startswith("2"))
            operation["responses"][status]["content"]["application/json"]["example"] = example


def _schemas_used(document: Node, *roots: Node) -> set[str]:
    """Return the names of the schemas that `roots`, parts of a description, use directly or indirectly."""
    schemas, waiting, found = document["components"]["schemas"], list(roots), set[str]()
    while waiting:
        names = set(re.findall(r'"#/components/schemas/(\w+)"', json.dumps(waiting.pop()))) - found
        found |= names
        waiting += [schemas[name] for name in names]
    return found


def _drop_unused(document: Node) -> None:
    """Drop schemas that no operation uses, such as those of fields whose form is not promised."""
    schemas, used = document["components"]["schemas"], _schemas_used(document, document["paths"])
    document["components"]["schemas"] = {name: schemas[name] for name in schemas if name in used}


def _require_all_of_answers(document: Node) -> None:
    """Mark every field of schemas that only answers use as required: the service always sends all fields."""
    schemas = document["components"]["schemas"]
    bodies = [operation.get("requestBody", {}) for *_, operation in _operations(document)]
    for name in schemas.keys() - _schemas_used(document, *bodies):
        if "properties" in schemas[name]:
            schemas[name]["required"] = list(schemas[name]["properties"])


def _share_components(document: Node) -> None:
    """Move problems, and parameters that several operations share, to the components; refer to them."""
    shared: dict[str, Node] = {"parameters": {}, "responses": {}}
    every = list(_operations(document))
    for stated in (one for *_, each in every for one in each.get("parameters", ())):
        stated["schema"].pop("description", None)  # FastAPI writes it with the parameter, too
    used = Counter(
        json.dumps(one, sort_keys=True) for *_, each in every for one in each.get("parameters", ())
    )
    for *_, operation in every:
        for i, stated in enumerate(operation.get("parameters", ())):
            if used[json.dumps(stated, sort_keys=True)] > 1:
                name = "".join(word.title() for word in re.findall(r"[a-z]+", stated["name"]))
                if shared["parameters"].setdefault(name, stated) == stated:
                    operation["parameters"][i] = {"$ref": f"#/components/parameters/{name}"}
        for status in operation["responses"].keys() & set(map(str, _PROBLEMS)):
            name = f"Problem{status.title()}"
            shared["responses"][name] = operation["responses"][status]
            operation["responses"][status] = {"$ref": f"#/components/responses/{name}"}
    document["components"] |= {kind: dict(sorted(stated.items())) for kind, stated in shared.items()}
