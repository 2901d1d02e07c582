"""Translate pydantic's messages into the project's words: what must hold, and the nearest known field."""

from __future__ import annotations

import re
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from typing import Any, Final

from jointstiff.schemas.fields import Message

_LONGEST_NAME: Final = 60

_WORDING: Final = tuple(
    (re.compile(pattern, re.DOTALL), wording)
    for pattern, wording in (
        (r"Value error, (.+)", r"\1"),
        (r"Field required", "required field is missing"),
        (r"Extra inputs are not permitted", "unknown field"),
        (r"Input should be a valid (?:dictionary|mapping).*", "must be an object"),
        (r"Input should be a valid (?:list|tuple|array).*", "must be a list"),
        (r"Input should be a valid string.*", "must be a text"),
        (r"Input should be a valid boolean.*", "must be true or false"),
        (r"Input should be a valid integer.*", "must be a whole number"),
        (r"Input should be a valid number.*", "must be a number"),
        (r"Input should be None", "must be null"),
        (r"Input should be (.+)", r"must be \1"),
        (r"String should match pattern (.+)", r"must match the pattern \1"),
        (r"Unable to extract tag using discriminator (.+)", r"needs the field \1"),
        (
            r"Input tag (.+) found using (.+) does not match any of the expected tags: (.+)",
            r"\2 is \1, but must be one of \3",
        ),
        (
            r"\w+ should have at (least|most) (\d+) items? after validation, not (.+)",
            r"must have at \1 \2 items, but has \3",
        ),
        (r"\w+ should have at (least|most) (.+)", r"must have at \1 \2"),
    )
)
"""Pydantic's messages and ours, the first match counts; what is not here stays as it is."""


def reworded(error: Mapping[str, Any]) -> str:
    """Return one of pydantic's errors in the project's words.

    Args:
        error: its `type`, `loc` and `msg`.
    """
    message = str(error["msg"])
    for pattern, wording in _WORDING:
        if match := pattern.fullmatch(message):
            message = match.expand(wording)
            break
    nearest = _nearest(error) if error["type"] == "extra_forbidden" else None
    return message if nearest is None else f"{message}; did you mean `{nearest}`?"


def _nearest(error: Mapping[str, Any]) -> str | None:
    """Return the field of any message whose name is nearest to an unknown one; None without such."""
    name = str(error["loc"][-1]) if error["loc"] else ""
    if not name or len(name) > _LONGEST_NAME or name in _fields():
        return None
    return next(iter(get_close_matches(name, _fields(), n=1, cutoff=0.75)), None)


@cache
def _fields() -> tuple[str, ...]:
    names: set[str] = set()
    waiting: list[type[Message]] = [Message]
    while waiting:
        message = waiting.pop()
        names |= set(message.model_fields)
        waiting += message.__subclasses__()
    return tuple(sorted(names))
