"""Numbers as people and instruments write them, read strictly or not at all."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, NamedTuple

from jointstiff.schemas.fields import MAX_MAGNITUDE
from jointstiff.schemas.importing import DecimalMark
from jointstiff.service.importing.errors import Fault, ImportFileError, Place, shown
from jointstiff.service.importing.limits import MAX_NUMBER_LENGTH

_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_THOUSANDS: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[.,][0-9]{3})+")
_POINT_ASSUMED: Final = (
    "the point was used as the decimal mark, although every number with one has three digits "
    "after it: check that it is not a thousands separator"
)


class MarkedCell(NamedTuple):
    """A cell with a point or a comma in it, and its line and column from 1."""

    text: str
    line: int
    column: int


def looks_like_a_number(text: str) -> bool:
    """Return whether it is one, with either decimal mark."""
    return _NUMBER.fullmatch(text.replace(",", ".")) is not None


def decide_mark(
    file: str, cells: Iterable[MarkedCell], given: DecimalMark | None
) -> tuple[DecimalMark, str | None]:
    """The decimal mark of a whole text file, and what had to be assumed for it.

    `1,234` alone may be 1.234 or 1234. It is 1.234 if some other number of the file has a comma that
    separates no thousands, such as `12,5` or `0,125`. Both marks in one file are refused.

    Args:
        file: its name, for messages.
        cells: all cells of numbers that have a point or a comma.
        given: by the caller.

    Raises:
        ImportFileError: the file does not decide it.
    """
    if given is not None:
        return given, None
    first, decided = _marks(cells)
    if len(first) > 1:
        later = max(first.values(), key=lambda cell: cell[1:])
        raise ImportFileError(
            Place(file, later.line, later.column),
            f"{shown(later.text)}: the file has decimal points and decimal commas",
            "use one decimal mark and no thousands separators",
        )
    if "," in first and "," not in decided:
        raise ImportFileError(
            Place(file, *first[","][1:]),
            f"the comma in {shown(first[','].text)} may be a decimal comma or a thousands separator, "
            "and no other number decides it",
            "give `decimal_mark`, or write a point",
            "decimal_mark",
        )
    if "," in first:
        return "comma", "the comma was used as the decimal mark"
    return "point", _POINT_ASSUMED if "." in first and "." not in decided else None


def _marks(cells: Iterable[MarkedCell]) -> tuple[dict[str, MarkedCell], set[str]]:
    """The first cell with each mark, and the marks that separate no thousands in some cell."""
    first: dict[str, MarkedCell] = {}
    decided: set[str] = set()
    for cell in cells:
        for mark in ",.":
            if mark in cell.text:
                first.setdefault(mark, cell)
                if mark not in decided and not _THOUSANDS.fullmatch(cell.text):
                    decided.add(mark)
    return first, decided


def read_number(text: str, mark: DecimalMark) -> float:
    """The number in a cell: digits, one decimal mark, an exponent; nothing else.

    Raises:
        Fault: it is none, or not finite, or beyond what any quantity of this field can be.
    """
    if not text:
        raise Fault("the cell is empty, but needs a number", "fill it in")
    other = "," if mark == "point" else "."
    plain = text if mark == "point" else text.replace(",", ".")
    if other in text or len(text) > MAX_NUMBER_LENGTH or not _NUMBER.fullmatch(plain):
        raise Fault(
            f"{shown(text)} is not a number with a decimal {mark}",
            "use digits with at most one decimal mark, no unit, no thousands separator, no NaN",
        )
    value = float(plain)
    if not abs(value) <= MAX_MAGNITUDE:
        raise Fault(f"{shown(text)} is outside ±{MAX_MAGNITUDE:g}", "check the number and its unit")
    return value
