"""Documents of YAML as a table, with the objects that a document of JSON would have."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.formats.json_rows import (
    NumberText,
    build_error_of_list,
    build_grids_of_objects,
    find_objects,
)
from jointstiff.service.importing.formats.messages import LEAST_ROWS, NumberedObject
from jointstiff.service.importing.grid import Grid, is_plain_number
from jointstiff.service.importing.texts.encoding import decode
from jointstiff.service.importing.texts.joint_states import read_joint_states

if TYPE_CHECKING:
    import yaml

_ENDINGS: Final = (".yaml", ".yml")
_ITEM: Final = re.compile(r"^[ \t]{0,40}-[ \t]{1,8}[\w\"'][\w \"'-]{0,60}:(?:[ \t]|$)", re.MULTILINE)
"""A list's item that is an object, with its first field."""
_FIELD: Final = re.compile(r"^[ \t]{0,40}(?:-[ \t]{1,8})?[\w\"'][\w \"'-]{0,60}:(?:[ \t]|$)", re.MULTILINE)
"""A line that begins with the name of a field."""
_MOST_LENGTH: Final = 4_000_000
"""Characters of a file."""
_MOST_DEPTH: Final = 12
_MOST_VALUES: Final = 2 * limits.MAX_CELLS
_SAVE_AS_TABLE: Final = "write a list of postures with the same fields, or export the readings as CSV"


class _RefusedError(Exception):
    """Error that a document has something that is never read: line and reason."""

    def __init__(self, line: int, reason: str, *, is_certain: bool = False) -> None:
        super().__init__(line, reason)
        self.line, self.reason = line, reason
        self.is_certain = is_certain  # whether the text is YAML, whatever the name of its file is


def read_yaml_rows(file: str, content: bytes) -> list[Grid]:
    """Return the objects of a file of YAML as tables, as those of JSON; none of another text.

    Anchors and aliases, by which few bytes become many, are refused.

    Raises:
        ImportFileError: name and lines are those of YAML, but the text cannot be read as objects; or a
            list of objects has an anchor or an alias.
    """
    text, encoding = decode(file, content)
    has_fields = len(_FIELD.findall(text[:_MOST_LENGTH])) >= LEAST_ROWS
    is_named = has_fields and is_named_yaml(file)
    if not (is_named or _looks_like_yaml(text)) or read_joint_states(text):
        return []
    try:
        objects = _read_objects(text)
    except _RefusedError as error:
        if is_named or error.is_certain:
            raise ImportFileError(Place(file, error.line), error.reason, _SAVE_AS_TABLE) from None
        return []
    if len(objects) >= LEAST_ROWS and (is_named or _are_records(objects)):
        return build_grids_of_objects(file, encoding, objects, "YAML")
    if is_named:
        errors = (build_error_of_list(file, document) for document in read_yaml_documents(text))
        error_of_list = next(filter(None, errors), None)
        if error_of_list is not None:
            raise error_of_list
        reason = f"the YAML has no list of {LEAST_ROWS} objects or more, one for each posture"
        raise ImportFileError(Place(file), reason, _SAVE_AS_TABLE).mark_document()
    return []


def is_named_yaml(file: str) -> bool:
    """Return whether the name of a file has an ending of YAML."""
    return file.lower().endswith(_ENDINGS)


def _looks_like_yaml(text: str) -> bool:
    """Return whether a text has a list of objects as YAML writes it."""
    return len(_ITEM.findall(text[:_MOST_LENGTH])) >= LEAST_ROWS


def _are_records(objects: Sequence[NumberedObject]) -> bool:
    """Return whether all objects have the same fields, two at least, unlike the items of notes."""
    fields = {frozenset(each) for _, each in objects}
    return len(fields) == 1 and len(next(iter(fields))) > 1


def read_yaml_documents(text: str) -> list[Any]:
    """Return the documents of a text of YAML; none of a text that is refused."""
    try:
        return _build(text).documents
    except _RefusedError:
        return []


def _read_objects(text: str) -> list[NumberedObject]:
    """Return the objects of the list that the only document has, or else the documents, with their lines.

    Raises:
        _RefusedError: the text is no YAML, is too large or too deep, or has an anchor or an alias.
    """
    builder = _build(text)
    documents = [each for each in builder.documents if each]
    objects = find_objects(documents[0] if len(documents) == 1 else documents)
    return [(builder.lines.get(id(each), number), each) for number, each in enumerate(objects, 1)]


def _build(text: str) -> _Builder:
    """Return the documents of a text, with their lines.

    Raises:
        _RefusedError: the text is no YAML, is too large or too deep, or has an anchor or an alias.
    """
    import yaml  # for these texts only

    if len(text) > _MOST_LENGTH:
        raise _RefusedError(1, f"the YAML has more than {_MOST_LENGTH} characters")
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    builder = _Builder()
    try:
        for event in yaml.parse(text, Loader=loader):
            builder.add(event)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = 1 if mark is None else mark.line + 1
        problem = getattr(error, "problem", None) or "it cannot be read"
        raise _RefusedError(line, f"invalid YAML: {problem}") from None
    return builder


@dataclass
class _Open:
    """List or object that is not complete yet."""

    value: Any  # list or dict
    key: str | None = None  # field of an object whose value follows


@dataclass
class _Builder:
    """Documents made of events in turn, without recursion, however deep a hostile text is."""

    documents: list[Any] = field(default_factory=list)
    lines: dict[int, int] = field(default_factory=dict)  # identity of an object → its line
    _open: list[_Open] = field(default_factory=list)
    _count: int = 0

    def add(self, event: yaml.Event) -> None:
        """Add an event of the parser.

        Raises:
            _RefusedError: the document is too large or too deep, or has an anchor, an alias or a name twice.
        """
        import yaml

        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            reason = "the YAML has an anchor or an alias, which is not read"
            raise _RefusedError(line, reason, is_certain=True)
        self._count += 1
        if self._count > _MOST_VALUES or len(self._open) > _MOST_DEPTH:
            raise _RefusedError(line, "the YAML has too many values, or lists in lists")
        if isinstance(event, yaml.MappingStartEvent):
            self._begin({}, line)
        elif isinstance(event, yaml.SequenceStartEvent):
            self._begin([], line)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._open.pop()
        elif isinstance(event, yaml.ScalarEvent):
            self._put(_read_scalar(event), line)

    def _begin(self, value: Any, line: int) -> None:  # noqa: ANN401 - a list or an object
        """Begin a list or an object."""
        self._put(value, line)
        self.lines[id(value)] = line
        self._open.append(_Open(value))

    def _put(self, value: Any, line: int) -> None:  # noqa: ANN401 - a value of a document
        """Put a value into the list or object that is open."""
        if not self._open:
            self.documents.append(value)
            return
        inner = self._open[-1]
        if isinstance(inner.value, list):
            inner.value.append(value)
        elif inner.key is not None:
            inner.value[inner.key] = value
            inner.key = None
        elif not isinstance(value, str):
            raise _RefusedError(line, "a name in the YAML is a list or an object")
        elif value in inner.value:
            raise _RefusedError(line, f"the name {quote(value)} occurs twice in an object of the YAML")
        else:
            inner.key = value


def _read_scalar(event: yaml.ScalarEvent) -> str | None:
    """Return the text of a scalar, as a number if it is one; None for nothing."""
    text = str(event.value)
    is_plain = not event.style
    if is_plain and text in ("", "~", "null"):
        return None
    return NumberText(text) if is_plain and is_plain_number(text) else text
