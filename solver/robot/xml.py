"""Parse XML from strangers: a document of bounded size into a tree with line numbers.

The parser is expat, one pass, and each limit is checked as an element arrives, before anything is
built from it. Document types, entities and processing instructions are refused, so nothing expands
and nothing is fetched; text and comments are not kept. Nothing here knows about robots.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from jointstiff.solver.errors import RobotError

MAX_BYTES = 2 * 1024 * 1024
"""Largest document, in bytes of UTF-8; text and comments have no other limit."""

MAX_DEPTH = 16
"""Maximum depth of elements; the root is at depth 1."""

MAX_ELEMENTS = 20_000
"""Maximum number of elements in a document."""

MAX_ATTRIBUTES = 64
"""Maximum number of attributes of one element."""

MAX_ATTRIBUTE_LENGTH = 4_096
"""Maximum length of an attribute's value, or of the name of an element or attribute."""

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SPACE = re.compile(r"[ \t\r\n]+")


@dataclass(frozen=True)
class XmlElement:
    """An element without its text."""

    tag: str  #: name, with its prefix if it has one
    attributes: dict[str, str]  #: values by name
    line: int  #: line of the document on which it opens, from 1
    children: list[XmlElement] = field(default_factory=list)  #: elements directly within, in order

    def named(self, tag: str) -> list[XmlElement]:
        """Return the children with this tag, in order."""
        return [child for child in self.children if child.tag == tag]

    def only(self, tag: str, place: str) -> XmlElement | None:
        """Return the only child with this tag, or None.

        Raises:
            RobotError: there are several, of which other readers silently take the first.
        """
        children = self.named(tag)
        if len(children) > 1:
            where = f"{place} <{tag}>"
            raise RobotError(
                f"<{tag}> is given {len(children)} times", remedy="keep one of them", where=where
            )
        return children[0] if children else None

    def walk(self) -> Iterator[XmlElement]:
        """Yield this element and all within it; the depth is limited, so recursion is safe."""
        yield self
        for child in self.children:
            yield from child.walk()


def parse_xml(text: str) -> XmlElement:
    """Parse a document and return its root.

    Raises:
        RobotError: not well-formed, beyond a limit of this module, or with a document type, an
            entity, a processing instruction or a control character.
    """
    beginning = text[: MAX_BYTES + 1].lstrip("\ufeff \t\r\n")
    if beginning and not beginning.startswith("<"):
        raise RobotError(
            f"this is not XML: it begins with {text[:40]!r}",
            remedy="send the document itself, not its file name",
            where="document",
        )
    data = _encode(text)
    parser = expat.ParserCreate("utf-8")  # whatever encoding the document claims to have
    builder = _Builder(parser)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = f"not well-formed XML: {expat.ErrorString(error.code)}"
        remedy = "check the document with an XML tool"
        if error.code == expat.errors.codes[expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT]:
            reason = "there is content after the end of the document, such as a second robot"
            remedy = "send one robot per document"
        raise RobotError(reason, remedy=remedy, where=f"line {error.lineno}") from None
    return builder.root


def read_numbers(text: str, count: int, largest: float, where: str) -> tuple[float, ...]:
    """Read decimal numbers separated by spaces, exactly as many as needed.

    Args:
        text: for instance ``"0 0.35 1e-3"``.
        count: how many numbers there must be.
        largest: largest magnitude that makes sense, in the unit of the numbers.
        where: place for the message.

    Raises:
        RobotError: another count, another notation (hexadecimal, underscores, inf, nan, a comma),
            or a number beyond `largest`.
    """
    words = [word for word in _SPACE.split(text) if word]
    if len(words) != count:
        raise RobotError(
            f"needs exactly {count} {'number' if count == 1 else 'numbers'}, has {len(words)}",
            remedy="write decimal numbers separated by spaces",
            where=where,
        )
    return tuple(_number(word, largest, where) for word in words)


def quoted(text: str, length: int = 40) -> str:
    """Quote text from a stranger so that it is short and harmless in a message."""
    return ascii(text[:length]) + ("…" if len(text) > length else "")


class _Builder:
    """Check expat's events and build the tree from them.

    An exception in a handler stops expat at once.
    """

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
            "it has a document type declaration (DTD), which can define entities",
            "remove <!DOCTYPE …> and write the entities out",
        )

    def _instruction(self, target: str, _data: str) -> None:
        self._refuse(f"it has a processing instruction <?{target[:40]} …?>", "remove it")

    def _limit(self, count: int, most: int, what: str) -> None:
        if count > most:
            self._refuse(f"it has more than {most} {what}", "send only links and joints")

    def _refuse(self, reason: str, remedy: str) -> None:
        raise RobotError(reason, remedy=remedy, where=f"line {self._parser.CurrentLineNumber}")


def _encode(text: str) -> bytes:
    """Encode a document, unless it is too large or not text."""
    if len(text) <= MAX_BYTES and (control := _CONTROL.search(text)):
        reason, remedy = (
            f"it has a control character, {control.group()!a}",
            "remove it: the document must be plain text",
        )
        raise RobotError(reason, remedy=remedy, where=_line(text, control.start()))
    try:
        data = text.encode("utf-8") if len(text) <= MAX_BYTES else b""
    except UnicodeEncodeError as error:
        reason, remedy = (
            "it has half of a surrogate pair, which is no character",
            "send the document as UTF-8",
        )
        raise RobotError(reason, remedy=remedy, where=_line(text, error.start)) from None
    if (size := max(len(text), len(data))) > MAX_BYTES:
        raise RobotError(
            f"the document has {size} bytes or more",
            remedy=f"send at most {MAX_BYTES} bytes; only links and joints are needed",
            where="document",
        )
    return data


def _line(text: str, position: int) -> str:
    return f"line {text.count(chr(10), 0, position) + 1}"


def _number(word: str, largest: float, where: str) -> float:
    if not _NUMBER.fullmatch(word):
        remedy = "write it like 0.35 or -1.2e-3"
        raise RobotError(f"{quoted(word)} is not a finite decimal number", remedy=remedy, where=where)
    value = float(word)
    if not abs(value) <= largest:
        remedy = "check the number and its unit: lengths in m, angles in rad"
        raise RobotError(f"{quoted(word)} is outside ±{largest:g}", remedy=remedy, where=where)
    return value
