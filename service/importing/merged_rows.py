"""Tables whose label, joints, state or force stand in the first of several rows only, as in merged cells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

from jointstiff.service.importing.grammar import Meaning, find_unit_of_size
from jointstiff.service.importing.grid import Row, looks_like_a_number

_LEAST_POSTURES: Final = 3
_JOINTS: Final = range(3, 8)
"""Numbers of joints of a robot whose headers name none."""
_LEAST_READINGS: Final = 3
"""Columns with a number in each row, at least: the coordinates of a target."""
_OF_POSTURES: Final = frozenset(("name", "joint", "force", "moment", "load point"))
"""Kinds of columns that are the same for all rows of a posture."""


class FilledRows(NamedTuple):
    """Rows whose empty cells were filled with the cells above, and a note for the user."""

    rows: tuple[Row, ...]
    note: str  # empty if no cell was filled


def fill_down(rows: Sequence[Row], headers: Sequence[str], meanings: Sequence[Meaning | None]) -> FilledRows:
    """Fill the empty cells of label, joints, force and state below the first row of each posture.

    Each posture has to have as many rows as the others, or fewer; readings are never filled.

    Args:
        rows: rows of data, as long as the header.
        headers: text of each column; empty texts without a header.
        meanings: meaning of each header; None of an unknown one.
    """
    begins_of_column = _find_begins(rows, headers, meanings)
    if not begins_of_column:
        return FilledRows(tuple(rows), "")
    names = ", ".join(headers[column] or f"column {column + 1}" for column in sorted(begins_of_column))
    note = f"empty cells of {names} below the first row of a posture have the cell above"
    source_of_cell = {
        (number, column): begin
        for column, begins in begins_of_column.items()
        for begin, end in pairwise([*begins, len(rows)])
        for number in range(begin + 1, end)
    }
    filled = []
    for number, row in enumerate(rows):
        sources = [rows[source_of_cell.get((number, column), number)] for column in range(len(row.cells))]
        cells = tuple(source.cells[column] for column, source in enumerate(sources))
        kinds = None
        if row.kinds is not None:
            kinds = tuple((source.kinds or row.kinds)[column] for column, source in enumerate(sources))
        filled.append(replace(row, cells=cells, kinds=kinds))
    return FilledRows(tuple(filled), note)


def _find_begins(
    rows: Sequence[Row], headers: Sequence[str], meanings: Sequence[Meaning | None]
) -> dict[int, Sequence[int]]:
    """Return column → rows whose cells hold for the empty cells below them; arguments as of `fill_down`."""
    starts = _find_starts(rows, meanings)
    if not starts:
        return {}
    columns = _list_columns_of_postures(rows, headers, meanings, starts)
    begins_of_column: dict[int, Sequence[int]] = dict.fromkeys(columns, starts)
    for column, meaning in enumerate(meanings):
        begins = _list_filled(rows, column)
        is_state = meaning is not None and meaning.kind == "state"
        if is_state and _are_even(begins, starts, len(rows)):
            begins_of_column[column] = begins
    return begins_of_column


def _find_starts(rows: Sequence[Row], meanings: Sequence[Meaning | None]) -> list[int]:
    """Return the first row of each posture, by the cells of its joints or else of the first column.

    None if each row has these cells, or if a posture has more rows than most: then a cell is missing.
    """
    joints = [column for column, meaning in enumerate(meanings) if meaning and meaning.kind == "joint"]
    starts = _list_filled(rows, joints[0] if joints else 0)
    sizes = Counter(end - begin for begin, end in pairwise([*starts, len(rows)]))
    usual, count = sizes.most_common(1)[0] if sizes else (0, 0)
    are_alike = usual > 1 and max(sizes) == usual and 2 * count > len(starts)
    return starts if are_alike and starts[0] == 0 and len(starts) >= _LEAST_POSTURES else []


def _list_filled(rows: Sequence[Row], column: int) -> list[int]:
    """Return the rows whose cell in a column is not empty."""
    return [number for number, row in enumerate(rows) if row.cells[column]]


def _list_columns_of_postures(
    rows: Sequence[Row], headers: Sequence[str], meanings: Sequence[Meaning | None], starts: Sequence[int]
) -> list[int]:
    """Return the columns of label, joints and force that are filled in the first row of each posture only.

    An unknown first column has labels. Unknown columns of numbers are joints if no header names joints, there
    are as many as a robot has, and three other columns have a number in each row.
    """
    in_first = [column for column in range(len(headers)) if _list_filled(rows, column) == list(starts)]
    named = [column for column in in_first if _is_of_posture(headers[column], meanings[column])]
    unknown = [column for column in in_first if meanings[column] is None and column not in named]
    labels = [column for column in unknown if column == 0]
    numbers = [column for column in unknown if column and _has_numbers(rows, column, starts)]
    has_joints = any(meaning is not None and meaning.kind == "joint" for meaning in meanings)
    readings = [column for column in range(len(headers)) if _has_numbers(rows, column, range(len(rows)))]
    may_be_joints = len(numbers) in _JOINTS and len(readings) >= _LEAST_READINGS and not has_joints
    return [*labels, *named, *(numbers if may_be_joints else [])]


def _is_of_posture(header: str, meaning: Meaning | None) -> bool:
    """Return whether a header names what is the same for all rows of a posture."""
    if meaning is None:
        return find_unit_of_size(header) is not None
    return meaning.kind in _OF_POSTURES


def _has_numbers(rows: Sequence[Row], column: int, numbers: Sequence[int]) -> bool:
    """Return whether the cells of a column are numbers in some rows."""
    return all(looks_like_a_number(rows[number].cells[column]) for number in numbers)


def _are_even(begins: Sequence[int], starts: Sequence[int], count: int) -> bool:
    """Return whether states begin with each posture, and all have as many rows, of `count` rows."""
    lengths = {end - begin for begin, end in pairwise([*begins, count])}
    return set(starts) <= set(begins) and len(lengths) == 1 and max(lengths) > 1
