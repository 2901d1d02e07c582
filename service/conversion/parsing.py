"""Strict parsing of JSON texts to messages, in memory of the order of the text's size."""

from __future__ import annotations

import codecs
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any, Final, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import from_json
from typing_extensions import TypeAliasType

from jointstiff.schemas.measurement import MAX_OBSERVATIONS

MAX_SET_BYTES: Final = 8 * 1024 * 1024
"""Largest measurement set, or file with one, in bytes."""
USE_ARRAYS: Final = (
    "the runs of its parts do not replace one run: identify it in Python from arrays, with "
    f"`jointstiff.Campaign.from_arrays` up to {MAX_OBSERVATIONS:,} observations, beyond with "
    "`jointstiff.solver.identify` (docs/python.md)"
)
"""What to do with a measurement set that is too large."""

Parsed = TypeVar("Parsed", bound=BaseModel)

NOT_JSON: Final[Set[str]] = frozenset({"not JSON"})
"""Value of `MalformedError.keys` where the text is not JSON."""


class MalformedError(Exception):
    """A text that is not JSON, or that is not a valid message of the wanted model."""

    def __init__(self, faults: Sequence[Mapping[str, Any]], keys: Set[str] = NOT_JSON) -> None:
        super().__init__(f"{len(faults)} faults")
        # Errors as pydantic lists them, without the values that were sent; the fault of an unknown field
        # also has the `fields` that exist at its place
        self.faults = faults
        self.keys = keys  # keys of the document if it is an object; `NOT_JSON` if the text is not JSON


def parse(message: type[Parsed], content: bytes, section: str | None = None) -> Parsed:
    """Parse a JSON text and validate it as a message.

    The text is parsed before it is validated. In one step, pydantic would copy the whole text for each
    missing field at the top level: gigabytes for a text of a few megabytes.

    Args:
        message: model of the message.
        content: the text, with or without a byte order mark; its depth is limited to 200.
        section: key whose value is the message; without this key, the whole document is the message.

    Raises:
        MalformedError: the text is not JSON, or not a valid message.
    """
    try:
        document = from_json(content.removeprefix(codecs.BOM_UTF8))
    except ValueError as error:
        raise MalformedError([{"type": "json_invalid", "loc": (), "msg": f"Invalid JSON: {error}"}]) from None
    if section is not None and isinstance(document, dict) and section in document:
        document = document[section]
    try:
        return message.model_validate(document)
    except ValidationError as error:
        keys = set(document) if isinstance(document, dict) else set()
        raise MalformedError(_list_faults(message, error), keys) from None


def _list_faults(message: type[BaseModel], error: ValidationError) -> list[dict[str, Any]]:
    """Return the faults of a message.

    That of an unknown field also has the `fields` that exist at its place; that of a value that is no object
    has the `fields` that the object needs.
    """
    faults = []
    for stated in error.errors(include_url=False, include_context=False, include_input=False):
        fault: dict[str, Any] = dict(stated)
        if fault["type"] == "extra_forbidden":
            fault["fields"] = list_fields_at(message, fault["loc"][:-1])
        elif fault["type"] == "model_type":
            fault["fields"] = _list_required_fields_at(message, fault["loc"])
        faults.append(fault)
    return faults


def list_fields_at(message: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """Return the names of the fields that a message has at a place, such as ("observations", 3), sorted.

    Of several forms that a field may have, all fields are named.
    """
    models = _list_models_at(message, place)
    return sorted({name for model in models for name in model.model_fields})


def _list_required_fields_at(message: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """Return the names of the fields that an object needs at a place; none if it has several forms."""
    models = _list_models_at(message, place)
    if len(models) != 1:
        return []
    return [name for model in models for name, field in model.model_fields.items() if field.is_required()]


def _list_models_at(message: type[BaseModel], place: Sequence[int | str]) -> set[type[BaseModel]]:
    """Return the messages that a message may have at a place."""
    models = {message}
    for part in place:
        fields = [model.model_fields[part] for model in models if part in model.model_fields]
        if fields:  # otherwise an index, a key, or the form of a field
            models = {model for field in fields for model in _list_models(field.annotation)}
    return models


def _list_models(annotation: Any) -> Iterator[type[BaseModel]]:  # noqa: ANN401 - a type
    """Yield the messages that a type contains, such as the items of a list."""
    if isinstance(annotation, TypeAliasType):
        yield from _list_models(annotation.__value__)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for inner in get_args(annotation):
            yield from _list_models(inner)
