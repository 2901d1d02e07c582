"""Places in a document: names with dots between them, `[]` for each element of a list, `{}` for each value.

`result.joints[].budget` is the field `budget` of each joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

EACH_ELEMENT = "[]"
EACH_VALUE = "{}"


def find_parents(document: Any, path: str) -> Iterator[tuple[dict[str, Any], str]]:  # noqa: ANN401 - any JSON
    """Yield (object, name of a field) for each place of a path that a document has."""
    *outer, name = _split(path)
    for parent in _descend(document, outer):
        if isinstance(parent, dict) and name in parent:
            yield parent, name


def find_values(document: Any, path: str) -> Iterator[Any]:  # noqa: ANN401 - any JSON
    """Yield the values at each place of a path that a document has."""
    yield from _descend(document, _split(path))


def remove(document: Any, path: str) -> bool:  # noqa: ANN401 - any JSON
    """Remove the fields at a path; return whether any of them had a value other than null, zero or empty."""
    had_value = False
    for parent, name in list(find_parents(document, path)):
        had_value |= bool(parent.pop(name))
    return had_value


def _split(path: str) -> list[str]:
    """Return the steps of a path: names, `[]` and `{}`."""
    for each in (EACH_ELEMENT, EACH_VALUE):
        path = path.replace(each, f".{each}")
    return [part for part in path.split(".") if part]


def _descend(document: Any, parts: list[str]) -> Iterator[Any]:  # noqa: ANN401 - any JSON
    """Yield the values at the end of some steps."""
    if not parts:
        yield document
        return
    first, *others = parts
    if first == EACH_ELEMENT:
        inner = document if isinstance(document, list) else []
    elif first == EACH_VALUE:
        inner = list(document.values()) if isinstance(document, dict) else []
    else:
        has_field = isinstance(document, dict) and first in document
        inner = [document[first]] if has_field else []
    for value in inner:
        yield from _descend(value, others)
