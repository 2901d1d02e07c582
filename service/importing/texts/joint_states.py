"""Messages of ROS with the states of joints, as `topic echo` or a table writes them, read as a table."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from jointstiff.service.importing.texts.key_values import KeyedRecords

_LEAST_MESSAGES: Final = 3
_MAX_LENGTH: Final = 4_000_000
"""Characters of all messages."""
_MAX_MESSAGE: Final = 65_536
"""Characters of a message."""
_END: Final = re.compile(r"^---[ \t]*(?:\r\n|\n|\r|\Z)", re.MULTILINE)
"""Line between two messages."""
_FIELD_OF_MESSAGE: Final = 1
"""Depth of the fields of a message."""
_ELEMENT: Final = re.compile(r"(.{0,80}?)(name|position)([\[_.]?\d{1,2}\]?)")
"""Header of an element of the lists of names or positions, such as `field.name0` or `msg.position[0]`."""
_DELIMITERS: Final = ",;\t"


@dataclass
class _Message:
    """Lists of a message, under the names of its fields."""

    line: int  # of its first line
    lists: dict[str, list[str]] = field(default_factory=dict)


def read_joint_states(text: str) -> KeyedRecords | None:
    """Return a row of positions for each message, with the names of the joints; None of other texts.

    Units are those of the messages: rad and m. A text with an anchor or an alias of YAML is another text.
    """
    if "position:" not in text or _END.search(text) is None or len(text) > _MAX_LENGTH:
        return None
    import yaml  # for these texts only

    try:
        messages = [each for each in _read_messages(text) if each.lists]
    except (yaml.YAMLError, _AliasError):
        return None
    names = {tuple(each.lists.get("name", ())) for each in messages}
    if len(messages) < _LEAST_MESSAGES or len(names) != 1:
        return None
    headers = names.pop()
    rows = tuple((each.line, tuple(each.lists.get("position", ()))) for each in messages)
    are_complete = bool(headers) and all(len(numbers) == len(headers) for _, numbers in rows)
    return KeyedRecords(headers, rows, ()) if are_complete else None


def read_rows_of_joint_states(text: str) -> KeyedRecords | None:
    """Return the table of messages in rows, with the names in its cells as headers; None of other texts.

    Columns are elements of lists, such as `field.name0` and `field.position0` of `rostopic echo -p`.
    The columns of names are left out: each name is the header of its position.
    """
    if "position" not in text or len(text) > _MAX_LENGTH or '"' in text:
        return None
    numbered = enumerate(re.split(r"\r\n|\n|\r", text), 1)
    (_, first), *others = [(number, line) for number, line in numbered if line.strip()]
    delimiter = max(_DELIMITERS, key=first.count)
    headers = [header.strip() for header in first.lstrip("%# ").split(delimiter)]
    rows = [(number, [cell.strip() for cell in line.split(delimiter)]) for number, line in others]
    are_complete = all(len(cells) == len(headers) for _, cells in rows)
    if len(rows) < _LEAST_MESSAGES or not are_complete:
        return None
    column_of_position = _pair_names(headers)
    names = {column: {cells[column] for _, cells in rows} for column in column_of_position}
    if not names or any(len(own) != 1 for own in names.values()):
        return None
    for column, own in names.items():
        headers[column_of_position[column]] = own.pop()
    kept = [column for column in range(len(headers)) if column not in names]
    texts = tuple((line, tuple(cells[column] for column in kept)) for line, cells in rows)
    return KeyedRecords(tuple(headers[column] for column in kept), texts, ())


def _pair_names(headers: Sequence[str]) -> dict[int, int]:
    """Return column of a name → column of its position; none if an element has only one of the two."""
    column_of_element = dict[tuple[str, str, str], int]()
    for column, header in enumerate(headers):
        if (found := _ELEMENT.fullmatch(header)) is not None:
            column_of_element[found[1], found[2], found[3]] = column
    pairs = dict[int, int]()
    for (path, kind, element), column in column_of_element.items():
        pair = column_of_element.get((path, "position", element))
        if pair is None:
            return {}
        if kind == "name":
            pairs[column] = pair
    has_all = 2 * len(pairs) == len(column_of_element)
    return pairs if has_all else {}


class _AliasError(Exception):
    """Error that a message has an anchor or an alias, or is too long."""


def _read_messages(text: str) -> Iterator[_Message]:
    """Yield the messages of a text.

    Raises:
        yaml.YAMLError: a message is no YAML.
        _AliasError: a message has an anchor or an alias, or is too long.
    """
    line = 1
    for part in _END.split(text):
        if len(part) > _MAX_MESSAGE:
            raise _AliasError
        yield _read_message(part, line)
        line += part.count("\n") + 1


def _read_message(text: str, line: int) -> _Message:
    """Return the lists of a message; errors as of `_read_messages`.

    Events of YAML need no recursion, however deep a hostile text is, and make no object but texts.
    """
    import yaml

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    reader = _MessageReader(_Message(line))
    for event in yaml.parse(text, Loader=loader):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise _AliasError
        if isinstance(event, yaml.CollectionStartEvent):
            reader.begin()
        elif isinstance(event, yaml.CollectionEndEvent):
            reader.end(is_list=isinstance(event, yaml.SequenceEndEvent))
        elif isinstance(event, yaml.ScalarEvent):
            reader.add(event.value)
    return reader.message


@dataclass
class _MessageReader:
    """Events of a message in turn."""

    message: _Message
    depth: int = 0  # of lists and fields; 1 for the fields of the message
    key: str = ""  # name of the field whose value follows; empty if a name follows
    items: list[str] = field(default_factory=list)  # texts of the present list

    def begin(self) -> None:
        """Begin a list, or the fields of an object."""
        self.items = []
        self.depth += 1

    def end(self, *, is_list: bool) -> None:
        """End a list, or the fields of an object."""
        self.depth -= 1
        if self.depth == _FIELD_OF_MESSAGE:
            self.message.lists.update({self.key: self.items} if is_list else {})
            self.key = ""

    def add(self, text: str) -> None:
        """Add a text: the name of a field, its value, or an item of a list."""
        if self.depth == _FIELD_OF_MESSAGE:
            self.key = "" if self.key else text
        elif self.depth == _FIELD_OF_MESSAGE + 1:
            self.items.append(text)
