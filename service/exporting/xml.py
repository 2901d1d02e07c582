"""XML of exports: text is escaped by the library, comments and numbers here."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

from jointstiff.service.exporting.model import ExportedModel

Element = ElementTree.Element


def add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    """Add an element and return it."""
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def add_remarks(parent: Element, model: ExportedModel, *more: str) -> None:
    """Add what holds for all of the file, and what the file says of each joint."""
    joints = [model.remark_on(joint) for _, joint, _ in model.springs()]
    for line in (*model.remarks(), *more, *joints):
        comment(parent, line)


def comment(parent: Element, text: str) -> None:
    """Add a comment, in which XML forbids two dashes."""
    while "--" in text:
        text = text.replace("--", "- -")
    parent.append(ElementTree.Comment(f" {text} "))


def numbers(values: Iterable[float]) -> str:
    """Return numbers so that they read back the same."""
    return " ".join(repr(float(value)) for value in values)


def written(root: Element) -> bytes:
    """Return the document."""
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"
