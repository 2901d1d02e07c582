"""Values in XML from strangers: strict numbers, children given once, harmless quotations."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.xml_guard import XmlElement

__all__ = [
    "LARGEST_ANGLE",
    "LARGEST_LENGTH",
    "ORIGIN",
    "quoted",
    "read_numbers",
    "read_triples",
    "single",
]

LARGEST_LENGTH = 100.0
"""Largest coordinate of an <origin> [m]."""

LARGEST_ANGLE = 1e3
"""Largest angle of an <origin> [rad]."""

ORIGIN = MappingProxyType({"xyz": LARGEST_LENGTH, "rpy": LARGEST_ANGLE})
"""Attributes of an <origin>, with their largest magnitudes."""

_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SPACE = re.compile(r"[ \t\r\n]+")


def single(element: XmlElement, tag: str, place: str) -> XmlElement | None:
    """Return the only child with this tag, or None.

    Raises:
        RobotError: there are several, of which other readers silently take the first.
    """
    found = element.named(tag)
    if len(found) > 1:
        raise RobotError(
            f"<{tag}> is given {len(found)} times",
            remedy="keep one of them",
            where=f"{place} <{tag}>",
        )
    return found[0] if found else None


def read_numbers(text: str, count: int, largest: float, where: str) -> list[float]:
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
    words = _SPACE.split(text.strip(" \t\r\n"))
    if len(words) != count or words == [""]:
        found = 0 if words == [""] else len(words)
        raise RobotError(
            f"needs exactly {count} {'number' if count == 1 else 'numbers'}, has {found}",
            remedy="write decimal numbers separated by spaces",
            where=where,
        )
    return [_number(word, largest, where) for word in words]


def read_triples(
    parent: XmlElement, tag: str, largest: Mapping[str, float], place: str
) -> dict[str, tuple[float, ...]]:
    """Read the attributes of a child, three numbers each; nothing if there is no such child.

    Args:
        parent: element that may have the child.
        tag: the child's tag.
        largest: the attributes that the child may have, and their largest magnitudes.
        place: the parent, for the message.

    Raises:
        RobotError: the child is given twice, has other attributes, or not three proper numbers.
    """
    element = single(parent, tag, place)
    if element is None:
        return {}
    if unknown := element.attributes.keys() - largest.keys():
        raise RobotError(
            f"unknown attribute {quoted(min(unknown))}",
            remedy=f"use only {' and '.join(largest)}",
            where=f"{place} <{tag}>",
        )
    return {
        name: tuple(read_numbers(text, 3, largest[name], f"{place} <{tag}> {name}"))
        for name, text in element.attributes.items()
    }


def quoted(text: str, length: int = 40) -> str:
    """Quote what a stranger wrote so that it is short and harmless in a message."""
    return ascii(text[:length]) + ("…" if len(text) > length else "")


def _number(word: str, largest: float, where: str) -> float:
    if not _NUMBER.fullmatch(word):
        raise RobotError(
            f"{quoted(word)} is not a finite decimal number",
            remedy="write it like 0.35 or -1.2e-3",
            where=where,
        )
    value = float(word)
    if not math.isfinite(value) or abs(value) > largest:
        raise RobotError(
            f"{quoted(word)} is beyond ±{largest:g}",
            remedy="check the number and its unit: m, rad, kg",
            where=where,
        )
    return value
