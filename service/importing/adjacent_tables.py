"""Tables side by side in one sheet, each with its own column of labels, read as a table each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

from jointstiff.service.importing.grid import LEAST_NUMBERS, Grid, Row, count_numbers, looks_like_a_number

_LEAST_ROWS: Final = 3
_LEAST_COMMON: Final = 0.5
"""Least fraction of the labels of a table that the first table has, too."""


def split_adjacent(grid: Grid) -> list[Grid]:
    """Return the tables that are side by side in a sheet; any other sheet unchanged.

    The header of the first column, above labels, occurs again above the same labels. Each table has the name
    of the sheet and of the title above its header.
    """
    start = next((number for number, row in enumerate(grid.rows) if count_numbers(row) >= LEAST_NUMBERS), 0)
    rows = grid.rows[start:]
    if start == 0 or len(rows) < _LEAST_ROWS:
        return [grid]
    width = max(len(row.cells) for row in grid.rows)
    above = [row.resize(width) for row in grid.rows[:start]]
    header, resized = above[-1], [row.resize(width) for row in rows]
    starts = [column for column, cell in enumerate(header.cells) if cell and cell == header.cells[0]]
    if len(starts) < 2 or not _have_common_labels(resized, starts):
        return [grid]
    ranges = [range(first, end) for first, end in pairwise((*starts, width))]
    titles = above[-2].cells if len(above) > 1 else ("",) * width
    tables = [_cut_rows(header, titles, resized, columns) for columns in ranges]
    if any(max(map(count_numbers, table)) < LEAST_NUMBERS for table in tables):
        return [grid]
    return [
        _name_table(grid, number, _find_title(header, titles, columns), table)
        for number, (columns, table) in enumerate(zip(ranges, tables, strict=True), 1)
    ]


def _have_common_labels(rows: Sequence[Row], starts: Sequence[int]) -> bool:
    """Return whether columns have labels, no decimal numbers, and most of each are labels of the first."""
    labels = [{row.cells[start] for row in rows if row.cells[start]} for start in starts]
    are_labels = not any(
        looks_like_a_number(label) and not label.isdecimal() for own in labels for label in own
    )
    are_common = all(len(own & labels[0]) > _LEAST_COMMON * len(own) for own in labels)
    return are_labels and are_common and len(labels[0]) >= _LEAST_ROWS


def _cut_rows(header: Row, titles: Sequence[str], rows: Sequence[Row], columns: range) -> list[Row]:
    """Return the header and the rows of a table, those with a label or a number, without empty columns.

    A column without a header has the text above it, such as `Remarks`.
    """
    texts = tuple(cell or title for cell, title in zip(header.cells, titles, strict=True))
    named = replace(header, cells=texts)
    filled = [row for row in rows if any(row.cells[column] for column in columns)]
    kept = [column for column in columns if any(row.cells[column] for row in (named, *filled))]
    return [_pick(row, kept) for row in (named, *filled)]


def _pick(row: Row, columns: Sequence[int]) -> Row:
    """Return a row with some of its columns."""
    kinds = None if row.kinds is None else tuple(row.kinds[column] for column in columns)
    return Row(row.line, tuple(row.cells[column] for column in columns), kinds)


def _find_title(header: Row, titles: Sequence[str], columns: range) -> str:
    """Return the first text above the header of a table; empty without one."""
    return next((titles[column] for column in columns if header.cells[column] and titles[column]), "")


def _name_table(grid: Grid, number: int, title: str, rows: Sequence[Row]) -> Grid:
    """Return one of the tables, which has the name of the sheet and its title."""
    name = f"{grid.preview.sheet or ''} {title or f'table {number}'}".strip()
    notes = [*grid.preview.assumptions, f"table {number} of several side by side"]
    preview = grid.preview.model_copy(update={"sheet": name, "assumptions": notes})
    return replace(grid, preview=preview, rows=tuple(rows))
