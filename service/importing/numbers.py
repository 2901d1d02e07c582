"""Numbers as people and instruments write them, read strictly or not at all."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from typing import Final

from jointstiff.schemas.fields import MAX_MAGNITUDE
from jointstiff.schemas.importing import DecimalMark
from jointstiff.service.importing.errors import Fault, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.limits import MAX_NUMBER_LENGTH

_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_THOUSANDS: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[.,][0-9]{3})+")
_POINT_ASSUMED: Final = (
    "the point was used as the decimal mark, although every number with one has three digits "
    "after it: check that it is not a thousands separator"
)


def looks_like_a_number(text: str) -> bool:
    """Return whether it is one, with either decimal mark."""
    return _NUMBER.fullmatch(text.replace(",", ".")) is not None


def decide_mark(
    grid: Grid, rows: Iterable[Row], columns: Collection[int], given: DecimalMark | None
) -> tuple[DecimalMark, str | None]:
    """Return the decimal mark of a file, and what had to be assumed for it; that of a sheet is a point.

    `1,234` alone may be 1.234 or 1234. It is 1.234 if some other number of the file has a comma that
    separates no thousands, such as `12,5` or `0,125`. Both marks in one file are refused.

    Raises:
        ImportFileError: the file does not decide it.
    """
    if grid.format == "xlsx":
        return "point", None
    if given is not None:
        return given, None
    first: dict[str, tuple[str, Place]] = {}
    decided: set[str] = set()  # marks that separate no thousands in some cell
    cells = ((row, column, row.cells[column]) for row in rows for column in columns)
    for row, column, text, mark in ((*cell, mark) for cell in cells for mark in ",." if mark in cell[2]):
        if mark not in first:
            first[mark] = text, grid.place(row, column)
        decided.update([] if _THOUSANDS.fullmatch(text) else [mark])
    if len(first) > 1:
        text, place = max(first.values(), key=lambda cell: (cell[1].line or 0, cell[1].column or 0))
        reason = f"{shown(text)}: the file has decimal points and decimal commas"
        raise ImportFileError(place, reason, "use one decimal mark and no thousands separators")
    if "," in first and "," not in decided:
        text, place = first[","]
        raise ImportFileError(
            place,
            f"{shown(text)} may have a decimal comma or a thousands separator, and no other number shows "
            "which",
            "give `decimal_mark`, or write a point",
            "decimal_mark",
        )
    if "," in first:
        return "comma", "the comma was used as the decimal mark"
    return "point", _POINT_ASSUMED if "." in first and "." not in decided else None


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
