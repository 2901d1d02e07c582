"""Titles and comments of a table: the unit and the frame that they say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from jointstiff.service.importing.columns import Columns, spoken
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.header import collapsed
from jointstiff.service.importing.words import any_unit, unit_named

_AXES: Final = re.compile(r"AXES\s*=\s*(\w+)", re.IGNORECASE)
_AXES_UNIT: Final = re.compile(r"\bX\W+Y\W+Z\s*(?:\(\s*([^\W\d]+)\s*\)|in\s+([^\W\d]+))", re.IGNORECASE)
_FRAME: Final = re.compile(
    r"(?:\b(?:FRAME|(?:COORDINATE|REFERENCE)\s+SYSTEM|(?:KOORDINATEN|BEZUGS)SYSTEM|REP[ÈE]RE|R[ÉE]F[ÉE]RENTIEL)\s*[=:]"
    r"|\b(?:COORDINATE|WORKING|REFERENCE|ACTIVE)\s+FRAME\b)\s*[=:]*\s*(\S.*)",
    re.IGNORECASE,
)
_UNITS: Final = re.compile(
    r"(?:UNITÉ|UNIT|EINHEIT)(?:S|EN)?\b(?P<end>[^=:]{0,30}[=:]+)?\s*(?P<units>\S.*)", re.IGNORECASE
)
_UNIT: Final = re.compile(
    r"[\[(]\s*([^\W\d]+)\s*[\])]|\b(?:in|en)\s+([^\W\d]+)|(?<![\d\w.,])(?<!\d )(mm|inch|inches)(?!\w)",
    re.IGNORECASE,
)
"""A word in brackets, behind `in`, or a unit that is not of a number, as a reflector's diameter would be."""


Lines = tuple[tuple[int, str], ...]
"""Titles and comments: lines of the file, and their texts, in order."""


def read_remarks(grid: Grid, titles: Sequence[Row]) -> tuple[Lines, str | None, str | None]:
    """Return all remarks, the unit of x, y and z and the frame of positions that they say.

    As in `AXES = CARTESIAN: X, Y, Z (mm)`, `… Coordinate Frame 'A::R0'`, `Frame: A`.

    Raises:
        ImportFileError: other coordinates than x, y, z; a unit that we do not take; two frames.
    """
    lines = tuple(sorted([*((row.line, _as_text(row)) for row in titles), *grid.remarks]))
    unit = frame = None
    for line, text in lines:
        place, axes, match = Place(grid.file, line), _AXES.search(text), _AXES_UNIT.search(text)
        if axes and axes[1].upper() != "CARTESIAN":
            reason = f"the file has {shown(axes[1].lower())} coordinates"
            raise ImportFileError(place, reason, "export Cartesian coordinates x, y, z")
        word = (match[1] or match[2]) if match else ""
        known = unit_named(word) or unit_named(word.casefold())
        if known is not None and known[0] == "length":
            unit = unit or known[1]
        elif word and (axes or any_unit(word)):  # else it is prose
            reason = f"the unit {shown(word)} of x, y, z is not known"
            raise ImportFileError(place, reason, "export in mm, m or inches")
        if match := _FRAME.search(text):
            name = collapsed(match[1].rstrip(", \t")).strip("'\"")
            if frame not in (None, name):
                reason = f"the frame of the positions is {shown(name)} here, but {shown(frame or '')} above"
                raise ImportFileError(place, reason, "export one frame per file")
            frame = name
    return lines, unit, frame


def _as_text(title: Row) -> str:
    """Return a title as the text that a comment would be: `Frame;A::R0` as `Frame: A::R0`."""
    first, *others = [cell for cell in title.cells if cell]
    return f"{first}: {' '.join(others)}" if others else first


def check_units(file: str, remarks: Lines, columns: Columns, faults: Faults) -> None:
    """Refuse numbers in other units than a title or a comment names, such as `Units: inches` or `[m]`."""
    for line, text in remarks:
        match = _UNITS.search(text)
        words = re.findall(r"[^\s,;:()\[\]]+", match["units"]) if match else []
        known = [word for word in words if any_unit(word) and (word != "in" or len(words) == 1)]
        if match and not match["end"] and len(known) < len(words):
            known = []  # prose
        elif len(words) == 1 and not known and words[0].isalpha():
            reason = f"the unit {shown(words[0])} is not known"
            faults.report(Place(file, line), reason, "correct the remark, or remove it")
        for word in (*known, *map("".join, _UNIT.findall(text))):
            dimension, unit = any_unit(word) or (None, "")
            held = columns.units.get(dimension) if dimension else None
            if dimension and held and unit != held:
                reason = f"{shown(word)} is given here, but {dimension}s are in {spoken(held)}"
                remedy = "correct the unit, or remove the remark"
                faults.report(Place(file, line), reason, remedy, f"units.{dimension}")
