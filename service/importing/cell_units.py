"""Units within cells, such as `18.162°` or `12.3 mm`: numbers and units are separated."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from jointstiff.service.importing.grammar import split_unit
from jointstiff.service.importing.grid import Grid, Row, looks_like_a_number

_LEAST_ROWS: Final = 3
"""Fewest cells of a column with a unit."""
_NUMBER_AND_LETTERS: Final = re.compile(r"[-+]?[\d.,]{1,30}\s?[^\W\d_]{1,9}")
"""A number with letters behind it: a unit, or a part of a name such as `1u`."""
_DECIMAL: Final = re.compile(r"\d[.,]\d")
_LONG_UNITS: Final = frozenset(("m", "in"))
"""Units in which no arm's positions are whole numbers: `1m` and `2m` are names."""
_CELL: Final = re.compile(r"([-+]?[\d.,]{1,30}(?:[eE][-+]?\d{1,3})?)\s?(°|º|deg|rad|mm|µm|μm|um|m|in)")
"""A number with a unit of an angle or a length. Loads such as `50 kg` are words for states."""


def separate_units(grid: Grid) -> Grid:
    """Return a table without units in its cells; the header of a column has the unit of all its cells."""
    width = max((len(row.cells) for row in grid.rows), default=0)
    units = {column: unit for column in range(width) if (unit := _find_unit(grid.rows, column))}
    if not units:
        return grid
    first = next(
        number
        for number, row in enumerate(grid.rows)
        if any(column < len(row.cells) and _CELL.fullmatch(row.cells[column]) for column in units)
    )
    rows = list(grid.rows)
    for number, row in enumerate(rows):
        cells = list(row.cells)
        for column, unit in units.items():
            if column >= len(cells):
                continue
            match = _CELL.fullmatch(cells[column])
            if match is not None:
                cells[column] = match[1]
            elif number == first - 1 and cells[column] and split_unit(cells[column])[1] is None:
                cells[column] = f"{cells[column]} [{unit}]"
        rows[number] = replace(row, cells=tuple(cells))
    return replace(grid, rows=tuple(rows))


def _find_unit(rows: Sequence[Row], column: int) -> str:
    """Return the unit of all cells of a column below its header; empty unless they have one unit."""
    texts = [row.cells[column] for row in rows if column < len(row.cells) and row.cells[column]]
    matches = [_CELL.fullmatch(text) for text in texts]
    units = {match[2] for match in matches if match is not None}
    count = sum(match is not None for match in matches)
    if len(units) != 1 or count < _LEAST_ROWS:
        return ""
    first = next(number for number, match in enumerate(matches) if match is not None)
    others = [text for text, match in zip(texts[first:], matches[first:], strict=True) if match is None]
    has_bare_number = any(map(looks_like_a_number, texts))
    are_whole = units <= _LONG_UNITS and not any(map(_DECIMAL.search, texts))
    are_names = are_whole or any(map(_NUMBER_AND_LETTERS.fullmatch, others))
    return "" if has_bare_number or are_names else units.pop()
