"""Results of `schemas` filled from attributes of objects, and from arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Any, TypeVar

import numpy as np

from jointstiff.schemas.fields import Message, validated
from jointstiff.schemas.joints import JointKind

Built = TypeVar("Built", bound=Message)


class _View:
    """Show an object's attributes as messages take them; an attribute that is missing is an error."""

    __slots__ = ("_source",)

    def __init__(self, source: object) -> None:
        self._source = source

    def __getattr__(self, name: str) -> object:
        try:
            return _plain(getattr(self._source, name))
        except AttributeError as error:  # which pydantic would take for a field to be left at its default
            raise TypeError(str(error)) from error


def message(kind: type[Built], source: object, /, **stated: object) -> Built:
    """Build a message from an object, as `document` says."""
    return kind.model_validate(document(kind, source, **stated), from_attributes=True)


def document(kind: type[Message], source: object, /, **stated: object) -> dict[str, object]:
    """Return the fields of a message of an object, to be validated with the message that they are part of.

    Args:
        kind: class of the message.
        source: has an attribute for each field that is not stated, objects for nested messages. Arrays
            become lists; numbers, arrays and pairs that are not finite become null.
        stated: fields whose values are given here.
    """
    fields = {name: getattr(source, name) for name in kind.model_fields if name not in stated}
    return {name: _plain(value) for name, value in (fields | stated).items()}


def messages_of(kind: type[Built], sources: Sequence[object], /, **stated: Sequence[Any]) -> list[Built]:
    """Build one message for each object, as `message` does, with columns of fields whose values are given."""
    return validated(kind, documents(kind, sources, **stated))


def documents(
    kind: type[Message], sources: Sequence[object], /, **stated: Sequence[Any] | np.ndarray[Any, Any]
) -> list[dict[str, Any]]:
    """Return the fields of such messages, as `document` does."""
    names, count = [name for name in kind.model_fields if name not in stated], len(sources)
    values = [getattr(source, name) for name in names for source in sources]
    return table(**{name: values[k * count : (k + 1) * count] for k, name in enumerate(names)}, **stated)


def rows(kind: type[Built], /, **columns: Sequence[Any] | np.ndarray[Any, Any]) -> list[Built]:
    """Build one message for each row of columns of equal length, named by their fields."""
    return validated(kind, table(**columns))


def table(**columns: Sequence[Any] | np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """Return the fields of such messages, as `document` does."""
    values = zip(*map(_column, columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in values]


def finite(value: float | None) -> float | None:
    """Return a number as messages take it; None where it is not finite."""
    return None if value is None or not isfinite(value) else float(value)


def point(vector: np.ndarray[Any, Any]) -> tuple[float, float, float]:
    """Return three components as messages take them."""
    x, y, z = vector.tolist()
    return x, y, z


def _column(values: Sequence[Any] | np.ndarray[Any, Any]) -> list[Any]:
    if isinstance(values, np.ndarray) and (values.dtype.kind != "f" or np.isfinite(values).all()):
        return list(values.tolist())
    return [_plain(value) for value in values]


def _plain(value: object) -> object:
    if value is None or isinstance(value, str | int | dict | Message):
        return value
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind != "f" or np.isfinite(value).all() else None
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return [_plain(item) for item in value]
    return _View(value)


def stated_kinds(names: Iterable[str], kinds: Iterable[JointKind]) -> dict[str, JointKind]:
    """Return the kinds of joints by name, as results state them: none where all turn."""
    by_name = dict(zip(names, kinds, strict=True))
    return by_name if "prismatic" in by_name.values() else {}
