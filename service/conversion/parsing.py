"""Strict parsing of JSON texts to messages, in memory of the order of the text's size."""

from __future__ import annotations

import codecs
from collections.abc import Mapping, Sequence, Set
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import from_json

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
        self.faults = faults  # errors as pydantic lists them, without the values that were sent
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
        faults = error.errors(include_url=False, include_context=False, include_input=False)
        keys = set(document) if isinstance(document, dict) else set()
        raise MalformedError(faults, keys) from None
