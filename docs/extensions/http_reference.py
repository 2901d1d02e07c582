"""Turn the service's OpenAPI document into Markdown: operations by tag, messages with units and defaults."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

__all__ = ["messages_page", "operations_page"]

Node = dict[str, Any]

LINE = 100
"""Characters of a line of JSON."""

_OPERATIONS = """# HTTP reference

Operations by resource, made from `GET /openapi.json` of version {version}. The [messages](messages.md) show
each field with its unit and default; [The API](../api.md) explains how the operations work together.
Every error is a {problem}.
"""
_MESSAGES = """# Messages of the HTTP API

Fields of the requests and answers of the [HTTP API](http.md). *required*: a request must have the field; an
answer always has it. Numbers are finite.
"""


def operations_page(document: Node) -> str:
    """Return the page of all operations, grouped by tag in the document's order."""
    by_tag: defaultdict[str, list[str]] = defaultdict(list)
    for path, operations in document["paths"].items():
        for verb, operation in operations.items():
            by_tag[operation["tags"][0]].append(_operation(verb, path, operation))
    intro = _OPERATIONS.format(version=document["info"]["version"], problem=_link("Problem"))
    sections = (f"## {tag.capitalize()}\n\n" + "\n".join(parts) for tag, parts in by_tag.items())
    return "\n".join((intro, *sections))


def messages_page(document: Node) -> str:
    """Return the page of all messages, in alphabetical order."""
    schemas = document["components"]["schemas"]
    names = sorted(schemas, key=str.lower)
    return "\n".join((_MESSAGES, *(_message(name, schemas[name]) for name in names)))


def _operation(verb: str, path: str, operation: Node) -> str:
    body = operation.get("requestBody", {}).get("content", {})
    parameters = [
        (
            f"`{one['name']}`",
            one["in"],
            _type(one["schema"]),
            _default(one, one["schema"]),
            one.get("description", ""),
        )
        for one in operation.get("parameters", ())
    ]
    answers = [(status, _kinds(one), one["description"]) for status, one in operation["responses"].items()]
    parts = [
        f"### {verb.upper()} {path}\n",
        "\n\n".join(filter(None, [operation["summary"], operation.get("description")])) + "\n",
        _table(("parameter", "in", "type", "default", "meaning"), parameters),
        "".join(
            f"Body: {_type(content.get('schema', {}))} (`{kind}`).\n\n" for kind, content in body.items()
        ),
        "".join(_examples(content) for content in body.values()),
        _table(("status", "answer", "when"), answers),
    ]
    return "\n".join(part for part in parts if part)


def _examples(content: Node) -> str:
    return "\n".join(
        f"Example ({name}):\n\n```json\n{_layout(example['value'])}\n```\n"
        for name, example in content.get("examples", {}).items()
    )


def _layout(value: object, indent: str = "") -> str:
    """Return JSON in which whatever fits is on one line."""
    line = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(line) <= LINE or not isinstance(value, dict | list) or not value:
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {_layout(one, inner)}" for key, one in value.items()]
        return "{\n" + ",\n".join(inner + part for part in parts) + f"\n{indent}}}"
    return "[\n" + ",\n".join(inner + _layout(one, inner) for one in value) + f"\n{indent}]"


def _kinds(response: Node) -> str:
    """Return the messages of an answer, or the media types of what is none."""
    contents = response.get("content", {}).items()
    return ", ".join(_kind(media, one.get("schema", {})) for media, one in contents)


def _kind(media: str, schema: Node) -> str:
    return _type(schema) if "$ref" in schema else f"`{media}`"


def _message(name: str, schema: Node) -> str:
    fields = list(_fields(schema))
    described = schema.get("description", "")
    table = (
        _table(("field", "type", "unit", "default", "meaning"), fields) if fields else f"{_type(schema)}\n"
    )
    return f"({_anchor(name)})=\n## {name}\n\n{described}\n\n{table}"


def _fields(schema: Node) -> Iterator[tuple[str, ...]]:
    """Yield a row of the table for each field."""
    required = schema.get("required", ())
    for field, one in schema.get("properties", {}).items():
        default = "*required*" if field in required else _default({}, one)
        yield f"`{field}`", _type(one), one.get("unit", ""), default, _text(one)


def _text(schema: Node) -> str:
    examples = ", ".join(f"`{json.dumps(one, ensure_ascii=False)}`" for one in schema.get("examples", ()))
    return " ".join(
        part for part in (schema.get("description", ""), examples and f"Example: {examples}.") if part
    )


def _default(parameter: Node, schema: Node) -> str:
    if parameter.get("required"):
        return "*required*"
    return f"`{json.dumps(schema['default'], ensure_ascii=False)}`" if "default" in schema else ""


def _type(schema: Node) -> str:
    """Return the type of a field in words, with its bounds."""
    if "$ref" in schema:
        return _link(schema["$ref"].rpartition("/")[2])
    if alternatives := schema.get("anyOf") or schema.get("oneOf"):
        return " or ".join(dict.fromkeys(map(_type, alternatives)))
    if "const" in schema or "enum" in schema:
        return ", ".join(f"`{json.dumps(one)}`" for one in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        return _array(schema)
    if schema.get("type") == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"object of {_type(schema['additionalProperties'])} by name"
    return (
        schema.get("type", "any")
        + _bounds(schema, "minimum", "maximum")
        + _bounds(schema, "minLength", "maxLength", " characters")
    )


def _array(schema: Node) -> str:
    if "prefixItems" in schema:
        types = [_type(one) for one in schema["prefixItems"]]
        return f"array ({len(types)}) of {types[0]}" if len(set(types)) == 1 else f"[{', '.join(types)}]"
    return f"array{_bounds(schema, 'minItems', 'maxItems')} of {_type(schema.get('items', {}))}"


def _bounds(schema: Node, least: str, greatest: str, of: str = "") -> str:
    if least not in schema and greatest not in schema:
        return ""
    low, high = schema.get(least), schema.get(greatest)
    text = (
        f"≥ {low:g}"
        if high is None
        else f"≤ {high:g}"
        if low is None
        else f"{low:g}"
        if low == high
        else f"{low:g} – {high:g}"
    )
    return f" ({text}{of})"


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table without its empty columns, or nothing if there are no rows."""
    kept = [index for index in range(len(header)) if any(row[index] for row in rows)]
    lines = [
        [header[index] for index in kept],
        ["---"] * len(kept),
        *([_cell(row[index]) for index in kept] for row in rows),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) if rows else ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def _anchor(name: str) -> str:
    return f"message-{name.lower().replace('_', '-')}"


def _link(name: str) -> str:
    return f"[{name}](#{_anchor(name)})"
