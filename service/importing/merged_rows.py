"""Tables whose names, joints or force stand in the first of several rows only, as in merged cells."""

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
_MOST_NAMES: Final = 16
"""Most different names of targets or states."""
_OF_POSTURES: Final = frozenset(("name", "joint", "force", "moment", "load point"))
"""Kinds of columns that are the same for all rows of a posture."""
_OF_READINGS: Final = frozenset(("target", "state"))
"""Kinds of columns that are the same for some rows of a posture."""


class FilledRows(NamedTuple):
    """Rows whose empty cells were filled with the cells above, and a note for the user."""

    rows: tuple[Row, ...]
    note: str  # empty if no cell was filled


def fill_down(rows: Sequence[Row], headers: Sequence[str], meanings: Sequence[Meaning | None]) -> FilledRows:
    """Fill the empty cells of label, joints, force, target and state below the first row of each posture.

    Each posture, and each target or state in a posture, has to have as many rows as the others, or fewer;
    readings are never filled.

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
    begins_of_column: dict[int, Sequence[int]] = {}
    if starts:
        begins_of_column = dict.fromkeys(_list_columns_of_postures(rows, headers, meanings, starts), starts)
    postures = starts or _find_changes(rows, meanings)
    for column, meaning in enumerate(meanings):
        begins = _list_filled(rows, column)
        names_readings = meaning is not None and meaning.kind in _OF_READINGS
        may_name = meaning is None and len(begins) > len(postures) and _has_names(rows, column)
        are_of_postures = bool(postures) and set(postures) <= set(begins)
        if (names_readings or may_name) and are_of_postures and _are_alike(begins, len(rows)):
            begins_of_column[column] = begins
    return begins_of_column


def _find_starts(rows: Sequence[Row], meanings: Sequence[Meaning | None]) -> list[int]:
    """Return the first row of each posture, by the cells of its joints or else of the first column.

    None if each row has these cells, or if a posture has more rows than most: then a cell is missing.
    """
    starts = _list_filled(rows, _list_posture_columns(meanings)[0])
    return starts if _are_postures(starts, len(rows)) else []


def _find_changes(rows: Sequence[Row], meanings: Sequence[Meaning | None]) -> list[int]:
    """Return the first row of each posture, if each row has the cells of its joints, or of its label."""
    columns = _list_posture_columns(meanings)
    cells = [tuple(row.cells[column] for column in columns) for row in rows]
    changes = [number for number, own in enumerate(cells) if number == 0 or own != cells[number - 1]]
    return changes if all(map(all, cells)) and _are_postures(changes, len(rows)) else []


def _list_posture_columns(meanings: Sequence[Meaning | None]) -> list[int]:
    """Return the columns of joints; the first column if no header names joints."""
    return [column for column, meaning in enumerate(meanings) if meaning and meaning.kind == "joint"] or [0]


def _are_postures(starts: Sequence[int], count: int) -> bool:
    """Return whether rows are the first ones of postures of several rows, of `count` rows."""
    return len(starts) >= _LEAST_POSTURES and starts[0] == 0 and _are_alike(starts, count)


def _are_alike(begins: Sequence[int], count: int) -> bool:
    """Return whether most parts of `count` rows have the same several rows, and no part has more."""
    sizes = Counter(end - begin for begin, end in pairwise([*begins, count]))
    usual, usual_count = sizes.most_common(1)[0] if sizes else (0, 0)
    return usual > 1 and max(sizes) == usual and 2 * usual_count > len(begins)


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


def _has_names(rows: Sequence[Row], column: int) -> bool:
    """Return whether the cells of a column are a few texts or whole numbers, as names of readings are."""
    names = {row.cells[column] for row in rows} - {""}
    return len(names) <= _MOST_NAMES and all(
        name.isdigit() or not looks_like_a_number(name) for name in names
    )
