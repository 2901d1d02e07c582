"""Make an OpenAPI document smaller: what repeats is described once, and answers have no bounds."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job
from jointstiff.schemas.measurement import MeasurementSetHeader, SetMetadata
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.plan import ReadingOptions
from jointstiff.schemas.robot import RobotSummary

Node = dict[str, Any]

_REFERENCE: Final = "#/components/schemas/"
_SHARED: Final[tuple[type[Message], ...]] = (
    Job,
    RobotSummary,
    ReadingOptions,
    RunOptions,
    SetMetadata,
    MeasurementSetHeader,
)
"""Messages whose fields others inherit; a message follows its own base."""
_INLINE_BYTES: Final = 1100
"""Greatest size of a message of answers that is described in the only field that has it."""
_PARTS: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
    {
        "JointKinds": ("RunResult", "joint_kinds"),
        "JointKind": ("JointResult", "kind"),
        "FrameValues": ("ProgramFrame", "values"),
    }
)
"""Names for fields that many messages have: a message and its field that has the schema."""
_VALUES: Final[Mapping[str, tuple[str, str]]] = MappingProxyType({"Quantity": ("DhRow", "a")})
"""Names for types of values without words of their own: a message, and its field of this type."""
_WORDS: Final = frozenset({"description", "unit"})
"""Keywords that say what a value means, not which values are allowed."""
_BOUNDS: Final = frozenset(
    {"minLength", "maxLength", "pattern", "minItems", "maxItems", "propertyNames", "maxProperties", "default"}
)
"""Keywords that tell clients what to send; in an answer they tell nothing."""


def share_fields(document: Node) -> None:
    """Move fields that several messages inherit to one schema; these messages refer to it with `allOf`.

    `document` is the description of the API; it is changed in place.
    """
    schemas = document["components"]["schemas"]
    bases = {base.__name__ for base in _SHARED}
    for base in _SHARED:
        name = base.__name__
        subclasses = [
            class_name
            for class_name in _list_subclasses(base)
            if class_name in schemas
            and class_name not in bases
            and base.model_fields.keys() & schemas[class_name]["properties"].keys()
        ]
        schema = schemas.setdefault(
            name, _build_base(base, [schemas[class_name] for class_name in subclasses])
        )
        schema.pop("additionalProperties", None)  # it would refuse the fields of the heirs
        for subclass in subclasses:
            schemas[subclass] = _refer_to_base(schemas[subclass], name, schema)
    _close_shared(document)


def _build_base(base: type[Message], subclass_schemas: list[Node]) -> Node:
    """Return the schema of the fields of a base class that all its subclasses describe with the same words.

    `subclass_schemas` are the schemas of the subclasses.
    """
    texts_of_subclasses = [
        {_serialise_field(field) for field in schema["properties"].items()} for schema in subclass_schemas
    ]
    fields = {
        name: value
        for name, value in subclass_schemas[0]["properties"].items()
        if name in base.model_fields
        and all(_serialise_field((name, value)) in subclass_texts for subclass_texts in texts_of_subclasses)
    }
    required = set(fields).intersection(*(schema.get("required", ()) for schema in subclass_schemas))
    return {
        "properties": fields,
        "type": "object",
        "required": [name for name in fields if name in required],
        "description": (base.__doc__ or "").partition("\n\n")[0],
    }


def _serialise_field(field: tuple[str, Node]) -> str:
    """Return the name and the schema of a field as one text, by which two fields can be compared."""
    return json.dumps(field, sort_keys=True)


def _list_subclasses(message: type[Message]) -> list[str]:
    """Return the sorted names of all direct and indirect subclasses of a message."""
    class_names, to_search = list[str](), [message]
    while to_search:
        subclasses = to_search.pop().__subclasses__()
        to_search += subclasses
        class_names += [subclass.__name__ for subclass in subclasses]
    return sorted(set(class_names))


def _refer_to_base(schema: Node, base_name: str, base: Node) -> Node:
    """Return a schema that refers to its base for the fields that both describe in the same way."""
    own_fields = {
        name: value for name, value in schema["properties"].items() if base["properties"].get(name) != value
    }
    other_keys = {name: value for name, value in schema.items() if name not in {"properties", "required"}}
    if other_keys.pop("additionalProperties", None) is False:
        # `additionalProperties` would refuse the fields of the base.
        other_keys["unevaluatedProperties"] = False
    required = [name for name in schema.get("required", ()) if name not in base.get("required", ())]
    return {
        "allOf": [*other_keys.pop("allOf", ()), {"$ref": _REFERENCE + base_name}],
        "properties": own_fields,
        **({"required": required} if required else {}),
        **other_keys,
    }


def _close_shared(document: Node) -> None:
    """Refuse unknown fields where a request has a shared message itself, which is open for its heirs."""
    shared = {_REFERENCE + base.__name__ for base in _SHARED}

    def close(node: Any) -> None:  # noqa: ANN401 - any part of a JSON document
        if isinstance(node, list):
            for each in node:
                close(each)
        elif isinstance(node, dict):
            if node.get("$ref") in shared:
                node["unevaluatedProperties"] = False
            for key, value in node.items():
                if key != "allOf":
                    close(value)

    schemas = document["components"]["schemas"]
    close([schemas[name] for name in schemas.keys() - find_answer_schemas(document)])


def find_used_schemas(document: Node, *roots: Node) -> set[str]:
    """Return the names of the schemas that parts of a description use, directly or through other schemas.

    `roots` are the parts of the description.
    """
    schemas = document["components"]["schemas"]
    to_search = list(roots)
    used_names = set[str]()
    while to_search:
        new_names = set(re.findall(rf'"{_REFERENCE}(\w+)"', json.dumps(to_search.pop()))) - used_names
        used_names |= new_names
        to_search += [schemas[name] for name in new_names]
    return used_names


def find_answer_schemas(document: Node) -> set[str]:
    """Return the names of the schemas that no request uses."""
    bodies = [
        operation.get("requestBody", {})
        for operations in document["paths"].values()
        for operation in operations.values()
    ]
    return set(document["components"]["schemas"]) - find_used_schemas(document, *bodies)


def open_answers(document: Node) -> None:
    """Remove from schemas of answers the bounds of requests, and the promise that no field is ever added."""
    schemas = document["components"]["schemas"]
    for name in find_answer_schemas(document):
        schema: Node = _drop_bounds(schemas[name])
        schemas[name] = {
            key: value
            for key, value in schema.items()
            if value is not False or key not in {"additionalProperties", "unevaluatedProperties"}
        }


def _drop_bounds(node: Any, *, names: bool = False) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a schema without bounds; with `names`, its keys are names of fields."""
    if isinstance(node, list):
        return [_drop_bounds(each) for each in node]
    if not isinstance(node, dict):
        return node
    # An array with `prefixItems` has a fixed length.
    kept = {"minItems", "maxItems"} if "prefixItems" in node else set()
    return {
        key: _drop_bounds(value, names=key == "properties")
        for key, value in node.items()
        if names or key not in _BOUNDS or key in kept
    }


