"""Tables with a column for each posture, whose first column names the quantities, turned to rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from jointstiff.service.importing.grammar import Vocabulary, find_any_unit, lacks_number, split_unit
from jointstiff.service.importing.grid import Grid, Row, count_numbers, looks_like_a_number

_LEAST_JOINTS: Final = 3
"""Rows that name joints, at least."""
_MOST_JOINTS: Final = 7
"""Rows that name joints, at most: more are postures with such names."""
_LEAST_OTHERS: Final = 3
"""Further rows, at least: the coordinates of a target."""
_LEAST_POSTURES: Final = 3
_MOST_NAMES: Final = 3
"""Columns before those of the postures: groups, names and units."""
_MOST_OTHER_ROWS: Final = 3
"""Rows of texts, such as remarks, between the quantities."""


def turn_table(grid: Grid, words: Vocabulary) -> Grid:
    """Return a table whose first columns name joints and other quantities with these as columns.

    Any other table is returned unchanged.
    """
    first = _find_first_posture(grid.rows)
    quantities = _list_quantities(grid.rows, first)
    headers = _name_quantities(grid.rows, quantities, first)
    if not _name_joints_once(headers, words):
        return grid
    columns = [row.cells[first:] for row in quantities]
    above = grid.rows[: grid.rows.index(quantities[0])]
    labels = _find_labels(above, first, len(quantities[0].cells))
    if labels:
        headers, columns = ["label", *headers], [labels, *columns]
    line = quantities[0].line
    rows = [Row(line, tuple(headers)), *(Row(line, cells) for cells in zip(*columns, strict=True))]
    notes = [*grid.preview.assumptions, "each column of the file was read as a row"]
    return replace(grid, preview=grid.preview.model_copy(update={"assumptions": notes}), rows=tuple(rows))


def _find_first_posture(rows: Sequence[Row]) -> int:
    """Return the index of the first column with a number, of rows with enough numbers; 0 without names."""
    columns = (
        next(column for column, cell in enumerate(row.cells) if looks_like_a_number(cell))
        for row in rows
        if count_numbers(row) >= _LEAST_POSTURES
    )
    return min(columns, default=0)


def _list_quantities(rows: Sequence[Row], first: int) -> list[Row]:
    """Return the rows of numbers behind texts; none if their widths differ, or if they have remarks between.

    Rows above them, and rows with one text, are titles. `first` is the index of the first column of numbers.
    """
    quantities = [row for row in rows if _is_quantity(row, first)]
    widths = {len(row.cells) for row in quantities}
    if len(widths) != 1 or not 0 < first <= _MOST_NAMES or min(widths) - first < _LEAST_POSTURES:
        return []
    below = rows[rows.index(quantities[0]) :]
    others = [row for row in below if not _is_quantity(row, first) and sum(map(bool, row.cells)) > 1]
    return quantities if len(others) <= _MOST_OTHER_ROWS else []


def _is_quantity(row: Row, first: int) -> bool:
    """Return whether a row has a name before its numbers.

    A posture without a reading has no number here.
    """
    numbers = [cell for cell in row.cells[first:] if not lacks_number(cell)]
    return any(row.cells[:first]) and bool(numbers) and all(map(looks_like_a_number, numbers))


def _name_joints_once(headers: Sequence[str], words: Vocabulary) -> bool:
    """Return whether headers name joints, by words or in a unit of angles, and enough other quantities.

    Names such as A1 to A14 are labels of postures.
    """
    words.add_names_of_table(headers)
    meanings = [words.find(header) for header in headers]
    are_angles = [(find_any_unit(split_unit(header)[1] or "") or "")[:1] == ("angle",) for header in headers]
    joint_count = sum(
        is_angle or (meaning is not None and meaning.kind == "joint")
        for meaning, is_angle in zip(meanings, are_angles, strict=True)
    )
    return _LEAST_JOINTS <= joint_count <= _MOST_JOINTS and len(headers) - joint_count >= _LEAST_OTHERS


def _name_quantities(rows: Sequence[Row], quantities: Sequence[Row], first: int) -> list[str]:
    """Return the headers of quantities, whose names and units are in the columns before `first`.

    A name that occurs again is preceded by the title above it, such as `unloaded` above `X`, `Y` and `Z`.
    """
    has_units = first > 1 and all(_is_unit(row.cells[first - 1]) for row in quantities)
    name_count = first - 1 if has_units else first
    names = [" ".join(filter(None, own)) for own in _fill_down(quantities, name_count)]
    titles = _find_titles(rows)
    counts = Counter(names)
    headers = []
    for row, name in zip(quantities, names, strict=True):
        title = titles.get(row.line, "") if counts[name] > 1 else ""
        header = f"{title} {name}".strip()
        unit = row.cells[first - 1].strip("[]() -") if has_units else ""
        headers.append(f"{header} [{unit}]" if unit and split_unit(header)[1] is None else header)
    return headers


def _fill_down(rows: Sequence[Row], count: int) -> Iterator[Sequence[str]]:
    """Yield the first `count` cells of each row; a merged cell holds for the rows below."""
    group = ""
    for row in rows:
        group = row.cells[0] or group
        yield (group, *row.cells[1:count]) if count > 1 else row.cells[:count]


def _find_titles(rows: Sequence[Row]) -> dict[int, str]:
    """Return line of a row → last title above it, that is a row with one text."""
    title = ""
    titles = {}
    for row in rows:
        filled = [cell for cell in row.cells if cell]
        if len(filled) == 1 and not looks_like_a_number(filled[0]):
            title = filled[0]
        titles[row.line] = title
    return titles


def _is_unit(cell: str) -> bool:
    """Return whether a cell has a unit, or a sign that there is none."""
    text = cell.strip("[]() ")
    return text in ("", "-") or find_any_unit(text) is not None


def _find_labels(above: Sequence[Row], first: int, width: int) -> tuple[str, ...]:
    """Return the names of the postures in the row above the quantities; none without such a row."""
    for row in above:
        labels = row.cells[first:]
        if len(row.cells) == width and all(labels) and len(set(labels)) == len(labels):
            return labels
    return ()
