"""Tables with a column for each posture, whose first column names the quantities, turned to rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from jointstiff.service.importing.grammar import Vocabulary, find_any_unit, lacks_number, split_unit
from jointstiff.service.importing.grid import Grid, Row, looks_like_a_number

_LEAST_JOINTS: Final = 3
"""Rows that name joints, at least."""
_MOST_JOINTS: Final = 7
"""Rows that name joints, at most: more are postures with such names."""
_LEAST_OTHERS: Final = 3
"""Further rows, at least: the coordinates of a target."""
_LEAST_POSTURES: Final = 3
_MOST_TITLES: Final = 3


def turn_table(grid: Grid, words: Vocabulary) -> Grid:
    """Return a table whose first column names joints and other quantities with these as columns.

    Any other table is returned unchanged.
    """
    names = _list_quantities(grid.rows, words)
    if not names:
        return grid
    has_units = all(_is_unit(row.cells[1]) for row in names)
    first = 2 if has_units else 1
    above = grid.rows[: grid.rows.index(names[0])]
    headers = [_name(row, has_units=has_units) for row in names]
    columns = [row.cells[first:] for row in names]
    labels = _find_labels(above, first, len(names[0].cells))
    if labels:
        headers, columns = ["label", *headers], [labels, *columns]
    line = names[0].line
    rows = [Row(line, tuple(headers)), *(Row(line, cells) for cells in zip(*columns, strict=True))]
    notes = [*grid.preview.assumptions, "each column of the file was read as a row"]
    return replace(grid, preview=grid.preview.model_copy(update={"assumptions": notes}), rows=tuple(rows))


def _list_quantities(rows: Sequence[Row], words: Vocabulary) -> list[Row]:
    """Return the rows that begin with a name and have numbers; none if they name too few joints, or too many.

    Names such as A1 to A14 are labels of postures.
    """
    named = [row for row in rows if _is_quantity(row)]
    titles = [row for row in rows if not _is_quantity(row)]
    widths = {len(row.cells) for row in named}
    if len(widths) != 1 or len(titles) > _MOST_TITLES or min(widths) <= _LEAST_POSTURES:
        return []
    words.add_names_of_table([row.cells[0] for row in named])
    meanings = [words.find(row.cells[0]) for row in named]
    joint_count = sum(meaning is not None and meaning.kind == "joint" for meaning in meanings)
    other_count = len(named) - joint_count
    is_turned = _LEAST_JOINTS <= joint_count <= _MOST_JOINTS and other_count >= _LEAST_OTHERS
    return named if is_turned else []


def _is_quantity(row: Row) -> bool:
    """Return whether a row begins with a name and has numbers, perhaps behind a unit.

    A posture without a reading has no number here.
    """
    first, *others = row.cells
    cells = others[1:] if others and _is_unit(others[0]) else others
    numbers = [cell for cell in cells if not lacks_number(cell)]
    is_named = bool(first) and not looks_like_a_number(first)
    return is_named and bool(numbers) and all(map(looks_like_a_number, numbers))


def _is_unit(cell: str) -> bool:
    """Return whether a cell has a unit, or a sign that there is none."""
    text = cell.strip("[]() ")
    return text in ("", "-") or find_any_unit(text) is not None


def _name(row: Row, *, has_units: bool) -> str:
    """Return the header of a quantity, with its unit if the second column has units."""
    unit = row.cells[1].strip("[]() -") if has_units else ""
    name = row.cells[0]
    return f"{name} [{unit}]" if unit and split_unit(name)[1] is None else name


def _find_labels(above: Sequence[Row], first: int, width: int) -> tuple[str, ...]:
    """Return the names of the postures in the row above the quantities; none without such a row."""
    for row in above:
        labels = row.cells[first:]
        if len(row.cells) == width and all(labels) and len(set(labels)) == len(labels):
            return labels
    return ()
