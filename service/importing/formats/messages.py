"""Messages of several kinds in one stream, such as those of joints and of points: a table for each kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

LEAST_ROWS: Final = 3
"""Objects of a table."""
_MOST_KINDS: Final = 8
_MOST_DEPTH: Final = 6
_LARGEST_COMMON_PART: Final = 0.5
"""Fraction of the fields of each kind that all kinds have, at most: rows of one table have more in common."""

NumberedObject = tuple[int, Mapping[str, Any]]
"""Line of an object, or its number, and the object."""


def split_messages(objects: Sequence[NumberedObject]) -> dict[str, list[NumberedObject]]:
    """Return name → messages of each kind in a stream; empty if the objects are rows of one table.

    A text in each message, such as `topic`, names its kind; without one, the names of the fields show the
    kinds, which are numbered. The fields of an object that has all but the head of each message are those of
    the message.
    """
    fields = [frozenset(_list_fields(each, (), 0)) for _, each in objects]
    keys = [key for key in objects[0][1] if all(isinstance(each.get(key), str) for _, each in objects)]
    for key in keys:
        kinds = _group([str(each[key]) for _, each in objects], objects, fields)
        if kinds:
            return kinds
    number_of_fields = {own: str(number) for number, own in enumerate(dict.fromkeys(fields), 1)}
    return _group([number_of_fields[own] for own in fields], objects, fields)


def _group(
    names: Sequence[str], objects: Sequence[NumberedObject], fields: Sequence[frozenset[tuple[str, ...]]]
) -> dict[str, list[NumberedObject]]:
    """Return the messages of each name; empty unless the names are those of kinds of messages.

    Args:
        names: name of the kind of each message.
        objects: messages.
        fields: names of the fields of each message.
    """
    if not 2 <= len(set(names)) <= _MOST_KINDS:
        return {}
    kinds: dict[str, list[NumberedObject]] = {}
    fields_of_kind: dict[str, frozenset[tuple[str, ...]]] = {}
    for name, (line, message), own in zip(names, objects, fields, strict=True):
        kinds.setdefault(name, []).append((line, message))
        fields_of_kind[name] = fields_of_kind.get(name, own) | own
    common = frozenset.intersection(*fields_of_kind.values())
    are_long = all(len(messages) >= LEAST_ROWS for messages in kinds.values())
    are_different = all(len(common) <= _LARGEST_COMMON_PART * len(own) for own in fields_of_kind.values())
    if not (are_long and are_different):
        return {}
    return _take_out_of_container(kinds)


def _take_out_of_container(kinds: Mapping[str, list[NumberedObject]]) -> dict[str, list[NumberedObject]]:
    """Return messages with the fields of the only object that each of them has, next to its own fields."""
    messages = [message for own in kinds.values() for _, message in own]
    containers = {tuple(_list_containers(message)) for message in messages}
    container = containers.pop() if len(containers) == 1 else ()
    if len(container) != 1:
        return dict(kinds)
    (name,) = container
    can_be_joined = all(
        isinstance(message[name], Mapping) and message.keys().isdisjoint(message[name])
        for message in messages
    )
    if not can_be_joined:
        return dict(kinds)
    return {
        kind: [(line, _join_fields(message, name)) for line, message in own] for kind, own in kinds.items()
    }


def _list_containers(message: Mapping[str, Any]) -> Iterator[str]:
    """Yield the names of the objects and lists in a message."""
    return (key for key, each in message.items() if isinstance(each, Mapping | list))


def _join_fields(message: Mapping[str, Any], container: str) -> dict[str, Any]:
    """Return the fields of a message, with those of a container in it instead of the container."""
    head = {key: each for key, each in message.items() if key != container}
    return {**head, **message[container]}


def _list_fields(value: object, path: tuple[str, ...], depth: int) -> Iterator[tuple[str, ...]]:
    """Yield the paths of the fields of an object, and of the elements of objects and lists in it."""
    if isinstance(value, list):
        value = dict(enumerate(value))
    if not isinstance(value, Mapping) or depth > _MOST_DEPTH:
        yield path
        return
    for key, each in value.items():
        yield from _list_fields(each, (*path, str(key)), depth + 1)
