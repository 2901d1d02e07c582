"""Elements of a document in XML, parsed within limits, and the numbers and texts in them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Final, NamedTuple, NoReturn
from xml.parsers import expat

from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.grid import looks_like_a_number

_MAX_ELEMENTS: Final = 400_000
_MAX_DEPTH: Final = 64
_MOST_TAGS: Final = 12
"""Levels of elements with leaves."""
_MOST_NAMES: Final = 4
"""Names of an element that its leaves have."""
_MOST_CHARACTERS: Final = 40
"""Characters of a text that is a name."""
_LEAST_REPEATS: Final = 4
"""Elements of one kind with the same text, at least, that have the text as their name."""
_AXES: Final = ("x", "y", "z")
_OWN: Final = ""
"""Name of the text of an element with attributes or children."""
_NEXT_WORD: Final = re.compile(r"(?<=[a-z])[A-Z]")
_BETWEEN_NUMBERS: Final = re.compile(r"[\s;]+|,\s+")


@dataclass(slots=True)
class Element:
    """Element of a document."""

    tag: str  # namespace, a blank, name
    line: int
    attributes: Mapping[str, str] = field(default_factory=dict)
    parts: list[Element | str] = field(default_factory=list)  # elements and pieces of text, in their order

    @property
    def children(self) -> list[Element]:
        """Elements in the element."""
        return [part for part in self.parts if not isinstance(part, str)]

    @property
    def text(self) -> str:
        """Text of the element, without that of its children and without blanks at its ends."""
        return "".join(part for part in self.parts if isinstance(part, str)).strip()

    def find(self, tag: str) -> Element | None:
        """Return the first child with a tag; None without one."""
        return next((child for child in self.children if child.tag == tag), None)

    def walk(self, tag: str | None = None) -> Iterator[Element]:
        """Yield all elements below this one that have a tag, or all of them, in their order."""
        for child in self.children:
            if tag is None or child.tag == tag:
                yield child
            yield from child.walk(tag)

    @property
    def name(self) -> str:
        """Tag without its namespace."""
        return self.tag.rpartition(" ")[2]

    @property
    def is_field(self) -> bool:
        """Return whether the element has a text and nothing else, as an attribute of its parent has."""
        return not self.attributes and not self.children

    @property
    def fields(self) -> dict[str, str]:
        """Name → text of the attributes and of the children that are fields; empty name for the own text.

        Texts of children with one name are one text, with blanks between.
        """
        texts = {_OWN: [self.text]} if self.text and not self.is_field else {}
        for key, text in self.attributes.items():
            texts.setdefault(key.rpartition(" ")[2], []).append(text.strip())
        for child in self.children:
            if child.is_field:
                texts.setdefault(child.name, []).append(child.text)
        return {key: " ".join(each) for key, each in texts.items()}


class Leaf(NamedTuple):
    """Numbers of an element, or one of its texts, with the names that lead there."""

    line: int
    tags: tuple[str, ...]  # of the element, and of those around
    names: tuple[str, ...]  # texts of these elements that are names, and the name of the field
    values: tuple[str, ...]
    are_numbers: bool

    @property
    def is_point(self) -> bool:
        """Return whether the leaf has three numbers."""
        return self.are_numbers and len(self.values) == len(_AXES)


def list_leaves(root: Element) -> list[Leaf]:
    """Return the numbers and texts of a document, in their order.

    Texts that several elements of a kind have are names, such as of a state or a target. Fields x, y and z
    are one leaf. Tags that all leaves of three numbers have tell nothing, and are left out.
    """
    leaves = list(_walk(root, (), (), _find_names(root)))
    tags_of_points = [set(leaf.tags) for leaf in leaves if leaf.is_point]
    common = set.intersection(*tags_of_points) if tags_of_points else set[str]()
    return [leaf._replace(tags=tuple(tag for tag in leaf.tags if tag not in common)) for leaf in leaves]


_Text = tuple[str, str, str]
"""Name of an element, name of one of its fields, and text of this field."""


def _find_names(root: Element) -> set[_Text]:
    """Return the texts of fields that are names: elements of a kind have few of them, and each often."""
    counts = Counter(
        (element.name, key, text)
        for element in root.walk()
        for key, text in element.fields.items()
        if 0 < len(text) <= _MOST_CHARACTERS and not _read_numbers(text)
    )
    different = Counter((name, key) for name, key, _ in counts)
    return {
        (name, key, text)
        for (name, key, text), count in counts.items()
        if count >= max(_LEAST_REPEATS, different[name, key])
    }


def _walk(
    element: Element, tags: tuple[str, ...], names: tuple[str, ...], known: Collection[_Text]
) -> Iterator[Leaf]:
    """Yield the leaves of an element and of its children.

    Args:
        element: part of a document.
        tags: tags of the elements around.
        names: names of the elements around.
        known: texts that are names.
    """
    if len(tags) >= _MOST_TAGS:
        return
    fields = element.fields
    tags = (*tags, split_name(element.name))
    own_names = (text for key, text in fields.items() if (element.name, key, text) in known)
    names = (*names, *islice(own_names, _MOST_NAMES))
    values = {
        key: _read_numbers(text)
        for key, text in fields.items()
        if text and (element.name, key, text) not in known
    }
    coordinates = {key.casefold(): numbers for key, numbers in values.items() if key.casefold() in _AXES}
    point = [number for axis in _AXES for number in coordinates.get(axis, ())]
    is_point = len(point) == len(coordinates) == len(_AXES)
    if is_point:
        yield Leaf(element.line, tags, names, tuple(point), are_numbers=True)
    for key, numbers in values.items():
        if not (is_point and key.casefold() in _AXES):
            path = (*names, split_name(key)) if key else names
            own_values = numbers or (fields[key][:_MOST_CHARACTERS],)
            yield Leaf(element.line, tags, path, own_values, bool(numbers))
    for child in element.children:
        if not child.is_field:
            yield from _walk(child, tags, names, known)


def _read_numbers(text: str) -> tuple[str, ...]:
    """Return the numbers of a text, with blanks, semicolons or commas between; none of another text."""
    parts = tuple(part for part in _BETWEEN_NUMBERS.split(text) if part)
    if len(parts) == 1 and text.count(",") > 1:
        parts = tuple(text.split(","))
    return parts if all(map(looks_like_a_number, parts)) else ()


def split_name(name: str) -> str:
    """Return the words of the name of an element or attribute: `massKg` gives `mass kg`."""
    return _NEXT_WORD.sub(_begin_word, name)[:_MOST_CHARACTERS]


def _begin_word(letter: re.Match[str]) -> str:
    """Return a letter as the first of a word, small unless the word is this letter, such as an axis."""
    is_last = letter.end() == len(letter.string)
    return f" {letter[0] if is_last else letter[0].lower()}"


def read_elements(file: str, content: bytes) -> Element:
    """Return the root of the XML, without document types and within limits.

    Raises:
        ImportFileError: the XML is not well-formed in UTF-8, declares a document type, or exceeds a limit.
    """
    builder = _TreeBuilder(file)
    try:
        builder.parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = f"the XML is not well-formed: {expat.ErrorString(error.code)}"
        raise ImportFileError(Place(file, error.lineno), reason, "export the file again, in UTF-8") from None
    return builder.document.children[0]


class _TreeBuilder:
    """Builder of the tree of elements from expat's events; an exception in a handler stops expat."""

    def __init__(self, file: str) -> None:
        self.document = Element("", 0)
        self._file, self._open, self._count = file, [self.document], 0
        self.parser = expat.ParserCreate("utf-8", " ")  # whatever encoding the document claims to have
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda _tag: self._open.pop()
        self.parser.CharacterDataHandler = lambda text: self._open[-1].parts.append(text)
        self.parser.StartDoctypeDeclHandler = self._refuse_document_type

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        """Add an element.

        Raises:
            ImportFileError: there are too many elements or levels.
        """
        self._count += 1
        if self._count > _MAX_ELEMENTS or len(self._open) > _MAX_DEPTH:
            self._refuse(
                f"the XML has more than {_MAX_ELEMENTS} elements or {_MAX_DEPTH} levels", "split the file"
            )
        element = Element(tag, self.parser.CurrentLineNumber, attributes)
        self._open[-1].parts.append(element)
        self._open.append(element)

    def _refuse_document_type(self, *_declaration: object) -> None:
        """Refuse a document type, which can define entities."""
        self._refuse(
            "the XML declares a document type (DTD), which can define entities", "remove <!DOCTYPE …>"
        )

    def _refuse(self, reason: str, remedy: str) -> NoReturn:
        """Raise the error at the present line."""
        raise ImportFileError(Place(self._file, self.parser.CurrentLineNumber), reason, remedy)