def drop_implied_bounds(node: Any) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a document without bounds of numbers and lengths that other keywords imply."""
    if isinstance(node, list):
        return [drop_implied_bounds(each) for each in node]
    if not isinstance(node, dict):
        return node
    implied = set()
    if isinstance(least := node.get("exclusiveMinimum"), float) and node.get("minimum", math.inf) <= least:
        implied.add("minimum")
    if isinstance(most := node.get("exclusiveMaximum"), float) and node.get("maximum", -math.inf) >= most:
        implied.add("maximum")
    if node.get("minLength") == 1 and str(node.get("pattern")).endswith("]+$"):
        implied.add("minLength")
    return {key: drop_implied_bounds(value) for key, value in node.items() if key not in implied}


def shorten_numbers(node: Any) -> Any:  # noqa: ANN401 - any part of a JSON document
    """Return a part of a document with whole numbers as integers, which JSON does not tell apart."""
    if isinstance(node, list):
        return [shorten_numbers(each) for each in node]
    if isinstance(node, dict):
        return {key: shorten_numbers(value) for key, value in node.items()}
    return int(node) if isinstance(node, float) and node.is_integer() else node


def require_discriminators(document: Node) -> None:
    """Mark the fields that tell the alternatives of a union apart as required, as generators demand."""
    schemas = document["components"]["schemas"]
    for discriminator in _iterate_discriminators(document):
        name = discriminator["propertyName"]
        for reference in discriminator["mapping"].values():
            schema = schemas[reference.removeprefix(_REFERENCE)]
            schema["required"] = list(dict.fromkeys((name, *schema.get("required", ()))))


def _iterate_discriminators(node: Any) -> Iterator[Node]:  # noqa: ANN401 - any part of a JSON document
    """Yield each discriminator of a part of a document."""
    if isinstance(node, dict):
        if "discriminator" in node:
            yield node["discriminator"]
        node = list(node.values())
    if isinstance(node, list):
        for each in node:
            yield from _iterate_discriminators(each)


def name_parts(document: Node) -> Node:
    """Return the document with a named schema, and references to it, for each of `_PARTS` and `_VALUES`.

    A schema that is written out in several places becomes {"$ref": "#/components/schemas/NAME"} there.
    """
    schema_of_name = _list_schemas_to_name(document)
    names = {json.dumps(part, sort_keys=True): name for name, part in schema_of_name.items()}

    def refer(node: Any) -> Any:  # noqa: ANN401 - any part of a JSON document
        if isinstance(node, list):
            return [refer(each) for each in node]
        if not isinstance(node, dict):
            return node
        name = names.get(json.dumps(node, sort_keys=True))
        return {"$ref": _REFERENCE + name} if name else {key: refer(value) for key, value in node.items()}

    named: Node = refer(document)
    named["components"]["schemas"] |= schema_of_name
    named = _rename_map(named)
    named["components"]["schemas"] = _sort_bases_first(named["components"]["schemas"])
    return named


def _list_schemas_to_name(document: Node) -> dict[str, Node]:
    """Return name → schema, as a field of a message has it, of each part of messages that gets a name."""
    schemas = document["components"]["schemas"]
    schema_of_name = dict[str, Node]()
    for name, (message, field) in _PARTS.items():
        schema_of_name[name] = schemas[message]["properties"][field]
    for name, (message, field) in _VALUES.items():
        described_schema = schemas[message]["properties"][field]
        schema_of_name[name] = {key: value for key, value in described_schema.items() if key not in _WORDS}
    answers = document["paths"]["/v1/jobs/{job_id}"]["get"]["responses"].values()
    contents = [answer["content"] for answer in answers if "application/json" in answer.get("content", {})]
    (content,) = contents
    schema_of_name["AnyJob"] = content["application/json"]["schema"]
    return schema_of_name


def _rename_map(document: Node) -> Node:
    """Return the document in which the schema `Map` is `MapJob`: TypeScript has a type `Map` already."""
    text = json.dumps(document).replace(f'"{_REFERENCE}Map"', f'"{_REFERENCE}MapJob"')
    renamed: Node = json.loads(text)
    schemas = renamed["components"]["schemas"]
    schemas["MapJob"] = schemas.pop("Map")
    return renamed


def _sort_bases_first(schemas: dict[str, Node]) -> dict[str, Node]:
    """Return the schemas by name, shared bases first: openapi-python-client needs a base before its heirs."""
    bases = [base.__name__ for base in _SHARED]
    others = sorted(schemas.keys() - set(bases))
    return {name: _nest_fields(schemas[name]) for name in (*bases, *others)}


def _nest_fields(schema: Node) -> Node:
    """Return a schema whose own fields are in its `allOf`, where generators of clients look for them."""
    if "allOf" not in schema:
        return schema
    other_keys = {name: value for name, value in schema.items() if name not in {"type", "properties"}}
    own_fields = {"type": "object", "properties": schema["properties"]}
    required = other_keys.pop("required", [])
    for part, names in (
        (own_fields, [name for name in required if name in schema["properties"]]),
        (other_keys, [name for name in required if name not in schema["properties"]]),  # inherited fields
    ):
        if names:
            part["required"] = names
    return {**other_keys, "allOf": [*schema["allOf"], own_fields]}


def inline_small_answers(document: Node) -> None:
    """Describe a small message of answers in the only field that has it."""
    schemas = document["components"]["schemas"]
    uses = Counter(re.findall(rf'"{_REFERENCE}(\w+)"', json.dumps(document)))
    fields = Counter(re.findall(rf'"{_REFERENCE}(\w+)"', json.dumps(schemas)))
    small = {
        name
        for name in find_answer_schemas(document)
        if uses[name] == fields[name] == 1
        and schemas[name].keys() <= {"type", "properties", "required", "description"}
        and len(json.dumps(schemas[name], ensure_ascii=False)) <= _INLINE_BYTES
    }
    # Generators of clients name the class of such a message by its title.
    inlined = {name: {"title": name, **schemas.pop(name)} for name in small}
    document["components"]["schemas"] = _replace_references(schemas, inlined)


def _replace_references(
    node: Any,  # noqa: ANN401 - any part of a document
    inlined: dict[str, Node],
    *,
    described: bool = False,
) -> Any:  # noqa: ANN401 - any part of a document
    """Return a part of a document in which schemas replace the references to them.

    Args:
        node: part of the document.
        inlined: name → schema that replaces the references to it.
        described: whether the field that has this part is described; then its message needs no description.
    """
    if isinstance(node, list):
        return [_replace_references(each, inlined, described=described) for each in node]
    if not isinstance(node, dict):
        return node
    name = str(node.get("$ref", "")).removeprefix(_REFERENCE)
    if name in inlined:
        message = dict(inlined[name])
        if described:
            message.pop("description", None)
        others = {key: value for key, value in node.items() if key != "$ref"}
        return _replace_references({**message, **others}, inlined)
    described = described or isinstance(node.get("description"), str)
    return {
        key: _replace_references(value, inlined, described=described and key in {"items", "anyOf"})
        for key, value in node.items()
    }
