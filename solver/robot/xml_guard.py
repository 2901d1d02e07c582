"""Read XML from strangers: well-formed, small, shallow, and without anything that expands.

Nothing here knows what a robot is. The parser is expat, one pass, and each limit is checked as the
element arrives, before anything is built from it. Document types, entities and processing
instructions are refused, so nothing expands and nothing is fetched.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from jointstiff.solver.errors import RobotError

__all__ = [
    "MAX_ATTRIBUTES",
    "MAX_ATTRIBUTE_LENGTH",
    "MAX_BYTES",
    "MAX_DEPTH",
    "MAX_ELEMENTS",
    "XmlElement",
    "check_size",
    "parse_xml",
]

MAX_BYTES = 2 * 1024 * 1024
"""Largest document, in bytes of UTF-8."""

MAX_DEPTH = 16
"""Deepest nesting of elements; the root is at depth 1."""

MAX_ELEMENTS = 20_000
"""Most elements in a document."""

MAX_ATTRIBUTES = 64
"""Most attributes of one element."""

MAX_ATTRIBUTE_LENGTH = 4_096
"""Most characters in one attribute's value, or in the name of an element or attribute."""

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


@dataclass(frozen=True)
class XmlElement:
    """An element without its text, which no reader here needs.

    Attributes:
        tag: name, with its prefix if it has one.
        attributes: values by name.
        line: line of the document on which it opens, from 1.
        children: elements directly within, in order.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[XmlElement] = field(default_factory=list)

    def named(self, tag: str) -> list[XmlElement]:
        """Return the children with this tag, in order."""
        return [child for child in self.children if child.tag == tag]

    def walk(self) -> Iterator[XmlElement]:
        """Yield this element and all within it; the depth is limited, so recursion is safe."""
        yield self
        for child in self.children:
            yield from child.walk()


def check_size(text: str) -> bytes:
    """Encode a document, unless it is too large or not text.

    Raises:
        RobotError: more than `MAX_BYTES`, control characters, or lone surrogates.
    """
    if len(text) > MAX_BYTES:
        raise _too_large(len(text))
    if control := _CONTROL.search(text):
        line = text.count("\n", 0, control.start()) + 1
        raise RobotError(
            f"a control character, {control.group()!a}",
            remedy="remove it: the document must be plain text",
            where=f"line {line}",
        )
    try:
        data = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise RobotError(
            "half of a surrogate pair, which is no character",
            remedy="send the document as UTF-8",
            where=f"line {text.count(chr(10), 0, error.start) + 1}",
        ) from None
    if len(data) > MAX_BYTES:
        raise _too_large(len(data))
    return data


def parse_xml(text: str) -> XmlElement:
    """Parse a document and return its root.

    Raises:
        RobotError: not well-formed, beyond a limit of this module, or with a document type, an
            entity or a processing instruction.
    """
    beginning = text.lstrip("\ufeff \t\r\n")
    if beginning and not beginning.startswith("<"):
        raise RobotError(
            f"no XML: it begins with {text[:40]!r}",
            remedy="give the document itself, not the name of its file",
            where="document",
        )
    data = check_size(text)
    parser = expat.ParserCreate("utf-8")  # whatever encoding the document claims to have
    builder = _Builder(parser)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise _malformed(error) from None
    return builder.root


class _Builder:
    """Receives expat's events, checks them, and builds the tree."""

    root: XmlElement

    def __init__(self, parser: expat.XMLParserType) -> None:
        self._parser = parser
        self._open: list[XmlElement] = []
        self._count = 0
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.StartDoctypeDeclHandler = self._doctype
        parser.ProcessingInstructionHandler = self._instruction

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        self._limit(self._count, MAX_ELEMENTS, "elements")
        self._limit(len(self._open) + 1, MAX_DEPTH, "levels of nesting")
        self._limit(len(attributes), MAX_ATTRIBUTES, "attributes of one element")
        for text in (tag, *attributes, *attributes.values()):
            self._limit(len(text), MAX_ATTRIBUTE_LENGTH, "characters in one name or attribute")
        element = XmlElement(tag, attributes, self._parser.CurrentLineNumber)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _doctype(self, *_declaration: object) -> None:
        self._refuse(
            "a document type declaration (DTD), which can define entities",
            "remove <!DOCTYPE …> and write the entities out",
        )

    def _instruction(self, target: str, _data: str) -> None:
        self._refuse(f"a processing instruction <?{target[:40]} …?>", "remove it")

    def _limit(self, count: int, most: int, what: str) -> None:
        if count > most:
            self._refuse(f"more than {most} {what}", "send only links and joints")

    def _refuse(self, reason: str, remedy: str) -> None:
        raise RobotError(reason, remedy=remedy, where=f"line {self._parser.CurrentLineNumber}")


def _too_large(size: int) -> RobotError:
    return RobotError(
        f"the document has {size} bytes or more",
        remedy=f"send at most {MAX_BYTES} bytes; only links and joints are needed",
        where="document",
    )


def _malformed(error: expat.ExpatError) -> RobotError:
    where = f"line {error.lineno}"
    if error.code == expat.errors.codes[expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT]:
        return RobotError(
            "something follows the end of the document, such as a second robot",
            remedy="send one robot in each document",
            where=where,
        )
    return RobotError(
        f"not well-formed XML: {expat.ErrorString(error.code)}",
        remedy="check the document with an XML tool",
        where=where,
    )
