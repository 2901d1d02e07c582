"""Strict parsing of JSON texts to messages, in memory of the order of the text's size."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any, Final, Literal, NamedTuple, TypeVar, get_args, get_origin

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


_NAME_OF_FILE: Final = re.compile(rb"@?[\w./\\:~ -]*[\w-]\.\w{1,8}")
"""Text that is only the name of a file, perhaps after the `@` of curl."""
_PAIRS_OF_FORM: Final = re.compile(rb"[\w.\[\]-]+=[^\s{&]*(&[\w.\[\]-]+=[^\s{&]*)*$")
"""Text of `name=value` pairs, as a web form sends them: `&` only separates pairs, for one way to match."""
_SECTION_OF_TOML: Final = re.compile(rb"\[+[A-Za-z][\w.-]*\]+[ \t]*\r?\n")
"""First line of a text in TOML."""
_COMMENT_BEFORE_JSON: Final = re.compile(rb"(?:(?>(?://|#)[^\n]*\n|/\*(?s:.*?)\*/)\s*)+[\[{]")
"""Comments of a programming language before a document; each ends at its first end, for one way to match."""
_LONGEST_NAME: Final = 256
"""Bytes of a name of a file, at most."""
_FIRST_BYTES: Final = 64 * 1024
"""Bytes at the beginning of a text by which its form is known."""
_QUOTED_BY_PYTHON: Final = re.compile(rb"[\[{]\s*'")
"""Beginning of a dictionary or list as `print` of Python writes it."""


class BrokenText(NamedTuple):
    """Reason why a text is no JSON document, with what to do."""

    cause: str  # without a subject, such as "ends in the middle of the document"
    remedy: str


_FORMS_OF_TEXTS: Final = (
    (
        _QUOTED_BY_PYTHON,
        BrokenText(
            "seems to be printed by Python: texts are in single quotes, not in double quotes",
            "write the document with `json.dump`, not with `print`",
        ),
    ),
    (
        _COMMENT_BEFORE_JSON,
        BrokenText("begins with a comment, but JSON has no comments", "remove all comments"),
    ),
    (_SECTION_OF_TOML, BrokenText("is a text in TOML, not a JSON document", "give a JSON document")),
    (
        _PAIRS_OF_FORM,
        BrokenText(
            "is a list of `name=value` pairs, as a web form sends them",
            'send one JSON object, such as {"name": "value"}',
        ),
    ),
)
"""Pattern of the beginning of a text → what the text is."""


def explain_broken_text(content: bytes, message: str) -> BrokenText | None:
    """Return why a text is no JSON document; None if nothing more is known than the parser's message.

    Args:
        content: bytes of the text, in UTF-8.
        message: message of the parser about the text.
    """
    text = content.removeprefix(codecs.BOM_UTF8).strip()
    if not text:
        return BrokenText("is empty", "give a JSON document")
    place = message.partition(" at ")[2]
    if "EOF while parsing" in message:
        return BrokenText(
            f"ends in the middle of the JSON document, at {place}: a part is missing",
            "copy or write the document again",
        )
    if "trailing characters" in message and text[:1] == b"{":
        return BrokenText(
            f"has further text after the end of the JSON document, at {place}",
            "remove this text; give several documents in files of their own",
        )
    if len(text) <= _LONGEST_NAME and _NAME_OF_FILE.fullmatch(text):
        name = text.decode(errors="replace").removeprefix("@")
        return BrokenText(
            f"is only the name {name!r} of a file, not its content",
            f"send the content of the file: with curl, `--data-binary @{name}`",
        )
    beginning = text[:_FIRST_BYTES]
    form = next((broken for pattern, broken in _FORMS_OF_TEXTS if pattern.match(beginning)), None)
    return form or _explain_place(content.removeprefix(codecs.BOM_UTF8), message)


_PLACE: Final = re.compile(r" at line (\d+) column (\d+)")
"""Place in a message of the parser."""
_MOST_LINES: Final = 1_000_000
"""Lines before a place, at most: finding them takes a tenth of a second."""
_BYTES_AROUND: Final = 64
"""Bytes before and after a place by which its mistake is known."""


class _Sign(NamedTuple):
    """Sign of a mistake at the place of an error."""

    pattern: re.Pattern[bytes]  # of the text from this place on
    mistake: str
    remedy: str


_SIGNS_OF_MISTAKES: Final = (
    _Sign(re.compile(rb"//|/\*|#"), "a comment, but JSON has no comments", "remove all comments"),
    _Sign(re.compile(b"'"), "a text in single quotes", 'write all texts in double quotes, such as "c01"'),
    _Sign(
        re.compile(rb"(None|True|False)\b"),
        "a word of Python",
        "write null, true and false, or write the document by `json.dump`",
    ),
    _Sign(
        re.compile(rb"[A-Za-z_]\w*\s*:"),
        "a name without quotes",
        'write all names in double quotes, such as {"robot": …}',
    ),
    _Sign(
        re.compile(rb"[+.]\d|0\d"),
        "a number that begins with +, a point or 0",
        "write numbers such as 0.5, 5 and -5",
    ),
)
_BEHIND_FIRST_SIGN: Final = re.compile("expected ident|invalid number")
"""Messages whose place is behind the first sign of a word or number."""
_DECIMAL_COMMA: Final = re.compile(rb"\d,$")
"""End of a text before the digits that follow a decimal comma."""


def _explain_place(text: bytes, message: str) -> BrokenText | None:
    """Return which mistake is at the place of a parser's message; None for another mistake."""
    place = _PLACE.search(message)
    if place is None or text.lstrip()[:1] not in (b"{", b"["):
        return None
    offset = _find_offset(text, int(place[1]), int(place[2]))
    before = text[max(0, offset - _BYTES_AROUND) : offset]
    after = text[offset : offset + _BYTES_AROUND]
    is_key = "key must be a string" in message
    if "trailing comma" in message:
        return BrokenText(
            f"has a comma before a closing bracket,{place[0]}", "remove the comma after the last entry"
        )
    if is_key and after[:1].isdigit() and _DECIMAL_COMMA.search(before):
        return BrokenText(f"has a decimal comma,{place[0]}", "write numbers with decimal points, such as 1.5")
    if _BEHIND_FIRST_SIGN.search(message):
        after = before[-1:] + after
    found = next((sign for sign in _SIGNS_OF_MISTAKES if sign.pattern.match(after)), None)
    return None if found is None else BrokenText(f"has {found.mistake},{place[0]}", found.remedy)


