"""Rows with the same names that are repeated readings of a point, by their numbers alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.service.importing.grammar import is_repeat_header
from jointstiff.service.proposals.names.labels import omit_repeat_numbers
from jointstiff.service.proposals.names.rows import find_different_words
from jointstiff.service.proposals.tables.lengths import MOST_REPEAT, find_units_of_coordinates
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray

_MOST_LOADS: Final = 16
"""Most different numbers of a column that may be loads of the rows; noise and times have more."""

_NOISY_KINDS: Final = frozenset(("joint", "time", "ignored", "uncertainty"))
"""Kinds of columns that differ between repeats."""


def are_repeats(table: NumberTable, groups: Sequence[Sequence[int]]) -> bool:
    """Return whether groups of rows are repeats: near each other, and without a word or number of a load.

    Most groups have to have several rows: a single row twice may be a mistake.

    Args:
        table: numbers of a file.
        groups: indices of the rows with the same names.
    """
    repeated = [list(group) for group in groups if len(group) > 1]
    sizes_of_units = find_units_of_coordinates(table)
    if 2 * len(repeated) <= len(groups) or not sizes_of_units:
        return False
    columns = range(len(table.headers))
    if any(find_different_words(table, column, rows) for column in columns for rows in repeated):
        return False
    others = [column for column in columns if column not in sizes_of_units]
    are_near = all(
        measure_distance(table, rows, column, size) <= MOST_REPEAT
        for column, size in sizes_of_units.items()
        for rows in repeated
    )
    return are_near and not any(_may_be_load(table, column, repeated) for column in others)


def find_telling_column(table: NumberTable, groups: Sequence[Sequence[int]]) -> int | None:
    """Return the first column of few values, all different in rows with the same names; else None.

    The values may be states or loads, without the numbers of their repeats. `groups` are the rows with the
    same names; most have several.
    """
    if 2 * sum(len(rows) > 1 for rows in groups) <= len(groups):
        return None
    for column in range(len(table.headers)):
        texts = table.list_texts(column)
        word_of_text = omit_repeat_numbers(texts)
        texts = [word_of_text[text] for text in texts]
        are_few = 1 < len(set(texts)) <= _MOST_LOADS and 2 * len(set(texts)) <= len(texts)
        are_told = all(len({texts[row] for row in rows}) == len(rows) for rows in groups)
        if table.may_name(column) and not is_repeat_header(table.headers[column]) and are_few and are_told:
            return column
    return None


def measure_distance(table: NumberTable, rows: Sequence[int], column: int, size: float) -> float:
    """Return the greatest distance [m] of the known numbers of a column from their mean; 0 without numbers.

    Args:
        table: numbers of a file.
        rows: indices of the repeats.
        column: column of coordinates.
        size: size of the unit of the column [m].
    """
    numbers = table.table.numbers[list(rows), column]
    known = numbers[np.isfinite(numbers)]
    return size * float(np.abs(known - known.mean()).max()) if known.size else 0.0


def _may_be_load(table: NumberTable, column: int, groups: Sequence[Sequence[int]]) -> bool:
    """Return whether the rows of a group differ by a number that may be a load.

    A column that counts the repeats from 0 or 1, or that has other numbers in most rows, such as times and
    joints with noise, is none. Nor is one with a number in the first row only, as in merged cells.
    """
    meaning = table.meanings[column]
    of_groups = [table.table.numbers[list(rows), column] for rows in groups]
    numbers = [np.nan_to_num(own) for own in of_groups if np.isfinite(own[1:]).any()]
    differing = [own for own in numbers if np.ptp(own) > 0.0]
    is_noisy = meaning is not None and meaning.kind in _NOISY_KINDS
    if not differing or is_noisy:
        return False
    has_few = len(np.unique(np.concatenate(differing))) <= _MOST_LOADS
    is_load = meaning is not None and meaning.kind != "name"
    return is_load or (has_few and not all(map(_is_count, numbers)))


def _is_count(numbers: FloatArray) -> bool:
    """Return whether numbers (N,) count rows one by one."""
    return bool((np.diff(np.sort(numbers)) == 1.0).all())
