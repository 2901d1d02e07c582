"""Unit and frame of positions in the comments of an export, as SpatialAnalyzer writes them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jointstiff.service.importing.errors import ImportFileError, shown
from jointstiff.service.importing.grid import Grid, Row

_AXES: Final = re.compile(r"AXES\s*=\s*(\w+)", re.IGNORECASE)
_UNIT: Final = re.compile(r"\bX\W+Y\W+Z\s*(?:\(\s*|in\s+)([^\W\d]+)\s*\)?\s*", re.IGNORECASE)
_FRAME: Final = re.compile(r"FRAME\s*=\s*(\S.*)", re.IGNORECASE)
_UNITS: Final = MappingProxyType(
    {
        **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
        **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
        **dict.fromkeys(("in", "inch", "inches"), "in"),
    }
)


@dataclass(frozen=True)
class Said:
    """Unit and frame of the positions."""

    unit: str | None = None  # of x, y and z
    frame: str | None = None  # its name


def read_comments(grid: Grid) -> Said:
    """Return what the comments of a file say: `AXES = CARTESIAN: X, Y, Z (mm)`, `FRAME = A::R0`.

    Raises:
        ImportFileError: other coordinates than x, y, z; an unknown unit; two that differ.
    """
    said: dict[str, str] = {}
    for comment in grid.comments:
        text = " ".join(", ".join(comment.cells).replace(",,", ",").split())
        if (axes := _AXES.search(text)) and axes[1].upper() != "CARTESIAN":
            raise ImportFileError(
                grid.place(comment),
                f"the file has {shown(axes[1].lower())} coordinates",
                "export Cartesian coordinates x, y, z",
            )
        if unit := _UNIT.search(text):
            _add(grid, comment, said, "unit", _unit(grid, comment, unit[1]))
        if frame := _FRAME.search(text):
            _add(grid, comment, said, "frame", frame[1].rstrip(", "))
    return Said(**said)


def _unit(grid: Grid, comment: Row, word: str) -> str:
    unit = _UNITS.get(word.casefold())
    if unit is None:
        raise ImportFileError(
            grid.place(comment),
            f"the unit {shown(word)} of x, y, z is not known",
            "export in mm, m or inches",
        )
    return unit


def _add(grid: Grid, comment: Row, said: dict[str, str], kind: str, value: str) -> None:
    if said.setdefault(kind, value) != value:
        raise ImportFileError(
            grid.place(comment),
            f"the {kind} of the positions is {shown(value)}, but {shown(said[kind])} in an earlier comment",
            "export one frame and one unit per file",
        )
