"""Elements of a document in XML, parsed within limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NoReturn
from xml.parsers import expat

from jointstiff.service.importing.errors import ImportFileError, Place

_MAX_ELEMENTS: Final = 400_000
_MAX_DEPTH: Final = 64


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