def _find_offset(text: bytes, line: int, column: int) -> int:
    """Return the number of bytes before a place; that of the last of `_MOST_LINES` for a later place."""
    line_start = 0
    for _ in range(min(line, _MOST_LINES) - 1):
        line_start = text.find(b"\n", line_start) + 1
    return line_start + max(0, column - 1)


_MOST_EXPLAINED: Final = 20
"""Number of faults, at most, whose unknown fields are looked for at other places."""


def _list_faults(message: type[BaseModel], error: ValidationError) -> list[dict[str, Any]]:
    """Return the faults of a message.

    That of an unknown field also has the `fields` that exist at its place, those of them that the field's own
    value has (`inside`), the neighbours of the field that have a field of its name (`homes`), and those with
    all fields of its value (`alike`). That of a value that is no object, or no list of objects, has the
    `fields` that the object needs, and that of an object without its kind its `forms`. That of a missing
    field has the `words` that the field may be. Of the value itself, a fault has only whether the value is a
    text (`is_text`) or a list (`is_list`).
    """
    faults = list[dict[str, Any]]()
    for stated in error.errors(include_url=False, include_context=False):
        fault: dict[str, Any] = dict(stated)
        value = fault.pop("input")
        fault["is_text"], fault["is_list"] = isinstance(value, str), isinstance(value, list | tuple)
        if fault["type"] == "extra_forbidden":
            *place, name = fault["loc"]
            fields = list_fields_at(message, place)
            fault["fields"] = fields
            fault["inside"] = [each for each in fields if isinstance(value, Mapping) and each in value]
            if len(faults) < _MOST_EXPLAINED:
                inner = {each: list_fields_at(message, (*place, each)) for each in fields}
                fault["homes"] = [each for each, names in inner.items() if name in names]
                if isinstance(value, Mapping) and value:
                    fault["alike"] = [each for each, names in inner.items() if value.keys() <= {*names}]
        elif fault["type"] == "missing":
            fault["words"] = _list_words_at(message, fault["loc"])
        elif fault["type"] in {"model_type", "list_type"}:
            fault["fields"] = _list_required_fields_at(message, fault["loc"])
        elif fault["type"] in {"model_attributes_type", "union_tag_not_found"}:
            fault["forms"] = _list_forms_at(message, fault["loc"], value)
        faults.append(fault)
    return faults


def list_fields_at(message: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """Return the names of the fields that a message has at a place, such as ("observations", 3), sorted.

    Of several forms that a field may have, all fields are named.
    """
    models = _list_models_at(message, place)
    return sorted({name for model in models for name in model.model_fields})


def _list_words_at(message: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """Return the words that the field at a place may be; none if it may be anything else."""
    *outer, name = place
    fields = [
        model.model_fields[name] for model in _list_models_at(message, outer) if name in model.model_fields
    ]
    is_word = len(fields) == 1 and get_origin(fields[0].annotation) is Literal
    return [str(word) for word in get_args(fields[0].annotation)] if is_word else []


def _list_required_fields_at(message: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """Return the names of the fields that an object needs at a place; none if it has several forms."""
    models = _list_models_at(message, place)
    if len(models) != 1:
        return []
    return [name for model in models for name, field in model.model_fields.items() if field.is_required()]


def _list_forms_at(message: type[BaseModel], place: Sequence[int | str], value: object) -> list[str]:
    """Return the forms that an object may have at a place, in JSON with … for a value.

    Those with most of the fields of the given value come first, and of these the shortest.
    """
    given = set(value) if isinstance(value, Mapping) else {"urdf"} if _is_xml(value) else set[str]()
    forms = list[tuple[int, str]]()
    for model in _list_models_at(message, place):
        parts = []
        for name, field in model.model_fields.items():
            words = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
            if len(words) == 1:
                parts.append(f'"{name}": "{words[0]}"')
            elif field.is_required():
                parts.append(f'"{name}": …')
        shared = len(given.intersection(model.model_fields))
        forms.append((shared, f"{{{', '.join(parts)}}}"))
    return [form for _, form in sorted(forms, key=lambda each: (-each[0], len(each[1])))]


def _is_xml(value: object) -> bool:
    """Return whether a value is a text in XML, such as a URDF."""
    return isinstance(value, str) and value.lstrip()[:1] == "<"


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
