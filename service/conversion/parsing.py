"""JSON from outside, turned into messages: strictly, and in memory of the size of what came."""

from __future__ import annotations

import codecs
from collections.abc import Mapping, Sequence, Set
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import from_json

MAX_SET_BYTES: Final = 8 * 1024 * 1024
"""Largest measurement set, or file with one, in bytes."""

Parsed = TypeVar("Parsed", bound=BaseModel)

NOT_JSON: Final[Set[str]] = frozenset({"not JSON"})
"""In the place of a document's keys."""


class MalformedError(Exception):
    """A text that is not such a message."""

    def __init__(self, faults: Sequence[Mapping[str, Any]], keys: Set[str] = NOT_JSON) -> None:
        super().__init__(f"{len(faults)} faults")
        self.faults = faults  # as pydantic tells them, without what was sent
        self.keys = keys  # of the document, if it is an object; `NOT_JSON` if it is none of JSON


def parse(message: type[Parsed], content: bytes, section: str | None = None) -> Parsed:
    """Understand a JSON text.

    It is parsed before it is validated. In one go, pydantic would make a copy of the whole text for each
    field that is missing at its top, gigabytes for a few megabytes.

    Args:
        message: what it should be.
        content: the text, with a byte order mark or without; its depth is limited to 200.
        section: key of an object under which the message may stand, in place of at the top.

    Raises:
        MalformedError: it is not JSON, or not such a message.
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
        faults = error.errors(include_url=False, include_context=False, include_input=False)
        raise MalformedError(faults, set(document) if isinstance(document, dict) else set()) from None
