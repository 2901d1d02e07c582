"""Messages of ROS with the states of joints, as `ros2 topic echo` writes them, read as a table."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from jointstiff.service.importing.key_values import KeyedRecords

_LEAST_MESSAGES: Final = 3
_END: Final = "---"
"""Line between two messages."""
_FIELD: Final = re.compile(r"(\w{1,64}):[ \t]*(.*)")
_ITEM: Final = re.compile(r"[ \t]*-[ \t]+(.*)")


@dataclass
class _Message:
    """Lists of a message, under the names of its fields."""

    line: int  # of its first line
    lists: dict[str, list[str]] = field(default_factory=dict)


def read_joint_states(text: str) -> KeyedRecords | None:
    """Return a row of positions for each message, with the names of the joints; None of other texts.

    Units are those of the messages: rad and m.
    """
    if f"\n{_END}" not in text or "position:" not in text:
        return None
    messages = [each for each in _read_messages(text) if each.lists]
    names = {tuple(each.lists.get("name", ())) for each in messages}
    if len(messages) < _LEAST_MESSAGES or len(names) != 1:
        return None
    headers = names.pop()
    rows = tuple((each.line, tuple(each.lists.get("position", ()))) for each in messages)
    are_complete = bool(headers) and all(len(numbers) == len(headers) for _, numbers in rows)
    return KeyedRecords(headers, rows, ()) if are_complete else None


def _read_messages(text: str) -> Iterator[_Message]:
    """Yield the messages of a text."""
    message, name = _Message(1), ""
    for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1):
        if line.rstrip() == _END:
            yield message
            message, name = _Message(number + 1), ""
            continue
        if found := _FIELD.fullmatch(line):
            name, value = found.groups()
            if value.startswith("[") and value.rstrip().endswith("]"):
                message.lists[name] = [each.strip(" '\"") for each in value.strip("[] \t").split(",")]
        elif (found := _ITEM.fullmatch(line)) and name:
            message.lists.setdefault(name, []).append(found[1].strip(" '\""))
    yield message
