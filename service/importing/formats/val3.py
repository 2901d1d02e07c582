"""Data of a VAL3 program of Stäubli (`.dtx`, XML), read as a table of each array of joint positions.

The angles are in degrees, and the linear axis of a SCARA in mm, as the maker defines them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.importing import grid, limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.formats.elements import Element, read_elements
from jointstiff.service.importing.grid import Grid, Row

_LEAST_POSITIONS: Final = 3
_HEADERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "jointrx": tuple(f"J{number} [deg]" for number in range(1, 7)),
        "joint": tuple(f"J{number} [deg]" for number in range(1, 7)),
        "jointrs": ("J1 [deg]", "J2 [deg]", "J3 [mm]", "J4 [deg]"),
    }
)
"""Type of data → headers of its axes."""


def read_joint_data(file: str, content: bytes) -> list[Grid]:
    """Return a table of each array of joint positions; shorter arrays, such as a home position, are named.

    Raises:
        ImportFileError: the XML is damaged or beyond a limit, or has no array of joint positions.
    """
    root = read_elements(file, content)
    arrays = [each for each in root.walk() if each.attributes.get("type", "").casefold() in _HEADERS]
    tables = [each for each in arrays if len(each.children) >= _LEAST_POSITIONS]
    if not tables:
        reason = f"the VAL3 data have no array of {_LEAST_POSITIONS} joint positions"
        raise ImportFileError(Place(file), reason, "check that this is the right file")
    others = [quote(_name(each)) for each in arrays if each not in tables]
    notes = [f"joint positions of fewer postures were not read: {', '.join(others)}"] if others else []
    return [_build_grid(file, each, notes, is_only=len(tables) == 1) for each in tables]


def _name(array: Element) -> str:
    """Return the name of an array."""
    return array.attributes.get("name", "")


def _build_grid(file: str, array: Element, notes: list[str], *, is_only: bool) -> Grid:
    """Return an array of joint positions as a table, whose labels are the keys of the array.

    Raises:
        ImportFileError: a position lacks an axis, or the table or a cell is too large.
    """
    headers = _HEADERS[array.attributes["type"].casefold()]
    rows = tuple(_read_rows(file, array, len(headers)))
    if len(rows) > limits.MAX_ROWS or len(rows) * (1 + len(headers)) > limits.MAX_CELLS:
        raise grid.too_large_error(file, array.line)
    note = f"{len(rows)} joint positions of the VAL3 data {quote(_name(array))} were read"
    sheet = None if is_only else _name(array)[: limits.MAX_CELL_LENGTH]
    preview = FilePreview(file=file, format="text", encoding="utf-8", sheet=sheet, assumptions=[note, *notes])
    return Grid(preview, (Row(array.line, ("label", *headers)), *rows))


def _read_rows(file: str, array: Element, axis_count: int) -> Iterator[Row]:
    """Yield a row of each position.

    Raises:
        ImportFileError: a position lacks an axis, or a cell is too long.
    """
    for position in array.children:
        names = ("key", *(f"j{number}" for number in range(1, axis_count + 1)))
        cells = tuple(position.attributes.get(name, "").strip() for name in names)
        if not all(cells) or len(max(cells, key=len)) > limits.MAX_CELL_LENGTH:
            reason = f"a position of {quote(_name(array))} lacks an axis, or has too long a text"
            raise ImportFileError(Place(file, position.line), reason, "export the data of the program again")
        yield Row(position.line, cells)
